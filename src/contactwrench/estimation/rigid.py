"""The joint force and torque fit of the rigid models `yaw`, `mount` and `mount+base`, and that of `affine`.

Gauss-Newton steps of the mounting and of gravity are small rotations, so no angle is singular; the initial guess is
global, so no mounting has to be stated.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..geometry.arrays import Array
from ..model import (
    PARAMETERS,
    RigidTool,
    affine_jacobian,
    free_wrench,
    gravity_in_flange,
    matrix_jacobian,
    stepped,
    wrench_jacobian,
    wrench_matrix,
)
from .initial_guess import SEARCH_OF_MODEL, initial_guesses
from .least_squares import LEAST_LEFT, Fit, Linearised, Solved, linearise, solve
from .noise import (
    EstimatedNoise,
    PoseReadings,
    Scatter,
    StatedNoise,
    effective_dof,
    mean_scatter,
    relative_variances,
    whitening,
)
from .priors import Knowledge, rows_of

SETTLE_ITERATIONS = 12
SETTLED = 1e-2


@dataclass(frozen=True, eq=False)
class RigidProblem:
    """Residuals, derivatives and steps of a rigid tool with the parameters `names` for poses (n, 3, 3) and readings
    (n, 6), and what is known of it beforehand.
    """

    R_base_flange: Array
    wrench: Array
    names: tuple[str, ...]
    knowledge: tuple[Knowledge, ...] = ()

    def residuals(self, tool: RigidTool) -> Array:
        """What `tool` leaves in the readings, (n, 6), N and N m."""
        r = gravity_in_flange(self.R_base_flange, tool.gravity_direction)
        return self.wrench - free_wrench(wrench_matrix(tool), r)

    def linearised(self, tool: RigidTool, whitener: Array) -> Linearised:
        """Residuals and derivatives at `tool`, whitened, with the rows of what is known."""
        jacobian = wrench_jacobian(tool, self.R_base_flange, self.names)
        return linearise(self.residuals(tool), jacobian, whitener, rows_of(self.knowledge, tool, self.names))

    def advanced(self, tool: RigidTool, linear: Linearised) -> RigidTool:
        """A Gauss-Newton step, halved until the misfit does not grow."""
        step = linear.step()
        for _ in range(30):
            moved = stepped(tool, step, self.names)
            if self.misfit(moved, linear.whitener) <= linear.chi2 * (1.0 + 1e-12):
                return moved
            step = 0.5 * step
        return tool

    def misfit(self, tool: RigidTool, whitener: Array) -> float:
        """Sum of the squared whitened residuals, those of what is known included."""
        whitened = np.einsum("nij,nj->ni", whitener, self.residuals(tool))
        known = rows_of(self.knowledge, tool, self.names)
        return float(np.sum(whitened**2)) + (0.0 if known is None else float(known.residuals @ known.residuals))


def fit_rigid(
    readings: PoseReadings,
    model: str,
    gravity_direction: Array,
    noise: StatedNoise | None,
    knowledge: tuple[Knowledge, ...] = (),
    sign: float = 1.0,
) -> Fit:
    """Fit `yaw`, `mount` or `mount+base`.

    `gravity_direction` (3,) in base axes is held, but for `mount+base`; `knowledge` joins the readings. `sign` -1 fits
    the negated readings (the rival reading of section 4b of the method). Singular problems are returned as they come:
    see observability.py.
    """
    problem = RigidProblem(readings.R_base_flange, sign * readings.wrench, PARAMETERS[model], knowledge)
    guesses = initial_guesses(readings.R_base_flange, problem.wrench, SEARCH_OF_MODEL[model], gravity_direction)
    tool, solved = solved_from(problem, guesses, readings, noise)
    return finished_rigid(tool, problem.names, solved)


def solved_from(
    problem: RigidProblem, guesses: list[RigidTool], readings: PoseReadings, noise: StatedNoise | None
) -> tuple[RigidTool, Solved]:
    """The optimum that the most promising of the guesses leads to."""
    rough = whitening(relative_variances(noise), None, len(readings))
    settled = [_settled(problem, guess, rough) for guess in guesses]
    best, _ = min(settled, key=lambda guess: guess[1])
    return solve(problem, best, readings, noise)


def finished_rigid(tool: RigidTool, names: tuple[str, ...], solved: Solved) -> Fit:
    """The `Fit` of a rigid tool at its optimum."""
    return finished(tool, tool.gravity_direction, wrench_matrix(tool), matrix_jacobian(tool, names), solved)


def finished(tool: RigidTool | None, gravity_direction: Array, B: Array, matrix_jacobian: Array, solved: Solved) -> Fit:
    """The `Fit` at an optimum; `matrix_jacobian` (24, p) is the derivative of B, row-major."""
    linear = solved.linear
    A = linear.inverse()
    covariance = A @ A.T
    if isinstance(solved.noise, EstimatedNoise):
        estimated, left = solved.noise, linear.readings_left
        reduced_chi2 = _chi2_of_scatter(linear, estimated.scatter) / left if left >= LEAST_LEFT else 1.0
        noise = np.sqrt(estimated.counted + mean_scatter(estimated.scatter))
        gain = np.einsum("cp,nkp,nka->nca", A, linear.U, linear.whitener)
        covariance = covariance + np.einsum("nca,nda,a->cd", gain, gain, estimated.counted - estimated.weighting)
        from_prior = np.sum((A @ linear.U_prior.T) ** 2, axis=1)
        dof = effective_dof(gain, np.diag(covariance), from_prior, estimated)
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


def _settled(problem: RigidProblem, tool: RigidTool, whitener: Array) -> tuple[RigidTool, float]:
    """A guess brought close to its optimum, and the misfit there."""
    for _ in range(SETTLE_ITERATIONS):
        linear = problem.linearised(tool, whitener)
        tool = problem.advanced(tool, linear)
        if linear.step_size() <= SETTLED:
            break
    return tool, problem.misfit(tool, whitener)


class _AffineProblem:
    """Residuals, derivatives and steps of the 24 numbers B, row-major."""

    def __init__(self, r: Array, wrench: Array) -> None:
        self.r, self.wrench = r, wrench
        self.jacobian = affine_jacobian(r)

    def linearised(self, B: Array, whitener: Array) -> Linearised:
        return linearise(self.wrench - free_wrench(B, self.r), self.jacobian, whitener)

    def advanced(self, B: Array, linear: Linearised) -> Array:
        return B + linear.step().reshape(6, 4)


def fit_affine(readings: PoseReadings, gravity_direction: Array, noise: StatedNoise | None) -> Fit:
    """Fit B (6, 4) itself, 24 free numbers: `F = A r + F0, T = A_t r + T0` (method, section 4)."""
    problem = _AffineProblem(gravity_in_flange(readings.R_base_flange, gravity_direction), readings.wrench)
    B, solved = solve(problem, np.zeros((6, 4)), readings, noise)
    return finished(None, gravity_direction, B, np.eye(24), solved)
