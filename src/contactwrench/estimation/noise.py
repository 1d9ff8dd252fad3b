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
from numpy.typing import ArrayLike, NDArray

from ..calibration.observability import LEVER
from ..errors import InputError
from ..geometry.arrays import Array
from ..samples.poses import Pose
from ..samples.samples import Samples

GROUPS = (slice(0, 3), slice(3, 6))
LEAST_OWN_DOF = 2.0
LEAST_DOF = 0.1
CHANCE = 7.0
"""The spread of three log variances exceeds what chance gives on average by this factor once in 1,000 times (chi-square
with 2 dof): up to there the axes share one variance, beyond it they quickly get their own."""

MOST_DOF = 1e6
"""What a parameter that the prior alone settles is said to have."""

NoiseLike: TypeAlias = "ArrayLike | Samples | None"
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


def mean_scatter(scatter: Scatter | None) -> Array:
    """The variances (6,) of a pose's mean from the scatter of its samples, on average; zero where there is none."""
    if scatter is None:
        return np.zeros(6)
    mean: Array = np.einsum("nii->i", scatter.covariance) / len(scatter.covariance)
    return mean


def in_time(poses: tuple[Pose, ...]) -> tuple[Pose, ...]:
    """The poses in the order of time."""
    return tuple(sorted(poses, key=_middle))


def _middle(pose: Pose) -> float:
    return 0.0 if pose.t_start is None or pose.t_end is None else 0.5 * (pose.t_start + pose.t_end)


def readings_of(poses: tuple[Pose, ...]) -> PoseReadings:
    """The poses as arrays."""
    return PoseReadings(
        np.array([pose.R_base_flange for pose in poses]),
        np.array([pose.wrench for pose in poses]),
        pooled_scatter(poses),
    )


def times_of(poses: tuple[Pose, ...]) -> Array:
    """The middle of each pose (n,), s; the count of poses where no time is known or it stands still."""
    times = np.array([_middle(pose) for pose in poses])
    if poses[0].t_start is not None and times[-1] > times[0]:
        return times
    return np.arange(len(poses), dtype=np.float64)


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


@dataclass(frozen=True, eq=False)
class PoseReadings:
    """The poses of a fit as arrays: `R_base_flange` (n, 3, 3), mean `wrench` (n, 6), and their scatter."""

    R_base_flange: Array
    wrench: Array
    scatter: Scatter | None

    def __len__(self) -> int:
        return len(self.wrench)

    def select(self, kept: NDArray[np.bool_]) -> PoseReadings:
        """The poses of a mask (n,)."""
        scatter = None if self.scatter is None else Scatter(self.scatter.covariance[kept], self.scatter.dof)
        return PoseReadings(self.R_base_flange[kept], self.wrench[kept], scatter)


@dataclass(frozen=True, eq=False)
class StatedNoise:
    """Standard deviations (6,) of one pose's reading, N and N m, known up to one scale; `dof` degrees of freedom stand
    behind that scale already (0: none, the residuals settle it).
    """

    std: Array
    dof: float = 0.0


@dataclass(frozen=True, eq=False)
class EstimatedNoise:
    """Between-pose variances that were estimated along with the fit.

    `weighting` (6,) those that weighted the readings; `counted` (6,) those that the covariance counts with; `dof` (6,)
    behind each axis alone; `mixing` (6, 6) of the counted variances, see noise.py; the samples' `scatter`.
    """

    weighting: Array
    counted: Array
    dof: Array
    mixing: Array
    scatter: Scatter | None


@dataclass(frozen=True, eq=False)
class ScaledNoise:
    """Given variances (6,) times the scale that was found, the `reduced_chi2` of the readings against what was given,
    and the `dof` behind the scale.
    """

    variance: Array
    reduced_chi2: float
    dof: float


def stated_noise(noise: NoiseLike) -> StatedNoise | None:
    """The noise of one pose's reading from what the user states of it, or None. Raises `InputError`."""
    if noise is None:
        return None
    try:
        values = np.asarray(noise.wrench if isinstance(noise, Samples) else noise, dtype=np.float64)
    except (TypeError, ValueError):
        values = np.empty(0)
    if values.ndim == 2 and values.shape[1] == 6 and len(values) >= 2:
        values = values.std(axis=0, ddof=1)
    if values.shape != (6,) or not (np.isfinite(values).all() and (values > 0.0).all()):
        raise InputError(
            "noise must be six standard deviations above 0 (fx..tz, N and N m), or a recording at rest (n, 6) in which "
            f"every axis moves; found {np.array2string(values, threshold=8)}"
        )
    return StatedNoise(values)


def relative_variances(noise: StatedNoise | None) -> Array:
    """Variances (6,) to begin with: of the given noise, or of torques as forces at a lever."""
    if noise is not None:
        return np.asarray(noise.std**2, dtype=np.float64)
    return np.array([1.0, 1.0, 1.0, LEVER**2, LEVER**2, LEVER**2])


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


def effective_dof(gain: Array, variance: Array, from_prior: Array, noise: EstimatedNoise) -> Array:
    """Degrees of freedom (p,) behind the variance of each parameter (Satterthwaite, 1946).

    `gain` (n, p, 6) maps the readings' errors to the parameters'. A parameter's `variance` (p,) is a weighted sum of
    the axes' estimated variances, each with dof of its own, of the scatter's, and of what comes `from_prior` (p,),
    which is known.
    """
    of_axis = np.einsum("nca,nca->ca", gain, gain) * noise.counted
    spread = (of_axis @ noise.mixing) ** 2 @ (1.0 / noise.dof)
    if noise.scatter is not None:
        spread += np.maximum(variance - of_axis.sum(axis=1) - from_prior, 0.0) ** 2 / noise.scatter.dof
    dof: Array = np.divide(variance**2, spread, out=np.full(len(variance), MOST_DOF), where=spread > 0.0)
    return np.minimum(dof, MOST_DOF)
