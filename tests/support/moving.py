"""Moving recordings where the delay is known: of the virtual rig, and of a tool that feels gravity alone."""

from __future__ import annotations

import numpy as np

from contactwrench.samples.samples import OrientationStream, Streams, WrenchStream
from contactwrench.simulate.recording import Recorded, record_motion
from contactwrench.simulate.settings import Settings, changed
from contactwrench.simulate.trajectory import exciting, sweeping
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
