"""The way to a calibration, step by step: connect, push, poses, fit, verify; what a person may do at each.

Nothing here knows a device: it looks at the readings of the last seconds, ten times a second.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from ..assess.plan import plan
from ..assess.robot_arms import Reach
from ..assess.verify import verify
from ..calibration.calibration import Calibration
from ..errors import ContactWrenchError
from ..geometry.orientation import from_quat_xyzw, to_quat_xyzw
from ..geometry.quaternions import angle_between
from ..samples.samples import Streams
from .fitting import FEWEST_POSES, Fitted, Stated, doubts_of, fitted, force_std, with_check, with_delay, with_inertia
from .history import History, Stillness
from .pose_taking import PoseTaking, samples_of
from .push_test import PushTest
from .snapshot import Check, Command, Phase, Poses, TakenPose
from .source import Four

CHECKS = 2
FEWEST_TO_PREDICT = 5
FEWEST_TO_FIT = 4
"""Poses from which on a fit is tried for what it tells while poses are taken."""
SPOKEN = {
    Phase.CONNECT: "to the devices",
    Phase.PUSH: "to the push test",
    Phase.POSES: "to the poses",
    Phase.FIT: "to the fit",
    Phase.VERIFY: "to the check on new poses",
    Phase.RUN: "running",
}
Happened = tuple[str, str]
"""The kind of an event, and what happened in words."""


@dataclass(frozen=True)
class Wish:
    """What a person wants: `wanted` N, the std of the contact force at which poses are enough; how many `poses` are
    planned, within `reach` where the arm is known; what was `stated`; what goes into the calibration's provenance as
    its source.
    """

    wanted: float = 0.05
    poses: int = 12
    stated: Stated = field(default_factory=Stated)
    source: str = "live"
    reach: Reach | None = None


class Wizard:
    """Where a person is on the way; `streams` gives the motion so far, in which the delay is looked for."""

    def __init__(self, wish: Wish, streams: Callable[[], Streams | None]) -> None:
        self._wish, self._streams = wish, streams
        self.phase = Phase.CONNECT
        self.push, self.poses = PushTest(), PoseTaking()
        self._verifying = PoseTaking()
        self._targets: tuple[Four, ...] = ()
        self.fit: Fitted | None = None
        self._std_forces: dict[int, float | None] = {}
        self.checks: tuple[Check, ...] = ()
        self.verified = ""

    @property
    def calibration(self) -> Calibration | None:
        """Of the last fit."""
        return None if self.fit is None else self.fit.calibration

    @property
    def sign(self) -> float:
        """By which readings are multiplied, as far as is known."""
        return 1.0 if self.fit is None else self.fit.sign

    def commands(self, stillness: Stillness) -> tuple[Command, ...]:
        """What can be asked for now."""
        done = Command.NEXT
        match self.phase:
            case Phase.CONNECT:
                return (done,) if stillness.noise is not None and stillness.orientation is not None else ()
            case Phase.PUSH:
                return (*((done,) if self.push.done else ()), Command.SKIP, Command.RETAKE, Command.BACK)
            case Phase.POSES:
                enough = len(self.poses.taken) >= FEWEST_POSES
                retake = (Command.RETAKE,) if self.poses.taken else ()
                return (*((done,) if enough else ()), Command.CAPTURE, *retake, Command.BACK)
            case Phase.FIT:
                return (*((done,) if self.calibration else ()), Command.BACK)
            case Phase.VERIFY:
                return (done, Command.BACK) if self.verified else (Command.SKIP, Command.CAPTURE, Command.BACK)
        return (Command.BACK,)

    def do(self, command: Command, number: int | None, history: History, t: float) -> list[Happened]:
        """What a person asked for at `t` s, which `commands` allows."""
        if command in (Command.NEXT, Command.SKIP):
            return self._next(skip=command is Command.SKIP)
        if command is Command.BACK:
            return self._back()
        if command is Command.RETAKE and self.phase is Phase.PUSH and number is None:
            self.push.again()
            return [("push", "the push test begins anew")]
        if command is Command.RETAKE:
            return self._retake(len(self.poses.taken) if number is None else number)
        taking = self.poses if self.phase is Phase.POSES else self._verifying
        return self._taken(*taking.take_anyway(history, t))

    def look(self, history: History, stillness: Stillness, t: float) -> list[Happened]:
        """Look at the newest readings at `t` s: what happened."""
        if self.phase is Phase.PUSH:
            said = self.push.look(history, stillness.now, t)
            return [("push", said)] if said else []
        if self.phase is Phase.POSES:
            known = self.calibration if len(self.poses.taken) >= FEWEST_TO_PREDICT else None
            return self._taken(*self.poses.look(history, stillness.now, stillness.quiet, known, self.sign, t))
        if self.phase is Phase.VERIFY and not self.verified:
            return self._taken(*self._verifying.look(history, stillness.now, stillness.quiet, None, self.sign, t))
        return []

    def _next(self, *, skip: bool) -> list[Happened]:
        phases = list(Phase)
        self.phase = phases[phases.index(self.phase) + 1]
        said: list[Happened] = [("phase", SPOKEN[self.phase])]
        match self.phase:
            case Phase.POSES:
                if skip:
                    self.push.again()
                self._plan()
            case Phase.FIT:
                said += self._fit(with_motion=True)
            case Phase.VERIFY:
                self._verifying, self.checks, self.verified = PoseTaking(self.poses.taken), (), ""
                self._targets = self._planned(CHECKS, [pose.turn for pose in self.poses.taken])
        return said

    def _back(self) -> list[Happened]:
        before = {Phase.PUSH: Phase.CONNECT, Phase.POSES: Phase.PUSH, Phase.VERIFY: Phase.FIT}
        self.phase = before.get(self.phase, Phase.POSES)
        if self.phase is Phase.POSES:
            self._plan()
        return [("phase", SPOKEN[self.phase])]

    def _retake(self, number: int) -> list[Happened]:
        if not self.poses.drop(number):
            return [("refusal", f"there is no pose {number}: name one of {len(self.poses.taken)}")]
        self._fit()
        self._plan()
        return [("pose", f"pose {number} is to be taken again")]

    def _taken(self, kind: str, text: str) -> list[Happened]:
        if not kind:
            return []
        if self.phase is Phase.POSES and kind in ("pose", "pose_refused"):
            self._fit()
            self._plan()
        elif self.phase is Phase.VERIFY and kind == "pose":
            return [(kind, text), *self._check()]
        return [(kind, text)]

    def _fit(self, *, with_motion: bool = False) -> list[Happened]:
        """Fit the poses so far; `with_motion`: for good, with what pushes and the motion between the poses tell."""
        taken = self.poses.taken
        if len(taken) < FEWEST_TO_FIT:
            self.fit = None
            return []
        pushes = self.push.pushes if with_motion else ()
        self.fit = fitted(taken, pushes, self._wish.stated, self._wish.source)
        self._std_forces[len(taken)] = force_std(self.calibration)[0]
        if self.calibration is None:
            return [("refusal", self.fit.refusal)] if with_motion else []
        self.poses.doubt(doubts_of(self.calibration, taken))
        if with_motion:
            streams = self._streams()
            whole = with_inertia(with_delay(self.calibration, streams), streams)
            self.fit = Fitted(whole, self.sign, "", self.fit.settled)
        told = [("finding", reason) for reason in self.fit.reasons]
        return [("fit", f"{len(taken)} poses: verdict {self.calibration.verdict}"), *told]

    def _check(self) -> list[Happened]:
        """Hold the newest pose of the verification against the calibration, and at the end all of them."""
        if self.calibration is None:
            return []
        poses = self._verifying.taken
        left = self.calibration.compensate(self.sign * poses[-1].mean, np.array(poses[-1].turn))
        result, one = (
            verify(self.calibration, samples_of(part, self.sign, "verification")) for part in (poses, poses[-1:])
        )
        check = Check(float(np.linalg.norm(left[:3])), float(np.linalg.norm(left[3:])), one.passed)
        self.checks = (*self.checks, check)
        self._targets = self._targets[1:]
        if len(self.checks) < CHECKS:
            return []
        self.verified = f"{'passed' if result.passed else 'failed'}: {result.reason}"
        checked = with_check(self.calibration, result.passed, result.reason)
        self.fit = replace(self.fit, calibration=checked) if self.fit is not None else None
        return [("verified", self.verified)]

    def _plan(self) -> None:
        taken = [pose.turn for pose in self.poses.taken]
        self._targets = self._planned(max(self._wish.poses - len(taken), 1), taken)

    def _planned(self, n: int, taken: list[Four]) -> tuple[Four, ...]:
        """The next `n` orientations, the one that tells most first."""
        try:
            chosen = plan(n, recorded=from_quat_xyzw(np.array(taken)) if taken else None, reach=self._wish.reach)
        except ContactWrenchError:
            return ()
        quaternions = to_quat_xyzw(chosen.R_base_flange).tolist()
        return tuple((x, y, z, w) for x, y, z, w in quaternions)

    def shown(self, here: Four | None) -> Poses | None:
        """The poses, for a person whose arm is turned `here`."""
        if self.phase not in (Phase.POSES, Phase.VERIFY):
            return None
        taking = self.poses if self.phase is Phase.POSES else self._verifying
        (force, torque), wanted, number = force_std(self.calibration), self._wish.wanted, len(self.poses.taken)
        turn = angle_between(here, self._targets[0]) if here is not None and self._targets else None
        return Poses(
            tuple(TakenPose(pose.turn, pose.doubt) for pose in taking.taken),
            *(self._targets, turn, taking.progress, taking.waiting, force, torque, wanted),
            enough=force is not None and force <= wanted and number >= FEWEST_POSES,
            history=tuple(self._std_forces.get(n) for n in range(1, number + 1)),
            fewest=FEWEST_POSES if self.phase is Phase.POSES else CHECKS,
        )
