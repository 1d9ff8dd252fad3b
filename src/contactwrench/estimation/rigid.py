"""The joint force and torque fit of the rigid models `yaw`, `mount` and `mount+base`.

Gauss-Newton steps of the mounting and of gravity are small rotations, so no angle is singular; the start is global, so
no mounting needs a guess.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..geometry.arrays import Array
from ..model import (
    PARAMETERS,
    RigidTool,
    free_wrench,
    gravity_in_flange,
    matrix_jacobian,
    stepped,
    wrench_jacobian,
    wrench_matrix,
)
from .initial_guess import SEARCH_OF_MODEL, starting_tools
from .least_squares import Fit, GivenNoise, PoseReadings, Solved, finished, relative_variances, solve
from .linearised import Linearised, linearise
from .noise import whitening
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
    noise: GivenNoise | None,
    knowledge: tuple[Knowledge, ...] = (),
    sign: float = 1.0,
) -> Fit:
    """Fit `yaw`, `mount` or `mount+base`.

    `gravity_direction` (3,) in base axes is held, but for `mount+base`; `knowledge` joins the readings. `sign` -1 fits
    the negated readings (the rival reading of section 4b of the method). Singular problems are returned as they come:
    see observability.py.
    """
    problem = RigidProblem(readings.R_base_flange, sign * readings.wrench, PARAMETERS[model], knowledge)
    starts = starting_tools(readings.R_base_flange, problem.wrench, SEARCH_OF_MODEL[model], gravity_direction)
    tool, solved = solved_from(problem, starts, readings, noise)
    return finished_rigid(tool, problem.names, solved)


def solved_from(
    problem: RigidProblem, starts: list[RigidTool], readings: PoseReadings, noise: GivenNoise | None
) -> tuple[RigidTool, Solved]:
    """The optimum that the most promising of the starts leads to."""
    rough = whitening(relative_variances(noise), None, len(readings))
    settled = [_settled(problem, start, rough) for start in starts]
    best, _ = min(settled, key=lambda found: found[1])
    return solve(problem, best, readings, noise)


def finished_rigid(tool: RigidTool, names: tuple[str, ...], solved: Solved) -> Fit:
    """The `Fit` of a rigid tool at its optimum."""
    return finished(tool, tool.gravity_direction, wrench_matrix(tool), matrix_jacobian(tool, names), solved)


def _settled(problem: RigidProblem, tool: RigidTool, whitener: Array) -> tuple[RigidTool, float]:
    """A start brought close to its optimum, and the misfit there."""
    for _ in range(SETTLE_ITERATIONS):
        linear = problem.linearised(tool, whitener)
        tool = problem.advanced(tool, linear)
        if linear.step_size() <= SETTLED:
            break
    return tool, problem.misfit(tool, whitener)
