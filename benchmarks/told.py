"""The fit that is told: generalised least squares with the true covariance of the noise and of the bias' course.

It shares nothing with the package: Gauss-Newton on the readings of world.py, from the truth, with the stated priors on
the tilts. What `auto` loses against it is what not knowing costs.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tests.support.world import Array, Rig, derivatives, perturbed, readings

from .errors import NOISE, PRIOR_BASE, PRIOR_MOUNT

PARAMETERS = 15
ROUNDS = 4
SMALL = 1e-5


@dataclass(frozen=True)
class Told:
    """Mean squared force error (N^2) at the unseen orientations, and what was to be expected of it."""

    squared: float
    expected: float


def _tilts(rig: Rig) -> Array:
    """Of the mounting and of the base (4,), in units of their priors."""
    tilts: Array = np.r_[rig.R_flange_sensor[:2, 2] / PRIOR_MOUNT, rig.down[:2] / PRIOR_BASE]
    return tilts


def _tilts_jacobian(rig: Rig) -> Array:
    steps = SMALL * np.eye(PARAMETERS)
    columns = [(_tilts(perturbed(rig, step)) - _tilts(perturbed(rig, -step))) / (2.0 * SMALL) for step in steps]
    return np.column_stack(columns)


def told(rig: Rig, R_base_flange: Array, wrench: Array, course: Array | None, unseen: Array) -> Told:
    """The fit to readings (n, 6) whose bias has the covariance `course` (6, n, n) across poses; None: it is steady."""
    n = len(R_base_flange)
    covariance = NOISE[:, None, None] ** 2 * np.eye(n) + (0.0 if course is None else course)
    whitener = np.linalg.inv(np.linalg.cholesky(covariance))
    found = rig
    for _ in range(ROUNDS):
        J = np.einsum("amn,nap->map", whitener, derivatives(found, "mount+base", R_base_flange))
        left = np.einsum("amn,na->ma", whitener, wrench - readings(found, R_base_flange))
        A = np.vstack([J.reshape(-1, PARAMETERS), _tilts_jacobian(found)])
        found = perturbed(found, np.linalg.lstsq(A, np.r_[left.ravel(), -_tilts(found)], rcond=None)[0])
    spread = derivatives(rig, "mount+base", unseen)[:, :3] @ np.linalg.pinv(A, rcond=1e-12)
    expected = float(np.sum(spread**2, axis=(1, 2)).mean())
    off = readings(found, unseen)[:, :3] - readings(rig, unseen)[:, :3]
    return Told(float(np.sum(off**2, axis=1).mean()), expected)
