"""The options that verbs share: how a recording is written, which calibration and gravity; how a result is printed."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Collection
from inspect import Parameter, Signature, signature
from pathlib import Path
from shutil import get_terminal_size
from typing import Annotated, Any, NamedTuple, TypeVar

import numpy as np
import typer

from ..errors import InputError, shortened, visible
from ..geometry.arrays import Array
from ..geometry.ranges import DIRECTION, NOISE, NOISE_OF_AXIS, ON_FLANGE, G, Range

Result = TypeVar("Result")
MOST_COLUMNS = 120
"""Of text on a terminal, however wide: longer lines are hard to read."""


REQUIRED = Parameter.empty
"""The default of what has to be stated."""


class Declared(NamedTuple):
    """What the default of a verb's parameter says of an option: its value where nobody states one; what is noted of it
    in the parameter's type, for typer and for whoever guards outputs (`outputs.Writes`); the type where it has none.
    """

    default: Any
    notes: tuple[Any, ...]
    kind: Any = None


def number(within: Range, metavar: str, help: str, *names: str, **more: Any) -> Any:
    """The declaration of an option that takes a number of that range; `more` as of `text`."""

    def checked(value: float | None) -> float | None:
        try:
            return None if value is None else type(value)(within.require(value, "VALUE"))
        except InputError as error:
            raise typer.BadParameter(str(error).replace("VALUE is", "found", 1)) from None

    return text(metavar, help, *names, callback=checked, **more)


def text(
    metavar: str | None, help: str, *names: str, default: Any = None, mark: object = None, kind: Any = None, **more: Any
) -> Any:
    """The declaration of an option that takes a text, or what a text names; `more` of what typer's take."""
    says = "[default: " in help
    return Declared(
        default, (typer.Option(*names, metavar=metavar, help=help, show_default=not says, **more), mark), kind
    )


def switch(names: str, help: str, **more: Any) -> Any:
    """The declaration of an option that is given or not; `more` as of `text`."""
    return text(None, help, names, **{"default": False, **more})


def argument(metavar: str, help: str, default: Any = REQUIRED, kind: Any = None) -> Any:
    """The declaration of what stands on the command line without a name."""
    return Declared(default, (typer.Argument(metavar=metavar, help=help),), kind)


GRAVITY = text("X,Y,Z", "Direction of gravity in base axes. [default: down, or the calibration's]")
CALIBRATING_G = number(G, "G", "m/s^2, turns a weight into a mass. [default: 9.80665, or that of --prior]", "--g")
WEIGHING_G = number(G, "G", "m/s^2, turns a weight into a mass. [default: the calibration's]", "--g")
CALIBRATION = text("CAL.json", "Calibration that `calibrate` wrote.", "--calibration", "-c", default=REQUIRED)
JSON = switch("--json", "Print JSON and nothing else.")
FORCE = switch("--force", "Replace an existing output.")
OUTPUT_HELP = "an existing file is replaced only with --force; - is"
"""Of every output's help."""


def parameters_of(verb: Callable[..., Any]) -> dict[str, Parameter]:
    """The parameters of a verb as typer reads them: what is `Declared` of each stands in its type."""
    return {name: _annotated(each) for name, each in signature(verb, eval_str=True).parameters.items()}


def _annotated(each: Parameter) -> Parameter:
    if not isinstance(each.default, Declared):
        return each
    default, notes, kind = each.default
    return each.replace(default=default, annotation=Annotated[kind or each.annotation, *notes])


def spelled(run: Callable[..., Any], parameters: Collection[Parameter]) -> Callable[..., Any]:
    """What runs in a verb's place, with the parameters that typer is to see, each by its name."""
    seen = [_annotated(each).replace(kind=Parameter.KEYWORD_ONLY) for each in parameters]
    vars(run)["__signature__"] = Signature(seen)
    run.__annotations__ = {each.name: each.annotation for each in seen}
    return run


def noise_or_file(text: str, what: str) -> Array | Path:
    """What --noise says: std (6,), or from a number, N; or the file with a recording of `what`. Raises `InputError`."""
    from ..estimation.noise import with_torques

    try:
        std = np.array([float(part) for part in text.split(",")])
    except ValueError:
        if not re.fullmatch(r"[+-]?\d+([.,]\d+)?\s*[A-Za-z ]{0,4}", text):
            return Path(text)
        std = np.empty(0)
    if len(std) not in (1, 6) or len((NOISE if len(std) == 1 else NOISE_OF_AXIS).outside(std)):
        raise InputError(f"--noise is {text}, expected {NOISE}, six with commas, fx..tz, or a recording of {what}")
    return with_torques(std[0]) if len(std) == 1 else std


def numbers(text: str, option: str, form: str, within: Range, count: int | None = None) -> Array:
    """Numbers with commas between, so many or any. Raises `InputError` naming the option and what it takes."""
    try:
        values = np.array([float(part) for part in text.split(",")])
    except ValueError:
        values = np.array([np.nan])
    if len(within.outside(values)) or count not in (None, len(values)):
        raise InputError(f"{option} is {text!r}, expected {form}, {within}")
    return values


def point(text: str | None, option: str, within: Range = ON_FLANGE) -> Array | None:
    """The three numbers (3,) that an option states, or None. Raises `InputError`."""
    return None if text is None else numbers(text, option, "three numbers X,Y,Z", within, 3)


def gravity_direction(text: str | None) -> Array | None:
    """The direction that --gravity states, unit length, or None."""
    from ..geometry.wrench import unit_direction

    stated = point(text, "--gravity", DIRECTION)
    return None if stated is None else unit_direction(stated, "--gravity")


def print_result(
    result: Result,
    json: bool,
    as_json: Callable[[Result], str],
    as_text: Callable[[Result], str],
    elsewhere: int | None = None,
) -> None:
    """A result on stdout: as JSON and nothing else, or as text, as `say` prints it."""
    if json:
        typer.echo(visible_lines(as_json(result).rstrip("\n")))
    else:
        say(as_text(result), elsewhere=elsewhere)


def say(text: str, *, err: bool = False, elsewhere: int | None = None) -> None:
    """Print text, visibly. A sentence is one line: on a terminal it flows to its width, and `elsewhere` to that one."""
    from ..calibration.text import flowed

    text = visible_lines(text)
    on_terminal = (sys.stderr if err else sys.stdout).isatty()
    columns = min(get_terminal_size().columns, MOST_COLUMNS) if on_terminal else elsewhere
    typer.echo(text if columns is None else flowed(text, columns), err=err)


def doubtful_ends(*paths: Path | None) -> list[str]:
    """Of which text files the last number may be cut off, a sentence each."""
    from ..recording.tables.doubts import end_in_doubt

    return [*filter(None, map(end_in_doubt, filter(None, paths)))]


def note(*texts: str) -> None:
    """Say on stderr what is good to know."""
    for text in texts:
        say(shortened(f"Note: {visible(text)}"), err=True)


def visible_lines(text: str) -> str:
    """Text, each line as `visible` has it; JSON says the same so."""
    return "\n".join(map(visible, text.split("\n")))
