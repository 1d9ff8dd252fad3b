"""The readings of the last seconds, as arrays."""

from __future__ import annotations

import numpy as np

from ..geometry.arrays import Array
from .sink import Turn

SECONDS, ROOM = 2.5, 32_768
"""Kept, and rows: a sensor at 10 kHz and more has a shorter past."""


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
