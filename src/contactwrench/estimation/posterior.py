"""The posterior over sets of poses that belong: the tables of those that may, the likeliest first.

The search starts from clean subsets (outliers.py) and from all poses, and goes on pose by pose; then it looks for poses
on one of two levels, beside those left out, and last for two causes at once. What it looked at and comes near the
likeliest stays in the mean.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial
from itertools import compress

import numpy as np
from numpy.typing import NDArray

from ..calibration.findings import Kind
from ..geometry.arrays import Array
from ..model import RigidTool, wrench_jacobian
from .bias_drift import Drift
from .hypotheses import Hypothesis
from .orientation_errors import with_gain_beside
from .outliers import beyond_the_cut, likely_clean, log_prior_outlying, log_prior_two_levels
from .problem import Problem
from .robot_errors import turns_across_gravity
from .settling import settled, with_kernels
from .tables import (
    FAR,
    NEAR_AT_A_GLANCE,
    Table,
    covariance_of_errors,
    explained,
    near_kernels,
    odds_at_a_glance,
    seen,
    table_at,
)

DOUBTED = 28.0
"""Squared distance from the other poses (6 numbers, 0.1 %) from which on leaving a pose out is tried."""

MOST_AS_LEVELS = 3
MANY = 40
"""Poses: of fewer, turns of the robot take up what contacts make, which are looked for as if there were none; of more
all that are far off are left out together, as one by one takes minutes."""
FEWEST_POSES = 4


def explored(problem: Problem, tool: RigidTool, hypotheses: tuple[Hypothesis, ...]) -> list[Table]:
    """Tables for the sets of poses that may be clean, at the tool of the likeliest, which comes first."""
    everything = np.ones(len(problem.wrench), dtype=bool)
    best = settled(problem, tool, everything, hypotheses)
    if len(everything) <= FEWEST_POSES or best.members.dof[best.best].sum() < 6.0:
        return [best]
    tables = {best.kept.tobytes(): best}

    def tried(kept: NDArray[np.bool_], start: Table, among: NDArray[np.intp] | None = None) -> Table:
        key = kept.tobytes()
        if key not in tables:
            of_all_tables = start.members.kernel < len(problem.kernels.drift)
            nearby = replace(start, members=start.members.select(of_all_tables))
            tables[key] = settled(problem, start.tool, kept, hypotheses, among, nearby)
        return tables[key]

    clean, on_a_level = _clean_poses(problem, best)
    for _ in range(3):
        if clean.all():
            break
        rival = tried(clean, best)
        again, _ = _clean_poses(problem, rival)
        best = max(best, rival, key=lambda table: table.log_evidence)
        if (again == clean).all():
            break
        clean = again
    near, nearby = near_kernels(list(tables.values())), cache(partial(_flips, problem))
    starts = 2 if len(everything) <= MANY else 1
    for start in sorted(tables.values(), key=lambda table: -table.log_evidence)[:starts]:
        now = start
        for _ in range(len(everything)):
            flips = [tried(kept, now, near) for kept in nearby(now)]
            better = max(flips, key=lambda table: table.log_evidence, default=now)
            if better.log_evidence <= now.log_evidence:
                break
            tables[better.kept.tobytes()] = now = _looked_at_anew(problem, better, near)
            near = np.union1d(near, near_kernels([now]))
    by_near, of_all = partial(tried, among=near), everything.tobytes()
    tables |= _grown(*_leveled(problem, tables, on_a_level), by_near, nearby)
    likeliest = max(tables.values(), key=lambda table: table.log_evidence)
    tables |= _grown([likeliest, tables[of_all]], partial(with_gain_beside, problem), by_near, nearby)
    first, *others = sorted(tables.values(), key=lambda table: -table.log_evidence)
    others = [table for table in others if table.log_evidence > first.log_evidence - FAR]
    own_kernels = [(replace(problem, kernels=table.kernels), table) for table in others]
    return [first, *(table_at(own, first.tool, table.kept, hypotheses, table) for own, table in own_kernels)]


def _leveled(
    problem: Problem, tables: dict[bytes, Table], on_a_level: NDArray[np.bool_]
) -> tuple[list[Table], Callable[[Table], Table]]:
    """The tables to begin with, that of all poses and the likeliest, and what makes of a table one in which some poses
    may be `on_a_level` of their own, or on a side of what was found.
    """
    found = sorted(tables.values(), key=lambda table: -table.log_evidence)
    of_all = tables[np.ones(len(problem.wrench), dtype=bool).tobytes()]
    proposed = [on_a_level, *(table.kept for table in found[:MOST_AS_LEVELS])]
    proposed += [side for table in (found[0], of_all) for side in _two_sides(problem, table)]
    anew = [of_all]
    if not found[0].kept.all():
        proposed.append(_clean_poses(problem, found[0], found[0].kept)[1])
        anew.append(found[0])
    return anew, partial(_with_levels, problem, proposed=proposed)


def _grown(
    anew: list[Table],
    grow: Callable[[Table], Table],
    tried: Callable[[NDArray[np.bool_], Table], Table],
    nearby: Callable[[Table], list[NDArray[np.bool_]]],
) -> dict[bytes, Table]:
    """Tables by the poses that they keep, each with the members that `grow` adds: those `anew`, and, as long as there
    are others, those nearby of the likeliest, for what is found there makes other poses look good or bad.
    """
    grown = dict[bytes, Table]()
    while anew:
        grown |= {table.kept.tobytes(): grow(table) for table in anew}
        now = max(grown.values(), key=lambda table: table.log_evidence)
        anew = [tried(kept, now) for kept in nearby(now) if kept.tobytes() not in grown]
    return grown


def _looked_at_anew(problem: Problem, table: Table, near: NDArray[np.intp]) -> Table:
    """The table with the kernels that are likelier than a steady bias and not among those `near`: a pose in contact,
    left out now, had hidden them.
    """
    hidden = np.setdiff1d(seen(problem, table.kept, None), near)
    odds = odds_at_a_glance(problem, table.tool, table.kept, table.priors, hidden, table.members)
    shown = hidden[(odds > 0.0) & np.isfinite(odds)]
    return with_kernels(problem, table, shown) if len(shown) else table


def _with_levels(problem: Problem, table: Table, proposed: list[NDArray[np.bool_]]) -> Table:
    """The table, in which those left out of a set that is `proposed` may be no outliers, but on one of two levels, as
    backlash makes them, the constant halfway between.
    """
    n, before = len(problem.wrench), len(problem.kernels.drift)
    sets = list({kept.tobytes(): kept for kept in proposed}.values())
    log_prior = [log_prior_two_levels(n, int(np.sum(~kept))) for kept in sets]
    levels = [Drift(Kind.TWO_LEVELS, np.where(kept, 0.5, -0.5)[:, None]) for kept in sets]
    possible = np.isfinite(log_prior)
    kernels = problem.kernels.joined(list(compress(levels, possible)), list(compress(log_prior, possible)))
    problem, look = replace(problem, kernels=kernels), np.arange(before, len(kernels.drift))
    odds = odds_at_a_glance(problem, table.tool, table.kept, table.priors, look, table.members)
    shown = look[odds > -NEAR_AT_A_GLANCE]
    return with_kernels(problem, table, shown) if len(shown) else table


def _two_sides(problem: Problem, table: Table) -> list[NDArray[np.bool_]]:
    """Where the bias wanders, the poses on the larger side of its course: it may take two levels up, and no pose would
    then seem to be off.
    """
    if table.kinds[table.best] != Kind.BIAS_WANDERED:
        return []
    left = (explained(problem, table, table.best)[0] / np.sqrt(table.members.variance[table.best]))[table.kept]
    larger = np.ones_like(table.kept)
    larger[table.kept] = beyond_the_cut(left) < 0.0
    return [larger]


def _clean_poses(
    problem: Problem, table: Table, among: NDArray[np.bool_] | None = None
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """As `likely_clean` has them `among` which to look (n,), linearised at the table's tool."""
    J = wrench_jacobian(table.tool, problem.R_base_flange, problem.names)
    q, columns = len(problem.names), problem.columns
    information, pull = np.zeros((q, q)), np.zeros(q)
    information[np.ix_(columns, columns)], pull[columns] = table.priors.information[-1], table.priors.pull[-1]
    errors, m, best = problem.errors(table.tool), table.members, table.best
    if m.robot[best] >= 0 and len(errors) > MANY:  # what turns make of a pose counts as little as it tells
        noise = np.sqrt(m.variance[best])[:, None]
        turned = m.turn[best] * turns_across_gravity(table.tool, problem.R_base_flange, None, table.kept).reads / noise
        own = np.linalg.inv(np.eye(6) + turned @ turned.transpose(0, 2, 1))
        weigh = noise * np.linalg.cholesky(own).transpose(0, 2, 1) / noise.T
        J, errors = weigh @ J, (weigh @ errors[..., None])[..., 0]
    if among is None:
        return likely_clean(J, errors, information, pull)
    clean, on_a_level = np.ones((2, len(among)), dtype=bool)
    clean[among], on_a_level[among] = likely_clean(J[among], errors[among], information, pull)
    return clean, on_a_level


