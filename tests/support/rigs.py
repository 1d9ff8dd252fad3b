"""Tools, mountings and poses that the tests share; the readings come from world.py, not from the package."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st

import contactwrench as cw
from tests.support.world import Array, Rig, noisy_readings, random_rig, random_rotations, readings

NOISE = np.array([0.05, 0.05, 0.05, 0.002, 0.002, 0.002])
"""N and N m: a decent sensor."""

seeds = st.integers(min_value=0, max_value=2**32 - 1)


def rotation_angle(R_a: Array, R_b: Array) -> float:
    """The angle between two rotations, rad, exact for small ones too."""
    return float(2.0 * np.arcsin(min(1.0, np.linalg.norm(R_a - R_b) / np.sqrt(8.0))))


def noise_free(rig: Rig, R_base_flange: Array) -> cw.Samples:
    """Perfect readings."""
    return cw.Samples(wrench=readings(rig, R_base_flange), R_base_flange=R_base_flange)


def noisy(rig: Rig, R_base_flange: Array, rng: np.random.Generator, noise: Array = NOISE) -> cw.Samples:
    """Readings with noise."""
    return cw.Samples(wrench=noisy_readings(rig, R_base_flange, noise, rng), R_base_flange=R_base_flange)


def noise_of_a_design(runs: int, poses: int, rng: np.random.Generator, noise: Array = NOISE) -> Array:
    """Noise (runs, poses, 6) of which the mean over the runs is 0 and the covariance exactly that of `noise`: what an
    estimate scatters by shows in few runs (more than a run has readings), without the scatter of dice.
    """
    drawn = rng.normal(size=(runs, 6 * poses))
    assert runs > drawn.shape[1]
    whitened = np.sqrt(runs) * np.linalg.qr(drawn - drawn.mean(axis=0))[0]
    of_all: Array = noise * whitened.reshape(runs, poses, 6)
    return of_all


def samples_of_a_design(rig: Rig, R_base_flange: Array, runs: int, rng: np.random.Generator) -> list[cw.Samples]:
    """As many recordings of the same poses, with noise of a design."""
    free = readings(rig, R_base_flange)
    return [cw.Samples(free + off, R_base_flange) for off in noise_of_a_design(runs, len(R_base_flange), rng)]


def example(seed: int, poses: int = 24) -> tuple[Rig, Array, np.random.Generator]:
    """A random rig, random poses, and the generator that made them."""
    rng = np.random.default_rng(seed)
    return random_rig(rng), random_rotations(poses, rng), rng


def assert_same_tool(calibration: cw.Calibration, rig: Rig, tolerance: float = 1e-6) -> None:
    """Every parameter of a rigid calibration is the rig's, to `tolerance` in N, m, N m, rad."""
    assert calibration.weight is not None
    assert calibration.com is not None
    assert calibration.R_flange_sensor is not None
    assert abs(calibration.weight - rig.weight) < tolerance
    assert np.abs(calibration.com - rig.com).max() < tolerance
    assert np.abs(calibration.bias - rig.bias).max() < tolerance
    assert rotation_angle(calibration.R_flange_sensor, rig.R_flange_sensor) < tolerance
    assert np.linalg.norm(calibration.gravity_direction - rig.down) < tolerance
