"""The axes' variances: the optimum of a restricted likelihood with a prior, and which axes may differ."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.special import gammaln
from scipy.stats import chi2

import contactwrench as cw
from contactwrench.estimation.noise import ALIKE, APART, NoiseModel, StatedNoise
from tests.support.rigs import NOISE, example, noisy
from tests.support.world import Array

FREE = NoiseModel(np.full(6, 1e-30), None, NOISE**2)


def _minus_log_posterior(log_variance: Array, squares: Array, dof: Array, apart: float) -> float:
    """Of a group's axes: chi-square densities, and a Gaussian of what each logarithm is off their mean."""
    likelihood = 0.5 * np.sum(dof * log_variance + squares * np.exp(-log_variance))
    off = log_variance - log_variance.mean()
    return float(likelihood + 0.5 * (off @ off) / apart**2)


def _improved(squares: Array, dof: Array, apart: float, model: NoiseModel = FREE, passes: int = 60) -> Array:
    log_variance = np.log(model.start)[None]
    for k in range(passes):
        log_variance = model.improved(log_variance, squares[None], dof[None], np.array([apart]), first=k == 0)
    return np.asarray(log_variance[0])


@pytest.mark.parametrize("ratio", [1.0, 1.3, 3.0, 81.0])
@pytest.mark.parametrize("dof", [3.0, 20.0])
@pytest.mark.parametrize("apart", [ALIKE, APART])
def test_variances_are_where_a_direct_search_finds_the_optimum(ratio: float, dof: float, apart: float) -> None:
    squares = dof * NOISE**2 * np.array([1.0, ratio, 1.1, 0.9, 1.0, 1.0 / ratio])
    left = np.full(6, dof)
    found = _improved(squares, left, apart)
    assert _improved(squares, left, apart, passes=10) == pytest.approx(found, abs=1e-3)
    for group in (slice(0, 3), slice(3, 6)):
        searched = minimize(
            _minus_log_posterior,
            np.log(squares[group] / dof),
            args=(squares[group], left[group], apart),
            method="Nelder-Mead",
            options={"xatol": 1e-9, "fatol": 1e-12, "maxiter": 4000},
        )
        assert found[group] == pytest.approx(searched.x, abs=1e-3)


def test_an_axis_is_no_lower_than_the_stops_show_and_the_others_are_where_they_would_be_beside_it() -> None:
    least = np.zeros(6)
    least[2] = 4.0 * NOISE[2] ** 2
    bounded = NoiseModel(np.maximum(least, 1e-30), None, NOISE**2)
    squares, left = 20.0 * NOISE**2 * np.array([1.0, 3.0, 0.5, 1.0, 1.0, 1.0]), np.full(6, 20.0)
    found = _improved(squares, left, APART, bounded)
    assert found[2] == pytest.approx(np.log(least[2]))

    def others(free: Array) -> float:
        return _minus_log_posterior(np.r_[free, found[2]], squares[:3], left[:3], APART)

    searched = minimize(others, found[:2] + 0.3, method="Nelder-Mead", options={"xatol": 1e-9, "fatol": 1e-12})
    assert found[:2] == pytest.approx(searched.x, abs=1e-3)


def test_alike_axes_share_one_variance_and_others_have_their_own() -> None:
    dof = np.full(6, 5.0)
    chance = 5.0 * NOISE**2 * np.array([0.3, 1.0, 1.7, 1.0, 1.0, 1.0])
    together = np.exp(_improved(chance, dof, ALIKE))[:3] / NOISE[:3] ** 2
    assert together.max() < 1.2 * together.min()
    plain = 20.0 * NOISE**2 * np.array([1.0, 1.0, 81.0, 1.0, 1.0, 1.0])
    apart = np.exp(_improved(plain, np.full(6, 20.0), APART))[:3] / NOISE[:3] ** 2
    assert apart == pytest.approx([1.0, 1.0, 81.0], rel=0.15)


