"""From poses, pushes and the motion between them to a calibration: the way to understand the readings that all agree
with.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..calibration.calibration import Calibration
from ..calibration.findings import Finding, Kind, Severity
from ..calibration.text import parameter_rows
from ..compensate.inertia import SLOWEST_POSES
from ..errors import ContactWrenchError
from ..estimation.calibrate import DOWN, calibrate
from ..estimation.in_motion import with_motion
from ..geometry.arrays import Frozen
from ..samples.delay import estimate_delay, is_significant
from ..samples.samples import Streams
from ..samples.synchronize import synchronize
from .pose_taking import Taken, samples_of
from .push_test import Push, as_tested, contradiction
from .snapshot import Fit, Parameter

FEWEST_POSES = 6
NOT_TESTED = (
    "the sign of the readings was not tested: without a push a sensor of the other sign on a robot that hangs reads "
    "the same; do the push test, or state --sign"
)
OTHER_SIDE = (
    "by the pushes the robot {base}, which is not what was stated or usual: if it is not so, a push went the other "
    "way; push again, or state --gravity {towards}"
)
SIGNS = {"pull": 1.0, "reaction": -1.0}
MOST_ROWS = 45_000
"""Of a motion, that are looked at: of three minutes 250 a second, which tell what 1,000 do in a quarter of the time. So
many need no other compiled step (`FUSED_FROM`), which would be loaded beside the stream.
"""


@dataclass(frozen=True, eq=False)
class Fitted(Frozen):
    """A calibration for readings times `sign`, or why there is none; what `settled` the sign, in words."""

    calibration: Calibration | None
    sign: float
    refusal: str = ""
    settled: str = ""

    @property
    def reasons(self) -> list[str]:
        """The findings that make the verdict, in words; none where that is good."""
        found = () if self.calibration is None else self.calibration.findings
        return [each.text for each in found if each.severity in (Severity.DOUBTFUL, Severity.WEAK)]


@dataclass(frozen=True)
class Stated:
    """What a person stated: `sign` pull or reaction, None: not known; `gravity` (3,) in base axes."""

    sign: str | None = None
    gravity: tuple[float, float, float] = DOWN


def fitted(poses: tuple[Taken, ...], pushes: tuple[Push, ...], stated: Stated, source: str) -> Fitted:
    """The one way to understand the readings that poses and pushes agree with, and the calibration of it.

    Pull or reaction, gravity as stated or against it: free air is the same for two of the four. Without pushes the
    first that the poses do not refuse is taken, and a finding of the calibration says that its sign is not confirmed.
    """
    refusals: list[str] = []
    against: list[str] = []
    other_side = tuple(-part + 0.0 for part in stated.gravity)
    for gravity in (stated.gravity, other_side):
        for name in (stated.sign,) if stated.sign else SIGNS:
            sign = SIGNS[name]
            try:
                calibration = calibrate(samples_of(poses, sign, source), gravity=gravity)
            except ContactWrenchError as error:
                refusals.append(str(error))
                continue
            if not pushes:
                doubt = Finding.doubtful(Kind.SIGN_NOT_CONFIRMED, NOT_TESTED)
                untested = calibration if stated.sign else _with(calibration, doubt)
                return Fitted(untested, sign, settled=f"{name}, as assumed: no push was felt")
            if wrong := contradiction(calibration, pushes, sign):
                against.append(wrong)
                continue
            upright = float(np.dot(calibration.gravity_direction, (0.0, 0.0, -1.0)))
            base = "stands" if upright > 0.7 else "hangs" if upright < -0.7 else "is on a wall"
            settled = f"settled by the pushes: the sensor reads the {name}, and the robot {base}"
            tested = as_tested(calibration, pushes, sign)
            if gravity == other_side:
                towards = ",".join(f"{part:g}" for part in other_side)
                told = OTHER_SIDE.format(base=base, towards=towards)
                tested = _with(tested, Finding.doubtful(Kind.SIGN_NOT_CONFIRMED, told))
            return Fitted(tested, sign, settled=settled)
    if against:
        return Fitted(None, 1.0, f"{against[0]}: push again as asked, or check the robot's pose and frames")
    return Fitted(None, 1.0, refusals[0])


def _with(calibration: Calibration, finding: Finding) -> Calibration:
    return replace(calibration, findings=(*calibration.findings, finding))


def with_check(calibration: Calibration, passed: bool, reason: str) -> Calibration:
    """The calibration, doubtful where it failed on new poses."""
    told = f"the check on new poses failed: {reason}"
    return calibration if passed else _with(calibration, Finding.doubtful(Kind.FAILED_CHECK, told))


def with_delay(calibration: Calibration, streams: Streams | None) -> Calibration:
    """The calibration with the delay of its recording's wrench behind the orientation, where the motion tells it."""
    if streams is None or len(streams.wrench) == 0 or len(streams.orientation) == 0:
        return calibration
    try:
        delay = estimate_delay(streams, calibration.gravity_direction)
    except ContactWrenchError:
        return calibration
    told = bool(np.isfinite(delay.std))
    return replace(calibration, delay=delay.value, delay_std=delay.std) if told else calibration


