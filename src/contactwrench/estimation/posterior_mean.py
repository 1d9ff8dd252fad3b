"""The mean over all members of the tables, and its covariance within and between."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..calibration.findings import BIAS_MOVED, Kind
from ..geometry.arrays import Array
from ..model import matrix_jacobian, small_change_about, stepped, wrench_jacobian, wrench_matrix
from .beliefs import beliefs_of
from .error_covariance import Turned, precision_times
from .estimate import IN_DOUBT, RigidEstimate
from .noise import MOST_DOF, PoseReadings
from .orientation_errors import covariance_of_gain, hidden_in_parameters
from .outliers import probability_of_a_level
from .posterior import deleted_errors
from .priors import rows_of
from .problem import Problem
from .robot_errors import variance_of_turns
from .tables import Table, covariance_of_errors, each_with_place, explained, explained_by_kernels
from .variance_components import inverse_of, log_spread

FEWEST_DOF = 2.0
"""With fewer an axis alone says next to nothing."""

NOT_EXCLUDED = 1.96**-2.0
"""Of the square of what a rival in doubt would make of the bias, in its variance: the 95 % interval reaches it."""

FOUND_AT_POSES = (Kind.TWO_LEVELS, Kind.CREEP)
"""Errors that another orientation has anew, by what is found at the poses."""

NOT_LEFT = (*BIAS_MOVED, Kind.CREEP)
"""What is found of these is known of each pose, and is no part of what is left there."""


def mean_of(problem: Problem, tables: list[Table], readings: PoseReadings, plain: bool) -> RigidEstimate:
    """The mean of all members of the tables, which are linearised at one tool; if `plain`, without held-out errors, and
    but for `auto` without beliefs.
    """
    names, columns, first, auto = problem.names, problem.columns, tables[0], problem.question.model == "auto"
    with_tool = tables if problem.question.earlier is None else [_with_tool_as_known(each) for each in tables]
    tool, bias = first.tool, slice(4, 10)
    log_all = np.concatenate([table.members.log_evidence for table in tables])
    weight = np.exp(log_all - np.logaddexp.reduce(log_all))
    steps, within = np.zeros((len(weight), len(names))), np.zeros((len(names), len(names)))
    own_variance, last_biases = np.zeros_like(steps), [_last_bias(problem, table) for table in tables]
    for (table, here), (mean, of_mean, own) in zip(each_with_place(with_tool), last_biases, strict=True):
        m, share = table.members, weight[here]
        steps[here, columns] = m.step
        steps[here, bias] = mean - (of_mean @ m.step[:, :, None])[:, :, 0]
        to_bias = -of_mean @ m.covariance
        C = np.zeros((len(share), len(names), len(names)))
        C[np.ix_(range(len(share)), columns, columns)] = m.covariance
        C[:, bias, columns] = to_bias
        C[:, columns, bias] = to_bias.transpose(0, 2, 1)
        C[:, bias, bias] = -to_bias @ of_mean.transpose(0, 2, 1) + own
        within += np.tensordot(share, C, 1)
        own_variance[here] = np.einsum("mpp->mp", C)
    step = weight @ steps
    moved = stepped(tool, step, names)
    axes = small_change_about(tool, moved, names)
    off = steps - step
    believed = None if plain and not auto else beliefs_of(problem, tables, weight, off, own_variance)
    covariance = axes @ (within + (weight * off.T) @ off) @ axes.T
    of_axes, spread = _of_axes(problem, first)
    of_axes = axes @ of_axes @ axes.T
    covariance = covariance + np.tensordot(_noisier_alone(problem, first) - 1.0, of_axes[:6], 1)
    from_parameters = matrix_jacobian(moved, names)
    of_B = covariance_of_gain(problem, tables, weight)
    known = rows_of(problem.question.knowledge, moved, names).jacobian
    hidden = hidden_in_parameters(of_B, moved, from_parameters, covariance, known)
    of_B = of_B - from_parameters @ hidden @ from_parameters.T
    covariance = covariance + hidden
    covariance = 0.5 * (covariance + covariance.T)
    variance = weight @ np.concatenate([table.members.variance for table in tables])
    variance = variance * _noisier_alone(problem, first) + _of_what_differs_anew(problem, tables, weight)
    best = first.best
    moves, beside = first.kernel_of(best)[0].kind in NOT_LEFT, problem.question.earlier is not None
    errors, of_kernel, _, of_turns = explained(problem, with_tool[0], best)
    errors = errors - of_kernel * moves
    of_noise, of_kernel, of_gain, _ = explained(problem, first, best)
    of_noise = of_noise - of_kernel * (moves or beside) - of_gain * beside
    covariance[bias, bias] += _of_other_causes(problem, tables, weight)
    left = first.members.dof[best].reshape(2, 3).sum(axis=1)
    if first.members.robot[best] >= 0:  # which are of the noise alone
        left = np.full(2, max(3.0 * int(first.kept.sum()) - 0.5 * len(names), 0.0))
    whitened = wrench_jacobian(moved, problem.R_base_flange[first.kept], names) / np.sqrt(variance)[:, None]
    rows = np.vstack([whitened.reshape(-1, len(names)), known])
    length = np.linalg.norm(rows, axis=0)
    return RigidEstimate(
        names=names,
        tool=moved,
        gravity_direction=moved.gravity_direction,
        B=wrench_matrix(moved),
        B_covariance=from_parameters @ covariance @ from_parameters.T,
        covariance=covariance,
        noise=np.sqrt(variance),
        dof=_dof(problem, first, of_axes, spread, covariance - hidden),
        kept=first.kept,
        errors=errors,
        held_out=None if plain else deleted_errors(problem, first),
        reduced_chi2=_reduced_chi2(problem, of_noise[first.kept], readings.select(first.kept), float(left.sum())),
        readings_left=left,
        singular_values=np.asarray(np.linalg.svd(rows / np.where(length > 0.0, length, 1.0), compute_uv=False)),
        of_robot=of_turns,
        gain_covariance=0.5 * (of_B + of_B.T) if of_B.any() else None,
        beliefs=believed,
    )


def _with_tool_as_known(table: Table) -> Table:
    """The table with the tool that is known beforehand, and its covariance, whatever the readings say of it: with the
    same sensor, cable and arm, errors that made the earlier tool what it is are there again, and do not average out.
    The bias is then what the readings leave of that tool, as uncertain as both are. What moved, which poses belong, and
    the noise are of a fit whose tool was free to follow.
    """
    m, covariance = table.members, inverse_of(table.priors.information)[table.members.hypothesis]
    step = covariance @ table.priors.pull[m.hypothesis][..., None]
    return replace(table, members=replace(m, step=step[..., 0], covariance=covariance))


def _of_other_causes(problem: Problem, tables: list[Table], weight: Array) -> Array:
    """What joins the covariance (6, 6) of the bias where a pose was left out as in contact, by the probability of that:
    where it is the last, a step before it reads the same, and where all of them are off alike, a second level that they
    are on. What no reading excludes is in the std.
    """
    n = len(problem.wrench)
    added, stepping = np.zeros((6, 6)), any(drift.first_after == n - 1 for drift in problem.kernels.drifts)
    for table, here in each_with_place(tables):
        out = np.flatnonzero(~table.kept)
        if not len(out):
            continue
        left, *known = explained(problem, table, table.best)
        off, share = (left - sum(known))[out], float(weight[here].sum())
        if stepping and out[-1] == len(left) - 1:
            added += share * NOT_EXCLUDED * np.outer(off[-1], off[-1])
        scale, halfway = np.sqrt(table.members.variance[table.best]), 0.5 * off.mean(axis=0)
        level = probability_of_a_level(len(left), off, scale, table.tool.weight)
        added += share * max(level, NOT_EXCLUDED * (level > IN_DOUBT)) * np.outer(halfway, halfway)
    return added


def _of_what_differs_anew(problem: Problem, tables: list[Table], weight: Array) -> Array:
    """What a field over orientations, two levels of the bias, creep or turns add to the variance (6,) of a reading:
    at a new orientation it is there anew.
    """
    added = np.zeros(6)
    for table, here in each_with_place(tables):
        m, share = table.members, weight[here]
        added += share @ m.turn**2 * variance_of_turns(table.tool, problem.R_base_flange)
        added += (share * m.strength**2 * (table.kinds == Kind.CABLE)) @ m.variance
        at_poses = np.array([kind in FOUND_AT_POSES for kind in table.kinds])
        if (alone := np.flatnonzero(at_poses & (m.robot < 0))).size:
            added += share[alone] @ np.mean(explained_by_kernels(problem, table, alone)[1] ** 2, axis=1)
        for member in np.flatnonzero(at_poses & (m.robot >= 0)).tolist():
            added += share[member] * np.mean(explained(problem, table, member)[1] ** 2, axis=0)
    return added


def _last_bias(problem: Problem, table: Table) -> tuple[Array, Array, Array]:
    """Of each member: the mean error (m, 6) that the last bias is read off, that of its derivatives (m, 6, p - 6), and
    the covariance (m, 6, 6) of the bias, were all else known.
    """
    m, kept, relative = table.members, table.kept, problem.relative[table.kept]
    J = wrench_jacobian(table.tool, problem.R_base_flange[kept], problem.names)[:, :, problem.columns]
    mean, own = np.zeros((len(m.kernel), 6, J.shape[2] + 1)), np.zeros((len(m.kernel), 6, 6))
    untouched = np.flatnonzero(m.robot < 0)
    kernels, of_member = np.unique(m.kernel[untouched], return_inverse=True)
    of_one = precision_times(table.kernels.at_poses(kernels, kept), relative, np.ones((len(relative), 1)))[..., 0]
    told, total = np.concatenate([J, problem.errors(table.tool)[kept, :, None]], axis=2), of_one.sum(axis=1)
    means = of_one @ told.reshape(len(relative), -1) / total[:, None]
    mean[untouched] = means.reshape(-1, *mean.shape[1:])[of_member]
    own[untouched[:, None], range(6), range(6)] = m.variance[untouched] / total[of_member, None]
    turned = np.flatnonzero(m.robot >= 0)
    for kernel, robot in sorted(set(zip(m.kernel[turned].tolist(), m.robot[turned].tolist(), strict=True))):
        alike = np.flatnonzero((m.kernel == kernel) & (m.robot == robot))
        if isinstance(V := covariance_of_errors(problem, table, int(alike[0])), Turned):
            told[:, :, -1] = problem.errors(table.tool, V.sd)[kept]
            mean[alike], own[alike] = V.constant(told)
    return mean[:, :, -1], mean[:, :, :-1], own


def _of_axes(problem: Problem, table: Table) -> tuple[Array, Array]:
    """Of the likeliest member: what each axis' noise contributes to the covariance of the parameters (6, p, p), and the
    covariance (6, 6) of the logarithms of their variances; more of each: the robot's turns, and the rows known, if any.
    """
    m, best = table.members, table.best
    V = covariance_of_errors(problem, table, best)
    J = wrench_jacobian(table.tool, problem.R_base_flange[table.kept], problem.names)
    weighted = V.precision_times(J)
    if problem.question.earlier is not None:  # the readings settle the bias alone
        weighted[:, :, problem.columns] = 0.0
    information = np.tensordot(weighted, J, ((0, 1), (0, 1)))
    information[np.ix_(problem.columns, problem.columns)] += table.priors.information[m.hypothesis[best]]
    base = V.base if isinstance(V, Turned) else V
    of_reading = weighted @ (covariance := inverse_of(information).T)
    gain = of_reading * np.sqrt(m.variance[best])[:, None]
    of_noise = gain * np.sqrt(problem.relative[table.kept])[:, None, None]
    of_kernel = base.strength * np.tensordot(base.columns[table.kept], gain, (0, 0))
    by_axis = np.concatenate([of_noise, of_kernel])
    of_axes: Array = by_axis.transpose(1, 2, 0) @ by_axis.transpose(1, 0, 2)
    spread = problem.noise.log_spread(m.dof[best], table.hypotheses[m.hypothesis[best]].apart)
    if isinstance(V, Turned):
        of_turns = V.along_turns(of_reading)
        of_axes, spread = np.concatenate([of_axes, (of_turns.T @ of_turns)[None]]), log_spread(V, J, information)
    return _and_known(problem, table, of_axes, spread, covariance)


def _and_known(problem: Problem, table: Table, of_axes: Array, spread: Array, covariance: Array) -> tuple[Array, Array]:
    """These and the same of each row of what is known, given the covariance (p, p) of the parameters: the variances of
    rows of one piece are off together, and with an earlier noise so far as that still stands behind the scale.
    """
    if not (pieces := [piece(table.tool, problem.names) for piece in problem.question.knowledge]):
        return of_axes, spread
    gain = np.concatenate([each.jacobian for each in pieces]) @ covariance
    std = np.sqrt(2.0 / np.concatenate([each.dof for each in pieces]))
    piece = np.repeat(np.arange(len(pieces)), [len(each.dof) for each in pieces])
    earlier = 0.0 if problem.noise.stated is None else problem.noise.stated.dof
    cross = np.outer(np.sqrt(0.5 * earlier) * np.diag(spread), std)
    of_known, alike = gain[:, :, None] * gain[:, None, :], np.outer(std, std) * np.equal.outer(piece, piece)
    return np.concatenate([of_axes, of_known]), np.block([[spread, cross], [cross.T, alike]])


def _noisier_alone(problem: Problem, table: Table) -> Array:
    """By how much (6,) an axis alone has more variance than its group lends it, at least 1: so that no noisy axis hides
    in its group.
    """
    m, best = table.members, table.best
    if problem.noise.stated is not None:
        return np.ones(6)
    alone = np.where(m.dof[best] > FEWEST_DOF, m.misfit[best] / np.maximum(m.dof[best], FEWEST_DOF), 1.0)
    return np.maximum(alone, 1.0)


def _dof(problem: Problem, table: Table, of_axes: Array, spread: Array, covariance: Array) -> Array:
    """Degrees of freedom (p,) behind the variance of each parameter (Satterthwaite, 1946): by how much the variances of
    the axes, and of what is known, of which it is a weighted sum, are uncertain together.
    """
    m, best = table.members, table.best
    alone = _noisier_alone(problem, table)
    for axis in np.flatnonzero(alone > 1.0):
        spread[axis, :] = spread[:, axis] = 0.0
        spread[axis, axis] = 2.0 / max(float(m.dof[best, axis]), FEWEST_DOF)
    share = np.einsum("app->pa", of_axes) * np.append(alone, np.ones(len(of_axes) - 6))
    share = share / np.maximum(np.diag(covariance), share.sum(axis=1) + 1e-300)[:, None]
    uncertain = np.einsum("pa,ab,pb->p", share, spread, share)
    return np.asarray(np.minimum(2.0 / np.maximum(uncertain, 2.0 / MOST_DOF), MOST_DOF))


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
