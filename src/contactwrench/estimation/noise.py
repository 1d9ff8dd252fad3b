"""The noise of a pose: what its samples scatter, plus what poses differ by for no reason that the model knows.

Robot pose error, hysteresis, cross-talk and cables move a pose's mean far more than the scatter of its samples
does, so the variance between poses is estimated from the residuals, by restricted maximum likelihood (Patterson and
Thompson, 1971). First one variance for the forces and one for the torques, to convergence. Then, from what that fit
leaves, one an axis: a handful of poses says little about one axis alone, so the logarithm of each is drawn towards the
mean of its group, by the share of their spread that chance explains (after James and Stein, 1961). Those variances
weight the readings. They are not iterated: a model with many parameters would come to fit one axis of a few poses
perfectly and call that its noise. In the covariance an axis' own variance counts where it is the larger, so that no
noisy axis hides in its group.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from ..geometry.arrays import Array
from ..samples.poses import Pose

GROUPS = (slice(0, 3), slice(3, 6))
LEAST_OWN_DOF = 2.0
LEAST_DOF = 0.1
CHANCE = 7.0
"""The spread of three log variances exceeds what chance gives on average by this factor once in 1,000 times (chi-square
with 2 dof): up to there the axes share one variance, beyond it they quickly get their own."""

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


def variance_of_means(noise: Array, fitted: tuple[Pose, ...], rows: Array) -> Array:
    """Variance (m, 6) of the mean of so many `rows` (m,) each: what the `fitted` poses, whose readings have the std
    `noise` (6,), differ by, and the scatter of a sample over the rows (where no row is repeated, `noise` has both).
    """
    scatter = pooled_scatter(fitted)
    if scatter is None:
        return np.tile(noise**2, (len(rows), 1))
    of_means = np.einsum("nii->ni", scatter.covariance)
    of_sample = of_means[0] * fitted[0].n
    between = np.maximum(noise**2 - of_means.mean(axis=0), 0.0)
    total: Array = between + of_sample / rows[:, None]
    return total


def whitening(between: Array, scatter: Scatter | None, n: int) -> Whitening:
    """Whitening of n poses for the between-pose variances (6,) and the scatter."""
    if scatter is None:
        return np.broadcast_to(np.diag(1.0 / np.sqrt(between)), (n, 6, 6))
    return np.linalg.inv(np.linalg.cholesky(scatter.covariance + np.diag(between)))


@dataclass(frozen=True, eq=False)
class AxisVariances:
    """Between-pose variances (6,) as each axis tells them alone, and the degrees of freedom (6,) behind each."""

    single: Array
    dof: Array

    def of_groups(self) -> Array:
        """One variance for the forces and one for the torques, (6,)."""
        variance = np.empty(6)
        for group in GROUPS:
            variance[group] = float(self.dof[group] @ self.single[group]) / float(self.dof[group].sum())
        return variance

    def pooled(self) -> tuple[Array, Array]:
        """Each axis' variance (6,), drawn towards its group, and the mixing (6, 6): how the logarithms of these
        follow those of single axes.
        """
        variance, mixing = np.empty(6), np.zeros((6, 6))
        for group in GROUPS:
            variance[group], mixing[group, group] = _pooled(self.single[group], self.dof[group])
        return variance, mixing


def axis_variances(between: Array, whitener: Whitening, residuals: Array, U: Array, floor: Array) -> AxisVariances:
    """The next estimate of the between-pose variances, from a fit that was weighted with `between` (6,).

    `residuals` (n, 6), whitened; `U` (n, 6, p) orthonormal columns that span the whitened Jacobian. With P the
    projector off that span, the score of the variance of axis a vanishes where `e^T S^-1 I_a S^-1 e = tr(P I_a)`;
    the ratio of the two sides is the factor of the next estimate, exact at once where there is no scatter. `floor`
    (6,) is the least variance that is taken seriously.
    """
    score = np.einsum("nka,nk->na", whitener, residuals)
    information = np.einsum("nka,nka->a", whitener, whitener)
    spanned = np.einsum("nka,nkp->nap", whitener, U)
    trace = np.maximum(information - np.einsum("nap,nap->a", spanned, spanned), 1e-12 * information)
    single = between * np.einsum("na,na->a", score, score) / trace
    return AxisVariances(np.maximum(single, floor), np.maximum(trace * between, LEAST_DOF))


def _pooled(single: Array, dof: Array) -> tuple[Array, Array]:
    """The variances (3,) of a group's axes, from their single estimates and dof, and their mixing (3, 3).

    With fewer than two dof an axis' own estimate says next to nothing, and the group shares one variance.
    The logarithm of a variance estimated with f dof has the variance 2/f + 2/f^2 and the bias -(1/f + 1/(3 f^2)),
    asymptotically (trigamma and digamma functions of f/2).
    """
    of_each = dof / float(dof.sum())
    if float(dof.min()) < LEAST_OWN_DOF:
        return np.full(len(dof), float(of_each @ single)), np.tile(of_each, (len(dof), 1))
    log_variance = float(np.mean(2.0 / dof + 2.0 / dof**2))
    log_bias = float(np.mean(1.0 / dof + 1.0 / (3.0 * dof**2)))
    logs = np.log(single)
    spread = float(np.var(logs, ddof=1))
    share = min(1.0, (CHANCE * log_variance / spread) ** 4) if spread > 0.0 else 1.0
    common = float(np.mean(logs)) + log_bias - log_variance / (2.0 * len(dof))
    mixing = (1.0 - share) * np.eye(len(dof)) + share / len(dof)
    return np.exp(logs + share * (common - logs)), mixing
