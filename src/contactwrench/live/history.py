"""What is kept of the past: the last seconds' readings, and whether arm and reading stand still in them, judged ten
times a second by the sensor's own quiet; and what both streams were on the way to a calibration.
"""

from __future__ import annotations

from array import array
from bisect import bisect_right
from collections import deque
from dataclasses import dataclass
from math import inf

import numpy as np

from ..geometry.arrays import Array
from ..geometry.orientation import from_quat_xyzw
from ..samples.samples import OrientationStream, Streams, WrenchStream
from ..statistics import two_digits
from .sink import Turn

ROOM, WIDTH = 32_768, 11
"""Readings: 3 s of a sensor at 10 kHz; and numbers of each."""
STOPPED = 1.0
"""s: of steady bursts no two lie further apart (arrivals.py)."""
SECONDS, RATE = 180, 1_000
"""Kept of a motion, and rows of each stream in a second at most."""
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


class History:
    """Readings (n, 6) with their times and orientations (n, 4), the newest last."""

    def __init__(self) -> None:
        self._numbers = array("d")

    def add(self, turn: Turn) -> None:
        """The readings of a turn that may be used."""
        for t, _, wrench, orientation, flaw in turn.readings:
            if not flaw:
                self._numbers.extend((t, *wrench, *orientation))
        if len(self._numbers) > 2 * ROOM * WIDTH:
            del self._numbers[: -ROOM * WIDTH]

    def last(self, seconds: float, now: float = -inf) -> tuple[Array, Array, Array]:
        """Times (n,), readings (n, 6) and orientations (n, 4) of the last seconds; none, where `now` (s) is told, of a
        sensor that has given no good reading for `STOPPED` s.
        """
        kept = np.frombuffer(self._numbers).reshape(-1, WIDTH)
        newest = kept[-1, 0] if len(kept) else -inf
        begin = inf if now - newest > STOPPED else newest - seconds
        rows = kept[bisect_right(kept[:, 0], begin) :].copy()  # what is viewed cannot grow
        return rows[:, 0], rows[:, 1:7], rows[:, 7:]


class Motion:
    """The last seconds of both streams, thinned, (t, wrench) and (t, quaternion, position): they tell the delay."""

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
