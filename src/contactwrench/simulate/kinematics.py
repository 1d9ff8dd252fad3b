"""Where the flange is at given joints, joints that bring it to given poses, and poses to go to: the paper's, random."""

from __future__ import annotations

from importlib.resources import files
from typing import Any

import numpy as np

from ..assess.robot_arms import known_arm
from ..errors import InputError
from ..geometry.arrays import Array
from ..geometry.orientation import CONVENTIONS
from ..geometry.rotations import rotation_log
from .arm import JOINT_RANGE
from .rig import Rig, import_mujoco, inverse_dynamics, site_at

HOME = known_arm("iiwa7").home
"""Joints (7,), rad: flange down before the base, x = 0.600 and z = 0.560 m; every tilt is within the wrist's reach."""

ITERATIONS, TRIES = 200, 24
CLOSE = 1e-11
"""m and rad."""
MILLIMETRES = 10.0
"""m: beyond this a position was meant in mm."""

CLEARANCE = 0.1
"""m: a random pose keeps the flange, and a tool of `TOOL_LENGTH` on it, this far over the plane of the base."""
TOOL_LENGTH = 0.2
ROUND_THE_COLUMN = 0.3
"""m: a random pose keeps both at least this far from the axis of the base."""
WITHIN = 0.95
"""Of each joint's range, for random poses."""


def flange_pose(rig: Rig, joints: Array) -> tuple[Array, Array]:
    """`R_base_flange` (n, 3, 3) and position (n, 3), m, in base axes, at joints (n, 7), rad."""
    physics = inverse_dynamics(rig, joints)
    return physics.R_base_flange, physics.position


def flange_jacobian(rig: Rig, joints: Array) -> Array:
    """The Jacobian (6, 7) of the flange at joints (7,): velocity (m/s), then angular velocity (rad/s), base axes."""
    return _flange(rig, import_mujoco().MjData(rig.model), joints)[2]


def _flange(rig: Rig, data: Any, joints: Array) -> tuple[Array, Array, Array]:
    """`R_base_flange` (3, 3), position (3,) and Jacobian (6, 7) at joints (7,); `data` is MuJoCo's, to work in."""
    R_world_flange, in_world, jacobian = site_at(rig, data, joints, rig.flange)
    R_base_world = rig.R_world_base.T
    turned = (R_base_world @ jacobian.reshape(2, 3, -1)).reshape(6, -1)
    return R_base_world @ R_world_flange, R_base_world @ in_world, turned


def joints_for(rig: Rig, R_base_flange: Array, position: Array | None = None, near: Array = HOME) -> Array:
    """Joints (7,), rad, that bring the flange to an orientation (3, 3), and to a position (3,), m, where one is given.

    Newton's steps in the least norm from `near` (7,), then from other places; of seven joints one is free, or four, and
    stays close to where it began. Raises `InputError` for a pose that no configuration within the limits was found for.
    """
    rng = np.random.default_rng(0)
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


def paper_joints(rig: Rig) -> Array:
    """Joints (6, 7), rad, that bring the flange to the paper's six poses (Table III), each near the one before."""
    text = (files("contactwrench") / "data" / "paper_six_poses.csv").read_text(encoding="utf-8")
    rows = [line for line in text.splitlines() if not line.startswith("#")]
    table = np.genfromtxt(rows, delimiter=",", names=True)
    position = np.stack([table[name] for name in ("x_mm", "y_mm", "z_mm")], axis=1) / 1000.0
    angles = np.deg2rad(np.stack([table[name] for name in ("a_deg", "b_deg", "c_deg")], axis=1))
    return joints_through(rig, CONVENTIONS["kuka_abc"].to_matrices(angles), position)


def joints_through(rig: Rig, R_base_flange: Array, position: Array | None = None) -> Array:
    """Joints (n, 7), rad, for flange orientations (n, 3, 3) and, where given, positions (n, 3), m, base axes.

    Without positions the flange is where the least motion from `HOME` brings it. Raises `InputError`, with the row of a
    pose that cannot be reached.
    """
    joints = np.empty((len(R_base_flange), len(HOME)))
    near = HOME
    for row, R in enumerate(R_base_flange):
        try:
            joints[row] = joints_for(rig, R, None if position is None else position[row], near)
        except InputError as error:
            raise InputError(f"pose {row + 1}: {error}", row) from None
        near = HOME if position is None else joints[row]
    return joints


def random_joints(rig: Rig, n: int, rng: np.random.Generator) -> Array:
    """Joints (n, 7), rad, uniform within the limits, as far as flange and tool stay clear of ground and column."""
    kept = np.empty((0, len(HOME)))
    while len(kept) < n:
        joints = rng.uniform(-WITHIN * JOINT_RANGE, WITHIN * JOINT_RANGE, size=(2 * n, len(HOME)))
        R, position = flange_pose(rig, joints)
        places = position + np.array([[[0.0]], [[TOOL_LENGTH]]]) * R[:, :, 2]
        clear = (places[..., 2] > CLEARANCE) & (np.hypot(places[..., 0], places[..., 1]) > ROUND_THE_COLUMN)
        kept = np.concatenate([kept, joints[clear.all(axis=0)]])
    return kept[:n]
