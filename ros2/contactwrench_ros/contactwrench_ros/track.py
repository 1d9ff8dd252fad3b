"""Orientations by their stamps: asked for between two of them, or a little after the last, and when they are stale."""

from __future__ import annotations

from bisect import bisect_left, bisect_right

from contactwrench.compensate.faults import Reason
from contactwrench.geometry.quaternions import Quat, between, unit

KEPT = 2000
"""Orientations: 2 s of the fastest arm's."""
LOOK_BACK = 0.02
"""s: over which the turn is taken that is carried on after the last orientation; over less, jitter of stamps counts."""
BEGUN_ANEW = 10.0
"""s by which a stamp is earlier than the last when a clock began anew; tf2 keeps as much."""
STALE = "stale orientation"


class Track:
    """The last orientations that were heard, in the order of their stamps."""

    def __init__(self) -> None:
        self.times: list[float] = []
        self._quats: list[Quat] = []

    def hear(self, t: float, quat_xyzw: Quat) -> bool:
        """Keep an orientation; False, and it is passed over, where it is none, or no newer than the last."""
        if (orientation := unit(quat_xyzw)) is None:
            return False
        if self.times and t < self.times[-1] - BEGUN_ANEW:
            self.times.clear()
            self._quats.clear()
        if self.times and t <= self.times[-1]:
            return False
        if len(self.times) >= 2 * KEPT:
            del self.times[:KEPT], self._quats[:KEPT]
        self.times.append(t)
        self._quats.append(orientation)
        return True

    def at(self, t: float, stale_after: float) -> Quat | Reason:
        """The orientation at a time, s, or why it is not known: between two that are at most `stale_after` apart along
        the shortest turn, and as long after the last, with the turn carried on for no longer than it was seen.
        """
        times, quats = self.times, self._quats
        if not times:
            return Reason("orientation: none was heard yet", STALE)
        after = bisect_right(times, t)
        if after == 0:
            return Reason(f"orientation: the oldest is {times[0] - t:.3f} s after the reading", STALE)
        if after == len(times):
            if t - times[-1] > stale_after:
                old = f"the last is {t - times[-1]:.3f} s old"
                return Reason(f"orientation: {old}, expected at most {stale_after:g} s", STALE)
            before = max(min(bisect_left(times, times[-1] - LOOK_BACK), after - 2), 0)
            seen = times[-1] - times[before]
            if not 0.0 < seen <= stale_after:
                return quats[-1]
            return between(quats[before], quats[-1], 1.0 + min((t - times[-1]) / seen, 1.0))
        gap = times[after] - times[after - 1]
        if gap > stale_after:
            return Reason(f"orientation: none for {gap:.3f} s, expected one every {stale_after:g} s", STALE)
        return between(quats[after - 1], quats[after], (t - times[after - 1]) / gap)
