"""Weighing: exact without noise in every orientation, and a gain error is the slope of the masses read."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from contactwrench.experiment import weighing
from contactwrench.experiment.trials import DEFAULT, joints_of_paper, unseen_joints
from contactwrench.experiment.ways import calibrated, tare
from contactwrench.experiment.weighing import GAIN, LOADS, PRINTED, SCALES, in_range, line, masses
from contactwrench.simulate.recording import record_poses
from tests.experiments import cell, figures, noise_free, one_thread, recorded

pytest.importorskip("mujoco")


def test_the_printed_masses_have_the_slope_that_the_method_page_says() -> None:
    slope, offset = line(np.array(PRINTED))
    assert slope == pytest.approx(0.974, abs=0.001)
    assert offset == pytest.approx(-3.9, abs=0.05)


@pytest.mark.parametrize("gain", [1.0, GAIN])
def test_without_noise_the_masses_are_exact_but_for_the_gain(gain: float) -> None:
    true = noise_free()
    settings = replace(true, sensor=replace(true.sensor, gain=(gain,) * 6))
    way = calibrated("yaw", "yaw")(recorded(settings, joints_of_paper()))
    joints = unseen_joints()[in_range(unseen_joints())][:5]
    hung = record_poses(settings, joints, LOADS, rng=np.random.default_rng(0))
    assert not hung.saturated.any()
    for scale in SCALES:
        read = masses(way, hung.samples, scale, settings.gravity).reshape(len(LOADS), -1)
        np.testing.assert_allclose(read, gain * 1e3 * np.array(LOADS)[:, None] * np.ones(5), atol=0.01)
    slope, offset = line(read[:, 0])
    assert slope == pytest.approx(gain, abs=1e-5)
    assert offset == pytest.approx(0.0, abs=0.01)


def test_a_tare_reads_true_only_where_it_was_zeroed() -> None:
    settings = noise_free()
    way = tare(recorded(settings, joints_of_paper()))
    same = record_poses(settings, joints_of_paper()[:1], LOADS, rng=np.random.default_rng(0))
    np.testing.assert_allclose(masses(way, same.samples, "norm", settings.gravity), 1e3 * np.array(LOADS), atol=0.01)


def test_out_of_range_is_where_the_sensor_saturates() -> None:
    fits = in_range(unseen_joints())
    others = np.setdiff1d(np.arange(len(unseen_joints())), fits)
    assert 0 < len(fits) < len(unseen_joints())
    hung = record_poses(noise_free(), unseen_joints(), LOADS, rng=np.random.default_rng(0))
    touched = np.any(hung.saturated, axis=1).reshape(len(LOADS), -1).any(axis=0)
    assert not touched[fits].any()
    assert touched[others].mean() > 0.9


def test_the_part_has_both_sensors_and_repeats_itself() -> None:
    with one_thread() as pool:
        first, again = (weighing.part(pool, 0.01, 3) for _ in range(2))
    assert figures(first) == figures(again)
    slopes = [cell(first, "gain", f"{gain}: yaw", "slope").value for gain in ("gain 1", f"gain {GAIN}")]
    assert slopes[1] / slopes[0] == pytest.approx(GAIN, abs=1e-4)
    weights = [cell(first, "gain", f"{gain}: yaw", "tool's weight, N").value for gain in ("gain 1", f"gain {GAIN}")]
    assert weights[0] - weights[1] == pytest.approx((1.0 - GAIN) * DEFAULT.tool.mass * DEFAULT.gravity, abs=2e-3)
