"""What a free tool still reads after compensation: drift of the bias, the calibration's own error. A Kalman filter.

The offset at orientation R is `z = drift + H(R) eta + u(R)`: the drift a random walk; eta, standard normal, the error
of the calibration's parameters (covariance L L^T, H = J(R) L); u what poses differ by for no reason that the model
knows, which decays with the angle between two orientations. Only z is estimated. eta and u are *considered* (Schmidt,
1966): their covariance with the error of z is carried along and they are never updated themselves, so that

- at one orientation z is learned from free samples, the calibration's error there included, and counted once;
- a turn to another orientation brings back exactly the part of that error which is not known there;
- nothing that live data do, a contact taken for drift included, can wear out the calibration.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..calibration.calibration import Calibration
from ..geometry.arrays import Array
from ..statistics import square_root

TYPICAL_DRIFT = np.array([0.05, 0.05, 0.05, 0.0025, 0.0025, 0.0025])
"""N and N m: std of a warm sensor's random walk after one hour."""
HOUR = 3600.0
ALIKE = 0.5
"""rad: orientations this far apart share 1/e of what poses differ by."""


class CalibrationError:
    """How wrong a calibration is at an orientation: `H(R)` (6, q), with `H H^T` the covariance of its free wrench,
    and `between` (6,), the variances of what poses differ by.

    The free wrench's derivative is linear in the entries of R, so that eleven evaluations give it everywhere.
    """

    def __init__(self, calibration: Calibration, between: Array) -> None:
        corners = np.vstack([np.zeros((1, 9)), np.eye(9)]).reshape(10, 3, 3)
        root = square_root(calibration.covariance)
        H = calibration.free_wrench_jacobian(corners) @ root
        self._at_zero = np.ascontiguousarray(H[0].ravel())
        self._slope = np.ascontiguousarray((H[1:] - H[0]).reshape(9, -1))
        self._shape = H.shape[1:]
        self.between = np.diag(between)

    def root(self, R_base_flange: Array) -> Array:
        """H (6, q) at `R_base_flange` (3, 3)."""
        H: Array = (R_base_flange.ravel() @ self._slope + self._at_zero).reshape(self._shape)
        return H


@dataclass(frozen=True, eq=False)
class Offset:
    """The offset `value` (6,) at orientation `R_base_flange` and time `t`; `covariance` (6, 6) of its error, and that
    error's covariance `with_calibration` (6, q) with eta and `with_pose` (6, 6) with u; `H` (6, q) there.
    """

    value: Array
    covariance: Array
    with_calibration: Array
    with_pose: Array
    H: Array
    R_base_flange: Array
    t: float


def calibrated(error: CalibrationError, R_base_flange: Array, t: float) -> Offset:
    """The offset as the calibration leaves it: none that is known."""
    H = error.root(R_base_flange)
    return Offset(np.zeros(6), H @ H.T + error.between, H, error.between, H, R_base_flange, t)


def predicted(offset: Offset, error: CalibrationError, walk: Array, R_base_flange: Array, t: float) -> Offset:
    """The offset at another orientation and time; `walk` (6,) is the drift's variance after one second. A clock that
    went back adds nothing.
    """
    covariance = offset.covariance + np.diag(walk * max(t - offset.t, 0.0))
    apart = R_base_flange - offset.R_base_flange
    squared = float(np.vdot(apart, apart))
    if squared == 0.0:
        return replace(offset, covariance=covariance, t=t)
    H = error.root(R_base_flange)
    change = H - offset.H
    kept = float(np.exp(-2.0 / ALIKE * np.arcsin(min(1.0, np.sqrt(squared / 8.0)))))
    along = change @ offset.with_calibration.T - (1.0 - kept) * offset.with_pose
    covariance += along + along.T + change @ change.T + 2.0 * (1.0 - kept) * error.between
    return Offset(
        offset.value,
        covariance,
        offset.with_calibration + change,
        kept * offset.with_pose + (1.0 - kept) * error.between,
        H,
        R_base_flange,
        t,
    )


def updated(offset: Offset, mean: Array, variance: Array) -> Offset:
    """The offset after the mean (6,) of free samples at its orientation and time, with the white noise's `variance`
    (6,) of that mean. The error's covariances with eta and u shrink with it; those two stay as they were.
    """
    left = np.linalg.solve(offset.covariance + np.diag(variance), np.diag(variance)).T
    covariance = left @ offset.covariance
    return replace(
        offset,
        value=mean + left @ (offset.value - mean),
        covariance=0.5 * (covariance + covariance.T),
        with_calibration=left @ offset.with_calibration,
        with_pose=left @ offset.with_pose,
    )


def zeroed(error: CalibrationError, mean: Array, variance: Array, R_base_flange: Array, t: float) -> Offset:
    """The offset where nothing before counts, only the mean (6,) of free samples, `variance` (6,): a new zero."""
    H = error.root(R_base_flange)
    return Offset(mean, np.diag(variance), np.zeros_like(H), np.zeros((6, 6)), H, R_base_flange, t)
