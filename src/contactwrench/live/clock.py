"""When a sample was taken, from the device's own clock and the times at which samples arrived.

A network delays a sample, and never sends it early: so the smallest delays seen bound the offset between two clocks,
and the line under all of them is their rate (Moon, Skelly and Towsley, 1999, for a path; Olson, 2010, for sensors). The
smallest delay itself, a fraction of a ms on a wire, cannot be seen, and is left in.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from math import inf, isnan

BIN, BINS = 0.5, 240
"""s over which only the smallest delay is kept, and how many of those: two minutes, in which quartz keeps its rate."""
LEAST_SPAN = 4.0
"""s: over less, jitter would make a rate."""
FASTEST = 500e-6
"""Of one clock against another: quartz does not differ by more."""
STEPPED = 0.25
"""s: smallest delays that grow by more at once are a clock that was set, or a queue that nobody wants to trust."""
LEAST_STEP = 1e-6
"""s from one sample to the next: time goes on."""


class Clock:
    """Turns (arrival, device's time) of one device, in order, into times of arrival without the network's jitter."""

    def __init__(self) -> None:
        self.reset()
        self._last = -inf

    def reset(self) -> None:
        """The device's clock began anew."""
        self._bins: list[tuple[float, float]] = []
        self._bin = self._device = -inf
        self._least = (0.0, inf)
        self._rate, self._line = 0.0, (0.0, inf)
        self.lateness = 0.0

    def times(self, stamps: Sequence[tuple[float, float]]) -> list[float]:
        """The times (s since 1970) of samples that came together, from their (arrival, device's time): what a device
        had kept, and sent at once, is told apart so. NaN for the device's: the arrival, there is nothing better. Where
        the device's goes back it has begun anew, and what came before has nothing to do with it.
        """
        times = list[float]()
        for part in self._parts(stamps):
            for arrival, device in part:
                if not isnan(device):
                    self._see(arrival, device)
            times += [self._time(arrival, device) for arrival, device in part]
        return times

    def _parts(self, stamps: Sequence[tuple[float, float]]) -> Iterator[Sequence[tuple[float, float]]]:
        """The stamps, parted where the device began anew."""
        begin, latest = 0, self._device
        for k, (_, device) in enumerate(stamps):
            if device < latest:
                yield stamps[begin:k]
                self.reset()
                begin = k
            latest = latest if isnan(device) else device
        yield stamps[begin:]

    def _see(self, arrival: float, device: float) -> None:
        offset, self._device = arrival - device, device
        if device >= self._bin + BIN:
            self._next_bin(device)
        if offset < self._least[1]:
            self._least = (device, offset)
            if offset < self._at(device):
                self._line = self._least

    def _time(self, arrival: float, device: float) -> float:
        t = arrival if isnan(device) else device + self._at(device)
        self.lateness += 0.01 * (arrival - t - self.lateness)
        self._last = max(t, self._last + LEAST_STEP)
        return self._last

    def _at(self, device: float) -> float:
        return self._line[1] + self._rate * (device - self._line[0])

    def _next_bin(self, device: float) -> None:
        if self._least[1] < inf:
            if self._bins and self._least[1] - self._at(self._least[0]) > STEPPED:
                self._bins.clear()
                self._rate = 0.0
            self._bins.append(self._least)
            del self._bins[:-BINS]
            self._rate, self._line = line_under(self._bins)
        self._bin, self._least = device, (0.0, inf)


def line_under(points: list[tuple[float, float]]) -> tuple[float, tuple[float, float]]:
    """Slope, and a point, of the highest line, over the mean time, that has no point of (time, offset), in order of
    time, below it. Level where they span too little; no steeper than `FASTEST`, as where a queue on the way fills.
    """
    slope = 0.0
    if points[-1][0] - points[0][0] >= LEAST_SPAN:
        middle = sum(time for time, _ in points) / len(points)
        (a, offset_a), (b, offset_b) = next(edge for edge in pairwise(_lower_hull(points)) if edge[1][0] >= middle)
        slope = max(-FASTEST, min(FASTEST, (offset_b - offset_a) / (b - a)))
    return slope, min(points, key=lambda point: point[1] - slope * point[0])


def _lower_hull(points: list[tuple[float, float]]) -> list[tuple[float, float]]:
    hull: list[tuple[float, float]] = []
    for point in points:
        while len(hull) > 1 and _turns_right(hull[-2], hull[-1], point):
            hull.pop()
        hull.append(point)
    return hull


def _turns_right(a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]) -> bool:
    """Whether b lies on or above the line from a to c."""
    return (b[1] - a[1]) * (c[0] - a[0]) >= (c[1] - a[1]) * (b[0] - a[0])
