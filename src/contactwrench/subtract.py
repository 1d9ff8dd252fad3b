"""Compensation: the contact wrench is the reading less what a free tool would read at that orientation.

Whatever was identified is in B (6, 4): the free wrench is `B @ [r, 1]` with `r = R_base_flange^T d`. A batch takes one
pass over memory: in numpy by chunks that stay in the cache, or fused by numba (extra `fast`). The step for one sample
at a time is plain Python floats, which beat numpy there. For a unit quaternion with vector part v and scalar part w,

    r = d - w t + v x t,    t = 2 v x d
"""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import cache
from importlib.util import find_spec
from itertools import pairwise
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from .errors import InputError
from .geometry.arrays import Array, numbers
from .geometry.orientation import (
    ROTATION_TOLERANCE,
    OrientationLike,
    nearest_rotations,
    require_rotations,
    require_unit,
)
from .geometry.wrench import cross_matrix, wrench_rows

CHUNK = 8192
"""Samples of a numpy chunk: its rows fill, and do not overflow, a second-level cache of 1 MiB."""
SURELY_UNIT, SURELY_ROTATION = 1.0 - (1.0 - ROTATION_TOLERANCE) ** 2, (0.5 * ROTATION_TOLERANCE) ** 2
"""What is no further off surely is an orientation within 1 %: a quaternion's squared length off 1; of a matrix z off
x cross y and x and y off unit and square, squares summed. Of the rest the slower `require_rotations` decides.
"""
FUSED_FROM = 50_000
"""Samples from which compiling and starting threads pays."""
MAX_THREADS = 8

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
    """The contact wrench of readings. A NaN in a reading stays in its row.

    Args:
        B: what was identified, (6, 4).
        gravity_direction: (3,) unit vector, base axes.
        wrench: readings (n, 6), or (6,) of one, N and N m, sensor axes.
        orientation: `R_base_flange` as matrices (n, 3, 3), quaternions x, y, z, w (n, 4) or a scipy Rotation, or one of
            them for all readings. From 50,000 on, matrices that are rotations within 1 % are taken as they are.
        out: (n, 6) float64, C order, which receives the result; it may be `wrench` itself, and shares no memory else.

    Returns:
        (n, 6), or (6,) of one, N and N m, sensor axes.

    Raises:
        InputError: shapes that do not pair; an orientation that is none by over 1 % or NaN, `out` filled in part.
    """
    readings, single = wrench_rows(wrench)
    if not len(readings) and out is None:
        return readings.copy()
    parts = _orientation_parts(orientation, len(readings))
    result = np.empty_like(readings) if out is None else _rows_of(out, single, readings, parts)
    if len(readings) >= FUSED_FROM and find_spec("numba") is not None:
        fine = _compensate_fused(B, gravity_direction, readings, parts, result)
    else:
        fine = _compensate_chunks(B, gravity_direction, readings, parts, result)
    if not fine:
        (require_unit if parts.shape[1] == 4 else require_rotations)(parts)
    if out is not None:
        return out
    return result[0] if single else result


def _rows_of(out: Array, single: bool, readings: Array, parts: Array) -> Array:
    """`out` as rows like the readings. Raises `InputError` where the result cannot be written there."""
    if not isinstance(out, np.ndarray) or isinstance(out, np.ma.MaskedArray):
        raise InputError(f"out is a {type(out).__name__}, expected {readings.shape} float64, C order")
    result = out[None] if single and out.shape == (6,) else out
    if result.shape != readings.shape or result.dtype != np.float64 or not result.flags.c_contiguous:
        raise InputError(f"out has shape {out.shape} and type {out.dtype}, expected {readings.shape} float64, C order")
    if not out.flags.writeable:
        raise InputError("out is read-only, expected an array that can be written to: pass a copy")
    there, from_there = result.__array_interface__["data"], readings.__array_interface__["data"]
    in_place = there == from_there and result.strides == readings.strides
    if np.may_share_memory(result, parts) or (np.may_share_memory(result, readings) and not in_place):
        raise InputError("out overlaps with what is read, expected wrench itself or memory of its own: pass a copy")
    return result


def _orientation_parts(orientation: OrientationLike, n: int) -> Array:
    """Quaternions (n, 4) or row-major matrices (n, 9) as they were given; one orientation counts for all."""
    if hasattr(orientation, "as_quat"):
        orientation = orientation.as_quat()
    values = numbers(orientation, "orientation")
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
    """Fill `result` (n, 6) chunk by chunk; whether every orientation surely is one."""
    Bt = np.ascontiguousarray(B.T)
    into_r = _gravity_from_quaternions if parts.shape[1] == 4 else _gravity_from_matrices
    r_one, free, fine = np.ones((4, CHUNK)), np.empty((CHUNK, 6)), True
    with np.errstate(all="ignore"):
        for start in range(0, len(readings), CHUNK):
            rows = slice(start, min(start + CHUNK, len(readings)))
            m = rows.stop - start
            fine &= into_r(np.ascontiguousarray(parts[rows].T), gravity_direction, r_one[:3, :m])
            np.matmul(r_one[:, :m].T, Bt, out=free[:m])
            np.subtract(readings[rows], free[:m], out=result[rows])
    return fine


def _gravity_from_quaternions(parts: Array, d: Array, r: Array) -> bool:
    """Fill `r` (3, m) from quaternions (4, m) of any length; whether it surely is 1."""
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
    return bool(np.abs(squared - 1.0).max() <= SURELY_UNIT)


