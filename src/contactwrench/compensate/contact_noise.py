"""The noise of a compensated reading that the calibration itself does not explain, and how well it is known."""

from __future__ import annotations

import numpy as np

from ..calibration.calibration import Calibration
from ..estimation.noise import variance_of_means
from ..geometry.arrays import Array
from ..samples.poses import Pose


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
