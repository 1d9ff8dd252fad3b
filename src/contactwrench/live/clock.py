"""When a sample was taken, from the device's own clock and the times at which samples arrived.

A network delays a sample, and never sends it early: so the smallest delays seen bound the offset between two clocks,
and the line under all of them is their rate (Moon, Skelly and Towsley, 1999, for a path; Olson, 2010, for sensors). The
smallest delay itself, a fraction of a ms on a wire, cannot be seen, and is left in.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Sequence
from math import inf, isnan

import numpy as np

BIN, BINS = 0.5, 240
"""s over which only the smallest delay is kept, and how many of those: two minutes, in which quartz keeps its rate."""
LEAST_SPAN = 4.0
"""s: over less, jitter would make a rate."""
FASTEST = 500e-6
"""Of one clock against another: quartz does not differ by more. A count whose rate is another than is said does, a
program that adds up its pauses, or a simulation that falls behind: that shows when all samples come `LATE`.
"""
RECENT, STRAIGHT = 8, 0.1
"""The last smallest delays by which such a clock is told, and how far they may lie off a straight line, as a part of
its rise: so no step. A queue that fills evenly looks alike until it is empty again.
"""
FLAT = 1e-3
"""s within which all of those lie but the first, where they rose at once by more than `SOONER`, and stay: the device
was set back, or stood. A network that is later by the same at once looks alike, its samples are told so much too late:
so it is said (intake.py).
"""
LATE = 0.05
"""s by which a sample comes after it was taken beyond which it is not to be used: its time may be wrong. Where all come
so late for a while the device's clock stood, or was set back, and times are told anew."""
SOONER = 2e-3
"""s: a smallest delay that falls by more at once is a clock that was set forward, or a queue that was in all before."""
EMPTY = 0.05
"""s in which the smallest delay falls by no more than `SOONER`: samples come no faster than they are taken, so what had
waited has come. Without it a queue that is read in pieces gave its middle for now: valid rows up to 7.7 N off. One that
comes at less than 1.04 times the pace at which it was taken is not told from a clock that is fast.
"""
FALLS = 2.0
"""s of falling: so long no queue is read, but a recording at twice its pace, or a clock that is fast by a twentieth."""
AGAIN, OFTEN = 0.5, 5
"""s from one beginning to the next, and how many in a row, that are no restart of a device: its clock never goes on."""


