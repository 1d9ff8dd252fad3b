"""The offset's filter against truths that are drawn: its covariance is that of its errors, whatever the arm did."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from scipy.stats import chi2

import contactwrench as cw
from contactwrench.compensate.bias_tracking import HOUR, TYPICAL_DRIFT, learn, predict, start, track
from contactwrench.compensate.state import State
from tests.support.rigs import NOISE, example, noisy, seeds
from tests.support.world import Array, random_rotations

WALK = TYPICAL_DRIFT**2 / HOUR
BETWEEN = (0.5 * NOISE) ** 2


def _tracking(
    seed: int, model: str = "mount+base", between: Array = BETWEEN
) -> tuple[cw.Calibration, State, np.random.Generator]:
    """A calibration, and what follows the offset that it leaves from time 0 on."""
    rig, R, rng = example(seed)
    calibration = cw.calibrate(noisy(rig, R, rng), model, noise=NOISE)
    return calibration, _begun(calibration, between), rng


def _begun(calibration: cw.Calibration, between: Array = BETWEEN) -> State:
    s = State()
    track(s, calibration, between)
    s.quantum, s.noise_variance = [1e-3] * 6, [1.0] * 6  # of readings that nothing rounds
    s.walk, s.offset_time = WALK.tolist(), 0.0
    return s


def _predicted(s: State, R: Array, t: float) -> Array:
    """The covariance (6, 6) at another orientation and time."""
    predict(s, R.ravel().tolist(), t)
    return np.array(s.systematic)


def _learn(s: State, R: Array, t: float, mean: Array, variance: Array) -> None:
    learn(s, R.ravel().tolist(), t, mean.tolist(), variance.tolist())


def _root(calibration: cw.Calibration, R: Array) -> Array:
    """H (6, q) at an orientation, any one with `H H^T` the covariance and derivatives of one sign."""
    values, vectors = np.linalg.eigh(calibration.covariance)
    H: Array = calibration.free_wrench_jacobian(R[None])[0] @ (vectors * np.sqrt(np.maximum(values, 0.0)))
    return H


@pytest.mark.parametrize("model", ["yaw", "mount", "mount+base", "affine"])
def test_before_anything_is_learned_the_covariance_is_the_calibrations(model: str) -> None:
    """Also where means that say nothing are learned on the way."""
    calibration, s, rng = _tracking(1, model)
    R = random_rotations(5, rng)
    for k in range(5):
        expected = calibration.wrench_covariance(R[k]) + np.diag(BETWEEN)
        assert np.abs(_predicted(s, R[k], 0.0) - expected).max() < 1e-9 * np.abs(expected).max()
        if k % 2:
            _learn(s, R[k], 0.0, np.zeros(6), np.full(6, 1e12))


@pytest.mark.slow
@settings(deadline=None, max_examples=10)
@given(seed=seeds)
def test_there_and_back_nothing_is_lost(seed: int) -> None:
    """What was learned at an orientation counts there again, if nothing was learned elsewhere."""
    _, s, rng = _tracking(seed, between=np.zeros(6))
    here, there = random_rotations(2, rng)
    _learn(s, here, 0.0, np.ones(6), NOISE**2 / 100)
    learned = _predicted(s, here, 0.0)
    away, back = _predicted(s, there, 0.0), _predicted(s, here, 0.0)
    assert np.abs(back - learned).max() < 1e-9 * NOISE[0] ** 2
    assert (np.diag(away) > np.diag(learned)).all()


def _life(s: State, rng: np.random.Generator, H: list[Array], R: Array) -> tuple[Array, Array]:
    """A drawn truth, and a filter that follows it: errors (k, 6), covariances (k, 6, 6), along one life of the arm."""
    eta = rng.normal(size=H[0].shape[1])
    u, drift, variance = rng.normal(size=6) * np.sqrt(BETWEEN), np.zeros(6), NOISE**2 / 100.0
    t, errors, covariances = 0.0, [], []
    for k in range(len(R)):
        if k:
            apart = np.linalg.norm(R[k] - R[k - 1])
            kept = np.exp(-2.0 * np.arcsin(apart / np.sqrt(8.0)) / 0.5)
            u = kept * u + np.sqrt((1.0 - kept**2) * BETWEEN) * rng.normal(size=6)
        passed = 20.0
        drift = drift + rng.normal(size=6) * np.sqrt(WALK * passed)
        t += passed
        truth = drift + H[k] @ eta + u
        covariances.append(_predicted(s, R[k], t))
        errors.append(truth - s.offset)
        if k % 3 != 2:
            for _ in range(3):
                _learn(s, R[k], t, truth + rng.normal(size=6) * np.sqrt(variance), variance)
        covariances.append(_predicted(s, R[k], t))
        errors.append(truth - s.offset)
    return np.array(errors), np.array(covariances)


@pytest.mark.slow
def test_the_covariance_is_that_of_the_errors() -> None:
    """Normalised squared errors of 150 lives, at every step: 6 on average, and as chi-square has it in the tail."""
    calibration, _, rng = _tracking(3)
    R = random_rotations(6, rng)[[0, 0, 1, 2, 1, 3, 4, 5]]
    H = [_root(calibration, each) for each in R]
    lives = [_life(_begun(calibration), rng, H, R) for _ in range(150)]
    errors = np.array([life[0] for life in lives])
    for step in range(errors.shape[1]):
        S = lives[0][1][step]
        squared = np.einsum("ni,ij,nj->n", errors[:, step], np.linalg.inv(S), errors[:, step])
        assert squared.mean() == pytest.approx(6.0, abs=5.0 * np.sqrt(12.0 / 150)), step
        assert np.mean(squared > chi2.isf(0.05, 6)) < 0.14, step


@pytest.mark.slow
def test_what_was_learned_in_one_pose_is_not_known_in_another() -> None:
    """After a turn the error is as large as the filter says then, and not as it was where it learned."""
    calibration, _, rng = _tracking(3)
    here, there = random_rotations(2, rng)
    H_here, H_there = _root(calibration, here), _root(calibration, there)
    honest, learned_there = [], []
    for _ in range(200):
        eta = rng.normal(size=H_here.shape[1])
        s = _begun(calibration, np.zeros(6))
        for _ in range(10):
            _learn(s, here, 0.0, H_here @ eta + 0.1 * NOISE * rng.normal(size=6), 0.01 * NOISE**2)
        left = H_there @ eta - s.offset
        honest.append(left @ np.linalg.solve(_predicted(s, there, 0.0), left))
        learned_there.append(left @ np.linalg.solve(_predicted(s, here, 0.0), left))
    assert np.mean(honest) == pytest.approx(6.0, abs=5.0 * np.sqrt(12.0 / 200))
    assert np.mean(learned_there) > 30.0


def _zeroed(s: State, mean: Array, variance: Array, R: Array, t: float) -> None:
    start(s, mean, np.diag(variance), np.zeros((6, s.parameters)), np.zeros(6), R, t)


def test_a_new_zero_counts_alone() -> None:
    calibration, s, rng = _tracking(4)
    R = random_rotations(2, rng)
    _zeroed(s, np.full(6, 3.0), NOISE**2 / 100, R[0], 5.0)
    assert s.offset == pytest.approx(np.full(6, 3.0))
    assert np.diag(_predicted(s, R[0], 5.0)) == pytest.approx(NOISE**2 / 100)
    change = _root(calibration, R[1]) - _root(calibration, R[0])
    kept = np.exp(-2.0 * np.arcsin(np.linalg.norm(R[1] - R[0]) / np.sqrt(8.0)) / 0.5)
    expected = NOISE**2 / 100 + np.diag(change @ change.T) + 2.0 * (1.0 - kept) * BETWEEN
    assert np.diag(_predicted(s, R[1], 5.0)) == pytest.approx(expected)


def test_the_walk_adds_up_and_a_clock_that_goes_back_adds_nothing() -> None:
    _, s, rng = _tracking(5)
    R = random_rotations(1, rng)[0]
    _zeroed(s, np.zeros(6), np.zeros(6), R, 100.0)
    assert np.sqrt(np.diag(_predicted(s, R, 100.0 + HOUR))) == pytest.approx(TYPICAL_DRIFT)
    assert not _predicted(s, R, 0.0).any()
