"""How far off the contact wrench is where a program cannot express all of a calibration."""

from __future__ import annotations

import numpy as np

from ...calibration.calibration import Calibration
from ...geometry.arrays import Array
from ...geometry.rotations import spread_rotations

ROUNDING = 1e-6
"""N and N m: a smaller error is that of rounded numbers, and not worth a remark."""
STARTS, MOST_STEPS = 24, 2000
LEAST_GAIN = 1e-10
"""Relative, a step: where the climb ends, which is then within 1e-6 of the top."""


def largest_error(calibration: Calibration, B: Array, gravity_direction: Array) -> tuple[float, float]:
    """How far off contact force and torque are at most, over all orientations, where a program subtracts another free
    wrench than the calibration's.

    Args:
        calibration: what is right.
        B: (6, 4), N and N m, sensor axes: the program subtracts `B @ [r, 1]`.
        gravity_direction: unit vector (3,), base axes, with `r = R_base_flange.T @ gravity_direction`.

    Returns:
        The largest norm of the error of the force, N, and of the torque, N m, to a relative accuracy of 1e-6.
    """
    wrong = np.einsum("ij,k->ijk", B[:, :3], gravity_direction)
    right = np.einsum("ij,k->ijk", calibration.B[:, :3], calibration.gravity_direction)
    turning, constant = wrong - right, B[:, 3] - calibration.bias
    return _largest(turning[:3], constant[:3]), _largest(turning[3:], constant[3:])


def _largest(turning: Array, constant: Array) -> float:
    """The largest norm of `turning[i, j, k] R[k, j] + constant[i]` over all rotations R.

    Its square is convex in R. So the rotation that has most in common with the gradient is never worse than the one
    before: from the best of a dense set of rotations these steps climb to the largest.
    """
    R = spread_rotations(288, 24)
    error = _error(turning, constant, R)
    R = R[np.argsort(np.linalg.norm(error, axis=1))[-STARTS:]]
    largest = 0.0
    for _ in range(MOST_STEPS):
        error = _error(turning, constant, R)
        before, largest = largest, float(np.linalg.norm(error, axis=1).max())
        if largest <= before * (1.0 + LEAST_GAIN):
            break
        U, _, Vt = np.linalg.svd(np.einsum("ijk,ni->nkj", turning, error))
        U[:, :, 2] *= np.sign(np.linalg.det(U @ Vt))[:, None]
        R = U @ Vt
    return largest


def _error(turning: Array, constant: Array, R: Array) -> Array:
    """The error (n, 3) at rotations (n, 3, 3)."""
    return np.asarray(np.einsum("ijk,nkj->ni", turning, R) + constant)
