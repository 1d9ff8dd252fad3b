"""What errors that go with the orientation add to the covariances, beyond what a kernel across poses can say.

A kernel treats all axes of a group alike. Gain and cross-talk are part of what the sensor reads at any orientation, and
a robot's error in orientation turns the weight, which moves nothing along gravity: both are worked out here.
"""

from __future__ import annotations

import numpy as np

from ..calibration.fields import Kind
from ..geometry.arrays import Array
from ..geometry.wrench import cross_matrix
from ..model import gravity_in_flange, matrix_jacobian, wrench_jacobian, wrench_matrix
from .hypotheses import priors_at
from .moments import precision_times
from .orientation_errors import CORRELATION
from .tables import Problem, Table

AXES = range(6)


def of_orientation(problem: Problem, tables: list[Table], weight: Array) -> tuple[Array, Array]:
    """What joins the covariance (p, p) of the parameters, and that of B (24, 24), by the probabilities `weight` of all
    members of the tables.
    """
    of_parameters, of_B, k = np.zeros((len(problem.names),) * 2), np.zeros((24, 24)), 0
    for table in tables:
        kinds = [table.kernel_of(j)[0].kind for j in range(len(table.members.kernel))]
        for kind in (Kind.GAIN, Kind.ROBOT):
            own = [j for j, of in enumerate(kinds) if of is kind]
            if not own:
                continue
            share = float(sum(weight[k + j] for j in own))
            best = max(own, key=lambda j: float(table.members.log_evidence[j]))
            if kind is Kind.GAIN:
                of_B += share * _slopes(problem, table, best)
            else:
                of_parameters += share * _turns(problem, table, best)
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
    prior = priors_at(table.tool, problem.names, table.hypotheses, problem.question)
    information[np.ix_(problem.columns, problem.columns)] += prior.information[m.hypothesis[member]]
    right[problem.columns] += prior.pull[m.hypothesis[member]]
    information[range(q, q + 18), range(q, q + 18)] += np.repeat(1.0 / (strength**2 * variance), 3)
    covariance = _inverse(information)
    to_B = np.zeros((24, q + 18))
    to_B[:, :q] = matrix_jacobian(table.tool, problem.names)
    for axis in AXES:
        to_B[4 * axis : 4 * axis + 3, q + 3 * axis : q + 3 * axis + 3] = np.eye(3)
    found = to_B[:, q:] @ (covariance @ right)[q:]
    rigid = to_B[:, :q] @ covariance[:q, :q] @ to_B[:, :q].T
    beyond: Array = to_B @ covariance @ to_B.T - rigid + np.outer(found, found)
    return beyond


def _turns(problem: Problem, table: Table, member: int) -> Array:
    """Of a robot whose orientation is off from pose to pose: the covariance of the parameters by errors that turn the
    weight, less that by the kernel's, which has them alike on all axes.
    """
    m, kept = table.members, table.kept
    drift, strength = table.kernel_of(member)
    variance, relative = m.variance[member], problem.relative[kept]
    D = wrench_jacobian(table.tool, problem.R_base_flange[kept], problem.names)
    weighted = np.stack(
        [precision_times(drift.columns[kept], strength, relative, D[:, axis]) / variance[axis] for axis in AXES], axis=1
    )
    information = np.einsum("naq,nar->qr", D, weighted)
    prior = priors_at(table.tool, problem.names, table.hypotheses, problem.question)
    information[np.ix_(problem.columns, problem.columns)] += prior.information[m.hypothesis[member]]
    gain = np.einsum("qr,nar->nqa", _inverse(information), weighted)
    r = gravity_in_flange(problem.R_base_flange[kept], table.tool.gravity_direction)
    place = np.flatnonzero(kept)
    alike = CORRELATION ** np.abs(np.subtract.outer(place, place))
    of_axis = gain * np.sqrt(variance)
    by_kernel = strength**2 * np.einsum("nqa,nm,mra->qr", of_axis, alike * (r @ r.T), of_axis, optimize=True)
    turn = 1.5 * strength**2 * float(np.mean(variance[:3])) / max(table.tool.weight**2, 1e-12)  # rad^2
    turned = gain @ (wrench_matrix(table.tool)[:, :3] @ cross_matrix(r))
    by_turns = turn * np.einsum("nqc,nm,mrc->qr", turned, alike, turned, optimize=True)
    beyond: Array = by_turns - by_kernel
    return beyond


def _inverse(information: Array) -> Array:
    unit = np.sqrt(np.diag(information)) + 1e-100
    scaled = information / np.outer(unit, unit) + 1e-13 * np.eye(len(unit))
    return np.asarray(np.linalg.inv(scaled) / np.outer(unit, unit))
