"""An estimate from a recording as it is: poses that the others do not explain left out, a bias that moved followed.

Most recordings are clean, and that is seen at a glance from the leverages of the ordinary fit; those that are not are
linearised at it, judged there (outliers.py, bias_drift.py), fitted again, and so on until the same poses stay.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..calibration.fields import Finding, Kind, Severity
from ..geometry.arrays import Array
from ..model import affine_jacobian, free_wrench, gravity_in_flange, matrix_jacobian, wrench_jacobian
from ..samples.poses import Pose
from ..samples.recorded_poses import RecordedPoses
from ..statistics import two_digits
from .bias_drift import FALSE_ALARM, FEWEST_POSES, BiasDrift, chance_of_steady, in_words, likeliest_drift
from .estimate import Estimate, checked, fitted
from .least_squares import LEAST_LEFT, Fit
from .noise import GROUPS, PoseReadings
from .outliers import SURELY_CLEAN, LinearReadings, deleted_distances
from .priors import Question, rows_of

ROUNDS = 5
ROUNDING = 1e-7
AT_A_GLANCE = 3.0
"""Times the probability of a false alarm: what looks less clean than this is looked at closely."""

POOR_SHARE = 0.10
"""Of the weight: where more is left in a pose than this, something is wrong."""

MENDED = 0.3
"""Of what was left before: leaving poses out that leaves less has found what was wrong."""

MOST_JUDGED = 2_000
"""Poses: of more, rows taken on the way most often, none is left out. Looking at each would take minutes."""

MOST_NAMED = 6
MOST_SEGMENTS_NAMED = 3
MOST_MOVED = 1.0 / 3.0
"""Of the segments in which the arm stood: where the reading moves in more of them, the recording is in doubt."""

ROBUST_MODELS = ("auto", "yaw", "mount", "mount+base")


@dataclass(frozen=True, eq=False)
class RobustEstimate:
    """The estimate from the `readings` that were kept of those `as_recorded`, the drift of the bias taken out of them;
    `reasons` (n,) why each pose was left out, None where it was kept; `bias_drift` over all poses.
    """

    estimate: Estimate
    readings: PoseReadings
    as_recorded: PoseReadings
    reasons: tuple[str | None, ...]
    bias_drift: BiasDrift | None


def robust_estimate(readings: PoseReadings, time: Array, question: Question) -> RobustEstimate:
    """Fit, leave out what does not fit, and fit again; `time` (n,) s, or the count of poses where none is known.

    The paper's estimator and `affine` take the readings as they are. Nothing is checked yet: what the poses cannot
    separate comes as it is (see `confirmed`).
    """
    estimate, drift, kept = fitted(readings, question), None, readings
    if (
        question.model in ROBUST_MODELS
        and len(readings) <= MOST_JUDGED
        and not _clean_at_a_glance(estimate, readings, time, question)
    ):
        estimate, drift, kept = _without_outliers(estimate, readings, time, question)
    return RobustEstimate(estimate, kept, readings, _reasons(estimate.fit, readings, drift), drift)


def confirmed(robust: RobustEstimate, question: Question) -> RobustEstimate:
    """The estimate, checked, its covariance enlarged by what is unknown of the bias' drift. Raises as `checked`."""
    estimate, drift = checked(robust.estimate, robust.readings, robust.as_recorded, question), robust.bias_drift
    if drift is not None and drift.parameters > 0.0:
        estimate = replace(estimate, fit=_with_drift(estimate.fit, estimate.names, drift))
    return replace(robust, estimate=estimate)


