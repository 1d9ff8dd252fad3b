"""Weighing: exact without noise in every orientation, and a gain error is the slope of the masses read."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from contactwrench.simulate.recording import record_poses
from reproduction import weighing, weighing_trials
from reproduction.methods import calibrated, tare
from reproduction.trials import DEFAULT, joints_of_paper, unseen_joints
from reproduction.weighing import GAIN, PRINTED, line, prediction_interval
from reproduction.weighing_trials import LOADS, ORIENTATIONS, SCALES, in_range, masses
from tests.support.experiments import cell, figures, noise_free, one_thread, recorded, undrawn

pytest.importorskip("mujoco")


def test_the_printed_masses_have_the_slope_that_the_method_page_says() -> None:
    slope, offset = line(np.array(PRINTED))
    assert slope == pytest.approx(0.974, abs=0.001)
    assert offset == pytest.approx(-3.9, abs=0.05)


@pytest.mark.slow
@pytest.mark.parametrize("gain", [1.0, GAIN])
def test_without_noise_the_masses_are_exact_but_for_the_gain(gain: float) -> None:
    true = noise_free()
    settings = replace(true, sensor=replace(true.sensor, gain=(gain,) * 6))
    method = calibrated("yaw", "yaw")(recorded(settings, joints_of_paper()))
    joints = unseen_joints()[in_range(unseen_joints())][:5]
    hung = record_poses(settings, joints, LOADS, rng=np.random.default_rng(0))
    assert not hung.saturated.any()
    for scale in SCALES:
        read = masses(method, hung.samples, scale, settings.gravity).reshape(len(LOADS), -1)
        np.testing.assert_allclose(read, gain * 1e3 * np.array(LOADS)[:, None] * np.ones(5), atol=0.01)
    slope, offset = line(read[:, 0])
    assert slope == pytest.approx(gain, abs=1e-5)
    assert offset == pytest.approx(0.0, abs=0.01)


def test_a_tare_reads_true_only_where_it_was_zeroed() -> None:
    settings = noise_free()
    method = tare(recorded(settings, joints_of_paper()))
    same = record_poses(settings, joints_of_paper()[:1], LOADS, rng=np.random.default_rng(0))
    np.testing.assert_allclose(masses(method, same.samples, "norm", settings.gravity), 1e3 * np.array(LOADS), atol=0.01)


def test_out_of_range_is_where_the_sensor_saturates() -> None:
    fits = in_range(unseen_joints())
    others = np.setdiff1d(np.arange(len(unseen_joints())), fits)
    assert 0 < len(fits) < len(unseen_joints())
    hung = record_poses(noise_free(), unseen_joints(), LOADS, rng=np.random.default_rng(0))
    touched = np.any(hung.saturated, axis=1).reshape(len(LOADS), -1).any(axis=0)
    assert not touched[fits].any()
    assert touched[others].mean() > 0.9


@pytest.mark.slow
def test_an_interval_holds_one_more_reading_with_95_per_cent() -> None:
    """Of readings whose error is the data set's and the orientation's alike, with few data sets."""
    rng = np.random.default_rng(2)

    def readings(sets: int, each: int) -> np.ndarray:
        return np.asarray(100.0 + 3.0 * rng.normal(size=(sets, 1)) + 3.0 * rng.normal(size=(sets, each)))

    for each, most in ((1, 0.96), (12, 0.985)):
        held = []
        for _ in range(4000):
            low, high = prediction_interval(readings(6, each))
            held.append(low.value <= readings(1, 1)[0, 0] <= high.value)
        assert 0.94 < np.mean(held) < most


def test_each_data_set_is_weighed_in_orientations_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(weighing_trials, "ESTIMATORS", {"tare": tare})
    method = "tare", "norm"
    usable = unseen_joints()[in_range(unseen_joints())]
    poses = np.concatenate([joints_of_paper()[:1], usable])
    first, second = (
        trial.anywhere[method] for trial in weighing_trials.run(noise_free(), joints_of_paper(), poses, 5, range(2))
    )
    assert first.shape == second.shape == (len(LOADS), ORIENTATIONS)
    assert len(np.unique(np.round(first[0], 6))) == ORIENTATIONS
    assert not np.allclose(np.sort(first[0]), np.sort(second[0]), atol=0.1)


@pytest.mark.slow
def test_the_part_has_both_sensors_and_repeats_itself() -> None:
    with one_thread() as pool, undrawn():
        first, again = (weighing.part(pool, 0.01, 3) for _ in range(2))
    assert figures(first) == figures(again)
    slopes = [cell(first, "gain", f"{gain}: yaw", "slope").value for gain in ("gain 1", f"gain {GAIN}")]
    assert slopes[1] / slopes[0] == pytest.approx(GAIN, abs=1e-4)
    weights = [cell(first, "gain", f"{gain}: yaw", "tool's weight, N").value for gain in ("gain 1", f"gain {GAIN}")]
    assert weights[0] - weights[1] == pytest.approx((1.0 - GAIN) * DEFAULT.tool.mass * DEFAULT.gravity, abs=2e-3)
