"""A global initial guess for the joint fit, so that no mounting and no base needs a guess.

With the mounting R = R_flange_sensor and the direction of gravity d held, the model is linear in weight, weight *
com and bias. Eliminating those leaves a score that depends on R and d alone, through second moments of the centred
poses: so it costs next to nothing to score many, and the best few go on to Gauss-Newton.

    sum |F - G u - F0|^2 is least for  G = tr(R^T M_F) / S,   M_F = sum r F^T,  S = sum |r|^2   (centred r, F)

For the force alone the best proper rotation is the closed-form Procrustes one (Kabsch, 1976, in the form of Wahba's
problem); for the paper's mounting, `Rz(theta)`, it is the closed form of the coupled yaw-only fit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..calibration.observability import LEVER
from ..geometry.arrays import Array
from ..geometry.rotations import rotations_about_z, spread_directions, spread_rotations
from ..model import FLIP, RigidTool, gravity_in_flange

FEW_POSES = 5
"""Up to here an unknown base has local optima that score well, so that every direction of gravity goes on."""


@dataclass(frozen=True)
class Search:
    """Where to look: among mountings that only turn about z (the paper's) or `any_mounting`; with gravity held, or
    with `any_base` that has it within 90 deg.
    """

    any_mounting: bool
    any_base: bool


SEARCH_OF_MODEL = {
    "yaw": Search(any_mounting=False, any_base=False),
    "mount": Search(any_mounting=True, any_base=False),
    "mount+base": Search(any_mounting=True, any_base=True),
}


def initial_guesses(R_base_flange: Array, wrench: Array, search: Search, gravity_direction: Array) -> list[RigidTool]:
    """The most promising tools, best first, from poses (n, 3, 3) and their readings (n, 6)."""
    guesses = _scored_guesses(R_base_flange, wrench, search, gravity_direction)
    return [linear_fit(R_base_flange, wrench, R, d) for _, R, d in guesses]


def explained_by_guess(R_base_flange: Array, wrench: Array, search: Search, gravity_direction: Array) -> float:
    """The part of the readings' sum of squares that the best guess explains with a positive weight."""
    return _scored_guesses(R_base_flange, wrench, search, gravity_direction)[0][0]


def _scored_guesses(
    R_base_flange: Array, wrench: Array, search: Search, gravity_direction: Array
) -> list[tuple[float, Array, Array]]:
    if search.any_base:
        sphere = spread_directions(48)
        directions = sphere[sphere @ gravity_direction >= 0.0]
        of_each, most = 1, len(directions) if len(wrench) <= FEW_POSES else 4
    else:
        directions, of_each, most = gravity_direction[None], 2, 2
    guesses: list[tuple[float, Array, Array]] = []
    for d in directions:
        moments = _Moments(gravity_in_flange(R_base_flange, d), wrench)
        candidates = _mount_candidates(moments.force) if search.any_mounting else _yaw_candidates(moments.force)
        scores = moments.score(candidates)
        guesses += [(float(scores[k]), candidates[k], d) for k in np.argsort(-scores)[:of_each]]
    guesses.sort(key=lambda guess: -guess[0])
    return guesses[:most]


class _Moments:
    """Second moments of the centred poses, all that the score of a mounting needs."""

    def __init__(self, r: Array, wrench: Array) -> None:
        r = r - r.mean(axis=0)
        wrench = wrench - wrench.mean(axis=0)
        self.spread = float(np.sum(r * r))
        self.force = r.T @ wrench[:, :3]
        self.torque = r.T @ wrench[:, 3:]
        self.inverse_inertia = np.linalg.pinv(self.spread * np.eye(3) - r.T @ r, rcond=1e-9, hermitian=True)

    def weight(self, R: Array) -> Array:
        """The least-squares weight (m,) for mountings (m, 3, 3), no less than zero."""
        force = np.maximum(np.einsum("mjk,jk->m", R, self.force), 0.0)
        weight: Array = force / self.spread if self.spread > 0.0 else np.zeros(len(R))
        return weight

    def moment(self, R: Array) -> Array:
        """`sum u x T` (m, 3) in flange axes: `inverse_inertia @ moment` is weight * com of least squares there."""
        P = R.transpose(0, 2, 1) @ self.torque
        in_sensor = np.stack([P[:, 1, 2] - P[:, 2, 1], P[:, 2, 0] - P[:, 0, 2], P[:, 0, 1] - P[:, 1, 0]], axis=1)
        moment: Array = np.einsum("mjk,mk->mj", R, in_sensor)
        return moment

    def score(self, R: Array) -> Array:
        """The part of the readings' sum of squares that each mounting (m, 3, 3) explains with a positive weight."""
        moment = self.moment(R)
        explained_torque = np.einsum("mj,jk,mk->m", moment, self.inverse_inertia, moment)
        score: Array = self.spread * self.weight(R) ** 2 + explained_torque / LEVER**2
        return score


def _procrustes(M: Array) -> Array:
    """The proper rotation R with the largest `tr(R^T M)`."""
    U, _, Vt = np.linalg.svd(M)
    R: Array = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
    return R


def _mount_candidates(force_moments: Array) -> Array:
    return np.concatenate([_procrustes(force_moments)[None], spread_rotations(24, 12)])


def _yaw_candidates(force_moments: Array) -> Array:
    """`Rz(yaw)` and `FLIP @ Rz(yaw)`: the closed form for each, and a turn in steps of 10 degrees."""
    yaw = [np.arctan2(M[1, 0] - M[0, 1], M[0, 0] + M[1, 1]) for M in (force_moments, FLIP @ force_moments)]
    turn = np.deg2rad(np.arange(0.0, 360.0, 10.0))
    upright = rotations_about_z(np.r_[yaw[0], turn])
    flipped = FLIP @ rotations_about_z(np.r_[yaw[1], turn])
    return np.concatenate([upright, flipped])


def linear_fit(R_base_flange: Array, wrench: Array, R_flange_sensor: Array, gravity_direction: Array) -> RigidTool:
    """Weight, com and bias of least squares with both rotations held; the weight kept above zero."""
    r = gravity_in_flange(R_base_flange, gravity_direction)
    moments = _Moments(r, wrench)
    weight = float(moments.weight(R_flange_sensor[None])[0])
    weight_com = R_flange_sensor.T @ moments.inverse_inertia @ moments.moment(R_flange_sensor[None])[0]
    weight = max(weight, 1e-3 * float(np.abs(wrench[:, :3]).max()), 1e-9)
    u_mean = r.mean(axis=0) @ R_flange_sensor
    bias = wrench.mean(axis=0) - np.r_[weight * u_mean, np.cross(weight_com, u_mean)]
    return RigidTool(weight, weight_com / weight, bias, R_flange_sensor, gravity_direction)
