"""Runs of the virtual rig with stops, and what truly happened: what tests and benchmarks of still stretches share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

import contactwrench as cw
from contactwrench.simulate.arm import JOINT_RANGE, MAX_SPEED
from contactwrench.simulate.kinematics import HOME
from contactwrench.simulate.rig import Physics, build, inverse_dynamics
from contactwrench.simulate.sensor import SensorStream
from contactwrench.simulate.settings import Settings, changed
from contactwrench.simulate.trajectory import Motion, stopping
from tests.support.world import Array

TOOL = ("tool.mass=1", "tool.com=[0.01,-0.02,0.08]", "sensor.noise.force=0.05", "sensor.noise.torque=0.002",
        "sensor.ranges=[700,700,700,30,30,30]")  # fmt: skip


MOST_OF_SPEED = 0.95
"""The fastest joint's, half-way between the postures that lie furthest apart."""


@dataclass(frozen=True, eq=False)
class Run:
    """What was recorded, `samples`; from when to when the arm stood, `stops` (k, 2) s; what the sensor reads there but
    for noise and drift, `wrench` (k, 6) N and N m; the rig's `settings`.
    """

    samples: cw.Samples
    stops: Array
    wrench: Array
    settings: Settings


def run(
    stops: int = 12,
    stop: float = 2.0,
    move: float = 1.5,
    rate: float = 1000.0,
    settings: tuple[str, ...] = (),
    seed: int = 0,
    orientation_noise_deg: float = 0.0,
    disturb: Callable[[Array, Array], Array] | None = None,
) -> Run:
    """The rig goes through `stops` random postures around home; the sensor reads at 1 kHz or `rate`, whichever is more,
    and rows are kept at `rate`. `disturb` gives from times (n,), s, and true wrenches (n, 6) those with a contact.
    """
    rng = np.random.default_rng(seed)
    setup = changed(Settings(), [*TOOL, *settings])
    inner = max(rate, 1000.0)
    reach = np.minimum(0.5 * (JOINT_RANGE - np.abs(HOME)), MOST_OF_SPEED * MAX_SPEED * move / 3.75)
    postures = rng.uniform(-reach, reach, size=(stops, len(HOME)))
    of_rig = tuple(setting for setting in settings if not setting.startswith("sensor."))
    motion, physics = _driven(postures.tobytes(), stop, move, inner, of_rig)
    wrench = physics.wrench if disturb is None else disturb(motion.t, physics.wrench)
    readings = SensorStream(setup.sensor, inner, rng).read(wrench).wrench
    every = slice(None, None, round(inner / rate))
    R = physics.R_base_flange[every]
    if orientation_noise_deg:
        from scipy.spatial.transform import Rotation

        R = R @ Rotation.from_rotvec(np.deg2rad(orientation_noise_deg) * rng.normal(size=(len(R), 3))).as_matrix()
    begin = np.arange(stops) * (move + stop)
    middle = np.searchsorted(motion.t, begin + 0.5 * stop)
    true = physics.wrench[middle] + np.array(setup.sensor.bias)
    samples = cw.Samples(readings[every], R, motion.t[every], source="run")
    return Run(samples, np.stack([begin, begin + stop], axis=1), true, setup)


@lru_cache(maxsize=4)
def _driven(
    postures: bytes, stop: float, move: float, rate: float, settings: tuple[str, ...]
) -> tuple[Motion, Physics]:
    """The motion through postures (k, 7), rad from home, and its physics: the same whatever sensor reads it."""
    motion = stopping(HOME + np.frombuffer(postures).reshape(-1, len(HOME)), move, stop, rate)
    rig = build(changed(Settings(), [*TOOL, *settings]))
    return motion, inverse_dynamics(rig, motion.joints, motion.velocity, motion.acceleration)
