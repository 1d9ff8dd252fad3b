"""How the arm moves, for a tool whose inertia is known: its poses to the compensator, and what they lack for that."""

from __future__ import annotations

from math import inf

from contactwrench.calibration.dynamics import Dynamics
from contactwrench.compensate.compensator import Compensator
from contactwrench.compensate.faults import Reason
from contactwrench.live.pose_track import NEEDED, PoseFeed, PoseTrack
from contactwrench.live.running import NOT_SUBTRACTED, OF_ACCELEROMETER
from contactwrench.live.source import Sample

from .track import Pose

STALE = "stale motion"
SLOWEST = 80.0
"""Hz, of poses that tell accelerations: on the rig those at 250 Hz leave 0.05 to 0.07 N of 3.2 to 4.9, at 100 Hz 0.2 to
0.3, at 50 Hz 0.6 to 0.7, and at 20 Hz, as robot_state_publisher sends them unless told otherwise, half of it.
"""
TOO_SLOW = (
    "poses come at {:.0f} Hz, expected {:.0f} Hz or more: part of the tool's inertia reads as contact while the arm "
    "accelerates; let the robot send them faster, robot_state_publisher by its parameter publish_frequency"
)


class Motion:
    """Of one arm, for a compensator whose calibration knows the tool's inertia, by `dynamics`."""

    def __init__(self, compensator: Compensator, dynamics: Dynamics) -> None:
        self._compensator, self._of_positions = compensator, dynamics.accelerometer is None
        self._begin()

    def _begin(self) -> None:
        self._newest, self._track = -inf, PoseTrack()
        self._feed = PoseFeed(self._compensator, 0.0)  # the compensator itself looks back by the delay

    def hear(self, pose: Pose) -> None:
        """Take a pose. One that is older than the last is the first by a clock that began anew."""
        if pose.t < self._newest:
            self._begin()
        self._newest = pose.t
        if self._of_positions:
            self._feed.add([(pose.t, Sample(pose.t, pose.t, None, pose.quat_xyzw, pose.place))])
        if pose.place is not None:
            self._track.add(*pose)

    def doubt(self, t: float, stale_after: float) -> Reason | None:
        """Why the motion at a reading, of `t` s, is not known; None: it is, or is never told, and the arm counts as
        standing still. Positions are old as in a live session, and where an orientation is: after `stale_after` s.
        """
        longest = min(stale_after, self._track.stale_after)
        why = self._feed.doubt(t - self._compensator.delay, t, longest)
        return Reason(why.replace("stale", "motion", 1), STALE) if why else None

    @property
    def lacking(self) -> str:
        """Why inertia is not subtracted, or not as it should be, in one line; empty: it is, or no pose has come."""
        if not self._of_positions:
            return OF_ACCELEROMETER
        if lacks := self._feed.lacks:
            return NOT_SUBTRACTED.format(lacks, NEEDED[lacks])
        period = self._track.period
        return TOO_SLOW.format(1.0 / period, SLOWEST) if period * SLOWEST > 1.0 else ""

    @property
    def subtracted(self) -> str:
        """Whether inertia is, in a word or two."""
        return {None: "not yet", "": "yes"}.get(self._feed.lacks, "no") if self._of_positions else "no"
