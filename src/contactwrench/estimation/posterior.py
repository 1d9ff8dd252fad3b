"""The posterior over drifts of the bias, hypotheses on mounting and base, and poses left out; and its mean.

A `Table` has every member that counts, linearised at one tool, for one set of poses. Several tables, for several sets
of poses, make the posterior: the answer is their mean by evidence, its covariance is within members plus between.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..geometry.arrays import Array
from ..model import (
    GRAVITY,
    RigidTool,
    free_wrench,
    gravity_in_flange,
    response_jacobian,
    stepped,
    wrench_jacobian,
    wrench_matrix,
)
from .bias_drift import Drift, Kernels, kernels_of
from .hypotheses import Hypothesis, priors_at
from .least_squares import Members, gram, solved
from .moments import moments_of, precision_times
from .noise_model import NoiseModel
from .orientation_errors import two_levels
from .outliers import likely_clean, log_density_outlying, log_prior_outlying
from .priors import Question

FAR = 9.0
"""Natural logarithm of the odds at which a rival is no longer looked at."""

NEAR = 11.0
"""The same after a rough look, kernels and hypotheses apart."""

LOOK = 4
"""Passes of a rough look."""

LONG_WAY = 3.0
"""Standard deviations: after a longer step all kernels are looked at again."""

CENTRINGS = 10
CENTRED = 0.05
LARGEST_TURN = 0.5
"""rad in one step."""

DOUBTED = 28.0
"""Squared distance from the other poses (6 numbers, 0.1 %) from which on leaving a pose out is tried."""

BEYOND_WALL = 0.2
"""Cosine of the angle to the stated direction: a negative weight there is a positive one, with gravity the other way."""

TWO_LEVELS = 0.3
"""Probability of a bias that comes back in two levels; each pose is on either alike."""

MOST_AS_LEVELS = 3
FEWEST_POSES = 4


@dataclass(frozen=True, eq=False)
class Problem:
    """Poses (n, 3, 3), readings (n, 6) with relative variances (n,), kernels of how the bias may have moved, the parameters
    `names`, the question and what is known of the noise.
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
        return [k for k, name in enumerate(self.names) if not name.startswith("bias")]

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
    """Members linearised at `tool` for the poses `kept` (n,), with the evidence of those left out; their `kernels`."""

    tool: RigidTool
    hypotheses: tuple[Hypothesis, ...]
    kept: NDArray[np.bool_]
    kernels: Kernels
    members: Members

    def kernel_of(self, member: int) -> tuple[Drift, float]:
        """The drift of a member, and its strength."""
        k = self.members.kernel[member]
        return self.kernels.drifts[self.kernels.drift[k]], float(self.kernels.strength[k])

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
    """
    n = len(problem.wrench)
    X = np.concatenate([problem.R_base_flange.reshape(n, 9), problem.errors(tool)], axis=1)[kept]
    among = np.arange(len(problem.kernels.drift)) if among is None else among
    kernels = problem.kernels.select(among)
    moments = moments_of(X, problem.relative[kept], kernels.of_poses(kept))
    G = gram(tool, problem.names, moments.S)
    priors = priors_at(tool, problem.names, hypotheses, problem.question)
    all_kernels, all_hypotheses = np.arange(len(among)), np.arange(len(hypotheses))
    rough = np.zeros(len(among))
    if len(among) > 1:
        pairs = all_kernels, np.full(len(among), len(hypotheses) - 1)
        rough = solved(G, moments, kernels.log_prior, priors, pairs, problem.noise, LOOK).log_evidence
    likeliest = int(np.argmax(rough))
    of_hypotheses = np.zeros(len(hypotheses))
    if len(hypotheses) > 1:
        pairs = np.full(len(hypotheses), likeliest), all_hypotheses
        of_hypotheses = solved(G, moments, kernels.log_prior, priors, pairs, problem.noise, LOOK).log_evidence
    together = np.add.outer(rough - rough.max(), of_hypotheses - of_hypotheses.max())
    pairs = np.nonzero(together > -NEAR)
    members = solved(G, moments, kernels.log_prior, priors, pairs, problem.noise)
    members = members.select(members.log_evidence > members.log_evidence.max() - FAR)
    table = Table(tool, hypotheses, kept, problem.kernels, replace(members, kernel=among[members.kernel]))
    return replace(
        table, members=replace(table.members, log_evidence=members.log_evidence + _of_the_rest(problem, table))
    )


def _of_the_rest(problem: Problem, table: Table) -> float:
    """Logarithm of the probability of those left out, and that the others are none."""
    out = ~table.kept
    rest = log_prior_outlying(len(out), int(out.sum())) - 3.0 * np.log(2.0 * np.pi) * float(table.kept.sum())
    if not out.any():
        return float(rest)
    errors, variance = errors_of(problem, table, table.best)[out], table.members.variance[table.best]
    density = log_density_outlying(errors / np.sqrt(variance))
    return float(rest + density - 0.5 * float(np.sum(np.log(variance))) * len(errors))


def errors_of(problem: Problem, table: Table, member: int) -> Array:
    """What a member leaves in all readings (n, 6), its bias and what it knows of the bias' change taken out."""
    m = table.members
    J = response_jacobian(table.tool, problem.names)
    n = len(problem.wrench)
    moved = np.einsum("p,paj->aj", m.step[member], J)
    errors = problem.errors(table.tool) - problem.R_base_flange.reshape(n, 9) @ moved.T
    drift, strength = table.kernel_of(member)
    L, variance = drift.columns[table.kept], problem.relative[table.kept]
    one = np.ones((len(L), 1))
    of_one = precision_times(L, strength, variance, one)
    bias = of_one[:, 0] @ errors[table.kept] / float(of_one.sum())
    left = errors - bias
    if not drift.columns.shape[1]:
        return left
    weighted = precision_times(L, strength, variance, left[table.kept])
    return np.asarray(left - strength**2 * drift.columns @ (L.T @ weighted))


