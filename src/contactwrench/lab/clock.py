"""A device's own clock: when its rows are, and when they leave."""

from __future__ import annotations

from collections.abc import Callable
from time import monotonic
from typing import TypeAlias

import numpy as np

BLOCK = 0.001
"""s between two wake-ups of a device that is faster: the rows since then leave together."""

Jitter: TypeAlias = float | Callable[[], float]
"""s by which a wake-up is late: the largest, or a function that says."""


class Clock:
    """A device's own: row k is at `start + k / rate`, where `rate` is what its quartz makes of the one it means.

    Deadlines are absolute, so that no time is lost between them.
    """

    def __init__(self, rate: float, drift: float, jitter: Jitter) -> None:
        self._drift, self._jitter, self._rng = drift, jitter, np.random.default_rng(0)
        self.running, self.start, self.row = False, 0.0, 0
        self.set(rate)

    def set(self, rate: float) -> None:
        """Mean another rate, Hz, from the next start on."""
        self.nominal, self.rate = rate, rate * (1.0 + 1e-6 * self._drift)
        self._block, self.running = max(round(BLOCK * rate), 1), False

    def begin(self) -> None:
        """Row 0 is now."""
        self.running, self.start, self.row = True, monotonic(), 0
        self._schedule()

    def time(self, row: int) -> float:
        """When a row is, by the lab's clock."""
        return self.start + row / self.rate

    def due(self) -> int:
        """How many rows have become due: none before the next deadline."""
        if (now := monotonic()) < self._deadline:
            return 0
        rows = int((now - self.start) * self.rate) + 1 - self.row
        self.row += rows
        self._schedule()
        return rows

    def remaining(self) -> float:
        """Until the next deadline, s."""
        return max(self._deadline - monotonic(), 0.0)

    def _schedule(self) -> None:
        late = self._jitter() if callable(self._jitter) else self._jitter * self._rng.random()
        self._deadline = self.time(self.row + self._block - 1) + late
