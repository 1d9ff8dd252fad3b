"""What both streams were on the way to a calibration, thinned and bounded: their motion tells the delay."""

from __future__ import annotations

from collections import deque

import numpy as np

from ..geometry.arrays import Array
from ..geometry.orientation import from_quat_xyzw
from ..samples.samples import OrientationStream, Streams, WrenchStream
from .sink import Turn

SECONDS, RATE = 180, 1_000
"""Kept, and rows of each stream in a second at most."""


class Motion:
    """The last seconds of both streams, a block of (t, wrench) and one of (t, quaternion, position) for each."""

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
