"""The noise of a pose is not the scatter of its samples: standard deviations that hold on repeated rows too."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import contactwrench as cw
from tests.support.rigs import NOISE, example, noisy
from tests.support.world import Array, Rig, readings


def _repeated(rig: Rig, R: Array, between: Array, scatter: Array, rows: int, rng: np.random.Generator) -> cw.Samples:
    """`rows` rows a pose: an error that the pose's rows share, and one of each row."""
    pose = readings(rig, R) + between * rng.normal(size=(len(R), 6))
    wrench = np.repeat(pose, rows, axis=0) + scatter * rng.normal(size=(len(R) * rows, 6))
    return cw.Samples(wrench, np.repeat(R, rows, axis=0))


def test_a_thousand_rows_a_pose_with_pose_errors_are_no_surer_than_one() -> None:
    rig, R, rng = example(1)
    many = cw.calibrate(_repeated(rig, R, NOISE, 0.3 * NOISE, 1000, rng), "mount")
    one = cw.calibrate(_repeated(rig, R, NOISE, 0.0 * NOISE, 1, rng), "mount")
    assert many.std["weight"] == pytest.approx(one.std["weight"], rel=0.4)
    assert many.std["bias"] == pytest.approx(one.std["bias"], rel=0.8)
    assert len(many.poses) == 24
    assert many.reduced_chi2 > 1000.0


@pytest.mark.slow
def test_errors_have_the_stated_size_on_repeated_rows() -> None:
    rig, R, rng = example(2, poses=14)
    z = []
    for _ in range(12):
        calibration = cw.calibrate(_repeated(rig, R, NOISE, 2.0 * NOISE, 8, rng), "mount")
        error = np.r_[calibration.weight, calibration.com, calibration.bias] - np.r_[rig.weight, rig.com, rig.bias]
        z.append(error / np.sqrt(np.diag(calibration.covariance)[:10]))
    assert np.mean(np.square(z)) == pytest.approx(1.0, abs=0.35)  # of 12 runs: a quarter of 24


@pytest.mark.slow
def test_without_pose_errors_rows_average_out() -> None:
    """The variance of a mean is known to a quarter or so: of many recordings chi-square is one."""
    chi2: dict[int, list[float]] = {4: [], 400: []}
    for seed in range(6):
        rig, R, rng = example(seed)
        few, many = (cw.calibrate(_repeated(rig, R, 0.0 * NOISE, NOISE, n, rng), "mount") for n in chi2)
        assert few.std["weight"] / many.std["weight"] == pytest.approx(10.0, rel=0.4)
        chi2[4].append(few.reduced_chi2)
        chi2[400].append(many.reduced_chi2)
    assert np.mean(chi2[4]) == pytest.approx(1.0, abs=0.25)
    assert np.mean(chi2[400]) == pytest.approx(1.0, abs=0.15)
    assert max(*chi2[4], *chi2[400]) < 2.0


@pytest.mark.slow
@pytest.mark.parametrize(("poses", "runs"), [(8, 20), (24, 12)])
def test_estimated_noise_has_no_bias(poses: int, runs: int) -> None:
    """Of a run and an axis its variance scatters by 60 %, with 24 poses by 30 %: of the mean by 13 % and 9 %."""
    rig, R, rng = example(4, poses)
    variances = [cw.calibrate(noisy(rig, R, rng), "mount").noise ** 2 for _ in range(runs)]
    assert np.mean(variances, axis=0) / NOISE**2 == pytest.approx(np.ones(6), abs=0.35)


@pytest.mark.slow
def test_a_noisy_axis_does_not_hide_in_its_group() -> None:
    rig, R, rng = example(5)
    uneven = NOISE * np.array([1.0, 1.0, 20.0, 1.0, 1.0, 1.0])
    found = np.mean([cw.calibrate(noisy(rig, R, rng, uneven), "mount").noise for _ in range(5)], axis=0)
    assert found[2] == pytest.approx(uneven[2], rel=0.25)
    assert found[:2] == pytest.approx(uneven[:2], rel=0.5)


