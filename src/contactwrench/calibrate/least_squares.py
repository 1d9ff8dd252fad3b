"""Whitened least squares on a manifold, with the noise given up to one scale or estimated along the way.

What every joint fit shares: a `Problem` gives residuals and derivatives at a state and takes Gauss-Newton steps; here
are the iteration, the variances between poses (see noise.py), and what follows at the optimum: covariance, degrees of
freedom, leave-one-out residuals.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, TypeVar

import numpy as np

from ..model import RigidTool
from ..orientation import Array
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

LEVER = 0.05
"""m: before anything is known of the noise, a torque counts as a force at this lever."""

State = TypeVar("State")


@dataclass(frozen=True, eq=False)
class PoseReadings:
    """The poses of a fit as arrays: `R_base_flange` (n, 3, 3), mean `wrench` (n, 6), and their scatter."""

    R_base_flange: Array
    wrench: Array
    scatter: Scatter | None

    def __len__(self) -> int:
        return len(self.wrench)


@dataclass(frozen=True, eq=False)
class Fit:
    """What an estimator hands on, in the terms of `Calibration`.

    `tool` is None for `affine`; `residuals` (n, 6) N, N m; `held_out` the same with each pose left out of the fit;
    `singular_values` (p,) of the whitened Jacobian with columns of unit length, largest first.
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
    dof: float
    singular_values: Array


@dataclass(frozen=True, eq=False)
class Linearised:
    """The whitened problem at one point, and the singular value decomposition of its Jacobian by way of QR."""

    residuals: Array
    whitener: Array
    whitened: Array
    U: Array
    s: Array
    Vt: Array
    column_length: Array

    @property
    def chi2(self) -> float:
        """Sum of the squared whitened residuals."""
        return float(np.sum(self.whitened**2))

    def inverse(self) -> Array:
        """A (p, p): `A @ U^T @ whitened` is the least-squares step, of least length where nothing determines it;
        `A @ A.T` is the covariance of the parameters.
        """
        inverse: Array = (self.Vt.T / np.where(self.s > 0.0, self.s, np.inf)) / self.column_length[:, None]
        return inverse

    def step(self) -> Array:
        """The Gauss-Newton step (p,)."""
        step: Array = self.inverse() @ self.gradient()
        return step

    def gradient(self) -> Array:
        """The whitened residuals along the columns of U (p,): zero at the optimum."""
        along: Array = self.U.reshape(-1, len(self.s)).T @ self.whitened.ravel()
        return along

    def whitened_after_step(self) -> Array:
        """The whitened residuals (n, 6) that the step will leave, to first order."""
        left: Array = self.whitened - np.einsum("nkp,p->nk", self.U, self.gradient())
        return left

    def step_size(self) -> float:
        """Length of the next step in standard deviations of the readings, relative to the misfit that is left."""
        return float(np.linalg.norm(self.gradient())) / max(1.0, float(np.sqrt(self.chi2)))


def linearise(residuals: Array, jacobian: Array, whitener: Array) -> Linearised:
    """Whiten residuals (n, 6) and Jacobian (n, 6, p), scale its columns to unit length, and decompose it."""
    n, _, p = jacobian.shape
    J = (whitener @ jacobian).reshape(6 * n, p)
    length = np.sqrt(np.einsum("ip,ip->p", J, J))
    length[length == 0.0] = 1.0
    Q, triangle = np.linalg.qr(J / length)
    left, s, Vt = np.linalg.svd(triangle)
    s[s < 1e-10 * s[0]] = 0.0
    U = (Q @ left[:, : len(s)]) * (s > 0.0)
    whitened = np.einsum("nij,nj->ni", whitener, residuals)
    return Linearised(residuals, whitener, whitened, U.reshape(n, 6, -1), s, Vt[: len(s)], length)


class Problem(Protocol[State]):
    """A model to fit to given readings, from one state to the next."""

    def linearised(self, state: State, whitener: Array) -> Linearised:
        """Residuals and derivatives at `state`, whitened."""
        ...

    def advanced(self, state: State, linear: Linearised) -> State:
        """`state` after one Gauss-Newton step."""
        ...


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
class Solved:
    """A converged problem, and its noise: estimated, or given as variances (6,) up to one scale."""

    linear: Linearised
    noise: EstimatedNoise | Array


def relative_variances(noise: Array | None) -> Array:
    """Variances (6,) to begin with: of the given noise, or of torques as forces at a lever."""
    if noise is not None:
        return np.asarray(noise**2, dtype=np.float64)
    return np.array([1.0, 1.0, 1.0, LEVER**2, LEVER**2, LEVER**2])


def solve(problem: Problem[State], state: State, readings: PoseReadings, noise: Array | None) -> tuple[State, Solved]:
    """Gauss-Newton to the end; the between-pose variances are estimated along the way unless the noise is given."""
    n = len(readings)
    variance = relative_variances(noise)
    if noise is not None:
        state, linear = _converged(problem, state, whitening(variance, None, n))
        return state, Solved(linear, variance)
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
    linear, n = solved.linear, len(solved.linear.residuals)
    A = linear.inverse()
    covariance = A @ A.T
    dof: float = 6 * n - len(A)
    if isinstance(solved.noise, EstimatedNoise):
        estimated = solved.noise
        reduced_chi2 = _chi2_of_scatter(linear, estimated.scatter) / dof if dof > 0 else 1.0
        noise = np.sqrt(estimated.counted + _mean_scatter(estimated.scatter))
        gain = np.einsum("cp,nkp,nka->nca", A, linear.U, linear.whitener)
        covariance = covariance + np.einsum("nca,nda,a->cd", gain, gain, estimated.counted - estimated.weighting)
        dof = _effective_dof(gain, covariance, estimated)
    else:
        reduced_chi2 = linear.chi2 / dof if dof > 0 else 1.0
        covariance = reduced_chi2 * covariance
        noise = np.sqrt(reduced_chi2 * solved.noise)
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
        dof=float(dof),
        singular_values=linear.s,
    )


def _mean_scatter(scatter: Scatter | None) -> Array:
    if scatter is None:
        return np.zeros(6)
    mean: Array = np.einsum("nii->i", scatter.covariance) / len(scatter.covariance)
    return mean


def _chi2_of_scatter(linear: Linearised, scatter: Scatter | None) -> float:
    """Sum of squares of the residuals over what the samples' scatter alone explains (without any: over the noise)."""
    if scatter is None:
        return linear.chi2
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


def _effective_dof(gain: Array, covariance: Array, noise: EstimatedNoise) -> float:
    """The fewest degrees of freedom behind the variance of any parameter (Satterthwaite, 1946).

    `gain` (n, p, 6) maps the readings' errors to the parameters'. A parameter's variance is a weighted sum of the
    axes' estimated variances, each with dof of its own.
    """
    of_axis = np.einsum("nca,nca->ca", gain, gain) * noise.counted
    total = np.diag(covariance)
    spread = (of_axis @ noise.mixing) ** 2 @ (1.0 / noise.dof)
    if noise.scatter is not None:
        spread += np.maximum(total - of_axis.sum(axis=1), 0.0) ** 2 / noise.scatter.dof
    known = total > 0.0
    return float(np.min(total[known] ** 2 / spread[known]))
