"""Compensation of one sample at a time in plain Python floats, which beat numpy there."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

from ..geometry.arrays import Array

Step: TypeAlias = Callable[
    [float, float, float, float, float, float, float, float, float, float],
    tuple[float, float, float, float, float, float],
]


def stepper(B: Array, gravity_direction: Array) -> Step:
    """`Calibration.stepper` of B (6, 4) and a unit `gravity_direction` (3,), base axes: the quaternion of
    `R_base_flange` must have unit length, which is not checked here.
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
