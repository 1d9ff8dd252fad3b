"""The noise of a pose: what its samples scatter, plus what poses differ by for no reason that the model knows.

Robot pose error, hysteresis, cross-talk and cables move a pose's mean far more than the scatter of its samples
does, so the variance between poses is estimated from the residuals: restricted maximum likelihood (Patterson and
Thompson, 1971) by the fixed-point iteration on its score, one variance an axis. A handful of poses says little about
one axis alone, so the logarithm of each axis' variance is drawn towards the mean of its group (forces, torques), by
the share of their spread that chance explains (after James and Stein, 1961). Those variances weight the readings; for
the covariance an axis' own variance counts where it is the larger, so that no noisy axis hides in its group.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from ..orientation import Array
from ..poses import Pose

GROUPS = (slice(0, 3), slice(3, 6))
LEAST_OWN_DOF = 2.0
CHANCE = 3.0
"""The spread of three log variances exceeds what chance gives on average by this factor once in 20 times (chi-square
with 2 dof): up to there the axes share one variance, beyond it less and less of it. A model with many parameters would
otherwise fit one axis of a few poses perfectly and call that its noise."""

Whitening: TypeAlias = Array
"""(n, 6, 6): inverse Cholesky factors W of the poses' noise covariances, so that `W @ error` has unit variance."""


@dataclass(frozen=True, eq=False)
class Scatter:
    """Covariance (n, 6, 6) of each pose's mean from the pooled scatter of its samples, and that scatter's dof."""

    covariance: Array
    dof: float


def pooled_scatter(poses: tuple[Pose, ...]) -> Scatter | None:
    """The scatter of the samples within poses, pooled over the poses; None where no pose has a repeated row."""
    n = np.array([pose.n for pose in poses], dtype=np.float64)
    dof = float(np.sum(n - 1.0))
    if dof == 0.0:
        return None
    of_sample = sum((pose.n * (pose.n - 1.0) * pose.wrench_cov for pose in poses), np.zeros((6, 6))) / dof
    return Scatter(of_sample / n[:, None, None], dof)


def whitening(between: Array, scatter: Scatter | None, n: int) -> Whitening:
    """Whitening of n poses for the between-pose variances (6,) and the scatter."""
    if scatter is None:
        return np.broadcast_to(np.diag(1.0 / np.sqrt(between)), (n, 6, 6))
    return np.linalg.inv(np.linalg.cholesky(scatter.covariance + np.diag(between)))


@dataclass(frozen=True, eq=False)
class VarianceUpdate:
    """One step of the iteration, each (6,): the variances that weight the readings, those that the covariance counts
    with, and the dof behind each axis alone; `mixing` (6, 6): how the logarithms of the counted variances follow
    those of single axes.
    """

    weighting: Array
    counted: Array
    dof: Array
    mixing: Array


def update_between(
    between: Array, whitener: Whitening, whitened_residuals: Array, U: Array, floor: Array
) -> VarianceUpdate:
    """The next between-pose variances (6,).

    `whitened_residuals` (n, 6); `U` (n, 6, p) orthonormal columns that span the whitened Jacobian. With
    P the projector off that span, the score of variance a vanishes where `e^T S^-1 S^-1 e = tr(P)` on axis a.
    """
    score = np.einsum("nka,nk->na", whitener, whitened_residuals)
    information = np.einsum("nka,nka->a", whitener, whitener)
    spanned = np.einsum("nka,nkp->nap", whitener, U)
    trace = np.maximum(information - np.einsum("nap,nap->a", spanned, spanned), 1e-12 * information)
    dof = np.maximum(trace * between, 0.1)
    single = np.maximum(between * np.einsum("na,na->a", score, score) / trace, floor)
    pooled, mixing = np.empty(6), np.zeros((6, 6))
    for group in GROUPS:
        pooled[group], mixing[group, group] = _pooled(single[group], dof[group])
    pooled = np.maximum(pooled, floor)
    own = single > pooled
    return VarianceUpdate(pooled, np.maximum(single, pooled), dof, np.where(own[:, None], np.eye(6), mixing))


def _pooled(single: Array, dof: Array) -> tuple[Array, Array]:
    """The variances (3,) of a group's axes, from their single estimates and dof, and their mixing (3, 3).

    With fewer than two dof an axis' own estimate says next to nothing, and the group shares one variance.
    The logarithm of a variance estimated with f dof has the variance 2/f + 2/f^2 and the bias -(1/f + 1/(3 f^2)),
    asymptotically (trigamma and digamma functions of f/2).
    """
    if float(dof.min()) < LEAST_OWN_DOF:
        share_of_each = dof / float(dof.sum())
        return np.full(len(dof), float(share_of_each @ single)), np.tile(share_of_each, (len(dof), 1))
    log_variance = float(np.mean(2.0 / dof + 2.0 / dof**2))
    log_bias = float(np.mean(1.0 / dof + 1.0 / (3.0 * dof**2)))
    logs = np.log(single)
    spread = float(np.var(logs, ddof=1))
    share = min(1.0, (CHANCE * log_variance / spread) ** 2) if spread > 0.0 else 1.0
    common = float(np.mean(logs)) + log_bias - log_variance / (2.0 * len(dof))
    mixing = (1.0 - share) * np.eye(len(dof)) + share / len(dof)
    return np.exp(logs + share * (common - logs)), mixing
