"""Where the flange was turned at any moment of the last seconds: between two poses, or carried on for a moment."""

from __future__ import annotations

from collections import deque
from math import acos, inf, nan, sin, sqrt

from .source import Four, Three

KEPT = 4_096
LOOK_BACK = 0.01
"""s over which the turn is taken that a pose is carried on with: over less, the noise of the poses makes it."""
PERIODS, LEAST_AGE, MOST_AGE = 5.0, 0.02, 0.25
"""A pose is old after so many periods of its stream, within these s: on a fast stream a moment of the network's is
waited for, on a slow one never longer than an arm stands still by chance."""
FORGETS = 0.02
BRAKING = 20.0
"""rad/s^2: no arm stops a turn faster."""
UNKNOWN: Four = (nan, nan, nan, nan)
NO_PLACE: Three = (nan, nan, nan)


class PoseTrack:
    """The last poses of a stream, in the order of their times."""

    def __init__(self) -> None:
        self._poses: deque[tuple[float, Four, Three]] = deque(maxlen=KEPT)
        self._period = 0.0
        self._changed, self._usual, self._speed, self._steady = -inf, 0.0, 0.0, False

    def add(self, t: float, orientation: Four, position: Three | None) -> None:
        """A pose at `t` s: the quaternion x, y, z, w of the flange in base axes, and its place, m."""
        if self._poses:
            last, before, _ = self._poses[-1]
            step = t - last
            if 0.0 < step < MOST_AGE:
                self._period += FORGETS * (step - self._period) if self._period else step
            if sum(a * b for a, b in zip(orientation, before, strict=True)) < 0.0:
                x, y, z, w = orientation
                orientation = (-x, -y, -z, -w)
            self._watch(t, orientation, before)
        self._poses.append((t, orientation, position or NO_PLACE))

    def _watch(self, t: float, orientation: Four, before: Four) -> None:
        """Note how fast it turns, where it has turned at all, and whether too fast to stop before the next pose."""
        if orientation == before or t <= self._changed:
            return
        if self.frozen(t):
            self._poses.clear()
        since = min(t - self._changed, MOST_AGE)
        self._usual += 10.0 * FORGETS * (since - self._usual) if self._usual else since
        speed, self._changed = angle_between(orientation, before) / since, t
        self._steady = min(speed, self._speed) > BRAKING * max(since, self._usual)
        self._speed = speed

    def frozen(self, now: float) -> bool:
        """Whether poses go on to come, all of them the same, although the arm turned too fast to stop so soon."""
        return self._steady and now - self._changed > max(PERIODS * self._usual, LEAST_AGE)

    @property
    def stale_after(self) -> float:
        """Age (s) from which a pose says nothing of now."""
        return min(max(PERIODS * self._period, LEAST_AGE), MOST_AGE)

    @property
    def newest(self) -> tuple[float, Four, Three] | None:
        """The last pose: time, orientation, place."""
        return self._poses[-1] if self._poses else None

    def at(self, t: float, now: float) -> tuple[Four, float]:
        """The orientation at `t` s, and how old it is at `now`, s: 0 between two poses, else the age of the newest,
        from which it is carried on. NaN where there is none, where the newest is old, or the two lie too far apart.
        """
        poses = self._poses
        if not poses:
            return UNKNOWN, inf
        newest = poses[-1][0]
        if self.frozen(now):
            return UNKNOWN, now - self._changed
        if t >= newest:
            age = max(now - newest, 0.0)
            return (UNKNOWN if age > self.stale_after else self._carried_on(t - newest)), age
        for k in range(len(poses) - 1, 0, -1):
            before, after = poses[k - 1], poses[k]
            if before[0] <= t:
                gap = after[0] - before[0]
                if gap > self.stale_after:
                    return UNKNOWN, gap
                return turned(before[1], after[1], (t - before[0]) / gap if gap > 0.0 else 1.0), 0.0
        return UNKNOWN, inf

    def _carried_on(self, onwards: float) -> Four:
        """The newest orientation, turned on for some s as it turned before."""
        newest, orientation, _ = self._poses[-1]
        for k in range(len(self._poses) - 2, -1, -1):
            t, earlier, _ = self._poses[k]
            if newest - t >= LOOK_BACK:
                if newest - t > MOST_AGE:
                    break
                return turned(earlier, orientation, 1.0 + onwards / (newest - t))
        return orientation


def turned(a: Four, b: Four, part: float) -> Four:
    """The orientation at `part` of the way from a to b, unit quaternions less than half a turn apart; beyond 1: on."""
    if a == b:
        return a
    cosine = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]
    if cosine > 0.999999:
        of_a, of_b = 1.0 - part, part
    else:
        angle = acos(max(cosine, -1.0))
        of_a, of_b = sin((1.0 - part) * angle) / sin(angle), sin(part * angle) / sin(angle)
    x, y, z, w = (of_a * p + of_b * q for p, q in zip(a, b, strict=True))
    length = sqrt(x * x + y * y + z * z + w * w)
    return (x / length, y / length, z / length, w / length)


def angle_between(a: Four, b: Four) -> float:
    """The angle (rad) from one orientation to another."""
    cosine = abs(a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3])
    return 2.0 * acos(min(cosine, 1.0))
