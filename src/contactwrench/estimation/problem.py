"""What is asked of a set of poses: readings, what may be wrong with them, and what is known, linearised at a tool."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..geometry.arrays import Array
from ..model import GRAVITY, RigidTool, all_but_the_bias, free_wrench, gravity_in_flange, stepped, wrench_matrix
from .bias_drift import Kernels
from .hypotheses import Hypothesis
from .least_squares import Priors
from .noise import NoiseModel
from .priors import PriorRows, Question, rows_of

COM_SD = 0.15
"""m: a tool's size, which keeps what poor poses cannot tell within it; what is surely further off goes free."""

LARGEST_TURN = 0.5
"""rad in one step."""

BEYOND_WALL = 0.2
"""Cosine of the angle to the stated direction, up to which a negative weight is a positive one, gravity turned."""


@dataclass(frozen=True, eq=False)
class Problem:
    """Poses (n, 3, 3), readings (n, 6) with relative variances (n,), kernels of their errors, the parameters `names`,
    the question, what is known of the noise, and how the `robot`'s errors may be alike from pose to pose, (n, n), None:
    not at all.
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

    def known_at(self, tool: RigidTool) -> PriorRows:
        """What is known of the parameters but the bias, and what is nominal, linearised at `tool`."""
        known = rows_of((*self.question.knowledge, *self.question.nominal), tool, self.names)
        return replace(known, jacobian=known.jacobian[:, self.columns])

    def priors_at(self, tool: RigidTool, hypotheses: tuple[Hypothesis, ...]) -> Priors:
        """What is known beforehand under each hypothesis, linearised at `tool`."""
        known, h = self.known_at(tool), len(hypotheses)
        J = known.jacobian
        precision, of_volume = np.ones((h, len(J))), np.zeros((h, J.shape[1], J.shape[1]))
        if self.question.nominal:
            tilts = np.array([[0.0 if sd is None else sd**-2.0 for sd in (it.mount, it.base)] for it in hypotheses])
            precision[:, -7:-4] = 1.0 / (COM_SD**2 + float(tool.com @ tool.com))
            precision[:, -4:] = np.repeat(tilts, 2, axis=1)
            if not tilts.all():
                of_volume += np.multiply.outer(tilts[:, 0] == 0.0, J[-4:-2].T @ J[-4:-2])
                of_volume[:, [-2, -1], [-2, -1]] += tilts[:, 1:] == 0.0
        log_prior, apart = np.array([(it.log_prior, it.apart) for it in hypotheses]).T
        return Priors(known, precision, of_volume, log_prior, apart)
