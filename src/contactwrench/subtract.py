"""Compensation: the contact wrench is the reading less what a free tool would read at that orientation and motion.

Whatever was identified is in B (6, 4): the free wrench is `B @ [r, 1]` with `r = R_base_flange^T d`, and in motion
`[B D] @ [r, 1, terms]`. A batch takes one pass over memory, in numpy and by numba (extra `fast`) alike: chunk by chunk,
which stay in the cache, the columns that the matrix multiplies, the product, the difference. For a unit quaternion with
vector part v and scalar part w,

    r = d - w t + v x t,    t = 2 v x d
"""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import cache
from itertools import pairwise
from math import prod
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from .errors import InputError, has_compiler
from .geometry.arrays import Array
from .geometry.orientation import (
    ROTATION_TOLERANCE,
    OrientationLike,
    nearest_rotations,
    numbers_of,
    require_rotations,
    require_unit,
)
from .geometry.wrench import cross_matrix, result_rows, wrench_rows

if TYPE_CHECKING:
    from .samples.flange_motion import FlangeMotion

CHUNK = 8192
"""Samples of a numpy chunk: its rows fill, and do not overflow, a second-level cache of 1 MiB."""
SURELY_UNIT, SURELY_ROTATION = 1.0 - (1.0 - ROTATION_TOLERANCE) ** 2, (0.5 * ROTATION_TOLERANCE) ** 2
"""What is no further off surely is an orientation within 1 %: a quaternion's squared length off 1; of a matrix z off
x cross y and x and y off unit and square, squares summed. Of the rest the slower `require_rotations` decides.
"""
FUSED_FROM = 50_000
"""Samples from which compiling and starting threads pays."""
BLOCK = 32
"""Samples of a compiled chunk: 64 run alike from the cache, and 1.4 times slower from memory."""
MAX_THREADS = 8


def compensate(
    matrix: Array,
    gravity_direction: Array,
    wrench: ArrayLike,
    orientation: OrientationLike,
    out: Array | None = None,
    motion: FlangeMotion | None = None,
) -> Array:
    """The contact wrench of readings. A NaN in a reading stays in its row.

    Args:
        matrix: what was identified, B (6, 4), with a motion [B D] (6, 16).
        gravity_direction: (3,) unit vector, base axes.
        wrench: readings (n, 6), (6,) of one, or (..., 6) of a batch of sequences, N and N m, sensor axes.
        orientation: `R_base_flange` as matrices (n, 3, 3), quaternions x, y, z, w (n, 4) or a scipy Rotation, shaped as
            the readings, or one for all. From 50,000 on, matrices that are rotations within 1 % are taken as they are.
        out: as `wrench`, float64, C order, receives the result; it may be `wrench` itself, and shares no memory else.
        motion: of the flange at the moments of the n readings; None: it is at rest.

    Returns:
        As `wrench`, N and N m, sensor axes.

    Raises:
        InputError: shapes that do not pair; an orientation that is none by over 1 % or NaN, `out` filled in part.
    """
    readings, leading = wrench_rows(wrench)
    if not len(readings) and out is None:
        return np.empty((*leading, 6))
    if motion is not None and len(motion) != len(readings):
        raise InputError(f"found {len(motion)} moments of motion, expected {len(readings)}, one for each reading")
    parts = _orientation_parts(orientation, leading or (1,))
    result = np.empty_like(readings) if out is None else result_rows(out, leading, readings, parts)
    if len(readings) >= FUSED_FROM and has_compiler():
        fine = _compensate_fused(matrix, gravity_direction, readings, parts, motion, result)
    else:
        fine = _compensate_chunks(matrix, gravity_direction, readings, parts, motion, result)
    if not fine:
        (require_unit if parts.shape[1] == 4 else require_rotations)(parts)
    return result.reshape(*leading, 6) if out is None else out


def _orientation_parts(orientation: OrientationLike, leading: tuple[int, ...]) -> Array:
    """Quaternions (n, 4) or row-major matrices (n, 9) as they were given; one orientation counts for all."""
    values, n = numbers_of(orientation), prod(leading)
    if values.shape in {(4,), (3, 3)}:
        return np.broadcast_to(values.reshape(1, -1), (n, values.size))
    if values.shape == (*leading, 4):
        return values.reshape(n, 4)
    if values.shape == (*leading, 3, 3):
        matrices = values.reshape(n, 3, 3)
        return (nearest_rotations(matrices) if n < FUSED_FROM else matrices).reshape(n, 9)
    of_each = ", ".join(map(str, leading))
    raise InputError(
        f"orientation has shape {values.shape}, expected ({of_each}, 3, 3) rotation matrices or ({of_each}, 4) "
        f"quaternions x, y, z, w for {n} readings"
    )


