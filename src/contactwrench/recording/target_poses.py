"""Tables of where an arm is to go: joint angles or flange poses, with times where it is a motion."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..errors import FileFormatError
from ..geometry.arrays import Array
from .tables.column_names import LENGTH
from .tables.columns import Body, Column, optional
from .tables.table import opened, orientations, times

JOINT_ANGLE = {"": 1.0, "rad": 1.0, "deg": 180.0 / np.pi}


@dataclass(frozen=True, eq=False)
class Goals:
    """Where an arm is to go, row by row: `joints` (n, k), rad, or, where that is None, `R_base_flange` (n, 3, 3) with
    `position` (n, 3), m, or None; `t` (n,), s, or None. A table that has joint angles is not read for its poses.
    """

    joints: Array | None
    R_base_flange: Array
    position: Array | None
    t: Array | None


def read_goals(path: str | Path, joint_count: int, orientation: str = "auto") -> Goals:
    """Read columns `q1` to `qN` (rad, or `q1_deg`), or an orientation by its columns' names as in a recording and
    `x y z`; and `t`. Raises `FileAccessError`, and `FileFormatError` naming the file, the row and the column.
    """
    places, body = opened(path)
    names = [f"q{k}" for k in range(1, joint_count + 1)]
    joints = optional(places, names, JOINT_ANGLE, set(), body.source)
    t = times(places, body)
    if joints:
        return Goals(_values(body, joints), np.empty((0, 3, 3)), None, t)
    try:
        R, taken = orientations(places, body, orientation)
    except FileFormatError as error:
        raise FileFormatError(f"{error}; or give joint angles {names[0]} to {names[-1]}") from None
    position = optional(places, ["x", "y", "z"], LENGTH, taken, body.source)
    return Goals(None, R, _values(body, position) if position else None, t)


def _values(body: Body, columns: list[Column]) -> Array:
    """The columns' numbers (n, k), SI."""
    values: Array = body.numbers(columns) / np.array([column.per_si for column in columns])
    return values
