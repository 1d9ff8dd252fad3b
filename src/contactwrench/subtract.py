"""Compensation: the contact wrench is the reading less what a free tool would read at that orientation.

Whatever was identified is in B (6, 4): the free wrench is `B @ [r, 1]` with `r = R_base_flange^T d`. A batch takes one
pass over memory: in numpy by chunks that stay in the cache, or fused with the `fast` extra. The step for one sample
at a time is plain Python floats, which beat numpy there. For a unit quaternion with vector part v and scalar part w,

    r = d - w t + v x t,    t = 2 v x d
"""

from __future__ import annotations

from collections.abc import Callable
from importlib.util import find_spec
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from .errors import InputError
from .geometry.arrays import Array
from .geometry.orientation import ROTATION_TOLERANCE, OrientationLike, nearest_rotations
from .geometry.wrench import cross_matrix, wrench_rows

CHUNK = 8192
"""Samples of a numpy chunk: its rows fill, and do not overflow, a second-level cache of 1 MiB."""
SQUARED_TOLERANCE = 2.0 * ROTATION_TOLERANCE
FUSED_FROM = 50_000
"""Samples from which compiling and starting threads pays."""

Step: TypeAlias = Callable[
    [float, float, float, float, float, float, float, float, float, float],
    tuple[float, float, float, float, float, float],
]


def compensate(
    B: Array,
    gravity_direction: Array,
    wrench: ArrayLike,
    orientation: OrientationLike,
    out: Array | None = None,
) -> Array:
    """The contact wrench (n, 6) of readings (n, 6), sensor axes, or (6,) of one.

    `orientation`: `R_base_flange` as matrices (n, 3, 3), quaternions x, y, z, w (n, 4) or a scipy Rotation, or one
    of them for all readings. `out` (n, 6) float64 receives the result, and may be `wrench` itself. A NaN in a
    reading stays in its row. Raises `InputError` on shapes that do not pair, and on an orientation off unit length by
    more than 1 % or NaN; `out` is then filled in part. Of 50,000 matrices and more only the length is checked.
    """
    readings, single = wrench_rows(wrench)
    if not len(readings):
        return readings.copy() if out is None else out
    parts = _orientation_parts(orientation, len(readings))
    if out is None:
        result = np.empty_like(readings)
    else:
        result = out[None] if single and out.shape == (6,) else out
        if result.shape != readings.shape or result.dtype != np.float64 or not result.flags.c_contiguous:
            raise InputError(
                f"out has shape {out.shape} and type {out.dtype}, expected {readings.shape} float64, C order"
            )
    if len(readings) >= FUSED_FROM and find_spec("numba") is not None:
        from .subtract_fused import compensate_fused

        fine = compensate_fused(B, gravity_direction, readings, parts, result)
    else:
        fine = _compensate_chunks(B, gravity_direction, readings, parts, result)
    if not fine:
        _refuse_first_off_unit(parts)
    if out is not None:
        return out
    return result[0] if single else result


def _orientation_parts(orientation: OrientationLike, n: int) -> Array:
    """Quaternions (n, 4) or row-major matrices (n, 9) as they were given; one orientation counts for all."""
    if hasattr(orientation, "as_quat"):
        orientation = orientation.as_quat()
    values = np.asarray(orientation, dtype=np.float64)
    if values.shape in {(4,), (3, 3)}:
        return np.broadcast_to(values.reshape(1, -1), (n, values.size))
    if values.shape == (n, 4):
        return values
    if values.shape == (n, 3, 3):
        return (nearest_rotations(values) if n < FUSED_FROM else values).reshape(n, 9)
    raise InputError(
        f"orientation has shape {values.shape}, expected ({n}, 3, 3) rotation matrices or ({n}, 4) quaternions "
        f"x, y, z, w for {n} readings"
    )


def _compensate_chunks(B: Array, gravity_direction: Array, readings: Array, parts: Array, result: Array) -> bool:
    """Fill `result` (n, 6) chunk by chunk; whether every orientation is one (the last chunk done is the first not)."""
    Bt = np.ascontiguousarray(B.T)
    into_r = _gravity_from_quaternions if parts.shape[1] == 4 else _gravity_from_matrices
    r_one, free = np.ones((4, CHUNK)), np.empty((CHUNK, 6))
    for start in range(0, len(readings), CHUNK):
        rows = slice(start, min(start + CHUNK, len(readings)))
        m = rows.stop - start
        with np.errstate(all="ignore"):
            squared = into_r(parts[rows], gravity_direction, r_one[:3, :m])
        if not (squared.max() <= 1.0 + SQUARED_TOLERANCE and squared.min() >= 1.0 - SQUARED_TOLERANCE):
            return False
        np.matmul(r_one[:, :m].T, Bt, out=free[:m])
        np.subtract(readings[rows], free[:m], out=result[rows])
    return True


def _gravity_from_quaternions(quat_xyzw: Array, d: Array, r: Array) -> Array:
    """Fill `r` (3, m) from quaternions (m, 4) of any length; their squared lengths (m,)."""
    parts = np.ascontiguousarray(quat_xyzw.T)
    squared: Array = np.einsum("km,km->m", parts, parts)
    x, y, z, w = parts
    t = np.zeros((3, 4))
    t[:, :3] = -2.0 * cross_matrix(d)
    tx, ty, tz = np.divide(t @ parts, squared)
    product = np.empty_like(x)
    for row, (a, ta, b, tb, tw) in enumerate(((y, tz, z, ty, tx), (z, tx, x, tz, ty), (x, ty, y, tx, tz))):
        np.multiply(a, ta, out=r[row])
        r[row] -= np.multiply(b, tb, out=product)
        r[row] -= np.multiply(w, tw, out=product)
        r[row] += d[row]
    return squared


def _gravity_from_matrices(matrices: Array, d: Array, r: Array) -> Array:
    """Fill `r` (3, m) from row-major matrices (m, 9); a third of the sum of their squares (m,)."""
    np.matmul(np.kron(d, np.eye(3)), matrices.T, out=r)
    squared: Array = np.einsum("mk,mk->m", matrices, matrices) / 3.0
    return squared


def _refuse_first_off_unit(parts: Array) -> None:
    what, unit = ("quaternion", 1.0) if parts.shape[1] == 4 else ("matrix", 3.0)
    with np.errstate(all="ignore"):
        squared = np.einsum("ni,ni->n", parts, parts) / unit
        row = int(np.argmax(~(np.abs(squared - 1.0) <= SQUARED_TOLERANCE)))
        length = float(np.sqrt(squared[row]))
    raise InputError(
        f"orientation {row} is a {what} of length {length:.6g}, expected 1 within 1 %: check the order of its parts, "
        "and leave out samples without an orientation",
        row,
    )


def stepper(B: Array, gravity_direction: Array) -> Step:
    """A function for one sample: `step(fx, fy, fz, tx, ty, tz, qx, qy, qz, qw)` gives the contact wrench as six floats.

    The quaternion of `R_base_flange` must have unit length: it is not checked here.
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
        fx: float,
        fy: float,
        fz: float,
        tx: float,
        ty: float,
        tz: float,
        qx: float,
        qy: float,
        qz: float,
        qw: float,
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
