"""A robot's poses: where the flange was turned at any moment of the last seconds, between two of them or carried on for
a moment; and, for a Compensator that knows the tool's inertia, each of them before the readings that need it.
"""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from collections.abc import Sequence
from math import inf, isfinite, isnan, nan
from operator import itemgetter

import numpy as np

from ..compensate.compensator import Compensator
from ..geometry.quaternions import angle_between, between, unit
from .source import NO_PLACE, UNKNOWN, Four, Sample, Three

KEPT = 8_192
"""More than come in a turn of the worker, which adds them before it asks: three blocks of a recording (replay.py)."""
LOOK_BACK = 0.01
"""s over which the turn is taken that a pose is carried on with: over less, the noise of the poses makes it."""
CARRIED = 2.5
"""Times as long as it was seen, that a turn is carried on to now: for a pose or two that is late, and no further where
the robot's times are wrong, and its speed with them (at half its clock 0.46 N of a tool of 9 N, without end 0.72 N).
"""
PERIODS, LEAST_AGE, MOST_AGE = 5.0, 0.02, 0.25
"""A pose is old after so many periods of its stream, within these s: on a fast stream a moment of the network's is
waited for, on a slow one never longer than an arm stands still by chance."""
FORGETS = 0.02
"""Of each step, into the mean period: fifty poses, over which bursts of a network even out."""
BRAKING = 20.0
"""rad/s^2: no arm stops a turn faster."""
ENOUGH = 3
"""Poses in a row: from so many the one in the middle has an acceleration."""
CLOSEST = 0.0035
"""s between poses, by the robot's clock: what their noise makes of an acceleration falls with the square of it. On the
rig, poses at 500 Hz over a network that is late by up to 5 ms, 2 ms leave 1.8 N of 0.01 mm and 0.001 deg of noise, 4 ms
0.42 N, 8 ms 0.22 N; without noise 0.04, 0.06 and 0.16 N.
"""
NEEDED = {"position": "x, y, z too", "time of their own": "t too, by its own clock"}
"""Of poses that tell a motion, and what a robot without it is to send."""


class PoseTrack:
    """The last poses of a stream, in the order of their times."""

    def __init__(self) -> None:
        self._poses: deque[tuple[float, Four, Three]] = deque(maxlen=KEPT)
        self.period = 0.0
        self.stale_after = LEAST_AGE
        """Age (s) from which a pose says nothing of now."""
        self._changed, self._usual, self._speed, self._steady = -inf, 0.0, 0.0, False

    def add(self, t: float, orientation: Four, position: Three | None) -> bool:
        """A pose at `t` s; one that is no orientation, and False, is passed over: the one before it grows old."""
        if (turn := unit(orientation)) is None:
            return False
        if self._poses:
            last, before, _ = self._poses[-1]
            if 0.0 < (step := t - last) < MOST_AGE:
                self.period += FORGETS * (step - self.period) if self.period else step
                self.stale_after = min(max(PERIODS * self.period, LEAST_AGE), MOST_AGE)
            self._watch(t, turn, before)
        self._poses.append((t, turn, position or NO_PLACE))
        return True

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
        return self._steady and min(now, self._poses[-1][0]) - self._changed > max(PERIODS * self._usual, LEAST_AGE)

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
            return (UNKNOWN if age > self.stale_after else self._carried_on(t - newest, max(t - now, 0.0))), age
        k = bisect_right(poses, t, key=itemgetter(0))
        if k == 0:
            return UNKNOWN, inf
        before, after = poses[k - 1], poses[k]
        gap = after[0] - before[0]
        if gap > self.stale_after and t > before[0]:  # else recorded together, however slowly
            return UNKNOWN, gap
        return between(before[1], after[1], (t - before[0]) / gap), 0.0

    def _carried_on(self, onwards: float, beyond: float) -> Four:
        """The newest orientation, turned on for some s as it turned before, of which so many lie beyond now."""
        backwards = reversed(self._poses)
        newest, orientation, _ = next(backwards)
        for t, earlier, _ in backwards:
            if (seen := newest - t) >= LOOK_BACK:
                if seen > MOST_AGE:
                    break
                return between(earlier, orientation, 1.0 + min((onwards - beyond) / seen, CARRIED) + beyond / seen)
        return orientation


class PoseFeed:
    """Gives a compensator one robot's poses; the wrench is stamped `delay` s later than the pose that goes with it.

    They are given as they came, and not as the track interpolates them for readings: between poses that is a straight
    line, and all acceleration would be at its ends. None is given to a reading of before it, though both came together:
    the noise of accelerations is fast, and a low-pass takes it out only where each of them lasts equally long.
    """

    def __init__(self, compensator: Compensator, delay: float) -> None:
        self._compensator, self._delay = compensator, delay
        self._waiting: deque[tuple[float, Sample]] = deque(maxlen=KEPT)
        self._newest, self._device, self._in_a_row = -inf, nan, 0
        self._known = self._taken = -inf
        self.lacks: str | None = None
        """What of `NEEDED` no pose has had, or an empty text; None: no pose has come."""

    def add(self, poses: Sequence[tuple[float, Sample]]) -> None:
        """Poses that came, with their times, s. One that tells no motion is passed over: the last one grows old."""
        telling = [each for each in poses if isfinite(sum(each[1].position or NO_PLACE, each[1].device))]
        for each in telling:
            if not 0.0 <= each[1].device - self._taken < CLOSEST:
                self._taken = each[1].device
                self._waiting.append(each)
        if telling:
            self.lacks = ""
        elif poses and self.lacks is None:
            self.lacks = "time of their own" if isnan(poses[0][1].device) else "position"

    def doubt(self, t: float, now: float, longest: float) -> str:
        """Give the poses that tell the motion at `t` s, by their times, for a reading of `now`. Why it is not known
        then, or an empty text: poses tell nothing of each other, or of now, that are `longest` s apart, or old.
        """
        while self._waiting and self._known < t and self._waiting[0][0] <= now:
            self._give(*self._waiting.popleft(), longest)
        if self.lacks != "" or self._known >= t:
            return ""
        if self._known == -inf:
            return f"stale: the motion is not known yet, {ENOUGH} poses in a row tell it"
        age = now - self._newest
        return f"stale: the position is {age:.2f} s old" if age > longest + CLOSEST else ""

    def _give(self, t: float, pose: Sample, longest: float) -> None:
        """By the robot's own clock: the line that its times lie on moves as more of them are known, and by arrivals a
        network's jitter would count; 0.1 ms between poses of 2 ms is 25 m/s^2 at 1 m/s.
        """
        passed = pose.device - self._device
        in_a_row = 0.0 < passed <= longest and t - self._newest <= longest
        self._in_a_row = self._in_a_row + 1 if in_a_row else 1
        self._known = self._newest if self._in_a_row >= ENOUGH else -inf
        self._newest, self._device = t, pose.device
        turn, place = np.array(pose.orientation), np.array(pose.position)
        self._compensator.pose(turn, place, t + self._delay, passed if in_a_row else inf)
