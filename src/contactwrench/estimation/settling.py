"""Where a table is linearised: near the mean of its own members, where that makes a difference."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..geometry.arrays import Array
from ..model import RigidTool, response, response_jacobian
from .hypotheses import Hypothesis
from .problem import Problem
from .tables import Table, near_kernels, seen, those_near, untouched, weighed, with_turns

STRAIGHT, BENT = 0.03, 1.0
"""Standard deviations that readings and priors differ from their linearisation: up to the first it will do, from the
second on all kernels are looked at again."""

NO_NEARER = 0.5
"""Of what it was: members that come and go about their mean would go round for ever."""

LONG_WAY = 3.0
"""Standard deviations: after a longer step they are, too."""

CENTRINGS = 10


def settled(
    problem: Problem,
    tool: RigidTool,
    kept: NDArray[np.bool_],
    hypotheses: tuple[Hypothesis, ...],
    among: NDArray[np.intp] | None = None,
    nearby: Table | None = None,
) -> Table:
    """The table near the mean of its own members: where that makes no difference, it stays linearised at `tool`. Where
    it makes little, and is near, kernels that come nowhere near are not looked at again. Turns of the robot come last:
    far from where the readings point, they would take up what is no error of it; they begin where a table `nearby` has
    them.
    """
    look = seen(problem, kept, among)
    table = _centred(replace(problem, robot=()), untouched(problem, tool, kept, hypotheses, look), among)
    turned = with_turns(problem, table, look, nearby)
    return weighed(problem, _centred(problem, turned, among) if (turned.members.robot >= 0).any() else table)


def with_kernels(problem: Problem, table: Table, among: NDArray[np.intp]) -> Table:
    """A settled table with the members of further kernels `among`, and near its mean again, should that move far."""
    tool, kept, hypotheses = table.tool, table.kept, table.hypotheses
    further = with_turns(problem, untouched(problem, tool, kept, hypotheses, among), among, table)
    members = those_near(table.members.joined(weighed(problem, further).members))
    both = replace(table, kernels=problem.kernels, members=members)
    step, moved = _to_the_mean(problem, both)
    if _bent(problem, both, step, moved) < STRAIGHT:
        return both
    return settled(problem, moved, kept, hypotheses, near_kernels([both]), both)


def _to_the_mean(problem: Problem, table: Table) -> tuple[Array, RigidTool]:
    """The step (p,) to the mean of the members, and the tool there."""
    step = np.exp(table.members.log_evidence - table.log_evidence) @ table.members.step
    return step, problem.stepped(table.tool, step)


def _centred(problem: Problem, table: Table, among: NDArray[np.intp] | None) -> Table:
    bent = np.inf
    for _ in range(CENTRINGS):
        before, (step, moved) = bent, _to_the_mean(problem, table)
        bent = _bent(problem, table, step, moved)
        if bent < STRAIGHT or NO_NEARER * before < bent < BENT:
            break
        std = np.sqrt(np.maximum(np.diag(table.members.covariance[table.best]), 1e-300))
        anew = bent > BENT or float(np.max(np.abs(step) / std)) > LONG_WAY
        near = seen(problem, table.kept, among if anew else near_kernels([table]))
        anew_there = untouched(problem, moved, table.kept, table.hypotheses, near)
        table = with_turns(problem, anew_there, near, table)
    return table


def _bent(problem: Problem, table: Table, step: Array, moved: RigidTool) -> float:
    """By how many standard deviations readings and priors at the tool `moved` by a `step` (p,) differ from linear."""
    if not np.isclose(moved.weight, table.tool.weight + step[0], rtol=1e-9, atol=0.0):
        return np.inf
    m, known = table.members, table.priors.known
    J = response_jacobian(table.tool, problem.names)
    beyond = response(moved) - response(table.tool) - np.tensordot(step, J, 1)
    of_readings = problem.R_base_flange[table.kept].reshape(-1, 9) @ beyond.T
    of_readings = (of_readings - of_readings.mean(axis=0)) ** 2 / m.variance[table.best]
    of_known = problem.known_at(moved).residuals - known.residuals + known.jacobian @ step
    precision = np.exp(m.log_evidence - table.log_evidence) @ table.priors.precision[m.hypothesis]
    return float(np.sqrt(np.sum(of_readings) + precision @ of_known**2))
