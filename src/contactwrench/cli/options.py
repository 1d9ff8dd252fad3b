"""The options that verbs share: how a recording is written, which calibration and gravity; how a result is printed."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from shutil import get_terminal_size
from typing import Annotated, Any, TypeVar

import numpy as np
import typer

from ..errors import InputError, visible
from ..geometry.arrays import Array
from ..geometry.orientation import CONVENTIONS
from ..geometry.ranges import DIRECTION, EPISODE, NOISE, G, Range
from ..geometry.wrench import STANDARD_GRAVITY

Result = TypeVar("Result")
MOST_COLUMNS = 120
"""Of text on a terminal, however wide: longer lines are hard to read."""


def number(within: Range, metavar: str, help: str, *names: str) -> Any:
    """The declaration of an option that takes a number of that range."""

    def checked(value: float | None) -> float | None:
        try:
            return None if value is None else type(value)(within.require(value, "VALUE"))
        except InputError as error:
            raise typer.BadParameter(str(error).replace("VALUE is", "found", 1)) from None

    return typer.Option(*names, metavar=metavar, help=help, callback=checked)


RECORDING_HELP = (
    "Recording: a table (CSV, - on standard input, Parquet, HDF5) with fx..tz and an orientation, or a bag."
)
File = Annotated[Path | None, typer.Argument(metavar="FILE", help=RECORDING_HELP)]
Files = Annotated[list[Path] | None, typer.Argument(metavar="FILE", help=f"{RECORDING_HELP} Several with --shared.")]
OR_ITS = "or the calibration's]"
Orientation = Annotated[
    str | None,
    typer.Option(
        metavar="NAME[:COLUMNS]",
        help=f"How the file writes R_base_flange: {', '.join(CONVENTIONS)}, or euler:ZYX:deg. [default: auto, {OR_ITS}",
    ),
]
WrenchFrame = Annotated[
    str | None, typer.Option(metavar="sensor|base", help=f"Axes of the file's wrench. [default: sensor, {OR_ITS}")
]
Sign = Annotated[
    str | None,
    typer.Option(metavar="pull|reaction", help=f"What acts on the sensor, or its reaction. [default: pull, {OR_ITS}"),
]
InverseOrientation = Annotated[
    bool | None,
    typer.Option(
        "--inverse-orientation/--no-inverse-orientation", help=f"The file holds R_flange_base. [default: no, {OR_ITS}"
    ),
]
WrenchFile = Annotated[
    Path | None,
    typer.Option("--wrench", metavar="W.csv", help="In place of FILE, with --pose: the table with t and fx..tz."),
]
PoseFile = Annotated[
    Path | None, typer.Option("--pose", metavar="P.csv", help="With --wrench: the table with t and an orientation.")
]
WrenchTopic = Annotated[str | None, typer.Option(metavar="TOPIC", help="Of a bag: the wrench. [default: the only one]")]
PoseTopic = Annotated[str | None, typer.Option(metavar="TOPIC", help="Of a bag: the pose. [default: the only one]")]
Frames = Annotated[
    str | None, typer.Option(metavar="BASE,FLANGE", help="Of a bag: the frames of tf between which the pose is.")
]
Robot = Annotated[
    str | None,
    typer.Option(
        metavar="NAME|URDF[:LINK]", help="Of a bag: the arm whose joint angles it has, a known one or a URDF."
    ),
]
WrenchColumns = Annotated[
    str | None,
    typer.Option(
        metavar="A,B,C,D,E,F",
        help="Of a table: the wrench's six columns, or a slice of a list, as in wrench[0:6].",
    ),
]
TimeColumn = Annotated[
    str | None, typer.Option(metavar="NAME[:UNIT]", help="Of a table: the column of the times, or none.")
]
Units = Annotated[
    str | None,
    typer.Option(metavar="force=U,torque=U", help="Of a table: units that no name states, as torque=Nmm."),
]
Hdf5 = Annotated[
    str | None,
    typer.Option(
        "--hdf5", metavar="wrench=/PATH,pose=/PATH,time=/PATH", help="Of an HDF5 file: which datasets hold what."
    ),
]
Episode = Annotated[int | None, number(EPISODE, "N", "Of a set of recordings: which one.")]
BaseFrame = Annotated[
    str | None, typer.Option(metavar="NAME", help="Of the orientations. [default: what a bag, or --robot, says]")
]
AcceptDamaged = Annotated[
    bool | None, typer.Option("--accept-damaged", help="Of a damaged bag: read what is left of it, and say so.")
]
Gravity = Annotated[
    str | None,
    typer.Option(metavar="X,Y,Z", help="Direction of gravity in base axes. [default: down, or the calibration's]"),
]
StandardGravity = Annotated[float, number(G, "G", "m/s^2, turns a weight into a mass.", "--g")]
WeighingGravity = Annotated[
    float | None, number(G, "G", "m/s^2, turns a weight into a mass. [default: the calibration's]", "--g")
]
CalibrationFile = Annotated[
    Path, typer.Option("--calibration", "-c", metavar="CAL.json", help="Calibration that `calibrate` wrote.")
]
Json = Annotated[bool, typer.Option("--json", help="Print JSON and nothing else.")]
Force = Annotated[bool, typer.Option("--force", help="Replace an existing output.")]
OUTPUT_HELP = "an existing file is replaced only with --force; - is"
"""Of every output's help."""

