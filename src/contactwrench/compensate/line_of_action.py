"""Where a contact force acts: the line that force and torque tell, and its point on a known surface or axis.

A force F whose line passes through p has the torque `p x F` about the sensor's origin. The point of that line which is
closest to the origin is `F x T / |F|^2`; what of the torque lies along the force no line explains. Covariances are
carried through by derivatives.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError
from ..geometry.arrays import Array, Frozen, numbers
from ..geometry.wrench import cross_matrix, unit_direction

LEAST_FORCE = 4.0
"""Standard deviations of the force along itself: with less, direction and lever are no better than noise."""
LEAST_INCIDENCE = 0.05
"""Sine of the angle between the force and a surface, or an axis: flatter, the point runs away along it."""
NO_POINT, NO_COVARIANCE = np.full(3, np.nan), np.full((3, 3), np.nan)


@dataclass(frozen=True, eq=False)
class LineOfAction(Frozen):
    """The line along `direction` (3,), the force's unit vector, through `point` (3,) m, its point closest to the
    sensor's origin; sensor axes.

    `direction_covariance` (3, 3), `point_covariance` (3, 3) m^2. `moment_along` N m is what of the torque is along the
    force, with `moment_along_std`: beyond noise, one force alone does not explain the wrench. `reason` says why there
    is no line; then everything is NaN.
    """

    direction: Array
    point: Array
    direction_covariance: Array
    point_covariance: Array
    moment_along: float
    moment_along_std: float
    reason: str | None = None


@dataclass(frozen=True, eq=False)
class PointOfAction(Frozen):
    """Where a force acts, `point` (3,) m, sensor axes, with its `covariance` (3, 3) m^2; `miss` m by which the line
    passes the axis that was given, 0 for a plane. `reason` says why there is none; then everything is NaN.
    """

    point: Array
    covariance: Array
    miss: float
    reason: str | None = None


def line_of_action(wrench: ArrayLike, covariance: ArrayLike) -> LineOfAction:
    """The line of a contact wrench (6,), sensor axes, with `covariance` (6, 6).

    Without a force well above its noise the line has a `reason` in place of numbers. Raises `InputError` for shapes.
    """
    w, C = _checked(wrench, covariance)
    if reason := _too_weak(w, C):
        return LineOfAction(NO_POINT, NO_POINT, NO_COVARIANCE, NO_COVARIANCE, np.nan, np.nan, reason)
    F, T = w[:3], w[3:]
    length = float(np.linalg.norm(F))
    f = F / length
    across = (np.eye(3) - np.outer(f, f)) / length
    point, of_point = _closest_point(F, T)
    along = np.r_[across @ T, f]
    std = float(np.sqrt(along @ C @ along))
    return LineOfAction(f, point, across @ C[:3, :3] @ across.T, of_point @ C @ of_point.T, float(f @ T), std)


def point_on_plane(wrench: ArrayLike, covariance: ArrayLike, origin: ArrayLike, normal: ArrayLike) -> PointOfAction:
    """Where the line of a contact's force meets a plane: a known surface.

    Args:
        wrench: (6,) N and N m, sensor axes.
        covariance: (6, 6) of the wrench.
        origin: (3,) m, a point of the plane, sensor axes.
        normal: (3,) of the plane, sensor axes, of any length.

    Returns:
        The point; a line that all but lies in the plane gives a `reason`, as does a force no better than its noise.

    Raises:
        InputError: other shapes, or a normal without a direction.
    """
    w, C = _checked(wrench, covariance)
    n, q = unit_direction(normal, "normal"), numbers(origin, "origin")
    F, T = w[:3], w[3:]
    if reason := _too_weak(w, C) or _too_flat(abs(float(n @ F)), F, "plane"):
        return PointOfAction(NO_POINT, NO_COVARIANCE, np.nan, reason)
    # The point x of the plane, n . x = n . q, with x x F = T up to what of T is along F.
    p, of_p = _closest_point(F, T)
    s = float(n @ (q - p)) / float(n @ F)
    of_s = -(n @ of_p) / float(n @ F)
    of_s[:3] -= s * n / float(n @ F)
    derivative = of_p + np.outer(F, of_s)
    derivative[:, :3] += s * np.eye(3)
    return PointOfAction(p + s * F, derivative @ C @ derivative.T, 0.0)


def point_on_axis(wrench: ArrayLike, covariance: ArrayLike, origin: ArrayLike, along: ArrayLike) -> PointOfAction:
    """The point of an axis that the line of a contact's force passes most closely: where a rod was touched.

    Args:
        wrench: (6,) N and N m, sensor axes.
        covariance: (6, 6) of the wrench.
        origin: (3,) m, a point of the axis, sensor axes.
        along: (3,) the axis' direction, sensor axes, of any length.

    Returns:
        The point; a force all but along the axis gives a `reason`, as does one no better than its noise.

    Raises:
        InputError: other shapes, or an axis without a direction.
    """
    w, C = _checked(wrench, covariance)
    a, q = unit_direction(along, "axis"), numbers(origin, "origin")
    F, T = w[:3], w[3:]
    m, M, Q = np.cross(a, F), cross_matrix(a), cross_matrix(q)
    if reason := _too_weak(w, C) or _too_flat(float(np.linalg.norm(m)), F, "axis"):
        return PointOfAction(NO_POINT, NO_COVARIANCE, np.nan, reason)
    # (q + s a) x F = T along a x F: s = (T - q x F) . m / |m|^2, m = a x F.
    rest = T - Q @ F
    mm = float(m @ m)
    s = float(rest @ m) / mm
    of_s = np.r_[(rest @ M - m @ Q - 2.0 * s * (m @ M)) / mm, m / mm]
    derivative = np.outer(a, of_s)
    miss = abs(float((q - _closest_point(F, T)[0]) @ m)) / float(np.sqrt(mm))
    return PointOfAction(q + s * a, derivative @ C @ derivative.T, miss)


def _closest_point(F: Array, T: Array) -> tuple[Array, Array]:
    """The line's point (3,) closest to the origin, `F x T / |F|^2`, and its derivative (3, 6)."""
    squared = float(F @ F)
    point = np.cross(F, T) / squared
    return point, np.hstack([-cross_matrix(T) - 2.0 * np.outer(point, F), cross_matrix(F)]) / squared


def _too_weak(wrench: Array, covariance: Array) -> str | None:
    F = wrench[:3]
    length = float(np.linalg.norm(F))
    f = F / length if length > 0.0 else F
    std = float(np.sqrt(f @ covariance[:3, :3] @ f))
    if length > LEAST_FORCE * std:
        return None
    return f"the force is {length:.3g} N with a std of {std:.3g} N, expected more than {LEAST_FORCE:g} of those"


def _too_flat(across: float, F: Array, what: str) -> str | None:
    incidence = across / max(float(np.linalg.norm(F)), 1e-300)
    if incidence >= LEAST_INCIDENCE:
        return None
    return f"the force lies within {np.degrees(np.arcsin(incidence)):.2g} deg of the {what}, expected more than 3"


def _checked(wrench: ArrayLike, covariance: ArrayLike) -> tuple[Array, Array]:
    w, C = numbers(wrench, "wrench"), numbers(covariance, "covariance")
    if w.shape != (6,) or C.shape != (6, 6):
        raise InputError(f"wrench and covariance have shapes {w.shape} and {C.shape}, expected (6,) and (6, 6)")
    return w, C
