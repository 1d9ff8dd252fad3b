"""What was done to a recording before it was fitted, in words: poses left out, a bias that moved."""

from __future__ import annotations

import numpy as np

from ..errors import two_digits
from ..geometry.arrays import Array
from ..samples.poses import Pose
from .bias_drift import Course
from .robust import RobustEstimate

MOST_NAMED = 6
MOST_STRETCHES_NAMED = 3
HOUR = 3600.0
MOST_MOVED = 1.0 / 3.0
"""Of the stretches in which the arm stood: where the reading moves in more of them, the recording is in doubt."""


def what_was_cleaned(found: RobustEstimate, poses: tuple[Pose, ...], since: float) -> tuple[str, ...]:
    """A warning for each pose left out, up to `MOST_NAMED`, and one for a bias that moved; times count from `since`."""
    left_out = [(k, reason) for k, reason in enumerate(found.reasons) if reason is not None]
    warnings = [f"{_name(poses, k, since)} was left out: {reason}" for k, reason in left_out[:MOST_NAMED]]
    if len(left_out) > MOST_NAMED:
        warnings.append(f"{len(left_out) - MOST_NAMED} more poses were left out for the same reason")
    if found.course is not None and found.course.kind != "steady":
        warnings.append(_moved(found.course, poses, since))
    return tuple(warnings)


def what_was_not_still(rejected: tuple[Pose, ...], accepted: int, since: float) -> tuple[str, ...]:
    """A warning of a stream's stretches that are no pose, beside those `accepted`; the longest with their reasons."""
    if not rejected:
        return ()
    longest = sorted(sorted(rejected, key=lambda pose: -pose.n)[:MOST_STRETCHES_NAMED], key=_start)
    named = "; ".join(f"t = {_start(pose) - since:.6g} s, {pose.rejected}" for pose in longest)
    more = f"; {len(rejected) - len(longest)} more" if len(rejected) > len(longest) else ""
    stood = len(rejected) + accepted
    moved = sum("the reading moves" in (pose.rejected or "") for pose in rejected)
    doubt = ""
    if moved > MOST_MOVED * stood:
        doubt = "; do wrench and pose belong together in time, and was the tool let alone?"
    weak = "weak: " if doubt else ""
    return (f"{weak}{len(rejected)} of {stood} stretches in which the arm stood were left out: {named}{more}{doubt}",)


def _start(pose: Pose) -> float:
    return 0.0 if pose.t_start is None else pose.t_start


def _moved(course: Course, poses: tuple[Pose, ...], since: float) -> str:
    if course.first_after is not None:
        before, after = (_name(poses, k, since) for k in (course.first_after - 1, course.first_after))
        return (
            f"the bias stepped by {_vector(-course.change[0])} between {before} and {after}: both sides share the "
            "tool, and the bias is that of the last pose; was the sensor zeroed there?"
        )
    first, last = poses[0].t_start, poses[-1].t_end
    timed = first is not None and last is not None and last > first
    span = (last - first) / HOUR if timed and first is not None and last is not None else float(len(poses) - 1)
    per = "an hour" if timed else "a pose"
    if course.kind == "drift":
        rate = -course.change[0] / span
        return (
            f"the bias drifted by {_vector(rate)} {per}, steadily: the bias is that of the last pose; let the sensor "
            "warm up before the next calibration"
        )
    steps = np.diff(course.change, axis=0)
    strength = np.sqrt(np.sum(steps**2, axis=0) / span)
    furthest = float(np.linalg.norm(course.change[:, :3], axis=1).max())
    return (
        f"the bias wandered by up to {furthest:.2g} N, as a random walk of {_vector(strength)} per root of {per}: the "
        "bias is that of the last pose; let the sensor warm up before the next calibration"
    )


def _name(poses: tuple[Pose, ...], k: int, since: float) -> str:
    t = poses[k].t_start
    return f"pose {k + 1}" + ("" if t is None else f" (t = {t - since:.6g} s)")


def _vector(wrench: Array) -> str:
    force, torque = (", ".join(two_digits(value) for value in part) for part in (wrench[:3], 1e3 * wrench[3:]))
    return f"({force}) N and ({torque}) mN m"
