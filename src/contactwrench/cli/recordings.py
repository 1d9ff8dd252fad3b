"""The recordings that a verb reads: FILE, or --wrench and --pose, with the options that say how they are written."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import wraps
from inspect import Parameter, Signature, signature
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import InputError
from ..geometry.arrays import Array
from ..recording.options import Options
from ..samples.samples import Samples
from . import options
from .progress import progress

if TYPE_CHECKING:
    from ..calibration.calibration import Calibration
    from ..recording.as_calibrated import AsCalibrated

READING: dict[str, Any] = {
    "file": options.File,
    "orientation": options.Orientation,
    "wrench_frame": options.WrenchFrame,
    "sign": options.Sign,
    "inverse_orientation": options.InverseOrientation,
    "wrench": options.WrenchFile,
    "pose": options.PoseFile,
    "wrench_topic": options.WrenchTopic,
    "pose_topic": options.PoseTopic,
    "frames": options.Frames,
    "robot": options.Robot,
    "wrench_columns": options.WrenchColumns,
    "time_column": options.TimeColumn,
    "units": options.Units,
    "hdf5": options.Hdf5,
    "episode": options.Episode,
    "base_frame": options.BaseFrame,
    "accept_damaged": options.AcceptDamaged,
}
"""Which recording, and how it is read: None is not stated."""


@dataclass(frozen=True)
class Recordings:
    """The files that FILE, or --wrench and --pose, name, and how they are written; the options that are not among the
    `stated` ones are as usual.
    """

    files: tuple[Path, ...]
    options: Options
    stated: frozenset[str] = frozenset()

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
    """A verb whose parameter `recording`, or `recordings`, is spelled out for typer: FILE, one or several, and the
    options that say how it is written.
    """
    own = signature(verb, eval_str=True).parameters
    name = "recordings" if "recordings" in own else "recording"
    annotations = {**READING, "file": options.Files if name == "recordings" else options.File}
    reading = [
        Parameter(option, Parameter.KEYWORD_ONLY, default=None, annotation=annotations[option]) for option in READING
    ]

    @wraps(verb)
    def run(**values: Any) -> Any:
        recordings = _recordings(**{option: values.pop(option) for option in READING})
        if not recordings.files:
            raise InputError(f"Missing argument 'FILE': try 'contactwrench {verb.__name__} --help'")
        result = verb(**values, **{name: recordings})
        options.note_ends(*recordings.files, recordings.options.pose_file)
        return result

    spelled = [each for own_one in own.values() for each in (reading if own_one.name == name else [own_one])]
    vars(run)["__signature__"] = Signature([each.replace(kind=Parameter.KEYWORD_ONLY) for each in spelled])
    run.__annotations__ = {each.name: each.annotation for each in spelled}
    return run


def _recordings(*, file: Any, wrench: Path | None, pose: Path | None, frames: str | None, **others: Any) -> Recordings:
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
        return Recordings((wrench,), how, frozenset(stated))
    files = tuple(file) if isinstance(file, list) else () if file is None else (file,)
    return Recordings(files, how, frozenset(stated))


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
    for sentence in (*alike.notes, *filter(None, [samples.damage, samples.doubt])):
        options.note(sentence)
    return alike.calibration.with_gravity(direction), samples
