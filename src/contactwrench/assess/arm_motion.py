"""How an arm's flange moves when its joints do: velocities and accelerations from link to link, from the base outwards
(Luh, Walker and Paul, On-Line Computational Scheme for Mechanical Manipulators, 1980).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..geometry.arrays import Array
from ..geometry.wrench import cross_matrix
from ..samples.flange_motion import FlangeMotion
from .robot_arms import Arm


@dataclass(frozen=True, eq=False)
class MovingFlange:
    """`motion` of a flange at n moments, its `position` (n, 3) m and `speed` (n,) m/s from the base."""

    motion: FlangeMotion
    position: Array
    speed: Array


def moving_flange(arm: Arm, joints: Array, velocity: Array, acceleration: Array) -> MovingFlange:
    """The flange at joint angles (n, k), rad, with their derivatives (n, k), rad/s and rad/s^2."""
    # Moments are the last axis: numpy then takes a third of the time.
    R = np.broadcast_to(np.eye(3)[..., None], (3, 3, len(joints)))
    position, v, a, omega, alpha = (np.zeros((3, len(joints))) for _ in range(5))
    links = zip(arm.offset[:-1], arm.R_before, arm.axis, joints.T, velocity.T, acceleration.T, strict=True)
    for offset, before, axis, q, speed, faster in links:
        K = cross_matrix(axis)
        # All of the turn I + sin q K + (1 - cos q) K^2, and of both vectors, that does not depend on q.
        still = np.column_stack([before, before @ K, before @ K @ K, before @ axis, offset]).T @ R
        position, v, a = _carried(still[:, 10], position, v, a, omega, alpha)
        R = still[:, :3] + np.sin(q) * still[:, 3:6] + (1.0 - np.cos(q)) * still[:, 6:9]
        along, turning = still[:, 9], still[:, 9] * speed
        alpha = alpha + along * faster + _cross(omega, turning)
        omega = omega + turning
    still = np.column_stack([arm.R_last_flange, arm.offset[-1]]).T @ R
    position, v, a = _carried(still[:, 3], position, v, a, omega, alpha)
    R = still[:, :3]
    omega, alpha, a = (np.einsum("jin,jn->ni", R, each) for each in (omega, alpha, a))
    motion = FlangeMotion(omega, alpha, a, R.transpose(2, 0, 1), np.full(len(joints), fill_value=True))
    return MovingFlange(motion, np.ascontiguousarray(position.T), np.sqrt(np.einsum("in,in->n", v, v)))


def _carried(lever: Array, position: Array, v: Array, a: Array, omega: Array, alpha: Array) -> tuple[Array, ...]:
    """Position, velocity and acceleration (3, n) of a point at the end of a `lever` (3, n) m that turns."""
    around = _cross(omega, lever)
    return position + lever, v + around, a + _cross(alpha, lever) + _cross(omega, around)


def _cross(a: Array, b: Array) -> Array:
    """`a x b` (3, n); numpy's own takes three times as long."""
    return a[[1, 2, 0]] * b[[2, 0, 1]] - a[[2, 0, 1]] * b[[1, 2, 0]]
