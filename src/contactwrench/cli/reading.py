"""The reading flags, the same on every verb that reads a recording."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from ..errors import InputError
from ..orientation import CONVENTIONS, Array
from ..samples import Samples
from ..wrench import STANDARD_GRAVITY


def not_negative(value: float | None) -> float | None:
    """A limit that a flag states. Raises typer's error unless it is a finite number of 0 or more."""
    if value is not None and not 0.0 <= value < np.inf:
        raise typer.BadParameter(f"found {value:g}, expected a number of 0 or more")
    return value


def above_zero(value: float | None) -> float | None:
    """A quantity that a flag states. Raises typer's error unless it is finite and above 0."""
    if value is not None and not 0.0 < value < np.inf:
        raise typer.BadParameter(f"found {value:g}, expected a number above 0")
    return value


Recording = Annotated[Path, typer.Argument(metavar="FILE", help="Recording: CSV with fx..tz and an orientation.")]
Orientation = Annotated[
    str,
    typer.Option(
        metavar="NAME[:COLUMNS]",
        help=f"How the file writes R_base_flange: auto, {', '.join(CONVENTIONS)}, or euler:ZYX:deg.",
        rich_help_panel="reading",
    ),
]
WrenchFrame = Annotated[str, typer.Option(metavar="sensor|base", help="Axes in which the file gives the wrench.")]
Sign = Annotated[str, typer.Option(metavar="pull|reaction", help="What acts on the sensor, or its reaction.")]
InverseOrientation = Annotated[bool, typer.Option("--inverse-orientation", help="The file holds R_flange_base.")]
Gravity = Annotated[
    str | None,
    typer.Option(metavar="X,Y,Z", help="Direction of gravity in base axes. [default: down, or the calibration's]"),
]
StandardGravity = Annotated[
    float, typer.Option("--g", metavar="G", help="m/s^2, turns a weight into a mass.", callback=above_zero)
]
WeighingGravity = Annotated[
    float | None,
    typer.Option(
        "--g", metavar="G", help="m/s^2, turns a weight into a mass. [default: the calibration's]", callback=above_zero
    ),
]
CalibrationFile = Annotated[
    Path, typer.Option("--calibration", "-c", metavar="CAL.json", help="Calibration that `calibrate` wrote.")
]
Json = Annotated[bool, typer.Option("--json", help="Print JSON and nothing else.")]

DEFAULT_G = STANDARD_GRAVITY


def read_recording(file: Path, orientation: str, wrench_frame: str, sign: str, inverse_orientation: bool) -> Samples:
    """The recording as the flags say it is written."""
    from ..recording import read

    return read(file, orientation, wrench_frame, sign, inverse_orientation=inverse_orientation)


def three_numbers(text: str, flag: str) -> Array:
    """`X,Y,Z` as (3,). Raises `InputError` naming the flag."""
    try:
        values = np.array([float(part) for part in text.split(",")])
    except ValueError:
        values = np.empty(0)
    if values.shape != (3,) or not np.isfinite(values).all():
        raise InputError(f"{flag} is {text!r}, expected three numbers X,Y,Z")
    return values


def gravity_direction(text: str | None) -> Array | None:
    """The direction that --gravity states, unit length, or None."""
    if text is None:
        return None
    from ..wrench import unit_direction

    return unit_direction(three_numbers(text, "--gravity"), "--gravity")


def note_other_reading(provenance: dict[str, Any], wrench_frame: str, sign: str, inverse_orientation: bool) -> None:
    """Say on stderr where a recording is read otherwise than the calibration's was: most often a forgotten flag."""
    flags = {
        "--wrench-frame": ("wrench_frame", wrench_frame),
        "--sign": ("sign", sign),
        "--inverse-orientation": ("inverse_orientation", inverse_orientation),
    }
    for flag, (key, now) in flags.items():
        before = provenance.get(key, now)
        if before != now:
            typer.echo(f"Note: {flag} was {before} for the calibration and is {now} for this recording", err=True)
