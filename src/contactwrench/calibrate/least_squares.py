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
from .noise import Scatter, VarianceUpdate, update_between, whitening

MAX_ITERATIONS = 100
STEP_TOLERANCE = 1e-7
VARIANCE_TOLERANCE = 1e-3
"""Relative; a weight that is off by this much changes an estimate by far less than a hundredth of its std."""

SINGULAR_SCATTER = 1e-8
"""Of the scatter's variance: what is added where the scatter of few rows has no full rank."""

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
class Solved:
    """A converged problem. `variance` (6,) of a pose's reading beyond its scatter; `update` None: noise given."""

    linear: Linearised
    variance: Array
    scatter: Scatter | None
    update: VarianceUpdate | None


def relative_variances(noise: Array | None) -> Array:
    """Variances (6,) to begin with: of the given noise, or of torques as forces at a lever."""
    if noise is not None:
        return np.asarray(noise**2, dtype=np.float64)
    return np.array([1.0, 1.0, 1.0, LEVER**2, LEVER**2, LEVER**2])


def iterate(problem: Problem[State], state: State, readings: PoseReadings, noise: Array | None) -> tuple[State, Solved]:
    """Gauss-Newton to the end, the between-pose variances estimated along the way unless the noise is given."""
    n = len(readings)
    variance = relative_variances(noise)
    if noise is not None:
        whitener = whitening(variance, None, n)
        for _ in range(MAX_ITERATIONS):
            linear = problem.linearised(state, whitener)
            state = problem.advanced(state, linear)
            if linear.step_size() <= STEP_TOLERANCE:
                break
        return state, Solved(problem.linearised(state, whitener), variance, None, None)

    scatter = readings.scatter
    scattered = _mean_scatter(scatter)
    floor = np.maximum(_rounding(readings.wrench), SINGULAR_SCATTER * scattered)
    linear = problem.linearised(state, whitening(variance, None, n))
    state = problem.advanced(state, linear)
    variance = np.maximum(variance * problem.linearised(state, linear.whitener).chi2 / (6.0 * n), floor)
    for _ in range(MAX_ITERATIONS):
        linear = problem.linearised(state, whitening(variance, scatter, n))
        state = problem.advanced(state, linear)
        update = update_between(variance, linear.whitener, linear.whitened_after_step(), linear.U, floor)
        change = np.abs(update.weighting - variance) / (update.weighting + scattered)
        variance = update.weighting
        if linear.step_size() <= STEP_TOLERANCE and float(change.max()) <= VARIANCE_TOLERANCE:
            break
    linear = problem.linearised(state, whitening(variance, scatter, n))
    return state, Solved(linear, variance, scatter, update)


def _rounding(wrench: Array) -> Array:
    """The least variance (6,) that is taken seriously: noise-free data carry rounding errors only."""
    scale = np.repeat([float(np.abs(wrench[:, :3]).max()), float(np.abs(wrench[:, 3:]).max())], 3)
    floor: Array = (1e-10 * scale + 1e-14) ** 2
    return floor


def finished(tool: RigidTool | None, gravity_direction: Array, B: Array, matrix_jacobian: Array, solved: Solved) -> Fit:
    """The `Fit` at an optimum; `matrix_jacobian` (24, p) is the derivative of B, row-major."""
    linear, n = solved.linear, len(solved.linear.residuals)
    A = linear.inverse()
    covariance = A @ A.T
    dof: float = 6 * n - len(A)
    if solved.update is None:
        reduced_chi2 = linear.chi2 / dof if dof > 0 else 1.0
        covariance = reduced_chi2 * covariance
        noise = np.sqrt(reduced_chi2 * solved.variance)
    else:
        reduced_chi2 = _chi2_of_scatter(linear, solved.scatter) / dof if dof > 0 else 1.0
        noise = np.sqrt(solved.update.counted + _mean_scatter(solved.scatter))
        gain = np.einsum("cp,nkp,nka->nca", A, linear.U, linear.whitener)
        covariance = covariance + np.einsum("nca,nda,a->cd", gain, gain, solved.update.counted - solved.variance)
        dof = _effective_dof(gain, covariance, solved.update, solved.scatter)
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


def _effective_dof(gain: Array, covariance: Array, update: VarianceUpdate, scatter: Scatter | None) -> float:
    """The fewest degrees of freedom behind the variance of any parameter (Satterthwaite, 1946).

    `gain` (n, p, 6) maps the readings' errors to the parameters'. A parameter's variance is a weighted sum of the
    axes' estimated variances, each with dof of its own.
    """
    of_axis = np.einsum("nca,nca->ca", gain, gain) * update.counted
    total = np.diag(covariance)
    spread = (of_axis @ update.mixing) ** 2 @ (1.0 / update.dof)
    if scatter is not None:
        spread += np.maximum(total - of_axis.sum(axis=1), 0.0) ** 2 / scatter.dof
    known = total > 0.0
    return float(np.min(total[known] ** 2 / spread[known]))
