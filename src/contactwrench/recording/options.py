"""How a recording is written: what the options of reading say of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import FileFormatError, InputError
from ..geometry.arrays import Array
from ..geometry.ranges import RATE
from ..samples.samples import ReadAs
from .tables.columns import Naming
from .tables.table import Table

OF_TABLES = ("orientation", "wrench_columns", "time_column", "units", "hdf5", "episode", "rate")
OF_BAGS = ("wrench_topic", "pose_topic", "frames", "robot")
"""Options that only one of the kinds has."""

OF_MEANING = ("sign", "wrench_frame", "inverse_orientation")
"""What the numbers mean, in a file of any kind."""

TEXTS = ("orientation", "wrench_columns", "time_column", "units", "hdf5", "wrench_topic", "pose_topic", "base_frame")
"""Options that a program may give as something else, where the command line gives a text."""

ACCEPT_FLAG = "--accept-damaged"

IN_BASE_AXES = (
    "found a wrench in base axes without an orientation in its row, expected both in each row: record them together, "
    "or the wrench in sensor axes"
)


@dataclass(frozen=True)
class Options(Naming):
    """How a recording is written: arguments of `read` under their names. Raises `InputError` for others."""

    wrench_frame: str = "sensor"
    sign: str = "pull"
    inverse_orientation: bool = False
    wrench_topic: str | None = None
    pose_topic: str | None = None
    frames: tuple[str, str] | None = None
    robot: str | None = None
    pose_file: Path | None = None
    base_frame: str | None = None
    accept_damaged: bool = False
    imu: str | None = None

    def __post_init__(self) -> None:
        for name, known in (("wrench_frame", ("sensor", "base")), ("sign", ("pull", "reaction"))):
            if getattr(self, name) not in known:
                raise InputError(f"{name} is {getattr(self, name)!r}, expected {' or '.join(known)}")
        if self.episode is not None and (
            isinstance(self.episode, bool) or not isinstance(self.episode, int | np.integer)
        ):
            raise InputError(f"episode is {self.episode!r}, expected a whole number: read one at a time")
        if self.rate is not None:
            RATE.require(self.rate, "rate")
            if self.pose_file is not None:
                raise InputError(f"found two files and rate {self.rate:g}, expected times in each: leave it out")
        if isinstance(self.frames, str):
            raise InputError(f"frames is {self.frames!r}, expected two: write ('base', 'flange')")
        for name in TEXTS:
            if not isinstance(value := getattr(self, name), str | None):
                said = name.replace("_", "-")
                raise InputError(f"{name} is {value!r}, expected a text: write it as for --{said} on the command line")

    def require_for(self, path: str | Path, *, bag: bool) -> None:
        """Raise `InputError` for what is said of a table where the recording is a bag, and the other way round."""
        kinds = ("a bag", "tables") if bag else ("a table", "bags")
        for name in OF_TABLES if bag else (*OF_BAGS, "accept_damaged"):
            value = getattr(self, name)
            if value != getattr(AS_USUAL, name):
                given = ",".join(value) if name == "frames" else value
                raise InputError(f"{path}: found {kinds[0]}, and {name} {given}, which is for {kinds[1]}: leave it out")

    def told(self, found: ReadAs) -> ReadAs:
        """How a recording was read: what was `found` in it, and these options as far as they say something, plain. The
        frame in which an inverse orientation is, is the flange.
        """
        values = {name: getattr(self, name) for name in (*OF_MEANING, *OF_TABLES, *OF_BAGS, "base_frame")}
        stated = {name: value for name, value in values.items() if value not in (None, "auto")}
        plain = {name: ",".join(value) if name == "frames" else value for name, value in stated.items()}
        known = {
            name: value for name, value in found.items() if not (self.inverse_orientation and name == "base_frame")
        }
        return {**known, **plain}

    def R_base_flange(self, R: Array) -> Array:
        """`R_base_flange` (n, 3, 3) of rotations as they are written."""
        return R.transpose(0, 2, 1) if self.inverse_orientation else R

    def pull(self, wrench: Array) -> Array:
        """What acts on the sensor (n, 6), of wrenches as they are written."""
        return -wrench if self.sign == "reaction" else wrench

    def applied(self, table: Table) -> Table:
        """Wrenches in sensor axes, pull sign, and orientations of `R_base_flange`. Raises `FileFormatError`."""
        R, wrench = self.R_base_flange(table.orientation), self.pull(table.wrench)
        if self.wrench_frame == "base":
            if table.lacks_orientations:
                raise FileFormatError(f"{table.source}: {IN_BASE_AXES}")
            parts = [np.einsum("nij,ni->nj", R, part) for part in (wrench[:, :3], wrench[:, 3:])]
            wrench = np.concatenate(parts, axis=1)
        return replace(table, wrench=wrench, orientation=R, read_as=self.told(table.read_as))


AS_USUAL = Options()


def remembered(provenance: Mapping[str, Any]) -> dict[str, Any]:
    """The options of reading that a provenance holds, less those of one file alone. Raises `InputError` for others."""
    names = (*OF_MEANING, "orientation", "wrench_columns", "time_column", "units", "hdf5", *OF_BAGS)
    kept = {name: provenance[name] for name in names if provenance.get(name) not in (None, "auto")}
    for name, value in kept.items():
        kind = bool if name == "inverse_orientation" else str
        if not isinstance(value, kind) or (name == "frames" and str(value).count(",") != 1):
            raise InputError(f"the calibration's provenance has {name} {value!r}, which is none: calibrate again")
    return {name: tuple(value.split(",")) if name == "frames" else value for name, value in kept.items()}
