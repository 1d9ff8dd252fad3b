"""Whitened least squares on a manifold, with the noise given up to one scale or estimated along the way.

What every joint fit shares: a `Problem` gives residuals and derivatives at a state and takes Gauss-Newton steps; here
are the iteration, the variances between poses (see noise.py), and what follows at the optimum: covariance, degrees of
freedom, leave-one-out residuals.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..calibration.observability import LEVER
from ..geometry.arrays import Array
from ..model import RigidTool
from .linearised import Linearised
from .noise import Scatter, axis_variances, whitening

MAX_ITERATIONS = 100
STEP_TOLERANCE = 1e-7
AXIS_PASSES = 2
"""How often each axis' variance is taken from the fit before: once more than once, as one noisy axis leaks into the
others of a fit that weights them alike."""

VARIANCE_TOLERANCE = 1e-3
"""Relative; a weight that is off by this much changes an estimate by far less than a hundredth of its std."""

SINGULAR_SCATTER = 1e-8
"""Of the scatter's variance: what is added where the scatter of few rows has no full rank."""

SAME_WEIGHTS = 0.02
"""Relative: variances that differ by less weight the readings alike."""

LEAST_LEFT = 0.5
"""Degrees of freedom: with fewer left, residuals say nothing about the noise."""

MOST_DOF = 1e6
"""What a parameter that the prior alone settles is said to have."""

State = TypeVar("State")


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
class Fit:
    """What an estimator hands on, in the terms of `Calibration`.

    `tool` is None for `affine`; `residuals` (n, 6) N, N m; `held_out` the same with each pose left out of the fit;
    `dof` (p,) behind the std of each parameter; `readings_left` what the parameters leave of the 6 n readings;
    `singular_values` (p,) of the whitened Jacobian with columns of unit
    length, largest first; `linear` the whitened problem at the optimum, None where the estimate is no least squares.
    """

    tool: RigidTool | None
    gravity_direction: Array
    B: Array
    B_covariance: Array
    covariance: Array
    noise: Array
    residuals: Array
    held_out: Array | None
    reduced_chi2: float
    dof: Array
    readings_left: float
    singular_values: Array
    linear: Linearised | None = None


class Problem(Protocol[State]):
    """A model to fit to given readings, from one state to the next."""

    def linearised(self, state: State, whitener: Array) -> Linearised:
        """Residuals and derivatives at `state`, whitened."""
        ...

    def advanced(self, state: State, linear: Linearised) -> State:
        """`state` after one Gauss-Newton step."""
        ...


@dataclass(frozen=True, eq=False)
class GivenNoise:
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


@dataclass(frozen=True, eq=False)
class Solved:
    """A converged problem and its noise."""

    linear: Linearised
    noise: EstimatedNoise | ScaledNoise


def relative_variances(noise: GivenNoise | None) -> Array:
    """Variances (6,) to begin with: of the given noise, or of torques as forces at a lever."""
    if noise is not None:
        return np.asarray(noise.std**2, dtype=np.float64)
    return np.array([1.0, 1.0, 1.0, LEVER**2, LEVER**2, LEVER**2])


def solve(
    problem: Problem[State], state: State, readings: PoseReadings, noise: GivenNoise | None
) -> tuple[State, Solved]:
    """Gauss-Newton to the end; the noise, or the scale of the given noise, is estimated along the way."""
    if noise is not None:
        return _with_given_noise(problem, state, readings, noise)
    n = len(readings)
    state, variance = _with_variance_of_groups(problem, state, readings)
    scatter, floor = readings.scatter, _least_variance(readings)
    linear = problem.linearised(state, whitening(variance, scatter, n))
    for _ in range(AXIS_PASSES):
        before = variance
        variance, mixing = axis_variances(variance, linear.whitener, linear.whitened, linear.U, floor).pooled()
        if float(np.max(np.abs(variance - before) / variance)) <= SAME_WEIGHTS:
            variance = before
            break
        state, linear = _converged(problem, state, whitening(variance, scatter, n))
    axes = axis_variances(variance, linear.whitener, linear.whitened, linear.U, floor)
    own = axes.single > variance
    counted, mixing = np.where(own, axes.single, variance), np.where(own[:, None], np.eye(6), mixing)
    return state, Solved(linear, EstimatedNoise(variance, counted, axes.dof, mixing, scatter))


def _with_given_noise(
    problem: Problem[State], state: State, readings: PoseReadings, noise: GivenNoise
) -> tuple[State, Solved]:
    """The optimum, with the one scale of the given noise that residuals and earlier degrees of freedom agree on."""
    n, given = len(readings), relative_variances(noise)
    least = float(np.max(_least_variance(readings) / given))
    scale, chi2, dof = 1.0, 0.0, 0.0
    for _ in range(MAX_ITERATIONS):
        state, linear = _converged(problem, state, whitening(scale * given, None, n))
        chi2, left = scale * linear.chi2_of_readings, linear.readings_left
        dof = noise.dof + left if left >= LEAST_LEFT else noise.dof
        before, scale = scale, max((noise.dof + chi2) / dof, least) if left >= LEAST_LEFT else 1.0
        if abs(scale - before) <= VARIANCE_TOLERANCE * scale:
            break
    return state, Solved(linear, ScaledNoise(scale * given, chi2 / left if left >= LEAST_LEFT else 1.0, dof))