class Clock:
    """Turns (arrival, device's time) of one device, in order, into times of arrival without the network's jitter.
    `pace` is s that pass in one of the device's, where that is none of a quartz; samples come `lateness` s later than
    the soonest, on average; and all of them by `later` s since it began, that came at once, and stay.
    """

    def __init__(self) -> None:
        self._began, self._beginnings = -inf, 0
        self.reset()

    @property
    def begins_on_and_on(self) -> bool:
        """Whether it begins anew again and again, so that no time of it lasts."""
        return self._beginnings >= OFTEN

    def reset(self) -> None:
        """The device's clock began anew."""
        self._bins: list[tuple[float, float]] = []
        self._recent = deque[tuple[float, float]](maxlen=RECENT)
        self._bin = self._device = self._arrived = -inf
        self._least = (0.0, inf)
        self._rate, self._line, self.pace = 0.0, (0.0, inf), 1.0
        self._is_known, self._is_fast, self._fell, self._unknown_from = False, False, (inf, inf), inf
        self.lateness = self.later = 0.0

    def times(self, stamps: Sequence[tuple[float, float]], anew: Collection[int] = ()) -> list[tuple[float, bool]]:
        """The times (s since 1970) of samples that came together, from their (arrival, device's time), and whether they
        are known: what a device had kept, and sent at once, is told apart so. NaN for the device's: the arrival, there
        is nothing better. Where the device's goes back, and at the places `anew`, it has begun anew: what came before
        has nothing to do with it. They are not known until what waited then has come, `EMPTY`, or is no queue, `FALLS`.
        """
        times: list[tuple[float, bool]] = []
        for k, (arrival, device) in enumerate(stamps):
            if device < self._device or k in anew:
                self._tell(stamps[len(times) : k], times)
                self.reset()
                self._beginnings = self._beginnings + 1 if arrival - self._began < AGAIN else 1
                self._began = arrival
            if not isnan(device):
                self._see(arrival, device)
        self._tell(stamps[len(times) :], times)
        return times

    def _tell(self, stamps: Sequence[tuple[float, float]], times: list[tuple[float, bool]]) -> None:
        """Append the times of samples, all of which were seen."""
        if not self._is_known:
            self._is_known = self._arrived - self._fell[0] >= EMPTY
            self._is_fast = not self._is_known and self._arrived - self._unknown_from >= FALLS
        known = self._is_known or self._is_fast
        for arrival, device in stamps:
            none = isnan(device)
            t = arrival if none else (told := device * self.pace) + self._at(told)
            self.lateness += 0.01 * (arrival - t - self.lateness)
            times.append((t, known or none))

    def _see(self, arrival: float, device: float) -> None:
        self._device, self._arrived = device, arrival
        self._unknown_from = min(self._unknown_from, arrival)
        if arrival >= self._bin + BIN:
            self._next_bin(arrival)
        device *= self.pace
        offset = arrival - device
        if offset < self._fell[1] - SOONER:
            self._fell = (arrival, offset)
        if offset < self._least[1]:
            self._least = (device, offset)
            if (sooner := self._at(device) - offset) > 0.0:
                if sooner > LATE and self._is_known:  # a queue all the same, or another clock: what comes will tell
                    self._is_known, self._fell, self._unknown_from = False, (arrival, offset), arrival
                if sooner > SOONER:
                    self._bins.clear()
                    self._rate = 0.0
                self._line = self._least

    def _at(self, device: float) -> float:
        return self._line[1] + self._rate * (device - self._line[0])

    def _next_bin(self, arrival: float) -> None:
        if self._least[1] < inf:
            self._recent.append(self._least)
            if self.pace > 1.0 and self._recent[0][1] - self._least[1] > LATE:  # of a slow clock nothing comes sooner
                self._paced(1.0 / self.pace)
                self.pace = 1.0
            if self._bins and self._least[1] - self._at(self._least[0]) > LATE:
                self._bins.clear()
                self._rate = 0.0
                if rise := steady_rise(self._recent):
                    self._paced(1.0 + rise)
            elif has_stepped(self._recent):
                self.later += self._recent[1][1] - self._recent[0][1]
                self._bins = [*self._recent][1:-1]
            if not self._bins or self._least[0] > self._bins[-1][0]:  # else its clock stands
                self._bins.append(self._least)
            del self._bins[:-BINS]
            self._rate, self._line = line_under(self._bins)
        self._bin, self._least = arrival, (0.0, inf)

    def _paced(self, pace: float) -> None:
        """Tell the device's times by another pace from here on."""
        self.pace *= pace
        device = self._least[0] * pace
        moved = self._least[0] - device
        self._least = (device, self._least[1] + moved)
        self._fell = (self._fell[0], self._fell[1] + moved)
        self._recent.clear()
        self._bins.clear()
        self._rate = 0.0


def steady_rise(recent: Sequence[tuple[float, float]]) -> float:
    """The slope of (time, offset) that rise along a straight line, as those of a clock that is slow do; else 0."""
    if len(recent) < RECENT:
        return 0.0
    (begin, first), (end, last) = recent[0], recent[-1]
    slope = (last - first) / max(end - begin, LEAST_SPAN * FASTEST)
    off = max(abs(offset - first - slope * (time - begin)) for time, offset in recent)
    return slope if off < STRAIGHT * (last - first) else 0.0


def has_stepped(recent: Sequence[tuple[float, float]]) -> bool:
    """Whether (time, offset) rose at once, and stay."""
    later = [offset for _, offset in [*recent][1:]]
    return len(later) == RECENT - 1 and min(later) - recent[0][1] > SOONER and max(later) - min(later) < FLAT


def line_under(points: list[tuple[float, float]]) -> tuple[float, tuple[float, float]]:
    """Slope, and a point, of the highest line, over the mean time, that has no point of (time, offset), in order of
    time, below it. Level where they span too little; no steeper than `FASTEST`, as where a queue on the way fills.
    """
    slope = 0.0
    if points[-1][0] - points[0][0] >= LEAST_SPAN:
        time, offset = (np.array(points) - points[0]).T
        is_before = time < (middle := time.mean())
        rise = (offset[~is_before] - offset[is_before, None]) / (time[~is_before] - time[is_before, None])
        there = offset[is_before, None] + rise * (middle - time[is_before, None])
        slope = max(-FASTEST, min(FASTEST, float(rise.flat[np.argmin(there)])))  # of two points the lowest line there
    return slope, min(points, key=lambda point: point[1] - slope * point[0])
