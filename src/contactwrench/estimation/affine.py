"""The affine fit: B (6, 4) itself, with nothing of a rigid tool in it. A diagnosis of gains and cross-talk."""

from __future__ import annotations

import numpy as np

from ..geometry.arrays import Array
from ..model import affine_jacobian, free_wrench, gravity_in_flange
from .least_squares import Fit, GivenNoise, PoseReadings, finished, solve
from .linearised import Linearised, linearise


class _AffineProblem:
    """Residuals, derivatives and steps of the 24 numbers B, row-major."""

    def __init__(self, r: Array, wrench: Array) -> None:
        self.r, self.wrench = r, wrench
        self.jacobian = affine_jacobian(r)

    def linearised(self, B: Array, whitener: Array) -> Linearised:
        return linearise(self.wrench - free_wrench(B, self.r), self.jacobian, whitener)

    def advanced(self, B: Array, linear: Linearised) -> Array:
        return B + linear.step().reshape(6, 4)


def fit_affine(readings: PoseReadings, gravity_direction: Array, noise: GivenNoise | None) -> Fit:
    """Fit B (6, 4) itself, 24 free numbers: `F = A r + F0, T = A_t r + T0` (method, section 4)."""
    problem = _AffineProblem(gravity_in_flange(readings.R_base_flange, gravity_direction), readings.wrench)
    B, solved = solve(problem, np.zeros((6, 4)), readings, noise)
    return finished(None, gravity_direction, B, np.eye(24), solved)
