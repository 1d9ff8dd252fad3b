"""The estimate of a rigid tool: mean and covariance over all that the readings leave open.

Where to begin is global, so no mounting and no base needs a guess; `auto` begins near nominal and, where the readings
favour it, with mounting and base anywhere.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..geometry.arrays import Array
from ..model import PARAMETERS, RigidTool
from .bias_drift import kernels_of, possible_drifts
from .estimate import RigidEstimate
from .hypotheses import Hypothesis, hypotheses_of, priors_at
from .initial_guess import SEARCH_OF_MODEL, Search, initial_guesses
from .least_squares import gram
from .moments import moments_of
from .noise import PoseReadings, relative_variances
from .noise_model import NoiseModel
from .orientation_errors import PROBABILITY, orientation_errors
from .posterior import explored
from .posterior_mean import mean_of
from .priors import Question
from .tables import Problem, Table, settled

MODEL_OF_AUTO = "mount+base"
CLOSE_RIVAL = 6.0
"""Natural logarithm of the odds, up to which another place to begin is looked at closely."""

SURELY_WORSE = 12.0
"""Odds at which mounting and base anywhere are worse than nominal: then neither of the two is tried alone."""

MOST_JUDGED = 2_000
"""Poses: of more, rows taken on the way most often, none is left out, and the bias is taken to be steady."""

SETTLE_ITERATIONS = 15
EVEN = 1.5
"""Ratio of the poses' own variances up to which they count alike."""


def model_fitted(model: str) -> str:
    """The model whose parameters another one estimates."""
    return MODEL_OF_AUTO if model == "auto" else model


def estimated(
    readings: PoseReadings, question: Question, plain: bool = False, begin: RigidTool | None = None
) -> RigidEstimate:
    """The posterior mean of tool, mounting, base and last bias. Singular problems are returned as they come.

    Args:
        readings: of the poses, in the order of time where that tells.
        question: `yaw`, `mount`, `mount+base` or `auto`.
        plain: all poses belong, and the bias is steady.
        begin: where to, of a model other than `auto`; None: everywhere is looked at.
    """
    problem = _problem(readings, question, plain or len(readings) > MOST_JUDGED)
    tables = _tables(problem, plain or len(readings) > MOST_JUDGED, begin)
    relative = readings.relative_variance
    if question.noise is None and float(relative.max()) > EVEN * float(relative.min()):
        of_stops = float(np.mean(readings.least_variance / _mean_variance(tables)))
        problem = replace(problem, relative=1.0 + min(of_stops, 1.0) * (relative - 1.0))
        tables = [settled(problem, tables[0].tool, table.kept, table.hypotheses) for table in tables[:1]] + tables[1:]
    return mean_of(problem, tables, readings)


FEWEST_FOR_ORIENTATION = 5


def _problem(readings: PoseReadings, question: Question, plain: bool) -> Problem:
    n = len(readings)
    relative = np.ones(n)
    spread = readings.wrench - readings.wrench.mean(axis=0)
    start = relative_variances(question.noise) * max(float(np.mean(spread[:, :3] ** 2)), 1e-20)
    if question.noise is not None:
        start = relative_variances(question.noise)
    drifts, log_prior = ([], []) if plain else possible_drifts(readings.time, n)
    if not plain and n > FEWEST_FOR_ORIENTATION and question.earlier is None:
        of_orientation = orientation_errors(readings.R_base_flange, question.gravity_direction)
        drifts, log_prior = (
            [*drifts, *of_orientation],
            [*log_prior, *(np.log(PROBABILITY[d.kind]) for d in of_orientation)],
        )
    return Problem(
        readings.R_base_flange,
        readings.wrench,
        relative,
        kernels_of(n, drifts, log_prior),
        PARAMETERS[model_fitted(question.model)],
        question,
        NoiseModel(readings.least_variance, question.noise, start),
    )


def _tables(problem: Problem, plain: bool, begin: RigidTool | None) -> list[Table]:
    question = problem.question
    look = _settled_only if plain else explored
    if question.earlier is not None:
        return look(problem, question.earlier, hypotheses_of(question, False, False))
    if question.model != "auto":
        begin = _start(problem, SEARCH_OF_MODEL[question.model]) if begin is None else begin
        return look(problem, begin, hypotheses_of(question, False, False))
    mounting, base = question.priors.mount is None, question.priors.base is None
    nominal = hypotheses_of(question, False, False)
    best = look(problem, _start(problem, Search(mounting, base)), nominal)
    rivals = [(m, b) for m, b in ((True, True), (False, True), (True, False)) if m >= mounting and b >= base]
    rivals = [pair for pair in rivals if pair != (mounting, base)]
    found = best
    for k, (any_mounting, any_base) in enumerate(rivals):
        hypotheses = hypotheses_of(question, any_mounting, any_base)
        start = _start(problem, Search(any_mounting, any_base), best[0].kept)
        rival = settled(problem, start, best[0].kept, hypotheses)
        if rival.log_evidence > best[0].log_evidence - CLOSE_RIVAL:
            tables = look(problem, rival.tool, hypotheses)
            if tables[0].log_evidence > found[0].log_evidence:
                found = tables
        elif k == 0 and rival.log_evidence < best[0].log_evidence - SURELY_WORSE:
            break
    return found


def _settled_only(problem: Problem, tool: RigidTool, hypotheses: tuple[Hypothesis, ...]) -> list[Table]:
    return [settled(problem, tool, np.ones(len(problem.wrench), dtype=bool), hypotheses)]


def _start(problem: Problem, search: Search, kept: NDArray[np.bool_] | None = None) -> RigidTool:
    """The most promising guess, brought close to its optimum under a steady bias."""
    kept = np.ones(len(problem.wrench), dtype=bool) if kept is None else kept
    R, wrench = problem.R_base_flange[kept], problem.wrench[kept]
    steady = problem.kernels.select(np.zeros(1, dtype=np.intp)).of_poses(kept)
    guesses = initial_guesses(R, wrench, search, problem.question.gravity_direction)
    wide = (Hypothesis(None if search.any_mounting else 0.1, None if search.any_base else 0.05, (False, False), 0.0),)
    weight = 1.0 / relative_variances(problem.question.noise)
    found = []
    for tool in guesses:
        for _ in range(SETTLE_ITERATIONS):
            X = np.concatenate([R.reshape(-1, 9), problem.errors(tool)[kept]], axis=1)
            G = gram(tool, problem.names, moments_of(X, problem.relative[kept], steady).S)[0]
            total = np.einsum("a,aij->ij", weight / (weight @ G[:, -1, -1] / (6.0 * len(R)) + 1e-30), G)
            known = priors_at(tool, problem.names, wide, problem.question)
            information = total[:-1, :-1] + known.information[0]
            unit = np.sqrt(np.diag(information)) + 1e-100
            scaled = information / np.outer(unit, unit) + 1e-12 * np.eye(len(unit))
            step = np.linalg.solve(scaled, (total[:-1, -1] + known.pull[0]) / unit) / unit
            misfit = float(weight @ G[:, -1, -1])
            if float(np.max(np.abs(step) * unit)) < 0.3:
                break
            tool = problem.stepped(tool, step)
        found.append((misfit, tool))
    return min(found, key=lambda pair: pair[0])[1]


def _mean_variance(tables: list[Table]) -> Array:
    members = tables[0].members
    weight = np.exp(members.log_evidence - tables[0].log_evidence)
    mean: Array = weight @ members.variance
    return mean
