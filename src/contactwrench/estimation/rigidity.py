"""Whether what moved was a rigid tool, and its motion as the poses have it.

Positions in other axes than the orientations, a stream of poses that is too slow, an accelerometer behind a filter,
something that swings on the tool: each leaves forces that follow the motion, and a rigid tool takes up what it can of
them, with parameters that are wrong and a std of the noise alone. So what is left is explained once more, by any matrix
D (6, 12) of the terms of the motion; noise gives it no more than its 72 numbers' worth. And forces say by themselves
how positions were read: a matrix, which is 1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..calibration.calibration import Calibration
from ..calibration.dynamics import turning
from ..geometry.arrays import Array
from ..samples.flange_motion import FlangeMotion
from ..samples.samples import Samples
from ..samples.timestamps import spread_evenly
from .motion_moments import MOTION, ONE, MotionMoments

BY_CHANCE = 1.6
"""Times what noise gives on average: 0.1 % of recordings have more."""
ROWS = 4000
"""Of the motion, evenly: to tell nine numbers and three."""
RIDGE = 1e-9
OTHERWISE, SURELY_OTHERWISE, ALMOST = 0.08, 8.0, 0.35
"""Of the matrix between true accelerations and those of the positions: what is no rounding of it, in std too, and how
far it may be off one that only exchanges axes. The sensor's filter and delay make some hundredths.
"""


@dataclass(frozen=True, eq=False)
class BeyondRigid:
    """Of what a rigid tool leaves in motion: how much any matrix of the motion's terms explains, over what it would of
    noise, `ratio`; and how large that is, as a share of the force, or of the torque, that the motion makes felt.
    """

    ratio: float
    share: float

    @property
    def shows(self) -> bool:
        """Whether chance does not explain it."""
        return self.ratio > BY_CHANCE


def beyond_rigid(left: Array, weight: Array, variance: Array, moments: MotionMoments) -> BeyondRigid:
    """Any matrix against the rigid one.

    Args:
        left: combination (6, 72) of the columns of the moments that a rigid tool leaves.
        weight: of windows (w, 6).
        variance: of the noise, (6, b).
        moments: of the motion.
    """
    columns, still = np.r_[: MOTION.stop], ONE + 1
    gain, of_any, of_rigid = 0.0, np.zeros(2), np.zeros(2)
    felt = moments.products.sum(axis=(0, 1))[MOTION, MOTION]
    for axis, (own, combination) in enumerate(zip(weight.T, left, strict=True)):
        seen = np.tensordot(np.outer(own, 1.0 / variance[axis]), moments.products, 2)
        normal, right = seen[np.ix_(columns, columns)], seen[columns] @ combination
        unit = 1.0 / np.sqrt(np.maximum(np.diag(normal), 1e-300))
        scaled, pull = normal * np.outer(unit, unit) + RIDGE * np.eye(len(unit)), unit * right
        more = np.linalg.solve(scaled, pull)
        fewer = np.linalg.solve(scaled[:still, :still], pull[:still])
        gain += float(pull @ more - pull[:still] @ fewer)
        found, rigid = (unit * more)[MOTION], combination[MOTION]
        of_any[axis // 3] += found @ felt @ found
        of_rigid[axis // 3] += rigid @ felt @ rigid
    share = float(np.sqrt(np.max(of_any / np.maximum(of_rigid, 1e-300))))
    return BeyondRigid(gain / left[:, MOTION].size, share)


@dataclass(frozen=True, eq=False)
class PositionsRead:
    """By which `matrix` (3, 3), base axes, accelerations of the positions become those that the forces tell, and its
    `std` (3, 3).
    """

    matrix: Array
    std: Array

    @property
    def otherwise(self) -> bool:
        """Whether they are read otherwise than they are given."""
        off = np.abs(self.matrix - np.eye(3))
        return bool(np.any((off > OTHERWISE) & (off > SURELY_OTHERWISE * self.std)))

    @property
    def cause(self) -> str | None:
        """What true positions are of those given, where that is something plain: axes exchanged or reversed, a unit."""
        exchanged, scale = np.round(self.matrix), float(np.trace(self.matrix)) / 3.0
        if np.abs(self.matrix - exchanged).max() < ALMOST and np.array_equal(exchanged @ exchanged.T, np.eye(3)):
            each = ["-"[: int(row.sum() < 0.0)] + "xyz"[int(np.argmax(np.abs(row)))] for row in exchanged]
            if each != ["x", "y", "z"]:
                return f"{', '.join(each)} of those given"
        if np.abs(self.matrix - scale * np.eye(3)).max() < OTHERWISE * scale:
            return f"{scale:.3g} times those given"
        return None


def positions_read(calibration: Calibration, samples: Samples, motion: FlangeMotion) -> PositionsRead:
    """How forces in motion say that positions are read: `f = -m R_sensor_base (M a + W p)`, linear in M and in where
    the centre of mass is, p (3,) from the flange's origin, W the acceleration of a turning body's points.

    Args:
        calibration: of the stops, a rigid one.
        samples: with the wrench.
        motion: by positions.
    """
    inside = np.flatnonzero(motion.inside)
    rows = inside[np.linspace(0, len(inside) - 1, min(len(inside), ROWS)).astype(int)]
    R, R_sensor_flange = motion.R_base_flange[rows], np.asarray(calibration.R_flange_sensor).T
    force = calibration.compensate(samples.wrench[rows], samples.R_base_flange[rows])[:, :3]
    omega = motion.angular_velocity[rows]
    W = turning(motion.angular_acceleration[rows], omega[:, :, None] * omega[:, None])
    a = np.einsum("nij,nj->ni", R, motion.acceleration[rows])
    of_matrix = np.einsum("ij,nkj,nl->nikl", R_sensor_flange, R, a).reshape(-1, 3, 9)
    columns = -float(calibration.mass or 0.0) * np.concatenate([of_matrix, R_sensor_flange @ W], axis=2).reshape(-1, 12)
    one = np.r_[np.eye(3).ravel(), np.zeros(3)]
    normal = columns.T @ columns
    inverse = np.linalg.inv(normal + RIDGE * np.trace(normal) * np.eye(12))
    found = one + inverse @ (columns.T @ (force.ravel() - columns @ one))
    left = float(np.mean((force.ravel() - columns @ found) ** 2))
    seconds = len(inside) * float(np.median(np.diff(spread_evenly(np.asarray(samples.t)))))
    each_counts = max(len(rows) / (2.0 * motion.bandwidth * seconds), 1.0)
    std = np.sqrt(left * each_counts * np.diag(inverse)[:9])
    return PositionsRead(found[:9].reshape(3, 3), std.reshape(3, 3))