def settled(
    problem: Problem,
    tool: RigidTool,
    kept: NDArray[np.bool_],
    hypotheses: tuple[Hypothesis, ...],
    among: NDArray[np.intp] | None = None,
) -> Table:
    """The table at the mean of its own members. After a short step, kernels that come nowhere near are not looked at
    again.
    """
    table = table_at(problem, tool, kept, hypotheses, among)
    for _ in range(CENTRINGS):
        weight = np.exp(table.members.log_evidence - table.log_evidence)
        step = weight @ table.members.step
        std = np.sqrt(np.maximum(np.diag(table.members.covariance[table.best]), 1e-300))
        size = float(np.max(np.abs(step) / std))
        if size < CENTRED:
            break
        near = among if size > LONG_WAY else near_kernels([table])
        table = table_at(problem, problem.stepped(table.tool, step), kept, hypotheses, near)
    return table


def near_kernels(tables: list[Table]) -> NDArray[np.intp]:
    """The kernels that count in a table, and a steady bias."""
    return np.unique(np.concatenate([[0], *(table.members.kernel for table in tables)]))


def explored(problem: Problem, tool: RigidTool, hypotheses: tuple[Hypothesis, ...]) -> list[Table]:
    """Tables for the sets of poses that may be clean, at the tool of the likeliest, which comes first."""
    everything = np.ones(len(problem.wrench), dtype=bool)
    best = settled(problem, tool, everything, hypotheses)
    if len(everything) <= FEWEST_POSES or best.members.dof[best.best].sum() < 6.0:
        return [best]
    tables = {best.kept.tobytes(): best}

    def tried(kept: NDArray[np.bool_], start: RigidTool, among: NDArray[np.intp] | None = None) -> Table:
        key = kept.tobytes()
        if key not in tables:
            tables[key] = settled(problem, start, kept, hypotheses, among)
        return tables[key]

    clean = _clean_poses(problem, best)
    for _ in range(3):
        if clean.all():
            break
        rival = tried(clean, best.tool)
        again = _clean_poses(problem, rival)
        best = max(best, rival, key=lambda table: table.log_evidence)
        if (again == clean).all():
            break
        clean = again
    near = near_kernels(list(tables.values()))
    for start in sorted(tables.values(), key=lambda table: -table.log_evidence)[:2]:
        now = start
        for _ in range(len(everything)):
            flips = [tried(kept, now.tool, near) for kept in _flips(problem, now)]
            better = max(flips, key=lambda table: table.log_evidence, default=now)
            if better.log_evidence <= now.log_evidence:
                break
            now = better
    found = sorted(tables.values(), key=lambda table: -table.log_evidence)
    levels = {t.kept.tobytes(): _as_two_levels(problem, t.kept) for t in found[:MOST_AS_LEVELS] if not t.kept.all()}
    of_levels = [
        settled(levels[t.kept.tobytes()], t.tool, everything, hypotheses) for t in found if t.kept.tobytes() in levels
    ]
    whole = sorted([*found, *of_levels], key=lambda table: -table.log_evidence)
    first = whole[0]
    others = [t for t in whole[1:] if t.log_evidence > first.log_evidence - FAR]
    return [first, *(table_at(replace(problem, kernels=t.kernels), first.tool, t.kept, hypotheses) for t in others)]


