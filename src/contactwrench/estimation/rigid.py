"""The estimate of a rigid tool: mean and covariance over all that the readings leave open.

Where to begin is global, so no mounting and no base needs a guess; `auto` begins near nominal and, where the readings
favour it, with mounting and base anywhere.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..calibration.fields import BIAS_MOVED, Kind
from ..geometry.arrays import Array
from ..model import (
    PARAMETERS,
    RigidTool,
    matrix_jacobian,
    response_jacobian,
    small_change_about,
    stepped,
    wrench_jacobian,
    wrench_matrix,
)
from .bias_drift import kernels_of, possible_drifts
from .estimate import Beliefs, RigidEstimate
from .hypotheses import Hypothesis, hypotheses_of, priors_at
from .initial_guess import SEARCH_OF_MODEL, Search, initial_guesses
from .least_squares import gram
from .moments import moments_of, precision_times
from .noise import MOST_DOF, PoseReadings, relative_variances
from .noise_model import NoiseModel
from .orientation_errors import PROBABILITY, orientation_errors
from .posterior import Problem, Table, deleted_errors, errors_of, explored, settled
from .priors import Question, rows_of

MODEL_OF_AUTO = "mount+base"
CLOSE_RIVAL = 6.0
"""Natural logarithm of the odds, up to which another place to begin is looked at closely."""

SURELY_WORSE = 25.0
"""Natural logarithm of the odds, from which on mounting and base anywhere are so much worse than nominal that neither
is tried alone: more than an exactly level base is worth, which a mounting that points anywhere may stand on.
"""

DIFFER_ANEW = (Kind.CABLE, Kind.ROBOT, Kind.TWO_LEVELS)
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
    return _mean(problem, tables, readings)


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


def _mean(problem: Problem, tables: list[Table], readings: PoseReadings) -> RigidEstimate:
    """The mean of all members of the tables, which are linearised at one tool."""
    names, columns, first = problem.names, problem.columns, tables[0]
    tool, bias = first.tool, slice(4, 10)
    J = response_jacobian(tool, names)
    log_all = np.concatenate([table.members.log_evidence for table in tables])
    weight = np.exp(log_all - np.logaddexp.reduce(log_all))
    steps, within = np.zeros((len(weight), len(names))), np.zeros((len(names), len(names)))
    offset = 0
    for table in tables:
        m = table.members
        mean, own = _last_bias(problem, table)
        here = slice(offset, offset + len(m.kernel))
        share = weight[here]
        steps[here, columns] = m.step
        of_mean = np.einsum("paj,kj->kap", J, mean[:, :9])
        steps[here, bias] = mean[:, 9:] - np.einsum("kap,kp->ka", of_mean, m.step)
        to_bias = -of_mean @ m.covariance
        C = np.zeros((len(share), len(names), len(names)))
        C[np.ix_(range(len(share)), columns, columns)] = m.covariance
        C[:, bias, columns] = to_bias
        C[:, columns, bias] = to_bias.transpose(0, 2, 1)
        C[:, bias, bias] = -to_bias @ of_mean.transpose(0, 2, 1) + (own[:, None] * m.variance)[:, :, None] * np.eye(6)
        within += np.einsum("k,kpq->pq", share, C)
        offset += len(share)
    step = weight @ steps
    moved = stepped(tool, step, names)
    axes = small_change_about(tool, moved, names)
    off = steps - step
    covariance = axes @ (within + np.einsum("k,kp,kq->pq", weight, off, off)) @ axes.T
    covariance = 0.5 * (covariance + covariance.T)
    variance = sum(
        (np.exp(t.members.log_evidence - np.logaddexp.reduce(log_all)) @ t.members.variance for t in tables),
        np.zeros(6),
    )
    variance = variance + _of_levels(problem, tables, weight)
    from_parameters = matrix_jacobian(moved, names)
    best = first.best
    errors = errors_of(problem, first, best)
    left = first.members.dof[best].reshape(2, 3).sum(axis=1)
    known = rows_of(problem.question.knowledge, moved, names)
    whitened = wrench_jacobian(moved, problem.R_base_flange[first.kept], names) / np.sqrt(variance)[:, None]
    rows = whitened.reshape(-1, len(names))
    rows = rows if known is None else np.vstack([rows, known.jacobian])
    length = np.linalg.norm(rows, axis=0)
    return RigidEstimate(
        names=names,
        tool=moved,
        gravity_direction=moved.gravity_direction,
        B=wrench_matrix(moved),
        B_covariance=from_parameters @ covariance @ from_parameters.T + _of_gain(problem, tables, weight),
        covariance=covariance,
        noise=np.sqrt(variance),
        dof=_dof(problem, first, covariance),
        kept=first.kept,
        errors=errors,
        held_out=deleted_errors(problem, first),
        reduced_chi2=_reduced_chi2(problem, errors[first.kept], readings.select(first.kept), float(left.sum())),
        readings_left=left,
        singular_values=np.linalg.svd(rows / np.where(length > 0.0, length, 1.0), compute_uv=False),
        beliefs=_beliefs(problem, tables, weight, errors),
    )


def _of_gain(problem: Problem, tables: list[Table], weight: Array) -> Array:
    """By how much the covariance (24, 24) of B grows because gain and cross-talk are part of what the sensor reads at
    any orientation: that of B with a slope of its own for each axis, less that of the rigid B, and the slopes found.
    """
    added, k, names = np.zeros((24, 24)), 0, problem.names
    for table in tables:
        members = table.members
        of_gain = [j for j in range(len(members.kernel)) if table.kernel_of(j)[0].kind is Kind.GAIN]
        if of_gain:
            share = float(sum(weight[k + j] for j in of_gain))
            best = max(of_gain, key=lambda j: float(members.log_evidence[j]))
            added += share * _slopes(problem, table, best)
        k += len(members.kernel)
    return added


def _slopes(problem: Problem, table: Table, member: int) -> Array:
    """The same for one member."""
    names, m, kept = problem.names, table.members, table.kept
    drift, strength = table.kernel_of(member)
    variance, q = m.variance[member], len(names)
    D = np.zeros((int(kept.sum()), 6, q + 18))
    D[:, :, :q] = wrench_jacobian(table.tool, problem.R_base_flange[kept], names)
    for axis in range(6):
        D[:, axis, q + 3 * axis : q + 3 * axis + 3] = drift.columns[kept]
    whitened = (D / np.sqrt(problem.relative[kept, None] * variance)[:, :, None]).reshape(-1, q + 18)
    errors = (problem.errors(table.tool)[kept] / np.sqrt(problem.relative[kept, None] * variance)).ravel()
    prior = priors_at(table.tool, names, table.hypotheses, problem.question)
    known, pull = prior.information[m.hypothesis[member]], prior.pull[m.hypothesis[member]]
    information, right = whitened.T @ whitened, whitened.T @ errors
    information[np.ix_(problem.columns, problem.columns)] += known
    right[problem.columns] += pull
    information[range(q, q + 18), range(q, q + 18)] += np.repeat(1.0 / (strength**2 * variance), 3)
    unit = np.sqrt(np.diag(information)) + 1e-100
    covariance = np.linalg.inv(information / np.outer(unit, unit) + 1e-13 * np.eye(q + 18)) / np.outer(unit, unit)
    to_B = np.zeros((24, q + 18))
    to_B[:, :q] = matrix_jacobian(table.tool, names)
    for axis in range(6):
        to_B[4 * axis : 4 * axis + 3, q + 3 * axis : q + 3 * axis + 3] = np.eye(3)
    found = to_B[:, q:] @ (covariance @ right)[q:]
    rigid = to_B[:, :q] @ covariance[:q, :q] @ to_B[:, :q].T
    extra: Array = to_B @ covariance @ to_B.T - rigid + np.outer(found, found)
    return extra


def _of_levels(problem: Problem, tables: list[Table], weight: Array) -> Array:
    """What a field over orientations, or two levels of the bias, adds to the variance (6,) of a pose's reading: at a
    new orientation it is there anew.
    """
    added, k = np.zeros(6), 0
    for table in tables:
        for member in range(len(table.members.kernel)):
            drift, strength = table.kernel_of(member)
            if drift.kind in DIFFER_ANEW:
                share = float(np.mean(np.sum((drift.columns - drift.columns.mean(axis=0)) ** 2, axis=1)))
                if drift.kind is Kind.TWO_LEVELS:
                    added += weight[k] * np.mean(_change(problem, table, member) ** 2, axis=0)
                else:
                    added += weight[k] * share * strength**2 * table.members.variance[member]
            k += 1
    return added


def _last_bias(problem: Problem, table: Table) -> tuple[Array, Array]:
    """Of each member: the weighted mean (m, 15) of orientation and error that the last bias is read off, and its
    variance (m,) in units of a reading's.
    """
    kernels, kept = table.kernels, table.kept
    n = int(kept.sum())
    X = np.concatenate([problem.R_base_flange.reshape(-1, 9), problem.errors(table.tool)], axis=1)[kept]
    mean, own = {}, {}
    for k in np.unique(table.members.kernel):
        of_one = precision_times(
            kernels.drifts[kernels.drift[k]].columns[kept],
            float(kernels.strength[k]),
            problem.relative[kept],
            np.ones((n, 1)),
        )[:, 0]
        mean[k], own[k] = of_one @ X / of_one.sum(), 1.0 / of_one.sum()
    return np.array([mean[k] for k in table.members.kernel]), np.array([own[k] for k in table.members.kernel])


def _dof(problem: Problem, table: Table, covariance: Array) -> Array:
    """Degrees of freedom (p,) behind the variance of each parameter (Satterthwaite, 1946): by how much the variances of
    the axes, of which it is a weighted sum, are uncertain together.
    """
    m, best, names = table.members, table.best, problem.names
    spread = problem.noise.log_spread(np.log(m.variance[best]), m.dof[best])
    of_step = m.covariance[best]
    X = np.concatenate([problem.R_base_flange.reshape(-1, 9), problem.errors(table.tool)], axis=1)[table.kept]
    kernel = table.kernels.select(m.kernel[best : best + 1]).of_poses(table.kept)
    G = gram(table.tool, names, moments_of(X, problem.relative[table.kept], kernel).S)[0, :, :-1, :-1]
    of_axis = np.einsum("pi,aij,jq->apq", of_step, G / m.variance[best][:, None, None], of_step)
    mean, own = _last_bias(problem, table)
    to_bias = np.einsum("paj,j->ap", response_jacobian(table.tool, names), mean[best, :9])
    share = np.zeros((len(names), 6))
    share[problem.columns] = np.einsum("app->pa", of_axis)
    share[4:10] = np.einsum("bp,apq,bq->ba", to_bias, of_axis, to_bias) + np.diag(own[best] * m.variance[best])
    total = np.maximum(np.diag(covariance), 1e-300)
    share = share / np.maximum(total, share.sum(axis=1))[:, None]
    uncertain = np.einsum("pa,ab,pb->p", share, spread, share)
    dof: Array = np.minimum(2.0 / np.maximum(uncertain, 2.0 / MOST_DOF), MOST_DOF)
    return dof


def _reduced_chi2(problem: Problem, residuals: Array, readings: PoseReadings, left: float) -> float:
    """Sum of squares over what is known of the noise, stated or shown by the stops; 1 where nothing is."""
    if left < 0.5:
        return 1.0
    stated = problem.noise.stated
    if stated is not None:
        return float(np.sum((residuals / stated.std) ** 2)) / left
    known = readings.variance > 0.0
    if not known.any():
        return 1.0
    return float(np.sum(residuals[known] ** 2 / readings.variance[known])) / left


def _beliefs(problem: Problem, tables: list[Table], weight: Array, errors: Array) -> Beliefs:
    """Probabilities, read off the members."""
    hypotheses = [table.hypotheses[h] for table in tables for h in table.members.hypothesis]
    of_table = np.repeat(np.arange(len(tables)), [len(table.members.kernel) for table in tables])
    drifts = [table.kernel_of(k)[0] for table in tables for k in range(len(table.members.kernel))]
    moved: dict[Kind, float] = {}
    of_kind: dict[Kind, float] = {}
    of_drift: dict[int, float] = {}
    for drift, share in zip(drifts, weight, strict=True):
        if drift.kind in BIAS_MOVED:
            moved[drift.kind] = moved.get(drift.kind, 0.0) + float(share)
            of_drift[id(drift)] = of_drift.get(id(drift), 0.0) + float(share)
        elif drift.kind is not None:
            of_kind[drift.kind] = of_kind.get(drift.kind, 0.0) + float(share)
    likeliest = max(of_drift, key=lambda drift: of_drift[drift], default=None)
    drift, change = None, np.zeros_like(problem.wrench)
    for k in np.argsort(-weight):
        if id(drifts[k]) == likeliest:
            drift = drifts[k]
            before = int(np.sum(of_table < of_table[k]))
            change = _change(problem, tables[of_table[k]], int(k) - before)
            break
    return Beliefs(
        outlying=np.bincount(of_table, weight, len(tables)) @ np.array([~table.kept for table in tables]),
        moved=moved,
        drift=drift,
        change=change,
        with_orientation=of_kind,
        mounting_exact=float(sum(w for w, h in zip(weight, hypotheses, strict=True) if h.exact[0])),
        base_exact=float(sum(w for w, h in zip(weight, hypotheses, strict=True) if h.exact[1])),
        any_mounting=float(sum(w for w, h in zip(weight, hypotheses, strict=True) if h.mount is None)),
        any_base=float(sum(w for w, h in zip(weight, hypotheses, strict=True) if h.base is None)),
    )


def _change(problem: Problem, table: Table, member: int) -> Array:
    """What a member says each pose's bias was off the last one, (n, 6)."""
    drift, strength = table.kernel_of(member)
    J = response_jacobian(table.tool, problem.names)
    moved = np.einsum("p,paj->aj", table.members.step[member], J)
    errors = problem.errors(table.tool) - problem.R_base_flange.reshape(-1, 9) @ moved.T
    L, variance = drift.columns[table.kept], problem.relative[table.kept]
    both = precision_times(L, strength, variance, np.column_stack([np.ones(len(L)), errors[table.kept]]))
    left = both[:, 1:] - both[:, :1] * both[:, 1:].sum(axis=0) / both[:, 0].sum()
    change: Array = strength**2 * drift.columns @ (L.T @ left)
    return change
