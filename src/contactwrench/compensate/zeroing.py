"""A new zero from free samples at rest: what they leave, and whether they may be taken for free and at rest."""

from __future__ import annotations

import numpy as np

from ..calibration.calibration import Calibration
from ..errors import InputError
from ..geometry.arrays import Array
from ..geometry.rotations import rotation_angle
from ..model import AXES
from ..samples.poses import SAME_POSE_ANGLE
from ..samples.samples import Samples

LEAST_SAMPLES = 10
MOST_SCATTER = 2.0
"""Times the noise, beyond what chance gives to so few samples."""
MOST_MOVED = 5.0
"""Standard deviations between the means of the two halves."""


def free_mean(calibration: Calibration, samples: Samples, noise: Array) -> tuple[Array, Array]:
    """What the calibration leaves of the samples on average (6,), and their orientation (3, 3).

    `noise` (6,): std of one sample. Raises `InputError` where they turn, scatter or move by more than noise does, or
    are too few.
    """
    n = len(samples)
    if n < LEAST_SAMPLES:
        raise InputError(f"no new zero: found {n} samples, expected at least {LEAST_SAMPLES} at rest")
    R = samples.R_base_flange
    angle = max(rotation_angle(R[0].T @ R[k]) for k in (n // 2, n - 1, _farthest(R)))
    if angle > SAME_POSE_ANGLE:
        raise InputError(
            f"no new zero: the arm turns by {np.degrees(angle):.2g} deg in these samples, expected at most "
            f"{np.degrees(SAME_POSE_ANGLE):.2g}; hold it still"
        )
    left = calibration.compensate(samples.wrench, R)
    scatter = left.std(axis=0, ddof=1) / noise
    most = MOST_SCATTER * (1.0 + 2.0 / np.sqrt(n))
    if scatter.max() > most:
        axis = int(np.argmax(scatter))
        raise InputError(
            f"no new zero: {AXES[axis]} scatters {scatter[axis]:.3g} times its noise, expected at most {most:.2g}; "
            "keep everything away from the tool, and the arm still"
        )
    half = n // 2
    moved = np.abs(left[:half].mean(axis=0) - left[half:].mean(axis=0)) / (
        noise * np.sqrt(1.0 / half + 1.0 / (n - half))
    )
    if moved.max() > MOST_MOVED:
        axis = int(np.argmax(moved))
        raise InputError(
            f"no new zero: {AXES[axis]} moves by {moved[axis]:.3g} standard deviations between the halves of these "
            f"samples, expected at most {MOST_MOVED:g}; wait until nothing touches the tool"
        )
    return left.mean(axis=0), R[half]


def _farthest(R: Array) -> int:
    return int(np.argmax(np.sum((R - R[0]) ** 2, axis=(1, 2))))
