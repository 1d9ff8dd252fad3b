"""Errors that go with the orientation: of the sensor, of the robot, of cables. Neighbouring poses have them in common.

Taken for independent from pose to pose they would make a calibration far too sure: in a cone the same error comes with
every pose, and what is learned there does not hold elsewhere. Each is a covariance across poses with a strength in
units of the noise, beside those of a bias that moves (bias_drift.py): none is chosen, all are in the mean.

A kernel treats all axes of a group alike. Gain and cross-talk are part of what the sensor reads at any orientation, and
a robot's error in orientation turns the weight, which moves nothing along gravity: what that adds to the covariances is
worked out here, too.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..calibration.findings import Kind
from ..geometry.arrays import Array
from ..geometry.wrench import cross_matrix
from ..model import gravity_in_flange, matrix_jacobian, wrench_jacobian, wrench_matrix
from .bias_drift import Drift
from .moments import precision_times
from .tables import Problem, Table

ODDS = {Kind.GAIN: 0.4, Kind.CREEP: 0.2, Kind.CABLE: 0.2, Kind.ROBOT: 2.5}
"""Before the readings, against independent errors: robots err in orientation, sensors and cables less often."""

IN_ORDER = (Kind.CREEP, Kind.ROBOT)
"""What goes on from one pose to the next shows where their order is known."""

FIELD_LENGTH = 0.5
"""rad over which the pull of a cable changes."""

CORRELATION = 0.85
"""Of the robot's error in orientation from one pose to the next."""

AXES = range(6)
MOST_POSES = 100
"""With more, poses taken on the way most often, only the sensor's gain is looked for."""


def orientation_errors(R_base_flange: Array, gravity_direction: Array) -> dict[Kind, Drift]:
    """Columns (n, q) of unit strength: of gain and cross-talk, of a cable, of the robot's orientation. By what the
    latter is off in all poses alike the mounting comes out turned, which no reading shows: `_turns` counts it.
    """
    n = len(R_base_flange)
    r = gravity_in_flange(R_base_flange, gravity_direction)
    of_sensor = {Kind.GAIN: Drift(Kind.GAIN, r), Kind.CREEP: Drift(Kind.CREEP, np.diff(-r, axis=0, prepend=-r[:1]))}
    if n > MOST_POSES:
        return of_sensor
    flat = R_base_flange.reshape(n, 9)
    chord = np.maximum(6.0 - 2.0 * flat @ flat.T, 0.0)  # ||R_i - R_j||^2, about twice the squared angle
    cable = np.exp(-chord / (4.0 * FIELD_LENGTH**2))
    apart = np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
    alike = CORRELATION**apart
    varying = alike - alike.mean(axis=0) - alike.mean(axis=1)[:, None] + alike.mean()
    robot = varying * (r @ r.T)
    return {
        **of_sensor,
        Kind.CABLE: Drift(Kind.CABLE, _root(cable)),
        Kind.ROBOT: Drift(Kind.ROBOT, _root(robot)),
    }


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


def of_orientation(problem: Problem, tables: list[Table], weight: Array) -> tuple[Array, Array]:
    """What joins the covariance (p, p) of the parameters, and that of B (24, 24), by the probabilities `weight` of all
    members of the tables.
    """
    of_parameters, of_B, k = np.zeros((len(problem.names),) * 2), np.zeros((24, 24)), 0
    for table in tables:
        kinds = table.kinds
        for kind in (Kind.GAIN, Kind.ROBOT):
            own = np.flatnonzero(kinds == kind)
            if not len(own):
                continue
            share = weight[k + own]
            best = int(own[np.argmax(table.members.log_evidence[own])])
            if kind is Kind.GAIN:
                of_B += float(share.sum()) * _slopes(problem, table, best)
            else:
                strength = table.kernels.strength[table.members.kernel[own]]
                power = strength**2 * table.members.variance[own, :3].mean(axis=1)
                of_parameters += float(share @ power) * _turns(problem, table, best)
        k += len(kinds)
    return of_parameters, of_B


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
    unit = np.sqrt(problem.relative[kept, None] * variance)
    whitened = (D / unit[:, :, None]).reshape(-1, q + 18)
    information = whitened.T @ whitened
    right = whitened.T @ (problem.errors(table.tool)[kept] / unit).ravel()
    information[np.ix_(problem.columns, problem.columns)] += table.priors.information[m.hypothesis[member]]
    right[problem.columns] += table.priors.pull[m.hypothesis[member]]
    information[range(q, q + 18), range(q, q + 18)] += np.repeat(1.0 / (strength**2 * variance), 3)
    covariance = _inverse(information)
    to_B = np.zeros((24, q + 18))
    to_B[:, :q] = matrix_jacobian(table.tool, problem.names)
    for axis in AXES:
        to_B[4 * axis : 4 * axis + 3, q + 3 * axis : q + 3 * axis + 3] = np.eye(3)
    found = (covariance @ right)[q:].reshape(2, 9)
    rigid = to_B[:, :q] @ covariance[:q, :q] @ to_B[:, :q].T
    alike = np.diag(np.repeat(np.mean(found**2, axis=1), 9))  # as large as found, in no direction of its own
    return np.asarray(to_B @ covariance @ to_B.T - rigid + to_B[:, q:] @ alike @ to_B[:, q:].T)


def _turns(problem: Problem, table: Table, member: int) -> Array:
    """Of a robot whose orientation is off: the covariance of the parameters by errors that turn the weight, less that
    by the kernel's, which has them alike on all axes and none in all poses; for forces that are off by 1 N an axis.
    """
    m, kept = table.members, table.kept
    drift, strength = table.kernel_of(member)
    variance, relative = m.variance[member], problem.relative[kept]
    D = wrench_jacobian(table.tool, problem.R_base_flange[kept], problem.names)
    weighted = np.stack(
        [precision_times(drift.columns[kept], strength, relative, D[:, axis]) / variance[axis] for axis in AXES], axis=1
    )
    information = np.einsum("naq,nar->qr", D, weighted)
    information[np.ix_(problem.columns, problem.columns)] += table.priors.information[m.hypothesis[member]]
    gain = np.einsum("qr,nar->nqa", _inverse(information), weighted)
    r = gravity_in_flange(problem.R_base_flange[kept], table.tool.gravity_direction)
    place = np.flatnonzero(kept)
    alike = CORRELATION ** np.abs(np.subtract.outer(place, place))
    by_axis = gain * np.sqrt(variance / np.mean(variance[:3]))
    of_columns = np.tensordot(drift.columns[kept], by_axis, (0, 0))
    by_kernel = np.tensordot(of_columns, of_columns, ((0, 2), (0, 2)))
    turn = 1.5 / max(table.tool.weight**2, 1e-12)  # rad^2
    turned = gain @ (wrench_matrix(table.tool)[:, :3] @ cross_matrix(r))
    of_alike = np.tensordot(alike, turned, 1)
    return np.asarray(turn * np.tensordot(turned, of_alike, ((0, 2), (0, 2))) - by_kernel)


def _inverse(information: Array) -> Array:
    unit = np.sqrt(np.maximum(np.diag(information), 0.0)) + 1e-100
    scaled = information / np.outer(unit, unit) + 1e-13 * np.eye(len(unit))
    return np.asarray(np.linalg.inv(scaled) / np.outer(unit, unit))
