"""Constant-force pushing: a ball-ended probe holds 10 N against a plate while the tool leans over and turns round."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from contactwrench.geometry.arrays import Array, read_only
from contactwrench.geometry.rotations import rotation_exp
from contactwrench.simulate.kinematics import joints_for
from contactwrench.simulate.rig import Rig, build

from .admittance import Admittance
from .closed_loop import PERIOD, ClosedLoop, ToContact, Trace
from .postures import roomy_joints
from .scenes import BALL_RADIUS, tip_in_flange

FORCE = 10.0
"""N, along the plate's normal."""
LEAN = np.deg2rad(30.0)
"""The largest of the tool, from square to the plate, to all sides."""
FIGURE_MOST = 1.25
"""Of `hypot(sin a, sin 2a)` over all a: the tool draws a figure of eight."""
START = 0.001
"""m from the plate."""
SETTLED = 1.5
"""s: of approach, which is not judged."""
ROUND = 8.0
"""s: twice about one axis while once about the other."""
YIELDING = Admittance(np.array([4.0]), np.array([800.0]), np.array([0.0]))
"""Along the plate's normal; the position across, and the orientation, are commanded."""
LOST = 0.05
"""m from where the plate is: the controller has run away."""
TOO_MUCH = 100.0
"""N: the robot's protective stop."""


@dataclass(frozen=True, eq=False)
class Pushing:
    """`normal_force` (n,) N: the true one after the approach, at the sensor's rate; zeros follow where the controller
    ran away from the plate or the robot's protective stop ended it.
    """

    normal_force: Array
    ended_early: bool
    trace: Trace

    def __post_init__(self) -> None:
        object.__setattr__(self, "normal_force", read_only(self.normal_force))

    @property
    def error(self) -> float:
        """Root mean square of the normal force's error, N."""
        return float(np.sqrt(np.mean((self.normal_force - FORCE) ** 2)))


def joints_at(rig: Rig, R_base_plate: Array, spot: Array) -> Array:
    """Joints (7,), rad, with the tool square to the plate and the ball at a spot (3,) of it, m, base axes."""
    R = R_base_plate @ np.diag([1.0, -1.0, -1.0]) @ rig.settings.R_flange_sensor.T
    return roomy_joints(build(rig.settings), R, spot + BALL_RADIUS * R_base_plate[:, 2] - R @ tip_in_flange(rig))


def push(
    rig: Rig, R_base_plate: Array, spot: Array, joints: Array, to_contact: ToContact, rng: np.random.Generator
) -> Pushing:
    """Pushing with `servo_rig(settings, PROBE, PLATE)`: the plate's axes (3, 3), z out of it, and the spot (3,), m, in
    base axes; `joints` are `joints_at` it. The lean begins in a random direction.
    """
    R_flange_sensor = rig.settings.R_flange_sensor
    tip, normal = tip_in_flange(rig), R_base_plate[:, 2]
    square = R_base_plate @ np.diag([1.0, -1.0, -1.0]) @ R_flange_sensor.T
    phase = rng.uniform(0.0, 2.0 * np.pi)
    about = np.array([[np.cos(phase), -np.sin(phase)], [np.sin(phase), np.cos(phase)], [0.0, 0.0]])
    touching = spot + BALL_RADIUS * normal

    def flange(height: Array, t: float) -> tuple[Array, Array]:
        angle = 2.0 * np.pi * max(t - SETTLED, 0.0) / ROUND
        lean = LEAN * np.array([np.sin(angle), np.sin(2.0 * angle)]) / FIGURE_MOST
        R = R_base_plate @ rotation_exp(about @ lean) @ R_base_plate.T @ square
        return R, touching + height[0] * normal - R @ tip

    height, velocity, t = np.array([START]), np.zeros(1), 0.0
    at_start, position = flange(height, t)
    arm = ClosedLoop(rig, joints_for(build(rig.settings), at_start, position, joints), R_base_plate, spot, rng)
    world_normal = rig.settings.R_world_base @ normal
    rows = np.zeros((round((SETTLED + ROUND) / PERIOD), len(arm.contact_force)))
    ended_early = False
    for k in range(len(rows)):
        t += PERIOD
        force = arm.R_base_flange @ (R_flange_sensor @ to_contact(arm.reading, arm.R_base_flange)[:3])
        height, velocity = YIELDING.step(height, velocity, np.array([force @ normal - FORCE]), PERIOD)
        arm.advance(*flange(height, t))
        rows[k] = arm.contact_force @ world_normal
        ended_early = bool(abs(height[0]) > LOST or rows[k].max() > TOO_MUCH)
        if ended_early:
            break
    return Pushing(rows[round(SETTLED / PERIOD) :].ravel(), ended_early, arm.trace())