def _without_outliers(
    as_it_is: Estimate, readings: PoseReadings, time: Array, question: Question
) -> tuple[Estimate, BiasDrift | None, PoseReadings]:
    """The estimate once outliers and drift are out of the readings; as it is where that does not settle, or does not
    mend a poor fit: what is wrong then is not a pose or two, but how the readings are understood.
    """
    estimate, drift = as_it_is, None
    for _ in range(ROUNDS):
        before = drift
        unit = noise_of_groups(estimate.fit) if before is None else estimate.fit.noise
        r = gravity_in_flange(readings.R_base_flange, estimate.fit.gravity_direction)
        wide = affine_jacobian(r) / unit[:, None]
        drift = likeliest_drift(_linear_readings(estimate, readings, unit), wide, unit, time)
        kept = replace(readings, wrench=readings.wrench - drift.change).select(~drift.outlying)
        estimate = fitted(kept, question)
        if before is not None and _same(before, drift):
            left, left_before = force_left(estimate.fit), force_left(as_it_is.fit)
            if left > POOR_SHARE * weight_of(estimate.fit) and left > MENDED * left_before:
                break
            return estimate, drift, kept
    return as_it_is, None, readings


def _clean_at_a_glance(estimate: Estimate, readings: PoseReadings, time: Array, question: Question) -> bool:
    """Whether neither a pose nor the order in time stands out of the ordinary fit.

    What rounding leaves of perfect readings has no distribution to stand out of, nor has what a fit leaves that reaches
    every force, or every torque.
    """
    fit, n = estimate.fit, len(time)
    linear = fit.linear
    if linear is None or linear.s[-1] == 0.0 or fit.readings_left < LEAST_LEFT or linear.chi2_of_readings == 0.0:
        return True
    if question.noise is None and not linear.tells_noise:
        return True
    if float(np.abs(fit.residuals).max()) <= ROUNDING * float(np.abs(fit.B).max()):
        return True
    in_groups = _linear_readings(estimate, readings, noise_of_groups(fit))
    distance, limit = deleted_distances(in_groups, np.ones(n, dtype=bool))
    if float(distance.max()) > SURELY_CLEAN * limit:
        return False
    if n < FEWEST_POSES:
        return True
    r = gravity_in_flange(readings.R_base_flange, fit.gravity_direction)
    columns = np.concatenate([linear.U, linear.whitener @ affine_jacobian(r)], axis=2)
    return chance_of_steady(columns, linear.whitened, time) > AT_A_GLANCE * FALSE_ALARM


def noise_of_groups(fit: Fit) -> Array:
    """One noise (6,) for the forces and one for the torques: an axis of its own would hide its outliers."""
    noise = np.empty(6)
    for group in GROUPS:
        noise[group] = float(np.sqrt(np.mean(fit.noise[group] ** 2)))
    return noise


def _linear_readings(estimate: Estimate, readings: PoseReadings, unit: Array) -> LinearReadings:
    """The readings linearised at the estimate, in units (6,) of noise."""
    fit = estimate.fit
    known = rows_of(estimate.knowledge, fit.rigid_tool, estimate.names)
    return LinearReadings(
        J=wrench_jacobian(fit.rigid_tool, readings.R_base_flange, estimate.names) / unit[:, None],
        errors=_left_by(fit, readings) / unit,
        known=np.zeros((0, len(estimate.names))) if known is None else known.jacobian,
        known_errors=np.zeros(0) if known is None else known.residuals,
    )


def _left_by(fit: Fit, readings: PoseReadings) -> Array:
    """What a fit leaves in any readings, (n, 6), N and N m."""
    return readings.wrench - free_wrench(fit.B, gravity_in_flange(readings.R_base_flange, fit.gravity_direction))


def weight_of(fit: Fit) -> float:
    """The weight (N), of a model without one the mean singular value of its force matrix."""
    return float(np.mean(np.linalg.svd(fit.B[:3, :3], compute_uv=False)))


def force_left(fit: Fit) -> float:
    """RMS norm (N) of what is left of the force in a pose, degrees of freedom counted."""
    return float(np.sqrt(np.sum(fit.residuals[:, :3] ** 2) / max(fit.readings_left / 6.0, LEAST_LEFT)))


def _same(a: BiasDrift, b: BiasDrift) -> bool:
    return (a.kind, a.first_after) == (b.kind, b.first_after) and bool((a.outlying == b.outlying).all())


