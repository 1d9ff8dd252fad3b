"""One recording for model `dynamic`: the planned stops, and after them the motion that tells most of the inertia."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..errors import InputError
from ..geometry.arrays import Array, Frozen
from ..geometry.ranges import HEIGHT, MOTION_TIME, NEAR
from .fourier_motion import ABOVE, WITHIN, FourierMotion, Limits, limits_of, moving_flange, pace
from .motion_design import best_motion
from .plan import Expected, Plan, expected_tool, plan
from .robot_arms import Arm, Reach, flange_pose, reach

STOPS, STOP, DURATION = 12, 1.5, 30.0
"""How many, and s."""
MOVE_PACE = 0.5
"""Of the fastest, from stop to stop: the sensor and the cables rest sooner."""
ON_A_MOVE, LOOKED_AT = 61, 0.005
"""Moments of a move at which its limits are kept; s, from one to the next at which the largest values are taken."""


@dataclass(frozen=True, eq=False)
class Largest:
    """Of a whole recording: how far each joint goes `from_start`, its `speed` and `acceleration` (k,) in rad and
    s; the flange's `turn_speed` rad/s, `turn_acceleration` rad/s^2 and `flange_speed` m/s, its `lowest` height over the
    plane of the base, m, and its `furthest` from where it starts, m.
    """

    from_start: Array
    speed: Array
    acceleration: Array
    turn_speed: float
    turn_acceleration: float
    flange_speed: float
    lowest: float
    furthest: float


@dataclass(frozen=True, eq=False)
class DynamicPlan(Frozen):
    """One recording for model `dynamic`: stops, and a motion after them, from and to where the arm stands.

    `stops` as planned; `visited` (n + 2, k) rad with the start at both ends, `moves` (n + 1,) s from each to the next;
    then `motion`. `limits` that it keeps; `std` (9,) of `DYNAMIC_PARAMETERS`, kg m^2 and m, given the tool and the
    bias, and `std_after_stops` (9,) with what the stops leave open of these.
    """

    arm: Arm
    stops: Plan
    visited: Array
    moves: Array
    motion: FourierMotion
    limits: Limits
    std: Array
    std_after_stops: Array

    @property
    def duration(self) -> float:
        """Of the recording, s."""
        return float(STOP * (len(self.visited) + 1) + self.moves.sum() + self.motion.duration)

    @cached_property
    def largest(self) -> Largest:
        """What the arm has to do at most, every 5 ms."""
        t = np.arange(0.0, self.duration, LOOKED_AT)
        joints = self.at(t)
        flange = moving_flange(self.arm, *joints)
        turning = flange.motion.angular_velocity, flange.motion.angular_acceleration
        from_start, speed, acceleration = (np.abs(q - q[0]).max(axis=0) for q in joints)
        turn_speed, turn_acceleration = (float(np.linalg.norm(each, axis=1).max()) for each in turning)
        return Largest(
            from_start,
            speed,
            acceleration,
            turn_speed,
            turn_acceleration,
            float(flange.speed.max()),
            float(flange.position[:, 2].min()),
            float(np.linalg.norm(flange.position - flange.position[0], axis=1).max()),
        )

    def at(self, t: Array) -> tuple[Array, Array, Array]:
        """Joints at times (n,), s, and their derivatives (n, k): rad, rad/s, rad/s^2. Stops of `STOP`, moves of least
        jerk (Flash and Hogan 1985), a stop, the motion, a stop.
        """
        leaves = np.cumsum(np.r_[STOP, STOP + self.moves])
        row = np.minimum(np.searchsorted(leaves - STOP, t, "right") - 1, len(self.moves))
        step = np.vstack([np.diff(self.visited, axis=0), np.zeros(len(self.arm))])[row]
        taken = np.r_[self.moves, 1.0][row][:, None]
        s = np.clip((t - leaves[row])[:, None] / taken, 0.0, 1.0)
        along, speed, acceleration = _least_jerk(s)
        q, qd, qdd = self.visited[row] + along * step, speed * step / taken, acceleration * step / taken**2
        into = t - leaves[-1]
        moving = (into > 0.0) & (into < self.motion.duration)
        q[moving], qd[moving], qdd[moving] = self.motion.at(into[moving])
        return q, qd, qdd


def plan_motion(
    arm: Arm,
    around: Array | None = None,
    n: int = STOPS,
    expected: Expected | None = None,
    *,
    model: str = "auto",
    duration: float = DURATION,
    above: float = ABOVE,
    within: float = WITHIN,
) -> DynamicPlan:
    """The stops, and after them the motion that tells most of inertia and sensor offset.

    Args:
        arm: with k joints.
        around: joints (k,), rad, where it stands; None: its home.
        n: how many stops.
        expected: tool and noise; None: assumed.
        model: that the stops are for, as in `plan`.
        duration: of the motion, s, at most.
        above: m, of the flange over the plane of the base.
        within: m, of the flange from where it starts, during the motion.

    Raises:
        InputError: joints that leave no room, and as `plan` and `reach`.
    """
    MOTION_TIME.require(duration, "duration")
    HEIGHT.require(above, "above")
    NEAR.require(within, "within")
    expected = expected_tool(None, model) if expected is None else expected
    wrist = reach(arm, around)
    limits = limits_of(arm, wrist.around, above, within)
    high = flange_pose(arm, wrist.joints)[1][:, 2] >= above
    wrist = Reach(wrist.arm, wrist.around, wrist.R_base_flange[high], wrist.joints[high])
    stops = plan(n, expected, model=model, reach=wrist)
    visited = np.vstack([wrist.around, np.asarray(stops.joints), wrist.around])
    motion, design = best_motion(arm, wrist.around, stops, limits, duration)
    of_noise = design.of_noise[0] * duration / motion.duration
    std = np.sqrt(of_noise), np.sqrt(of_noise + design.of_stops[0])
    return DynamicPlan(arm, stops, visited, _moves(arm, visited, limits), motion, limits, *std)


def _moves(arm: Arm, visited: Array, limits: Limits) -> Array:
    """How long each move between joints (m, k) takes (m - 1,), s, in whole 0.1 s. Raises `InputError` where one is too
    low.
    """
    step = np.diff(visited, axis=0)[:, None]
    along, slope, curvature = (each[:, None] * step for each in _least_jerk(np.linspace(0.0, 1.0, ON_A_MOVE)))
    joints = visited[:-1, None] + along
    flange = moving_flange(arm, *(each.reshape(-1, len(arm)) for each in (joints, slope, curvature)))
    lowest = float(flange.position[:, 2].min())
    if lowest < limits.above:
        raise InputError(
            f"the flange of {arm.name} is {lowest:.3g} m above the plane of its base between two stops, expected "
            f"{limits.above:g} m or more: start elsewhere (--around), or state --above"
        )
    return np.ceil(10.0 / (MOVE_PACE * pace(flange, slope, curvature, limits))) / 10.0


def _least_jerk(s: Array) -> tuple[Array, Array, Array]:
    return s**3 * (10.0 - 15.0 * s + 6.0 * s**2), 30.0 * (s * (1.0 - s)) ** 2, 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s)