def with_inertia(calibration: Calibration, streams: Streams | None) -> Calibration:
    """The calibration with the inertia that the motion tells, where the robot's poses have positions and nothing of it
    is in doubt: a tool that was led by hand, or positions that are not those of this arm, are no way to tell it. Else
    it says why there is none.
    """
    if streams is None or len(streams.orientation) < 2:
        return calibration
    if streams.orientation.position is None:
        return _without_inertia(calibration, "the robot's poses have no positions")
    if np.median(np.diff(streams.orientation.t)) > SLOWEST_POSES:  # in the run they would tell no motion
        return _without_inertia(calibration, f"poses came less than {1.0 / SLOWEST_POSES:.0f} times a second")
    readings = streams.wrench.select(slice(None, None, 1 + len(streams.wrench) // MOST_ROWS))
    applied = is_significant(calibration.delay or 0.0, calibration.delay_std or np.inf)
    late = (calibration.delay, calibration.delay_std) if applied else (0.0, None)
    try:
        paired = synchronize(replace(streams, wrench=readings), late[0] or 0.0, late[1], at_their_pace=True)
        moved = with_motion(calibration, paired.samples, None)
    except ContactWrenchError as error:
        return _without_inertia(calibration, str(error).removeprefix(f"{readings.source}: "))
    new = moved.findings[len(calibration.findings) :]
    doubt = next((finding for finding in new if finding.severity is not Severity.NOTE), None)
    return moved if doubt is None else _without_inertia(calibration, doubt.said)


def _without_inertia(calibration: Calibration, why: str) -> Calibration:
    """The calibration, with a word on what its tool does while the arm accelerates."""
    text = f"the tool's inertia is not known, and reads as contact while the arm accelerates: {why}"
    return _with(calibration, Finding(Kind.UNTOLD_BY_MOTION, Severity.NOTE, text))


def doubts_of(calibration: Calibration, poses: tuple[Taken, ...]) -> dict[int, str]:
    """What the calibration has against poses, by number from 0."""
    against: dict[int, str] = {}
    for pose in calibration.poses:
        if pose.rejected is not None and pose.t_start is not None:
            for k, taken in enumerate(poses):
                if taken.t[0] - 1e-6 <= pose.t_start <= taken.t[-1]:
                    against[k] = pose.rejected
    return against


def shown(result: Fitted) -> Fit:
    """For a person."""
    c = result.calibration
    if c is None:
        return Fit("", result.refusal, (), None, None, "", "", ())
    parameters = tuple(Parameter(*row) for row in parameter_rows(c))
    findings = tuple((finding.severity.value, finding.text) for finding in c.findings)
    return Fit(c.verdict, "", parameters, *c.expected_error, result.settled, _delay_in_words(c), findings)


def _delay_in_words(c: Calibration) -> str:
    if c.delay is None or c.delay_std is None:
        return "not told by the motion so far: none is applied"
    late, applied = "wrench" if c.delay >= 0.0 else "orientation", is_significant(c.delay, c.delay_std)
    return f"{late} {1e3 * abs(c.delay):.1f} +- {1e3 * c.delay_std:.1f} ms late, {'' if applied else 'not '}applied"


def force_std(calibration: Calibration | None) -> tuple[float | None, float | None]:
    """The std of the contact force, N, and torque, N m, from the calibration's poses, at the worst orientation."""
    return (None, None) if calibration is None else calibration.largest_std
