"""Orientations by their stamps: asked for between two of them, or a little after the last, and when they are stale."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from math import acos, sin, sqrt
from typing import TypeAlias

from contactwrench.compensate.faults import Reason

Quat: TypeAlias = tuple[float, float, float, float]
"""x, y, z, w."""

KEPT = 2000
"""Orientations: 2 s of the fastest arm's."""
LOOK_BACK = 0.02
"""s: over which the turn is taken that is carried on after the last orientation; over less, jitter of stamps counts."""
BEGUN_ANEW = 10.0
"""s by which a stamp is earlier than the last when a clock began anew; tf2 keeps as much."""
STALE, OFF_UNIT = "stale orientation", 0.01


class Track:
    """The last orientations that were heard, in the order of their stamps."""

    def __init__(self) -> None:
        self.times: list[float] = []
        self._quats: list[Quat] = []

    def hear(self, t: float, quat_xyzw: Quat) -> bool:
        """Keep an orientation; False, and it is passed over, where it is none, or no newer than the last."""
        length = sqrt(sum(value * value for value in quat_xyzw))
        if not abs(length - 1.0) <= OFF_UNIT:
            return False
        if self.times and t < self.times[-1] - BEGUN_ANEW:
            self.times.clear()
            self._quats.clear()
        if self.times and t <= self.times[-1]:
            return False
        if len(self.times) >= 2 * KEPT:
            del self.times[:KEPT], self._quats[:KEPT]
        self.times.append(t)
        x, y, z, w = quat_xyzw
        self._quats.append((x / length, y / length, z / length, w / length))
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


def between(a: Quat, b: Quat, share: float) -> Quat:
    """The orientation at a share of the shortest turn from `a` to `b`, or beyond; exactly `a` where both are one."""
    cosine = sum(p * q for p, q in zip(a, b, strict=True))
    sign = 1.0 if cosine >= 0.0 else -1.0
    if cosine * sign > 1.0 - 1e-9:
        of_b = share * sign
        of_a = 1.0 - share
        if a == b:
            return a
    else:
        half = acos(cosine * sign)
        of_a, of_b = sin((1.0 - share) * half) / sin(half), sign * sin(share * half) / sin(half)
    x, y, z, w = (of_a * p + of_b * q for p, q in zip(a, b, strict=True))
    length = sqrt(x * x + y * y + z * z + w * w)
    return x / length, y / length, z / length, w / length


def times(a: Quat, b: Quat) -> Quat:
    """The product of two rotations."""
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )


def inverse(a: Quat) -> Quat:
    """The rotation back."""
    return -a[0], -a[1], -a[2], a[3]
