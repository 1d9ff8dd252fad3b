"""Errors that go with the orientation: of the sensor, of cables. Neighbouring poses have them in common.

Taken for independent from pose to pose they would make a calibration far too sure: in a cone the same error comes with
every pose, and what is learned there does not hold elsewhere. Each is a kernel as a bias that moves is (bias_drift.py).
One kernel is one cause, and one that explains most of what is left hides the other: a gain that hid behind backlash was
in no std, though it grows beyond the poses; a drift that hid behind a gain left the last bias as it was on average. So
where one cause is found, it is looked at with a gain beside it; where that is the gain, each other one is.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..calibration.findings import Kind
from ..calibration.observability import LEVER
from ..geometry.arrays import Array
from ..model import RigidTool, gravity_in_flange, matrix_jacobian, wrench_jacobian
from .bias_drift import SHARE_OF_WEIGHT, STRENGTHS, Drift
from .problem import Problem
from .settling import with_kernels
from .tables import Table, covariance_of_errors, each_with_place, explained
from .variance_components import inverse_of

ODDS = {Kind.GAIN: 0.4, Kind.CREEP: 0.2, Kind.CABLE: 0.2}
"""Before the readings, against independent errors: sensors and cables err less often."""

FIELD_LENGTH, MOST_WITH_CABLE = 0.5, 100
"""rad over which the pull of a cable changes; with more poses, taken on the way most often, none is looked for."""

FEWEST_POSES, FEWEST_OF_KNOWN_TOOL = 8, 6
"""With fewer, a tool, the slopes of a gain and another cause, 14, 18 and 6 numbers, leave next to nothing to judge."""

CLOSE = 4.0
"""Natural logarithm of the odds of a cause, against the likeliest, from which on it is looked at with a gain."""

AS_STRONG = (1.0, 3.0)
"""Times as strong, in units of the noise, as a gain alone: beside another cause less is left to noise."""

MOST_STEPS = 8
"""Places of a step that are looked at beside a gain."""

MOST_OF_SCALE = 3.0
"""Times the scale of its prior: no gain is larger."""


def orientation_errors(
    R_base_flange: Array, gravity_direction: Array, in_order: float
) -> tuple[list[Drift], list[float]]:
    """Errors of sensor and cable that poses may have by their orientation, and the logarithm of the odds of each: gain
    and cross-talk, creep, a cable; `in_order`: the probability that poses are.
    """
    r = gravity_in_flange(R_base_flange, gravity_direction)
    drifts = [Drift(Kind.GAIN, r), Drift(Kind.CREEP, np.diff(-r, axis=0, prepend=-r[:1]))]
    odds = [ODDS[Kind.GAIN], ODDS[Kind.CREEP] * in_order]
    if len(r) <= MOST_WITH_CABLE:
        flat = R_base_flange.reshape(-1, 9)
        chord = np.maximum(6.0 - 2.0 * flat @ flat.T, 0.0)  # ||R_i - R_j||^2, about twice the squared angle
        values, vectors = np.linalg.eigh(np.exp(-chord / (4.0 * FIELD_LENGTH**2)))
        seen = values > 1e-6 * values[-1]
        drifts.append(Drift(Kind.CABLE, vectors[:, seen] * np.sqrt(values[seen])))
        odds.append(ODDS[Kind.CABLE])
    return drifts, np.log(odds).tolist()


def with_gain_beside(problem: Problem, table: Table) -> Table:
    """The settled table with the members in which a gain is beside another cause, where one is likelier than none."""
    m = table.members
    steady = np.exp(m.log_evidence[table.kernels.drift[m.kernel] == 0] - table.log_evidence).sum()
    gain = next((drift for drift in table.kernels.drifts if drift.kind is Kind.GAIN), None)
    few = FEWEST_POSES if problem.question.earlier is None else FEWEST_OF_KNOWN_TOOL
    if table.kept.sum() < few or gain is None or steady > 0.5:
        return table
    if not (pairs := list(_pairs(problem, table, gain))):
        return table
    before = len(table.kernels.drift)
    log_prior = [float(table.kernels.log_prior[k] + np.log(ODDS[Kind.GAIN])) for k, _ in pairs]
    kernels = table.kernels.joined([both for _, both in pairs], log_prior)
    return with_kernels(replace(problem, kernels=kernels), table, np.arange(before, len(kernels.drift)))


def _pairs(problem: Problem, table: Table, gain: Drift) -> Iterator[tuple[int, Drift]]:
    """Kernels of another cause, and their drift with the gain beside it."""
    m, kernels, is_gain = table.members, table.kernels, table.kinds == Kind.GAIN
    near = m.log_evidence > float(m.log_evidence.max()) - CLOSE
    if (near & is_gain).any():
        best = int(np.argmax(np.where(is_gain, m.log_evidence, -np.inf)))
        strengths = m.strength[best] * np.array(AS_STRONG)
        others = [k for k, drift in enumerate(kernels.drifts) if drift.kind not in (None, Kind.GAIN)]
        causes = np.setdiff1d(others, _idle_steps(problem, table, best))
        among = np.flatnonzero(np.isin(kernels.drift, causes))
    else:
        noise = float(np.sqrt(m.variance[table.best, :3].mean()))
        largest = MOST_OF_SCALE * SHARE_OF_WEIGHT[Kind.GAIN] * abs(table.tool.weight)
        strengths = STRENGTHS[STRENGTHS * noise < largest]
        among = np.unique(m.kernel[near & (kernels.drift[m.kernel] > 0)])
    for k in among.tolist():
        for strength in strengths.tolist():
            yield k, kernels.drifts[kernels.drift[k]].beside(gain, float(kernels.strength[k]), strength)


def _idle_steps(problem: Problem, table: Table, member: int) -> NDArray[np.intp]:
    """The steps of the bias but for those few that would take most off what a member with a gain leaves."""
    steps = np.array(
        [k for k, drift in enumerate(table.kernels.drifts) if drift.first_after is not None], dtype=np.intp
    )
    left, *known = explained(problem, table, member)
    left = ((left - sum(known)) / np.sqrt(table.members.variance[member]))[table.kept]
    before = np.hstack([table.kernels.drifts[k].columns[table.kept] for k in steps.tolist()] or [left[:, :0]])
    before, left = before - before.mean(axis=0), left - left.mean(axis=0)
    taken = np.sum((before.T @ left) ** 2, axis=1) / np.maximum(np.sum(before**2, axis=0), 1e-12)
    return steps[np.argsort(-taken)[MOST_STEPS:]]


def covariance_of_gain(problem: Problem, tables: list[Table], weight: Array) -> Array:
    """What gain and cross-talk add to the covariance of B (24, 24), by the probabilities `weight` of all members."""
    of_B = np.zeros((24, 24))
    for table, here in each_with_place(tables):
        own = np.flatnonzero(table.with_gain)
        if len(own):
            best = int(own[np.argmax(table.members.log_evidence[own])])
            of_B += float(weight[here][own].sum()) * _slopes(problem, table, best)
    return of_B


def hidden_in_parameters(
    of_B: Array, tool: RigidTool, from_parameters: Array, covariance: Array, known: Array
) -> Array:
    """What gain and cross-talk add to the covariance (p, p) of the parameters: of what they add to that of B, `of_B`
    (24, 24), as much as looks like another tool and mounting, less by the better rows (k, p) of what is `known` tell
    it. B follows the parameters by `from_parameters` (24, p). Torques count by what a force does at the tool's lever.
    """
    if not of_B.any():
        return np.zeros_like(covariance)
    std, follows = np.sqrt(np.diag(covariance)), np.eye(len(covariance)) - covariance @ known.T @ known
    lever = max(LEVER, float(np.linalg.norm(tool.com)))
    counts = np.outer(np.repeat([1.0, 1.0 / lever], 3), [1.0, 1.0, 1.0, 0.0]).reshape(24, 1)
    nearest = np.linalg.pinv(counts * from_parameters) * counts.T / std[:, None]
    values, vectors = np.linalg.eigh(nearest @ of_B @ nearest.T)
    root = follows @ (std[:, None] * vectors * np.sqrt(np.maximum(values, 0.0)))  # in places gain lessens it
    return np.asarray(root @ root.T)


def _slopes(problem: Problem, table: Table, member: int) -> Array:
    """Of a sensor with gain and cross-talk: the covariance of B with a slope of its own for each axis, less that of the
    rigid B, and the slopes that were found.
    """
    m, kept, q = table.members, table.kept, len(problem.names)
    drift, strength = table.kernel_of(member)
    r, variance = gravity_in_flange(problem.R_base_flange[kept], problem.question.gravity_direction), m.variance[member]
    strength *= drift.gain or 1.0
    D = np.zeros((int(kept.sum()), 6, q + 18))
    D[:, :, :q] = wrench_jacobian(table.tool, problem.R_base_flange[kept], problem.names)
    for axis in range(6):
        D[:, axis, q + 3 * axis : q + 3 * axis + 3] = r
    weighted = covariance_of_errors(problem, table, member, without_gain=True).precision_times(D)
    information = np.tensordot(D, weighted, ((0, 1), (0, 1)))
    right = np.tensordot(weighted, problem.errors(table.tool, float(m.turn[member]))[kept], ((0, 1), (0, 1)))
    information[np.ix_(problem.columns, problem.columns)] += table.priors.information[m.hypothesis[member]]
    right[problem.columns] += table.priors.pull[m.hypothesis[member]]
    information[range(q, q + 18), range(q, q + 18)] += np.repeat(1.0 / (strength**2 * variance), 3)
    covariance = inverse_of(information)
    to_B = np.zeros((24, q + 18))
    to_B[:, :q] = matrix_jacobian(table.tool, problem.names)
    for axis in range(6):
        to_B[4 * axis : 4 * axis + 3, q + 3 * axis : q + 3 * axis + 3] = np.eye(3)
    found = (covariance @ right)[q:].reshape(2, 9)
    rigid = to_B[:, :q] @ covariance[:q, :q] @ to_B[:, :q].T
    alike = np.diag(np.repeat(np.mean(found**2, axis=1), 9))  # as large as found, in no direction of its own
    return np.asarray(to_B @ covariance @ to_B.T - rigid + to_B[:, q:] @ alike @ to_B[:, q:].T)