def _flips(problem: Problem, table: Table) -> list[NDArray[np.bool_]]:
    """Sets of poses nearby: less the one furthest off, of `MANY` less all that are off half as far; with the one left
    out that is nearest, of `MANY` with all that nobody would doubt.
    """
    member, m = table.best, table.members
    distance, dof = deleted_distances(problem, table), float(m.dof[member].sum())
    if m.robot[member] >= 0:  # of the noise alone
        dof = 6.0 * int(table.kept.sum()) - len(problem.names)
    distance = distance * max(dof - 6.0, 1.0) / np.maximum(dof - distance, 1e-3)  # in noise that counts it is less
    sets, kept, many = [], table.kept, len(table.kept) > MANY
    furthest = float(distance[kept].max())
    for least in (max(0.5 * furthest, DOUBTED), furthest) if many else (furthest,):
        fewer = kept & (distance < least)
        if furthest > DOUBTED and np.isfinite(log_prior_outlying(len(kept), int(np.sum(~fewer)))):
            sets.append(fewer)
            break
    if not kept.all():
        left, *known = explained(problem, table, member)
        squared = np.sum((left - sum(known)) ** 2 / m.variance[member], axis=1)
        nearest = float(squared[~kept].min())
        sets.append(kept | (squared <= (max(nearest, 0.5 * DOUBTED) if many else nearest)))
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
    V = covariance_of_errors(problem, table, best)
    J = wrench_jacobian(table.tool, problem.R_base_flange[kept], problem.names)
    errors = problem.errors(table.tool, float(m.turn[best]))[kept] - J[:, :, problem.columns] @ m.step[best]
    weighted = V.precision_times(np.concatenate([J, errors[..., None]], axis=2))
    of_J, of_errors = weighted[:, :, :-1], weighted[:, :, -1]
    Z, of_bias = of_J[:, :, problem.columns], of_J[:, :, 4:10]
    own = np.linalg.inv(of_bias.sum(axis=0))
    Z = Z - of_bias @ own @ Z.sum(axis=0)
    D = V.precision_blocks - of_bias @ own @ of_bias.transpose(0, 2, 1) - Z @ m.covariance[best] @ Z.transpose(0, 2, 1)
    return of_errors - of_bias @ own @ of_errors.sum(axis=0), D
