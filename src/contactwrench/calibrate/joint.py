"""The joint force and torque fit of the rigid models `yaw`, `mount` and `mount+base`.

Gauss-Newton steps of the mounting and of gravity are small rotations, so no angle is singular; the start is global, so
no mounting needs a guess.
"""

from __future__ import annotations

import numpy as np

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
from ..orientation import Array
from .least_squares import Fit, Linearised, PoseReadings, finished, linearise, relative_variances, solve
from .noise import whitening
from .start import starting_tools

SETTLE_ITERATIONS = 12
SETTLED = 1e-2


class _RigidProblem:
    """Residuals, derivatives and steps of a rigid model for given readings."""

    def __init__(self, R_base_flange: Array, wrench: Array, names: tuple[str, ...]) -> None:
        self.R_base_flange, self.wrench, self.names = R_base_flange, wrench, names

    def residuals(self, tool: RigidTool) -> Array:
        r = gravity_in_flange(self.R_base_flange, tool.gravity_direction)
        return self.wrench - free_wrench(wrench_matrix(tool), r)

    def linearised(self, tool: RigidTool, whitener: Array) -> Linearised:
        return linearise(self.residuals(tool), wrench_jacobian(tool, self.R_base_flange, self.names), whitener)

    def advanced(self, tool: RigidTool, linear: Linearised) -> RigidTool:
        """A Gauss-Newton step, halved until the misfit does not grow."""
        step = linear.step()
        for _ in range(30):
            moved = stepped(tool, step, self.names)
            whitened = np.einsum("nij,nj->ni", linear.whitener, self.residuals(moved))
            if float(np.sum(whitened**2)) <= linear.chi2 * (1.0 + 1e-12):
                return moved
            step = 0.5 * step
        return tool


def fit_rigid(
    readings: PoseReadings, model: str, gravity_direction: Array, noise: Array | None, sign: float = 1.0
) -> Fit:
    """Fit `yaw`, `mount` or `mount+base`.

    `gravity_direction` (3,) in base axes is held, but for `mount+base`. `noise` (6,) standard deviations of one
    pose's reading, whose common scale the residuals settle, or None. `sign` -1 fits the negated readings (the
    rival reading of section 4b of the method). Singular problems are returned as they come: see observability.py.
    """
    names = PARAMETERS[model]
    wrench = sign * readings.wrench
    problem = _RigidProblem(readings.R_base_flange, wrench, names)
    rough = whitening(relative_variances(noise), None, len(readings))
    starts = starting_tools(readings.R_base_flange, wrench, model, gravity_direction)
    settled = [_settled(problem, start, rough) for start in starts]
    best, _ = min(settled, key=lambda found: found[1])
    tool, solved = solve(problem, best, readings, noise)
    return finished(tool, tool.gravity_direction, wrench_matrix(tool), matrix_jacobian(tool, names), solved)


def _settled(problem: _RigidProblem, tool: RigidTool, whitener: Array) -> tuple[RigidTool, float]:
    """A start brought close to its optimum, and the misfit there."""
    for _ in range(SETTLE_ITERATIONS):
        linear = problem.linearised(tool, whitener)
        tool = problem.advanced(tool, linear)
        if linear.step_size() <= SETTLED:
            break
    return tool, float(np.sum((whitener @ problem.residuals(tool)[..., None]) ** 2))
