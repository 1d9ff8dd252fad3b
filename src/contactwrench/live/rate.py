"""Whether a device's samples come at the rate that was asked for: counted in windows that follow each other."""

from __future__ import annotations

from collections import deque
from itertools import pairwise
from math import inf

SURELY, SOON = (0.5, 0.1), (0.12, 0.3)
"""s of a window, and the part by which two of them are to be off: a rate that is far off is not waited for longer."""
FEWEST = 10
"""Samples that are to come in a window, which is longer for a slow device: one more or less makes no other rate."""
RIGHT = 0.5
"""Of the part by which a rate is off: within it, it is right again. One at the limit is not said over and over so."""


class Windows:
    """Samples counted in windows of at least `over` s, from one arrival to another, so that bursts count as what they
    are. Their rate is `off` where two in a row differ from `asked`, Hz, by more than the part `by`, and less from each
    other: a stall, the burst behind it and silence are no rate.

    Attributes:
        counted: how many of the last two have ended.
        rate: Hz in them; None: not known yet.
        off: whether it is another rate.
        right: whether the last one has the rate that was asked for.
    """

    def __init__(self, asked: float | None, over: float, by: float) -> None:
        self._asked, self._by = asked, by
        self._over = over if asked is None else max(over, FEWEST / asked)
        self.begin(-inf)

    def begin(self, t: float) -> None:
        """Count anew, from `t` s on."""
        self._marks: deque[tuple[float, int]] = deque(maxlen=3)
        self._due, self.counted, self.off, self.right = t, 0, False, False
        self.rate: float | None = None

    def look(self, samples: int, t: float) -> None:
        """Count on; so many `samples` have come in all, the last of them at `t` s."""
        if t < self._due or (self._marks and samples == self._marks[-1][1]):
            return
        self._due = t + self._over
        self._marks.append((t, samples))
        rates = [(after - before) / (end - begin) for (begin, before), (end, after) in pairwise(self._marks)]
        if not rates:
            return
        self.counted, self.rate = len(rates), sum(rates) / len(rates)
        if self._asked is not None:
            errors = [rate / self._asked - 1.0 for rate in rates]
            least = min(map(abs, errors))
            self.right = abs(errors[-1]) < RIGHT * self._by
            self.off = len(rates) == 2 and least > max(self._by, abs(errors[1] - errors[0])) and min(rates) > 0.0


class Rate:
    """The rate of a device, from `t` s on, against the one that was `asked` for, Hz; None: it is only counted.

    Attributes:
        hz: over the last second, or longer for a slow device; None: not known yet.
    """

    def __init__(self, asked: float | None, t: float) -> None:
        self.asked = asked
        self.hz: float | None = None
        self._surely, self._soon = Windows(asked, *SURELY), Windows(asked, *SOON)
        self.begin(t)

    def begin(self, t: float) -> None:
        """Count anew, from `t` s on."""
        self._off: Windows | None = None
        self._surely.begin(t)
        self._soon.begin(t)

    def look(self, samples: int, t: float) -> float | None:
        """Count on, as `Windows` does. What comes, Hz, where that has become another rate than was asked for: said
        once, until it is right again.
        """
        self._surely.look(samples, t)
        self._soon.look(samples, t)
        self.hz = self._surely.rate or self.hz
        if self._off is None:
            self._off = next((each for each in (self._soon, self._surely) if each.off), None)
            return None if self._off is None else self._off.rate
        if self._off.right:
            self.begin(t)
        return None
