"""The affine fit: any linear sensor is reproduced, and its covariance is that of ordinary least squares."""

from __future__ import annotations

import numpy as np
import pytest

import contactwrench as cw
from tests.support.rigs import NOISE, example, noisy
from tests.support.world import DOWN, noisy_readings, random_rotations, readings


def test_any_linear_sensor_is_reproduced() -> None:
    rng = np.random.default_rng(1)
    B, R = rng.normal(size=(6, 4)), random_rotations(12, rng)
    wrench = np.column_stack([np.einsum("nji,j->ni", R, DOWN), np.ones(12)]) @ B.T
    calibration = cw.calibrate(cw.Samples(wrench, R), "affine")
    assert np.abs(calibration.B - B).max() < 1e-10
    assert calibration.bias == pytest.approx(B[:, 3], abs=1e-10)
    assert calibration.parameters == pytest.approx(B.ravel(), abs=1e-10)


def test_it_has_no_tool_and_no_mounting() -> None:
    rig, R, rng = example(2)
    calibration = cw.calibrate(noisy(rig, R, rng), "affine")
    for name in ("weight", "mass", "com", "R_flange_sensor", "yaw"):
        assert getattr(calibration, name) is None
    for name in ("weight", "com", "yaw", "mount", "gravity"):
        assert calibration.std[name] is None
    assert calibration.std["bias"].shape == (6,)
    assert "affine" in str(calibration)


def test_covariance_is_that_of_ordinary_least_squares() -> None:
    rig, R, rng = example(3, poses=30)
    calibration = cw.calibrate(noisy(rig, R, rng), "affine", noise=NOISE)
    A = np.column_stack([-R[:, 2], np.ones(30)])
    inverse = np.linalg.inv(A.T @ A)
    for axis in range(6):
        rows = slice(4 * axis, 4 * axis + 4)
        assert calibration.covariance[rows, rows] == pytest.approx(calibration.noise[axis] ** 2 * inverse, rel=1e-6)
    assert calibration.B_covariance == pytest.approx(calibration.covariance)
    assert calibration.noise == pytest.approx(NOISE, rel=0.3)
    assert calibration.dof == 6 * 30 - 24


def test_cross_talk_shows_as_a_residual_that_affine_does_not_have() -> None:
    rig, R, rng = example(4)
    talk = np.eye(6) + 0.03 * rng.normal(size=(6, 6))
    wrench = readings(rig, R) @ talk.T + 0.1 * NOISE * rng.normal(size=(24, 6))
    rigid, affine = (cw.calibrate(cw.Samples(wrench, R), model) for model in ("mount", "affine"))
    assert np.linalg.norm(affine.residual_rms[:3]) < 0.1 * np.linalg.norm(rigid.residual_rms[:3])


@pytest.mark.slow
def test_predictions_are_as_sure_as_they_are_good() -> None:
    rig, R, rng = example(5)
    unseen = random_rotations(40, rng)
    squared = []
    for _ in range(60):
        calibration = cw.calibrate(cw.Samples(noisy_readings(rig, R, NOISE, rng), R), "affine")
        error = calibration.predict(unseen) - readings(rig, unseen)
        squared.append((error / calibration.wrench_std(unseen)) ** 2)
    assert np.mean(squared) == pytest.approx(1.0, abs=0.2)


def test_three_poses_cannot_do() -> None:
    rig, R, rng = example(6, poses=3)
    with pytest.raises(cw.ContactWrenchError):
        cw.calibrate(noisy(rig, R, rng), "affine", noise=NOISE)
