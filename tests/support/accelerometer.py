"""An accelerometer on the tool of a recording in motion: what it would read, from where the rig says the flange was."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np
from scipy.spatial.transform import Rotation

import contactwrench as cw
from contactwrench.estimation.in_motion import with_motion
from contactwrench.samples.accelerometer import AccelerometerStream, with_accelerometer
from tests.support.in_motion import Moving, pushed
from tests.support.world import Array

GRAVITY = 9.80665
PLACE = np.array([0.03, -0.02, 0.01])
"""m, from the flange's origin, flange axes."""
RATE, LATE = 250.0, 0.006
"""Hz, and s behind the moments; the rig's sensor is 1 ms late, and its filter a little more."""
NOISE = 0.02
"""m/s^2."""


@dataclass(frozen=True)
class Mounted:
    """How one sits: `axes` (3, 3) of the flange's in its own, its unit for each m/s^2, what it reads of none, and its
    noise, m/s^2.
    """

    axes: Array = field(default_factory=lambda: Rotation.from_euler("xyz", [40.0, -70.0, 160.0], True).as_matrix())
    unit: float = 1.0 / GRAVITY
    zero: tuple[float, float, float] = (0.01, -0.02, 0.03)
    noise: float = NOISE


def accelerometer(of: Moving, mounted: Mounted, seed: int = 3, every: int | None = None) -> AccelerometerStream:
    """Its readings, at every so many samples: the second differences of its places, less gravity, in its own axes."""
    rec = of.recorded
    place = rec.position + rec.R_base_flange @ PLACE
    acceleration = np.gradient(np.gradient(place, rec.t, axis=0), rec.t, axis=0)
    down = np.asarray(of.settings.gravity_direction)
    specific_force = np.einsum("nji,nj->ni", rec.R_base_flange, acceleration - GRAVITY * down)
    some = slice(None, None, every or round(of.settings.recording.rate / RATE))
    felt = specific_force[some] + mounted.noise * np.random.default_rng(seed).normal(size=specific_force[some].shape)
    reading = mounted.unit * felt @ mounted.axes.T + np.array(mounted.zero)
    return AccelerometerStream(rec.t[some] + LATE, reading, "imu.csv")


@lru_cache
def without_positions() -> cw.Samples:
    """The readings of `pushed`, with orientations and no positions."""
    samples = pushed().samples()
    return cw.Samples(samples.wrench, samples.R_base_flange, samples.t, source="run.csv")


def with_readings(mounted: Mounted) -> cw.Samples:
    """Those samples, and what an accelerometer read."""
    return with_accelerometer(without_positions(), accelerometer(pushed(), mounted))


@lru_cache
def _of_stops() -> cw.Calibration:
    return cw.calibrate(without_positions())


def calibrated_with(samples: cw.Samples) -> cw.Calibration:
    """What `cw.calibrate` makes of samples that differ from `without_positions` in their accelerometer alone, to the
    last bit: of the stops, which are the same, once, and of the motion.
    """
    stops = _of_stops()
    return with_motion(stops, replace(samples, delay=stops.delay, delay_std=stops.delay_std), None)


@lru_cache
def calibrated_by_accelerometer() -> cw.Calibration:
    """From them."""
    return cw.calibrate(with_readings(Mounted()), "dynamic")