def _with_drift(fit: Fit, names: tuple[str, ...], drift: BiasDrift) -> Fit:
    """The fit with what the unknown drift of the bias adds to its covariance."""
    counted = fit.readings_left / max(fit.readings_left - drift.parameters, 1.0)
    covariance = counted * (fit.covariance + drift.covariance)
    from_parameters = matrix_jacobian(fit.rigid_tool, names)
    return replace(
        fit,
        covariance=covariance,
        B_covariance=from_parameters @ covariance @ from_parameters.T,
        noise=np.sqrt(counted) * fit.noise,
        dof=fit.dof / counted,
        readings_left=fit.readings_left / counted,
    )


def _reasons(fit: Fit, readings: PoseReadings, drift: BiasDrift | None) -> tuple[str | None, ...]:
    """Why each pose was left out, None where it was kept."""
    if drift is None:
        return (None,) * len(readings)
    errors = _left_by(fit, readings) - drift.change
    return tuple(_reason(error, fit.noise) if out else None for error, out in zip(errors, drift.outlying, strict=True))


def _reason(error: Array, noise: Array) -> str:
    force, torque = float(np.linalg.norm(error[:3])), float(np.linalg.norm(error[3:]))
    return (
        f"{two_digits(force)} N and {two_digits(1e3 * torque)} mN m off what the other poses explain, "
        f"{float(np.linalg.norm(error / noise)):.0f} std: in contact, bumped, or read before the arm was still"
    )


def segments_left_out(recorded: RecordedPoses, since: float) -> tuple[Finding, ...]:
    """That still segments of a stream are no pose; the longest with their reasons, times counted from `since` (s)."""
    rejected = recorded.rejected
    if not rejected:
        return ()
    longest = sorted(sorted(rejected, key=lambda pose: -pose.n)[:MOST_SEGMENTS_NAMED], key=_start)
    named = "; ".join(f"t = {_start(pose) - since:.6g} s, {pose.rejected}" for pose in longest)
    more = f"; {len(rejected) - len(longest)} more" if len(rejected) > len(longest) else ""
    stood = len(rejected) + recorded.segments
    text = f"{len(rejected)} of {stood} stretches in which the arm stood were left out: {named}{more}"
    if recorded.moved <= MOST_MOVED * stood:
        return (Finding(Kind.STILL_SEGMENTS_LEFT_OUT, Severity.REFUSED, text),)
    doubt = "do wrench and pose belong together in time, and was the tool let alone?"
    return (Finding.weak(Kind.STILL_SEGMENTS_LEFT_OUT, f"{text}; {doubt}"),)


def _start(pose: Pose) -> float:
    return 0.0 if pose.t_start is None else pose.t_start


def poses_left_out(robust: RobustEstimate, poses: tuple[Pose, ...], since: float) -> tuple[Finding, ...]:
    """That poses were left out, up to `MOST_NAMED` by name, and that the bias moved; times count from `since` (s)."""
    names = [_name(k, pose, since) for k, pose in enumerate(poses)]
    texts = [f"{names[k]} was left out: {reason}" for k, reason in enumerate(robust.reasons) if reason is not None]
    if len(texts) > MOST_NAMED:
        texts[MOST_NAMED:] = [f"{len(texts) - MOST_NAMED} more poses were left out for the same reason"]
    findings = tuple(Finding(Kind.POSE_LEFT_OUT, Severity.REFUSED, text) for text in texts)
    if robust.bias_drift is None or robust.bias_drift.kind is None:
        return findings
    text = in_words(robust.bias_drift, names, poses[0].t_start, poses[-1].t_end)
    return (*findings, Finding(robust.bias_drift.kind, Severity.WARNING, text))


def _name(k: int, pose: Pose, since: float) -> str:
    return f"pose {k + 1}" + ("" if pose.t_start is None else f" (t = {pose.t_start - since:.6g} s)")
