"""Whitened least squares on a manifold, with the noise given up to one scale or estimated along the way.

What every joint fit shares: a `Problem` gives residuals and derivatives at a state and takes Gauss-Newton steps; here
are the iteration, the variances between poses (see noise.py), and what follows at the optimum: covariance, degrees of
freedom, leave-one-out residuals.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, TypeVar

import numpy as np

from ..geometry.arrays import Array
from ..model import RigidTool
from .noise import (
    GROUPS,
    EstimatedNoise,
    PoseReadings,
    ScaledNoise,
    StatedNoise,
    axis_variances,
    mean_scatter,
    relative_variances,
    whitening,
)

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

NEGLIGIBLE = 1e-10
"""Of the largest singular value: below, a direction is not determined and the step leaves it alone."""


State = TypeVar("State")


@dataclass(frozen=True, eq=False)
class PriorRows:
    """What is known before the readings, as rows of unit variance.

    `residuals` (q,): what is known less what the state says, in standard deviations; `jacobian` (q, p): the derivative
    of what the state says, likewise.
    """

    residuals: Array
    jacobian: Array


@dataclass(frozen=True, eq=False)
class Linearised:
    """The whitened problem at one point, and the singular value decomposition of its Jacobian by way of QR.

    `residuals` (n, 6) and `whitened` (n, 6) of the readings, `prior` (q,) those of the prior; `U` (n, 6, p) and
    `U_prior` (q, p) together have orthonormal columns.
    """

    residuals: Array
    whitener: Array
    whitened: Array
    prior: Array
    U: Array
    U_prior: Array
    s: Array
    Vt: Array
    column_length: Array

    @property
    def chi2(self) -> float:
        """Sum of the squared whitened residuals, the prior's included: what the step makes smaller."""
        return self.chi2_of_readings + float(self.prior @ self.prior)

    @property
    def chi2_of_readings(self) -> float:
        """Sum of the squared whitened residuals of the readings alone."""
        return float(np.sum(self.whitened**2))

    @property
    def readings_left(self) -> float:
        """Degrees of freedom that the readings have left; a parameter that the prior settles costs them none."""
        return self.whitened.size - float(np.sum(self.U**2))

    @property
    def tells_noise(self) -> bool:
        """Whether forces and torques, whose noises differ, each have readings left to estimate their noise from."""
        return self.least_left >= LEAST_LEFT

    @property
    def least_left(self) -> float:
        """Degrees of freedom that are left to the forces, or to the torques, whichever has fewer."""
        return min(3.0 * len(self.residuals) - float(np.sum(self.U[:, group] ** 2)) for group in GROUPS)

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
        along: Array = self.U.reshape(-1, len(self.s)).T @ self.whitened.ravel() + self.U_prior.T @ self.prior
        return along

    def whitened_after_step(self) -> Array:
        """The whitened residuals (n, 6) of the readings that the step will leave, to first order."""
        left: Array = self.whitened - np.einsum("nkp,p->nk", self.U, self.gradient())
        return left

    def step_size(self) -> float:
        """Length of the next step in standard deviations of the readings, relative to the misfit that is left."""
        return float(np.linalg.norm(self.gradient())) / max(1.0, float(np.sqrt(self.chi2)))


def linearise(residuals: Array, jacobian: Array, whitener: Array, prior: PriorRows | None = None) -> Linearised:
    """Whiten residuals (n, 6) and Jacobian (n, 6, p), add the prior's rows, scale columns to unit length, decompose."""
    n, _, p = jacobian.shape
    J = (whitener @ jacobian).reshape(6 * n, p)
    if prior is not None:
        J = np.vstack([J, prior.jacobian])
    length = np.sqrt(np.einsum("ip,ip->p", J, J))
    length[length == 0.0] = 1.0
    Q, triangle = np.linalg.qr(J / length)
    left, s, Vt = np.linalg.svd(triangle)
    s[s < NEGLIGIBLE * s[0]] = 0.0
    U = (Q @ left[:, : len(s)]) * (s > 0.0)
    return Linearised(
        residuals=residuals,
        whitener=whitener,
        whitened=np.einsum("nij,nj->ni", whitener, residuals),
        prior=np.empty(0) if prior is None else prior.residuals,
        U=U[: 6 * n].reshape(n, 6, -1),
        U_prior=U[6 * n :],
        s=s,
        Vt=Vt[: len(s)],
        column_length=length,
    )


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

    @property
    def rigid_tool(self) -> RigidTool:
        """The tool of a fit that is known to be rigid."""
        if self.tool is None:
            raise TypeError("a rigid fit has a tool")
        return self.tool


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
    """A converged problem and its noise."""

    linear: Linearised
    noise: EstimatedNoise | ScaledNoise


def solve(
    problem: Problem[State], state: State, readings: PoseReadings, noise: StatedNoise | None
) -> tuple[State, Solved]:
    """Gauss-Newton to the end; the noise, or the scale of the given noise, is estimated along the way."""
    if noise is not None:
        return _with_stated_noise(problem, state, readings, noise)
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


def _with_stated_noise(
    problem: Problem[State], state: State, readings: PoseReadings, noise: StatedNoise
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
    scattered, floor = mean_scatter(readings.scatter), _least_variance(readings)
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
    least: Array = np.maximum(rounding, SINGULAR_SCATTER * mean_scatter(readings.scatter))
    return least
