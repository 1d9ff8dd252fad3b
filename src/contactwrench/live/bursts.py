"""Samples that come many at a time: as from a buffer that is emptied ten times a second, how long a burst is, and when
each of its samples was taken; and behind a gap, whether they waited in it.
"""

from __future__ import annotations

from collections import deque
from itertools import pairwise
from math import inf
from statistics import median

from .clock import LATE

PAUSE, MOST = 0.5 * LATE, 1.0
"""s without a sample, behind which a new burst begins; s from one burst to the next: more are stops."""
KEPT, FEWEST = 8, 3
"""Bursts by which a stream is judged; samples in each, at the least."""
SHORT = 0.5
"""Of the time from burst to burst, that the samples of one come within: those of a slow stream come all of the time."""
REGULAR = 0.25
"""Part by which the time from burst to burst, and their samples, may be off: a stall of the network is off by more."""


GAP, SOME, FASTER = 3.0, 10, 1.05
"""Periods without a sample, and `LATE` at the least, behind which one that has no time of its own may have been taken
before the gap, and waited. So it is for `LATE`, and until as much has come early as can have waited, or for `SOME`
periods no more than was taken meanwhile, by this factor and one: a network that was held up brought a queue of half a
second in one or two, and each sample of it was taken for one of now. At 1.12 times its pace none is told.
"""
DRAINED = 5.0
"""s behind a gap, after which no sample waited: a stream that comes faster than before has another rate."""


class Waited:
    """Of a stream without a time of its own: whether its samples waited."""

    def __init__(self) -> None:
        self._arrived, self._begin, self._usual = -inf, -inf, inf
        self._gap = self._queued = 0.0
        self._came, self._end = 0, -inf

    def took(self, arrival: float, usual: float) -> float:
        """How long the gap was, s, in which a sample may have waited, that came where they come every `usual` s; 0:
        it did not.
        """
        gap, self._arrived = arrival - self._arrived, arrival
        if max(LATE, GAP * usual) < gap < inf:
            self._gap, self._usual, self._begin, self._came = gap, usual, arrival, 0
            self._queued, self._end = gap - usual, arrival + DRAINED
        elif arrival >= self._end:
            self._gap = 0.0
        elif self._gap and (passed := arrival - self._begin) >= LATE:
            came_early = self._came * self._usual - passed
            if came_early >= self._queued - 0.5 * self._usual:  # all of it has come
                self._gap = 0.0
            elif passed >= SOME * self._usual:
                if came_early < (FASTER - 1.0) * passed + self._usual:  # there was none
                    self._gap = 0.0
                self._queued -= came_early
                self._begin, self._came = arrival, 0
        self._came += 1
        return self._gap


class Bursts:
    """The bursts of one stream, by the arrivals of its samples.

    Attributes:
        period: s from one burst to the next; 0: its samples come evenly, or stop and go as they like.
    """

    def __init__(self) -> None:
        self.period, self._step = 0.0, 0.0
        self._begins: deque[tuple[float, int, float]] = deque(maxlen=KEPT)
        self._arrived, self._samples = -inf, 0

    def taken(self, arrival: float) -> float | None:
        """When the next sample was taken, s: steady bursts are spread over the time since the burst before; None: of no
        such burst.
        """
        if arrival - self._arrived > PAUSE:
            self._begins.append((arrival, self._samples, self._arrived))
            self._judge()
        elif self.period and arrival - self._begins[-1][0] > self.period:
            self.period = 0.0
            self._begins.clear()
        self._arrived = arrival
        self._samples += 1
        if not self.period:
            return None
        before, (begin, first, _) = self._begins[-2][0], self._begins[-1]
        if not self._is_regular(begin - before):
            return None
        return min(before + (self._samples - first) * self._step, arrival)

    def _judge(self) -> None:
        """Whether the last bursts are alike; once they were, all but two: one that is held up is two that are not."""
        each = [
            (next_begin - begin, after - before, end - begin)
            for (begin, before, _), (next_begin, after, end) in pairwise(self._begins)
        ]
        if len(each) < KEPT - 1:
            return
        allowed = 2 if self.period else 0
        self.period, samples, lasted = (median(values) for values in zip(*each, strict=True))
        self._step = self.period / samples
        alike = [self._is_regular(time) and abs(number - samples) <= REGULAR * samples for time, number, _ in each]
        in_bursts = samples >= FEWEST and lasted <= SHORT * self.period
        if self.period > MOST or not in_bursts or sum(alike) < len(each) - allowed:
            self.period = 0.0

    def _is_regular(self, time: float) -> bool:
        return abs(time - self.period) <= REGULAR * self.period
