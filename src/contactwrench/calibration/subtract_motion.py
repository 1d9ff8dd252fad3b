"""Subtract what a moving tool exerts, `D @ terms`, in one pass over memory, as subtract.py does its weight."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from functools import cache
from importlib.util import find_spec
from itertools import pairwise
from typing import Any

import numpy as np

from ..geometry.arrays import Array
from ..samples.flange_motion import FlangeMotion
from ..subtract import CHUNK, FUSED_FROM, compiled_by_numba, threads


def subtract_motion(D: Array, motion: FlangeMotion, contact: Array) -> None:
    """Subtract in place.

    Args:
        D: (6, 12), N and N m for each unit of `FlangeMotion.terms`.
        motion: of n moments.
        contact: (n, 6), N and N m.
    """
    omega, alpha, acceleration = motion.angular_velocity, motion.angular_acceleration, motion.acceleration
    if len(contact) < FUSED_FROM or find_spec("numba") is None:
        for start in range(0, len(contact), CHUNK):
            rows = slice(start, start + CHUNK)
            contact[rows] -= (D @ motion.terms_of(rows)).T
        return
    kernel = _compiled()
    edges = np.linspace(0, len(contact), threads() + 1).astype(int).tolist()

    def block(edge: tuple[int, int]) -> None:
        rows = slice(*edge)
        kernel(D, omega[rows], alpha[rows], acceleration[rows], contact[rows])

    with ThreadPoolExecutor(threads()) as pool:
        list(pool.map(block, pairwise(edges)))


@cache
def _compiled() -> Any:
    from numba import types

    rows = types.Array(types.float64, 2, "C", readonly=True)
    arguments = (rows, rows, rows, rows, types.float64[:, ::1])
    options: dict[str, Any] = {"nogil": True, "error_model": "numpy", "fastmath": {"contract", "reassoc", "nsz"}}
    return compiled_by_numba(_fused, arguments, **options)


def _fused(D, omega, alpha, acceleration, contact):  # type: ignore[no-untyped-def]
    for i in range(len(contact)):
        x, y, z = omega[i, 0], omega[i, 1], omega[i, 2]
        xx, xy, xz, yy, yz, zz = x * x, x * y, x * z, y * y, y * z, z * z
        a, b, c = alpha[i, 0], alpha[i, 1], alpha[i, 2]
        d, e, f = acceleration[i, 0], acceleration[i, 1], acceleration[i, 2]
        for k in range(6):
            row = D[k]
            turning = row[0] * a + row[1] * b + row[2] * c
            spinning = row[3] * xx + row[4] * xy + row[5] * xz + row[6] * yy + row[7] * yz + row[8] * zz
            contact[i, k] -= turning + spinning + row[9] * d + row[10] * e + row[11] * f
    return 0
