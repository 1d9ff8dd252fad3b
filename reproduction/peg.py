"""Peg in hole: a peg of 20 mm in a hole 0.5 mm wider, which is not quite where the robot believes it to be.

The peg is pushed along the hole's believed axis with a constant force, and yields to the contact wrench at its tip in
the other directions: to sideways forces, and to torques about both axes across. The chamfer is as wide as the
largest offset, so no search is needed: all that can go wrong is what the robot believes it feels.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from contactwrench.geometry.arrays import Array
from contactwrench.geometry.rotations import rotation_exp
from contactwrench.geometry.wrench import cross_matrix
from contactwrench.simulate.kinematics import joints_for
from contactwrench.simulate.rig import Rig, build

from .admittance import Admittance
from .closed_loop import PERIOD, ClosedLoop, ToContact, Trace
from .postures import roomy_joints
from .scenes import TIP, tip_in_flange

PUSH = 12.0
"""N, along the hole."""
LARGEST_OFFSET = 0.002
LARGEST_TILT = np.deg2rad(2.0)
DEEP = 0.02
"""m below the block's face: the peg is in."""
START = 0.005
"""m: of the peg's end over the face, as the robot believes."""
LONGEST = 10.0
"""s: five times and more what it takes with the true contact wrench."""
TOO_MUCH = 100.0
"""N: the robot's protective stop, and the end of the try."""
LOST = 0.012
"""m: with its tip so far off the axis, or over the face, the peg is no longer looking for the hole."""

YIELDING = Admittance(
    np.array([4.0, 4.0, 4.0, 0.02, 0.02, 0.02]),
    np.array([800.0, 800.0, 800.0, 2.0, 2.0, 2.0]),
    np.array([500.0, 500.0, 0.0, 2.0, 2.0, 2.0]),
)
"""Along and about the believed hole's axes. The largest offset costs 1 N sideways, the largest tilt 0.07 N m; along the
hole there is no spring, and the damping makes the push 15 mm/s in free air.
"""

AT_TIP = np.block([[np.eye(3), np.zeros((3, 3))], [-cross_matrix(TIP), np.eye(3)]])
"""From a wrench at the sensor to the same wrench about the peg's tip, both in sensor axes."""
TOOL_IN_HOLE = np.diag([1.0, -1.0, -1.0])
"""The tool points into the hole."""


@dataclass(frozen=True, eq=False)
class Insertion:
    """How it ended: `in`, the peg's end at `DEEP` below the face of the block where its springs let it be; out of
    `time`; `lost`; or by the protective `stop`.

    `largest_force` N: the largest net force of block and peg on each other; `depth` m: how far it came; `seconds` that
    it took, or until it was given up.
    """

    ended: Literal["in", "time", "lost", "stop"]
    largest_force: float
    depth: float
    seconds: float
    trace: Trace

    @property
    def inserted(self) -> bool:
        """Whether the peg is in."""
        return self.ended == "in"


def joints_over(rig: Rig, R_base_hole: Array, mouth: Array) -> Array:
    """Joints (7,), rad, with the peg's end in the middle of the hole's mouth (3,), m, base axes."""
    R = R_base_hole @ TOOL_IN_HOLE @ rig.settings.R_flange_sensor.T
    return roomy_joints(build(rig.settings), R, mouth - R @ tip_in_flange(rig))


def insert(
    rig: Rig, R_base_hole: Array, mouth: Array, joints: Array, to_contact: ToContact, rng: np.random.Generator
) -> Insertion:
    """One try with `servo_rig(settings, peg_tool(), hole())`, the hole's axes (3, 3), z out of it, and the middle of
    its mouth (3,), m, in base axes; `joints` are `joints_over` it. The robot believes the hole to be off by a random
    offset and tilt.
    """
    R_believed, believed = _misplaced(R_base_hole, mouth, rng)
    R_flange_sensor = rig.settings.R_flange_sensor
    R_tool_flange = TOOL_IN_HOLE @ R_flange_sensor.T
    tip = tip_in_flange(rig)

    def flange(displacement: Array) -> tuple[Array, Array]:
        R = R_believed @ rotation_exp(displacement[3:]) @ R_tool_flange
        return R, believed + R_believed @ displacement[:3] - R @ tip

    displacement, velocity = np.zeros(6), np.zeros(6)
    displacement[2] = START
    R, position = flange(displacement)
    arm = ClosedLoop(rig, joints_for(build(rig.settings), R, position, joints), R_base_hole, mouth, rng)
    largest, depth, seconds = 0.0, 0.0, 0.0
    ended: Literal["in", "time", "lost", "stop"] = "time"
    while ended == "time" and seconds < LONGEST:
        felt = AT_TIP @ to_contact(arm.reading, arm.R_base_flange)
        R_sensor_believed = (arm.R_base_flange @ R_flange_sensor).T @ R_believed
        force = (felt.reshape(2, 3) @ R_sensor_believed).ravel()
        force[2] -= PUSH
        force[5] = 0.0
        displacement, velocity = YIELDING.step(displacement, velocity, force, PERIOD)
        arm.advance(*flange(displacement))
        seconds += PERIOD
        largest = max(largest, arm.largest_force)
        x, y, z = arm.in_work(arm.position + arm.R_base_flange @ tip).tolist()
        depth = -z
        if largest > TOO_MUCH:
            ended = "stop"
        elif depth >= DEEP:
            ended = "in"
        elif max(np.hypot(x, y), z) > LOST:
            ended = "lost"
    return Insertion(ended, largest, depth, seconds, arm.trace())


def _misplaced(R_base_hole: Array, mouth: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """Where the robot believes the hole to be: off by up to the largest offset and tilt, in any direction across."""
    way, about = rng.uniform(0.0, 2.0 * np.pi, 2)
    offset, tilt = rng.uniform(0.0, LARGEST_OFFSET), rng.uniform(0.0, LARGEST_TILT)
    turn = rotation_exp(tilt * np.array([np.cos(about), np.sin(about), 0.0]))
    return R_base_hole @ turn, mouth + R_base_hole @ (offset * np.array([np.cos(way), np.sin(way), 0.0]))
