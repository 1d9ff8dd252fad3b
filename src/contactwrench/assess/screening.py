"""How well a rigid tool can explain thousands of readings of one file, all at once.

A reading is one of the orientation's columns times one of the wrench's. For each, the mounting that explains the
forces best is a Procrustes rotation (Kabsch, 1976; estimation/initial_guess.py). With it held the torques are linear
in weight * com: so second moments of the centred rows decide, and nothing is iterated.

    sum |F - G Q r - F0|^2  is least for  G = tr(Q M_F) / S,   M_F = sum r F^T,   S = sum |r|^2,   Q = R_flange_sensor^T

Negated readings have the moments negated, so both signs come for one decomposition.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..geometry.arrays import Array
from ..model import gravity_in_flange

LEAST_TILT = 1e-6
"""Of the squared gravity directions, on average: a reading in which gravity moves less explains nothing."""

FORCE_PARAMETERS = 7
TORQUE_PARAMETERS = 6
"""Of model mount: weight, mounting and bias weigh on the forces; weight * com and bias on the torques."""

NOTHING_LEFT = 1e-6
"""Of the readings' scatter: where all is explained, the digits of the numbers in a file still leave that much."""


@dataclass(frozen=True, eq=False)
class Orientations:
    """One reading of the orientation: `R_base_flange` (m, 3, 3), belonging to the file's readings in `rows` (m,)."""

    R_base_flange: Array
    rows: slice


@dataclass(frozen=True, eq=False)
class Unexplained:
    """Variances of a component of force (N^2) and torque (N^2 m^2) that a rigid tool leaves, for every reading.

    Arrays (orientations, wrenches, 2), the last axis for the readings and the negated readings.
    """

    force: Array
    torque: Array


def screen(
    orientations: list[Orientations], wrench: Array, matrices: Array, in_base: Array, gravity_direction: Array
) -> Unexplained:
    """What a rigid tool leaves of each reading of `wrench` (n, 6), the file's columns.

    `matrices` (k, 6, 6) turn the columns into fx..tz, in base axes where `in_base` (k,), and then turned back.
    """
    cross, total, square, rows = [], [], [], []
    for orientation in orientations:
        r = gravity_in_flange(orientation.R_base_flange, gravity_direction)
        r = r - r.mean(axis=0)
        n = len(r)
        read = (wrench[orientation.rows] @ matrices.reshape(-1, 6).T).reshape(n, -1, 2, 3)
        given_in_base = read[:, in_base]
        turned_back = given_in_base.reshape(n, -1, 3) @ orientation.R_base_flange
        read[:, in_base] = turned_back.reshape(given_in_base.shape)
        read -= read.mean(axis=0)
        cross.append((r.T @ read.reshape(n, -1)).reshape(3, -1, 2, 3).transpose(1, 2, 0, 3))
        total.append(np.einsum("nkpb,nkpb->kp", read, read))
        square.append(r.T @ r)
        rows.append(n)
    return _unexplained(np.array(cross), np.array(total), np.array(square), np.array(rows, dtype=np.float64))


def _unexplained(cross: Array, total: Array, square: Array, n: Array) -> Unexplained:
    """From moments `cross` (v, k, 2, 3, 3), `total` (v, k, 2) and `square` (v, 3, 3) of n (v,) rows; force first."""
    spread = np.trace(square, axis1=1, axis2=2)
    moving = spread > LEAST_TILT * n
    spread = np.where(moving, spread, np.inf)
    inertia = np.where(moving, spread, 1.0)[:, None, None] * np.eye(3) - square
    inverse_inertia = np.linalg.pinv(inertia, rcond=1e-9, hermitian=True)[:, None]
    U, s, Vt = np.linalg.svd(cross[:, :, 0])
    handedness = np.linalg.det(U @ Vt)
    force, torque = np.empty((*total.shape[:2], 2)), np.empty((*total.shape[:2], 2))
    for k, sign in enumerate((1.0, -1.0)):
        last = sign * handedness
        pull = s[..., 0] + s[..., 1] + last * s[..., 2]
        force[..., k] = total[..., 0] - pull**2 / spread[:, None]
        R_flange_sensor = sign * U @ (np.stack([np.ones_like(last), np.ones_like(last), last], axis=-1)[..., None] * Vt)
        across = sign * cross[:, :, 1] @ np.swapaxes(R_flange_sensor, -1, -2)
        moment = np.stack([across[..., i, j] - across[..., j, i] for i, j in ((1, 2), (2, 0), (0, 1))], axis=-1)
        explained = np.einsum("vki,vkij,vkj->vk", moment, inverse_inertia * moving[:, None, None, None], moment)
        torque[..., k] = total[..., 1] - explained
    least = NOTHING_LEFT**2 * total[:1, :1]
    dof = 3.0 * n[:, None, None]
    return Unexplained(
        np.maximum(force, least[..., :1]) / (dof - FORCE_PARAMETERS),
        np.maximum(torque, least[..., 1:]) / (dof - TORQUE_PARAMETERS),
    )


def misfit(force: ArrayLike, torque: ArrayLike, n: int) -> Array:
    """-2 log likelihood, up to a constant, of a fit that leaves these variances in n poses, its parameters counted.

    The variances are not known beforehand: they are integrated out under Jeffreys' prior. The scale of the torques is
    their unit in the file, so that no reading of that unit gains by it.
    """
    least: Array = (3 * n - FORCE_PARAMETERS) * np.log(force) + (3 * n - TORQUE_PARAMETERS) * np.log(torque)
    return least
