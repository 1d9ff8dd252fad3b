"""The virtual rig against the clock: the arm with all its sensors, and a recording of six static poses."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from contactwrench.simulate.kinematics import paper_joints
from contactwrench.simulate.recording import Recorded, record_motion, record_poses
from contactwrench.simulate.rig import build, inverse_dynamics
from contactwrench.simulate.sensor import SensorStream, friction_torque, joint_torque_readings
from contactwrench.simulate.settings import Drift, Sensor, Settings
from contactwrench.simulate.trajectory import exciting

from .clock import median_seconds
from .table import Row

RATE = 1000.0
SECONDS = 60.0


def in_motion(seconds: float) -> Iterator[Row]:
    """Physics and every sensor along an exciting motion, the bias walking; this is one thread's work."""
    settings = Settings(sensor=Sensor(drift=Drift(walk=(0.1, 0.1, 0.1, 0.01, 0.01, 0.01))))
    rig, motion = build(settings), exciting(seconds, RATE, np.random.default_rng(1))
    physics = inverse_dynamics(rig, motion.joints, motion.velocity, motion.acceleration)

    def arm() -> object:
        return inverse_dynamics(rig, motion.joints, motion.velocity, motion.acceleration)

    def wrist() -> object:
        return SensorStream(settings.sensor, RATE, np.random.default_rng(2)).read(physics.wrench)

    def in_joints() -> object:
        rng = np.random.default_rng(3)
        friction = friction_torque(settings.joint_torque, motion.velocity, rng)
        return joint_torque_readings(settings.joint_torque, physics.joint_torque, friction, rng)

    def row_by_row() -> None:
        stream = SensorStream(settings.sensor, RATE, np.random.default_rng(2))
        for row in range(1000):
            stream.read(physics.wrench[row : row + 1])

    durations = {
        "physics": median_seconds(arm, 3),
        "wrist sensor": median_seconds(wrist, 3),
        "joint sensors": median_seconds(in_joints, 3),
    }
    total = sum(durations.values())
    shares = ", ".join(f"{name} {100.0 * part / total:.0f} %" for name, part in durations.items())
    yield Row("arm with all sensors, 1 kHz", seconds / total, "x real time", least=50.0, remark=shares)
    yield Row("wrist sensor alone, a row at a time", 1.0 / median_seconds(row_by_row, 3), "x real time")


def recordings() -> Iterator[Row]:
    """From settings to a recording, once warm, and the whole command."""
    settings = Settings()

    def six_poses() -> Recorded:
        return record_poses(settings, paper_joints(build(settings)), rng=np.random.default_rng(4))

    def a_motion() -> Recorded:
        motion = exciting(20.0, RATE, np.random.default_rng(5))
        return record_motion(settings, motion, rng=np.random.default_rng(6))

    yield Row("six static poses", median_seconds(six_poses, 5), "s", most=1.0)
    yield Row("20 s of an exciting motion", median_seconds(a_motion, 3), "s")
    with tempfile.TemporaryDirectory() as folder:
        out = str(Path(folder) / "six.csv")
        start = time.perf_counter()
        subprocess.run([sys.executable, "-m", "contactwrench", "simulate", "-o", out], capture_output=True, check=True)
        yield Row("contactwrench simulate, six static poses", time.perf_counter() - start, "s")


def tables(quick: bool) -> Iterator[tuple[str, Iterable[Row]]]:
    """Every table of the rig."""
    yield "The virtual rig in motion", in_motion(SECONDS / 10.0 if quick else SECONDS)
    yield "Recordings of the virtual rig", recordings()
