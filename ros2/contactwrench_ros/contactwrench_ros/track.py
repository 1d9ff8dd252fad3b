"""Poses by their stamps: asked for between two of them, or a little after the last, and when they are stale."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from math import inf
from typing import NamedTuple

from contactwrench.compensate.faults import FURTHEST, Reason
from contactwrench.geometry.quaternions import Quat, between, unit
from contactwrench.live.source import Three

KEPT = 2000
"""Poses: 2 s of the fastest arm's."""
LOOK_BACK = 0.02
"""s: over which the turn is taken that is carried on after the last orientation; over less, jitter of stamps counts."""
BEGUN_ANEW = 10.0
"""s by which the stamp of a pose is earlier than the last when a clock began anew; tf2 keeps as much. Poses that are
late by less, as of a second publisher, are passed over.
"""
STALE = "stale orientation"
NO_STAMP = "it is stamped 0, expected the time of its measurement: let whoever sends it stamp it"
ORIGIN: Three = (0.0, 0.0, 0.0)


class Pose(NamedTuple):
    """Of a flange in its base at `t` s: `R_base_flange`, and its `place`, m in base axes; None: that is not known."""

    t: float
    quat_xyzw: Quat
    place: Three | None


def filled_in(place: Three) -> Three | None:
    """A flange's place, m; None where nobody filled it in, as none is at 0, 0, 0 of its base, or no arm reaches it."""
    return place if any(place) and all(abs(part) < FURTHEST for part in place) else None


class Track:
    """The last poses of a frame that were heard, in the order of their stamps."""

    def __init__(self) -> None:
        self.times: list[float] = []
        self._quats: list[Quat] = []
        self._places: list[Three] = []
        self._none = "orientation: none was heard yet"

    def back_by(self, t: float, most: float = BEGUN_ANEW) -> float:
        """By how much, s, a stamp is earlier than the last, if by more than `most`, else 0."""
        return self.times[-1] - t if self.times and t < self.times[-1] - most else 0.0

    def forget(self) -> None:
        """Stamps went back: of a time that comes again the poses of before say nothing."""
        self.times.clear()
        self._quats.clear()
        self._places.clear()
        self._none = "orientation: none was heard since stamps went back"

    def hear(self, t: float, quat_xyzw: Quat, place: Three = ORIGIN) -> bool:
        """Keep a pose, `place` in m; False, and it is passed over, where it is no orientation, or no newer than the
        last.
        """
        if (orientation := unit(quat_xyzw)) is None:
            return False
        if self.back_by(t):
            self.forget()
        if self.times and t <= self.times[-1]:
            return False
        if len(self.times) >= 2 * KEPT:
            del self.times[:KEPT], self._quats[:KEPT], self._places[:KEPT]
        self.times.append(t)
        self._quats.append(orientation)
        self._places.append(place)
        return True

    def newest(self, t: float) -> float:
        """The last stamp, s, up to a time; minus infinity: there is none."""
        after = bisect_right(self.times, t)
        return self.times[after - 1] if after else -inf

    def apart(self, t: float) -> float:
        """By how much, s, a time is before the first stamp or after the last; 0 where there are none."""
        times = self.times
        return max(times[0] - t, t - times[-1], 0.0) if times and times[-1] else 0.0

    def place(self, t: float) -> Three:
        """The place, m, at a time, s, along the line between two that were heard; before and after them, the first and
        the last.
        """
        times, places = self.times, self._places
        after = min(bisect_right(times, t), len(times) - 1)
        if after == 0 or t >= times[after]:
            return places[after]
        (x, y, z), (a, b, c) = places[after - 1 : after + 1]
        share = (t - times[after - 1]) / (times[after] - times[after - 1])
        return x + share * (a - x), y + share * (b - y), z + share * (c - z)

    def at(self, t: float, stale_after: float) -> Quat | Reason:
        """The orientation at a time, s, or why it is not known: between two that are at most `stale_after` apart along
        the shortest turn, and as long after the last, with the turn carried on for no longer than it was seen.
        """
        times, quats = self.times, self._quats
        if not times:
            return Reason(self._none, STALE)
        after = bisect_right(times, t)
        if after == 0:
            return Reason(f"orientation: the oldest is {times[0] - t:.3f} s after the reading", STALE)
        if after == len(times):
            if t - times[-1] > stale_after:
                old = f"the last is {t - times[-1]:.3f} s old, expected at most {stale_after:g} s"
                return Reason(f"orientation: {old if times[-1] else NO_STAMP}", STALE)
            before = max(min(bisect_left(times, times[-1] - LOOK_BACK), after - 2), 0)
            seen = times[-1] - times[before]
            if not 0.0 < seen <= stale_after:
                return quats[-1]
            return between(quats[before], quats[-1], 1.0 + min((t - times[-1]) / seen, 1.0))
        gap = times[after] - times[after - 1]
        if gap > stale_after:
            return Reason(f"orientation: none for {gap:.3f} s, expected one every {stale_after:g} s", STALE)
        return between(quats[after - 1], quats[after], (t - times[after - 1]) / gap)
