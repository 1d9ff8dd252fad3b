"""How the samples of one stream come: at which rate; many at a time, as from a buffer that is emptied ten times a
second; and behind a gap, in which they may have waited.
"""

from __future__ import annotations

from collections import deque
from itertools import pairwise
from math import inf
from statistics import median

from .clock import LATE

SURELY, SOON = (0.5, 0.1), (0.12, 0.3)
"""s of a window, and the part by which two of them are to be off: a rate that is far off is not waited for longer."""
COUNTED = 10
"""Samples that are to come in a window, which is longer for a slow device: one more or less makes no other rate."""
RIGHT = 0.5
"""Of the part by which a rate is off: within it, it is right again. One at the limit is not said over and over so."""
STILL_READ = 2.0
"""Times as fast as within the window comes the rest of a burst, which a busy computer reads piece by piece: a window
that ended within it had too few, and the next too many. A rate that grew makes one window at most twice as long.
"""


class Windows:
    """Samples counted in windows of at least `over` s, from one arrival to another, so that bursts count as what they
    are: each ends where a burst has been read. Of the last two windows `counted` have ended, with `rate` Hz, None
    before. Where both differ from `asked`, Hz, by more than the part `by`, and less from each other, `off` is the rate
    of the last one, as that began within the first, else 0: a stall, the burst behind it and silence are no rate. It is
    `right` where all have it.
    """

    def __init__(self, asked: float | None, over: float, by: float) -> None:
        self._asked, self._by = asked, by
        self._over = over if asked is None else max(over, COUNTED / asked)
        self.begin(-inf)

    def begin(self, t: float) -> None:
        """Count anew, from `t` s on."""
        self._marks: deque[tuple[float, int]] = deque(maxlen=3)
        self._due, self._is_read, self.counted, self.off, self.right = t, True, 0, 0.0, False
        self.rate: float | None = None

    def look(self, samples: int, t: float) -> None:
        """Count on; so many `samples` have come in all, the last of them at `t` s."""
        if t >= self._due:
            self._is_read = not self._marks
        elif self._is_read:
            return
        else:
            (begin, before), (end, after) = self._marks[-2], self._marks[-1]
            self._is_read = (samples - after) * (end - begin) <= STILL_READ * (after - before) * (t - end)
            if self._is_read:
                self._judge()
                return
            self._marks.pop()
        self._marks.append((t, samples))
        self._due = t + self._over

    def _judge(self) -> None:
        rates = [(after - before) / (end - begin) for (begin, before), (end, after) in pairwise(self._marks)]
        self.counted, self.rate = len(rates), sum(rates) / len(rates)
        if self._asked is not None:
            errors = [rate / self._asked - 1.0 for rate in rates]
            least = min(map(abs, errors))
            self.right = max(map(abs, errors)) < RIGHT * self._by
            is_off = len(rates) == 2 and least > max(self._by, abs(errors[1] - errors[0])) and min(rates) > 0.0
            self.off = rates[-1] if is_off else 0.0


class Rate:
    """The rate `hz` of a device over the last second or longer, against the one `asked` for; None: not known."""

    def __init__(self, asked: float | None, t: float) -> None:
        self.asked = asked
        self.hz: float | None = None
        self._surely, self._soon = Windows(asked, *SURELY), Windows(asked, *SOON)
        self.begin(t)

    def begin(self, t: float) -> None:
        """Count anew, from `t` s on."""
        self._said: Windows | None = None
        self._surely.begin(t)
        self._soon.begin(t)

    def look(self, samples: int, t: float) -> float | None:
        """Count on. What comes, Hz, where that has become another rate than was asked for: once, until right again."""
        self._surely.look(samples, t)
        self._soon.look(samples, t)
        self.hz = self._surely.rate or self.hz
        if self._said is None:
            self._said = next((each for each in (self._soon, self._surely) if each.off), None)
            return None if self._said is None else self._said.off
        if self._said.right:
            self.begin(t)
        return None


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
        """The gap, s, in which a sample may have waited, that came where they come every `usual` s; 0: it did not."""
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
    """The bursts of one stream; `period`: s from one to the next, 0: its samples come evenly, or stop and go."""

    def __init__(self) -> None:
        self.period, self._step = 0.0, 0.0
        self._begins: deque[tuple[float, int, float]] = deque(maxlen=KEPT)
        self._arrived, self._samples = -inf, 0

    def taken(self, arrival: float) -> float | None:
        """When the next sample was taken, s: a steady burst is spread over the time since the last; None: no burst."""
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
