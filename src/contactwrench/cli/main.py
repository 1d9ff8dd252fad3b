"""The program: verbs, exit status, and one line on stderr for whatever the user can mend.

0 done; 1 a check failed; 2 bad use, bad input, or data that cannot give the answer; 130 Ctrl-C (__main__.py).
"""

from __future__ import annotations

import logging
import os
import re
import sys
import traceback
from itertools import pairwise
from typing import Any

import typer
from typer.core import TyperCommand, TyperGroup

from ..errors import BEFORE, ContactWrenchError, InputError, shortened, visible
from ..version import __version__
from .calibrate import calibrate
from .compensate import compensate
from .demo import demo
from .devices import devices
from .diagnose import diagnose
from .diff import diff
from .export import export
from .info import info
from .lab import lab
from .live import live
from .options import MOST_COLUMNS
from .outputs import guarded
from .plan import plan
from .show import show
from .simulate import simulate
from .streams import open_streams
from .verify import verify
from .weigh import weigh

ARGUMENTS, OWN = "Arguments", "Options"


class Verb(TyperCommand):
    """A verb whose options are in sections, each in that of its panel."""

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write arguments and options."""
        sections: dict[str, list[tuple[str, str]]] = {ARGUMENTS: [], OWN: []}
        for parameter in self.get_params(ctx):
            if record := parameter.get_help_record(ctx):
                own = ARGUMENTS if parameter.param_type_name == "argument" else OWN
                sections.setdefault(getattr(parameter, "rich_help_panel", None) or own, []).append(record)
        for title, records in sections.items():
            if records:
                with formatter.section(title):
                    formatter.write_dl(records)


class Verbs(TyperGroup):
    """The program, whose verbs are not cut off in mid-sentence."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write each verb with the first paragraph of its help."""
        verbs = [(name, self.commands[name].help or "") for name in self.list_commands(ctx)]
        with formatter.section("Commands"):
            formatter.write_dl([(name, " ".join(help.split("\n\n")[0].split())) for name, help in verbs])


BAD = 2
NO_RECORDINGS = ("-o", "--output", "--report", "--out", "-c", "--calibration", "--prior")
TRACEBACK = "CONTACTWRENCH_TRACEBACK"
"""The variable of the environment that asks for the traceback of an error of the program's own."""

OF_TYPES = (
    ("Input should be a valid integer, .*", "expected a whole number"),
    ("Input should be a valid number, .*", "expected a number"),
    ("Value error, .* is not one of ", "expected one of "),
)
"""What typer says of an option of another type, and what this program does behind what it found."""
OF_MEMORY = ("failed to map segment", "start new thread")
"""What else than a MemoryError says that there is too little: a library that is not loaded, a thread."""
NO_MEMORY = (
    "needs more memory than there is, or than a whole file of its size, expected a recording that fits: split it, or "
    "is it damaged"
)

app = typer.Typer(
    name="contactwrench",
    cls=Verbs,
    help="From a raw wrist force/torque sensor to the pure contact wrench.",
    epilog="Every verb has --help. Exit status: 0 done; 1 a check failed; 2 bad use, bad input, or poses that cannot "
    "give the answer, with one line on stderr that says what to do; 130 interrupted by Ctrl-C (143, 129: by a signal).",
    add_completion=False,
    no_args_is_help=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": MOST_COLUMNS},
)
OF_FILES = (info, plan, calibrate, diagnose, compensate, verify, weigh, show, diff, export)
OF_DEVICES = (simulate, live, devices, lab, demo)
for verb in (*OF_FILES, *OF_DEVICES):
    app.command(cls=Verb)(guarded(verb))


def _print_version(asked: bool) -> None:
    if asked:
        typer.echo(f"contactwrench {__version__}")
        raise typer.Exit()


@app.callback()
def _program(
    version: bool = typer.Option(False, "--version", help="Print the version.", callback=_print_version, is_eager=True),
) -> None:
    """From a raw wrist force/torque sensor to the pure contact wrench."""


def main(program: typer.Typer = app, name: str = "contactwrench") -> None:
    """Run the program and leave with its exit status."""
    open_streams()
    logging.getLogger().addHandler(logging.NullHandler())
    try:
        status = exit_status(program, name)
    except Exception as error:
        if os.environ.get(TRACEBACK):
            traceback.print_exc()
        status = _say(
            f"{_largest_input()}found {type(error).__name__} ({' '.join(str(error).split())}), expected no such error, "
            f"which is the program's: report it with what {TRACEBACK}=1 shows"
        )
    sys.exit(status)


def exit_status(program: typer.Typer = app, name: str = "contactwrench") -> int:
    """Run the program: its exit status. What is an error of the program itself is raised."""
    try:
        if "" in sys.argv[1:]:
            raise InputError("found an empty argument, expected a file or a value: is a variable of the shell not set?")
        status = program(prog_name=name, standalone_mode=False)
        sys.stdout.flush()
    except (BrokenPipeError, SystemExit):  # the reader has seen enough; typer makes the first into the second
        return 0
    except (OSError, UnicodeEncodeError) as error:
        return _say(_of_the_system(error))
    except ContactWrenchError as error:
        return _say(str(error))
    except typer.TyperException as error:
        context = getattr(error, "ctx", None)
        command = name if context is None else context.command_path
        message = " ".join(error.format_message().split()).rstrip(".")
        found = "".join(f"found {wrong['input']!r}, " for wrong in getattr(error.__cause__, "errors", list)()[:1])
        for theirs, ours in OF_TYPES:
            message = re.sub(theirs, (found + ours).replace("\\", r"\\"), message)
        return _say(f"{message}: try '{command} --help'")
    except typer.Abort as error:  # of typer's own, where a verb raised EOFError
        raise error.__cause__ or error from None
    except (MemoryError, ImportError, RuntimeError) as error:
        if not (isinstance(error, MemoryError) or any(words in str(error) for words in OF_MEMORY)):
            raise
        return _say(f"{_largest_input()}{NO_MEMORY}")
    return status if isinstance(status, int) else 0


def _of_the_system(error: OSError | UnicodeEncodeError) -> str:
    """What could not be opened, read or written, and why."""
    if isinstance(error, UnicodeEncodeError):
        return f"found {error.object!r}, which is not UTF-8, expected a text that is: write it so"
    try:
        os.getcwd()
    except FileNotFoundError:
        return "found that the current folder was deleted, expected one that is there: change to another with cd"
    if isinstance(error, ContactWrenchError):
        return str(error)
    where = f"{error.filename}: " if error.filename is not None else _largest_input()
    return f"{where}cannot be read or written ({(error.strerror or str(error)).lower()}): check the path and its disk"


def _largest_input() -> str:
    """The recording, as far as the command line tells, to begin a message with."""
    files = [this for option, this in pairwise(sys.argv[1:]) if option not in NO_RECORDINGS and os.path.exists(this)]
    return f"{max(files, key=lambda file: (os.path.isdir(file), os.path.getsize(file)))}: " if files else ""


def _say(message: str) -> int:
    print(shortened(f"{BEFORE}{visible(message)}"), file=sys.stderr)
    return BAD
