"""Tables of everything that the readings may mean, linearised at one tool: kernels of errors, hypotheses, evidence.

A `Table` has every member that counts for one set of poses: a kernel (how the bias moves, errors that go with the
orientation, each at a strength), alone or beside turns of the robot, with a hypothesis (on mounting and base), its
solution and its evidence.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..calibration.findings import Kind
from ..geometry.arrays import Array
from ..model import RigidTool, response_jacobian, wrench_jacobian
from .bias_drift import Drift, Kernels
from .error_covariance import AlikeOnAxes, ErrorCovariance, Turned, in_common
from .hypotheses import Hypothesis
from .least_squares import Members, Priors, columns_of_axes, log_odds, moments_of, solved
from .one_direction import log_either
from .outliers import log_density_outlying, log_prior_outlying
from .problem import Problem
from .robot_errors import ODDS, likely_with, turns_across_gravity
from .variance_components import Linear, members_of

FAR = 10.0
"""Natural logarithm of the odds at which a rival is no longer looked at."""

NEAR, NEAR_AT_A_GLANCE = 12.0, 16.0
"""The same after a rough look, kernels and hypotheses apart; and of one column against a steady bias, unsolved."""

LOOK = 2
"""Passes of a rough look at kernels. Of hypotheses, after so few, axes that err apart are far from their optimum."""

FEW_PAIRS = 60
"""Of kernels and hypotheses, of which each is looked at closely; or of kernels, at none of which with a glance."""


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
        return self.kernels.drifts[self.kernels.drift[k]], float(self.members.strength[member])

    @property
    def kinds(self) -> NDArray[np.object_]:
        """Of the drifts of all members."""
        kinds = np.array([drift.kind for drift in self.kernels.drifts], dtype=object)
        return kinds[self.kernels.drift[self.members.kernel]]

    @property
    def with_gain(self) -> NDArray[np.bool_]:
        """Which of the members have a gain, alone or beside another drift."""
        gain = np.array([drift.kind is Kind.GAIN or drift.gain > 0.0 for drift in self.kernels.drifts])
        return np.asarray(gain[self.kernels.drift[self.members.kernel]])

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
    nearby: Table | None = None,
) -> Table:
    """All members that count, linearised at `tool`; `nearby` a table of the same kernels."""
    among = seen(problem, kept, None)
    return weighed(problem, with_turns(problem, untouched(problem, tool, kept, hypotheses, among), among, nearby))


def seen(problem: Problem, kept: NDArray[np.bool_], among: NDArray[np.intp] | None) -> NDArray[np.intp]:
    """The kernels `among` which to look, all if None, but for those that show nowhere: of the poses kept all are alike
    before a step after the last of them, or on one of two levels.
    """
    among = np.arange(len(problem.kernels.drift)) if among is None else among
    drifts = problem.kernels.drifts
    of_column = np.repeat(np.arange(len(drifts)), [drift.columns.shape[1] for drift in drifts])
    moves = np.ptp(np.hstack([drift.columns for drift in drifts])[kept], axis=0) != 0.0
    shows = np.bincount(of_column, moves, len(drifts)) > 0.0
    shows |= [drift.kind is None for drift in drifts]
    return np.asarray(among[shows[problem.kernels.drift[among]]])


def untouched(
    problem: Problem,
    tool: RigidTool,
    kept: NDArray[np.bool_],
    hypotheses: tuple[Hypothesis, ...],
    among: NDArray[np.intp],
) -> Table:
    """The members in which the robot's orientation is right: every kernel that shows under the widest hypothesis, every
    hypothesis under the likeliest kernel, the former roughly, and then the pairs that come near the best.
    """
    priors = problem.priors_at(tool, hypotheses)
    if len(among) > FEW_PAIRS:
        among = among[odds_at_a_glance(problem, tool, kept, priors, among) > -NEAR_AT_A_GLANCE]
    X, relative, W = _rows(problem, tool, kept), problem.relative[kept], columns_of_axes(tool, problem.names)
    kernels, begin = problem.kernels.select(among), None
    moments = moments_of(X, relative, kernels, W, kept)
    k, h = np.indices((len(among), len(hypotheses))).reshape(2, -1)
    if len(k) > FEW_PAIRS:
        each, widest = np.arange(len(among)), np.full(len(among), len(hypotheses) - 1)
        looked_at = solved(moments, kernels, priors, (each, widest), problem.noise, LOOK)
        rough = _sized(problem, Table(tool, priors, hypotheses, kept, kernels, looked_at)).log_evidence
        likeliest, each = np.full(len(hypotheses), int(np.argmax(rough))), np.arange(len(hypotheses))
        begin = np.log(looked_at.variance)
        under = solved(moments, kernels, priors, (likeliest, each), problem.noise, begin=begin[likeliest])
        k, h = np.nonzero(np.add.outer(rough - rough.max(), under.log_evidence - under.log_evidence.max()) > -NEAR)
        begin = begin[k] + np.log(under.variance[h]) - begin[likeliest[0]]  # as if each added its own
    members = solved(moments, kernels, priors, (k, h), problem.noise, begin=begin)
    members = _sized(problem, Table(tool, priors, hypotheses, kept, kernels, members))
    members = those_near(replace(members, kernel=among[k]))
    return Table(tool, priors, hypotheses, kept, problem.kernels, members)


def odds_at_a_glance(
    problem: Problem,
    tool: RigidTool,
    kept: NDArray[np.bool_],
    priors: Priors,
    among: NDArray[np.intp],
    found: Members | None = None,
) -> Array:
    """Logarithm of the odds of kernels `among` which to look, against a steady bias, the likeliest that was `found` or
    the one under the widest hypothesis; inf where a glance cannot tell.
    """
    X, relative, W = _rows(problem, tool, kept), problem.relative[kept], columns_of_axes(tool, problem.names)
    steady = None if found is None else found.select((found.kernel == 0) & (found.robot < 0))
    if steady is None or not len(steady.kernel):
        first, widest = np.zeros(1, dtype=np.intp), np.array([len(priors.apart) - 1])
        moments = moments_of(X, relative, problem.kernels.select(first), W, kept)
        steady = solved(moments, problem.kernels.select(first), priors, (first, widest), problem.noise, LOOK)
    alone = steady.select(np.argsort(-steady.log_evidence)[:1])
    return log_odds(X, relative, problem.kernels.select(among), W, kept, alone)


def _rows(problem: Problem, tool: RigidTool, kept: NDArray[np.bool_]) -> Array:
    """Of the poses kept, `[vec(R), error]` (m, 15)."""
    return np.concatenate([problem.R_base_flange.reshape(-1, 9), problem.errors(tool)], axis=1)[kept]


def with_turns(problem: Problem, table: Table, among: NDArray[np.intp], nearby: Table | None = None) -> Table:
    """The same, and the members in which the robot's orientation is off beside one of the kernels `among`."""
    if not problem.robot:
        return table
    kept, tool, m = table.kept, table.tool, table.members
    J = wrench_jacobian(tool, problem.R_base_flange[kept], problem.names)
    linear = Linear(J, problem.errors(tool)[kept], problem.columns, tool.weight, table.priors, problem.noise)
    base = AlikeOnAxes(kept, problem.relative, m.variance[table.best], np.zeros((len(kept), 0)), 0.0)
    log_odds_of_turns, untouched = float(np.log(ODDS / len(problem.robot))), m
    for robot, alike in enumerate(problem.robot):
        turns = turns_across_gravity(tool, problem.R_base_flange, alike, kept)
        before = None if nearby is None else nearby.members.select(nearby.members.robot == robot)
        for k, optimum in likely_with(linear, base, turns, problem.kernels, untouched, among, before):
            own = optimum.V.base
            size = problem.kernels.log_plausible(np.array([k]), np.array([own.strength]), own.of_forces, tool.weight)
            log_prior = log_odds_of_turns + float(size[0] + problem.kernels.log_prior[k])
            strengths = problem.kernels.drifts[problem.kernels.drift[k]].strengths
            m = m.joined(members_of(linear, optimum, k, strengths, log_prior, robot))
    return replace(table, members=those_near(m))


