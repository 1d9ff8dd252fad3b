"""Errors that a table of poses shows are no contact in free motion, and a clean table costs no sensitivity."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

import contactwrench as cw
from contactwrench.compensate.noise import between_poses
from tests.support.world import Array

RATE, SECONDS = 100.0, 60.0
ROW = np.repeat([0.03, 0.0012], 3)
"""Std of a sample, N and N m."""


class Field:
    """A smooth random function of orientation, of size one, that changes over `length` rad."""

    def __init__(self, rng: np.random.Generator, length: float, axes: int) -> None:
        self.wave = rng.normal(size=(9, 60)) / (np.sqrt(2.0) * length)
        self.phase, self.size = rng.uniform(0.0, 2.0 * np.pi, 60), rng.normal(size=(60, axes)) / np.sqrt(30.0)

    def __call__(self, R: Rotation) -> Array:
        values: Array = np.cos(R.as_matrix().reshape(-1, 9) @ self.wave + self.phase) @ self.size
        return values


@cache
def recorded(seed: int, rows: int, turned: float = 0.0, pulled: float = 0.0) -> tuple[cw.Calibration, Array, Array]:
    """A calibration from 12 poses, means of so many rows, and a minute of free motion: readings and orientations. The
    robot's orientations are off by `turned` deg an axis, a cable pulls with `pulled` N and 4 cm of that.
    """
    rng = np.random.default_rng(seed)
    weight, com = rng.uniform(8.0, 25.0), np.array([0.01, -0.015, 0.06]) + 0.01 * rng.normal(size=3)
    bias, mount = rng.normal(size=6) * np.repeat([8.0, 0.3], 3), Rotation.random(random_state=rng)
    of_robot, of_cable = Field(rng, 0.7, 3), Field(rng, 0.5, 6)

    def read(R: Rotation, averaged: int) -> Array:
        true = R * Rotation.from_rotvec(np.deg2rad(turned) * of_robot(R))
        force = (true * mount).inv().apply([0.0, 0.0, -weight])
        pull = pulled * of_cable(R) * np.repeat([1.0, 0.04], 3)
        noise = ROW / np.sqrt(averaged) * rng.normal(size=(len(force), 6))
        return np.asarray(np.hstack([force, np.cross(com, force)]) + bias + pull + noise)

    poses = Rotation.random(12, random_state=rng)
    calibration = cw.calibrate(cw.Samples(read(poses, rows), poses.as_matrix()), "mount")
    t = np.arange(SECONDS * RATE) / RATE
    leg, share = t // 4.0, np.clip((t % 4.0) / 3.0, 0.0, 1.0)
    way = Slerp(np.arange(17), Rotation.random(17, random_state=rng))(leg + 0.5 - 0.5 * np.cos(np.pi * share))
    return calibration, read(way, 1), way.as_matrix()


def compensator_of(calibration: cw.Calibration) -> cw.Compensator:
    """In the setting to begin with."""
    return cw.Compensator(calibration, rate=RATE, lowpass=20.0, drift=0.2)


def judged(calibration: cw.Calibration, wrench: Array, R: Array) -> tuple[int, float]:
    """Contacts, and the force (N) along an axis that is the threshold."""
    compensator = compensator_of(calibration)
    batch = compensator.run(wrench, R, np.arange(len(wrench)) / RATE)
    last = compensator.last_contact
    force = np.sqrt(batch.threshold) * np.mean(batch.std[:, :3], axis=1)
    return len(batch.contacts) + int(last is not None and last.release is None), float(np.nanmedian(force))


@pytest.mark.parametrize(
    ("error", "rows"), [({"turned": 0.1}, 1), ({"pulled": 0.05}, 1000), ({"turned": 0.1, "pulled": 0.04}, 1000)]
)
def test_what_the_table_shows_is_no_contact(error: dict[str, float], rows: int) -> None:
    found = [judged(*recorded(seed, rows, **error))[0] for seed in range(40, 43)]
    assert sum(contacts > 0 for contacts in found) == 0, found


@pytest.mark.parametrize("rows", [1, 1000])
def test_a_clean_table_costs_no_sensitivity(rows: int) -> None:
    """Six std of a sample behind the low-pass, and what 12 poses tell of the rest."""
    forces = [judged(*recorded(seed, rows))[1] for seed in range(40, 43)]
    assert np.median(forces) < 4.5 * ROW[0]


@pytest.mark.parametrize("rows", [1, 1000])
def test_a_push_of_twice_the_threshold_is_found(rows: int) -> None:
    """By a copy of what has followed the free motion so far, which goes on without it."""
    calibration, wrench, R = recorded(50, rows, turned=0.1, pulled=0.02)
    _, force = judged(calibration, wrench, R)
    free, t = compensator_of(calibration), np.arange(len(wrench)) / RATE
    for k, (before, start) in enumerate(pairwise((0, *range(1500, 5500, 500)))):
        free.run(wrench[before:start], R[before:start], t[before:start])
        direction = np.random.default_rng(k).normal(size=3)
        pushed, later = wrench[start : start + 60].copy(), slice(start, start + 60)
        pushed[:50, :3] += 2.0 * force * direction / np.linalg.norm(direction)
        assert (deepcopy(free).run(pushed, R[later], t[later]).contact == 1).any()


def test_poses_that_differ_as_samples_do_are_samples() -> None:
    """On forces and torques alike, as far as so few poses tell; else all that they differ by stays."""
    clean, _, _ = recorded(40, 1)
    assert clean.dof > 5.0
    row = clean.noise**2
    assert between_poses(clean, row) == pytest.approx(0.0)
    assert between_poses(clean, 1.2 * row) == pytest.approx(0.0)
    for shares in ([1.0, 1.0, 1.0, 0.1, 0.1, 0.1], [10.0, 10.0, 10.0, 1.0, 1.0, 1.0], [0.01] * 6):
        other = replace(clean, noise=np.sqrt(np.array(shares) * row))
        assert between_poses(other, row) == pytest.approx(other.noise**2)
    assert between_poses(clean, np.zeros(6)) == pytest.approx(row)
