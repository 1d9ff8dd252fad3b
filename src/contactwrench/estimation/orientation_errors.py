"""Errors that go with the orientation: of the sensor, of cables. Neighbouring poses have them in common.

Taken for independent from pose to pose they would make a calibration far too sure: in a cone the same error comes with
every pose, and what is learned there does not hold elsewhere. Each is a covariance across poses with a strength in
units of the noise, beside those of a bias that moves (bias_drift.py): none is chosen, all are in the mean.

A kernel treats all axes of a group alike. Gain and cross-talk are part of what the sensor reads at any orientation:
what that adds to the covariance is worked out here, too.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..calibration.findings import Kind
from ..geometry.arrays import Array
from ..model import gravity_in_flange, matrix_jacobian, wrench_jacobian
from .bias_drift import ROWS_IN_ORDER, Drift
from .problem import Problem
from .tables import Table, covariance_of_errors
from .variance_components import inverse_of

ODDS = {Kind.GAIN: 0.4, Kind.CREEP: 0.2, Kind.CABLE: 0.2}
"""Before the readings, against independent errors: sensors and cables err less often."""

FIELD_LENGTH = 0.5
"""rad over which the pull of a cable changes."""

AXES = range(6)
MOST_POSES = 100
"""With more, poses taken on the way most often, no cable is looked for."""


def orientation_errors(
    R_base_flange: Array, gravity_direction: Array, in_order: bool
) -> tuple[list[Drift], list[float]]:
    """Errors of sensor and cable that poses may have by their orientation, each with columns (n, q) of unit strength,
    and the logarithm of the odds of each: gain and cross-talk, creep, a cable; `in_order`: poses are known to be.
    """
    n = len(R_base_flange)
    r = gravity_in_flange(R_base_flange, gravity_direction)
    drifts = [Drift(Kind.GAIN, r), Drift(Kind.CREEP, np.diff(-r, axis=0, prepend=-r[:1]))]
    if n <= MOST_POSES:
        flat = R_base_flange.reshape(n, 9)
        chord = np.maximum(6.0 - 2.0 * flat @ flat.T, 0.0)  # ||R_i - R_j||^2, about twice the squared angle
        drifts.append(Drift(Kind.CABLE, _root(np.exp(-chord / (4.0 * FIELD_LENGTH**2)))))
    odds = ODDS | {Kind.CREEP: ODDS[Kind.CREEP] * (1.0 if in_order else ROWS_IN_ORDER)}
    return drifts, [float(np.log(odds[drift.kind])) for drift in drifts if drift.kind is not None]


def _root(covariance: Array) -> Array:
    """L (n, q) with `L @ L.T` the covariance."""
    values, vectors = np.linalg.eigh(covariance)
    seen = values > 1e-6 * values[-1]
    return np.asarray(vectors[:, seen] * np.sqrt(values[seen]))


def two_levels(low: NDArray[np.bool_]) -> Drift:
    """A bias that comes back in two levels, as backlash has: poses of the lower one (n,) and the others, the constant
    halfway between.
    """
    return Drift(Kind.TWO_LEVELS, np.where(low, -0.5, 0.5)[:, None])


def of_gain(problem: Problem, tables: list[Table], weight: Array) -> Array:
    """What gain and cross-talk add to the covariance of B (24, 24), by the probabilities `weight` of all members."""
    of_B, k = np.zeros((24, 24)), 0
    for table in tables:
        own = np.flatnonzero(table.kinds == Kind.GAIN)
        if len(own):
            best = int(own[np.argmax(table.members.log_evidence[own])])
            of_B += float(weight[k + own].sum()) * _slopes(problem, table, best)
        k += len(table.kinds)
    return of_B


def _slopes(problem: Problem, table: Table, member: int) -> Array:
    """Of a sensor with gain and cross-talk: the covariance of B with a slope of its own for each axis, less that of the
    rigid B, and the slopes that were found.
    """
    m, kept, q = table.members, table.kept, len(problem.names)
    drift, strength = table.kernel_of(member)
    variance = m.variance[member]
    D = np.zeros((int(kept.sum()), 6, q + 18))
    D[:, :, :q] = wrench_jacobian(table.tool, problem.R_base_flange[kept], problem.names)
    for axis in AXES:
        D[:, axis, q + 3 * axis : q + 3 * axis + 3] = drift.columns[kept]
    weighted = covariance_of_errors(problem, table, member, without_kernel=True).precision_times(D)
    information = np.tensordot(D, weighted, ((0, 1), (0, 1)))
    right = np.tensordot(weighted, problem.errors(table.tool, float(m.turn[member]))[kept], ((0, 1), (0, 1)))
    information[np.ix_(problem.columns, problem.columns)] += table.priors.information[m.hypothesis[member]]
    right[problem.columns] += table.priors.pull[m.hypothesis[member]]
    information[range(q, q + 18), range(q, q + 18)] += np.repeat(1.0 / (strength**2 * variance), 3)
    covariance = inverse_of(information)
    to_B = np.zeros((24, q + 18))
    to_B[:, :q] = matrix_jacobian(table.tool, problem.names)
    for axis in AXES:
        to_B[4 * axis : 4 * axis + 3, q + 3 * axis : q + 3 * axis + 3] = np.eye(3)
    found = (covariance @ right)[q:].reshape(2, 9)
    rigid = to_B[:, :q] @ covariance[:q, :q] @ to_B[:, :q].T
    alike = np.diag(np.repeat(np.mean(found**2, axis=1), 9))  # as large as found, in no direction of its own
    return np.asarray(to_B @ covariance @ to_B.T - rigid + to_B[:, q:] @ alike @ to_B[:, q:].T)
