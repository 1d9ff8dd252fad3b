"""The offset's filter against truths that are drawn: its covariance is that of its errors, whatever the arm did."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from scipy.stats import chi2

import contactwrench as cw
from contactwrench.compensate.bias_tracking import (
    HOUR,
    TYPICAL_DRIFT,
    CalibrationError,
    calibrated,
    predicted,
    updated,
    zeroed,
)
from tests.support.rigs import NOISE, example, noisy, seeds
from tests.support.world import Array, random_rotations

WALK = TYPICAL_DRIFT**2 / HOUR
BETWEEN = (0.5 * NOISE) ** 2


def _error(seed: int, model: str = "mount+base") -> tuple[cw.Calibration, CalibrationError, np.random.Generator]:
    rig, R, rng = example(seed)
    calibration = cw.calibrate(noisy(rig, R, rng), model, noise=NOISE)
    return calibration, CalibrationError(calibration, BETWEEN), rng


@pytest.mark.parametrize("model", ["yaw", "mount", "mount+base", "affine"])
def test_before_anything_is_learned_the_covariance_is_the_calibrations(model: str) -> None:
    calibration, error, rng = _error(1, model)
    R = random_rotations(5, rng)
    offset = calibrated(error, R[0], 0.0)
    for k in range(5):
        expected = calibration.wrench_covariance(R[k]) + np.diag(BETWEEN)
        moved = predicted(offset, error, WALK, R[k], 0.0)
        assert np.abs(moved.covariance - expected).max() < 1e-9 * np.abs(expected).max()
        offset = moved if k % 2 else offset


@settings(deadline=None, max_examples=20)
@given(seed=seeds)
def test_there_and_back_nothing_is_lost(seed: int) -> None:
    """What was learned at an orientation counts there again, if nothing was learned elsewhere."""
    calibration, _, rng = _error(seed)
    here, there = random_rotations(2, rng)
    no_between = CalibrationError(calibration, np.zeros(6))
    learned = updated(calibrated(no_between, here, 0.0), np.ones(6), NOISE**2 / 100)
    back = predicted(predicted(learned, no_between, WALK, there, 0.0), no_between, WALK, here, 0.0)
    assert np.abs(back.covariance - learned.covariance).max() < 1e-9 * NOISE[0] ** 2
    away = predicted(learned, no_between, WALK, there, 0.0)
    assert (np.diag(away.covariance) > np.diag(learned.covariance)).all()


def _life(error: CalibrationError, rng: np.random.Generator, H: list[Array], R: Array) -> tuple[Array, Array]:
    """A drawn truth, and a filter that follows it: errors (k, 6), covariances (k, 6, 6), along one life of the arm."""
    eta = rng.normal(size=H[0].shape[1])
    u, drift, variance = rng.normal(size=6) * np.sqrt(BETWEEN), np.zeros(6), NOISE**2 / 100.0
    offset, t, errors, covariances = calibrated(error, R[0], 0.0), 0.0, [], []
    for k in range(len(R)):
        if k:
            apart = np.linalg.norm(R[k] - R[k - 1])
            kept = np.exp(-2.0 * np.arcsin(apart / np.sqrt(8.0)) / 0.5)
            u = kept * u + np.sqrt((1.0 - kept**2) * BETWEEN) * rng.normal(size=6)
        passed = 20.0
        drift = drift + rng.normal(size=6) * np.sqrt(WALK * passed)
        t += passed
        truth = drift + H[k] @ eta + u
        offset = predicted(offset, error, WALK, R[k], t)
        errors.append(truth - offset.value)
        covariances.append(offset.covariance)
        if k % 3 != 2:
            for _ in range(3):
                offset = updated(offset, truth + rng.normal(size=6) * np.sqrt(variance), variance)
        errors.append(truth - offset.value)
        covariances.append(offset.covariance)
    return np.array(errors), np.array(covariances)


def test_the_covariance_is_that_of_the_errors() -> None:
    """Normalised squared errors of 150 lives, at every step: 6 on average, and as chi-square has it in the tail."""
    _, error, rng = _error(3)
    R = random_rotations(6, rng)[[0, 0, 1, 2, 1, 3, 4, 5]]
    H = [error.root(each) for each in R]
    lives = [_life(error, rng, H, R) for _ in range(150)]
    errors = np.array([life[0] for life in lives])
    for step in range(errors.shape[1]):
        S = lives[0][1][step]
        squared = np.einsum("ni,ij,nj->n", errors[:, step], np.linalg.inv(S), errors[:, step])
        assert squared.mean() == pytest.approx(6.0, abs=5.0 * np.sqrt(12.0 / 150)), step
        assert np.mean(squared > chi2.isf(0.05, 6)) < 0.14, step


def test_what_was_learned_in_one_pose_is_not_known_in_another() -> None:
    """After a turn the error is as large as the filter says then, and not as it was where it learned."""
    calibration, _, rng = _error(3)
    error = CalibrationError(calibration, np.zeros(6))
    here, there = random_rotations(2, rng)
    honest, learned_there = [], []
    for _ in range(200):
        eta = rng.normal(size=error.root(here).shape[1])
        offset = calibrated(error, here, 0.0)
        for _ in range(10):
            offset = updated(offset, error.root(here) @ eta + 0.1 * NOISE * rng.normal(size=6), 0.01 * NOISE**2)
        left = error.root(there) @ eta - offset.value
        honest.append(left @ np.linalg.solve(predicted(offset, error, WALK, there, 0.0).covariance, left))
        learned_there.append(left @ np.linalg.solve(offset.covariance, left))
    assert np.mean(honest) == pytest.approx(6.0, abs=5.0 * np.sqrt(12.0 / 200))
    assert np.mean(learned_there) > 30.0


def test_a_new_zero_counts_alone() -> None:
    _, error, rng = _error(4)
    R = random_rotations(2, rng)
    offset = zeroed(error, np.full(6, 3.0), NOISE**2 / 100, R[0], 5.0)
    assert offset.value == pytest.approx(np.full(6, 3.0))
    assert np.diag(offset.covariance) == pytest.approx(NOISE**2 / 100)
    elsewhere = predicted(offset, error, WALK, R[1], 5.0)
    change = error.root(R[1]) - error.root(R[0])
    kept = np.exp(-2.0 * np.arcsin(np.linalg.norm(R[1] - R[0]) / np.sqrt(8.0)) / 0.5)
    expected = NOISE**2 / 100 + np.diag(change @ change.T) + 2.0 * (1.0 - kept) * BETWEEN
    assert np.diag(elsewhere.covariance) == pytest.approx(expected)


def test_the_walk_adds_up_and_a_clock_that_goes_back_adds_nothing() -> None:
    _, error, rng = _error(5)
    R = random_rotations(1, rng)[0]
    offset = zeroed(error, np.zeros(6), np.zeros(6), R, 100.0)
    hour = predicted(offset, error, WALK, R, 100.0 + HOUR)
    assert np.sqrt(np.diag(hour.covariance)) == pytest.approx(TYPICAL_DRIFT)
    assert not predicted(offset, error, WALK, R, 0.0).covariance.any()
