"""Poses take themselves while arm and reading stand, and a pose that somebody touches is refused by name.

A hand that holds still can hardly be told from a tool that weighs more. What gives it away: the reading moves while it
is there; it jumps when the hand lets go, while the arm still stands; and from the fifth pose on the others predict it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..calibration.calibration import Calibration
from ..geometry.arrays import Array, Frozen
from ..geometry.orientation import from_quat_xyzw
from ..geometry.quaternions import angle_between
from ..samples.creep import change_within
from ..samples.samples import Samples
from ..statistics import two_digits
from .history import History, Stand
from .source import Four

SETTLED, HOLD = 0.3, 1.0
"""s that everything stands before readings count, and s of readings in a pose."""
APART = np.deg2rad(8.0)
"""rad from every pose that was taken: one beside another tells nothing new."""
CREEPS, PATIENCE = 2.5, 8.0
"""Of the quiet std of a mean over a twentieth of a second: what one half of the readings is off the other while they
still creep after a move; waited for, but for no more s than that.
"""
JUMPED = 6.0
"""Of the quiet std of a mean over a twentieth of a second: what the reading changes by when a hand lets go. Creep goes
on without a moment in which the reading moves, and is none."""
FROM_OTHERS = 5.0
"""Standard deviations of what the other poses predict, and `GAIN` of the tool's weight: sensors are not better."""
GAIN = 0.02


@dataclass(frozen=True, eq=False)
class Taken(Frozen):
    """A pose: times (n,), readings (n, 6) as the device gives them, orientations (n, 4), and `doubt` of it; the arm had
    `stood` for so many s when it was taken.
    """

    t: Array
    wrench: Array
    orientation: Array
    doubt: str = ""
    stood: float = SETTLED + HOLD

    @property
    def mean(self) -> Array:
        """The mean reading (6,)."""
        return np.asarray(self.wrench.mean(axis=0))

    @property
    def turn(self) -> Four:
        """Its orientation."""
        x, y, z, w = self.orientation[-1].tolist()
        return (x, y, z, w)


