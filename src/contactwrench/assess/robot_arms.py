"""Robot arms as far as they turn and carry a sensor: where the flange is, and which orientations the wrist reaches.

Flange, z out of it, and base are those of the maker's controller (on ROS, `base_link` of the Universal Robots arms is
turned by half a turn about z).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError
from ..geometry.arrays import Array, Frozen, numbers
from ..geometry.wrench import cross_matrix

WRIST = 3
"""The last joints, which turn the flange; the others carry it, and stay where they are."""

MARGIN = np.deg2rad(5.0)
"""Kept from every joint limit: a controller stops before it, and a person's figures are rounded."""

SPACING = np.deg2rad(18.0)
"""Between the orientations that are offered: fine enough, by measurement (benchmarks/plan.py)."""

TRIED = 4096
TYPED_DIGITS = 4
"""Joint angles are given to 0.1 mrad, which a person types; the orientations are those of the rounded angles."""


@dataclass(frozen=True, eq=False)
class Arm(Frozen):
    """An arm with k revolute joints, which turns by `R_before[0] exp(axis[0] q1) R_before[1] ... R_last_flange`.

    `R_before` (k, 3, 3) from each joint's frame to the one before it, at rest; `offset` (k + 1, 3) m, from each
    frame's origin to the next, in its axes: base, joints, flange; `axis` (k, 3) unit vectors in the
    joint's own frame; `R_last_flange` (3, 3) from the flange to the last joint; `limits` (k, 2) rad, lowest and
    highest; `home` (k,) rad, a place to plan around. `max_speed` (k,) rad/s and `max_acceleration` (k,) rad/s^2 are the
    maker's, NaN where none is known. `source` says where this is from; `joint_names` (k), where it names the joints;
    `base_frame` is the base's name.
    """

    name: str
    R_before: Array
    offset: Array
    axis: Array
    R_last_flange: Array
    limits: Array
    home: Array
    max_speed: Array
    max_acceleration: Array
    source: str
    joint_names: tuple[str, ...] = ()
    base_frame: str = ""

    def __len__(self) -> int:
        return len(self.axis)


@dataclass(frozen=True, eq=False)
class Reach(Frozen):
    """Orientations that an arm's wrist reaches: `R_base_flange` (m, 3, 3), at `joints` (m, k) rad, `around` (k,)."""

    arm: str
    around: Array
    R_base_flange: Array
    joints: Array


def flange_pose(arm: Arm, joints: Array) -> tuple[Array, Array]:
    """`R_base_flange` (n, 3, 3) and position (n, 3), m, of an arm's flange at joint angles (n, k), rad."""
    R, position = np.broadcast_to(np.eye(3), (len(joints), 3, 3)), np.zeros((len(joints), 3))
    for offset, before, axis, q in zip(arm.offset[:-1], arm.R_before, arm.axis, joints.T, strict=True):
        K = cross_matrix(axis)
        turn = np.eye(3) + np.sin(q)[:, None, None] * K + (1.0 - np.cos(q))[:, None, None] * (K @ K)
        position = position + R @ offset
        R = R @ before @ turn
    return R @ arm.R_last_flange, position + R @ arm.offset[-1]


def flange_orientation(arm: Arm, joints: Array) -> Array:
    """`R_base_flange` (n, 3, 3) of an arm at joint angles (n, k), rad."""
    return flange_pose(arm, joints)[0]


def reach(arm: Arm, around: Array | None = None) -> Reach:
    """What the arm's wrist reaches while its other joints stay `around` (k,), rad, where it stands (None: its home):
    orientations at least `SPACING` apart.

    Each comes at the configuration nearest to `around` that was found for it, the nearest first (which is `around`
    itself). No joint is closer than `MARGIN` to a limit, unless it stands there, or further than half a turn from where
    it stands. Collisions of the arm with itself, its cables or its surroundings are not known here. Raises `InputError`
    for a wrong number of joints, and for one outside its limits.
    """
    start = np.round(arm.home if around is None else within_limits(arm, around), TYPED_DIGITS)
    wrist = min(WRIST, len(arm))
    low, high = arm.limits[-wrist:].T
    low = np.minimum(np.maximum(low + MARGIN, start[-wrist:] - np.pi), start[-wrist:])
    high = np.maximum(np.minimum(high - MARGIN, start[-wrist:] + np.pi), start[-wrist:])
    joints = np.tile(start, (TRIED, 1))
    joints[1:, -wrist:] = np.round(low + (high - low) * _evenly(TRIED - 1, wrist), TYPED_DIGITS)
    joints = joints[np.argsort(np.abs(joints - start).max(axis=1), kind="stable")]
    R = flange_orientation(arm, joints)
    kept = _apart(R, SPACING)
    return Reach(arm.name, start, R[kept], joints[kept])


