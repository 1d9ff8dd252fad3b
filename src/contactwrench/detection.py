"""Is something touching? Chi-square of a contact wrench against its own covariance, at a stated false-alarm rate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from .calibrate.noise import pooled_scatter
from .calibration import Calibration
from .errors import InputError
from .orientation import Array

RELEASE_RATE = 0.05
"""A contact is over when the statistic falls to what this share of free samples exceeds."""
LEAST_STD = np.array([1e-6, 1e-6, 1e-6, 1e-7, 1e-7, 1e-7])
"""N and N m: less noise than this no sensor has, and rounding begins to count."""
_LOG_DOF = np.linspace(np.log(0.5), np.log(1e6), 400)


@dataclass(frozen=True, eq=False)
class Thresholds:
    """Of the statistic, over the logarithm of the degrees of freedom behind its covariance: above `contact` a sample
    is taken for a contact, below `release` for free.
    """

    contact: Array
    release: Array

    def at(self, dof: float) -> tuple[float, float]:
        """Both at `dof`; 0: the covariance is known."""
        x = np.log(dof) if dof > 0.0 else np.inf
        return float(np.interp(x, _LOG_DOF, self.contact)), float(np.interp(x, _LOG_DOF, self.release))


def thresholds(false_alarm_rate: float) -> Thresholds:
    """For 6 axes: 6 F(6, dof), which is chi-square where the covariance is known.

    Raises `InputError` unless the rate lies between 1e-9 and 0.05.
    """
    from scipy.special import fdtri

    if not 1e-9 <= false_alarm_rate <= RELEASE_RATE:
        raise InputError(f"false-alarm rate is {false_alarm_rate:g}, expected 1e-9 to {RELEASE_RATE:g} per sample")
    contact, release = (6.0 * fdtri(6.0, np.exp(_LOG_DOF), 1.0 - rate) for rate in (false_alarm_rate, RELEASE_RATE))
    return Thresholds(contact, release)


def whitening(covariance: Array) -> Array:
    """The lower triangular W (6, 6) with `W S W^T = 1`: the statistic is `|W f|^2`."""
    W: Array = np.linalg.inv(np.linalg.cholesky(covariance))
    return W


def satterthwaite(W: Array, estimated: Array, dof: float) -> float:
    """Degrees of freedom behind a covariance of which the part `estimated` (6, 6) rests on `dof` (0: all is known) and
    the rest is known, by its mean share of the variance (Satterthwaite, 1946).
    """
    share = min(float(np.vdot(W @ estimated, W)) / 6.0, 1.0)
    return dof / max(share * share, 1e-12) if dof > 0.0 else 0.0


def noise_of_sample(calibration: Calibration, noise: ArrayLike | None) -> tuple[Array, Array]:
    """Variances (6,): of one sample's white noise, and of what poses differ by, which no filter reduces.

    `noise`: standard deviations (6,) of a sample, or a recording at rest (n, 6), or None: the scatter within the
    calibration's poses. Where each of those is a single row its two parts cannot be told apart, and all of it counts
    as either. Raises `InputError` for any other shape, a negative number or a NaN.
    """
    scatter = pooled_scatter(calibration.fitted_poses)
    of_mean = 0.0 if scatter is None else np.einsum("nii->ni", scatter.covariance).mean(axis=0)
    if noise is not None:
        white = _given(noise)
        of_mean = white if scatter is None else of_mean
    elif scatter is not None:
        white = np.diag(scatter.covariance[0]) * calibration.fitted_poses[0].n
    else:
        white = calibration.noise**2
    return np.maximum(white, LEAST_STD**2), np.maximum(calibration.noise**2 - of_mean, 0.0)


def _given(noise: ArrayLike) -> Array:
    values = np.asarray(noise, dtype=np.float64)
    recording = values.ndim == 2 and values.shape[1] == 6 and len(values) >= 10
    if not (recording or values.shape == (6,)) or not np.isfinite(values).all():
        raise InputError(
            f"noise has shape {values.shape}, expected (6,) standard deviations of a sample, or a recording at rest of "
            "at least 10 rows (n, 6), all finite"
        )
    if recording:
        variance: Array = values.var(axis=0, ddof=1)
        return variance
    if (values < 0.0).any():
        raise InputError(f"noise is {values.min():g} on one axis, expected standard deviations of 0 or more")
    return np.square(values)
