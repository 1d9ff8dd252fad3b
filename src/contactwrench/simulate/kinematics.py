"""Where the arm goes: the flange at given joints, and joints that bring the flange to a given pose."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..errors import InputError
from ..geometry.arrays import Array
from ..geometry.rotations import rotation_log
from .arm import JOINT_RANGE
from .rig import JOINTS, Rig, import_mujoco, inverse_dynamics

HOME = np.deg2rad([0.0, 30.0, 0.0, -60.0, 0.0, 90.0, 0.0])
"""Joints (7,) with the flange down in front of the base, at x = 0.600 and z = 0.560 m: every tilt is within the wrist's
reach.
"""

ITERATIONS = 200
CLOSE = 1e-11
"""m and rad."""
TRIES = 24
MILLIMETRES = 10.0
"""m: beyond this a position was meant in mm."""


def flange_pose(rig: Rig, joints: Array) -> tuple[Array, Array]:
    """`R_base_flange` (n, 3, 3) and position (n, 3), m, in base axes, at joints (n, 7), rad."""
    physics = inverse_dynamics(rig, joints)
    return physics.R_base_flange, physics.position


def flange_jacobian(rig: Rig, joints: Array) -> Array:
    """The Jacobian (6, 7) of the flange at joints (7,): velocity (m/s), then angular velocity (rad/s), base axes."""
    return _flange(rig, import_mujoco().MjData(rig.model), joints)[2]


def _flange(rig: Rig, data: Any, joints: Array) -> tuple[Array, Array, Array]:
    """`R_base_flange` (3, 3), position (3,) and Jacobian (6, 7) at joints (7,); `data` is MuJoCo's, to work in."""
    mujoco = import_mujoco()
    data.qpos[:] = joints
    mujoco.mj_kinematics(rig.model, data)
    mujoco.mj_comPos(rig.model, data)
    jacobian = np.zeros((6, JOINTS))
    mujoco.mj_jacSite(rig.model, data, jacobian[:3], jacobian[3:], rig.flange)
    R_base_world = rig.settings.R_world_base.T
    return (
        R_base_world @ data.site_xmat[rig.flange].reshape(3, 3),
        R_base_world @ data.site_xpos[rig.flange],
        np.concatenate([R_base_world @ jacobian[:3], R_base_world @ jacobian[3:]]),
    )


def joints_for(
    rig: Rig, R_base_flange: Array, position: Array | None = None, near: Array = HOME, seed: int = 0
) -> Array:
    """Joints (7,), rad, that bring the flange to an orientation (3, 3), and to a position (3,), m, where one is given.

    Newton's steps in the least norm from `near` (7,), then from other places; of seven joints one is free, or four, and
    stays close to where it began. Raises `InputError` for a pose that no configuration within the limits was found for.
    """
    rng = np.random.default_rng(seed)
    start = np.asarray(near, dtype=np.float64)
    for _ in range(TRIES):
        joints = _newton(rig, R_base_flange, position, start)
        if joints is not None:
            return joints
        start = rng.uniform(-0.9 * JOINT_RANGE, 0.9 * JOINT_RANGE)
    where, hint = "", ""
    if position is not None:
        where = f" at {', '.join(f'{value:.4g}' for value in position)} m"
        hint = " (are these mm?)" if np.abs(position).max() > MILLIMETRES else ""
    raise InputError(
        f"the iiwa 7 was not found to reach a flange pose{where}, expected one in its workspace{hint}: move it"
    )


def _newton(rig: Rig, R_goal: Array, goal: Array | None, start: Array) -> Array | None:
    """Joints within the limits at the goal, or None."""
    joints, data = start.copy(), import_mujoco().MjData(rig.model)
    for _ in range(ITERATIONS):
        R, position, jacobian = _flange(rig, data, joints)
        error = R @ rotation_log(R.T @ R_goal)
        if goal is None:
            jacobian = jacobian[3:]
        else:
            error = np.concatenate([goal - position, error])
        if np.abs(error).max() < CLOSE:
            joints = (joints + np.pi) % (2.0 * np.pi) - np.pi
            return joints if bool(np.all(np.abs(joints) <= JOINT_RANGE)) else None
        step = jacobian.T @ np.linalg.solve(jacobian @ jacobian.T + 1e-9 * np.eye(len(error)), error)
        joints += step * min(1.0, 0.5 / np.abs(step).max())
    return None
