"""The options that verbs share: how a recording is read, which calibration, what gravity; how a result is printed."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import wraps
from inspect import Parameter, Signature, signature
from pathlib import Path
from shutil import get_terminal_size
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import numpy as np
import typer

from ..errors import InputError
from ..geometry.arrays import Array
from ..geometry.orientation import CONVENTIONS
from ..geometry.wrench import STANDARD_GRAVITY
from ..recording.options import Options
from ..samples.samples import Samples
from .progress import progress

if TYPE_CHECKING:
    from ..calibration.calibration import Calibration

Result = TypeVar("Result")
MOST_COLUMNS = 120
"""Of text on a terminal, however wide: longer lines are hard to read."""


def not_negative(metavar: str, help: str) -> Any:
    """The declaration of an option that takes a finite number of 0 or more."""

    def checked(value: float | None) -> float | None:
        if value is not None and not 0.0 <= value < np.inf:
            raise typer.BadParameter(f"found {value:g}, expected a number of 0 or more")
        return value

    return typer.Option(metavar=metavar, help=help, callback=checked)


def above_zero(metavar: str, help: str, *names: str) -> Any:
    """The declaration of an option that takes a finite number above 0."""

    def checked(value: float | None) -> float | None:
        if value is not None and not 0.0 < value < np.inf:
            raise typer.BadParameter(f"found {value:g}, expected a number above 0")
        return value

    return typer.Option(*names, metavar=metavar, help=help, callback=checked)


RECORDING_HELP = "Recording: a table (CSV, Parquet, HDF5) with fx..tz and an orientation, or a bag."
File = Annotated[Path | None, typer.Argument(metavar="FILE", help=RECORDING_HELP)]
Files = Annotated[list[Path] | None, typer.Argument(metavar="FILE", help=f"{RECORDING_HELP} Several with --shared.")]
Orientation = Annotated[
    str,
    typer.Option(
        metavar="NAME[:COLUMNS]",
        help=f"How the file writes R_base_flange: auto, {', '.join(CONVENTIONS)}, or euler:ZYX:deg.",
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
WrenchColumns = Annotated[
    str | None,
    typer.Option(
        metavar="A,B,C,D,E,F",
        help="Of a table: the wrench's six columns, or a slice of a list, as in wrench[0:6].",
    ),
]
TimeColumn = Annotated[str | None, typer.Option(metavar="NAME[:UNIT]", help="Of a table: the column of the times.")]
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
Episode = Annotated[int | None, typer.Option(metavar="N", help="Of a set of recordings: which one.", min=0)]
Gravity = Annotated[
    str | None,
    typer.Option(metavar="X,Y,Z", help="Direction of gravity in base axes. [default: down, or the calibration's]"),
]
StandardGravity = Annotated[float, above_zero("G", "m/s^2, turns a weight into a mass.", "--g")]
WeighingGravity = Annotated[
    float | None, above_zero("G", "m/s^2, turns a weight into a mass. [default: the calibration's]", "--g")
]
CalibrationFile = Annotated[
    Path, typer.Option("--calibration", "-c", metavar="CAL.json", help="Calibration that `calibrate` wrote.")
]
Json = Annotated[bool, typer.Option("--json", help="Print JSON and nothing else.")]
OUTPUT_HELP = "an existing file is replaced, once the new one is whole; - is"
"""Of every output's help."""

DEFAULT_G = STANDARD_GRAVITY


@dataclass(frozen=True)
class Recordings:
    """The files that FILE, or --wrench and --pose, name, and how they are written."""

    files: tuple[Path, ...]
    options: Options

    @property
    def path(self) -> Path:
        """The only file, or that of the wrenches."""
        return self.files[0]

    def read(self, path: Path | None = None, options: Options | None = None) -> Samples:
        """A file as samples; what takes long shows how far it is."""
        from ..recording.read import read_samples

        path = path or self.path
        with progress(f"reading {path.name}") as bar:
            return read_samples(path, options or self.options, bar, note, bar.begin)

    def note_differences(self, calibration: Calibration) -> None:
        """Say on stderr where the calibration's recording was read otherwise: most often a forgotten option."""
        for name in ("wrench_frame", "sign", "inverse_orientation"):
            now = getattr(self.options, name)
            before = calibration.provenance.get(name, now)
            if before != now:
                option = f"--{name.replace('_', '-')}"
                note(f"{option} was {before} for the calibration and is {now} for this recording")


