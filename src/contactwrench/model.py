"""The measurement model: what a free tool reads, and how that changes with every parameter.

    u = R_flange_sensor^T R_base_flange^T d           unit "down" in sensor axes
    F = weight * u + F0      T = com x (weight * u) + T0

(paper, Eq. 1-2 and 10-12, with any mounting and any direction of gravity d). In one line: `B @ [r, 1]` with
`r = R_base_flange^T d` and B (6, 4); everything that was identified, but d, is in B.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import TypeAlias

import numpy as np

from .geometry.arrays import Array, Frozen, read_only
from .geometry.rotations import procrustes, rotation_exp
from .geometry.wrench import WRENCH_AXES, cross_matrix

Step: TypeAlias = Callable[
    [float, float, float, float, float, float, float, float, float, float],
    tuple[float, float, float, float, float, float],
]
LINEAR_PARAMETERS = ("weight", "com_x", "com_y", "com_z", *(f"bias_{axis}" for axis in WRENCH_AXES))
MOUNT = ("mount_x", "mount_y", "mount_z")
GRAVITY = ("gravity_a", "gravity_b")
AXES = WRENCH_AXES
ABOUT_AXES = cross_matrix(np.eye(3))
FEW_TOOLS = 16
"""At which a search stands at a time, whose responses are kept."""

PARAMETERS: dict[str, tuple[str, ...]] = {
    "paper": (*LINEAR_PARAMETERS, "yaw"),
    "yaw": (*LINEAR_PARAMETERS, "yaw"),
    "mount": (*LINEAR_PARAMETERS, *MOUNT),
    "mount+base": (*LINEAR_PARAMETERS, *MOUNT, *GRAVITY),
    "affine": tuple(f"B_{axis}_{column}" for axis in AXES for column in ("rx", "ry", "rz", "1")),
}
"""The parameters of each model, in the order of every covariance (design: section 3)."""


@dataclass(frozen=True, eq=False)
class RigidTool(Frozen):
    """The parameters of the rigid models, unpacked.

    `weight` N; `com` (3,) m, sensor frame; `bias` (6,) N and N m; `R_flange_sensor` (3, 3); `gravity_direction`
    (3,) unit vector in base axes.
    """

    weight: float
    com: Array
    bias: Array
    R_flange_sensor: Array
    gravity_direction: Array


def parameters_of(tool: RigidTool, yaw: float, names: tuple[str, ...]) -> Array:
    """The values (p,) of the rigid parameters `names`; the small rotations are zero."""
    known = dict(zip((*LINEAR_PARAMETERS, "yaw"), (tool.weight, *tool.com, *tool.bias, yaw), strict=True))
    return np.array([known.get(name, 0.0) for name in names])


def horizontal_axes(gravity_direction: Array) -> tuple[Array, Array]:
    """Two unit vectors a, b (base axes) that complete `gravity_direction` to a right-handed base (a, b, d)."""
    x, y, z = gravity_direction.tolist()
    sizes = [abs(x), abs(y), abs(z)]
    across = ((0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0))[sizes.index(min(sizes))]
    length = math.hypot(*across)
    p, q, r = (part / length for part in across)
    return np.array([p, q, r]), np.array([y * r - z * q, z * p - x * r, x * q - y * p])


def gravity_in_flange(R_base_flange: Array, gravity_direction: Array) -> Array:
    """`r = R_base_flange^T d`, (n, 3), unit "down" in flange axes, for orientations (n, 3, 3)."""
    return gravity_direction @ R_base_flange


def wrench_matrix(tool: RigidTool) -> Array:
    """B (6, 4): the free wrench is `B @ [r, 1]`."""
    R_sensor_flange = tool.R_flange_sensor.T
    B = np.empty((6, 4))
    B[:3, :3] = tool.weight * R_sensor_flange
    B[3:, :3] = cross_matrix(tool.com) @ B[:3, :3]
    B[:, 3] = tool.bias
    return B


def weight_scale(B: Array) -> float:
    """The weight (N) of a free tool, of one that is not rigid the mean singular value of its force matrix."""
    return float(np.mean(np.linalg.svd(B[:3, :3], compute_uv=False)))


def free_wrench(B: Array, r: Array) -> Array:
    """The wrench (n, 6) of a free tool for gravity directions `r` (n, 3) in flange axes."""
    return r @ B[:, :3].T + B[:, 3]


def affine_jacobian(r: Array) -> Array:
    """Derivative (n, 6, 24) of the free wrench with respect to B itself, row-major, for `r` (n, 3)."""
    columns = np.column_stack([r, np.ones(len(r))])
    jacobian: Array = np.einsum("ij,nk->nijk", np.eye(6), columns).reshape(len(r), 6, 24)
    return jacobian


def wrench_jacobian(tool: RigidTool, R_base_flange: Array, names: tuple[str, ...]) -> Array:
    """Derivative (n, 6, p) of the free wrench with respect to the rigid parameters `names`.

    Mounting: `R_flange_sensor @ exp([delta]x)`, sensor axes, so du = u x delta. `yaw` is the z component of delta.
    Gravity: `exp([alpha a + beta b]x) d` with `horizontal_axes` a, b.
    """
    of_R = response_jacobian(tool, names)
    of_each = R_base_flange.reshape(-1, 9) @ of_R.reshape(-1, 9).T
    J = np.zeros((len(R_base_flange), 6, len(names)))
    J[:, :, all_but_the_bias(names)] = of_each.reshape(-1, len(of_R), 6).transpose(0, 2, 1)
    J[:, :, 4:10] = np.eye(6)
    return J


@lru_cache(maxsize=FEW_TOOLS)
def response(tool: RigidTool) -> Array:
    """C (6, 9): the free wrench less the bias is `C @ vec(R_base_flange)`, row-major."""
    return read_only(response_of(wrench_matrix(tool)[:, :3], tool.gravity_direction))


def response_of(A: Array, d: Array) -> Array:
    """The same of B's first three columns (..., 6, 3) and the direction of gravity d (..., 3)."""
    C: Array = A[..., :, None, :] * d[..., None, :, None]
    return C.reshape(*C.shape[:-2], 9)


