"""A global initial guess for the joint fit, so that no mounting and no base needs a guess.

With mounting and direction of gravity held, the model is linear in weight, weight * com and bias. Eliminating those
leaves a score through second moments of the centred poses: so it costs next to nothing to score many, and the best few
go on to Gauss-Newton (method, "A start that needs no guess").
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..calibration.observability import LEVER
from ..geometry.arrays import Array
from ..geometry.rotations import procrustes, rotations_about_z, spread_directions, spread_rotations
from ..geometry.wrench import cross_matrix
from ..model import FLIP, RigidTool, gravity_in_flange

FEW_POSES = 5
"""Up to here an unknown base has local optima that score well, so that every direction of gravity goes on."""

ALIKE = 0.9
"""Correlation of two changes of gravity."""

LEAST_INERTIA = 1e-9
"""Of the poses' spread: a direction in which a centre of mass shows less does not show."""


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


def initial_guesses(
    R_base_flange: Array, wrench: Array, search: Search, gravity_direction: Array
) -> Iterator[RigidTool]:
    """The most promising tools, best first, from poses (n, 3, 3) and their readings (n, 6). Where gravity changes with
    the pose alike in the sensor's axes of two, one leads where the other does, and the better is enough.
    """
    few = len(wrench) <= FEW_POSES
    scores, mountings, directions = _scored(R_base_flange, wrench, search, gravity_direction)
    of_each, most = (1, len(directions) if few else 4) if search.any_base else (2, 2)
    best = np.argsort(-scores, axis=1)[:, :of_each]
    d, k = np.repeat(np.arange(len(directions)), of_each), best.ravel()
    order = np.argsort(-scores[d, k])[:most]
    changes: list[Array] = []
    for down, mounting in ((directions[d[i]], mountings[d[i], k[i]]) for i in order):
        u = gravity_in_flange(R_base_flange, down) @ mounting
        change = (u - u.mean(axis=0)).ravel()
        change = change / max(float(np.linalg.norm(change)), 1e-300)
        if all(change @ other < ALIKE for other in changes):
            changes.append(change)
            yield linear_fit(R_base_flange, wrench, mounting, down)


def explained_by_guess(R_base_flange: Array, wrench: Array, search: Search, gravity_direction: Array) -> float:
    """The part of the readings' sum of squares that the best guess explains with a positive weight."""
    return float(_scored(R_base_flange, wrench, search, gravity_direction)[0].max())


def _scored(
    R_base_flange: Array, wrench: Array, search: Search, gravity_direction: Array
) -> tuple[Array, Array, Array]:
    """Scores (k, m) of mountings (k, m, 3, 3) under each direction of gravity (k, 3)."""
    directions = gravity_direction[None]
    if search.any_base:
        sphere = spread_directions(48)
        directions = sphere[sphere @ gravity_direction >= 0.0]
    moments = _Moments(np.einsum("kj,njl->knl", directions, R_base_flange), wrench)
    mountings = _any_mounting(moments.force) if search.any_mounting else _turned_mounting(moments.force)
    return moments.score(mountings), mountings, directions


class _Moments:
    """Second moments of the centred poses for directions `r` (k, n, 3), all that the score of a mounting needs."""

    def __init__(self, r: Array, wrench: Array) -> None:
        r = r - r.mean(axis=1, keepdims=True)
        wrench = wrench - wrench.mean(axis=0)
        self.spread = np.sum(r * r, axis=(1, 2))
        both = r.transpose(0, 2, 1) @ wrench
        self.force, self.torque = both[:, :, :3], both[:, :, 3:]
        # sum R (u x T) = sum r x (R T) is linear in R.
        of_torque = cross_matrix(self.torque.transpose(0, 2, 1)).transpose(0, 3, 1, 2)
        self.of_mounting = of_torque.reshape(len(r), 9, 3)
        inertia = self.spread[:, None, None] * np.eye(3) - r.transpose(0, 2, 1) @ r
        values, vectors = np.linalg.eigh(inertia)
        seen = values > LEAST_INERTIA * np.maximum(values[:, 2:], 1e-300)
        inverse = np.divide(1.0, values, out=np.zeros_like(values), where=seen)
        self.inverse_inertia = (vectors * inverse[:, None, :]) @ vectors.transpose(0, 2, 1)

    def weight(self, R: Array) -> Array:
        """The least-squares weight (k, m) for mountings (k, m, 3, 3), no less than zero."""
        k, m = R.shape[:2]
        along = (R.reshape(k, m, 9) @ self.force.reshape(k, 9, 1))[..., 0]
        return np.asarray(np.maximum(along, 0.0) / np.maximum(self.spread, 1e-300)[:, None])

    def moment(self, R: Array) -> Array:
        """`sum u x T` (k, m, 3) in flange axes: `inverse_inertia @ moment` is weight * com of least squares there."""
        k, m = R.shape[:2]
        return np.asarray(R.reshape(k, m, 9) @ self.of_mounting)

    def score(self, R: Array) -> Array:
        """The part (k, m) of the readings' sum of squares that each mounting explains with a positive weight."""
        moment = self.moment(R)
        explained_torque = np.sum((moment @ self.inverse_inertia) * moment, axis=2)
        return np.asarray(self.spread[:, None] * self.weight(R) ** 2 + explained_torque / LEVER**2)


def _any_mounting(force_moments: Array) -> Array:
    """Of each direction: the proper rotation with the largest `tr(R^T M)`, and rotations all over (k, m, 3, 3)."""
    everywhere = spread_rotations(24, 12)
    spread = np.broadcast_to(everywhere, (len(force_moments), *everywhere.shape))
    return np.concatenate([procrustes(force_moments)[:, None], spread], axis=1)


def _turned_mounting(force_moments: Array) -> Array:
    """Of each direction: `Rz(yaw)` and `FLIP @ Rz(yaw)`, the closed form of each, and a turn in steps of 10 degrees."""
    turn = rotations_about_z(np.deg2rad(np.arange(0.0, 360.0, 10.0)))
    spread = np.concatenate([turn, FLIP @ turn])
    closed = [
        flip @ rotations_about_z(np.arctan2(M[:, 1, 0] - M[:, 0, 1], M[:, 0, 0] + M[:, 1, 1]))
        for flip, M in ((np.eye(3), force_moments), (FLIP, FLIP @ force_moments))
    ]
    everywhere = np.broadcast_to(spread, (len(force_moments), *spread.shape))
    return np.concatenate([np.stack(closed, axis=1), everywhere], axis=1)


def linear_fit(R_base_flange: Array, wrench: Array, R_flange_sensor: Array, gravity_direction: Array) -> RigidTool:
    """Weight, com and bias of least squares with both rotations held; the weight kept above zero."""
    r = gravity_in_flange(R_base_flange, gravity_direction)
    moments, R = _Moments(r[None], wrench), R_flange_sensor[None, None]
    weight = float(moments.weight(R)[0, 0])
    weight_com = R_flange_sensor.T @ moments.inverse_inertia[0] @ moments.moment(R)[0, 0]
    weight = max(weight, 1e-3 * float(np.abs(wrench[:, :3]).max()), 1e-9)
    u_mean = r.mean(axis=0) @ R_flange_sensor
    bias = wrench.mean(axis=0) - np.r_[weight * u_mean, np.cross(weight_com, u_mean)]
    return RigidTool(weight, weight_com / weight, bias, R_flange_sensor, gravity_direction)
