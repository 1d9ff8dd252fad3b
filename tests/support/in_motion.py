"""Recordings of the rig that stop at poses and then move fast, free of contact or pushed, and what is true of them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.spatial.transform import Rotation

import contactwrench as cw
from contactwrench.assess.robot_arms import flange_pose, known_arm
from contactwrench.samples.samples import OrientationStream, Streams, WrenchStream
from contactwrench.samples.synchronize import synchronize
from contactwrench.simulate.arm import JOINT_RANGE, MAX_SPEED
from contactwrench.simulate.kinematics import HOME
from contactwrench.simulate.recording import Recorded, record_motion
from contactwrench.simulate.settings import Settings, changed
from contactwrench.simulate.trajectory import Motion, Push, stopping
from tests.support.world import Array

TOOL = ("tool.mass=1", "tool.com=[0.01,-0.02,0.08]", "tool.inertia=[0.004,0.0004,-0.0006,0.0035,0.0003,0.0015]",
        "mounting.height=0.05", "sensor.bias=[3,-6,20,0.5,0.2,-0.1]", "sensor.noise.force=0.05",
        "sensor.noise.torque=0.002", "sensor.ranges=[700,700,700,30,30,30]")  # fmt: skip
SPEED, ACCELERATION = np.deg2rad(100.0), np.deg2rad(500.0)
"""rad/s and rad/s^2 of every joint, at most."""
SLOWEST, FASTEST, TONES = 0.1, 1.2, 8
"""Hz, between which the sines of a joint's motion lie, and how many there are."""
RAMP = 1.0
"""s, from rest to the full motion and back."""
STOP, MOVE = 1.5, 2.0
"""s."""


@dataclass(frozen=True, eq=False)
class Moving:
    """A recording, its `settings`, and from when on the arm moves without a stop, `begin` s."""

    recorded: Recorded
    begin: float

    @property
    def settings(self) -> Settings:
        """Of the rig: what is true."""
        return self.recorded.settings

    @property
    def offset(self) -> Array:
        """Where the sensor's origin is (3,), m from the flange's, flange axes."""
        return np.array([0.0, 0.0, self.settings.mounting.height])

    def samples(
        self,
        pose_rate: float | None = None,
        noise_deg: float = 0.0,
        noise_m: float = 0.0,
        delay: float = 0.0,
        joint_deg: float = 0.0,
    ) -> cw.Samples:
        """Readings, `delay` s late, and poses with each of them or at their own rate, Hz, as in `poses`."""
        rec = self.recorded
        if pose_rate is None and not delay:
            return rec.samples
        every = slice(None, None, 1 if pose_rate is None else round(rec.settings.recording.rate / pose_rate))
        R, position = self.poses(every, noise_deg, noise_m, joint_deg, np.random.default_rng(len(rec.t)))
        poses = OrientationStream(rec.t[every], R, position)
        return synchronize(Streams(WrenchStream(rec.t, rec.wrench), poses), delay).samples

    def poses(
        self, rows: slice, noise_deg: float, noise_m: float, joint_deg: float, rng: np.random.Generator
    ) -> tuple[Array, Array]:
        """With noise of these std an axis, `R_base_flange` (m, 3, 3) and position (m, 3); or of joint angles that have
        some, by the arm's kinematics.
        """
        rec = self.recorded
        R, position = rec.R_base_flange[rows], rec.position[rows]
        if joint_deg:
            joints = rec.joints[rows] + np.deg2rad(joint_deg) * rng.normal(size=(len(R), rec.joints.shape[1]))
            return flange_pose(known_arm("iiwa7"), joints)
        turn = Rotation.from_rotvec(np.deg2rad(noise_deg) * rng.normal(size=(len(R), 3))).as_matrix()
        return R @ turn, position + noise_m * rng.normal(size=position.shape)


def fast(seconds: float, rate: float, rng: np.random.Generator) -> Motion:
    """Random sines in every joint around home, from rest to rest, at up to `SPEED` and `ACCELERATION`."""
    t = np.arange(round(seconds * rate)) / rate
    frequency = 2.0 * np.pi * rng.uniform(SLOWEST, FASTEST, size=(TONES, 1, 7))
    phase = rng.uniform(0.0, 2.0 * np.pi, size=(TONES, 1, 7))
    amplitude = rng.uniform(0.3, 1.0, size=(TONES, 1, 7)) / frequency**1.5
    angle = frequency * t[:, None] + phase
    derivatives = [amplitude * np.sin(angle), amplitude * frequency * np.cos(angle)]
    q, v, a = (np.sum(each, axis=0) for each in (*derivatives, -amplitude * frequency**2 * np.sin(angle)))
    s = np.clip(np.minimum(t, t[-1] - t) / RAMP, 0.0, 1.0)[:, None]
    up = np.where(t < t[-1] / 2.0, 1.0, -1.0)[:, None] / RAMP
    w = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
    dw, ddw = 30.0 * s**2 * (1.0 - s) ** 2 * up, 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) * up**2
    q, v, a = w * q, dw * q + w * v, ddw * q + 2.0 * dw * v + w * a
    limits = (0.6 * (JOINT_RANGE - np.abs(HOME)), np.minimum(SPEED, MAX_SPEED), ACCELERATION)
    scale = np.min([limit / np.abs(each).max(axis=0) for limit, each in zip(limits, (q, v, a), strict=True)], axis=0)
    return Motion(t, HOME + scale * q, scale * v, scale * a)


def moving(
    seed: int,
    *assignments: str,
    stops: int = 12,
    seconds: float = 30.0,
    rate: float = 1000.0,
    pushes: tuple[Push, ...] = (),
) -> Moving:
    """`TOOL` on the rig, with `assignments`: so many stops, then fast motion, from whose begin `pushes` count."""
    rng = np.random.default_rng(seed)
    settings = changed(Settings(), [*TOOL, f"recording.rate={rate}", *assignments])
    reach = np.minimum(0.5 * (JOINT_RANGE - np.abs(HOME)), 0.45 * MAX_SPEED * MOVE / 1.875)
    goals = np.vstack([HOME + rng.uniform(-reach, reach, size=(stops, 7)), HOME]) if stops else HOME[None]
    parts = [stopping(goals, MOVE, STOP, rate), fast(seconds, rate, rng)]
    joined = [
        np.concatenate([getattr(part, name) for part in parts]) for name in ("joints", "velocity", "acceleration")
    ]
    begin = len(parts[0].t) / rate
    motion = Motion(np.arange(len(joined[0])) / rate, *joined)
    later = tuple(Push(begin + push.t_start, begin + push.t_end, push.force) for push in pushes)
    return Moving(record_motion(settings, motion, pushes=later, rng=rng), begin)


@lru_cache
def pushed() -> Moving:
    """Eight stops and 15 s of motion at 500 Hz, in which 5 N push for a second and a half."""
    return moving(5, stops=8, seconds=15.0, rate=500.0, pushes=(Push(4.0, 5.5, np.array([3.0, 0.0, 4.0])),))


@lru_cache
def at_stops() -> cw.Calibration:
    """Of the stops of `pushed`, with exact poses."""
    return cw.calibrate(pushed().samples())


@lru_cache
def calibrated(stated: bool = False) -> cw.Calibration:
    """Of `pushed`, at 100 poses a second with noise of 0.01 deg and 0.02 mm; where the sensor is, is stated or not."""
    samples = pushed().samples(100.0, 0.01, 2e-5)
    return cw.calibrate(samples, "dynamic", sensor_offset=pushed().offset if stated else None)
