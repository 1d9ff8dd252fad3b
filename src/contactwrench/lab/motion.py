"""A move of the arm, from however it moves to rest at given joints, with its physics worked out once for all of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..geometry.arrays import Array
from ..simulate.arm import MAX_SPEED
from ..simulate.rig import Rig, inverse_dynamics
from ..simulate.trajectory import PEAK

KNOT = 0.002
"""s between the moments that MuJoCo computes; between them the physics is taken for linear: 1e-6 rad of the flange."""
SHORTEST = 0.4
"""s: of a move over no distance."""


@dataclass(frozen=True, eq=False)
class Course:
    """`joints` (k, 7), `wrench` (k, 6) of the free tool on the sensor, quaternions `quat_xyzw` (k, 4) of
    `R_base_flange`, `position` (k, 3) at k moments from `start` on, `KNOT` apart; after the last the arm rests.
    `coefficients` (6, 7) are of the joints' polynomial in s over `duration`, s.
    """

    start: float
    duration: float
    coefficients: Array
    joints: Array
    wrench: Array
    quat_xyzw: Array
    position: Array

    @property
    def end(self) -> float:
        """When the arm comes to rest."""
        return self.start + self.duration

    def at(self, values: Array, t: Array) -> Array:
        """Of such values (k, d), those at times (n,) that rise: (n, d)."""
        if t[0] >= self.end:
            return np.broadcast_to(values[-1], (len(t), values.shape[1]))
        knot = np.minimum(np.maximum((t - self.start) / KNOT, 0.0), len(values) - 1.0)
        before = np.minimum(knot.astype(np.intp), max(len(values) - 2, 0))
        after = np.minimum(before + 1, len(values) - 1)
        between: Array = values[before] + (knot - before)[:, None] * (values[after] - values[before])
        return between

    def state(self, t: float) -> Array:
        """Joints, their velocity and their acceleration (3, 7)."""
        if self.duration == 0.0 or t >= self.end:
            return np.stack([self.joints[-1], np.zeros(7), np.zeros(7)])
        return _derivatives(self.coefficients, np.array([t - self.start]))[:, 0]


def rest(rig: Rig, joints: Array, start: float) -> Course:
    """An arm that rests at joints (7,)."""
    return _course(rig, start, 0.0, np.vstack([joints, np.zeros((5, 7))]))


def course(rig: Rig, state: Array, joints: Array, start: float, speed: float) -> Course:
    """The motion of least jerk (Flash and Hogan 1985) from a state (3, 7) to rest at joints (7,).

    Args:
        rig: the machine.
        state: joints, velocity, acceleration.
        joints: to rest at.
        start: s.
        speed: of the joint that has furthest to go, of its largest.
    """
    furthest = float((np.abs(joints - state[0]) / MAX_SPEED).max())
    duration = max(PEAK * furthest / speed, SHORTEST)
    if state[1:].any():  # it is on its way elsewhere, and must not stop hard
        duration = max(duration, 4.0 * SHORTEST)
    return _course(rig, start, duration, _coefficients(state, joints, duration))


def _coefficients(state: Array, joints: Array, duration: float) -> Array:
    """Of the quintic that begins with a state and ends at rest: the first three are the state's, the others follow."""
    begin = np.stack([state[0], state[1], state[2] / 2.0])
    powers = duration ** np.arange(6.0)
    ends = np.array([[1.0] * 6, [0.0, 1.0, 2.0, 3.0, 4.0, 5.0], [0.0, 0.0, 2.0, 6.0, 12.0, 20.0]])
    wanted = np.stack([joints, np.zeros(7), np.zeros(7)])
    missing = wanted - ends[:, :3] @ (begin * powers[:3, None])
    return np.vstack([begin, np.linalg.solve(ends[:, 3:], missing) / powers[3:, None]])


def _derivatives(coefficients: Array, t: Array) -> Array:
    """Joints, velocity and acceleration (3, n, 7) at times (n,) from the start."""
    k = np.arange(6.0)
    powers = t[:, None] ** k
    slower, slowest = np.maximum(k - 1.0, 0.0), np.maximum(k - 2.0, 0.0)
    return np.stack(
        [
            powers @ coefficients,
            (k * t[:, None] ** slower) @ coefficients,
            (k * (k - 1.0) * t[:, None] ** slowest) @ coefficients,
        ]
    )


def _course(rig: Rig, start: float, duration: float, coefficients: Array) -> Course:
    from scipy.spatial.transform import Rotation

    t = np.minimum(np.arange(int(np.ceil(duration / KNOT)) + 1) * KNOT, duration)
    joints, velocity, acceleration = _derivatives(coefficients, t)
    physics = inverse_dynamics(rig, joints, velocity, acceleration)
    quat_xyzw: Array = Rotation.from_matrix(physics.R_base_flange).as_quat()
    turned = np.where((quat_xyzw[1:] * quat_xyzw[:-1]).sum(axis=1) < 0.0, -1.0, 1.0)
    quat_xyzw[1:] *= np.cumprod(turned)[:, None]
    return Course(start, duration, coefficients, joints, physics.wrench, quat_xyzw, physics.position)