def within_limits(arm: Arm, joints: ArrayLike) -> Array:
    """The joints (k,), rad, of an arm. Raises `InputError` for a wrong number, and for one outside its limits."""
    joints = numbers(joints, "joints")
    if joints.shape != (len(arm),):
        raise InputError(f"found {joints.size} joint angles, expected {len(arm)} for {arm.name}: give one a joint, rad")
    for number, (q, (low, high)) in enumerate(zip(joints, arm.limits, strict=True), start=1):
        if not low <= q <= high:
            degrees = " (are these degrees?)" if abs(q) > 2.0 * np.pi else ""
            raise InputError(f"q{number} of {arm.name} is {q:g} rad, expected {low:.4g} to {high:.4g}{degrees}")
    return joints


def _evenly(n: int, dimensions: int) -> Array:
    """N points (n, dimensions) that fill the unit cube evenly: multiples, modulo 1, of the powers of 1 / g, where g
    solves g^(d + 1) = g + 1 (the golden ratio for one dimension).
    """
    g = 2.0
    for _ in range(60):
        g = (1.0 + g) ** (1.0 / (dimensions + 1.0))
    return (0.5 + np.arange(1, n + 1)[:, None] * g ** -np.arange(1.0, dimensions + 1.0)) % 1.0


def _apart(R: Array, angle: float) -> NDArray[np.intp]:
    """The rotations (n, 3, 3), first come first kept, that are at least `angle` from every one kept before."""
    flat, free = R.reshape(-1, 9), np.ones(len(R), dtype=np.bool_)
    most = 1.0 + 2.0 * np.cos(angle)  # the trace of the rotation from one to the other
    for k in range(len(flat)):
        if free[k]:
            free[k + 1 :] &= flat[k + 1 :] @ flat[k] <= most
    return np.flatnonzero(free)


def known_arm(name: str) -> Arm:
    """The arm of that name, in any case, with or without spaces and hyphens. Raises `InputError` naming those known."""
    key = name.lower().translate({ord(sign): None for sign in " -_"})
    if key not in ARMS:
        raise InputError(f"robot {name!r} is not known, expected {', '.join(ARMS)} or a file that ends in .urdf")
    return ARMS[key]


def _about_x(quarter_deg: int) -> Array:
    """`Rx` of 0, 90 or -90 deg, exact."""
    s, c = {0: (0.0, 1.0), 90: (1.0, 0.0), -90: (-1.0, 0.0)}[quarter_deg]
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def _arms(
    lengths: Mapping[str, ArrayLike], twists: tuple[int, ...], limits: ArrayLike, home: tuple[int, ...], source: str
) -> dict[str, Arm]:
    """Arms with one wrist, by their Denavit-Hartenberg twists, deg: `Rx(twist 0) Rz(q1) Rx(twist 1) ... Rx(twist k)`.

    `lengths` m: by name, how far from each joint the next one lies along x and along z, two times k numbers; `limits`
    rad, (2, k), lowest and highest; `home` deg, flange down and forearm level, so that every tilt is within the wrist's
    reach.
    """
    R = np.array([_about_x(twist) for twist in twists])
    axis = np.tile([0.0, 0.0, 1.0], (len(home), 1))
    ends = np.array(limits).T, np.deg2rad(home)
    offsets = {name: np.zeros((len(twists), 3)) for name in lengths}
    for name, along in lengths.items():
        offsets[name][1:, [0, 2]] = np.transpose(along)
    return {
        name: Arm(
            name,
            R[:-1],
            offset,
            axis,
            R[-1],
            *ends,
            np.deg2rad(MAX_SPEED_DEG[name]),
            np.array(MAX_ACCELERATION.get(name, [np.nan] * len(home))),
            source,
            base_frame=f"{name} base",
        )
        for name, offset in offsets.items()
    }


