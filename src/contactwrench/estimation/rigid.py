"""The estimate of a rigid tool: mean and covariance over all that the readings leave open.

Where to begin is global, so no mounting and no base needs a guess; `auto` begins near nominal and, where the readings
favour it, with mounting and base anywhere.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..geometry.arrays import Array
from ..model import PARAMETERS, RigidTool, gravity_in_flange, response, response_jacobian
from .bias_drift import FEWEST_POSES, Drift, kernels_of, possible_drifts
from .estimate import RigidEstimate
from .hypotheses import WIDTHS, Hypothesis, hypotheses_of
from .initial_guess import SEARCH_OF_MODEL, Search, initial_guesses
from .moved_bias import FEWEST_IF_MOVED
from .noise import NoiseModel, PoseReadings, relative_variances
from .orientation_errors import orientation_errors
from .posterior import explored
from .posterior_mean import mean_of
from .priors import Question, tool_of
from .problem import Problem
from .robot_errors import turns_of_robot
from .settling import settled
from .tables import Table, near_kernels, table_at
from .variance_components import inverse_of

RIGID_MODELS = ("auto", *SEARCH_OF_MODEL)
"""With one weight."""

MODEL_OF_AUTO = "mount+base"
CLOSE_RIVAL = 6.0
"""Natural logarithm of the odds, up to which another place to begin is looked at closely."""

AS_GOOD = 15.0
"""Over the poses beyond 10, of what any response leaves: twice what noise gives a tool of 9 numbers in place of 54."""

MOST_JUDGED = 2_000
"""Poses: of more, rows taken on the way most often, none is left out, and the bias is taken to be steady."""

SETTLE_ITERATIONS = 15
CLOSE = 1.0
"""Standard deviations, all else known: a shorter step leads to the optimum, as near as need be."""

WIDE = 0.1
"""rad, of the tilt of a mounting or a base that is looked for near nominal."""

FEWEST_FOR_STEP, MOST_OF_IT = 8, 0.75
"""Poses, and the share of what is left, from which on a start counts a step of the bias."""

FEWEST_FOR_ORIENTATION = 5
"""Poses, up to which a gain, creep or a cable would explain whatever is left of them; turns of the robot do not."""

SAME_PLACE = 0.2
"""Of the force: another sign differs by 2, another mounting by 1 or so."""

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
        plain: all poses belong, the bias is steady, and nobody asks for held-out errors.
        begin: where to; of `auto`, that near nominal what is not free is looked for; None: everywhere is looked at.
    """
    steady = plain or len(readings) > MOST_JUDGED
    problem = _problem(readings, question, steady)
    tables = _tables(problem, steady, begin)
    relative = readings.relative_variance
    if question.noise is None and float(relative.max()) > EVEN * float(relative.min()):
        members = tables[0].members
        found = np.exp(members.log_evidence - tables[0].log_evidence) @ members.variance
        of_stops = min(float(np.mean(readings.least_variance / found)), 1.0)
        problem = replace(problem, relative=1.0 - of_stops + of_stops * relative)
        first, *others = ((replace(problem, kernels=table.kernels), table) for table in tables)
        likeliest = settled(first[0], first[1].tool, first[1].kept, first[1].hypotheses)
        again = (table_at(own, likeliest.tool, table.kept, table.hypotheses) for own, table in others)
        tables = [likeliest, *again]
    return mean_of(problem, tables, readings, plain)


def _problem(readings: PoseReadings, question: Question, plain: bool) -> Problem:
    n, start = len(readings), relative_variances(question.noise)
    if question.noise is None:
        spread = readings.wrench[:, :3] - readings.wrench[:, :3].mean(axis=0)
        start = start * max(float(np.mean(spread**2)), 1e-20)
    anew = not plain and question.earlier is None
    drifts, log_prior = list[Drift](), list[float]()
    of_known_tool = not plain and readings.in_order == 1.0 and n >= FEWEST_IF_MOVED  # else another one would pass
    if anew or of_known_tool:
        drifts, log_prior = possible_drifts(readings.time, readings.in_order)
    turns = anew and n > FEWEST_POSES and question.noise is None
    errs = question.earlier is None or question.earlier.gain_covariance is not None
    if errs and not plain and n > FEWEST_FOR_ORIENTATION:
        errors = orientation_errors(readings.R_base_flange, question.gravity_direction, readings.in_order)
        drifts, log_prior = drifts + errors[0], log_prior + errors[1]
    return Problem(
        readings.R_base_flange,
        readings.wrench,
        np.ones(n),
        kernels_of(n, drifts, log_prior),
        PARAMETERS[model_fitted(question.model)],
        question,
        NoiseModel(readings.least_variance, question.noise, start),
        turns_of_robot(n) if turns else (),
    )


