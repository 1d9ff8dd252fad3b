"""What is known before the readings, each with its standard deviation: tilts near nominal, a weighed tool, a drawing.

Every piece of knowledge is a function of the tool and of the names of the parameters that are estimated; it gives the
rows that join the readings in the least squares: what is known, less what the tool says, in standard deviations.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np

from ..geometry.arrays import Array
from ..geometry.rotations import rotation_log
from ..geometry.wrench import cross_matrix
from ..model import GRAVITY, MOUNT, RigidTool, horizontal_axes
from .linearised import PriorRows

Knowledge: TypeAlias = Callable[[RigidTool, tuple[str, ...]], PriorRows]

ON_THE_SPOT = 1e-4
"""rad: below, an angle is its sine."""


def known_weight(weight: float, std: float) -> Knowledge:
    """The weight (N), from a scale."""

    def rows(tool: RigidTool, names: tuple[str, ...]) -> PriorRows:
        jacobian = np.zeros((1, len(names)))
        jacobian[0, 0] = 1.0 / std
        return PriorRows(np.array([weight - tool.weight]) / std, jacobian)

    return rows


def known_com(com: Array, std: Array) -> Knowledge:
    """The centre of mass (3,) m, sensor frame, from a drawing; `std` (3,) m."""

    def rows(tool: RigidTool, names: tuple[str, ...]) -> PriorRows:
        jacobian = np.zeros((3, len(names)))
        jacobian[:, 1:4] = np.diag(1.0 / std)
        return PriorRows((com - tool.com) / std, jacobian)

    return rows


def known_mounting(R_flange_sensor: Array, std: Array) -> Knowledge:
    """The mounting (3, 3); `std` (3,) rad of small rotations about the sensor's axes."""

    def rows(tool: RigidTool, names: tuple[str, ...]) -> PriorRows:
        off = rotation_log(tool.R_flange_sensor.T @ R_flange_sensor)
        jacobian = _of_mounting(np.diag(1.0 / std) @ _log_derivative(off), names)
        return PriorRows(off / std, jacobian)

    return rows


def known_gravity(gravity_direction: Array, std: float) -> Knowledge:
    """The direction of gravity (3,) in base axes; `std` rad about either horizontal axis."""
    sides = np.stack(horizontal_axes(gravity_direction))

    def rows(tool: RigidTool, names: tuple[str, ...]) -> PriorRows:
        jacobian = np.zeros((2, len(names)))
        if GRAVITY[0] in names:
            a, b = horizontal_axes(tool.gravity_direction)
            jacobian[:, -2:] = sides @ np.stack([-b, a], axis=1) / std
        return PriorRows(-sides @ tool.gravity_direction / std, jacobian)

    return rows


def nominal_mounting(std: float) -> Knowledge:
    """The sensor's z lies along the flange's, or against it: what its z is off by, as the sines of its tilt about the
    two axes across, has the standard deviation `std` (rad) each. The yaw is free.
    """

    def rows(tool: RigidTool, names: tuple[str, ...]) -> PriorRows:
        flange_z = tool.R_flange_sensor[2]
        return PriorRows(-flange_z[:2] / std, _of_mounting(cross_matrix(flange_z)[:2] / std, names))

    return rows


def earlier_calibration(tool: RigidTool, covariance: Array) -> Knowledge:
    """An earlier calibration of the same tool, its bias forgotten: `covariance` (9, 9) of weight, com, the mounting's
    small rotation and that of gravity, as in `Calibration`.
    """
    whitener = np.linalg.inv(np.linalg.cholesky(covariance))
    weight, com = known_weight(tool.weight, 1.0), known_com(tool.com, np.ones(3))
    rotations = _known_turns(tool.R_flange_sensor, tool.gravity_direction)

    def rows(now: RigidTool, names: tuple[str, ...]) -> PriorRows:
        parts = [piece(now, names) for piece in (weight, com, rotations)]
        off = np.concatenate([part.residuals for part in parts])
        jacobian = np.concatenate([part.jacobian for part in parts])
        return PriorRows(whitener @ off, whitener @ jacobian)

    return rows


