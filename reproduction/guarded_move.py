"""The guarded move: straight ahead along the tool until the contact force reaches 5 N, then stop.

It is the simplest thing to do with a sense of touch: looking for a surface whose place is not known. In any orientation
of the arm it needs the contact force itself: a reading that the tool's weight moves stops too early, or too late.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from contactwrench.geometry.arrays import Array
from contactwrench.geometry.rotations import rotation_exp
from contactwrench.simulate.kinematics import flange_jacobian, flange_pose, random_joints
from contactwrench.simulate.rig import Rig, build

from .closed_loop import PERIOD, ClosedLoop, ToContact, Trace
from .scenes import BALL_RADIUS, tip_in_flange

THRESHOLD = 5.0
"""N, of the contact force that is felt."""
SPEED = 0.01
"""m/s."""
GAP = (0.005, 0.015)
"""m to go in free air."""
LARGEST_LEAN = np.deg2rad(20.0)
"""Of the surface, from square to the motion."""
AFTER = 0.15
"""s: the arm has come to rest."""
TOO_MUCH = 40.0
"""N: a force that should have been felt long before."""
BEYOND = 0.004
"""m behind the surface at which the move ends at the latest."""
NIMBLE = 0.1
"""The least singular value of the flange's Jacobian (m and rad) from where a move may begin."""


@dataclass(frozen=True, eq=False)
class GuardedMove:
    """How it ended: at a `contact`, by a `false stop` in free air, or not at all (`missed`).

    `at_stop` N: the true contact force when the stop was commanded; `largest` N: the largest that there was.
    """

    ended: Literal["contact", "false stop", "missed"]
    at_stop: float
    largest: float
    trace: Trace


def approaches(rig: Rig, n: int, rng: np.random.Generator) -> Array:
    """Joints (m, 7), rad, from which a short straight move along the tool is possible, in any orientation.

    They are `n` random configurations (`random_joints`, which stay away from the joints' limits) less those near a
    singularity.
    """
    plain = build(rig.settings)
    joints = random_joints(plain, n, rng)
    nimble = [np.linalg.svd(flange_jacobian(plain, one), compute_uv=False)[-1] > NIMBLE for one in joints]
    chosen: Array = joints[np.array(nimble, dtype=bool)]
    return chosen


def tool_axis(rig: Rig, joints: Array) -> Array:
    """The direction (3,) of the move from `joints` (7,), rad: the flange's z in base axes."""
    axis: Array = flange_pose(build(rig.settings), joints[None])[0][0][:, 2]
    return axis


def guarded_move(rig: Rig, joints: Array, to_contact: ToContact, rng: np.random.Generator) -> GuardedMove:
    """One move of `servo_rig(settings, PROBE, PLATE)` from `joints` (7,), rad, towards a plate that the robot does not
    know: at a random distance, leaning in a random direction.
    """
    R, start = (part[0] for part in flange_pose(build(rig.settings), joints[None]))
    ahead, gap = R[:, 2], rng.uniform(*GAP)
    R_base_plate = R @ np.diag([1.0, -1.0, -1.0]) @ _lean(rng)
    touching = start + R @ tip_in_flange(rig) + gap * ahead
    arm = ClosedLoop(rig, joints, R_base_plate, touching - BALL_RADIUS * R_base_plate[:, 2], rng)
    way, at_stop, largest, since = 0.0, 0.0, 0.0, 0.0
    stopped = touched = False
    while since < AFTER and way < gap + BEYOND and largest < TOO_MUCH:
        if stopped:
            since += PERIOD
        else:
            force = to_contact(arm.reading, arm.R_base_flange)[:3]
            stopped = bool(force @ force >= THRESHOLD**2)
            if stopped:
                at_stop, touched = float(np.linalg.norm(arm.contact_force[-1])), largest > 0.0
            else:
                way += SPEED * PERIOD
        arm.advance(R, start + way * ahead)
        largest = max(largest, arm.largest_force)
    if not stopped:
        return GuardedMove("missed", at_stop, largest, arm.trace())
    return GuardedMove("contact" if touched else "false stop", at_stop, largest, arm.trace())


def _lean(rng: np.random.Generator) -> Array:
    about = rng.uniform(0.0, 2.0 * np.pi)
    return rotation_exp(rng.uniform(0.0, LARGEST_LEAN) * np.array([np.cos(about), np.sin(about), 0.0]))