def _tables(problem: Problem, plain: bool, begin: RigidTool | None) -> list[Table]:
    """Those from a start under a steady bias, or, where a step may have led it off, from one that counts the step: by
    more than a light tool weighs, it leads to another sign, or mounting, from where no step leads back.
    """
    steady = _tables_from(problem, plain, begin, np.zeros(len(problem.wrench), dtype=bool))
    before, search = _before_a_step(problem), SEARCH_OF_MODEL[model_fitted(problem.question.model)]
    if begin is not None or problem.question.earlier is not None or not before.any():
        return steady
    if _is_alike(steady[0].tool, _start(problem, search, before)):
        return steady
    return max(steady, _tables_from(problem, plain, None, before), key=lambda tables: tables[0].log_evidence)


def _is_alike(tool: RigidTool, other: RigidTool) -> bool:
    """Whether forces under the two are so near that both lead to one optimum."""
    force, apart = response(tool)[:3], response(other)[:3] - response(tool)[:3]
    return bool(np.linalg.norm(apart) < SAME_PLACE * np.linalg.norm(force))


def _tables_from(problem: Problem, plain: bool, begin: RigidTool | None, before: NDArray[np.bool_]) -> list[Table]:
    question = problem.question
    look = _settled_only if plain else explored
    if question.earlier is not None:
        begin = tool_of(question.earlier)
    if begin is not None:
        return look(problem, begin, hypotheses_of(question, False, False))
    if question.model != "auto":
        search, free = SEARCH_OF_MODEL[question.model], hypotheses_of(question, False, False)
        best = look(problem, _start(problem, search, before), free)
        if best[0].kept.all():
            return best
        return _led_by_the_others(problem, best, _start(problem, search, before, best[0].kept))
    mounting, base = question.priors.mount is None, question.priors.base is None
    nominal = hypotheses_of(question, False, False)
    anywhere = _start(problem, Search(True, True), before)
    near_nominal = _is_near_nominal(problem, anywhere)
    best = look(problem, anywhere if near_nominal else _start(problem, Search(mounting, base), before), nominal)
    if not best[0].kept.all():
        anywhere = _start(problem, Search(True, True), before, best[0].kept)
        near_nominal = _is_near_nominal(problem, anywhere)
        best = _led_by_the_others(problem, best, anywhere)
    if near_nominal:
        return best
    rivals = [(m, b) for m, b in ((True, True), (False, True), (True, False)) if m >= mounting and b >= base]
    rivals = [pair for pair in rivals if pair != (mounting, base)]
    near, own, found = near_kernels(best[:1]), replace(problem, kernels=best[0].kernels), [best]
    for any_mounting, any_base in rivals:
        hypotheses = hypotheses_of(question, any_mounting, any_base)
        rival = settled(own, anywhere, best[0].kept, hypotheses, near)
        if rival.log_evidence > best[0].log_evidence - CLOSE_RIVAL:
            found.append(look(problem, rival.tool, hypotheses))
    return max(found, key=lambda tables: tables[0].log_evidence)


def _led_by_the_others(problem: Problem, best: list[Table], begin: RigidTool) -> list[Table]:
    """The best tables, or those found from where the poses kept lead to `begin`: the ones left out may have led so far
    off that no step leads back.
    """
    first = best[0]
    clean = settled(replace(problem, kernels=first.kernels), begin, first.kept, first.hypotheses)
    if clean.log_evidence <= first.log_evidence + CLOSE_RIVAL:
        return best
    return max(best, explored(problem, clean.tool, first.hypotheses), key=lambda tables: tables[0].log_evidence)


