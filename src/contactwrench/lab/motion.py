"""A move of the arm, from however it moves to rest at given joints, with its physics worked out once for all of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..geometry.arrays import Array
from ..geometry.orientation import to_quat_xyzw
from ..simulate.arm import MAX_SPEED
from ..simulate.rig import Rig, inverse_dynamics
from ..simulate.trajectory import PEAK

KNOT = 0.002
"""s between the moments that MuJoCo computes; between them all is taken for linear: 1e-6 rad of the flange."""
SHORTEST = 0.4
"""s: of a move over no distance."""
TURNING_ROUND = 4.0 * SHORTEST
"""s: of the shortest move that begins on the way elsewhere, as the arm must not stop hard."""


@dataclass(frozen=True, eq=False)
class Move:
    """`joints` (k, 7), `wrench` (k, 6) of the free tool on the sensor, quaternions `quat_xyzw` (k, 4) of
    `R_base_flange`, `position` (k, 3) at k moments, `KNOT` apart from `start` on until `end`; then the arm rests.
    `path` is the joints' polynomial.
    """

    start: float
    end: float
    path: Any
    joints: Array
    wrench: Array
    quat_xyzw: Array
    position: Array

    def at(self, values: Array, t: Array) -> Array:
        """Of such values (k, d), those at times (n,) that rise: (n, d)."""
        if t[0] >= self.end:
            return np.broadcast_to(values[-1], (len(t), values.shape[1]))
        knot = np.minimum(np.maximum((t - self.start) / KNOT, 0.0), len(values) - 1.0)
        before = np.minimum(knot.astype(np.intp), len(values) - 2)
        return np.asarray(values[before] + (knot - before)[:, None] * (values[before + 1] - values[before]))

    def state(self, t: float) -> Array:
        """Joints, their velocity and their acceleration (3, 7)."""
        since = min(max(t, self.start), self.end) - self.start
        return np.stack([self.path(since, derivative) for derivative in range(3)])


def move(rig: Rig, state: Array, joints: Array, start: float, speed: float) -> Move:
    """The motion of least jerk (Flash and Hogan 1985) from a state (3, 7), joints, velocity and acceleration, to rest
    at joints (7,), from `start` s on; `speed`: of the joint that has furthest to go, of its largest.
    """
    from scipy.interpolate import BPoly

    furthest = float((np.abs(joints - state[0]) / MAX_SPEED).max())
    duration = max(PEAK * furthest / speed, TURNING_ROUND if np.abs(state[1:]).max() > 1e-9 else SHORTEST)
    path = BPoly.from_derivatives([0.0, duration], [[*state], [joints, np.zeros(7), np.zeros(7)]])
    t = np.minimum(np.arange(int(np.ceil(duration / KNOT)) + 1) * KNOT, duration)
    physics = inverse_dynamics(rig, *(path(t, derivative) for derivative in range(3)))
    quat_xyzw = to_quat_xyzw(physics.R_base_flange)
    turned = np.where((quat_xyzw[1:] * quat_xyzw[:-1]).sum(axis=1) < 0.0, -1.0, 1.0)
    quat_xyzw[1:] *= np.cumprod(turned)[:, None]
    return Move(start, start + duration, path, physics.joints, physics.wrench, quat_xyzw, physics.position)
