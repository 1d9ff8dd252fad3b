"""The paper's estimator against what the paper's printed data give (docs: the reproduction record)."""

from __future__ import annotations

from importlib import import_module
from importlib.resources import files

import numpy as np
import pytest

import contactwrench as cw
from contactwrench.estimation.initial_guess import SEARCH_OF_MODEL, initial_guesses
from contactwrench.estimation.paper import tool_of_unknowns, torque_regressor
from tests.support.poses import SIX_SPREAD
from tests.support.rigs import assert_same_tool, example, noise_free, noisy, samples_of_a_design
from tests.support.world import DOWN, Array, Rig, random_rotations, readings

SIX_POSES = str(files("contactwrench") / "data" / "paper_six_poses.csv")


@pytest.fixture(scope="module")
def samples() -> cw.Samples:
    return cw.read(SIX_POSES)


@pytest.fixture(scope="module")
def calibration(samples: cw.Samples) -> cw.Calibration:
    return cw.calibrate(samples, "paper")


def _yaw_mounting(yaw: float) -> Array:
    return np.array([[np.cos(yaw), -np.sin(yaw), 0.0], [np.sin(yaw), np.cos(yaw), 0.0], [0.0, 0.0, 1.0]])


def test_yaw_and_its_std(calibration: cw.Calibration) -> None:
    assert calibration.yaw is not None
    assert np.rad2deg(calibration.yaw) == pytest.approx(46.02, abs=0.005)
    assert np.rad2deg(calibration.std["yaw"]) == pytest.approx(0.43, abs=0.005)


def test_the_two_weights_disagree_and_the_second_is_hardly_known(calibration: cw.Calibration) -> None:
    assert calibration.weight_xy == pytest.approx(4.699, abs=5e-4)
    assert calibration.weight_z == pytest.approx(17.7, abs=0.05)
    assert calibration.weight == calibration.weight_z
    assert calibration.std["weight"] == pytest.approx(10.2, abs=0.05)


def test_centre_of_mass_and_force_bias(calibration: cw.Calibration) -> None:
    assert calibration.com == pytest.approx([-0.0043, 0.0041, 0.0374], abs=5e-5)
    assert calibration.bias[:2] == pytest.approx([4.282, -6.580], abs=5e-4)
    assert calibration.bias[2] == pytest.approx(40.5, abs=0.05)


def test_torque_bias_gives_back_l_by_equation_4(calibration: cw.Calibration) -> None:
    assert calibration.com is not None
    px, py, pz = calibration.com
    fx, fy, fz, tx, ty, tz = calibration.bias
    l = [tx + fy * pz - fz * py, ty + fz * px - fx * pz, tz + fx * py - fy * px]  # noqa: E741
    assert l == pytest.approx([1.7426, 0.5607, 0.0058], abs=5e-5)


def test_condition_numbers_of_the_two_regressions(calibration: cw.Calibration, samples: cw.Samples) -> None:
    assert calibration.observability.condition == pytest.approx(46, abs=0.5)
    torque = torque_regressor(samples.wrench[:, :3]).reshape(-1, 6)
    assert np.linalg.cond(torque) == pytest.approx(3013, abs=1.0)


@pytest.mark.parametrize(("poses", "rank"), [(1, 3), (2, 5), (3, 6)])
def test_rank_of_the_torque_regressor(samples: cw.Samples, poses: int, rank: int) -> None:
    assert np.linalg.matrix_rank(torque_regressor(samples.wrench[:poses, :3]).reshape(-1, 6)) == rank


def test_trade_off_of_weight_and_force_bias_is_said(calibration: cw.Calibration) -> None:
    (warning,) = (text for text in calibration.warnings if text.startswith("weak: ") and "weight 17.7" in text)
    assert "over 10 %" in warning
    assert "weight and bias_fz" in warning
    assert any("one more pose, with gravity along the sensor's" in text for text in calibration.warnings)


def test_equation_16_inside_table_5() -> None:
    G, theta = 1.980, np.deg2rad(33.918)
    force = np.array([G * np.cos(theta), G * np.sin(theta), G, 3.769, -6.903, 57.657])
    torque = np.array([-0.006, 0.006, 0.032, 1.661, 0.496, -0.002])
    printed = np.array([2.228, 0.963, -0.002])
    computed = tool_of_unknowns(force, torque, DOWN).bias[3:]
    assert computed[:2] == pytest.approx(printed[:2], abs=6e-4)
    assert computed[2] == pytest.approx(0.017, abs=5e-4)  # printed: a copy of l3


@pytest.fixture
def sign_as_given(monkeypatch: pytest.MonkeyPatch) -> None:
    """To see whether the negated readings fit too takes longer than the fit."""
    monkeypatch.setattr(import_module("contactwrench.estimation.calibrate"), "checked", lambda *_: ())


def _stated_over_actual(com: Array) -> Array:
    """Stated standard deviations over the scatter of the estimates."""
    rig, R, rng = example(3, poses=12)
    rig = Rig(rig.weight, com, rig.bias, _yaw_mounting(0.7), DOWN)
    fits = [cw.calibrate(samples, "paper") for samples in samples_of_a_design(rig, R, 80, rng)]
    stated = np.sqrt(np.mean([np.diag(fit.covariance) for fit in fits], axis=0))
    ratio: Array = stated / np.std([fit.parameters for fit in fits], axis=0)
    return ratio