def _compensate_chunks(
    matrix: Array, d: Array, readings: Array, parts: Array, motion: FlangeMotion | None, out: Array
) -> bool:
    """Fill `out` (n, 6) chunk by chunk; whether every orientation surely is one."""
    transposed = np.ascontiguousarray(matrix.T)
    into_r = _gravity_from_quaternions if parts.shape[1] == 4 else _gravity_from_matrices
    columns, free, fine = np.ones((len(transposed), CHUNK)), np.empty((CHUNK, 6)), True
    with np.errstate(all="ignore"):
        for start in range(0, len(readings), CHUNK):
            rows = slice(start, min(start + CHUNK, len(readings)))
            m = rows.stop - start
            fine &= into_r(np.ascontiguousarray(parts[rows].T), d, columns[:3, :m])
            if motion is not None:
                columns[4:, :m] = motion.terms_of(rows)
            np.matmul(columns[:, :m].T, transposed, out=free[:m])
            np.subtract(readings[rows], free[:m], out=out[rows])
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


def _compensate_fused(
    matrix: Array, d: Array, readings: Array, parts: Array, motion: FlangeMotion | None, out: Array
) -> bool:
    """The same by numba, on as many threads as there are cores.

    The kernel releases the interpreter and shares nothing, so plain Python threads run it; numba's own threading layers
    would not be safe to call from several threads of a user's program at once.
    """
    from concurrent.futures import ThreadPoolExecutor

    from numba import typeof

    still = (np.empty((0, 3)),) * 3
    moves = still if motion is None else (motion.angular_acceleration, motion.angular_velocity, motion.acceleration)
    whole = [_unwritten(matrix), _unwritten(d)]
    of_rows = [*(_unwritten(values) for values in (readings, parts, *moves)), out]
    layout = "C" if all(values.flags.c_contiguous for values in of_rows) else "A"  # any: to compile one takes a second
    kernel = _compiled((*map(typeof, whole), *(rows.copy(layout=layout) for rows in map(typeof, of_rows))))
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    edges = np.linspace(0, len(readings), min(MAX_THREADS, cores) + 1).astype(int).tolist()
    with ThreadPoolExecutor(len(edges) - 1) as pool:
        doubtful = pool.map(lambda block: kernel(*whole, *(rows[slice(*block)] for rows in of_rows)), pairwise(edges))
        return sum(doubtful) == 0


def _unwritten(values: Array) -> Array:
    """A view that cannot be written to, so that one compiled kernel does for arrays that can be and that cannot."""
    view = values.view()
    view.flags.writeable = False
    return view


@cache
def _compiled(types: tuple[Any, ...]) -> Callable[..., int]:
    return compiled_by_numba(_fused, types, nogil=True, no_cfunc_wrapper=True, **_options())


@cache
def _options() -> dict[str, Any]:
    """Of compiling the kernel and what it calls, which is named to numba once."""
    from numba.extending import register_jitable

    options: dict[str, Any] = {"error_model": "numpy", "fastmath": {"contract", "reassoc", "nsz"}}
    for function in (_fused_from_quaternions, _fused_from_matrices, _fused_terms, _fused_product):
        register_jitable(no_cfunc_wrapper=True, no_cpython_wrapper=True, **options)(function)
    return options


def compiled_by_numba(function: Callable[..., int], types: tuple[Any, ...], **options: Any) -> Callable[..., int]:
    """A function for arguments of these types, kept on disk for the next time where that can be."""
    from numba import njit

    try:
        kept = njit(cache=True, **options)(function)
        kept.compile(types)
    except Exception:  # no folder that can be written, a full disk, or what is kept is damaged
        kept = njit(**options)(function)
        kept.compile(types)
    kept.disable_compile()  # what can be taken for these types is
    compiled: Callable[..., int] = kept
    return compiled


