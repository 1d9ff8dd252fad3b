"""What is asked of a set of poses: readings, what may be wrong with them, and what is known."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..geometry.arrays import Array
from ..model import GRAVITY, RigidTool, all_but_the_bias, free_wrench, gravity_in_flange, stepped, wrench_matrix
from .bias_drift import Kernels
from .noise import NoiseModel
from .priors import Question

LARGEST_TURN = 0.5
"""rad in one step."""

BEYOND_WALL = 0.2
"""Cosine of the angle to the stated direction, up to which a negative weight is a positive one, gravity turned."""


@dataclass(frozen=True, eq=False)
class Problem:
    """Poses (n, 3, 3), readings (n, 6) with relative variances (n,), kernels of their errors, the parameters `names`,
    the question, what is known of the noise, and how the `robot`'s errors may be alike from pose to
    pose, (n, n), None: not at all.
    """

    R_base_flange: Array
    wrench: Array
    relative: Array
    kernels: Kernels
    names: tuple[str, ...]
    question: Question
    noise: NoiseModel
    robot: tuple[Array | None, ...] = ()

    @property
    def columns(self) -> list[int]:
        """Of the parameters: those that are not the bias."""
        return all_but_the_bias(self.names)

    def errors(self, tool: RigidTool, turn: float = 0.0) -> Array:
        """What `tool` leaves in the readings, (n, 6), whose orientations are off by `turn` rad an axis: either way that
        takes as much off what lies along gravity.
        """
        r = (1.0 - turn**2) * gravity_in_flange(self.R_base_flange, tool.gravity_direction)
        return self.wrench - free_wrench(wrench_matrix(tool), r)

    def stepped(self, tool: RigidTool, step: Array) -> RigidTool:
        """The tool after a step (p,) in all but the bias, no rotation too far."""
        full = np.zeros(len(self.names))
        full[self.columns] = step
        turn = float(np.abs(step[4:]).max(initial=0.0))
        moved = stepped(tool, full * min(1.0, LARGEST_TURN / max(turn, LARGEST_TURN)), self.names)
        d = moved.gravity_direction
        if moved.weight < 0.0 and GRAVITY[0] in self.names and d @ self.question.gravity_direction < BEYOND_WALL:
            return replace(moved, weight=-moved.weight, gravity_direction=-d)
        return moved
