"""The reading flags, the same on every verb that reads a recording."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import wraps
from inspect import Parameter, Signature, signature
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from ..errors import InputError
from ..geometry.arrays import Array
from ..geometry.orientation import CONVENTIONS
from ..geometry.wrench import STANDARD_GRAVITY
from ..recording.options import Options
from ..samples.samples import Samples
from .progress import progress


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


RECORDING_HELP = "Recording: a table (CSV, Parquet) with fx..tz and an orientation, or a bag."
Recording = Annotated[Path | None, typer.Argument(metavar="FILE", help=RECORDING_HELP)]
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


@dataclass(frozen=True)
class Reading:
    """What the reading flags say: how the recording is written, and the file with its wrenches where there are two."""

    layout: Options
    wrench_file: Path | None
    verb: str = ""

    def file(self, given: Path | None) -> Path:
        """The file to read: the one given, or that of --wrench. Raises `InputError` unless it is one of them."""
        return self.files(None if given is None else [given])[0]

    def files(self, given: list[Path] | None) -> list[Path]:
        """The same of several."""
        two = {"--wrench": self.wrench_file, "--pose": self.layout.pose_file}
        named = [flag for flag, file in two.items() if file is not None]
        if given and named:
            raise InputError(
                f"found FILE and {' and '.join(named)}, expected FILE, or --wrench and --pose: leave one of them out"
            )
        if len(named) == 1:
            other = "--pose" if named == ["--wrench"] else "--wrench"
            raise InputError(f"found {named[0]} without {other}, expected both: add {other}, or give one FILE with all")
        if self.wrench_file is not None:
            return [self.wrench_file]
        if not given:
            raise InputError(f"Missing argument 'FILE': try 'contactwrench {self.verb} --help'")
        return given


def with_reading_flags(verb: Callable[..., Any]) -> Callable[..., Any]:
    """A verb whose parameter `reading` is spelled out, for typer, as the flags that say how a recording is written."""
    own = signature(verb, eval_str=True).parameters
    flags = signature(_reading, eval_str=True).parameters

    @wraps(verb)
    def run(**values: Any) -> Any:
        of_recording = {name: values.pop(name) for name in flags}
        return verb(**values, reading=replace(_reading(**of_recording), verb=verb.__name__))

    spelled = [part for one in own.values() for part in (flags.values() if one.name == "reading" else [one])]
    vars(run)["__signature__"] = Signature([one.replace(kind=Parameter.KEYWORD_ONLY) for one in spelled])
    run.__annotations__ = {one.name: one.annotation for one in spelled}
    return run


def _reading(
    orientation: Orientation = "auto",
    wrench_frame: WrenchFrame = "sensor",
    sign: Sign = "pull",
    inverse_orientation: InverseOrientation = False,
    wrench: WrenchFile = None,
    pose: PoseFile = None,
    wrench_topic: WrenchTopic = None,
    pose_topic: PoseTopic = None,
    frames: Frames = None,
    robot: Robot = None,
) -> Reading:
    layout = Options(
        orientation,
        wrench_frame,
        sign,
        inverse_orientation,
        wrench_topic,
        pose_topic,
        None if frames is None else _two_names(frames),
        robot,
        pose,
    )
    return Reading(layout, wrench)


def _two_names(text: str) -> tuple[str, str]:
    names = [name.strip() for name in text.split(",")]
    if len(names) != 2 or not all(names):
        raise InputError(f"--frames is {text!r}, expected two names BASE,FLANGE")
    return names[0], names[1]


def read_recording(file: Path, layout: Options) -> Samples:
    """The recording as samples; what takes long shows how far it is."""
    from ..recording.read import read_samples

    with progress(f"reading {file.name}") as advance:
        return read_samples(file, layout, advance, note)


def note(text: str) -> None:
    """Say on stderr what is good to know."""
    typer.echo(f"Note: {text}", err=True)


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
    from ..geometry.wrench import unit_direction

    return unit_direction(three_numbers(text, "--gravity"), "--gravity")


def note_other_reading(provenance: dict[str, Any], layout: Options) -> None:
    """Say on stderr where a recording is read otherwise than the calibration's was: most often a forgotten flag."""
    for name in ("wrench_frame", "sign", "inverse_orientation"):
        now = getattr(layout, name)
        before = provenance.get(name, now)
        if before != now:
            flag = f"--{name.replace('_', '-')}"
            note(f"{flag} was {before} for the calibration and is {now} for this recording")
