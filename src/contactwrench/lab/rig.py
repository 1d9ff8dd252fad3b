"""The rig as time passes: it goes where it is told, hands push its tool, and a soft workpiece pushes back.

All is a function of time and of what was told: a device may ask for the rows of any moment up to now, at its own rate.
A push acts on a rigid body that MuJoCo moves, so it adds its force and its torque about the sensor to MuJoCo's wrench.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import inf
from operator import attrgetter
from threading import Lock
from time import monotonic
from typing import Any, Literal, TypeAlias

import numpy as np

from ..assess.robot_arms import known_arm, within_limits
from ..errors import InputError
from ..geometry.arrays import Array, Frozen
from ..geometry.orientation import rotation_matrices, to_quat_xyzw
from ..geometry.ranges import PLACE
from ..simulate.arm import MAX_SPEED
from ..simulate.kinematics import HOME, joints_for
from ..simulate.rig import JOINTS, Rig, build, inverse_dynamics
from ..simulate.sensor import SensorStream
from ..simulate.settings import Settings
from ..simulate.trajectory import MOVE_SPEED, PEAK, RISE, share_of_push
from .truth import FlangePose

Axes: TypeAlias = Literal["sensor", "flange", "base"]
Point: TypeAlias = Literal["hook", "axis"]

SOON = 0.15
"""s from an order to the first motion: the move is worked out meanwhile, and nobody has asked for that time yet."""
KNOT = 0.002
"""s between the moments that MuJoCo computes; between them all is taken for linear: 1e-6 rad of the flange."""
SHORTEST, TURNING_ROUND = 0.4, 1.6
"""s: of a move over no distance; and of the shortest that begins on the way elsewhere: the arm must not stop hard."""
REMEMBERED = 60.0
"""s: how far back a device may ask."""
FORCE = 1000.0
"""N: the largest push."""
WORKPIECE, STIFFNESS = 0.05, 2000.0
"""m above the base: its surface, which no planned pose reaches; and N/m: 10 N at 5 mm."""


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

    def pose(self, t: float) -> FlangePose:
        """Where the flange and the joints are at a moment."""
        quat_xyzw, position, joints = (
            self.at(values, np.array([t])) for values in (self.quat_xyzw, self.position, self.joints)
        )
        return FlangePose(_matrices(quat_xyzw)[0], quat_xyzw[0], position[0], joints[0])

    @cached_property
    def rest(self) -> FlangePose:
        """Where the arm rests then."""
        return self.pose(self.end)


def planned_move(rig: Rig, state: Array, joints: Array, start: float, speed: float) -> Move:
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


@dataclass(frozen=True, eq=False)
class Truth(Frozen):
    """What a calibration of the rig should find, under a calibration's names."""

    weight: float
    mass: float
    com: Array
    bias: Array
    R_flange_sensor: Array
    gravity_direction: Array


@dataclass
class _Push:
    force: Array
    frame: Axes
    point: Array
    start: float
    end: float


class Sensor:
    """The lab's truth as one device sees it: a sensor of its own, with its own noise, filter and bias in motion."""

    def __init__(self, lab: Lab, seed: int) -> None:
        self._lab, self._rng = lab, np.random.default_rng(seed)
        self._rate, self._stream = 0.0, SensorStream(lab.settings.sensor, 1.0, self._rng)
        self._stream.read(np.zeros((1, 6)))  # imports what it needs now: a device must not be late for it
        self.pose_at, self.true_contact = lab.pose_at, lab.true_contact

    def wrench_rows(self, t0: float, n: int, rate: float) -> Array:
        """Readings (n, 6) at `t0 + k / rate`."""
        if rate != self._rate:
            self._rate, self._stream = rate, SensorStream(self._lab.settings.sensor, rate, self._rng)
        return self._stream.read(self._lab.true_wrench(t0 + np.arange(n) / rate)).wrench


