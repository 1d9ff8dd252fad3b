"""Recordings of the rig: static poses with loads, or a motion, as a robot's controller and the sensor state them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..geometry.arrays import Array, read_only
from ..geometry.rotations import rotation_exp
from ..samples.samples import Samples
from .joint_torque import friction_torque, joint_torque_readings
from .pushes import Push, force_on_hook
from .rig import Physics, build, inverse_dynamics
from .sensor import SensorStream
from .settings import Settings
from .trajectory import Motion

SENSOR_RATE = 1000.0
"""Hz, while static poses are recorded: the M8125 over Ethernet."""
LEAD = 0.5
"""s: how long the arm is in motion already where a pose is read in motion; the sensor's filter has settled."""


@dataclass(frozen=True, eq=False)
class Recorded:
    """What a recording holds, n rows: `t` s; `wrench` (n, 6) the sensor's, and `saturated` (n, 6); `R_base_flange`
    (n, 3, 3) and `position` (n, 3) m as the robot states them; `joints` (n, 7) rad; `joint_torque` (n, 7) N m as its
    sensors read; `load_mass` (n,) kg on the hook; `pushes` on it. `settings` are the rig's.
    """

    settings: Settings
    t: Array
    wrench: Array
    saturated: NDArray[np.bool_]
    R_base_flange: Array
    position: Array
    joints: Array
    joint_torque: Array
    load_mass: Array
    pushes: tuple[Push, ...] = ()

    def __post_init__(self) -> None:
        for name in ("t", "wrench", "R_base_flange", "position", "joints", "joint_torque", "load_mass"):
            object.__setattr__(self, name, read_only(getattr(self, name)))

    @property
    def samples(self) -> Samples:
        """Readings and stated poses."""
        return Samples(self.wrench, self.R_base_flange, self.t, self.position, self.load_mass, "virtual rig")


def record_poses(
    settings: Settings, joints: Array, load_masses: tuple[float, ...] = (0.0,), *, rng: np.random.Generator
) -> Recorded:
    """A recording of static poses (m, 7), rad: all of them with the first load (kg), then with the next, and so on.

    Raises `MissingExtraError` without mujoco.
    """
    plan = settings.recording
    speed = plan.creep * rng.choice([-1.0, 1.0], size=joints.shape)
    return read_poses(settings, [true_poses(settings, joints, load, speed) for load in load_masses], load_masses, rng)


def true_poses(settings: Settings, joints: Array, load_mass: float, speed: Array) -> Physics:
    """The physics of every row that the sensor sees while static poses (m, 7), rad, are recorded, one row a pose where
    the arm is at rest. `speed` (m, 7), rad/s: of the joints while a pose is read; zero at rest.
    """
    rig = build(settings, load_mass)
    if not speed.any():
        return inverse_dynamics(rig, joints)
    t = _creeping(settings)
    moving = joints[:, None] + t[:, None] * speed[:, None]
    velocity = np.broadcast_to(speed[:, None], moving.shape)
    return inverse_dynamics(rig, moving.reshape(-1, 7), velocity.reshape(-1, 7))


def read_poses(
    settings: Settings, truth: list[Physics], load_masses: tuple[float, ...], rng: np.random.Generator
) -> Recorded:
    """What sensors and robot state of true poses, one `Physics` a load: the part of `record_poses` that is random."""
    plan = settings.recording
    moving = plan.creep > 0.0
    seen = len(_creeping(settings)) if moving else 1
    rows = plan.rows
    before = max(round(plan.settle * SENSOR_RATE), seen if moving else 1)
    poses = sum(len(one.wrench) for one in truth) // seen
    wrench, torque, joints, position, R = (
        np.concatenate([getattr(one, name) for one in truth]).reshape(poses, seen, -1)
        for name in ("wrench", "joint_torque", "joints", "position", "R_base_flange")
    )
    stream = SensorStream(settings.sensor, SENSOR_RATE, rng)
    readings = [stream.read(_in_time(wrench[pose], before, rows, moving)) for pose in range(poses)]
    velocity = (joints[:, -1] - joints[:, -2]) * SENSOR_RATE if moving else np.zeros((poses, 7))
    friction = np.repeat(friction_torque(settings.joint_torque, velocity, rng), rows, axis=0)

    def read(values: Array) -> Array:
        last = values[:, -rows:] if moving else np.repeat(values, rows, axis=1)
        return last.reshape(poses * rows, -1)

    error = np.deg2rad(plan.orientation_error_deg) * rng.normal(size=(poses, 3))
    stated = read(R).reshape(-1, 3, 3) @ np.repeat([rotation_exp(turn) for turn in error], rows, axis=0)
    first = before + (before + rows) * np.arange(poses)
    return Recorded(
        settings,
        (first[:, None] + np.arange(rows)).reshape(-1) / SENSOR_RATE,
        np.concatenate([one.wrench[-rows:] for one in readings]),
        np.concatenate([one.saturated[-rows:] for one in readings]),
        stated,
        read(position),
        read(joints),
        joint_torque_readings(settings.joint_torque, read(torque), friction, rng),
        np.repeat(load_masses, poses * rows // len(load_masses)),
    )


def _creeping(settings: Settings) -> Array:
    """Times (k,), s, of the rows that the sensor sees of a pose that is read in motion; 0 is the pose itself."""
    return np.arange(-round(LEAD * SENSOR_RATE), settings.recording.rows) / SENSOR_RATE


def _in_time(wrench: Array, before: int, rows: int, moving: bool) -> Array:
    """The wrenches (before + rows, 6) that the sensor feels from one pose to the next."""
    if not moving:
        return np.repeat(wrench, before + rows, axis=0)
    return np.concatenate([np.repeat(wrench[:1], before + rows - len(wrench), axis=0), wrench])


def record_motion(
    settings: Settings,
    motion: Motion,
    load_mass: float = 0.0,
    pushes: tuple[Push, ...] = (),
    *,
    rng: np.random.Generator,
) -> Recorded:
    """A recording along a motion that the arm follows exactly, row by row at the motion's own times, while `pushes`
    act on the tool's hook.
    """
    pushed = force_on_hook(pushes, motion.t) if pushes else None
    physics = inverse_dynamics(build(settings, load_mass), motion.joints, motion.velocity, motion.acceleration, pushed)
    readings = SensorStream(settings.sensor, settings.recording.rate, rng).read(physics.wrench)
    friction = friction_torque(settings.joint_torque, motion.velocity, rng)
    return Recorded(
        settings,
        motion.t,
        readings.wrench,
        readings.saturated,
        physics.R_base_flange,
        physics.position,
        motion.joints,
        joint_torque_readings(settings.joint_torque, physics.joint_torque, friction, rng),
        np.full(len(motion.t), load_mass),
        pushes,
    )
