"""An estimate from a recording as it is: poses that the others do not explain left out, a bias that moved followed.

Most recordings are clean, and that is seen at a glance from the leverages of the ordinary fit; those that are not are
linearised at it, cleaned there (outliers.py, course.py), fitted again, and so on until the same poses stay.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..errors import two_digits
from ..geometry.arrays import Array
from ..model import affine_jacobian, free_wrench, gravity_in_flange, matrix_jacobian, wrench_jacobian
from .bias_drift import FALSE_ALARM, FEWEST_POSES, Course, chance_of_steady, course_of_bias
from .estimate import Estimate, Question, checked, fitted
from .least_squares import LEAST_LEFT, Fit, PoseReadings
from .noise import GROUPS
from .outliers import SURELY_CLEAN, LinearReadings, deleted_distances
from .priors import rows_of

ROUNDS = 5
ROUNDING = 1e-7
AT_A_GLANCE = 3.0
"""Times the probability of a false alarm: what looks less clean than this is looked at closely."""

POOR_SHARE = 0.10
"""Of the weight: where more is left in a pose than this, something is wrong."""

MENDED = 0.3
"""Of what was left before: cleaning that leaves less has found what was wrong."""

MOST_CLEANED = 2_000
"""Poses: of more, rows taken on the way most often, none is left out. Looking at each would take minutes."""

ROBUST_MODELS = ("auto", "yaw", "mount", "mount+base")


@dataclass(frozen=True, eq=False)
class RobustEstimate:
    """The estimate from the `readings` that were kept of those `as_recorded`, the bias' course taken out of them;
    `reasons` (n,) why each pose was left out, None where it was kept; `course` of the bias over all poses.
    """

    found: Estimate
    readings: PoseReadings
    as_recorded: PoseReadings
    reasons: tuple[str | None, ...]
    course: Course | None


def cleaned_estimate(readings: PoseReadings, time: Array, question: Question) -> RobustEstimate:
    """Fit, clean and fit again; `time` (n,) s, or the count of poses where none is known.

    The paper's estimator and `affine` take the readings as they are. Nothing is checked yet: what the poses cannot
    separate comes as it is (see `confirmed`).
    """
    found, course, clean = fitted(readings, question), None, readings
    if (
        question.model in ROBUST_MODELS
        and len(readings) <= MOST_CLEANED
        and not _clean_at_a_glance(found, readings, time)
    ):
        found, course, clean = _cleaned(found, readings, time, question)
    kept = np.ones(len(readings), dtype=bool) if course is None else ~course.outlying
    return RobustEstimate(found, clean, readings, _reasons(found.fit, readings, kept, course), course)


def confirmed(cleaned: RobustEstimate, question: Question) -> RobustEstimate:
    """The estimate, checked, its covariance enlarged by what is unknown of the bias' course. Raises as `checked`."""
    found, course = checked(cleaned.found, cleaned.readings, cleaned.as_recorded, question), cleaned.course
    if course is not None and course.parameters > 0.0:
        found = replace(found, fit=_with_course(found.fit, found.names, course))
    return replace(cleaned, found=found)


def _cleaned(
    as_it_is: Estimate, readings: PoseReadings, time: Array, question: Question
) -> tuple[Estimate, Course | None, PoseReadings]:
    """The estimate once the readings were cleaned; as it is where that does not settle, or does not mend a poor fit:
    what is wrong then is not a pose or two, but how the readings are understood.
    """
    found, course = as_it_is, None
    for _ in range(ROUNDS):
        before = course
        unit = noise_of_groups(found.fit) if before is None else found.fit.noise
        r = gravity_in_flange(readings.R_base_flange, found.fit.gravity_direction)
        wide = affine_jacobian(r) / unit[:, None]
        course = course_of_bias(_linear_readings(found, readings, unit), wide, unit, time)
        clean = replace(readings, wrench=readings.wrench - course.change).select(~course.outlying)
        found = fitted(clean, question)
        if before is not None and _same(before, course):
            left, left_before = force_left(found.fit), force_left(as_it_is.fit)
            if left > POOR_SHARE * weight_of(found.fit) and left > MENDED * left_before:
                break
            return found, course, clean
    return as_it_is, None, readings


def _clean_at_a_glance(found: Estimate, readings: PoseReadings, time: Array) -> bool:
    """Whether neither a pose nor the order in time stands out of the ordinary fit.

    What rounding leaves of perfect readings has no distribution to stand out of.
    """
    fit, n = found.fit, len(time)
    linear = fit.linear
    if linear is None or linear.s[-1] == 0.0 or fit.readings_left < LEAST_LEFT or linear.chi2_of_readings == 0.0:
        return True
    if float(np.abs(fit.residuals).max()) <= ROUNDING * float(np.abs(fit.B).max()):
        return True
    in_groups = _linear_readings(found, readings, noise_of_groups(fit))
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


def _linear_readings(found: Estimate, readings: PoseReadings, unit: Array) -> LinearReadings:
    """The readings linearised at the estimate, in units (6,) of noise."""
    fit = found.fit
    tool = fit.tool
    if tool is None:
        raise TypeError("a rigid fit has a tool")
    known = rows_of(found.knowledge, tool, found.names)
    return LinearReadings(
        J=wrench_jacobian(tool, readings.R_base_flange, found.names) / unit[:, None],
        errors=_left_by(fit, readings) / unit,
        known=np.zeros((0, len(found.names))) if known is None else known.jacobian,
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


def _same(a: Course, b: Course) -> bool:
    return (a.kind, a.first_after) == (b.kind, b.first_after) and bool((a.outlying == b.outlying).all())


def _with_course(fit: Fit, names: tuple[str, ...], course: Course) -> Fit:
    """The fit with what the unknown course of the bias adds to its covariance."""
    if fit.tool is None or fit.linear is None:
        raise TypeError("a rigid fit has a tool")
    counted = fit.readings_left / max(fit.readings_left - course.parameters, 1.0)
    covariance = counted * (fit.covariance + course.covariance)
    from_parameters = matrix_jacobian(fit.tool, names)
    return replace(
        fit,
        covariance=covariance,
        B_covariance=from_parameters @ covariance @ from_parameters.T,
        noise=np.sqrt(counted) * fit.noise,
        dof=fit.dof / counted,
        readings_left=fit.readings_left / counted,
    )


def _reasons(
    fit: Fit, readings: PoseReadings, kept: NDArray[np.bool_], course: Course | None
) -> tuple[str | None, ...]:
    """Why each pose was left out, None where it was kept."""
    off = _left_by(fit, readings)
    if course is not None:
        off = off - course.change
    return tuple(None if stays else _reason(error, fit.noise) for error, stays in zip(off, kept, strict=True))


def _reason(error: Array, noise: Array) -> str:
    force, torque = float(np.linalg.norm(error[:3])), float(np.linalg.norm(error[3:]))
    return (
        f"{two_digits(force)} N and {two_digits(1e3 * torque)} mN m off what the other poses explain, "
        f"{float(np.linalg.norm(error / noise)):.0f} std: in contact, bumped, or read before the arm was still"
    )
