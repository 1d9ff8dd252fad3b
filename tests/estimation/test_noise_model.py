"""The axes' variances: the optimum of a restricted likelihood with a prior, and which axes may differ."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.special import gammaln

import contactwrench as cw
from contactwrench.estimation.noise import AXIS_SCALE, NoiseModel, StatedNoise
from tests.support.rigs import NOISE, example, noisy
from tests.support.world import Array

FREE = NoiseModel(np.full(6, 1e-30), None, NOISE**2)


def _minus_log_posterior(log_variance: Array, squares: Array, dof: Array) -> float:
    """Of a group's axes: chi-square densities, and a Student's t of one degree of freedom, in two dimensions, of what
    each logarithm is off their mean.
    """
    likelihood = 0.5 * np.sum(dof * log_variance + squares * np.exp(-log_variance))
    off = log_variance - log_variance.mean()
    return float(likelihood + 1.5 * np.log1p(off @ off / AXIS_SCALE**2))


def _improved(squares: Array, dof: Array, model: NoiseModel = FREE) -> Array:
    log_variance = np.log(model.start)[None]
    for k in range(60):
        log_variance = model.improved(log_variance, squares[None], dof[None], first=k == 0)
    return np.asarray(log_variance[0])


@pytest.mark.parametrize("ratio", [1.0, 1.3, 3.0, 81.0])
@pytest.mark.parametrize("dof", [3.0, 20.0])
def test_variances_are_where_a_direct_search_finds_the_optimum(ratio: float, dof: float) -> None:
    squares = dof * NOISE**2 * np.array([1.0, ratio, 1.1, 0.9, 1.0, 1.0 / ratio])
    left = np.full(6, dof)
    found = _improved(squares, left)
    for group in (slice(0, 3), slice(3, 6)):
        starts = (np.log(squares[group] / dof), np.full(3, np.log(squares[group].mean() / dof)))
        args = (squares[group], left[group])
        searched = [minimize(_minus_log_posterior, x, args=args, method="Nelder-Mead",
                             options={"xatol": 1e-9, "fatol": 1e-12, "maxiter": 4000}) for x in starts]  # fmt: skip
        own = _minus_log_posterior(found[group], *args)
        assert any(found[group] == pytest.approx(search.x, abs=1e-3) for search in searched)
        assert own < max(search.fun for search in searched) + 1e-6


def test_axes_between_which_little_lies_share_one_variance_and_others_do_not() -> None:
    dof = np.full(6, 5.0)
    chance = 5.0 * NOISE**2 * np.array([0.3, 1.0, 1.7, 1.0, 1.0, 1.0])
    together = np.exp(_improved(chance, dof))[:3] / NOISE[:3] ** 2
    assert together.max() < 1.2 * together.min()
    plain = 20.0 * NOISE**2 * np.array([1.0, 1.0, 81.0, 1.0, 1.0, 1.0])
    apart = np.exp(_improved(plain, np.full(6, 20.0)))[:3] / NOISE[:3] ** 2
    assert apart == pytest.approx([1.0, 1.0, 81.0], rel=0.15)


def test_stated_noise_has_one_scale_and_what_the_stops_show_is_the_least() -> None:
    stated = NoiseModel(np.zeros(6), StatedNoise(NOISE), NOISE**2)
    squares, dof = 4.0 * NOISE**2 * np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]), np.full(6, 10.0)
    assert np.exp(_improved(squares, dof, stated)) == pytest.approx(NOISE**2 * 4.0 * 21.0 / 60.0)
    earlier = NoiseModel(np.zeros(6), StatedNoise(NOISE, dof=40.0), NOISE**2)
    assert np.exp(_improved(squares, dof, earlier)) == pytest.approx(NOISE**2 * (4.0 * 21.0 + 40.0) / 100.0)
    floored = NoiseModel(9.0 * NOISE**2, None, NOISE**2)
    assert np.exp(_improved(squares, dof, floored)) == pytest.approx(9.0 * NOISE**2)


def test_an_axis_variance_is_as_uncertain_as_chi_square_says_where_axes_are_plainly_apart() -> None:
    """Alone, the logarithm of a variance of d dof has the variance 2 / d; where axes share one, 2 / (3 d)."""
    dof = np.full(6, 40.0)
    apart = np.log(NOISE**2 * np.array([1.0, 100.0, 1e4, 1.0, 1.0, 1.0]))
    spread = FREE.log_spread(apart, dof)
    assert np.diag(spread)[:3] == pytest.approx(np.full(3, 2.0 / 40.0), rel=0.05)
    assert spread[3:, 3:] == pytest.approx(np.full((3, 3), 2.0 / 120.0), rel=0.5)
    assert np.abs(spread[:3, 3:]).max() < 1e-12


def test_the_volume_of_one_scale_is_that_of_a_scaled_inverse_chi_square() -> None:
    """Laplace's method on the scale of a stated noise: ratios of exact integrals, for many dof, by gamma functions."""
    stated = NoiseModel(np.zeros(6), StatedNoise(NOISE), NOISE**2)
    at = np.log(NOISE**2)[None]

    def of(dof: float) -> float:
        """-2 log of what the integral over the log of the scale adds to the optimum's height."""
        volume = float(stated.log_volume(at, np.full((1, 6), dof / 6.0))[0])
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
