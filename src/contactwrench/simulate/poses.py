"""Static poses for the rig as joint angles: the paper's six, random ones, and those that others ask for."""

from __future__ import annotations

from importlib.resources import files

import numpy as np

from ..errors import InputError
from ..geometry.arrays import Array
from ..geometry.orientation import CONVENTIONS
from .arm import JOINT_RANGE
from .kinematics import HOME, flange_pose, joints_for
from .rig import Rig

CLEARANCE = 0.1
"""m: a random pose keeps the flange, and a tool of `TOOL_LENGTH` on it, this far over the plane of the base."""
TOOL_LENGTH = 0.2
ROUND_THE_COLUMN = 0.3
"""m: a random pose keeps both at least this far from the axis of the base."""
WITHIN = 0.95
"""Of each joint's range, for random poses."""


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