@lru_cache(maxsize=FEW_TOOLS)
def response_jacobian(tool: RigidTool, names: tuple[str, ...]) -> Array:
    """Derivative (p, 6, 9) of `response` with respect to the rigid parameters `names`, those of the bias left out."""
    R_sensor_flange, d = tool.R_flange_sensor.T, tool.gravity_direction
    force = np.zeros((9, 3, 3))
    torque = np.zeros((9, 3, 3))
    turn = ABOUT_AXES @ R_sensor_flange
    com = cross_matrix(tool.com)
    force[0], torque[0] = R_sensor_flange, com @ R_sensor_flange
    torque[1:4] = tool.weight * turn
    force[4:7] = -tool.weight * turn
    torque[4:7] = com @ force[4:7]
    a, b = horizontal_axes(d)
    J = response_of(np.concatenate([force, torque], axis=1), d)
    J[7:] = response_of(np.concatenate([force[0], torque[0]]) * tool.weight, np.stack([-b, a]))
    return read_only(J[_of_response(names)])


@cache
def _of_response(names: tuple[str, ...]) -> list[int]:
    place = {name: k for k, name in enumerate((*LINEAR_PARAMETERS[:4], *MOUNT, *GRAVITY))} | {"yaw": 6}
    return [place[name] for name in names if name in place]


@cache
def all_but_the_bias(names: tuple[str, ...]) -> list[int]:
    """Where the parameters `names` are that are not the bias."""
    return [k for k, name in enumerate(names) if not name.startswith("bias")]


@cache
def mounting_turn(names: tuple[str, ...]) -> Array:
    """How the mounting turns, about the sensor's own axes (rad), with each parameter `names`: (3, p)."""
    about = {"mount_x": 0, "mount_y": 1, "mount_z": 2, "yaw": 2}
    turn = np.zeros((3, len(names)))
    for k, name in enumerate(names):
        if name in about:
            turn[about[name], k] = 1.0
    return read_only(turn)


def matrix_jacobian(tool: RigidTool, names: tuple[str, ...]) -> Array:
    """Derivative (24, p) of B, row-major, with respect to the rigid parameters `names`: of what the response to
    R_base_flange says along gravity, whose direction does not enter B.
    """
    of_R = response_jacobian(tool, names).reshape(-1, 6, 3, 3)
    J = np.zeros((6, 4, len(names)))
    J[:, :3, all_but_the_bias(names)] = (tool.gravity_direction @ of_R).transpose(1, 2, 0)
    J[:, 3, 4:10] = np.eye(6)
    return J.reshape(24, len(names))