class Lab:
    """The virtual lab; it begins at rest at `HOME`. It is a `Truth`; a second device takes `sensor()`. `seed` is that
    of the sensors' noise; `speed` that of a move, of the largest of the joint that has furthest to go, 0 to 1. Raises
    `MissingExtraError`: mujoco is not installed.
    """

    def __init__(self, settings: Settings | None = None, seed: int = 0, speed: float = MOVE_SPEED) -> None:
        if not 0.0 < speed <= 1.0:
            raise InputError(f"speed is {speed:g}, expected more than 0 and at most 1: it is a share of the largest")
        self.settings = Settings() if settings is None else settings
        self._rig, self._speed, self._orders = build(self.settings), speed, Lock()
        resting = np.stack([HOME, np.zeros(JOINTS), np.zeros(JOINTS)])
        self._moves = [planned_move(self._rig, resting, HOME, monotonic() - REMEMBERED, speed)]
        self._pushes: list[_Push] = []
        self._R_flange_sensor = self.settings.R_flange_sensor
        self._hook = np.array(self.settings.tool.hook)
        self._hook_flange = self._R_flange_sensor @ self._hook + [0.0, 0.0, self.settings.mounting.height]
        self._seed = seed
        self.wrench_rows = self.sensor().wrench_rows

    def sensor(self) -> Sensor:
        """The lab as one more device sees it."""
        self._seed += 1
        return Sensor(self, self._seed)

    @property
    def truth(self) -> Truth:
        """What is true of the rig."""
        rig, tool = self.settings, self.settings.tool
        com, bias = np.array(tool.com), np.array(rig.sensor.bias)
        return Truth(tool.mass * rig.gravity, tool.mass, com, bias, rig.R_flange_sensor, rig.gravity_direction)

    def move_to(self, target: Array | Sequence[float], position: Sequence[float] | None = None) -> float:
        """Begin to move to joints (7,), rad, or `R_base_flange` (3, 3), from wherever the arm is on its way; returns
        how many seconds it will take. `position` (3,), m, base axes, is the flange's at an orientation; None: wherever
        it is nearest to home. Raises `InputError` for another shape, and what is out of reach.
        """
        with self._orders:
            joints = self._joints(np.asarray(target, dtype=np.float64), position)
            start = max(monotonic() + SOON, self._moves[-1].start)
            ahead = planned_move(self._rig, self.move_at(start).state(start), joints, start, self._speed)
            kept = max(bisect_right(self._moves, start - REMEMBERED, key=attrgetter("start")) - 1, 0)
            self._moves = [*self._moves[kept:], ahead]
        return ahead.end - monotonic()

    def _joints(self, target: Array, position: Sequence[float] | None) -> Array:
        if target.shape == (3, 3):
            R = rotation_matrices(target)[0][0]
            if position is None:
                return joints_for(self._rig, R, None, HOME)
            return joints_for(self._rig, R, PLACE.require(position, "position", (3,)), self.joints_now())
        return within_limits(known_arm("iiwa7"), target)

    @property
    def moving(self) -> bool:
        """Whether the arm is on its way, from the moment it was told."""
        return monotonic() < self._moves[-1].end

    def joints_now(self) -> Array:
        """Joints (7,), rad."""
        return self.pose_at(monotonic()).joints

    def push(
        self, force: Sequence[float] | Array, frame: Axes = "sensor", duration: float | None = None, at: Point = "hook"
    ) -> None:
        """Push the tool with a force (3,), N, in axes with which it turns, from now on for a `duration` above 0, s, or
        until `release`; pushes add up. It acts on the tool's hook, or on the point of the sensor's axis beside it,
        about which a push down turns nothing. Raises `InputError` for what nobody pushes with, or for no time.
        """
        newton, now = np.array(force, dtype=np.float64), monotonic()
        if newton.shape != (3,) or not np.all(np.abs(newton) <= FORCE):
            raise InputError(f"found a push of {force}, expected three numbers of at most {FORCE:g} N")
        if frame not in ("sensor", "flange", "base") or at not in ("hook", "axis"):
            raise InputError(f"found a push in {frame} axes at {at}, expected sensor, flange or base, and hook or axis")
        if duration is not None and not duration > 0.0:
            raise InputError(f"found a push for {duration} s, expected a time above 0")
        point = self._hook if at == "hook" else self._hook * (0.0, 0.0, 1.0)
        end = inf if duration is None else now + duration
        with self._orders:
            kept = [each for each in self._pushes if each.end > now - REMEMBERED]
            self._pushes = [*kept, _Push(newton, frame, point, now, end)]

    def release(self) -> None:
        """Take every hand away."""
        end = monotonic() + RISE
        for push in self._pushes:
            push.end = min(push.end, end)

    def move_at(self, t: float) -> Move:
        """The move that the arm is in at a moment, or rests after."""
        moves = self._moves
        return moves[max(bisect_right(moves, t, key=attrgetter("start")) - 1, 0)]

    def pose_at(self, t: float) -> FlangePose:
        """Where the flange and the joints are, or were, at a moment."""
        move = self.move_at(t)
        return move.pose(t) if t < move.end else move.rest

    def true_wrench(self, t: Array) -> Array:
        """What tool and environment exert on the sensor (n, 6), N and N m, sensor axes, at times (n,) that rise."""
        move = self.move_at(t[0])
        if move is not self.move_at(t[-1]):
            return np.concatenate([self.true_wrench(t[k : k + 1]) for k in range(len(t))])
        return move.at(move.wrench, t) + self._contact(t)

    def true_contact(self, t: float) -> Array:
        """What the environment exerts on the sensor (6,), N and N m, sensor axes, at a moment."""
        return np.asarray(self._contact(np.array([t]))[0])

    def _contact(self, t: Array) -> Array:
        R_base_flange, position = self._flange(t)
        total = self._workpiece(R_base_flange, position)
        for push in [each for each in self._pushes if t[-1] > each.start and t[0] < each.end]:
            force = share_of_push(t, push.start, push.end)[:, None] * push.force
            if push.frame == "base":
                force = np.einsum("nij,ni->nj", R_base_flange @ self._R_flange_sensor, force)
            elif push.frame == "flange":
                force = force @ self._R_flange_sensor
            total = total + np.hstack([force, np.cross(push.point, force)])
        return total

    def _workpiece(self, R_base_flange: Array, position: Array) -> Array:
        """The push (n, 6) of a soft surface parallel to the base's, where the hook is in it."""
        depth = WORKPIECE - position[:, 2] - R_base_flange[:, 2] @ self._hook_flange
        if depth.max() <= 0.0:
            return np.zeros((len(position), 6))
        force = (STIFFNESS * np.maximum(depth, 0.0))[:, None] * (R_base_flange[:, 2] @ self._R_flange_sensor)
        return np.hstack([force, np.cross(self._hook, force)])

    def _flange(self, t: Array) -> tuple[Array, Array]:
        """`R_base_flange` (n, 3, 3) and position (n, 3), all of one move."""
        move = self.move_at(t[0])
        if move.end <= t[0]:
            pose = move.rest
            return np.broadcast_to(pose.R_base_flange, (len(t), 3, 3)), np.broadcast_to(pose.position, (len(t), 3))
        return _matrices(move.at(move.quat_xyzw, t)), move.at(move.position, t)


def _matrices(quat_xyzw: Array) -> Array:
    """Rotation matrices (n, 3, 3) of quaternions (n, 4) of about unit length; scipy's cost more than all the rest."""
    x, y, z, w = quat_xyzw.T * np.sqrt(2.0 / (quat_xyzw**2).sum(axis=1))
    R = [1 - y * y - z * z, x * y - z * w, x * z + y * w, x * y + z * w, 1 - x * x - z * z]
    R += [y * z - x * w, x * z - y * w, y * z + x * w, 1 - x * x - y * y]
    return np.stack(R, axis=1).reshape(-1, 3, 3)
