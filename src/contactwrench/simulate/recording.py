"""Recordings of the rig: static poses with loads, or a motion, as a robot's controller and the sensor state them.

As files: the standard input CSV, and beside it what was true.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from ..files import write_text
from ..geometry.arrays import Array, Frozen
from ..geometry.orientation import to_quat_xyzw
from ..geometry.ranges import ROWS
from ..geometry.rotations import rotation_exp
from ..geometry.wrench import WRENCH_AXES
from ..samples.samples import Samples
from .rig import Physics, build, inverse_dynamics
from .sensor import SensorStream, friction_torque, joint_torque_readings
from .settings import Settings
from .trajectory import Motion, Push, force_on_hook, shaking

SENSOR_RATE = 1000.0
"""Hz, while static poses are recorded: the M8125 over Ethernet."""
LEAD = 0.5
"""s: how long the arm is in motion already where a pose is read in motion; the sensor's filter has settled."""


@dataclass(frozen=True, eq=False)
class Recorded(Frozen):
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

    @property
    def samples(self) -> Samples:
        """Readings and stated poses."""
        return Samples(self.wrench, self.R_base_flange, self.t, self.position, self.load_mass, "virtual rig")


def record_poses(
    settings: Settings, joints: Array, load_masses: tuple[float, ...] = (0.0,), *, rng: np.random.Generator
) -> Recorded:
    """A recording of static poses (m, 7), rad: all of them with the first load on the hook, kg, then with the next, and
    so on. Raises `MissingExtraError` without mujoco.
    """
    rows = settings.recording.rows + settings.recording.settle * SENSOR_RATE
    ROWS.require(len(joints) * len(load_masses) * rows, "number of rows, settling included,")
    speed = settings.recording.creep * rng.choice([-1.0, 1.0], size=joints.shape)
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
    plan, rows = settings.recording, settings.recording.rows
    seen = len(_creeping(settings)) if plan.creep > 0.0 else 1
    before = max(round(plan.settle * SENSOR_RATE), seen)
    poses = sum(len(physics.wrench) for physics in truth) // seen

    def moments(name: str) -> Array:
        """Of each pose what the sensor sees (poses, k, d): where the arm is at rest, again and again."""
        values = np.concatenate([getattr(physics, name) for physics in truth]).reshape(poses, seen, -1)
        return np.repeat(values, max(rows, 2), axis=1) if seen == 1 else values

    def read(values: Array) -> Array:
        return values[:, -rows:].reshape(poses * rows, -1)

    wrench, joints = moments("wrench"), moments("joints")
    to_come = before + rows - wrench.shape[1]
    stream = SensorStream(settings.sensor, SENSOR_RATE, rng)
    readings = [stream.read(np.concatenate([np.repeat(pose[:1], to_come, axis=0), pose])) for pose in wrench]
    velocity = (joints[:, -1] - joints[:, -2]) * SENSOR_RATE
    friction = np.repeat(friction_torque(settings.joint_torque, velocity, rng), rows, axis=0)
    error = np.deg2rad(plan.orientation_error_deg) * rng.normal(size=(poses, 3))
    R = read(moments("R_base_flange")).reshape(-1, 3, 3)
    stated = R @ np.repeat([rotation_exp(turn) for turn in error], rows, axis=0)
    first = before + (before + rows) * np.arange(poses)
    return Recorded(
        settings,
        (first[:, None] + np.arange(rows)).reshape(-1) / SENSOR_RATE,
        np.concatenate([of_pose.wrench[-rows:] for of_pose in readings]),
        np.concatenate([of_pose.saturated[-rows:] for of_pose in readings]),
        stated,
        read(moments("position")),
        read(joints),
        joint_torque_readings(settings.joint_torque, read(moments("joint_torque")), friction, rng),
        np.repeat(load_masses, poses * rows // len(load_masses)),
    )


def _creeping(settings: Settings) -> Array:
    """Times (k,), s, of the rows that the sensor sees of a pose that is read in motion; 0 is the pose itself."""
    return np.arange(-round(LEAD * SENSOR_RATE), settings.recording.rows) / SENSOR_RATE


def record_motion(
    settings: Settings,
    motion: Motion,
    load_mass: float = 0.0,
    pushes: tuple[Push, ...] = (),
    *,
    rng: np.random.Generator,
) -> Recorded:
    """A recording along a motion that the arm follows exactly, row by row at the motion's own times, whose rate is that
    of the settings, with `load_mass` kg on the hook and the `pushes` on it. Raises `MissingExtraError` without mujoco.
    """
    pushed = force_on_hook(pushes, motion.t) if pushes else None
    rig = build(settings, load_mass)
    moving = motion.joints, motion.velocity, motion.acceleration
    physics = inverse_dynamics(rig, *moving, pushed, shaking(rig, motion, rng))
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


COLUMNS = (
    *("t", *WRENCH_AXES, "qx", "qy", "qz", "qw", "x", "y", "z", "load_g"),
    *(f"q{k}" for k in range(1, 8)),
    *(f"tau{k}" for k in range(1, 8)),
    "saturated",
)
"""s; N and N m; the flange's orientation and position (m) in base axes; g; joints, rad; joint torques, N m; 1 where a
channel of the sensor stands at its limit."""
FORMAT = ",".join(["%.6f"] * 7 + ["%.12f"] * 4 + ["%.9f"] * 3 + ["%g"] + ["%.9f"] * 7 + ["%.6f"] * 7 + ["%d"]) + "\n"
TRUTH_SCHEMA = "contactwrench/truth/1"


def truth_path(path: Path) -> Path:
    """`OUT.truth.json` beside `OUT.csv`."""
    return path.with_suffix(".truth.json")


def write_truth(path: Path, recorded: Recorded, command: dict[str, object]) -> None:
    """Write what was true beside the recording at `path`, under the names of a calibration file, with the settings and
    the `command` that asked for it.

    `bias` is the setting; where it drifts, `settings.sensor.drift` says how. `saturated` counts rows a channel;
    `inertia` is the tool's, kg m^2, about its centre of mass, sensor axes; `sensor_offset` of the sensor's origin from
    the flange, m, flange axes; `pushes` are forces on the tool's hook, N, base axes. Raises `FileAccessError`.
    """
    settings, tool = recorded.settings, recorded.settings.tool
    values = {
        "schema": TRUTH_SCHEMA,
        "weight": tool.mass * settings.gravity,
        "mass": tool.mass,
        "com": tool.com,
        "inertia": settings.inertia.tolist(),
        "sensor_offset": (0.0, 0.0, settings.mounting.height),
        "bias": settings.sensor.bias,
        "R_flange_sensor": settings.R_flange_sensor.tolist(),
        "gravity_direction": (settings.gravity_direction + 0.0).tolist(),
        "saturated": dict(zip(WRENCH_AXES, recorded.saturated.sum(axis=0).tolist(), strict=True)),
        "pushes": [vars(push) | {"force": push.force.tolist()} for push in recorded.pushes],
        "command": command,
        "settings": msgspec.to_builtins(settings),
    }
    write_text(truth_path(path), msgspec.json.format(msgspec.json.encode(values), indent=2).decode() + "\n")


def csv_lines(recorded: Recorded) -> Iterator[str]:
    """The standard input CSV: same recording, same bytes."""
    quat_xyzw = to_quat_xyzw(recorded.R_base_flange, canonical=True)
    pose = [recorded.t, recorded.wrench, quat_xyzw, recorded.position, 1000.0 * recorded.load_mass]
    at_joints = [recorded.joints, recorded.joint_torque]
    table: Array = np.column_stack([*pose, *at_joints, recorded.saturated.any(axis=1)])
    yield ",".join(COLUMNS) + "\n"
    for row in (table + 0.0).tolist():
        yield FORMAT % tuple(row)
