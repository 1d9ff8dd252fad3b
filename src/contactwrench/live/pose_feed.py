"""Robot poses on their way to a Compensator that knows the tool's inertia, each before the readings that need it."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from math import inf, isfinite, isnan, nan

import numpy as np

from ..compensate.compensator import Compensator
from .pose_track import KEPT, NO_PLACE
from .source import Sample

ENOUGH = 3
"""Poses in a row: from so many the one in the middle has an acceleration."""
CLOSEST = 0.0035
"""s between poses, by the robot's clock: what their noise makes of an acceleration falls with the square of it. On the
rig, poses at 500 Hz over a network that is late by up to 5 ms, 2 ms leave 1.8 N of 0.01 mm and 0.001 deg of noise, 4 ms
0.42 N, 8 ms 0.22 N; without noise 0.04, 0.06 and 0.16 N.
"""
NEEDED = {"position": "x, y, z too", "time of their own": "t too, by its own clock"}
"""Of poses that tell a motion, and what a robot without it is to send."""


class PoseFeed:
    """The poses of one robot.

    They are given as they came, and not as the track interpolates them for readings: between poses that is a straight
    line, and all acceleration would be at its ends. None is given to a reading of before it, though both came together:
    the noise of accelerations is fast, and a low-pass takes it out only where each of them lasts equally long.

    Args:
        compensator: that takes them.
        delay: s by which the wrench is stamped later than the pose that goes with it.
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
        """Give the poses that tell the motion at a moment; why it is not known then, or an empty text.

        Args:
            t: s, by the poses' times.
            now: s, of the reading.
            longest: s between poses, and of their age, beyond which they tell nothing of each other, or of now.
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
