"""A tool that can exist: a positive mass somewhere, so that the pseudo-inertia is positive definite.

Of a body of density rho >= 0 the matrix J = integral rho [x; 1][x; 1]^T dx is positive definite, which says at once
that its mass is positive and that its principal moments obey the triangle inequality (Wensing, Kim and Slotine 2018).
Any such J is L L^T with a triangular L (Rucker and Wensing 2022, who take the logarithm of its diagonal; that goes to
minus infinity for the nearest body, which is flat in some direction).
"""

from __future__ import annotations

import numpy as np

from ..calibration.dynamics import elements, second_moments, symmetric
from ..geometry.arrays import Array

LEAST_SIZE = 1e-4
"""m: a tool is no smaller in any direction."""


def nearest_possible(inertia: Array, covariance: Array, mass: float) -> tuple[Array, float]:
    """The inertia (3, 3) of a body that can exist which is nearest in standard deviations, and how many these are:
    `covariance` (6, 6) of its elements.
    """
    from scipy.optimize import least_squares

    whiten = np.linalg.inv(np.linalg.cholesky(covariance))
    wanted, size = elements(inertia), mass * LEAST_SIZE**2

    def inertia_of(lower: Array) -> Array:
        L = np.zeros((3, 3))
        L[np.tril_indices(3)] = lower
        second = mass * (L @ L.T) + size * np.eye(3)
        return np.asarray(np.trace(second) * np.eye(3) - second)

    values, vectors = np.linalg.eigh(second_moments(inertia))
    begin = np.linalg.cholesky((vectors * np.maximum(values / mass, 10.0 * LEAST_SIZE**2)) @ vectors.T)
    first = begin[np.tril_indices(3)]
    found = least_squares(lambda lower: whiten @ (elements(inertia_of(lower)) - wanted), first, x_scale="jac")
    return symmetric(elements(inertia_of(found.x))), float(np.sqrt(2.0 * found.cost))