DEFAULT_G = STANDARD_GRAVITY


def noise_or_file(text: str, what: str) -> Array | Path:
    """What --noise says: std (6,) from a number, N; or the file with a recording of `what`. Raises `InputError`."""
    from ..compensate.noise import with_torques

    try:
        std = float(text)
    except ValueError:
        return Path(text)
    if len(NOISE.outside(np.array([std]))):
        raise InputError(f"--noise is {text}, expected {NOISE}, or a recording of {what}")
    return with_torques(std)


def numbers(text: str, option: str, form: str, within: Range, count: int | None = None) -> Array:
    """Numbers with commas between, so many or any. Raises `InputError` naming the option and what it takes."""
    try:
        values = np.array([float(part) for part in text.split(",")])
    except ValueError:
        values = np.array([np.nan])
    if len(within.outside(values)) or count not in (None, len(values)):
        raise InputError(f"{option} is {text!r}, expected {form}, {within}")
    return values


def gravity_direction(text: str | None) -> Array | None:
    """The direction that --gravity states, unit length, or None."""
    if text is None:
        return None
    from ..geometry.wrench import unit_direction

    return unit_direction(numbers(text, "--gravity", "three numbers X,Y,Z", DIRECTION, 3), "--gravity")


def print_result(
    result: Result,
    json: bool,
    as_json: Callable[[Result], str],
    as_text: Callable[[Result], str],
    elsewhere: int | None = None,
) -> None:
    """A result on stdout: as JSON and nothing else, or as text, as `say` prints it."""
    if json:
        typer.echo(_visible_lines(as_json(result).rstrip("\n")))
    else:
        say(as_text(result), elsewhere=elsewhere)


def say(text: str, *, err: bool = False, elsewhere: int | None = None) -> None:
    """Print text, visibly: on a terminal sentences flow to its width.

    Args:
        text: a sentence is one line.
        err: on stderr.
        elsewhere: the width where there is no terminal; None: a sentence stays one line.
    """
    from ..calibration.text import flowed

    text = _visible_lines(text)
    on_terminal = (sys.stderr if err else sys.stdout).isatty()
    columns = min(get_terminal_size().columns, MOST_COLUMNS) if on_terminal else elsewhere
    typer.echo(text if columns is None else flowed(text, columns), err=err)


def note_ends(*paths: Path | None) -> None:
    """Say of which text files the last number may be cut off."""
    from ..recording.tables.doubts import end_in_doubt

    for said in filter(None, map(end_in_doubt, filter(None, paths))):
        note(said)


def note(text: str) -> None:
    """Say on stderr what is good to know."""
    say(f"Note: {visible(text)}", err=True)


def _visible_lines(text: str) -> str:
    return "\n".join(map(visible, text.split("\n")))
