"""Mounting and base: exactly nominal, nearly, or anything; averaged, and honest whichever is true."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import contactwrench as cw
from contactwrench.estimation.hypotheses import ANY_BASE, ANY_MOUNTING, hypotheses_of
from contactwrench.estimation.noise import ALIKE, APART, AXES, stated_noise
from contactwrench.estimation.priors import Question
from tests.support.poses import POSE_SETS
from tests.support.rigs import NOISE, example
from tests.support.world import DOWN, Array, noisy_readings, random_rotations, readings

QUESTION = Question("auto", DOWN)
SPREAD = POSE_SETS["6 spread"]


def _volume(mount: float | None, base: float | None) -> float:
    """Of the directions of the flange's z and of gravity: Gaussians about two poles and one, spheres if free."""
    of_mount = 4.0 * np.pi if mount is None else 2.0 * (2.0 * np.pi * mount**2)
    of_base = 2.0 * np.pi if base is None else 2.0 * np.pi * base**2
    return float(of_mount * of_base)


def test_all_that_mounting_and_base_may_be_has_probability_one() -> None:
    """Densities times volumes; a mounting or base that points anywhere is a rival beside, with its own share."""
    near = hypotheses_of(QUESTION, False, False)
    assert sum(np.exp(h.log_prior) * _volume(h.mount, h.base) for h in near) == pytest.approx(1.0)
    anywhere = hypotheses_of(QUESTION, True, True)
    share = sum(np.exp(h.log_prior) * _volume(h.mount, h.base) for h in anywhere)
    assert share < ANY_MOUNTING * ANY_BASE * 1.01
    exact = [h for h in near if h.exact == (True, True)]
    assert sum(np.exp(h.log_prior) * _volume(h.mount, h.base) for h in exact) < 0.5


def test_a_model_that_is_asked_for_has_those_of_the_noise_alone_and_stated_noise_has_none() -> None:
    asked = replace(QUESTION, model="mount")
    apart, alike = hypotheses_of(asked, False, False)
    assert (alike.mount, alike.base, apart.mount, apart.base) == (None, None, None, None)
    assert (apart.apart, alike.apart) == (APART, ALIKE)
    assert np.exp([apart.log_prior, alike.log_prior]) == pytest.approx([AXES[APART], AXES[ALIKE]])
    (only,) = hypotheses_of(replace(asked, noise=stated_noise(np.ones(6))), False, False)
    assert only.log_prior == 0.0


def _errors_in_std(mount_deg: float, base_deg: float, poses: Array, runs: int, seed: int) -> tuple[Array, Array]:
    """Errors (runs, 4) of weight and com over their stds, and over their 95 % intervals; tilts drawn with these stds an
    axis.
    """
    rng = np.random.default_rng(seed)
    in_std, in_interval = [], []
    for _ in range(runs):
        rig, _, _ = example(int(rng.integers(10_000)))
        tilt = Rotation.from_rotvec([*(np.deg2rad(mount_deg) * rng.normal(size=2)), 0.0])
        lean = Rotation.from_rotvec([*(np.deg2rad(base_deg) * rng.normal(size=2)), 0.0])
        mounting = (tilt * Rotation.from_euler("z", rng.uniform(-np.pi, np.pi))).as_matrix()
        rig = replace(rig, weight=6.0, R_flange_sensor=mounting, down=lean.apply(DOWN))
        calibration = cw.calibrate(cw.Samples(noisy_readings(rig, poses, NOISE, rng), poses))
        off = np.r_[calibration.weight - rig.weight, calibration.com - rig.com]  # type: ignore[operator]
        in_std.append(off / np.r_[calibration.std["weight"], calibration.std["com"]])
        in_interval.append(in_std[-1] / calibration.t_quantile(0.95))
    return np.array(in_std), np.array(in_interval)


@pytest.mark.slow
@pytest.mark.parametrize(("mount_deg", "base_deg"), [(0.0, 0.0), (1.4, 0.7), (7.0, 0.0)])
def test_no_tilt_makes_the_std_of_the_mean_too_small(mount_deg: float, base_deg: float) -> None:
    """Six spread poses, exactly nominal to far beyond: errors of 1.3 std RMS at most (Student's t of few dof: 1.2)."""
    in_std, in_interval = _errors_in_std(mount_deg, base_deg, SPREAD, 4, 77)
    assert float(np.sqrt(np.mean(in_std**2))) < 1.3
    assert float(np.mean(np.abs(in_interval) < 1.0)) > 0.9


@pytest.mark.slow
def test_an_exactly_nominal_cell_profits_from_it() -> None:
    """The mean's force errs by little more than that of whoever knows both tilts, and less than where both are free."""
    rng = np.random.default_rng(8)
    unseen = random_rotations(40, rng)
    squares = {"auto": 0.0, "yaw": 0.0, "mount+base": 0.0}
    for _ in range(4):
        rig, _, _ = example(int(rng.integers(10_000)))
        rig = replace(rig, weight=6.0, R_flange_sensor=Rotation.from_euler("z", rng.uniform(-3.0, 3.0)).as_matrix())
        samples = cw.Samples(noisy_readings(rig, SPREAD, NOISE, rng), SPREAD)
        for model in squares:
            off = (cw.calibrate(samples, model).predict(unseen) - readings(rig, unseen))[:, :3]
            squares[model] += float(np.mean(off**2)) / 4.0
    assert squares["auto"] < 1.25**2 * squares["yaw"]
    assert squares["auto"] < squares["mount+base"]