compiled_by_numba.__code__ = compiled_by_numba.__code__.replace(co_stacksize=16_000)
"""With room for the frames of all that it calls: Python takes and gives back memory for frames by 16 kB, and where a
compiler calls to and fro over that border it is a tenth of its time, by mere luck."""


def _fused(
    matrix: Array, d: Array, readings: Array, parts: Array, alpha: Array, omega: Array, acceleration: Array, out: Array
) -> int:
    """Fill `out` of some rows; how many of their orientations are doubtful."""
    columns, free, doubtful = np.ones(16 * BLOCK), np.empty(6 * BLOCK), 0  # flat, so that the compiler knows each row
    for start in range(0, len(readings), BLOCK):
        stop = min(start + BLOCK, len(readings))
        if parts.shape[1] == 4:
            doubtful += _fused_from_quaternions(parts[start:stop], d, columns)
        else:
            doubtful += _fused_from_matrices(parts[start:stop], d, columns)
        if matrix.shape[1] == 16:
            _fused_terms(alpha[start:stop], omega[start:stop], acceleration[start:stop], columns)
        _fused_product(matrix, columns, free)
        for i in range(stop - start):
            for k in range(6):
                out[start + i, k] = readings[start + i, k] - free[k * BLOCK + i]
    return doubtful


def _fused_from_quaternions(quat_xyzw: Array, d: Array, columns: Array) -> int:
    dx, dy, dz = d[0], d[1], d[2]
    ex, ey, ez = 2.0 * dx, 2.0 * dy, 2.0 * dz
    doubtful = 0
    for i in range(len(quat_xyzw)):
        x, y, z, w = quat_xyzw[i, 0], quat_xyzw[i, 1], quat_xyzw[i, 2], quat_xyzw[i, 3]
        squared = x * x + y * y + z * z + w * w
        scale = 1.0 / squared
        tx, ty, tz = (y * ez - z * ey) * scale, (z * ex - x * ez) * scale, (x * ey - y * ex) * scale
        columns[i] = dx - w * tx + y * tz - z * ty
        columns[BLOCK + i] = dy - w * ty + z * tx - x * tz
        columns[2 * BLOCK + i] = dz - w * tz + x * ty - y * tx
        doubtful += not abs(squared - 1.0) <= SURELY_UNIT
    return doubtful


def _fused_from_matrices(matrices: Array, d: Array, columns: Array) -> int:
    dx, dy, dz, doubtful = d[0], d[1], d[2], 0
    for i in range(len(matrices)):
        R = matrices[i]
        x, y, z = R[3] * R[7] - R[6] * R[4] - R[2], R[6] * R[1] - R[0] * R[7] - R[5], R[0] * R[4] - R[3] * R[1] - R[8]
        xx = R[0] * R[0] + R[3] * R[3] + R[6] * R[6] - 1.0
        yy = R[1] * R[1] + R[4] * R[4] + R[7] * R[7] - 1.0
        xy = R[0] * R[1] + R[3] * R[4] + R[6] * R[7]
        doubtful += not x * x + y * y + z * z + xx * xx + yy * yy + xy * xy <= SURELY_ROTATION
        for k in range(3):
            columns[k * BLOCK + i] = dx * R[k] + dy * R[3 + k] + dz * R[6 + k]
    return doubtful


def _fused_terms(alpha: Array, omega: Array, acceleration: Array, columns: Array) -> None:
    for i in range(len(omega)):
        x, y, z = omega[i, 0], omega[i, 1], omega[i, 2]
        for k, product in enumerate((x * x, x * y, x * z, y * y, y * z, z * z)):
            columns[(7 + k) * BLOCK + i] = product
        for k in range(3):
            columns[(4 + k) * BLOCK + i] = alpha[i, k]
            columns[(13 + k) * BLOCK + i] = acceleration[i, k]


def _fused_product(matrix: Array, columns: Array, free: Array) -> None:
    for k in range(6):
        row = matrix[k]
        for i in range(BLOCK):
            total = 0.0
            for j in range(4):
                total += row[j] * columns[j * BLOCK + i]
            free[k * BLOCK + i] = total
        if len(row) == 16:
            for i in range(BLOCK):
                total = free[k * BLOCK + i]
                for j in range(4, 16):
                    total += row[j] * columns[j * BLOCK + i]
                free[k * BLOCK + i] = total
