"""Raw recordings: what the sensor read and where the arm was, as `calibrate`, `compensate` and `--from` read them."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...geometry.arrays import Array
from ...geometry.orientation import ROTATION_TOLERANCE
from ...recording.bags.write import nanoseconds, stamped
from ...recording.tables.columns import FLAW, POSITION, WRENCH_COLUMNS
from ...recording.tables.write import quoted
from ...samples.samples import LARGEST_READING
from ..sink import Turn
from .file import GrowingFile
from .growing import Message, text_message

QUATERNION = ("qx", "qy", "qz", "qw")
NAMES = ("t", *WRENCH_COLUMNS, *QUATERNION, *POSITION, FLAW)
ROW = "%r," * 7 + "%.9g," * 7 + "%s\n"
"""Times and readings to their last bit."""
POSES_KEPT = 1_000
"""Between which the positions at the times of later readings are found: 2 s of the fastest robot."""


class Recorder(GrowingFile):
    """`--record FILE`. A table has a row for each reading with the orientation at its time, and the position, linear
    between two; an MCAP has `/wrench` and `/pose` at their own times, logged when they came.

    What no reader takes as a reading, because it has a flaw, is no number or has no orientation beside readings that
    have one, is a NaN there, and its numbers stand as text behind the reason: column `flaw`, topic `/flaw`.
    """

    HEADER = ",".join(NAMES) + "\n"

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._posed = False
        self._pose_t, self._position = np.empty(0), np.empty((0, 3))

    def _rows_of(self, turn: Turn) -> int:
        return len(turn.t)

    def _messages(self, turn: Turn) -> Iterator[Message]:
        flaws, known = _flaws(turn), _is_orientation(turn.pose)
        wrench = np.where(_there(flaws), turn.wrench, np.nan)
        stamp, arrival = nanoseconds(turn.t), nanoseconds(turn.arrival).tolist()
        for ns, came, payload in zip(stamp.tolist(), arrival, stamped(False, "sensor", stamp, wrench), strict=True):
            yield "/wrench", came, ns, payload
        for came, ns, flaw in zip(arrival, stamp.tolist(), _with_numbers(flaws, turn.wrench), strict=True):
            if flaw:
                yield "/flaw", came, ns, text_message(flaw)
        stamp, pose = nanoseconds(turn.pose_t), np.hstack([turn.position, turn.pose])
        for ns, payload in zip(stamp[known].tolist(), stamped(False, "base", stamp[known], pose[known]), strict=True):
            yield "/pose", ns, ns, payload
        for ns, row in zip(stamp[~known].tolist(), pose[~known].tolist(), strict=True):
            yield "/flaw", ns, ns, text_message(f"pose: no orientation {row}")

    def _columns(self, turn: Turn) -> dict[str, Any]:
        known = _is_orientation(turn.orientation)
        self._posed |= bool(known.any())
        flaws = [
            flaw or ("" if there or not self._posed else "no orientation")
            for flaw, there in zip(_flaws(turn), known.tolist(), strict=True)
        ]
        wrench = np.where(_there(flaws), turn.wrench, np.nan)
        orientation = np.where(known[:, None], turn.orientation, np.nan)
        columns = np.column_stack([turn.t, wrench, orientation, self._positions(turn)])
        return {**dict(zip(NAMES, columns.T, strict=False)), FLAW: _with_numbers(flaws, turn.wrench)}

    def _lines(self, turn: Turn) -> Iterator[str]:
        *numbers, flaws = self._columns(turn).values()
        cells = (*(column.tolist() for column in numbers), map(quoted, flaws))
        yield ROW * len(turn.t) % tuple(chain.from_iterable(zip(*cells, strict=True)))

    def _positions(self, turn: Turn) -> Array:
        known = np.isfinite(turn.position).all(axis=1)
        t, position = np.r_[self._pose_t, turn.pose_t[known]], np.vstack([self._position, turn.position[known]])
        order = np.argsort(t, kind="stable")[-POSES_KEPT:]
        if not len(order):
            return np.full((len(turn.t), 3), np.nan)
        found = [np.interp(turn.t, t[order], axis[order]) for axis in position.T]
        self._pose_t, self._position = t[order], position[order]
        return np.column_stack(found)


def _flaws(turn: Turn) -> list[str]:
    """Why each reading is none; empty: it is one."""
    number = np.asarray((np.abs(turn.wrench) <= LARGEST_READING).all(axis=1))
    return [flaw or ("" if good else "no number") for flaw, good in zip(turn.flaw, number.tolist(), strict=True)]


def _there(flaws: list[str]) -> NDArray[np.bool_]:
    """Which readings (n, 1) are some."""
    return np.array([[not flaw] for flaw in flaws], np.bool_).reshape(-1, 1)


def _with_numbers(flaws: list[str], wrench: Array) -> list[str]:
    """The flaws, each with what was read."""
    return [flaw and f"{flaw} {row}" for flaw, row in zip(flaws, wrench.tolist(), strict=True)]


def _is_orientation(quat_xyzw: Array) -> NDArray[np.bool_]:
    """Which of (n, 4) are quaternions as the readers take them."""
    length: Array = np.linalg.norm(quat_xyzw, axis=1)
    return np.asarray(np.abs(length - 1.0) < ROTATION_TOLERANCE, np.bool_)