def _as_two_levels(problem: Problem, kept: NDArray[np.bool_]) -> Problem:
    """The problem in which the poses left out are no outliers, but on one of two levels, as backlash makes them."""
    log_prior = np.log(TWO_LEVELS) - (len(kept) - 1.0) * np.log(2.0)
    return replace(problem, kernels=kernels_of(len(kept), [two_levels(~kept)], [float(log_prior)], steady=False))


def _clean_poses(problem: Problem, table: Table) -> NDArray[np.bool_]:
    J = wrench_jacobian(table.tool, problem.R_base_flange, problem.names)
    priors = priors_at(table.tool, problem.names, table.hypotheses[-1:], problem.question)
    q, columns = len(problem.names), problem.columns
    information, pull = np.zeros((q, q)), np.zeros(q)
    information[np.ix_(columns, columns)], pull[columns] = priors.information[0], priors.pull[0]
    return likely_clean(J, problem.errors(table.tool), information, pull, LEVER)


LEVER = 0.05


def _flips(problem: Problem, table: Table) -> list[NDArray[np.bool_]]:
    """Sets of poses that differ in one: the kept pose furthest off, the pose left out that is nearest."""
    member, m = table.best, table.members
    distance = deleted_distances(problem, table)
    sets = []
    kept = table.kept
    worst = int(np.argmax(np.where(kept, distance, -np.inf)))
    if distance[worst] > DOUBTED and np.isfinite(log_prior_outlying(len(kept), int(np.sum(~kept)) + 1)):
        flipped = kept.copy()
        flipped[worst] = False
        sets.append(flipped)
    if not kept.all():
        errors = errors_of(problem, table, member)
        squared = np.sum(errors**2 / m.variance[member], axis=1)
        nearest = int(np.argmin(np.where(kept, np.inf, squared)))
        flipped = kept.copy()
        flipped[nearest] = True
        sets.append(flipped)
    return sets


def deleted_distances(problem: Problem, table: Table) -> Array:
    """Squared distance (n,) of each kept pose from what the others predict, of the likeliest member; 0 of the rest."""
    weighted, D = _deletion(problem, table)
    distance = np.zeros(len(problem.wrench))
    distance[table.kept] = np.einsum("ni,ni->n", weighted, np.linalg.solve(D, weighted[..., None])[..., 0])
    return distance


def deleted_errors(problem: Problem, table: Table) -> Array | None:
    """What each kept pose (m, 6) is off what the others predict; None where these are too few."""
    weighted, D = _deletion(problem, table)
    scale = np.sqrt(table.members.variance[table.best])
    if float(np.linalg.eigvalsh(D * np.outer(scale, scale))[:, 0].min()) < 1e-9:
        return None
    return np.asarray(np.linalg.solve(D, weighted[..., None])[..., 0])


def _deletion(problem: Problem, table: Table) -> tuple[Array, Array]:
    """Of the kept poses: weighted errors (m, 6) and the blocks (m, 6, 6), which inverted times the former are what each
    pose is off what the others predict.
    """
    m, best = table.members, table.best
    kept = table.kept
    drift, strength = table.kernel_of(best)
    L = drift.columns[kept]
    variance = problem.relative[kept]
    n = int(kept.sum())
    J = response_jacobian(table.tool, problem.names)
    R = problem.R_base_flange[kept].reshape(n, 9)
    errors = problem.errors(table.tool)[kept] - R @ np.einsum("p,paj->aj", m.step[best], J).T
    stacked = np.concatenate([R, errors, np.eye(n), np.ones((n, 1))], axis=1) if n <= 400 else None
    if stacked is None:
        of_one = precision_times(L, strength, variance, np.ones((n, 1)))
        QX = precision_times(L, strength, variance, np.concatenate([R, errors], axis=1))
        QX = QX - of_one * (of_one[:, 0] @ np.concatenate([R, errors], axis=1)) / of_one.sum()
        diagonal = 1.0 / variance
    else:
        K = precision_times(L, strength, variance, stacked)
        of_one = K[:, -1:]
        QX = K[:, :15] - of_one * (of_one[:, 0] @ stacked[:, :15]) / of_one.sum()
        diagonal = np.diag(K[:, 15:-1]) - of_one[:, 0] ** 2 / of_one.sum()
    inverse = 1.0 / m.variance[best]
    Z = np.einsum("nj,paj->nap", QX[:, :9], J) * inverse[:, None]
    D = diagonal[:, None, None] * np.diag(inverse) - np.einsum(
        "nap,pq,nbq->nab", Z, m.covariance[best], Z, optimize=True
    )
    return QX[:, 9:] * inverse, D