def those_near(members: Members) -> Members:
    """Less those that come nowhere near the likeliest."""
    return members.select(members.log_evidence > members.log_evidence.max() - FAR)


def weighed(problem: Problem, table: Table) -> Table:
    """The table with the evidence of the poses left out, and that the others are none."""
    m, out = table.members, ~table.kept
    rest = log_prior_outlying(len(out), int(out.sum())) - 3.0 * np.log(2.0 * np.pi) * float(table.kept.sum())
    if out.any():
        left, *known = explained(problem, table, table.best)
        errors, variance = (left - sum(known))[out], m.variance[table.best]
        rest += float(log_density_outlying(errors / np.sqrt(variance)) - 0.5 * np.sum(np.log(variance)) * len(errors))
    return replace(table, members=replace(m, log_evidence=m.log_evidence + rest))


def _sized(problem: Problem, table: Table) -> Members:
    """The members, as likely as errors of their size are, and as a bias is that may wander along one direction."""
    m, tool, kernels, kept = table.members, table.tool, table.kernels, table.kept
    noise, weight = np.sqrt(m.variance[:, :3].mean(axis=1)), tool.weight + m.step[:, 0]
    log_evidence = m.log_evidence + kernels.log_plausible(m.kernel, m.strength, noise, weight)
    wander = np.flatnonzero((table.kinds == Kind.BIAS_WANDERED) & ~table.with_gain)
    if len(wander) and problem.noise.stated is None:  # an axis that errs less than stated would share any direction
        J = wrench_jacobian(tool, problem.R_base_flange[kept], problem.names)[:, :, problem.columns]
        errors = _errors_of(problem, table, wander)[:, kept]
        log_evidence[wander] += log_either(kernels, m.select(wander), errors, J, problem.relative[kept], kept)
    return replace(m, log_evidence=log_evidence)


