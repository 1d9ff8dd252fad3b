"""The noise of means at rest: honest for white noise and for what creeps, kept in the calibration."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import contactwrench as cw
from contactwrench.samples.still_noise import StillNoise, covariances_of_means, still_noise_of
from tests.support.rigs import example, noisy
from tests.support.world import Array


def off_in_std(readings: list[Array], true: Array) -> Array:
    means = np.array([y.mean(axis=0) for y in readings])
    off: Array = (means - true) / np.sqrt([np.diag(covariance) for covariance in covariances_of_means(readings)])
    return off


@pytest.mark.parametrize(("count", "rows"), [(6, 300), (24, 40), (200, 12)])
def test_means_of_white_rows_lie_within_their_std(count: int, rows: int) -> None:
    rng = np.random.default_rng(5)
    off = [
        off_in_std(list(rng.normal(size=(count, rows, 6))), np.zeros((count, 6))) for _ in range(max(1, 200 // count))
    ]
    assert 0.9 < np.sqrt(np.mean(np.square(off))) < 1.15
    assert np.mean(np.abs(off) < 2.0) > 0.92


def test_what_creeps_is_as_uncertain_as_where_on_its_way_the_truth_lies() -> None:
    rng = np.random.default_rng(6)
    creep = np.exp(rng.uniform(np.log(5.0), np.log(60.0), size=(200, 1, 6)))
    readings = rng.normal(size=(200, 300, 6)) + creep * np.linspace(0.0, 1.0, 300)[:, None]
    off = off_in_std(list(readings), rng.uniform(size=(200, 6)) * creep[:, 0])
    assert 0.6 < np.sqrt(np.mean(np.square(off))) < 1.1


def test_a_mean_that_creeps_more_than_the_others_counts_less() -> None:
    rng = np.random.default_rng(7)
    readings = rng.normal(size=(20, 300, 6))
    readings[3] += 30.0 * np.linspace(0.0, 1.0, 300)[:, None]
    std = np.sqrt([np.diag(covariance) for covariance in covariances_of_means(list(readings))])
    assert (std[3] > 10.0 * np.median(std, axis=0)).all()


def test_visits_that_disagree_make_a_pose_uncertain() -> None:
    rng = np.random.default_rng(8)
    agreeing = list(rng.normal(size=(12, 200, 6)))
    disagreeing = [np.concatenate([y[:100], y[100:] + 5.0]) for y in agreeing]
    of_both = [np.diag(covariances_of_means(y)[0]).mean() for y in (agreeing, disagreeing)]
    assert of_both[1] > 100.0 * of_both[0]


def test_rows_that_repeat_exactly_and_single_rows_have_no_scatter() -> None:
    for rows in (1, 2, 5, 100):
        assert not covariances_of_means([np.tile(np.arange(6.0) + 0.1, (rows, 1))])[0].any()


def test_a_coarse_reading_that_happens_not_to_move_is_as_uncertain_as_the_others() -> None:
    readings = np.random.default_rng(12).normal(size=(10, 100, 6))
    readings[4, :, 2] = 0.5
    variance = np.array([np.diag(covariance) for covariance in covariances_of_means(list(readings))])
    assert 0.3 < variance[4, 2] / np.median(variance[:, 2]) < 1.5


@pytest.mark.parametrize(
    ("rate", "durations"),
    [(1000.0, [0.01, 0.03, 0.1, 1.0]), (100.0, [0.01, 0.03, 0.1, 1.0]), (30.0, [0.03, 0.1, 1.0]), (10.0, [0.1, 1.0])],
)
def test_the_noise_of_white_rows_falls_with_the_root_of_the_duration(rate: float, durations: list[float]) -> None:
    rng = np.random.default_rng(9)
    noise = still_noise_of([rng.normal(size=(int(20.0 * rate), 6)) for _ in range(10)], 1.0 / rate)
    assert noise is not None
    assert noise.duration.tolist() == durations
    rows = np.rint(noise.duration * rate)
    assert noise.std == pytest.approx(np.repeat(1.0 / np.sqrt(rows)[:, None], 6, axis=1), rel=0.3)


def test_the_noise_of_what_wanders_does_not_fall() -> None:
    rng = np.random.default_rng(10)
    noise = still_noise_of([np.cumsum(rng.normal(size=(2000, 6)), axis=0) for _ in range(10)], 0.01)
    assert noise is not None
    assert (noise.std[3] > 3.0 * noise.std[2]).all()


def test_segments_that_are_too_short_tell_nothing() -> None:
    assert still_noise_of([np.zeros((3, 6))], 0.01) is None
    assert still_noise_of([], 0.01) is None


def test_it_is_saved_and_read_back_and_checked(tmp_path: Path) -> None:
    rig, R, rng = example(3)
    calibration = cw.calibrate(noisy(rig, R, rng), "mount")
    assert calibration.still_noise is None
    rng = np.random.default_rng(11)
    still = np.repeat(R, 100, axis=0)
    wrench = np.repeat(noisy(rig, R, rng).wrench, 100, axis=0) + 0.01 * rng.normal(size=(len(still), 6))
    since = np.repeat(10.0 * np.arange(len(R)), 100) + np.tile(np.arange(100) / 100.0, len(R))
    kept = cw.calibrate(cw.Samples(wrench, still, since), "mount")
    noise = kept.still_noise
    assert noise is not None
    assert noise.duration.tolist() == [0.01, 0.03, 0.1]
    assert noise.std[0] == pytest.approx(np.full(6, 0.01), rel=0.1)
    kept.save(tmp_path / "with.json")
    again = cw.Calibration.load(tmp_path / "with.json").still_noise
    assert isinstance(again, StillNoise)
    assert again.duration.tolist() == noise.duration.tolist()
    assert again.std.tolist() == noise.std.tolist()
    text = (tmp_path / "with.json").read_text(encoding="utf-8")
    (tmp_path / "edited.json").write_text(text.replace('"duration":[0.01,', '"duration":[0.04,'), encoding="utf-8")
    with pytest.raises(
        cw.ContactWrenchError, match=r"found still_noise\.duration out of order, expected it ascending from above 0"
    ):
        cw.Calibration.load(tmp_path / "edited.json")
