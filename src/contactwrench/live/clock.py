"""When a sample was taken, from the device's own clock and the times at which samples arrived.

A network delays a sample, and never sends it early: so the smallest delays seen bound the offset between two clocks,
and the line under all of them is their rate (Moon, Skelly and Towsley, 1999, for a path; Olson, 2010, for sensors). The
smallest delay itself, a fraction of a ms on a wire, cannot be seen, and is left in.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import inf, isnan

BIN, BINS = 0.5, 240
"""s over which only the smallest delay is kept, and how many of those: two minutes, in which quartz keeps its rate."""
LEAST_SPAN = 4.0
"""s: over less, jitter would make a rate."""
FASTEST = 500e-6
"""Of one clock against another: quartz does not differ by more."""
LATE = 0.05
"""s by which a sample comes after it was taken beyond which it is not to be used: its time may be wrong. Where all come
so late for a while the device's clock stood, or was set back, and times are told anew."""
SOONER = 2e-3
"""s: a smallest delay that falls by more at once is a clock that was set forward, or a queue that was in all before."""


class Clock:
    """Turns (arrival, device's time) of one device, in order, into times of arrival without the network's jitter."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """The device's clock began anew."""
        self._bins: list[tuple[float, float]] = []
        self._bin = -inf
        self._least = (0.0, inf)
        self._rate, self._line = 0.0, (0.0, inf)
        self.lateness = 0.0

    def times(self, stamps: Sequence[tuple[float, float]]) -> list[float]:
        """The times (s since 1970) of samples that came together, from their (arrival, device's time): what a device
        had kept, and sent at once, is told apart so. NaN for the device's: the arrival, there is nothing better.
        """
        for arrival, device in stamps:
            if not isnan(device):
                self._see(arrival, device)
        return [self._time(arrival, device) for arrival, device in stamps]

    def _see(self, arrival: float, device: float) -> None:
        offset = arrival - device
        if arrival >= self._bin + BIN:
            self._next_bin(arrival)
        if offset < self._least[1]:
            self._least = (device, offset)
            if (sooner := self._at(device) - offset) > 0.0:
                if sooner > SOONER:
                    self._bins.clear()
                    self._rate = 0.0
                self._line = self._least

    def _time(self, arrival: float, device: float) -> float:
        t = arrival if isnan(device) else device + self._at(device)
        self.lateness += 0.01 * (arrival - t - self.lateness)
        return t

    def _at(self, device: float) -> float:
        return self._line[1] + self._rate * (device - self._line[0])

    def _next_bin(self, arrival: float) -> None:
        if self._least[1] < inf:
            if self._bins and self._least[1] - self._at(self._least[0]) > LATE:
                self._bins.clear()
                self._rate = 0.0
            self._bins.append(self._least)
            del self._bins[:-BINS]
            self._rate, self._line = line_under(self._bins)
        self._bin, self._least = arrival, (0.0, inf)


def line_under(points: list[tuple[float, float]]) -> tuple[float, tuple[float, float]]:
    """Slope, and a point, of the highest line that has no point of (time, offset), in order of time, below it: the edge
    of their lower hull over the mean time. Level, through the least offset, where they span too little.
    """
    if points[-1][0] - points[0][0] < LEAST_SPAN:
        return 0.0, min(points, key=lambda point: point[1])
    hull: list[tuple[float, float]] = []
    for point in points:
        while len(hull) > 1 and _turns_right(hull[-2], hull[-1], point):
            hull.pop()
        hull.append(point)
    middle = sum(time for time, _ in points) / len(points)
    k = next(k for k in range(1, len(hull)) if hull[k][0] >= middle)
    (a, offset_a), (b, offset_b) = hull[k - 1], hull[k]
    slope = (offset_b - offset_a) / (b - a)
    return max(-FASTEST, min(FASTEST, slope)), hull[k]


def _turns_right(a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]) -> bool:
    """Whether b lies on or above the line from a to c."""
    return (b[1] - a[1]) * (c[0] - a[0]) >= (c[1] - a[1]) * (b[0] - a[0])