class PoseTaking:
    """The poses so far, none of them near those of `others`."""

    def __init__(self, others: tuple[Taken, ...] = ()) -> None:
        self.taken: tuple[Taken, ...] = ()
        self._others = others
        self.progress, self.waiting = 0.0, ""
        self._refused: Four | None = None
        self._watched = False
        self._moved = False
        self._level = np.zeros(6)

    def look(
        self,
        history: History,
        stand: Stand,
        quiet: Array | None,
        calibration: Calibration | None,
        sign: float,
        t: float,
    ) -> tuple[str, str]:
        """Look at arm and reading at `t` s. What happened, as the kind of an event and in words; nothing: two empty
        texts. `calibration`: from the poses so far, for readings times `sign`.
        """
        times, wrench, orientation = history.last(HOLD)
        under_way, self.progress = self.progress > 0.0, 0.0
        if not len(times) or not np.isfinite(orientation).all():
            self.waiting = stand.moves or "the robot's orientation was missing for a moment"
            return "", ""
        x, y, z, w = orientation[-1].tolist()
        here: Four = (x, y, z, w)
        if self.taken and angle_between(here, self.taken[-1].turn) < 0.5 * APART:
            return self._stays(stand, wrench, quiet)
        self._watched, self._moved = False, False
        if self._refused is not None and angle_between(here, self._refused) > 0.5 * APART:
            self._refused = None
        if near := self._near(here):
            self.waiting = f"this is {near} again: turn on"
        elif not stand.still:
            self._refused, self.waiting = None if not stand.arm else self._refused, stand.moves
            if under_way and not stand.arm:
                return "pose_refused", f"pose {len(self.taken) + 1}, under way: {stand.moves}; it begins anew"
        elif (stood := t - stand.since) < SETTLED + HOLD:
            self.progress, self.waiting = stood / (SETTLED + HOLD), "hold still"
        elif self._refused is None:
            if _creeps(wrench, quiet) and stood < PATIENCE:
                self.progress, self.waiting = 1.0, "the reading still creeps after the move: wait"
            else:
                return self._take(Taken(times, wrench, orientation, stood=stood), calibration, sign)
        return "", ""

    def _near(self, here: Four) -> str:
        """The pose that lies too near, if any, in words."""
        for k, pose in enumerate((*self.taken, *self._others), start=1):
            if angle_between(here, pose.turn) < APART:
                return f"pose {k}" if k <= len(self.taken) else "a pose of the calibration"
        return ""

    def _stays(self, stand: Stand, wrench: Array, quiet: Array | None) -> tuple[str, str]:
        """After a pose was taken: whether somebody lets go of the tool while the arm still stands."""
        self.waiting = "taken: turn to the next pose"
        if stand.arm and not stand.still:
            self._watched = False
            return "", ""
        level = wrench[-len(wrench) // 2 :].mean(axis=0)
        if not stand.still:
            self._moved = self._watched
        elif self._watched and self._moved and quiet is not None:
            self._moved, change = False, level - self._level
            if (np.abs(change) > JUMPED * quiet).any():
                number, by = len(self.taken), float(np.linalg.norm(change[:3]))
                self.taken, self._watched = self.taken[:-1], False
                return "pose_refused", (
                    f"pose {number}: the reading changed by {by:.2g} N while the arm stood, expected a tool that "
                    "nobody touches: it is taken again"
                )
        else:
            self._watched = True
        self._level = level if stand.still else self._level
        return "", ""

    def _take(self, pose: Taken, calibration: Calibration | None, sign: float) -> tuple[str, str]:
        number = len(self.taken) + 1
        if calibration is not None and (by := _beside_prediction(calibration, pose, sign)):
            self._refused = pose.turn
            self.waiting = f"pose {number} reads {by} more than the other poses predict: let go of the tool"
            return "pose_refused", (
                f"pose {number}: reads {by} off what the other poses predict, expected a free tool: let go, or, "
                "if nobody touches it, take it all the same: the sensor may have drifted"
            )
        return self._add(pose)

    def take_anyway(self, history: History, now: float) -> tuple[str, str]:
        """Take the pose where the arm is `now`, s, whatever there is against it."""
        times, wrench, orientation = history.last(HOLD, now)
        if len(times) < 2 or not np.isfinite(orientation).all():
            return "refusal", "no pose: readings or orientations are missing; wait until both come"
        return self._add(
            Taken(times, wrench, orientation, "taken by hand: the reading moved, or others predict another")
        )

    def _add(self, pose: Taken) -> tuple[str, str]:
        self.taken, self._watched, self._moved, self._refused = (*self.taken, pose), True, False, None
        self._level = pose.mean
        return "pose", f"pose {len(self.taken)} taken"

    def drop(self, number: int) -> bool:
        """Forget pose `number`, from 1; whether there was one."""
        if not 1 <= number <= len(self.taken):
            return False
        self.taken = self.taken[: number - 1] + self.taken[number:]
        return True

    def doubt(self, reasons: dict[int, str]) -> None:
        """What the fit has against poses, by their number from 0."""
        self.taken = tuple(replace(pose, doubt=reasons.get(k, "")) for k, pose in enumerate(self.taken))


def _creeps(wrench: Array, quiet: Array | None) -> bool:
    """Whether readings (n, 6) over `HOLD` still change by more than noise."""
    return quiet is not None and bool((np.abs(change_within(wrench)) > CREEPS * quiet).any())


def samples_of(poses: tuple[Taken, ...], sign: float, source: str) -> Samples:
    """All rows of poses, readings times `sign`."""
    orientation = np.concatenate([pose.orientation for pose in poses])
    return Samples(
        sign * np.concatenate([pose.wrench for pose in poses]),
        from_quat_xyzw(orientation),
        np.concatenate([pose.t for pose in poses]),
        source=source,
        read_as={} if sign > 0.0 else {"sign": "reaction"},
        came=np.concatenate([np.full(len(pose.t), pose.t[-1] - pose.stood) for pose in poses]),
    )


def _beside_prediction(calibration: Calibration, pose: Taken, sign: float) -> str:
    """By how much, in words, a pose lies beside what the calibration predicts; empty: it does not."""
    left = calibration.compensate(sign * pose.mean, np.array(pose.turn))
    std = np.hypot(calibration.wrench_std(np.array(pose.turn)), calibration.noise)
    weight = calibration.weight or float(np.linalg.norm(calibration.B[:3, :3], 2))
    limit = FROM_OTHERS * std + GAIN * weight * np.r_[1.0, 1.0, 1.0, 0.1, 0.1, 0.1]
    if not (np.abs(left) > limit).any():
        return ""
    force, torque = float(np.linalg.norm(left[:3])), float(np.linalg.norm(left[3:]))
    return f"{force:.2g} N" if (np.abs(left[:3]) > limit[:3]).any() else f"{two_digits(1e3 * torque)} mN m"
