"""An estimate from a recording as it is: poses that the others do not explain left out, a bias that moved followed.

Most recordings are clean, and that is seen at a glance from the leverages of the ordinary fit; those that are not are
linearised at it, cleaned there (outliers.py, course.py), fitted again, and so on until the same poses stay.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..model import matrix_jacobian, wrench_jacobian
from ..orientation import Array
from .course import FALSE_ALARM, FEWEST_POSES, Course, chance_of_steady, course_of_bias
from .estimate import Estimate, Question, checked, fitted
from .knowledge import rows_of
from .least_squares import Fit, PoseReadings
from .noise import GROUPS
from .outliers import FALSE_ALARMS, SURELY_CLEAN, LinearReadings

ROUNDS = 8
AT_A_GLANCE = 3.0
"""Times the probability of a false alarm: what looks less clean than this is looked at closely."""

ROBUST_MODELS = ("auto", "yaw", "mount", "mount+base")


@dataclass(frozen=True, eq=False)
class RobustEstimate:
    """The estimate from the `readings` that were kept, the bias' course taken out of them; `reasons` (n,) why each pose
    was left out, None where it was kept; `course` of the bias over all poses.
    """

    found: Estimate
    readings: PoseReadings
    reasons: tuple[str | None, ...]
    course: Course | None


def cleaned_estimate(readings: PoseReadings, time: Array, question: Question) -> RobustEstimate:
    """Fit, clean and fit again; `time` (n,) s, or the count of poses where none is known.

    The paper's estimator and `affine` take the readings as they are. Nothing is checked yet: what the poses cannot
    separate comes as it is (see `confirmed`).
    """
    found, kept, course = fitted(readings, question), np.ones(len(readings), dtype=bool), None
    clean = readings
    if question.model in ROBUST_MODELS and not _clean_at_a_glance(found.fit, time):
        for _ in range(ROUNDS):
            before = course
            course = _course(found, readings, time)
            kept = ~course.outlying
            clean = replace(readings, wrench=readings.wrench - course.change).select(kept)
            found = fitted(clean, question)
            if before is not None and _same(before, course):
                break
        else:
            kept, course, clean = np.ones(len(readings), dtype=bool), None, readings
            found = fitted(clean, question)
    return RobustEstimate(found, clean, _reasons(found.fit, readings, kept, course), course)


def confirmed(cleaned: RobustEstimate, question: Question) -> RobustEstimate:
    """The estimate, checked, its covariance enlarged by what is unknown of the bias' course. Raises as `estimate`."""
    found, course = checked(cleaned.found, cleaned.readings, question), cleaned.course
    if course is not None and course.parameters > 0.0:
        found = replace(found, fit=_with_course(found.fit, found.names, course))
    return replace(cleaned, found=found)


def _clean_at_a_glance(fit: Fit, time: Array) -> bool:
    """Whether neither a pose nor the order in time stands out of the ordinary fit."""
    from scipy.special import fdtri

    linear, n = fit.linear, len(time)
    if linear is None:
        return True
    remaining = np.eye(6) - linear.U @ linear.U.transpose(0, 2, 1) + 1e-9 * np.eye(6)
    held_out = np.linalg.solve(remaining, linear.whitened[..., None])[..., 0]
    left = linear.readings_left
    distance = np.einsum("ni,ni->n", linear.whitened, held_out) * left / max(linear.chi2_of_readings, 1e-300)
    without = np.maximum(distance * (left - 6.0) / np.maximum(left - distance, 1e-9), 0.0)
    limit = 6.0 * float(fdtri(6.0, max(left - 6.0, 1.0), 1.0 - FALSE_ALARMS / n))
    if float(without.max()) > SURELY_CLEAN * limit:
        return False
    return n < FEWEST_POSES or chance_of_steady(linear.U, linear.whitened, time) > AT_A_GLANCE * FALSE_ALARM


def _course(found: Estimate, readings: PoseReadings, time: Array) -> Course:
    fit = found.fit
    tool = fit.tool
    if tool is None:
        raise TypeError("a rigid fit has a tool")
    names = found.names
    known = rows_of(found.knowledge, tool, names)
    unit = np.concatenate([fit.noise[group] for group in GROUPS])
    r = readings.R_base_flange.transpose(0, 2, 1) @ fit.gravity_direction
    errors = readings.wrench - r @ fit.B[:, :3].T - fit.B[:, 3]
    linear = LinearReadings(
        J=wrench_jacobian(tool, readings.R_base_flange, names) / unit[:, None],
        errors=errors / unit,
        known=np.zeros((0, len(names))) if known is None else known.jacobian,
        known_errors=np.zeros(0) if known is None else known.residuals,
    )
    return course_of_bias(linear, unit, time)


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
    )


def _reasons(
    fit: Fit, readings: PoseReadings, kept: NDArray[np.bool_], course: Course | None
) -> tuple[str | None, ...]:
    """Why each pose was left out, None where it was kept."""
    r = readings.R_base_flange.transpose(0, 2, 1) @ fit.gravity_direction
    off = readings.wrench - r @ fit.B[:, :3].T - fit.B[:, 3]
    if course is not None:
        off = off - course.change
    return tuple(None if stays else _reason(error, fit.noise) for error, stays in zip(off, kept, strict=True))


def _reason(error: Array, noise: Array) -> str:
    force, torque = float(np.linalg.norm(error[:3])), float(np.linalg.norm(error[3:]))
    return (
        f"{force:.2g} N and {1e3 * torque:.2g} mN m off what the other poses explain, "
        f"{float(np.linalg.norm(error / noise)):.0f} std: in contact, bumped, or read before the arm was still"
    )