def explained(problem: Problem, table: Table, member: int) -> tuple[Array, Array, Array, Array]:
    """What a member leaves in all readings (n, 6) with its constant bias taken out, and what of that is known: the
    change of the bias or the pull of a cable, a gain beside it, and the robot's turns.
    """
    V = covariance_of_errors(problem, table, member)
    if not isinstance(V, Turned):
        each = explained_by_kernels(problem, table, np.array([member]))
        return each[0][0], each[1][0], each[2][0], np.zeros_like(each[0][0])
    errors, kept = _errors_of(problem, table, np.array([member]))[0], table.kept
    errors = errors - V.constant(errors[kept, :, None])[0][:, 0]
    left = V.precision_times(errors[kept, :, None])[:, :, 0]
    own = table.kernel_of(member)[0].own
    return errors, V.base.in_common(left, slice(own)), V.base.in_common(left, slice(own, None)), V.by_turns(left)


def explained_by_kernels(problem: Problem, table: Table, members: NDArray[np.intp]) -> tuple[Array, Array, Array]:
    """The same of `members` (k,) without turns, (k, n, 6): what they leave, and what of that their kernels are."""
    L = table.kernels.at_poses(table.members.kernel[members], np.ones_like(table.kept))
    errors, along = in_common(L, table.kept, problem.relative[table.kept], _errors_of(problem, table, members))
    own = np.array([table.kernel_of(member)[0].own for member in members.tolist()])
    of_own = np.arange(L.shape[2]) < own[:, None]
    return errors, L @ (along * of_own[..., None]), L @ (along * ~of_own[..., None])


def _errors_of(problem: Problem, table: Table, members: NDArray[np.intp]) -> Array:
    """What members (k,), all turned alike, leave in all readings, (k, n, 6), their bias being the table's."""
    moved = np.tensordot(table.members.step[members], response_jacobian(table.tool, problem.names), 1)
    errors = problem.errors(table.tool, float(table.members.turn[members[0]]))
    return np.asarray(errors - problem.R_base_flange.reshape(-1, 9) @ moved.transpose(0, 2, 1))


def covariance_of_errors(problem: Problem, table: Table, member: int, without_gain: bool = False) -> ErrorCovariance:
    """Of all poses, under a member; `without_gain`: but for what a gain has."""
    m, drift = table.members, table.kernel_of(member)[0]
    columns = drift.columns[:, : drift.own * (drift.kind is not Kind.GAIN)] if without_gain else drift.columns
    base = AlikeOnAxes(table.kept, problem.relative, m.variance[member], columns, float(m.strength[member]))
    if m.robot[member] < 0:
        return base
    turns = turns_across_gravity(table.tool, problem.R_base_flange, problem.robot[m.robot[member]], table.kept)
    return Turned(base, turns, float(m.turn[member]))


def near_kernels(tables: list[Table]) -> NDArray[np.intp]:
    """The kernels that count in a table, and a steady bias."""
    return np.unique(np.concatenate([[0], *(table.members.kernel for table in tables)]))


def each_with_place(tables: list[Table]) -> Iterator[tuple[Table, slice]]:
    """Each table with the place of its members among those of all."""
    offset = 0
    for table in tables:
        yield table, slice(offset, offset := offset + len(table.members.kernel))
