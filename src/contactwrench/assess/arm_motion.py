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
    R = np.broadcast_to(np.eye(3), (len(joints), 3, 3))
    position, v, a, omega, alpha = (np.zeros((len(joints), 3)) for _ in range(5))
    links = zip(arm.offset[:-1], arm.R_before, arm.axis, joints.T, velocity.T, acceleration.T, strict=True)
    for offset, before, axis, q, speed, faster in links:
        arm_of_lever = R @ offset
        position, v, a = _carried(arm_of_lever, position, v, a, omega, alpha)
        K = cross_matrix(axis)
        turn = np.eye(3) + np.sin(q)[:, None, None] * K + (1.0 - np.cos(q))[:, None, None] * (K @ K)
        R = R @ before
        along = R @ axis
        R = R @ turn
        turning = along * speed[:, None]
        alpha = alpha + along * faster[:, None] + _cross(omega, turning)
        omega = omega + turning
    position, v, a = _carried(R @ arm.offset[-1], position, v, a, omega, alpha)
    R = R @ arm.R_last_flange
    omega, alpha, a = (np.einsum("nji,nj->ni", R, each) for each in (omega, alpha, a))
    motion = FlangeMotion(omega, alpha, a, R, np.full(len(joints), fill_value=True))
    return MovingFlange(motion, position, np.linalg.norm(v, axis=1))


def _carried(lever: Array, position: Array, v: Array, a: Array, omega: Array, alpha: Array) -> tuple[Array, ...]:
    """Position, velocity and acceleration (n, 3) of a point at the end of a `lever` (n, 3) m that turns."""
    around = _cross(omega, lever)
    return position + lever, v + around, a + _cross(alpha, lever) + _cross(omega, around)


def _cross(a: Array, b: Array) -> Array:
    """`a x b` (n, 3); numpy's own takes three times as long."""
    product: Array = a[:, [1, 2, 0]] * b[:, [2, 0, 1]] - a[:, [2, 0, 1]] * b[:, [1, 2, 0]]
    return product
