"""The program: verbs, exit status, and one line on stderr for whatever the user can mend.

0 done; 1 a check failed; 2 bad use, bad input, or data that cannot give the answer.
"""

from __future__ import annotations

import os
import sys
from io import TextIOWrapper

import typer

from ..errors import ContactWrenchError
from ..version import __version__
from .calibrate import calibrate
from .compensate import compensate
from .demo import demo
from .diagnose import diagnose
from .diff import diff
from .export import export
from .info import info
from .options import MOST_COLUMNS
from .outputs import guarded
from .plan import plan
from .show import show
from .simulate import simulate
from .verify import verify
from .weigh import weigh

CHECK_FAILED = 1
BAD = 2

app = typer.Typer(
    name="contactwrench",
    help="From a raw wrist force/torque sensor to the pure contact wrench.",
    epilog="Every verb has --help. Exit status: 0 done; 1 a check failed; 2 bad use, bad input, or poses that cannot "
    "give the answer, with one line on stderr that says what to do.",
    add_completion=False,
    no_args_is_help=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": MOST_COLUMNS},
)
for verb in (info, plan, calibrate, diagnose, compensate, verify, weigh, show, diff, export, simulate, demo):
    app.command()(guarded(verb))


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
    if sys.stdout is None:  # closed by whoever started the program
        sys.stdout = os.fdopen(os.open(os.devnull, os.O_WRONLY), "w", encoding="utf-8")
    if isinstance(sys.stdout, TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")
    sys.exit(exit_status(program, name))


def exit_status(program: typer.Typer = app, name: str = "contactwrench") -> int:
    """Run the program: its exit status."""
    try:
        status = program(prog_name=name, standalone_mode=False)
        sys.stdout.flush()
    except ContactWrenchError as error:
        return _say(str(error))
    except typer.TyperException as error:
        context = getattr(error, "ctx", None)
        command = name if context is None else context.command_path
        return _say(f"{error.format_message().rstrip('.')}: try '{command} --help'")
    except typer.Abort:
        return _say("interrupted")
    except (BrokenPipeError, SystemExit):  # the reader has seen enough; typer makes the first into the second
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except OSError as error:
        return _say(f"standard output cannot be written ({error.strerror}): check where it goes")
    return status if isinstance(status, int) else 0


def _say(message: str) -> int:
    print(f"contactwrench: {' '.join(message.split())}", file=sys.stderr)
    return BAD
