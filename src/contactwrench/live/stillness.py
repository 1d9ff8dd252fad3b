"""Whether arm and reading stand still now, and what does not: judged ten times a second, by the sensor's own quiet."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from math import inf

import numpy as np

from ..geometry.arrays import Array
from ..statistics import two_digits
from .history import History

EVERY, WINDOW = 0.1, 0.5
"""s from one look to the next, and s that are looked at."""
BLOCKS, FEWEST_ROWS = 10, 20
TURNS = np.deg2rad(0.1)
"""rad within the window: robots hold a pose to a tenth of it."""
KEPT, FEWEST_LOOKS = 200, 5
TIMES_QUIET, TIMES_WHITE = 4.0, 4.0
"""The std of the means of blocks over what it is in the quieter looks, beyond which somebody or something moves the
reading: a hand is at a hundred. And over what white noise would make of them, where no quiet was seen yet.
"""
QUIETER = 25.0
"""Percentile of the looks at a standing arm: a hand may be at the tool most of the time."""


@dataclass(frozen=True)
class Stand:
    """`still` since `since` s (infinity: not); else what `moves`, in words, and whether the `arm` is seen to."""

    since: float
    moves: str = "nothing has come yet"
    arm: bool = False

    @property
    def still(self) -> bool:
        """Whether arm and reading stand."""
        return self.since < inf


class Stillness:
    """Looks at the history, and remembers how quiet the sensor is."""

    def __init__(self) -> None:
        self._looks: deque[Array] = deque(maxlen=KEPT)
        self._next = -inf
        self.now = Stand(inf)
        self.noise: Array | None = None
        self.orientation: Array | None = None

    @property
    def quiet(self) -> Array | None:
        """The std (6,) of means over a twentieth of a second, N and N m, while nothing moves; None: not seen yet."""
        if len(self._looks) < FEWEST_LOOKS:
            return None
        return np.percentile(np.array(self._looks), QUIETER, axis=0)

    def look(self, history: History, t: float) -> bool:
        """Look, where it is time to at `t` s; whether it was."""
        if t < self._next:
            return False
        self._next = t + EVERY
        times, wrench, orientation = history.last(WINDOW)
        moves, arm = self._what_moves(times, wrench, orientation, t)
        if moves:
            self.now = Stand(inf, moves, arm)
        elif not self.now.still:
            self.now = Stand(float(times[0]), "", False)
        return True

    def _what_moves(self, times: Array, wrench: Array, orientation: Array, t: float) -> tuple[str, bool]:
        if len(times) < FEWEST_ROWS or times[-1] - times[0] < 0.8 * WINDOW or t - times[-1] > WINDOW:
            return "readings have stopped coming", False
        self.noise = wrench.std(axis=0)
        if not np.isfinite(orientation).all():
            return "the robot's orientation is missing", False
        self.orientation = orientation[-1]
        cosine = np.abs(orientation @ orientation[-1]).min()
        if 2.0 * np.arccos(min(cosine, 1.0)) > TURNS:
            return "the arm turns", True
        parts = np.array_split(wrench, BLOCKS)
        spread = np.std([part.mean(axis=0) for part in parts], axis=0)
        white = np.abs(np.diff(wrench, axis=0)).mean(axis=0) / np.sqrt(len(wrench) / BLOCKS) + 1e-12
        quiet = self.quiet
        limit = TIMES_WHITE * white * 10.0 if quiet is None else np.maximum(TIMES_QUIET * quiet, TIMES_WHITE * white)
        self._looks.append(spread)
        if (spread > limit).any():
            axis = int(np.argmax(spread / limit))
            unit, scale = ("N", 1.0) if axis < 3 else ("mN m", 1e3)
            by = two_digits(scale * float(np.ptp(wrench[:, axis])))
            return f"the reading moves by {by} {unit}: keep hands off the tool", False
        return "", False
