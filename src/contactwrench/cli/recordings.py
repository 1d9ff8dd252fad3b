"""The recordings that a verb reads: FILE, or --wrench and --pose, with the options that say how they are written."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial, wraps
from inspect import Parameter
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import InputError
from ..geometry.arrays import Array
from ..geometry.orientation import CONVENTIONS
from ..geometry.ranges import EPISODE, RATE
from ..recording.options import Options
from ..samples.samples import Samples
from . import options
from .streams import progress

if TYPE_CHECKING:
    from ..calibration.calibration import Calibration
    from ..recording.as_calibrated import AsCalibrated


PANEL = "How the recording is written (most need none of these)"
OR_ITS = "or the calibration's]"
"""Of the help of what a calibration tells of its recording."""


_text = partial(options.text, rich_help_panel=PANEL, kind=str | None)
_number = partial(options.number, rich_help_panel=PANEL, kind=float | None)
_switch = partial(options.switch, default=None, rich_help_panel=PANEL, kind=bool | None)

RECORDING_HELP = (
    "Recording: a table (CSV, - on standard input, Parquet, HDF5) with fx..tz and an orientation, or a bag."
)
OF_TABLE: dict[str, Any] = {
    "wrench_columns": _text(
        "A,B,C,D,E,F",
        "Of a table: the wrench's six columns, a slice of a list, as wrench[0:6], or, without a header, 1,2,3,4,5,6.",
    ),
    "time_column": _text("NAME[:UNIT]", "Of a table: the column of the times, or none."),
    "units": _text("force=U,torque=U", "Of a table: units that no name states, as torque=Nmm."),
    "hdf5": _text("wrench=/PATH,pose=/PATH,time=/PATH", "Of an HDF5 file: which datasets hold what.", "--hdf5"),
    "episode": _number(EPISODE, "N", "Of a set of recordings: which one.", kind=int | None),
    "rate": _number(RATE, "HZ", "Of a table without times: rows in a second."),
}
OF_MEANING: dict[str, Any] = {
    "orientation": _text(
        "NAME[:COLUMNS]",
        f"How the file writes R_base_flange: {', '.join(CONVENTIONS)}, or euler:ZYX:deg. [default: auto, {OR_ITS}",
    ),
    "wrench_frame": _text("sensor|base", f"Axes of the file's wrench. [default: sensor, {OR_ITS}"),
    "sign": _text("pull|reaction", f"What acts on the sensor, or its reaction. [default: pull, {OR_ITS}"),
    "inverse_orientation": _switch(
        "--inverse-orientation/--no-inverse-orientation", f"The file holds R_flange_base. [default: no, {OR_ITS}"
    ),
}
OF_ANY: dict[str, Any] = {
    **OF_MEANING,
    "wrench": _text(
        "W.csv", "In place of FILE, with --pose: the table with t and fx..tz.", "--wrench", kind=Path | None
    ),
    "pose": _text("P.csv", "With --wrench: the table with t and an orientation.", "--pose", kind=Path | None),
    "wrench_topic": _text("TOPIC", "Of a bag: the wrench. [default: the only one]"),
    "pose_topic": _text("TOPIC", "Of a bag: the pose. [default: the only one]"),
    "frames": _text("BASE,FLANGE", "Of a bag: the frames of tf between which the pose is."),
    "robot": _text("NAME|URDF[:LINK]", "Of a bag: the arm whose joint angles it has, a known one or a URDF."),
    **OF_TABLE,
    "imu": _text("SOURCE", "An accelerometer on the tool: a topic of the bag, a table, or columns AX,AY,AZ.", "--imu"),
    "base_frame": _text("NAME", "Of the orientations. [default: what a bag, or --robot, says]"),
    "accept_damaged": _switch("--accept-damaged", "Of a damaged bag, or a set: read what is left of it, and say so."),
}
READING: dict[str, dict[str, Any]] = {
    "recording": {"file": options.argument("FILE", RECORDING_HELP, None, Path | None), **OF_ANY},
    "recordings": {
        "file": options.argument("FILE", f"{RECORDING_HELP} Several with --shared.", None, list[Path] | None),
        **OF_ANY,
    },
    "written": {**OF_MEANING, **OF_TABLE},
}
"""What a parameter of a verb stands for, by its name: which recording, or several, and how it is read, or only how a
table is that another option names. None is not stated.
"""


@dataclass(frozen=True)
class Recordings:
    """The files that FILE, or --wrench and --pose, name, and how they are written; the options that are not among the
    `stated` ones are as usual.
    """

    files: tuple[Path, ...]
    options: Options
    stated: tuple[str, ...] = ()

    @property
    def path(self) -> Path:
        """The only file, or that of the wrenches."""
        return self.files[0]

    def read(self, path: Path | None = None) -> Samples:
        """A file as samples; what takes long shows how far it is."""
        from ..recording.read import read_samples

        path = path or self.path
        with progress(f"reading {path.name}") as bar:
            return read_samples(path, self.options, bar, options.note, bar.begin)

    def as_calibrated(self, calibration: Calibration, gravity: Array | None) -> AsCalibrated:
        """How to read the only file like a calibration's, and that in the file's base; `gravity` (3,) as stated."""
        from ..recording.as_calibrated import as_calibrated

        stated = gravity is not None
        return as_calibrated(self.path, self.options, self.stated, calibration, gravity_stated=stated)

    def beside(self, path: Path) -> Recordings:
        """Another file, with all in one, that is written alike."""
        return replace(self, files=(path,), options=replace(self.options, pose_file=None))


def with_reading_options(verb: Callable[..., Any]) -> Callable[..., Any]:
    """A verb whose parameter of one of the names in `READING` is spelled out for typer."""
    own = options.parameters_of(verb)
    name = next(iter(own.keys() & READING.keys()))
    reading = [Parameter(option, Parameter.KEYWORD_ONLY, default=of) for option, of in READING[name].items()]

    @wraps(verb)
    def run(**values: Any) -> Any:
        recordings = _recordings(**{option: values.pop(option) for option in READING[name]})
        import scipy.linalg.blas  # noqa: F401 - waits for ever where a recording has left too little memory for it

        if "file" in READING[name] and not recordings.files:
            raise InputError(f"Missing argument 'FILE': try 'contactwrench {verb.__name__} --help'")
        stated = (recordings.options.imu, values.get("noise"))
        beside = [Path(text) for text in stated if text and os.path.isfile(text)]
        doubts_beside = options.doubtful_ends(*beside)  # now: the verb may write and never open them
        result = verb(**values, **{name: recordings})
        options.note(*options.doubtful_ends(*recordings.files, recordings.options.pose_file), *doubts_beside)
        return result

    return options.spelled(
        run, [each for own_one in own.values() for each in (reading if own_one.name == name else [own_one])]
    )


def _recordings(
    *, file: Any = None, wrench: Path | None = None, pose: Path | None = None, frames: str | None = None, **others: Any
) -> Recordings:
    others |= {"frames": None if frames is None else _two_names(frames), "pose_file": pose}
    stated = {name: value for name, value in others.items() if value is not None}
    how = Options(**stated)
    named = [option for option, path in {"--wrench": wrench, "--pose": pose}.items() if path is not None]
    if file and named:
        raise InputError(
            f"found FILE and {' and '.join(named)}, expected FILE, or --wrench and --pose: leave one of them out"
        )
    if len(named) == 1:
        other = "--pose" if named == ["--wrench"] else "--wrench"
        raise InputError(f"found {named[0]} without {other}, expected both: add {other}, or give one FILE with all")
    if wrench is not None:
        return Recordings((wrench,), how, tuple(stated))
    files = tuple(file) if isinstance(file, list) else () if file is None else (file,)
    return Recordings(files, how, tuple(stated))


def _two_names(text: str) -> tuple[str, str]:
    names = [name.strip() for name in text.split(",")]
    if len(names) != 2 or not all(names):
        raise InputError(f"--frames is {text!r}, expected two names BASE,FLANGE")
    return names[0], names[1]


def calibration_and_samples(path: Path, gravity: str | None, recording: Recordings) -> tuple[Calibration, Samples]:
    """A calibration, with the direction that --gravity states, and a recording to hold against it."""
    from ..calibration.calibration import Calibration

    calibration, direction = Calibration.load(path), options.gravity_direction(gravity)
    alike = recording.as_calibrated(calibration, direction)
    samples = replace(recording, options=alike.options).read()
    options.note(*alike.notes, *filter(None, [samples.damage, samples.doubt]))
    return alike.calibration.with_gravity(direction), samples
