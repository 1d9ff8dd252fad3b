"""The tool as programs want it: a rigid body on the sensor, and numbers that read back exactly; and how far off the
contact wrench is where a program cannot express all of a calibration.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from ...calibration.calibration import Calibration
from ...errors import InputError
from ...geometry.arrays import Array
from ...geometry.rotations import procrustes, spread_rotations
from ...model import RigidTool
from .target import Setup

DOWN = np.array([0.0, 0.0, -1.0])
"""Gravity of programs that take the base for upright, base axes."""
ROUNDING = 1e-6
"""N and N m: a smaller error is that of rounded numbers, and not worth a remark."""
STARTS, MOST_STEPS = 24, 2000
LEAST_GAIN = 1e-10
"""Relative, a step: where the climb ends, which is then within 1e-6 of the top."""


def rigid_tool(calibration: Calibration, setup: Setup, target: str) -> RigidTool:
    """The identified tool, with the weight of the `tool_mass` that was stated; its centre of mass stays. Raises
    `InputError`, naming the `target` that asks, for a model that has no mass.
    """
    if (tool := calibration.rigid_tool) is None:
        without = "" if setup.tool_mass is None else ", without --tool-mass"
        raise InputError(
            f"{target} takes a mass and a centre of mass, found model {calibration.model}, which has none: calibrate "
            f"with --model auto, or export B itself with --to c, python or matlab{without}"
        )
    return tool if setup.tool_mass is None else replace(tool, weight=setup.tool_mass * calibration.g)


def roll_pitch_yaw(R: Array) -> Array:
    """The angles (3,), rad, of `Rz(yaw) Ry(pitch) Rx(roll)`, as in URDF's `rpy`; exact also at a pitch of 90 deg."""
    yaw = np.arctan2(R[1, 0], R[0, 0])
    c, s = np.cos(yaw), np.sin(yaw)
    pitch = np.arctan2(-R[2, 0], c * R[0, 0] + s * R[1, 0])
    roll = np.arctan2(s * R[0, 2] - c * R[1, 2], c * R[1, 1] - s * R[0, 1])
    return np.array([roll, pitch, yaw])


def number(value: float) -> str:
    """A number in the shortest form that reads back exactly, a float for every reader of YAML: with a point."""
    digits, power, exponent = repr(float(value) + 0.0).partition("e")
    return f"{digits if '.' in digits else f'{digits}.0'}{power}{exponent}"


def numbers(values: ArrayLike, between: str = ", ") -> str:
    """Numbers in a row, as `number` writes them."""
    return between.join(number(value) for value in np.ravel(values))


def mounting_remark(tool: RigidTool, frame: str) -> str:
    """How the sensor's frame has to stand in the robot's description."""
    rpy = numbers(roll_pitch_yaw(tool.R_flange_sensor), " ")
    return f'the robot\'s description must turn {frame} against the flange of the recording by rpy="{rpy}" (rad, URDF)'


def largest_error(calibration: Calibration, B: Array, gravity_direction: Array) -> tuple[float, float]:
    """How far off contact force, N, and torque, N m, are at most, each a norm, over all orientations and to a relative
    1e-6, where a program subtracts `B @ [r, 1]` in place of the calibration's free wrench: B (6, 4) in sensor axes, and
    `r = R_base_flange.T @ gravity_direction`, a unit vector (3,) in base axes.
    """
    wrong = np.einsum("ij,k->ijk", B[:, :3], gravity_direction)
    right = np.einsum("ij,k->ijk", calibration.B[:, :3], calibration.gravity_direction)
    slope, constant = wrong - right, B[:, 3] - calibration.bias
    return _largest(slope[:3], constant[:3]), _largest(slope[3:], constant[3:])


def _largest(slope: Array, constant: Array) -> float:
    """The largest norm of `slope[i, j, k] R[k, j] + constant[i]` over all rotations R.

    Its square is convex in R. So the rotation that has most in common with the gradient is never worse than the one
    before: from the best of a dense set of rotations these steps climb to the largest.
    """
    R = spread_rotations(288, 24)
    error = _error(slope, constant, R)
    R = R[np.argsort(np.linalg.norm(error, axis=1))[-STARTS:]]
    largest = 0.0
    for _ in range(MOST_STEPS):
        error = _error(slope, constant, R)
        before, largest = largest, float(np.linalg.norm(error, axis=1).max())
        if largest <= before * (1.0 + LEAST_GAIN):
            break
        R = procrustes(np.einsum("ijk,ni->nkj", slope, error))
    return largest


def _error(slope: Array, constant: Array, R: Array) -> Array:
    """The error (n, 3) at rotations (n, 3, 3)."""
    return np.asarray(np.einsum("ijk,nkj->ni", slope, R) + constant)
