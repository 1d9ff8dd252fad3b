"""How well a rigid tool can explain thousands of interpretations of one file, all at once.

An interpretation is one of the orientation's columns times one of the wrench's. For each, the mounting that explains
the forces best is a Procrustes rotation (Kabsch, 1976; see estimation/initial_guess.py), and with it held the torques
are linear in weight * com: so second moments of the centred rows decide, and nothing is iterated.

    sum |F - G Q r - F0|^2  is least for  G = tr(Q M_F) / S,   M_F = sum r F^T,   S = sum |r|^2,   Q = R_flange_sensor^T

Negated readings have the moments negated, so both signs come for one decomposition.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..geometry.arrays import Array
from ..geometry.rotations import procrustes
from ..model import gravity_in_flange
from .interpretations import (
    COST_OF_CHANGE,
    REVERSED_SIGN,
    Interpretations,
    OrientationInterpretation,
    WrenchInterpretation,
)

LEAST_TILT = 1e-6
"""Of the squared gravity directions, on average: an interpretation in which gravity moves less explains nothing."""

PARAMETERS = np.array([7.0, 6.0])
"""Of model mount: weight, mounting and bias weigh on the forces; weight * com and bias on the torques."""

NOTHING_LEFT = 1e-6
"""Of the readings' scatter: where all is explained, the digits of the numbers in a file still leave that much."""

MOST_FITTED, LEAST_FITTED = 12, 2
NOT_FITTED = 60.0
"""-2 log of the odds by which screening may be worse than at its best, and its interpretation still be fitted."""

SAME_FIT = 1e-6
"""Relative: interpretations of which screening leaves sums of squares this close are one class, see docs/method.md."""

SAME_ODDS = 1e-3
"""Interpretations of a class differ by less: the first of them is taken, whatever the rounding."""


def screen(
    orientations: Sequence[OrientationInterpretation],
    wrenches: Sequence[WrenchInterpretation],
    wrench: Array,
    gravity_direction: Array,
) -> tuple[Array, Array]:
    """What a rigid tool leaves of each interpretation of `wrench` (n, 6), the file's columns: sums of squares
    (orientations, wrenches, 2, 2), the last axis for force (N^2) and torque (N^2 m^2), the one before for the readings
    and the negated readings; and of how many degrees of freedom (orientations, 1, 1, 2).
    """
    matrices, in_base = np.array([w.matrix for w in wrenches]), np.array([w.in_base for w in wrenches])
    cross, total, square, rows = [], [], [], []
    for orientation in orientations:
        r = gravity_in_flange(orientation.R_base_flange, gravity_direction)
        r = r - r.mean(axis=0)
        n = len(r)
        read = (wrench[orientation.rows] @ matrices.reshape(-1, 6).T).reshape(n, -1, 2, 3)
        stated_in_base = read[:, in_base]
        turned_back = stated_in_base.reshape(n, -1, 3) @ orientation.R_base_flange
        read[:, in_base] = turned_back.reshape(stated_in_base.shape)
        read -= read.mean(axis=0)
        cross.append((r.T @ read.reshape(n, -1)).reshape(3, -1, 2, 3).transpose(1, 2, 0, 3))
        total.append(np.einsum("nkpb,nkpb->kp", read, read))
        square.append(r.T @ r)
        rows.append(n)
    of_rows = np.array(rows, dtype=np.float64)
    squares = _unexplained(np.array(cross), np.array(total), np.array(square), of_rows)
    return squares, (3.0 * of_rows[:, None] - PARAMETERS)[:, None, None]