def stepped(tool: RigidTool, step: Array, names: tuple[str, ...]) -> RigidTool:
    """The tool after a step (p,) in the parameters `names`: additive, but on the manifold for the two rotations."""
    d = tool.gravity_direction
    if GRAVITY[0] in names:
        a, b = horizontal_axes(d)
        d = rotation_exp(step[-2] * a + step[-1] * b) @ d
    R_flange_sensor = tool.R_flange_sensor @ rotation_exp(mounting_turn(names) @ step)
    return RigidTool(tool.weight + float(step[0]), tool.com + step[1:4], tool.bias + step[4:10], R_flange_sensor, d)


def small_change_about(before: RigidTool, after: RigidTool, names: tuple[str, ...]) -> Array:
    """The parameters (p, p) of a small change about `after` from those about `before`: the horizontal axes of two
    directions of gravity may differ by a quarter turn, however close these are.
    """
    axes = np.eye(len(names))
    if GRAVITY[0] in names:
        old, new = (np.stack(horizontal_axes(tool.gravity_direction)) for tool in (before, after))
        axes[-2:, -2:] = procrustes(new @ old.T)
    return axes


FLIP = np.diag([1.0, -1.0, -1.0])
"""Half a turn about the flange's x: a sensor whose z points against the flange's, at yaw 0."""


def yaw_of_mounting(R_flange_sensor: Array) -> tuple[float, bool, Array]:
    """The paper's theta for any mounting: yaw (rad), whether the sensor's z points against the flange's, and the
    derivative (3,) of yaw with respect to a small rotation `R_flange_sensor @ exp([delta]x)`.

    The mounting is the smallest rotation that tilts z, after `Rz(yaw)` or `FLIP @ Rz(yaw)`; so yaw is the twist
    of the (unflipped) mounting about z: with its quaternion, tan(yaw / 2) = qz / qw.
    """
    flipped = bool(R_flange_sensor[2, 2] < 0.0)
    R = FLIP @ R_flange_sensor if flipped else R_flange_sensor
    qw, qz = 1.0 + np.trace(R), R[1, 0] - R[0, 1]
    qx, qy = R[2, 1] - R[1, 2], R[0, 2] - R[2, 0]
    if qw < 1e-6:
        half = 1.0 + R[2, 2] - R[0, 0] - R[1, 1]
        qw, qx, qy, qz = R[1, 0] - R[0, 1], R[0, 2] + R[2, 0], R[1, 2] + R[2, 1], half
    yaw = 2.0 * np.arctan2(qz, qw)
    twist = qw * qw + qz * qz
    derivative = np.array([(qz * qx - qw * qy) / twist, (qw * qx + qz * qy) / twist, 1.0])
    return float((yaw + np.pi) % (2.0 * np.pi) - np.pi), flipped, derivative


def stepper(B: Array, gravity_direction: Array) -> Step:
    """`Calibration.stepper` of B (6, 4) and a unit `gravity_direction` (3,), base axes, in plain floats: for one sample
    they beat numpy. The quaternion of `R_base_flange` must have unit length, which is not checked here.
    """
    dx, dy, dz = (float(part) for part in gravity_direction)
    ex, ey, ez = 2.0 * dx, 2.0 * dy, 2.0 * dz
    (
        (b00, b01, b02, b03),
        (b10, b11, b12, b13),
        (b20, b21, b22, b23),
        (b30, b31, b32, b33),
        (b40, b41, b42, b43),
        (b50, b51, b52, b53),
    ) = B.tolist()

    def step(
        fx: float, fy: float, fz: float, tx: float, ty: float, tz: float, qx: float, qy: float, qz: float, qw: float
    ) -> tuple[float, float, float, float, float, float]:
        sx = qy * ez - qz * ey
        sy = qz * ex - qx * ez
        sz = qx * ey - qy * ex
        x = dx - qw * sx + qy * sz - qz * sy
        y = dy - qw * sy + qz * sx - qx * sz
        z = dz - qw * sz + qx * sy - qy * sx
        return (
            fx - b00 * x - b01 * y - b02 * z - b03,
            fy - b10 * x - b11 * y - b12 * z - b13,
            fz - b20 * x - b21 * y - b22 * z - b23,
            tx - b30 * x - b31 * y - b32 * z - b33,
            ty - b40 * x - b41 * y - b42 * z - b43,
            tz - b50 * x - b51 * y - b52 * z - b53,
        )

    return step
