"""Tables of everything that the readings may mean, linearised at one tool: kernels of errors, hypotheses, evidence.

A `Table` has every member that counts for one set of poses: a kernel (how the bias moves, errors that go with the
orientation, each at a strength) with a hypothesis (on mounting and base), its solution and its evidence.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..calibration.findings import Kind
from ..geometry.arrays import Array
from ..model import (
    GRAVITY,
    RigidTool,
    all_but_the_bias,
    free_wrench,
    gravity_in_flange,
    response,
    response_jacobian,
    stepped,
    wrench_matrix,
)
from .bias_drift import STRENGTHS, Drift, Kernels
from .hypotheses import Hypothesis, known_at, priors_at
from .least_squares import Members, Priors, gram, solved
from .moments import moments_of, precision_times
from .noise import NoiseModel
from .outliers import LEVEL_SHARE, log_density_outlying, log_prior_outlying
from .priors import Question

FAR = 10.0
"""Natural logarithm of the odds at which a rival is no longer looked at."""

NEAR = 12.0
"""The same after a rough look, kernels and hypotheses apart."""

LOOK = 2
"""Passes of a rough look."""

FEW_PAIRS = 60
"""Of kernels and hypotheses, of which each is looked at closely."""

STRAIGHT, BENT = 0.01, 1.0
"""Standard deviations that readings and priors differ from their linearisation: up to the first it will do, from the
second on all kernels are looked at again."""

LONG_WAY = 3.0
"""Standard deviations: after a longer step they are, too."""

CENTRINGS = 10
LARGEST_TURN = 0.5
"""rad in one step."""

BEYOND_WALL = 0.2
"""Cosine of the angle to the stated direction, up to which a negative weight is a positive one, gravity turned."""


SHARE_OF_WEIGHT: dict[Kind | None, float] = {
    Kind.GAIN: 0.01,
    Kind.CREEP: 0.01,
    Kind.ROBOT: 0.01,
    Kind.CABLE: 0.05,
    Kind.TWO_LEVELS: LEVEL_SHARE,
}
"""Scale of the error, of a half-normal prior: sensors have gains and cross-talk of a percent or two, robots
orientations good to half a degree, cables and backlash move a reading by some percent of the weight."""


@dataclass(frozen=True, eq=False)
class Problem:
    """Poses (n, 3, 3), readings (n, 6) with relative variances (n,), kernels of their errors, the parameters `names`,
    the question and what is known of the noise.
    """

    R_base_flange: Array
    wrench: Array
    relative: Array
    kernels: Kernels
    names: tuple[str, ...]
    question: Question
    noise: NoiseModel

    @property
    def columns(self) -> list[int]:
        """Of the parameters: those that are not the bias."""
        return all_but_the_bias(self.names)

    def errors(self, tool: RigidTool) -> Array:
        """What `tool` leaves in the readings, (n, 6)."""
        r = gravity_in_flange(self.R_base_flange, tool.gravity_direction)
        return self.wrench - free_wrench(wrench_matrix(tool), r)

    def stepped(self, tool: RigidTool, step: Array) -> RigidTool:
        """The tool after a step (p,) in all but the bias, no rotation too far."""
        full = np.zeros(len(self.names))
        full[self.columns] = step
        turn = float(np.abs(step[4:]).max(initial=0.0))
        moved = stepped(tool, full * min(1.0, LARGEST_TURN / max(turn, LARGEST_TURN)), self.names)
        d = moved.gravity_direction
        if moved.weight < 0.0 and GRAVITY[0] in self.names and d @ self.question.gravity_direction < BEYOND_WALL:
            return replace(moved, weight=-moved.weight, gravity_direction=-d)
        return moved


@dataclass(frozen=True, eq=False)
class Table:
    """Members linearised at `tool` for the poses `kept` (n,), with the evidence of those left out; their `kernels`, and
    the `priors` there.
    """

    tool: RigidTool
    priors: Priors
    hypotheses: tuple[Hypothesis, ...]
    kept: NDArray[np.bool_]
    kernels: Kernels
    members: Members

    def kernel_of(self, member: int) -> tuple[Drift, float]:
        """The drift of a member, and its strength."""
        k = self.members.kernel[member]
        return self.kernels.drifts[self.kernels.drift[k]], float(self.kernels.strength[k])

    @property
    def kinds(self) -> NDArray[np.object_]:
        """Of the drifts of all members."""
        kinds = np.array([drift.kind for drift in self.kernels.drifts], dtype=object)
        return kinds[self.kernels.drift[self.members.kernel]]

    @property
    def log_evidence(self) -> float:
        """Of all members together."""
        return float(np.logaddexp.reduce(self.members.log_evidence))

    @property
    def best(self) -> int:
        """The likeliest member."""
        return int(np.argmax(self.members.log_evidence))


def table_at(
    problem: Problem,
    tool: RigidTool,
    kept: NDArray[np.bool_],
    hypotheses: tuple[Hypothesis, ...],
    among: NDArray[np.intp] | None = None,
) -> Table:
    """All members that count, linearised at `tool`: every kernel, or those `among` which to look, under the widest
    hypothesis, every hypothesis under the likeliest kernel, both roughly, and then the pairs that come near the best.
    A step after the last pose that is kept shows nowhere, and is none of them.
    """
    n = len(problem.wrench)
    X = np.concatenate([problem.R_base_flange.reshape(n, 9), problem.errors(tool)], axis=1)[kept]
    among = np.arange(len(problem.kernels.drift)) if among is None else among
    last = np.flatnonzero(kept)[-1]
    unseen = np.array([(drift.first_after or 0) > last for drift in problem.kernels.drifts])
    among = among[~unseen[problem.kernels.drift[among]]]
    kernels = problem.kernels.select(among)
    moments = moments_of(X, problem.relative[kept], kernels.of_poses(kept))
    G = gram(tool, problem.names, moments.S)
    priors = priors_at(tool, problem.names, hypotheses, problem.question)
    k, h = np.indices((len(among), len(hypotheses))).reshape(2, -1)
    if len(k) > FEW_PAIRS:
        each, widest = np.arange(len(among)), np.full(len(among), len(hypotheses) - 1)
        looked_at = solved(G, moments, kernels.log_prior, priors, (each, widest), problem.noise, LOOK)
        rough = looked_at.log_evidence + _log_plausible(tool, kernels, looked_at)
        likeliest, each = np.full(len(hypotheses), int(np.argmax(rough))), np.arange(len(hypotheses))
        looked_at = solved(G, moments, kernels.log_prior, priors, (likeliest, each), problem.noise, LOOK)
        of_hypotheses = looked_at.log_evidence
        k, h = np.nonzero(np.add.outer(rough - rough.max(), of_hypotheses - of_hypotheses.max()) > -NEAR)
    members = solved(G, moments, kernels.log_prior, priors, (k, h), problem.noise)
    log_evidence = members.log_evidence + _log_plausible(tool, kernels, members)
    members = replace(members, kernel=among[k], log_evidence=log_evidence)
    members = members.select(log_evidence > log_evidence.max() - FAR)
    table = Table(tool, priors, hypotheses, kept, problem.kernels, members)
    return replace(table, members=replace(members, log_evidence=members.log_evidence + _of_the_rest(problem, table)))


def _log_plausible(tool: RigidTool, kernels: Kernels, members: Members) -> Array:
    """Logarithm of the prior (m,) of how large an error is as a share of the weight, over that of its strengths."""
    scales = np.array([SHARE_OF_WEIGHT.get(drift.kind, np.nan) for drift in kernels.drifts])[kernels.drift]
    noise = np.sqrt(members.variance[:, :3].mean(axis=1))
    weight = np.maximum(np.abs(tool.weight + members.step[:, 0]), 1e-12)
    share = kernels.strength[members.kernel] * noise / (weight * scales[members.kernel])
    apart = np.log(STRENGTHS[1] / STRENGTHS[0])
    even = 1.0 / (apart * np.array([len(drift.strengths) for drift in kernels.drifts]))  # density of the logarithm
    plausible = np.log(np.sqrt(2.0 / np.pi) * share / even[kernels.drift[members.kernel]]) - 0.5 * share**2
    return np.where(np.isnan(share), 0.0, plausible)


def _of_the_rest(problem: Problem, table: Table) -> float:
    """Logarithm of the probability of those left out, and that the others are none."""
    out = ~table.kept
    rest = log_prior_outlying(len(out), int(out.sum())) - 3.0 * np.log(2.0 * np.pi) * float(table.kept.sum())
    if not out.any():
        return float(rest)
    left, known = explained(problem, table, table.best)
    errors, variance = (left - known)[out], table.members.variance[table.best]
    density = log_density_outlying(errors / np.sqrt(variance))
    return float(rest + density - 0.5 * float(np.sum(np.log(variance))) * len(errors))


def explained(problem: Problem, table: Table, member: int) -> tuple[Array, Array]:
    """What a member leaves in all readings (n, 6) with its constant bias taken out, and what of that its kernel knows:
    the change of the bias, the pull of a cable.
    """
    moved = np.tensordot(table.members.step[member], response_jacobian(table.tool, problem.names), 1)
    errors = problem.errors(table.tool) - problem.R_base_flange.reshape(-1, 9) @ moved.T
    drift, strength = table.kernel_of(member)
    L, variance = drift.columns[table.kept], problem.relative[table.kept]
    both = precision_times(L, strength, variance, np.column_stack([np.ones(len(L)), errors[table.kept]]))
    bias = both[:, 1:].sum(axis=0) / both[:, 0].sum()
    known = strength**2 * drift.columns @ (L.T @ (both[:, 1:] - both[:, :1] * bias))
    return errors - bias, known


def settled(
    problem: Problem,
    tool: RigidTool,
    kept: NDArray[np.bool_],
    hypotheses: tuple[Hypothesis, ...],
    among: NDArray[np.intp] | None = None,
) -> Table:
    """The table near the mean of its own members: where that makes no difference, it stays linearised at `tool`. Where
    it makes little, and is near, kernels that come nowhere near are not looked at again.
    """
    table = table_at(problem, tool, kept, hypotheses, among)
    for _ in range(CENTRINGS):
        step = np.exp(table.members.log_evidence - table.log_evidence) @ table.members.step
        moved = problem.stepped(table.tool, step)
        bent = _bent(problem, table, step, moved)
        if bent < STRAIGHT:
            break
        std = np.sqrt(np.maximum(np.diag(table.members.covariance[table.best]), 1e-300))
        anew = bent > BENT or float(np.max(np.abs(step) / std)) > LONG_WAY
        table = table_at(problem, moved, kept, hypotheses, among if anew else near_kernels([table]))
    return table


def _bent(problem: Problem, table: Table, step: Array, moved: RigidTool) -> float:
    """By how many standard deviations readings and priors differ at the tool `moved` by a `step` (p,) from what they
    are taken to be there where all is linearised.
    """
    if not np.isclose(moved.weight, table.tool.weight + step[0], rtol=1e-9, atol=0.0):
        return np.inf
    m, known = table.members, table.priors.known
    J = response_jacobian(table.tool, problem.names)
    beyond = response(moved) - response(table.tool) - np.tensordot(step, J, 1)
    of_readings = problem.R_base_flange[table.kept].reshape(-1, 9) @ beyond.T
    of_readings = (of_readings - of_readings.mean(axis=0)) ** 2 / m.variance[table.best]
    of_known = known_at(moved, problem.names, problem.question).residuals - known.residuals + known.jacobian @ step
    precision = np.exp(m.log_evidence - table.log_evidence) @ table.priors.precision[m.hypothesis]
    return float(np.sqrt(np.sum(of_readings) + precision @ of_known**2))


def near_kernels(tables: list[Table]) -> NDArray[np.intp]:
    """The kernels that count in a table, and a steady bias."""
    return np.unique(np.concatenate([[0], *(table.members.kernel for table in tables)]))