IIWA_LENGTHS = {
    "iiwa7": ((0.0,) * 7, (0.34, 0.0, 0.4, 0.0, 0.4, 0.0, 0.126)),
    "iiwa14": ((0.0,) * 7, (0.36, 0.0, 0.42, 0.0, 0.4, 0.0, 0.126)),
}
UR_LENGTHS = {
    name: ((0.0, a2, a3, 0.0, 0.0, 0.0), (d1, 0.0, 0.0, d4, d5, d6))
    for name, (d1, a2, a3, d4, d5, d6) in {
        "ur3e": (0.15185, -0.24355, -0.2132, 0.13105, 0.08535, 0.0921),
        "ur5e": (0.1625, -0.425, -0.3922, 0.1333, 0.0997, 0.0996),
        "ur10e": (0.1807, -0.6127, -0.57155, 0.17415, 0.11985, 0.11655),
        "ur16e": (0.1807, -0.4784, -0.36, 0.17415, 0.11985, 0.11655),
        "ur20": (0.2363, -0.862, -0.7287, 0.201, 0.1593, 0.1543),
    }.items()
}
FRANKA_LENGTHS = (0.0, 0.0, 0.0825, -0.0825, 0.0, 0.088, 0.0), (0.333, 0.0, 0.316, 0.0, 0.384, 0.0, 0.107)
IIWA_LIMITS = np.outer([-1.0, 1.0], np.deg2rad([170.0, 120.0, 170.0, 120.0, 170.0, 120.0, 175.0]))
UR_LIMITS = np.outer([-1.0, 1.0], np.deg2rad(np.full(6, 360.0)))
PANDA_LIMITS = (
    (-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973),
    (2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973),
)
FR3_LIMITS = (
    (-2.7437, -1.7837, -2.9007, -3.0421, -2.8065, 0.5445, -3.0159),
    (2.7437, 1.7837, 2.9007, -0.1518, 2.8065, 4.5169, 3.0159),
)
MAX_SPEED_DEG = {
    "iiwa7": (98.0, 98.0, 100.0, 130.0, 140.0, 180.0, 180.0),
    "iiwa14": (85.0, 85.0, 100.0, 75.0, 130.0, 135.0, 135.0),
    "ur3e": (180.0, 180.0, 180.0, 360.0, 360.0, 360.0),
    "ur5e": (180.0,) * 6,
    "ur10e": (120.0, 120.0, 180.0, 180.0, 180.0, 180.0),
    "ur16e": (120.0, 120.0, 180.0, 180.0, 180.0, 180.0),
    "ur20": (120.0, 120.0, 150.0, 210.0, 210.0, 210.0),
    "panda": (*np.rad2deg([2.175] * 4), *np.rad2deg([2.61] * 3)),
    "fr3": (*np.rad2deg([2.62] * 4), *np.rad2deg([5.26, 4.18, 5.26])),
}
"""deg/s: KUKA's brochure of the LBR iiwa; the user manuals of Universal Robots, as joint_limits.yaml of their ROS 2
description has them; Franka's libfranka, rate_limiting.h, and for the FR3 the largest at any place of a joint.
"""
MAX_ACCELERATION = {"panda": (15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0), "fr3": (10.0,) * 7}
"""rad/s^2. KUKA and Universal Robots state none."""
FRANKA_TWISTS, FRANKA_HOME = (0, -90, 90, 90, -90, 90, 90, 0), (0, -45, 0, -135, 0, 90, 45)
KUKA = "KUKA, LBR iiwa 7 R800, LBR iiwa 14 R820, Specification: axis data"
UNIVERSAL = "Universal Robots, DH parameters for calculations of kinematics and dynamics; user manual: joint ranges"
UR_TWISTS, UR_HOME = (0, 90, 0, 0, 90, -90, 0), (0, -90, 90, -90, -90, 0)
FRANKA = "Franka Robotics, Franka Control Interface documentation: robot and interface specifications"

ARMS: dict[str, Arm] = {
    **_arms(IIWA_LENGTHS, (0, -90, 90, 90, -90, -90, 90, 0), IIWA_LIMITS, (0, 30, 0, -60, 0, 90, 0), KUKA),
    **_arms(UR_LENGTHS, UR_TWISTS, UR_LIMITS, UR_HOME, UNIVERSAL),
    **_arms({"panda": FRANKA_LENGTHS}, FRANKA_TWISTS, PANDA_LIMITS, FRANKA_HOME, FRANKA),
    **_arms({"fr3": FRANKA_LENGTHS}, FRANKA_TWISTS, FR3_LIMITS, FRANKA_HOME, FRANKA),
}
"""By name. Twists, lengths and limits are the makers' figures; `source` says where they stand."""
OF_UNIVERSAL_ROBOTS = frozenset(arm.base_frame for name, arm in ARMS.items() if name.startswith("ur"))
AGAINST_CONTROLLER = {"base": np.eye(3), "base_link": np.diag([-1.0, -1.0, 1.0])}
"""How the bases that ROS has of Universal Robots' arms stand to their controller's: `base_link`, x forward, is half a
turn about z away from it (Universal_Robots_ROS2_Description, urdf/ur_macro.xacro, base_link-base_fixed_joint and
base_link-base_link_inertia). ROS-Industrial's `base` and `base_link` are alike on some arms and not on others.
"""


def R_between(frame: str, other: str) -> Array | None:
    """`R_frame_other` (3, 3) of two base frames; None where it is not known."""
    if frame == other:
        return np.eye(3)
    named = {frame, other} - OF_UNIVERSAL_ROBOTS
    return AGAINST_CONTROLLER.get(named.pop()) if len(named) == 1 else None  # either way: a half turn is its inverse
