"""Moving recordings where the delay is known: of the virtual rig, and of a tool that feels gravity alone."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from contactwrench.assess.robot_arms import flange_pose, known_arm
from contactwrench.errors import InputError
from contactwrench.samples.samples import OrientationStream, Streams, WrenchStream
from contactwrench.simulate.arm import MAX_SPEED
from contactwrench.simulate.kinematics import HOME, joints_for
from contactwrench.simulate.recording import Recorded, record_motion
from contactwrench.simulate.rig import build
from contactwrench.simulate.settings import Settings, changed
from contactwrench.simulate.trajectory import Motion, exciting, sweeping
from tests.support.world import Array

NOISE = np.array([0.05, 0.05, 0.05, 0.002, 0.002, 0.002])
"""N and N m."""


def rig_recording(kind: str, duration: float, seed: int, *assignments: str) -> Recorded:
    """The rig at 1 kHz along an `exciting` or a `sweeping` motion, its wrench 4 ms late and unfiltered; `assignments`
    change its settings.
    """
    settings = changed(Settings(), ["sensor.low_pass=0", "sensor.delay=0.004", *assignments])
    rng = np.random.default_rng(seed)
    motion = exciting(duration, 1000.0, rng) if kind == "exciting" else sweeping(duration, 1000.0)
    return record_motion(settings, motion, rng=rng)


def two_streams(rec: Recorded, every_wrench: int = 1, every_pose: int = 10, position: bool = True) -> Streams:
    """Its streams, thinned, and never at the same times."""
    pose = slice(3 if every_pose > 3 else 0, None, every_pose)
    return Streams(
        WrenchStream(rec.t[::every_wrench], rec.wrench[::every_wrench]),
        OrientationStream(rec.t[pose], rec.R_base_flange[pose], rec.position[pose] if position else None),
    )


def whole_arm(kind: str, duration: float, seed: int) -> Recorded:
    """The rig at 1 kHz, its wrench on time and unfiltered, with any tool of 0.3 to 3 kg: `vertical` and `tilted` pick
    and place, a `hand` that guides it, trembling at 6 to 10 Hz.
    """
    rng = np.random.default_rng(seed)
    mass, com = np.exp(rng.uniform(np.log(0.3), np.log(3.0))), [*rng.uniform(-0.03, 0.03, 2), rng.uniform(0.02, 0.12)]
    tool = [f"tool.mass={mass}", f"tool.com=[{','.join(map(str, com))}]", "sensor.bias=0", "sensor.overload=2"]
    settings = changed(Settings(), ["sensor.low_pass=0", "sensor.delay=0", *tool])
    goals, trembling = (guided(rng), 2e-4) if kind == "hand" else (picked(rng, 30.0 * (kind == "tilted")), 0.0)
    return record_motion(settings, least_jerk(goals, duration, trembling, rng), rng=rng)


Goals = Iterator[tuple[Array, float, float]]
"""Joints (7,), the least time to get there, and the time from its end to the next move's begin, s."""


def picked(rng: np.random.Generator, tilt: float) -> Goals:
    """Over one of two boxes, down, up, and to the other one, the tool within `tilt` deg of the vertical."""
    from scipy.spatial.transform import Rotation

    rig, joints, side = build(Settings()), HOME, 1.0
    while True:
        turn = Rotation.from_euler("zxy", [rng.uniform(-60.0, 60.0), *rng.uniform(-tilt, tilt, 2)], degrees=True)
        R = (turn * Rotation.from_euler("x", 180.0, degrees=True)).as_matrix()
        x, y = rng.uniform(0.4, 0.6), side * rng.uniform(0.15, 0.35)
        try:
            over = joints_for(rig, R, np.array([x, y, 0.4]), joints)
            down = joints_for(rig, R, np.array([x, y, 0.27]), over)
        except InputError:
            continue
        if max(np.abs(over - joints).max(), 2.0 * np.abs(down - over).max()) < 2.5:
            yield over, rng.uniform(0.9, 1.4), 0.0
            yield down, rng.uniform(0.35, 0.6), rng.uniform(0.2, 0.6)
            yield over, rng.uniform(0.35, 0.6), 0.0
            joints, side = over, -side


def guided(rng: np.random.Generator) -> Goals:
    """Anywhere around home, each move begun before the last one has ended, with a rest now and then."""
    while True:
        goal = HOME + np.array([0.6, 0.4, 0.5, 0.5, 0.8, 0.7, 1.0]) * rng.uniform(-1.0, 1.0, 7)
        least = rng.uniform(0.5, 2.2)
        yield goal, least, rng.uniform(0.2, 1.0) if rng.random() < 0.2 else -0.5 * least * rng.random()


