"""A bias that wanders along one direction of force and torque, as all axes warm with one thermometer.

A kernel (bias_drift.py) has each axis wander on its own, and pays in evidence as if six courses had been there: a step,
a straight line or two levels, which all axes share, then look likelier than they are. Here the same course is weighed
as a single one along a direction that nobody knows, in closed form at the optimum of its member.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..geometry.arrays import Array
from .bias_drift import Kernels
from .least_squares import Members, centred
from .variance_components import inverse_of

PASSES = 3
"""Of a direction and the tool in turn."""

SHARED = 0.003
"""That a bias which wanders does so along one direction, before the readings: gain and cable, which pay for all axes,
too, would else lose a measured set to it.
"""

BLUNT = (2.0 / np.pi**3 * (2.0 * np.pi) ** 2.5) ** 0.4
"""How sharply a direction of six numbers shows that does not show at all: Laplace's mean over the sphere is then 1."""


def log_either(
    kernels: Kernels, members: Members, errors: Array, J: Array, variance: Array, kept: NDArray[np.bool_]
) -> Array:
    """Logarithm of the evidence (m,) of `members` whose bias wanders on each axis alone or along one direction, over
    that of the former; `errors` (m, k, 6) are what they leave in the poses kept, of relative `variance` (k,), with
    derivatives J (k, 6, p). Across that direction all is steady and tells more of the tool: it is another one then.
    """
    either, drift = np.zeros(len(members.kernel)), kernels.drift[members.kernel]
    for of_drift in np.unique(drift).tolist():
        here = np.flatnonzero(drift == of_drift)
        U, size, _ = np.linalg.svd(centred(kernels.drifts[of_drift].columns[kept], variance), full_matrices=False)
        scale = np.sqrt(members.variance[here, None] * variance[:, None])
        courses, of_J = U.T @ (errors[here] / scale), np.tensordot(U.T, J[None] / scale[..., None], (1, 1))
        of_J = of_J.transpose(1, 0, 2, 3)  # (m, c, 6, p) of courses
        grown, covariance = np.multiply.outer(members.strength[here], size) ** 2, members.covariance[here]
        alone, shown = grown / (1.0 + grown), 6.0 * grown / (1.0 + 6.0 * grown)  # as strong on all axes together
        flat, weighted = (each.reshape(len(here), -1, J.shape[2]) for each in (of_J, alone[:, :, None, None] * of_J))
        pull = np.swapaxes(weighted, 1, 2) @ courses.reshape(len(here), -1, 1)
        told = inverse_of(covariance) + np.swapaxes(weighted, 1, 2) @ flat
        left = courses
        for _ in range(PASSES):
            value, vectors = np.linalg.eigh(np.swapaxes(left, 1, 2) @ (left * shown[:, :, None]))
            direction = vectors[:, :, -1:]
            along, along_J = courses @ direction, (np.swapaxes(direction, 1, 2)[:, None] @ of_J)[:, :, 0]
            shown_J = np.swapaxes(shown[:, :, None] * along_J, 1, 2)
            information, gradient = told - shown_J @ along_J, pull - shown_J @ along
            step = inverse_of(information) @ gradient
            left = courses - (of_J @ step[:, None])[:, :, :, 0]
        costs = np.linalg.slogdet(information)[1] + np.linalg.slogdet(covariance)[1]
        costs += np.log((value[:, -1:] - value[:, :-1]) / BLUNT + 1.0).sum(axis=1)
        gain = np.sum(shown * along[:, :, 0] ** 2 - alone * np.sum(courses**2, axis=2), axis=1)
        gain += np.sum(gradient * step, axis=(1, 2))
        gain += np.sum(6.0 * np.log1p(grown) - np.log1p(6.0 * grown), axis=1)
        either[here] = np.logaddexp(np.log(1.0 - SHARED), np.log(SHARED) + 0.5 * (gain - costs))
    return either
