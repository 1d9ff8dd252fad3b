"""The paper's estimator: two decoupled regressions, with the measured force as the torque's regressor (method, "The
paper's estimator").

1. Torque, Eq. 5-7: `T = com x F + l`, six unknowns com, l.
2. Force, Eq. 13-15, with the third row corrected to -R33: unknowns G cos(theta), G sin(theta), G_z, F0. G_z is used.
3. T0 from l, F0 and com, Eq. 16.

The covariance is that of the whole chain to first order, with one variance for the noise of fx and fy, one for that of
fz, and one for that of the torques: what their regression leaves, less what the force's noise has in its regressor.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..calibration.observability import require_separable
from ..errors import UnobservableError
from ..geometry.arrays import Array
from ..geometry.rotations import rotations_about_z
from ..geometry.wrench import cross_matrix
from ..model import PARAMETERS, RigidTool, free_wrench, gravity_in_flange, matrix_jacobian, wrench_matrix
from ..statistics import counted
from .estimate import RigidEstimate
from .noise import PoseReadings

MIN_POSES = 3
LEAST_OWN_SHARE = 0.1
"""Of the torque regression's residual variance: no less is put down to the torques themselves."""

FORCE_NAMES = ("weight_xy", "yaw", "weight", "bias_fx", "bias_fy", "bias_fz")
TORQUE_NAMES = ("com_x", "com_y", "com_z", "bias_tx", "bias_ty", "bias_tz")


@dataclass(frozen=True)
class _Regression:
    """`A x = y` by ordinary least squares, for rows A (n, 3, 6) and values y (n, 3) (Eq. 7 and 15)."""

    A: Array
    y: Array

    @cached_property
    def solution(self) -> Array:
        return np.asarray(np.linalg.lstsq(self.A.reshape(-1, 6), self.y.ravel(), rcond=None)[0], dtype=np.float64)

    @cached_property
    def left(self) -> Array:
        return np.asarray(self.y - self.A @ self.solution)

    @cached_property
    def from_values(self) -> Array:
        """How the solution changes with the values of each pose, (n, 6, 3)."""
        inverse = np.asarray(np.linalg.pinv(self.A.reshape(-1, 6)), dtype=np.float64)
        return inverse.reshape(6, -1, 3).transpose(1, 0, 2)

    def without_each(self) -> Array | None:
        """The solutions (n, 6) without each pose in turn, exactly; None where one is needed."""
        remaining = np.eye(3) - self.A @ self.from_values
        if float(np.linalg.eigvals(remaining).real.min()) < 1e-9:
            return None
        errors = np.linalg.solve(remaining, self.left[..., None])
        return np.asarray(self.solution - (self.from_values @ errors)[..., 0])


def fit_paper(readings: PoseReadings, gravity_direction: Array) -> RigidEstimate:
    """The paper's estimate from at least three poses. Raises `UnobservableError` where a regression is singular."""
    n, names = len(readings), PARAMETERS["paper"]
    r = gravity_in_flange(readings.R_base_flange, gravity_direction)
    F, T = readings.wrench[:, :3], readings.wrench[:, 3:]
    force, torque = _Regression(_force_regressor(r), F), _Regression(torque_regressor(F), T)
    _require_separable(force.A, torque.A, readings.R_base_flange, gravity_direction)
    x = force.solution
    tool = tool_of_unknowns(x, torque.solution, gravity_direction)
    B, to_B = wrench_matrix(tool), matrix_jacobian(tool, names)
    variance = _variance(force, torque, tool)
    covariance = _covariance(force, torque, tool, variance)
    return RigidEstimate(
        names=names,
        tool=tool,
        gravity_direction=gravity_direction,
        B=B,
        B_covariance=to_B @ covariance @ to_B.T,
        covariance=covariance,
        noise=np.sqrt(variance),
        kept=np.ones(n, dtype=bool),
        errors=readings.wrench - free_wrench(B, r),
        held_out=_held_out(readings.wrench, r, force, torque, gravity_direction),
        reduced_chi2=1.0,
        dof=np.full(11, float(n - 2)),
        readings_left=np.full(2, 3.0 * n - 6.0),
        singular_values=np.asarray(np.linalg.svd(force.A.reshape(3 * n, 6), compute_uv=False)),
        weight_xy=float(np.hypot(x[0], x[1])),
        weight_z=float(x[2]),
    )


def _force_regressor(r: Array) -> Array:
    """Rows (n, 3, 6) of Eq. 13 for r = -(R31, R32, R33), the third row corrected: unknowns G cos(theta),
    G sin(theta), G_z, F0.
    """
    A = np.zeros((len(r), 3, 6))
    A[:, 0, 0], A[:, 0, 1] = r[:, 0], r[:, 1]
    A[:, 1, 0], A[:, 1, 1] = r[:, 1], -r[:, 0]
    A[:, 2, 2] = r[:, 2]
    A[:, :, 3:] = np.eye(3)
    return A


