"""What is kept of the past: the last seconds' readings, and what both streams were on the way to a calibration."""

from __future__ import annotations

from collections import deque

import numpy as np

from ..geometry.arrays import Array
from ..geometry.orientation import from_quat_xyzw
from ..samples.samples import OrientationStream, Streams, WrenchStream
from .sink import Turn

ROOM = 32_768
"""Readings: 3 s of a sensor at 10 kHz."""
SECONDS, RATE = 180, 1_000
"""Kept of a motion, and rows of each stream in a second at most."""


class History:
    """Readings (n, 6) with their times and orientations (n, 4), the newest last."""

    def __init__(self) -> None:
        self._rows = np.empty((2 * ROOM, 11))
        self._end = 0

    def add(self, turn: Turn) -> None:
        """The readings of a turn that may be used."""
        good = [(t, *wrench, *orientation) for t, _, wrench, orientation, flaw in turn.readings if not flaw][-ROOM:]
        if self._end + len(good) > 2 * ROOM:
            kept = self._rows[self._end - ROOM : self._end]
            self._rows[: len(kept)] = kept
            self._end = len(kept)
        if good:
            self._rows[self._end : self._end + len(good)] = good
            self._end += len(good)

    def last(self, seconds: float) -> tuple[Array, Array, Array]:
        """Times (n,), readings (n, 6) and orientations (n, 4) of the last seconds, as views."""
        if not self._end:
            return self._rows[:0, 0], self._rows[:0, 1:7], self._rows[:0, 7:]
        first = max(self._end - ROOM, 0)
        t = self._rows[first : self._end, 0]
        first += int(np.searchsorted(t, t[-1] - seconds, side="right"))
        rows = self._rows[first : self._end]
        return rows[:, 0], rows[:, 1:7], rows[:, 7:]


class Motion:
    """The last seconds of both streams, thinned: a block of (t, wrench) and one of (t, quaternion, position) for each.
    Their motion tells the delay.
    """

    def __init__(self) -> None:
        self._blocks: deque[tuple[Array, Array]] = deque(maxlen=SECONDS)
        self._fresh: list[Turn] = []
        self._closed = 0.0

    def add(self, turn: Turn, t: float) -> None:
        """Keep what came in the turn at `t` s."""
        self._fresh.append(turn)
        if t - self._closed >= 1.0:
            self._blocks.append(self._joined())
            self._fresh, self._closed = [], t

    def streams(self, sign: float) -> Streams | None:
        """Both streams, readings times `sign`; None: nothing came."""
        blocks = [*self._blocks, *([self._joined()] if self._fresh else [])]
        if not blocks:
            return None
        readings, poses = (np.concatenate(part) for part in zip(*blocks, strict=True))
        place = poses[:, 5:]
        return Streams(
            WrenchStream(readings[:, 0], sign * readings[:, 1:]),
            OrientationStream(poses[:, 0], from_quat_xyzw(poses[:, 1:5]), place if np.isfinite(place).all() else None),
        )

    def _joined(self) -> tuple[Array, Array]:
        fresh = Turn.joined(self._fresh)
        readings = np.column_stack([fresh.t, fresh.wrench])
        poses = np.column_stack([fresh.pose_t, fresh.pose, fresh.position])
        good = readings[np.isfinite(readings).all(axis=1)]
        return good[:: 1 + len(good) // (2 * RATE)], poses[:: 1 + len(poses) // (2 * RATE)]