def _is_near_nominal(problem: Problem, tool: RigidTool) -> bool:
    """Whether the tilts are such that those near nominal are likelier beforehand than ones that may be anything."""
    tilts, priors = problem.known_at(tool).residuals[-4:], problem.question.priors
    widths = np.repeat([np.inf if sd is None else max(WIDTHS) * sd for sd in (priors.mount, priors.base)], 2)
    return bool(np.all(np.abs(tilts) < widths))


def _settled_only(problem: Problem, tool: RigidTool, hypotheses: tuple[Hypothesis, ...]) -> list[Table]:
    return [settled(problem, tool, np.ones(len(problem.wrench), dtype=bool), hypotheses)]


def _start(
    problem: Problem, search: Search, before: NDArray[np.bool_], kept: NDArray[np.bool_] | None = None
) -> RigidTool:
    """The most promising guess, brought close to its optimum under a bias that is another one `before` a step, (n,)."""
    kept = np.ones(len(problem.wrench), dtype=bool) if kept is None else kept
    both = np.column_stack([problem.R_base_flange.reshape(-1, 9), problem.wrench])
    for part in (kept & before, kept & ~before):
        both[part] -= both[part].mean(axis=0) if part.any() else 0.0
    both = both[kept]
    R, wrench = both[:, :9].reshape(-1, 3, 3), both[:, 9:]
    rows: Array = np.linalg.qr(both).R  # few, with the moments of all
    wide = Hypothesis(None if search.any_mounting else WIDE, None if search.any_base else WIDE, (False, False), 0.0)
    beyond_tools = float(np.sum(rows[9:, 9:] ** 2 / relative_variances(problem.question.noise)))
    enough, reached = beyond_tools * (1.0 + AS_GOOD / max(len(wrench) - 10.0, 1.0)), list[tuple[float, RigidTool]]()
    for guess in initial_guesses(R, wrench, search, problem.question.gravity_direction):
        reached.append(_approached(problem, guess, rows, len(wrench), wide))
        if reached[-1][0] < enough:
            break
    return min(reached, key=lambda misfit_and_tool: misfit_and_tool[0])[1]


def _before_a_step(problem: Problem) -> NDArray[np.bool_]:
    """The poses (n,) before the step of the bias that makes most of what is left beside a linear response to gravity as
    stated; none where no step does.
    """
    n, steps = len(problem.wrench), [each.columns for each in problem.kernels.drifts if each.first_after is not None]
    if not steps or n < FEWEST_FOR_STEP:
        return np.zeros(n, dtype=bool)
    r = gravity_in_flange(problem.R_base_flange, problem.question.gravity_direction)
    before, of_any_tool = np.hstack(steps), np.linalg.qr(np.column_stack([np.ones(n), r])).Q
    wrench = problem.wrench / np.sqrt(relative_variances(problem.question.noise))
    left, seen = (values - of_any_tool @ (of_any_tool.T @ values) for values in (wrench, before))
    by_step = np.sum((seen.T @ left) ** 2, axis=1) / np.maximum(np.sum(seen**2, axis=0), 1e-6)
    best = int(np.argmax(by_step))
    return np.asarray((before[:, best] > 0.5) & (by_step[best] > MOST_OF_IT * np.sum(left**2)))


def _approached(
    problem: Problem, tool: RigidTool, rows: Array, poses: int, wide: Hypothesis
) -> tuple[float, RigidTool]:
    """The misfit that is reached from a guess, and the tool there; centred `rows` (k, 15) of orientation and reading
    have the moments of all `poses`.
    """
    R, wrench = np.split(rows, [9], axis=1)
    root = np.sqrt(1.0 / relative_variances(problem.question.noise))
    for _ in range(SETTLE_ITERATIONS):
        errors = ((wrench - R @ response(tool).T) * root).ravel()
        misfit = float(errors @ errors)
        scale = 1.0 / max(misfit / (6.0 * poses), 1e-30)
        J = (response_jacobian(tool, problem.names) * root[:, None]).transpose(1, 0, 2)
        D: Array = (R @ J.reshape(-1, 9).T).reshape(errors.size, -1)
        known = problem.priors_at(tool, (wide,))
        information = scale * D.T @ D + known.information[0]
        step = inverse_of(information) @ (scale * errors @ D + known.pull[0])
        tool = problem.stepped(tool, step)
        if float(np.max(np.abs(step) * np.sqrt(np.diag(information)))) < CLOSE:
            break
    return misfit, tool
