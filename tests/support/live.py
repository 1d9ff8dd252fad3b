"""Calibrations, motions and readings for the Compensator's tests; the physics are tests/support/world.py's."""

from __future__ import annotations

from functools import cache

import numpy as np
from scipy.spatial.transform import Rotation

import contactwrench as cw
from tests.support.rigs import NOISE, example, noise_free, noisy
from tests.support.world import Array, Rig, noisy_readings

RATE = 1000.0


def calibrated(seed: int, exact: bool = False) -> tuple[cw.Calibration, Rig, np.random.Generator]:
    """A calibration of any tool on any mounting, from 24 noisy (or `exact`) readings; what is true; what drew it."""
    calibration, rig = _calibration(seed, exact)
    return calibration, rig, np.random.default_rng((seed, 1))


@cache
def _calibration(seed: int, exact: bool) -> tuple[cw.Calibration, Rig]:
    rig, R, rng = example(seed)
    samples = noise_free(rig, R) if exact else noisy(rig, R, rng)
    return cw.calibrate(samples, "mount", noise=NOISE), rig


def still(rng: np.random.Generator, n: int) -> Array:
    """One orientation (n, 3, 3)."""
    return np.tile(Rotation.random(random_state=rng).as_matrix(), (n, 1, 1))


def swinging(rng: np.random.Generator, n: int, speed: float = 0.5) -> Array:
    """Orientations (n, 3, 3) at `RATE` of an arm that swings to and fro, at up to `speed` rad/s."""
    axis, t = rng.normal(size=3), np.arange(n) / RATE
    swing = np.sin(2.0 * t)[:, None] * axis / np.linalg.norm(axis) * speed / 2.0
    matrices: Array = (Rotation.random(random_state=rng) * Rotation.from_rotvec(swing)).as_matrix()
    return matrices


def free(rig: Rig, R: Array, rng: np.random.Generator, noise: float = 1.0) -> Array:
    """What a free tool reads (n, 6), with `noise` times the usual noise."""
    return noisy_readings(rig, R, noise * NOISE, rng)


def times(n: int, rate: float = RATE) -> Array:
    """Stamps (n,) from 100 s on."""
    return 100.0 + np.arange(n) / rate
