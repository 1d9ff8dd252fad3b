"""Tables of where an arm is to go: joint angles or flange poses, with times where it is a motion."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..errors import FileFormatError
from ..geometry.arrays import Array
from .tables.columns import Naming
from .tables.orientations import numbered_angles, orientation_columns
from .tables.roles import position_columns, time_columns
from .tables.table import in_seconds, in_si, open_table, rotations, whole_columns


@dataclass(frozen=True, eq=False)
class TargetPoses:
    """Where an arm is to go, row by row: `joints` (n, k), rad, or, where that is None, `R_base_flange` (n, 3, 3) with
    `position` (n, 3), m, or None; `t` (n,), s, or None. A table that has joint angles is not read for its poses.
    """

    joints: Array | None
    R_base_flange: Array
    position: Array | None
    t: Array | None


def read_target_poses(path: str | Path, joint_count: int, orientation: str = "auto") -> TargetPoses:
    """Read where an arm of N joints is to go: a table with `q1` to `qN` (rad, or `q1_deg`), or an `orientation` by its
    columns' names as in a recording and `x y z`; and `t`. Raises `FileAccessError`, and `FileFormatError` naming the
    file, the row and the column.
    """
    table = open_table(path)
    names = [f"q{k}" for k in range(1, joint_count + 1)]
    naming = Naming(orientation)
    t_columns = time_columns(table, naming)
    joint_columns = numbered_angles(table, names)
    if joint_columns:
        t, joints = whole_columns(table, t_columns, joint_columns)
        return TargetPoses(joints, np.empty((0, 3, 3)), None, in_seconds(t, t_columns))
    with _or_joint_angles(names):
        convention, angles = orientation_columns(table, naming)
    positions = position_columns(table, naming, {column.place for column in angles})
    R, others = [], []
    for body in table.bodies([*t_columns, *angles, *positions]):
        others.append(in_si(body, (t_columns, positions)))
        with _or_joint_angles(names):
            R.append(rotations(convention, angles, in_si(body, (angles,))[0], body))
    t, position = (np.concatenate(parts) for parts in zip(*others, strict=True))
    return TargetPoses(None, np.concatenate(R), position if positions else None, in_seconds(t, t_columns))


@contextmanager
def _or_joint_angles(names: list[str]) -> Iterator[None]:
    """Say, where an orientation cannot be read, that joint angles would do."""
    try:
        yield
    except FileFormatError as error:
        raise FileFormatError(f"{error}; or give joint angles {names[0]} to {names[-1]}") from None