def _unexplained(cross: Array, total: Array, square: Array, n: Array) -> Array:
    """From moments `cross` (v, k, 2, 3, 3), `total` (v, k, 2) and `square` (v, 3, 3) of n (v,) rows; force first."""
    spread = np.trace(square, axis1=1, axis2=2)
    moving = spread > LEAST_TILT * n
    spread = np.where(moving, spread, np.inf)
    inertia = np.where(moving, spread, 1.0)[:, None, None] * np.eye(3) - square
    inverse_inertia = np.linalg.pinv(inertia, rcond=1e-9, hermitian=True)[:, None]
    squares = np.empty((*total.shape[:2], 2, 2))
    for k, sign in enumerate((1.0, -1.0)):
        force, torque = sign * cross[:, :, 0], sign * cross[:, :, 1]
        R_flange_sensor = procrustes(force)
        pull = np.sum(R_flange_sensor * force, axis=(-2, -1))
        squares[..., k, 0] = total[..., 0] - pull**2 / spread[:, None]
        across = torque @ np.swapaxes(R_flange_sensor, -1, -2)
        moment = np.stack([across[..., i, j] - across[..., j, i] for i, j in ((1, 2), (2, 0), (0, 1))], axis=-1)
        explained = np.einsum("vki,vkij,vkj->vk", moment, inverse_inertia * moving[:, None, None, None], moment)
        squares[..., k, 1] = total[..., 1] - explained
    return np.asarray(np.maximum(squares, NOTHING_LEFT**2 * total[0, 0] + 1e-300))


def scatter_of(wrench: Array, matrices: Array) -> Array:
    """The variance (k, 2) of a component of force and of torque in the columns (n, 6), read by `matrices` (k, 6, 6)."""
    variance = np.maximum(np.var(wrench, axis=0, ddof=1), 1e-300)
    return np.asarray((matrices**2 @ variance).reshape(-1, 2, 3).mean(axis=2))


def misfit(squares: Array, dof: Array, scatter: Array) -> Array:
    """-2 log likelihood of fits that leave `squares` (..., 2) of force and torque in `dof` degrees of freedom, against
    that of no tool, which leaves their `scatter`: so a row that an explanation leaves out counts as unexplained.

    The variances are not known beforehand: they are integrated out under Jeffreys' prior, the parameters with them, so
    that what few degrees of freedom leave by chance counts for little.
    """
    return np.asarray(np.sum(dof * (np.log(np.maximum(squares, 1e-300)) - np.log(dof * scatter)), axis=-1))


@dataclass(frozen=True, eq=False)
class Screened:
    """What screening makes of all ways to read a file, by orientation, wrench and sign: the logarithm of the sums of
    squares left of force and torque (..., 2), and `odds`, -2 log of the odds against an interpretation, its changes
    counted.
    """

    log_squares: Array
    odds: Array

    def classes(self) -> list[tuple[int, int, int]]:
        """Places of the most promising interpretations, one of each class, best first."""
        places: list[tuple[int, int, int]] = []
        left = self.odds.copy()
        while len(places) < MOST_FITTED and (least := left.min()) < np.inf:
            if len(places) >= LEAST_FITTED and least > self.odds.min() + NOT_FITTED:
                break
            first = np.argmax(left <= least + SAME_ODDS)
            orientation, wrench, negative = (int(k) for k in np.unravel_index(first, left.shape))
            places.append((orientation, wrench, negative))
            left[self.class_of(places[-1])] = np.inf
        return places

    def class_of(self, place: tuple[int, int, int]) -> NDArray[np.bool_]:
        """Which interpretations screening cannot tell from the one at `place`."""
        same: NDArray[np.bool_] = (np.abs(self.log_squares - self.log_squares[place]) < SAME_FIT).all(axis=-1)
        return same


def screened(file: Interpretations) -> Screened:
    """All ways to read a file, judged in closed form."""
    squares, dof = screen(file.orientations, file.wrenches, file.wrench, file.down)
    changed_sign = np.array([file.sign == "reaction", file.sign == "pull"], dtype=np.float64)
    costs = (
        np.array([o.cost for o in file.orientations])[:, None, None]
        + np.array([w.cost for w in file.wrenches])[:, None]
        + REVERSED_SIGN * changed_sign
    )
    scatter = scatter_of(file.wrench, np.array([w.matrix for w in file.wrenches]))[:, None]
    return Screened(np.log(squares), misfit(squares, dof, scatter) + COST_OF_CHANGE * costs)