def with_reading_options(verb: Callable[..., Any]) -> Callable[..., Any]:
    """A verb whose parameter `recording`, or `recordings`, is spelled out for typer: FILE, one or several, and the
    options that say how it is written.
    """
    own = signature(verb, eval_str=True).parameters
    name = "recordings" if "recordings" in own else "recording"
    reading = dict(signature(_recordings, eval_str=True).parameters)
    if name == "recordings":
        reading["file"] = reading["file"].replace(annotation=Files)

    @wraps(verb)
    def run(**values: Any) -> Any:
        stated = {option: values.pop(option) for option in reading}
        recordings = _recordings(**stated)
        if not recordings.files:
            raise InputError(f"Missing argument 'FILE': try 'contactwrench {verb.__name__} --help'")
        return verb(**values, **{name: recordings})

    spelled = [each for own_one in own.values() for each in (reading.values() if own_one.name == name else [own_one])]
    vars(run)["__signature__"] = Signature([each.replace(kind=Parameter.KEYWORD_ONLY) for each in spelled])
    run.__annotations__ = {each.name: each.annotation for each in spelled}
    return run


def _recordings(
    file: File = None,
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
    wrench_columns: WrenchColumns = None,
    time_column: TimeColumn = None,
    units: Units = None,
    hdf5: Hdf5 = None,
    episode: Episode = None,
) -> Recordings:
    axes = (orientation, wrench_frame, sign, inverse_orientation)
    of_bag = (wrench_topic, pose_topic, None if frames is None else _two_names(frames), robot)
    options = Options(*axes, *of_bag, pose, wrench_columns, time_column, units, hdf5, episode)
    named = [option for option, path in {"--wrench": wrench, "--pose": pose}.items() if path is not None]
    if file and named:
        raise InputError(
            f"found FILE and {' and '.join(named)}, expected FILE, or --wrench and --pose: leave one of them out"
        )
    if len(named) == 1:
        other = "--pose" if named == ["--wrench"] else "--wrench"
        raise InputError(f"found {named[0]} without {other}, expected both: add {other}, or give one FILE with all")
    if wrench is not None:
        return Recordings((wrench,), options)
    return Recordings(tuple(file) if isinstance(file, list) else () if file is None else (file,), options)


def _two_names(text: str) -> tuple[str, str]:
    names = [name.strip() for name in text.split(",")]
    if len(names) != 2 or not all(names):
        raise InputError(f"--frames is {text!r}, expected two names BASE,FLANGE")
    return names[0], names[1]


def calibration_and_samples(path: Path, gravity: str | None, recording: Recordings) -> tuple[Calibration, Samples]:
    """A calibration, with the direction that --gravity states, and a recording to hold against it."""
    from ..calibration.calibration import Calibration

    calibration = Calibration.load(path).with_gravity(gravity_direction(gravity))
    samples = recording.read()
    recording.note_differences(calibration)
    return calibration, samples


def numbers(text: str, option: str, expected: str, count: int | None = None, least: float = -np.inf) -> Array:
    """Finite numbers with commas between, so many or any. Raises `InputError` naming the option and what it takes."""
    try:
        values = np.array([float(part) for part in text.split(",")])
    except ValueError:
        values = np.array([np.nan])
    if not (np.isfinite(values) & (values >= least)).all() or count not in (None, len(values)):
        raise InputError(f"{option} is {text!r}, expected {expected}")
    return values


def gravity_direction(text: str | None) -> Array | None:
    """The direction that --gravity states, unit length, or None."""
    if text is None:
        return None
    from ..geometry.wrench import unit_direction

    return unit_direction(numbers(text, "--gravity", "three numbers X,Y,Z", 3), "--gravity")


def print_result(
    result: Result,
    json: bool,
    as_json: Callable[[Result], str],
    as_text: Callable[[Result], str],
    elsewhere: int | None = None,
) -> None:
    """A result on stdout: as JSON and nothing else, or as text, as `say` prints it."""
    if json:
        typer.echo(as_json(result).rstrip("\n"))
    else:
        say(as_text(result), elsewhere=elsewhere)


def say(text: str, *, err: bool = False, elsewhere: int | None = None) -> None:
    """Print text: on a terminal sentences flow to its width.

    Args:
        text: a sentence is one line.
        err: on stderr.
        elsewhere: the width where there is no terminal; None: a sentence stays one line.
    """
    from ..calibration.text import flowed

    on_terminal = (sys.stderr if err else sys.stdout).isatty()
    columns = min(get_terminal_size().columns, MOST_COLUMNS) if on_terminal else elsewhere
    typer.echo(text if columns is None else flowed(text, columns), err=err)


def note(text: str) -> None:
    """Say on stderr what is good to know."""
    say(f"Note: {text}", err=True)
