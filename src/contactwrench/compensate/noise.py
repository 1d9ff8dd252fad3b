"""The noise that the calibration itself does not explain: of one sample, behind a filter, and of a mean."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..calibration.calibration import Calibration
from ..errors import InputError
from ..estimation.noise import pooled_scatter, variance_of_means
from ..geometry.arrays import Array
from ..samples.poses import Pose
from .filters import LowPass

LEAST_STD = np.array([1e-6, 1e-6, 1e-6, 1e-7, 1e-7, 1e-7])
"""N and N m: less noise than this no sensor has, and rounding begins to count."""
PER_NEWTON = np.array([1.0, 1.0, 1.0, 0.05, 0.05, 0.05])
"""A noise or a drift of one number, N, stands for as many N m at a lever of 5 cm, as in `TYPICAL_DRIFT`."""
LEAST_ROWS = 10
LEAST_BLOCKS = 5


@dataclass(frozen=True, eq=False)
class SampleNoise:
    """Variances (6,) `of_sample`, and `between` orientations, of what poses differ by, which no filter reduces.

    `recording` (n, 6), where the noise was given as one: how slowly it varies is then known, else it counts as white.
    """

    of_sample: Array
    between: Array
    recording: Array | None = None

    def behind(self, low_pass: LowPass | None, rate: float) -> Array:
        """Variances (k, 6) behind a filter, 0, 1, ... samples after its start; the last is what stays."""
        if low_pass is None:
            return self.of_sample[None]
        left: Array = low_pass.noise_gain(rate)[:, None] * self.of_sample
        if self.recording is None:
            return left
        from scipy.signal import sosfilt

        filtered: Array = sosfilt(low_pass.sections(rate), self.recording, axis=0)
        settled = filtered[min(len(left), len(filtered) // 2) :]
        slow: Array = np.maximum(left, np.mean(settled**2, axis=0))
        return slow

    def slowness(self, rows: int) -> Array:
        """How many times larger (6,) the variance of a mean of so many samples is than that of white noise."""
        if self.recording is None or (blocks := len(self.recording) // rows) < LEAST_BLOCKS:
            return np.ones(6)
        means = self.recording[: blocks * rows].reshape(blocks, rows, 6).mean(axis=1)
        slowness: Array = np.maximum(np.mean(means**2, axis=0) * rows / self.of_sample, 1.0)
        return slowness


def noise_of_sample(calibration: Calibration, noise: ArrayLike | None) -> SampleNoise:
    """The noise of a sample and of what poses differ by.

    `noise`: standard deviations (6,) of a sample, or a recording (n, 6) at rest or, compensated, of free motion, at the
    rate of the samples; None: the scatter within the calibration's poses. Where each of those is a single row its two
    parts cannot be told apart, and all of it counts as either. Raises `InputError` for any other shape, a negative
    number or a NaN.
    """
    scatter = pooled_scatter(calibration.fitted_poses)
    of_mean = 0.0 if scatter is None else np.einsum("nii->ni", scatter.covariance).mean(axis=0)
    recording = None
    if noise is not None:
        of_sample, recording = _stated(noise)
        of_mean = of_sample if scatter is None else of_mean
    elif scatter is not None:
        of_sample = np.diag(scatter.covariance[0]) * calibration.fitted_poses[0].n
    else:
        of_sample = calibration.noise**2
    between = np.maximum(calibration.noise**2 - of_mean, 0.0)
    return SampleNoise(np.maximum(of_sample, LEAST_STD**2), between, recording)


def with_torques(values: ArrayLike) -> Array:
    """Numbers as they are, but a single one, N, as six: `PER_NEWTON`. Raises `InputError` for what is no number."""
    try:
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(
            f"found {values!r}, expected numbers: one in N, or six, N of forces and N m of torques"
        ) from None
    return array * PER_NEWTON if array.ndim == 0 else array


def _stated(noise: ArrayLike) -> tuple[Array, Array | None]:
    """Variances (6,) of a sample, and the recording that they were taken from, less its mean."""
    values = with_torques(noise)
    is_recording = values.ndim == 2 and values.shape[1] == 6 and len(values) >= LEAST_ROWS
    if not (is_recording or values.shape == (6,)):
        raise InputError(
            f"noise has shape {values.shape}, expected (6,) standard deviations of a sample, or a recording at rest of "
            f"at least {LEAST_ROWS} rows (n, 6), all finite"
        )
    if not np.isfinite(values).all():
        raise InputError("noise has a NaN or an infinity, expected finite numbers: leave such samples out")
    if is_recording:
        return values.var(axis=0, ddof=1), values - values.mean(axis=0)
    if (values < 0.0).any():
        raise InputError(f"noise is {values.min():g} on one axis, expected standard deviations of 0 or more")
    return np.square(values), None


def reading_variance(calibration: Calibration, poses: tuple[Pose, ...]) -> Array:
    """Variance (n, 6) of the poses' mean readings: what poses of the calibration differed by, and the scatter of a
    sample over the rows that each of these has (where the calibration saw no repeated rows, its noise has both).
    """
    rows = np.array([pose.n for pose in poses], dtype=np.float64)
    return variance_of_means(calibration.noise, calibration.fitted_poses, rows)


def noise_dof(calibration: Calibration) -> float:
    """Degrees of freedom behind the noise of all axes together, readings less parameters; 0 for a known noise."""
    n = len(calibration.fitted_poses) if calibration.moments is None else calibration.moments.n
    return float(max(6 * n - len(calibration.parameters), 0)) if calibration.dof > 0.0 else 0.0