def _gravity_from_matrices(parts: Array, d: Array, r: Array) -> bool:
    """Fill `r` (3, m) from row-major matrices (9, m); whether these surely are rotations."""
    np.matmul(np.kron(d, np.eye(3)), parts, out=r)
    x, y, z = parts.reshape(3, 3, -1).swapaxes(0, 1)
    squares = np.zeros(parts.shape[1])
    for k, (i, j) in enumerate(((1, 2), (2, 0), (0, 1))):
        squares += (x[i] * y[j] - x[j] * y[i] - z[k]) ** 2
    for a, b, unit in ((x, x, 1.0), (y, y, 1.0), (x, y, 0.0)):
        squares += (np.einsum("im,im->m", a, b) - unit) ** 2
    return bool(squares.max() <= SURELY_ROTATION)


def _compensate_fused(B: Array, gravity_direction: Array, readings: Array, parts: Array, result: Array) -> bool:
    """The same by numba, on as many threads as there are cores.

    The kernel releases the interpreter and shares nothing, so plain Python threads run it; numba's own threading layers
    would not be safe to call from several threads of a user's program at once.
    """
    from concurrent.futures import ThreadPoolExecutor

    from numba import typeof

    types = tuple(map(typeof, (B, gravity_direction, readings, parts, result)))
    kernel = _compiled(_fused_from_quaternions if parts.shape[1] == 4 else _fused_from_matrices, types)
    edges = np.linspace(0, len(readings), threads() + 1).astype(int).tolist()

    def doubtful_in(block: tuple[int, int]) -> int:
        rows = slice(*block)
        return kernel(B, gravity_direction, readings[rows], parts[rows], result[rows])

    with ThreadPoolExecutor(threads()) as pool:
        return sum(pool.map(doubtful_in, pairwise(edges))) == 0


def threads() -> int:
    """How many run side by side."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min(MAX_THREADS, cores)


@cache
def _compiled(kernel: Callable[..., int], types: tuple[Any, ...]) -> Callable[..., int]:
    return compiled_by_numba(kernel, types, nogil=True, error_model="numpy", fastmath={"contract", "reassoc", "nsz"})


def compiled_by_numba(function: Callable[..., int], types: tuple[Any, ...], **options: Any) -> Callable[..., int]:
    """A function for arguments of these types, kept on disk for the next time where that can be."""
    from numba import njit

    try:
        kept = njit(cache=True, **options)(function)
        kept.compile(types)
    except Exception:  # no folder that can be written, a full disk, or what is kept is damaged
        kept = njit(**options)(function)
        kept.compile(types)
    compiled: Callable[..., int] = kept
    return compiled


def _fused_from_quaternions(B, d, readings, quat_xyzw, result):  # type: ignore[no-untyped-def]
    dx, dy, dz = d[0], d[1], d[2]
    ex, ey, ez = 2.0 * dx, 2.0 * dy, 2.0 * dz
    doubtful = 0
    for i in range(len(readings)):
        x, y, z, w = quat_xyzw[i, 0], quat_xyzw[i, 1], quat_xyzw[i, 2], quat_xyzw[i, 3]
        squared = x * x + y * y + z * z + w * w
        scale = 1.0 / squared
        tx, ty, tz = (y * ez - z * ey) * scale, (z * ex - x * ez) * scale, (x * ey - y * ex) * scale
        rx = dx - w * tx + y * tz - z * ty
        ry = dy - w * ty + z * tx - x * tz
        rz = dz - w * tz + x * ty - y * tx
        for k in range(6):
            result[i, k] = readings[i, k] - B[k, 0] * rx - B[k, 1] * ry - B[k, 2] * rz - B[k, 3]
        doubtful += not abs(squared - 1.0) <= SURELY_UNIT
    return doubtful


def _fused_from_matrices(B, d, readings, matrices, result):  # type: ignore[no-untyped-def]
    dx, dy, dz = d[0], d[1], d[2]
    doubtful = 0
    for i in range(len(readings)):
        R = matrices[i]
        rx = dx * R[0] + dy * R[3] + dz * R[6]
        ry = dx * R[1] + dy * R[4] + dz * R[7]
        rz = dx * R[2] + dy * R[5] + dz * R[8]
        for k in range(6):
            result[i, k] = readings[i, k] - B[k, 0] * rx - B[k, 1] * ry - B[k, 2] * rz - B[k, 3]
        x, y, z = R[3] * R[7] - R[6] * R[4] - R[2], R[6] * R[1] - R[0] * R[7] - R[5], R[0] * R[4] - R[3] * R[1] - R[8]
        xx = R[0] * R[0] + R[3] * R[3] + R[6] * R[6] - 1.0
        yy = R[1] * R[1] + R[4] * R[4] + R[7] * R[7] - 1.0
        xy = R[0] * R[1] + R[3] * R[4] + R[6] * R[7]
        doubtful += not x * x + y * y + z * z + xx * xx + yy * yy + xy * xy <= SURELY_ROTATION
    return doubtful


def stepper(B: Array, gravity_direction: Array) -> Step:
    """Compensation of one sample at a time.

    Args:
        B: what was identified, (6, 4).
        gravity_direction: (3,) unit vector, base axes.

    Returns:
        `step(fx, fy, fz, tx, ty, tz, qx, qy, qz, qw)`, which gives the contact wrench as six floats. The quaternion of
        `R_base_flange` must have unit length: it is not checked here.
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