def known_rotations(R_flange_sensor: Array, gravity_direction: Array, information: Array, turn: Array) -> Knowledge:
    """Mounting and gravity, by the small turns (5,) that lead to them from these two, those of `mount_x` to
    `gravity_b`: `information` (q, 5), rows of unit variance, times the turns is `turn` (q,). What the rows leave open
    is not known.
    """
    rotations = _known_turns(R_flange_sensor, gravity_direction)

    def rows(tool: RigidTool, names: tuple[str, ...]) -> PriorRows:
        back = rotations(tool, names)
        return PriorRows(turn + information @ back.residuals, information @ back.jacobian)

    return rows


def _known_turns(R_flange_sensor: Array, gravity_direction: Array) -> Knowledge:
    """Both rotations with a std of 1 rad, as five turns: of the mounting about the sensor's axes, of gravity about its
    horizontal axes. Unlike the sine of `known_gravity`, the turn tells gravity from its opposite.
    """
    mounting = known_mounting(R_flange_sensor, np.ones(3))
    axes = np.stack(horizontal_axes(gravity_direction))

    def rows(tool: RigidTool, names: tuple[str, ...]) -> PriorRows:
        of_mounting = mounting(tool, names)
        d = tool.gravity_direction
        # about a towards -b, about b towards a
        sine, cosine = np.array([-axes[1] @ d, axes[0] @ d]), float(gravity_direction @ d)
        per_sine, bend = _angle_per_sine(float(np.linalg.norm(sine)), cosine)
        jacobian = np.zeros((2, len(names)))
        if GRAVITY[0] in names:
            a, b = horizontal_axes(d)
            moves = np.stack([-b, a], axis=1)
            jacobian[:, -2:] = per_sine * np.stack([-axes[1], axes[0]]) @ moves
            jacobian[:, -2:] -= bend * np.outer(sine, gravity_direction @ moves)
        return PriorRows(
            np.concatenate([of_mounting.residuals, -per_sine * sine]), np.concatenate([of_mounting.jacobian, jacobian])
        )

    return rows


def _angle_per_sine(sine: float, cosine: float) -> tuple[float, float]:
    """The angle over its sine, and how that falls with the cosine."""
    if sine < ON_THE_SPOT and cosine > 0.0:
        return 1.0, 1.0 / 3.0
    sine = max(sine, ON_THE_SPOT)
    angle = float(np.arctan2(sine, cosine))
    return angle / sine, (sine - angle * cosine) / sine**3


def rows_of(knowledge: tuple[Knowledge, ...], tool: RigidTool, names: tuple[str, ...]) -> PriorRows | None:
    """All rows together, None where nothing is known."""
    if not knowledge:
        return None
    rows = [piece(tool, names) for piece in knowledge]
    return PriorRows(np.concatenate([r.residuals for r in rows]), np.concatenate([r.jacobian for r in rows]))


def _of_mounting(derivative: Array, names: tuple[str, ...]) -> Array:
    """A derivative (q, 3) with respect to small rotations of the mounting, in the columns of `names` (q, p)."""
    jacobian = np.zeros((len(derivative), len(names)))
    if MOUNT[0] in names:
        first = names.index(MOUNT[0])
        jacobian[:, first : first + 3] = derivative
    elif "yaw" in names:
        jacobian[:, names.index("yaw")] = derivative[:, 2]
    return jacobian


def _log_derivative(vector: Array) -> Array:
    """Derivative (3, 3) of `-log(exp(-delta) exp(vector))` at delta = 0: the inverse of the left Jacobian of SO(3)
    (Sola, Deray and Atchuthan, A micro Lie theory, 2018, Eq. 146).
    """
    angle = float(np.linalg.norm(vector))
    K = cross_matrix(vector)
    if angle < 1e-6:
        return np.eye(3) - 0.5 * K
    half = 0.5 * angle
    inverse: Array = np.eye(3) - 0.5 * K + (1.0 - half / np.tan(half)) / angle**2 * K @ K
    return inverse