@pytest.mark.slow
@pytest.mark.usefixtures("sign_as_given")
def test_covariance_is_that_of_monte_carlo() -> None:
    assert _stated_over_actual(np.array([-0.012, 0.016, 0.023])) == pytest.approx(np.ones(11), abs=0.10)


@pytest.mark.slow
@pytest.mark.usefixtures("sign_as_given")
def test_covariance_errs_on_the_safe_side_where_forces_drown_the_torques() -> None:
    """A centre of mass at 0.1 m: what the torques' own noise is can hardly be told, and is not taken for less."""
    ratio = _stated_over_actual(np.array([-0.102, 0.017, -0.023]))
    assert ratio.min() > 0.93
    assert ratio.max() < 1.25


@pytest.mark.slow
@pytest.mark.usefixtures("sign_as_given")
def test_no_std_vanishes_where_the_torques_happen_to_fit_well() -> None:
    """Table V, its sensor's noise, few poses: the torque residual is often less than what the forces explain."""
    theta = np.deg2rad(33.918)
    com, bias = np.array([-0.006, 0.006, 0.032]), np.array([3.769, -6.903, 57.657, 2.228, 0.963, 0.017])
    rig = Rig(1.980, com, bias, _yaw_mounting(theta), DOWN)
    noise = 0.0005 * np.array([70.0, 70.0, 70.0, 3.0, 1.0, 1.0])
    for seed in range(30):
        calibration = cw.calibrate(noisy(rig, SIX_SPREAD, np.random.default_rng(seed), noise), "paper")
        assert np.all(calibration.std["bias"] > 0.1 * noise / np.sqrt(6.0))
        assert np.all(calibration.noise > 0.0)


@pytest.mark.parametrize("yaw", [-3.0, -0.4, 0.592, 2.9])
def test_noise_free_readings_return_the_tool(yaw: float) -> None:
    rig, R, _ = example(5, poses=6)
    rig = Rig(rig.weight, rig.com, rig.bias, _yaw_mounting(yaw), DOWN)
    calibration = cw.calibrate(noise_free(rig, R), "paper")
    assert_same_tool(calibration, rig, 1e-9)
    assert calibration.weight_xy == pytest.approx(rig.weight)
    assert calibration.yaw == pytest.approx(yaw)


def test_start_of_the_yaw_fit_is_the_closed_form_of_the_coupled_force_fit(samples: cw.Samples) -> None:
    """Coupled yaw-only fit on Tables III and IV: G = 5.03 N, theta = 46.0 deg, F0 = (4.23, -6.57, 52.5)."""
    forces_only = samples.wrench * np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
    start = next(initial_guesses(samples.R_base_flange, forces_only, SEARCH_OF_MODEL["yaw"], DOWN))
    theta = np.arctan2(start.R_flange_sensor[1, 0], start.R_flange_sensor[0, 0])
    assert np.rad2deg(theta) == pytest.approx(46.0, abs=0.05)
    assert start.weight == pytest.approx(5.03, abs=5e-3)
    assert start.bias[:3] == pytest.approx([4.23, -6.57, 52.5], abs=0.05)


@pytest.mark.parametrize("seed", range(5))
def test_start_of_the_yaw_fit_with_noise(seed: int) -> None:
    """The closed form, written with sums over sensor axes as in the method's derivation."""
    rig, R, rng = example(seed, poses=9)
    rig = Rig(rig.weight, np.zeros(3), np.r_[rig.bias[:3], 0.0, 0.0, 0.0], _yaw_mounting(rng.uniform(-3, 3)), DOWN)
    wrench = readings(rig, R) + np.r_[0.3, 0.3, 0.3, 0.0, 0.0, 0.0] * rng.normal(size=(9, 6))
    u = -R[:, 2, :]
    F = wrench[:, :3] - wrench[:, :3].mean(axis=0)
    (ux, uy, uz), (Fx, Fy, Fz) = (u - u.mean(axis=0)).T, F.T
    A, B, C = np.sum(ux * Fx + uy * Fy), np.sum(uy * Fx - ux * Fy), np.sum(uz * Fz)
    start = next(initial_guesses(R, wrench, SEARCH_OF_MODEL["yaw"], DOWN))
    theta = np.arctan2(start.R_flange_sensor[1, 0], start.R_flange_sensor[0, 0])
    assert theta == pytest.approx(np.arctan2(B, A), abs=1e-9)
    assert start.weight == pytest.approx((np.hypot(A, B) + C) / np.sum(ux**2 + uy**2 + uz**2), rel=1e-9)


def test_fewer_than_three_poses_are_refused() -> None:
    rig, R, _ = example(1, poses=2)
    with pytest.raises(cw.ContactWrenchError, match="expected 3 or more for the paper's estimator"):
        cw.calibrate(noise_free(rig, R), "paper")


def test_turns_about_the_vertical_only_are_refused() -> None:
    rig, _, rng = example(1)
    R = np.array([_yaw_mounting(a) for a in np.linspace(0.0, 5.0, 8)]) @ random_rotations(1, rng)
    with pytest.raises(cw.ContactWrenchError, match="turns about the vertical only; tilt the tool between poses"):
        cw.calibrate(noise_free(rig, R), "paper")


def test_a_negative_weight_is_refused(samples: cw.Samples) -> None:
    reversed_sign = cw.Samples(wrench=-samples.wrench, R_base_flange=samples.R_base_flange)
    with pytest.raises(cw.ContactWrenchError, match=r"--sign reaction.*--gravity 0,0,1"):
        cw.calibrate(reversed_sign, "paper")