def test_stated_noise_has_one_scale_and_what_the_stops_show_is_the_least() -> None:
    stated = NoiseModel(np.zeros(6), StatedNoise(NOISE), NOISE**2)
    squares, dof = 4.0 * NOISE**2 * np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]), np.full(6, 10.0)
    assert np.exp(_improved(squares, dof, ALIKE, stated)) == pytest.approx(NOISE**2 * 4.0 * 21.0 / 60.0)
    earlier = NoiseModel(np.zeros(6), StatedNoise(NOISE, dof=40.0), NOISE**2)
    assert np.exp(_improved(squares, dof, ALIKE, earlier)) == pytest.approx(NOISE**2 * (4.0 * 21.0 + 40.0) / 100.0)
    floored = NoiseModel(9.0 * NOISE**2, None, NOISE**2)
    assert np.exp(_improved(squares, dof, ALIKE, floored)) == pytest.approx(9.0 * NOISE**2)


def test_an_axis_variance_is_as_uncertain_as_chi_square_says() -> None:
    """Alone, the logarithm of a variance of d dof has the variance 2 / d; where axes share one, 2 / (3 d)."""
    dof = np.full(6, 40.0)
    spread = FREE.log_spread(dof, APART)
    assert np.diag(spread) == pytest.approx(np.full(6, 2.0 / 40.0), rel=0.05)
    alike = FREE.log_spread(dof, ALIKE)
    assert alike[3:, 3:] == pytest.approx(np.full((3, 3), 2.0 / 120.0), rel=0.5)
    assert np.abs(alike[:3, 3:]).max() < 1e-12


def test_what_is_known_of_the_scale_counts_in_its_evidence() -> None:
    """Its scaled inverse chi-square density, of the logarithm of the scale: not where an axis is at its least."""
    stated, scale = NoiseModel(np.zeros(6), StatedNoise(NOISE, 20.0), NOISE**2), np.array([0.5, 1.0, 3.0])
    log_variance = np.log(NOISE**2) + np.log(scale)[:, None]
    log_variance[2, 1] += 1.0
    cost = stated.log_volume(log_variance, np.full((3, 6), 4.0), np.full(3, ALIKE))
    of_density = -2.0 * chi2.logpdf(20.0 / scale, 20.0) + 2.0 * np.log(scale)
    assert cost - cost[1] == pytest.approx(of_density - of_density[1])


def test_the_volume_of_one_scale_is_that_of_a_scaled_inverse_chi_square() -> None:
    """Laplace's method on the scale of a stated noise: ratios of exact integrals, for many dof, by gamma functions."""
    stated = NoiseModel(np.zeros(6), StatedNoise(NOISE), NOISE**2)
    at = np.log(NOISE**2)[None]

    def of(dof: float) -> float:
        """-2 log of what the integral over the log of the scale adds to the optimum's height."""
        volume = float(stated.log_volume(at, np.full((1, 6), dof / 6.0), np.array([ALIKE]))[0])
        exact = gammaln(0.5 * dof) - 0.5 * dof * np.log(0.5 * dof) + 0.5 * dof
        return volume + 2.0 * float(exact)

    assert of(60.0) == pytest.approx(of(600.0), abs=0.02)


@pytest.mark.slow
def test_seven_poses_share_one_noise_an_axis_and_24_with_one_of_nine_times_do_not() -> None:
    ratios, found = [], []
    for seed in range(12):
        rig, R, rng = example(seed, poses=7)
        noise = cw.calibrate(noisy(rig, R, rng), "mount").noise.reshape(2, 3)
        ratios.append(noise.max(axis=1) / noise.min(axis=1))
        rig, R, rng = example(100 + seed)
        uneven = NOISE * np.array([1.0, 9.0, 1.0, 1.0, 1.0, 1.0])
        calibration = cw.calibrate(noisy(rig, R, rng, uneven), "mount")
        found.append(calibration.noise / uneven)
    assert np.max(ratios) < 1.6
    assert np.median(ratios) < 1.2  # an axis alone counts where it is noisier, as chance makes a few of seven poses
    assert np.exp(np.mean(np.log(found), axis=0)) == pytest.approx(np.ones(6), rel=0.15)
