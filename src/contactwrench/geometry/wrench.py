"""Move a wrench between frames and points; the gravity of a payload.

A wrench is `[fx fy fz tx ty tz]`, N and N m, what tool and environment exert ON the sensor.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError
from .arrays import Array, numbers

WRENCH_AXES = ("fx", "fy", "fz", "tx", "ty", "tz")
STANDARD_GRAVITY = 9.80665
"""m/s^2, by definition (3rd CGPM, 1901)."""


def cross_matrix(v: ArrayLike) -> Array:
    """`[v]x`, (..., 3, 3), with `[v]x @ a = v x a`."""
    v = np.asarray(v, dtype=np.float64)
    if v.ndim == 1:
        x, y, z = v.tolist()
        return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    matrix = np.zeros((*v.shape[:-1], 3, 3))
    x, y, z = v[..., 0], v[..., 1], v[..., 2]
    matrix[..., 0, 1], matrix[..., 0, 2] = -z, y
    matrix[..., 1, 0], matrix[..., 1, 2] = z, -x
    matrix[..., 2, 0], matrix[..., 2, 1] = -y, x
    return matrix


def wrench_transform(R_new_old: ArrayLike, point: ArrayLike = (0.0, 0.0, 0.0)) -> Array:
    """The (..., 6, 6) matrix that gives a wrench in other axes and about another point.

    `R_new_old` (..., 3, 3); `point` (3,) m, in the old axes from the old point. Force turns; the torque about
    the new point is `T - point x F`, then turns.
    """
    R = np.asarray(R_new_old, dtype=np.float64)
    transform = np.zeros((*R.shape[:-2], 6, 6))
    transform[..., :3, :3] = R
    transform[..., 3:, 3:] = R
    transform[..., 3:, :3] = -R @ cross_matrix(point)
    return transform


def unit_direction(direction: ArrayLike, name: str = "gravity") -> Array:
    """`direction` (3,) scaled to length 1. Raises `InputError` unless it is three finite numbers, not all zero."""
    vector = numbers(direction, name)
    largest = float(np.abs(vector).max(initial=0.0))
    if vector.shape != (3,) or not 0.0 < largest < np.inf:
        parts = ",".join(f"{part:g}" for part in vector.ravel()[:6])
        raise InputError(f"{name} is {parts}, expected three finite numbers X,Y,Z that are not all zero")
    scaled: Array = vector / largest
    return scaled / np.linalg.norm(scaled)


def require_axes(wrench: object) -> None:
    """Raise `InputError` for a table whose columns are named as the axes are, in another order."""
    columns = getattr(wrench, "columns", None)
    named = tuple(str(name).lower() for name in columns) if isinstance(columns, Iterable) else ()
    if named and named != WRENCH_AXES and set(named) == set(WRENCH_AXES):
        raise InputError(f"wrench has columns {' '.join(named)}, expected fx fy fz tx ty tz: put them in this order")


def wrench_rows(wrench: ArrayLike) -> tuple[NDArray[np.float64], tuple[int, ...]]:
    """`wrench` (..., 6) as rows (n, 6) float64, and its leading shape: (n,), () of a single one, (b, n) of a batch of
    sequences. Raises `InputError` otherwise.
    """
    require_axes(wrench)
    values = numbers(wrench, "wrench")
    if values.shape[-1:] != (6,):
        raise InputError(f"wrench has shape {values.shape}, expected (n, 6) or (6,): fx fy fz tx ty tz")
    return values.reshape(-1, 6), values.shape[:-1]


def result_rows(out: Array, leading: tuple[int, ...], readings: Array, parts: Array) -> Array:
    """`out` as rows (n, 6) like the readings, which with the orientations' `parts` are read while it is written to.

    Raises `InputError` where the result cannot be written there.
    """
    shape = (*leading, 6) if leading else readings.shape
    if not isinstance(out, np.ndarray) or isinstance(out, np.ma.MaskedArray):
        raise InputError(f"out is a {type(out).__name__}, expected {shape} float64, C order")
    alike = out.shape == shape or (not leading and out.shape == (6,))
    if not alike or out.dtype != np.float64 or not out.flags.c_contiguous:
        raise InputError(f"out has shape {out.shape} and type {out.dtype}, expected {shape} float64, C order")
    if not out.flags.writeable:
        raise InputError("out is read-only, expected an array that can be written to: pass a copy")
    result = out.reshape(readings.shape)
    there, from_there = result.__array_interface__["data"], readings.__array_interface__["data"]
    in_place = there == from_there and result.strides == readings.strides
    if np.may_share_memory(result, parts) or (np.may_share_memory(result, readings) and not in_place):
        raise InputError("out overlaps with what is read, expected wrench itself or memory of its own: pass a copy")
    return result