def _converged(problem: Problem[State], state: State, whitener: Array) -> tuple[State, Linearised]:
    for _ in range(MAX_ITERATIONS):
        linear = problem.linearised(state, whitener)
        if linear.step_size() <= STEP_TOLERANCE:
            return state, linear
        state = problem.advanced(state, linear)
    return state, problem.linearised(state, whitener)


def _with_variance_of_groups(problem: Problem[State], state: State, readings: PoseReadings) -> tuple[State, Array]:
    """State and variances (6,) at the restricted maximum likelihood of one variance for the forces, one for torques."""
    n = len(readings)
    scattered, floor = _mean_scatter(readings.scatter), _least_variance(readings)
    linear = problem.linearised(state, whitening(relative_variances(None), None, n))
    state = problem.advanced(state, linear)
    left = float(np.sum(linear.whitened_after_step() ** 2)) / (6.0 * n)
    variance = np.maximum(relative_variances(None) * left, floor)
    for _ in range(MAX_ITERATIONS):
        linear = problem.linearised(state, whitening(variance, readings.scatter, n))
        state = problem.advanced(state, linear)
        axes = axis_variances(variance, linear.whitener, linear.whitened_after_step(), linear.U, floor)
        before, variance = variance, axes.of_groups()
        change = float(np.max(np.abs(variance - before) / (variance + scattered)))
        if linear.step_size() <= STEP_TOLERANCE and change <= VARIANCE_TOLERANCE:
            break
    return state, variance


def _least_variance(readings: PoseReadings) -> Array:
    """The least variance (6,) that is taken seriously: noise-free data carry rounding errors only, and the scatter of
    few rows may have no full rank.
    """
    scale = np.abs(readings.wrench).reshape(-1, 2, 3).max(axis=(0, 2), initial=0.0)
    rounding = np.repeat((1e-10 * scale + 1e-14) ** 2, 3)
    least: Array = np.maximum(rounding, SINGULAR_SCATTER * _mean_scatter(readings.scatter))
    return least


def finished(tool: RigidTool | None, gravity_direction: Array, B: Array, matrix_jacobian: Array, solved: Solved) -> Fit:
    """The `Fit` at an optimum; `matrix_jacobian` (24, p) is the derivative of B, row-major."""
    linear = solved.linear
    A = linear.inverse()
    covariance = A @ A.T
    if isinstance(solved.noise, EstimatedNoise):
        estimated, left = solved.noise, linear.readings_left
        reduced_chi2 = _chi2_of_scatter(linear, estimated.scatter) / left if left >= LEAST_LEFT else 1.0
        noise = np.sqrt(estimated.counted + _mean_scatter(estimated.scatter))
        gain = np.einsum("cp,nkp,nka->nca", A, linear.U, linear.whitener)
        covariance = covariance + np.einsum("nca,nda,a->cd", gain, gain, estimated.counted - estimated.weighting)
        from_prior = np.sum((A @ linear.U_prior.T) ** 2, axis=1)
        dof = _effective_dof(gain, np.diag(covariance), from_prior, estimated)
    else:
        reduced_chi2, noise = solved.noise.reduced_chi2, np.sqrt(solved.noise.variance)
        dof = np.full(len(A), solved.noise.dof)
    return Fit(
        tool=tool,
        gravity_direction=gravity_direction,
        B=B,
        B_covariance=matrix_jacobian @ covariance @ matrix_jacobian.T,
        covariance=covariance,
        noise=noise,
        residuals=linear.residuals,
        held_out=_held_out(linear),
        reduced_chi2=reduced_chi2,
        dof=dof,
        readings_left=linear.readings_left,
        singular_values=linear.s,
        linear=linear,
    )


def _mean_scatter(scatter: Scatter | None) -> Array:
    if scatter is None:
        return np.zeros(6)
    mean: Array = np.einsum("nii->i", scatter.covariance) / len(scatter.covariance)
    return mean


def _chi2_of_scatter(linear: Linearised, scatter: Scatter | None) -> float:
    """Sum of squares of the residuals over what the samples' scatter alone explains (without any: over the noise)."""
    if scatter is None:
        return linear.chi2_of_readings
    variance = np.einsum("nii->ni", scatter.covariance)
    known = variance > 0.0
    return float(np.sum(linear.residuals[known] ** 2 / variance[known]))


def _held_out(linear: Linearised) -> Array | None:
    """Residual (n, 6) of each pose against the fit to the other poses; None where the others are too few.

    From the block of the hat matrix, `(I - H_ii)^-1 e_i`: exact for a linear model, first order on the manifold.
    """
    remaining = np.eye(6) - linear.U @ linear.U.transpose(0, 2, 1)
    if float(np.linalg.eigvalsh(remaining)[:, 0].min()) < 1e-9:
        return None
    whitened = np.linalg.solve(remaining, linear.whitened[..., None])
    held_out: Array = np.linalg.solve(linear.whitener, whitened)[..., 0]
    return held_out


def _effective_dof(gain: Array, variance: Array, from_prior: Array, noise: EstimatedNoise) -> Array:
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