def test_a_quiet_axis_is_weighted_as_such() -> None:
    """The weight follows from fx and fy alone where fz is drowned in noise."""
    rig, R, rng = example(6)
    uneven = NOISE * np.array([1.0, 1.0, 400.0, 1.0, 1.0, 1.0])
    calibration = cw.calibrate(noisy(rig, R, rng, uneven), "mount")
    assert calibration.weight == pytest.approx(rig.weight, abs=0.3)


def test_covariance_is_not_below_what_the_residuals_support() -> None:
    """Given a noise of almost nothing, the std grows with the misfit: that of noise, and of 2 % of cross-talk, which a
    gain of each axis explains, and which is in the error to expect at any orientation.
    """
    rig, R, rng = example(7)
    noisy_only = cw.calibrate(noisy(rig, R, rng), "mount", noise=1e-4 * NOISE)
    assert noisy_only.reduced_chi2 == pytest.approx(1e8, rel=0.5)
    assert noisy_only.noise == pytest.approx(1e-4 * NOISE * np.sqrt(noisy_only.reduced_chi2), rel=0.02)
    wrench = readings(rig, R) @ (np.eye(6) + 0.02 * rng.normal(size=(6, 6))).T
    calibration = cw.calibrate(cw.Samples(wrench, R), "mount", noise=1e-4 * NOISE)
    assert calibration.reduced_chi2 > 1e4
    assert calibration.weight == pytest.approx(rig.weight, abs=3.0 * calibration.std["weight"])
    assert calibration.std["weight"] > 1e-3 * rig.weight
    assert calibration.expected_error[0] > 0.9 * np.linalg.norm(calibration.residual_rms[:3])


def test_degrees_of_freedom() -> None:
    rig, R, rng = example(8)
    rig = replace(rig, R_flange_sensor=Rotation.from_euler("z", 0.7).as_matrix())
    samples = noisy(rig, R, rng)
    assert cw.calibrate(samples, "mount", noise=NOISE).dof == pytest.approx(6 * 24 - 13, rel=0.02)
    assert cw.calibrate(samples, "yaw", noise=NOISE).dof == pytest.approx(6 * 24 - 11, rel=0.02)
    assert 10.0 < cw.calibrate(samples, "mount").dof < 6 * 24 - 13
    six = cw.calibrate(noisy(rig, R[:6], rng), "mount")
    assert six.dof < 23.0
    assert six.t_quantile(0.95) > 2.06


def test_noise_free_data_give_a_calibration_without_noise() -> None:
    rig, R, _ = example(9)
    for rows in (1, 5):
        calibration = cw.calibrate(cw.Samples(np.repeat(readings(rig, R), rows, 0), np.repeat(R, rows, 0)), "mount")
        assert calibration.noise.max() < 1e-6
        assert np.all(np.isfinite(calibration.covariance))


@pytest.mark.parametrize("model", ["paper", "yaw", "mount", "mount+base", "affine"])
def test_an_axis_that_reads_nothing_or_coarsely_is_no_trouble(model: str) -> None:
    """Quantised readings, and a tz so stiff that it shows one value: a scatter of deficient rank."""
    rig, R, rng = example(10)
    rig = replace(rig, R_flange_sensor=np.array([[0.6, -0.8, 0.0], [0.8, 0.6, 0.0], [0.0, 0.0, 1.0]]))
    samples = _repeated(rig, R, NOISE, NOISE, 6, rng)
    wrench = np.round(samples.wrench, 1)
    wrench[:, 5] = 0.2
    calibration = cw.calibrate(cw.Samples(wrench, samples.R_base_flange), model)
    assert np.all(np.isfinite(calibration.covariance))
    assert np.all(np.diag(calibration.covariance) >= 0.0)