def least_jerk(goals: Goals, duration: float, trembling: float, rng: np.random.Generator) -> Motion:
    """From home to each of the goals in a move of the least jerk (Flash and Hogan 1985); moves that overlap add up.
    Meanwhile each joint trembles by sines of so many rad.
    """
    t = np.arange(round(1000.0 * duration)) / 1000.0
    q, v, a = np.tile(HOME, (len(t), 1)), np.zeros((len(t), 7)), np.zeros((len(t), 7))
    begin, joints = 0.3, HOME
    for goal, least, pause in goals:
        time = max(least, 3.2 * float(np.abs((goal - joints) / MAX_SPEED).max()))
        if begin + time > duration:
            break
        first, last = np.searchsorted(t, (begin, begin + time))
        s, on_way, there = ((t[first:last] - begin) / time)[:, None], slice(first, last), slice(last, None)
        q[on_way] += s**3 * (10.0 - 15.0 * s + 6.0 * s**2) * (goal - joints)
        q[there] += goal - joints
        v[on_way] += 30.0 * s**2 * (1.0 - s) ** 2 * (goal - joints) / time
        a[on_way] += 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) * (goal - joints) / time**2
        begin, joints = begin + time + pause, goal
    for _ in range(3):
        speed, size = 2.0 * np.pi * rng.uniform(6.0, 10.0, 7), trembling * rng.normal(size=7)
        phase = speed * t[:, None] + rng.uniform(0.0, 2.0 * np.pi, 7)
        q, v, a = q + size * np.sin(phase), v + size * speed * np.cos(phase), a - size * speed**2 * np.sin(phase)
    return Motion(t, q, v, a)


def with_joints(rec: Recorded, delay: float, rng: np.random.Generator, jitter: float = 3e-4) -> Streams:
    """Its streams, the pose from joints at 100 Hz, 2e-5 rad off as encoders are, whose stamps jitter by so many s."""
    rows = slice(3, None, 10)
    joints = rec.joints[rows] + 2e-5 * rng.normal(size=rec.joints[rows].shape)
    stamps = rec.t[rows] + jitter * rng.normal(size=len(joints))
    pose = OrientationStream(stamps, *flange_pose(known_arm("iiwa7"), joints))
    return Streams(WrenchStream(rec.t + delay, rec.wrench), pose)


def bound_of(rec: Recorded, every_wrench: int) -> float:
    """The least std, s, of any unbiased estimate of the delay, gravity's coefficients and the bias free, in white noise
    (Cramer and Rao), from the true tool, motion and noise.
    """
    tool, R = rec.settings.tool, rec.R_base_flange
    u = np.einsum("nij,i->nj", R, rec.settings.gravity_direction)
    weight = tool.mass * rec.settings.gravity
    in_sensor = u @ rec.settings.R_flange_sensor
    wrench = np.concatenate([weight * in_sensor, np.cross(tool.com, weight * in_sensor)], axis=1)
    slope = np.gradient(wrench, rec.t, axis=0)
    known = np.column_stack([np.ones(len(u)), u])
    slope = slope - known @ np.linalg.lstsq(known, slope, rcond=None)[0]
    noise = np.array([*rec.settings.sensor.noise.force, *rec.settings.sensor.noise.torque])
    return float(1.0 / np.sqrt(np.sum((slope[::every_wrench] / noise) ** 2)))


def smooth_rotations(t: Array, rng: np.random.Generator, fastest: float = 0.6, angle: float = 0.8) -> Array:
    """Rotations (n, 3, 3) at t (n,), sines up to `fastest` Hz about all axes, from anywhere."""
    from scipy.spatial.transform import Rotation

    vector = np.zeros((len(t), 3))
    for _ in range(6):
        phase = 2.0 * np.pi * rng.uniform(0.1, fastest) * t[:, None] + rng.uniform(0.0, 2.0 * np.pi, 3)
        vector += 0.5 * angle * rng.normal(size=3) * np.sin(phase)
    R: Array = (Rotation.from_rotvec(vector) * Rotation.random(random_state=int(rng.integers(2**31)))).as_matrix()
    return R


def gravity_alone(
    seed: int,
    delay: float = 0.0137,
    duration: float = 30.0,
    rate: float = 100.0,
    noise: float = 1.0,
    correlated_over: float = 0.0,
    fastest: float = 0.6,
) -> Streams:
    """A tool of 5 N with any centre and mounting on a flange that turns on the spot, both streams at `rate` Hz; noise
    of `NOISE` times `noise`, white, or of the first order with a correlation time in s.
    """
    from scipy.signal import lfilter
    from scipy.spatial.transform import Rotation

    rng = np.random.default_rng(seed)
    t = np.arange(0.0, duration, 1.0 / rate)
    R = smooth_rotations(t, rng, fastest)
    mounting = Rotation.random(random_state=int(rng.integers(2**31))).as_matrix()
    force = -5.0 * R[:, 2] @ mounting
    wrench = np.concatenate([force, np.cross(rng.normal(scale=0.05, size=3), force)], axis=1) + rng.normal(size=6)
    keep = np.exp(-1.0 / (rate * correlated_over)) if correlated_over else 0.0
    before = round(5.0 * correlated_over * rate)
    white = rng.normal(size=(len(t) + before, 6)) * np.sqrt(1.0 - keep**2)
    wrench += noise * NOISE * lfilter([1.0], [1.0, -keep], white, axis=0)[before:]
    return Streams(WrenchStream(t + delay, wrench), OrientationStream(t, R, np.zeros((len(t), 3))))
