"""The batch kernel in one pass over memory, compiled by numba (extra `fast`), on as many threads as there are cores.

The kernel releases the interpreter and shares nothing between threads, so plain Python threads run it; numba's own
threading layers would not be safe to call from several threads of a user's program at once.
"""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise

import numba
import numpy as np

from .geometry.arrays import Array
from .geometry.orientation import ROTATION_TOLERANCE

MAX_THREADS = 8
SQUARED_TOLERANCE = 2.0 * ROTATION_TOLERANCE


_compiled = numba.njit(nogil=True, cache=True, error_model="numpy", fastmath={"contract", "reassoc", "nsz"})


@_compiled
def _from_quaternions(B, d, readings, quat_xyzw, result):  # type: ignore[no-untyped-def]
    dx, dy, dz = d[0], d[1], d[2]
    ex, ey, ez = 2.0 * dx, 2.0 * dy, 2.0 * dz
    wrong = 0
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
        wrong += not abs(squared - 1.0) <= SQUARED_TOLERANCE
    return wrong


@_compiled
def _from_matrices(B, d, readings, matrices, result):  # type: ignore[no-untyped-def]
    dx, dy, dz = d[0], d[1], d[2]
    wrong = 0
    for i in range(len(readings)):
        R = matrices[i]
        rx = dx * R[0] + dy * R[3] + dz * R[6]
        ry = dx * R[1] + dy * R[4] + dz * R[7]
        rz = dx * R[2] + dy * R[5] + dz * R[8]
        squared = 0.0
        for j in range(9):
            squared += R[j] * R[j]
        for k in range(6):
            result[i, k] = readings[i, k] - B[k, 0] * rx - B[k, 1] * ry - B[k, 2] * rz - B[k, 3]
        wrong += not abs(squared / 3.0 - 1.0) <= SQUARED_TOLERANCE
    return wrong


def compensate_fused(B: Array, gravity_direction: Array, readings: Array, parts: Array, result: Array) -> bool:
    """Fill `result` (n, 6); whether every orientation is one: none off unit length by over 1 %, none NaN.

    `parts` are quaternions (n, 4) or row-major matrices (n, 9).
    """
    kernel = _from_quaternions if parts.shape[1] == 4 else _from_matrices
    threads = min(MAX_THREADS, _usable_cores())
    edges = np.linspace(0, len(readings), threads + 1).astype(int).tolist()

    def run(block: tuple[int, int]) -> int:
        rows = slice(*block)
        return int(kernel(B, gravity_direction, readings[rows], parts[rows], result[rows]))

    with ThreadPoolExecutor(threads) as pool:
        return sum(pool.map(run, pairwise(edges))) == 0


def _usable_cores() -> int:
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