def torque_regressor(F: Array) -> Array:
    """Rows (n, 3, 6) of Eq. 5 for measured forces (n, 3): unknowns com, l."""
    A = np.empty((len(F), 3, 6))
    A[:, :, :3] = -cross_matrix(F)
    A[:, :, 3:] = np.eye(3)
    return A


def _require_separable(force: Array, torque: Array, R_base_flange: Array, gravity_direction: Array) -> None:
    n = len(force)
    if n < MIN_POSES:
        raise UnobservableError(
            f"cannot separate {', '.join(FORCE_NAMES + TORQUE_NAMES)}: found {counted(n, 'distinct orientation')}, "
            f"expected {MIN_POSES} or more for the paper's estimator; record 6 or more that tilt the tool"
        )
    require_separable(force.reshape(3 * n, 6), FORCE_NAMES, R_base_flange, gravity_direction)
    swing = torque[:, :, :3] - torque[:, :, :3].mean(axis=0)
    unit = np.sqrt(np.mean(np.sum(swing**2, axis=(1, 2)))) + 1e-300
    scaled = np.concatenate([swing / unit, torque[:, :, 3:]], axis=2)
    require_separable(scaled.reshape(3 * n, 6), TORQUE_NAMES, R_base_flange, gravity_direction)


def tool_of_unknowns(x: Array, L: Array, gravity_direction: Array) -> RigidTool:
    """The parameters of Eq. 16 and Eq. 17 from the unknowns of the two regressions."""
    theta = np.arctan2(x[1], x[0])
    com, F0 = L[:3], x[3:]
    T0 = L[3:] + np.cross(com, F0)
    return RigidTool(float(x[2]), com, np.r_[F0, T0], rotations_about_z(np.array([theta]))[0], gravity_direction)


def _variance(force: _Regression, torque: _Regression, tool: RigidTool) -> Array:
    """Of the noise of each axis (6,): fx and fy, fz, the torques less what the forces' noise has in them."""
    n = len(force.y)
    of_xy, of_z = float(np.sum(force.left[:, :2] ** 2)) / (2 * n - 4), float(np.sum(force.left[:, 2] ** 2)) / (n - 2)
    of_force = np.array([of_xy, of_xy, of_z])
    com = cross_matrix(tool.com)
    left = float(np.sum(torque.left**2)) / (3 * n - 6)
    own = left - float(np.trace(com * of_force @ com.T)) / 3.0
    least = np.finfo(np.float64).tiny  # readings without any error still weigh something
    return np.maximum([*of_force, *[max(own, LEAST_OWN_SHARE * left)] * 3], least)


def _covariance(force: _Regression, torque: _Regression, tool: RigidTool, variance: Array) -> Array:
    """Covariance (11, 11) of weight, com, bias and yaw, to first order in the noise of the readings.

    The torque regression's error is `n_T - com x n_F`: its regressor is measured, so the two share the force's noise.
    """
    of_x, of_L, x = force.from_values, torque.from_values, force.solution
    from_F = np.concatenate([of_x, -of_L @ cross_matrix(tool.com)], axis=1)
    from_T = np.concatenate([np.zeros_like(of_x), of_L], axis=1)
    J = np.zeros((11, 12))
    J[0, 2] = 1.0
    J[1:4, 6:9] = J[4:7, 3:6] = J[7:10, 9:12] = np.eye(3)
    J[7:10, 3:6] = cross_matrix(tool.com)
    J[7:10, 6:9] = -cross_matrix(tool.bias[:3])
    J[10, :2] = np.array([-x[1], x[0]]) / (x[0] ** 2 + x[1] ** 2)
    per_reading = J @ np.concatenate([from_F, from_T], axis=2)  # before squares: a large bias all but cancels here
    return np.asarray(np.einsum("npi,nqi,i->pq", per_reading, per_reading, variance))


def _held_out(wrench: Array, r: Array, force: _Regression, torque: _Regression, down: Array) -> Array | None:
    """Residual (n, 6) of each pose against the paper's estimate from the other poses; None where they are too few."""
    if len(wrench) <= MIN_POSES:
        return None
    without_x, without_L = force.without_each(), torque.without_each()
    if without_x is None or without_L is None:
        return None
    tools = [tool_of_unknowns(xi, Li, down) for xi, Li in zip(without_x, without_L, strict=True)]
    predicted: Array = np.array([free_wrench(wrench_matrix(tool), ri) for tool, ri in zip(tools, r, strict=True)])
    return wrench - predicted
