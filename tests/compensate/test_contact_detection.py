"""The test for contact against scipy's distributions and drawn noise; contacts, their times, and new zeros."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import chi2, f

import contactwrench as cw
from contactwrench.compensate.bias_tracking import TYPICAL_DRIFT, whiten
from contactwrench.compensate.contact_detection import satterthwaite, threshold_at, thresholds
from contactwrench.compensate.contact_wrenches import Contact, ContactWrenches
from contactwrench.compensate.filters import LowPass
from contactwrench.compensate.noise import between_poses, of_still_segments, stated_noise
from contactwrench.errors import InputError
from contactwrench.samples.still_noise import StillNoise, still_noise_of
from tests.support.live import RATE, calibrated, free, still, swinging, times
from tests.support.rigs import NOISE, example
from tests.support.world import Array, noisy_readings, random_rotations, readings


def _usual(calibration: cw.Calibration, **settings: Any) -> cw.Compensator:
    usual: dict[str, Any] = {"rate": RATE, "noise": NOISE}
    return cw.Compensator(calibration, **(usual | settings))


@pytest.mark.parametrize("rate", [1e-6, 1e-4, 0.01])
def test_thresholds_are_chi_square_or_f(rate: float) -> None:
    known, of_30 = ([threshold_at(table.tolist(), dof) for table in thresholds(rate)] for dof in (0.0, 30.0))
    rates = (rate, 0.01, 0.01 * rate)
    assert known == pytest.approx([chi2.isf(each, 6) for each in rates], rel=1e-4)
    assert of_30 == pytest.approx([6.0 * f.isf(each, 6, 30) for each in rates], rel=1e-2)
    for dof in (0.1, 0.5, 1e6, 1e9):
        assert threshold_at(thresholds(rate)[0].tolist(), dof) == pytest.approx(
            6.0 * f.isf(rate, 6, min(max(dof, 0.5), 1e6)), rel=1e-6
        )


def test_whitening_and_the_share_that_was_estimated() -> None:
    rng = np.random.default_rng(1)
    A, noise, W = rng.normal(size=(6, 6)), rng.uniform(size=6), np.zeros((6, 6)).tolist()
    S = A @ A.T + np.eye(6)
    whiten(S.tolist(), noise.tolist(), W)
    assert pytest.approx(np.eye(6)) == np.array(W) @ (S + np.diag(noise)) @ np.array(W).T
    whiten(S.tolist(), [0.0] * 6, W)
    assert satterthwaite(W, S.tolist(), 20.0) == pytest.approx(20.0)
    assert satterthwaite(W, (0.5 * S).tolist(), 20.0) == pytest.approx(80.0)
    assert satterthwaite(W, S.tolist(), 0.0) == 0.0


def test_a_covariance_that_rounding_made_indefinite_is_whitened_all_the_same() -> None:
    W = np.zeros((6, 6)).tolist()
    whiten((np.ones((6, 6)) - 1e-15 * np.eye(6)).tolist(), [0.0] * 6, W)
    assert np.isfinite(W).all()


def test_noise_of_means_of_a_recording_and_of_a_size() -> None:
    rng = np.random.default_rng(2)
    white = stated_noise(NOISE)
    found = replace(stated_noise(NOISE * rng.normal(size=(60_000, 6))), horizon=20_000.0)
    for rows, most in ((1.0, 1.1), (10.0, 1.2), (1000.0, 4.0)):
        assert white.of_mean(rows) == pytest.approx(NOISE**2 / rows, rel=1e-2)
        share = found.of_mean(rows) * rows / NOISE**2
        assert share.min() > 0.7
        assert share.max() < most
    steady = stated_noise(NOISE * np.cumsum(rng.normal(size=(20_000, 6)), axis=0))
    assert (steady.of_mean(100.0) > 0.5 * steady.of_sample).all()
    for values in (np.full(6, np.nan), np.zeros((9, 6)), -NOISE):
        with pytest.raises(InputError):
            stated_noise(values)


def test_noise_of_the_still_segments_is_carried_on_as_white_below_and_with_its_floor_above() -> None:
    duration = np.array([0.01, 0.03, 0.1, 1.0])
    flicker = 0.02**2
    std = np.sqrt(NOISE**2 / (1000.0 * duration[:, None]) + flicker)
    found = of_still_segments(StillNoise(duration, std), 1000.0)
    allan = found.allan_of(np.array([1.0, 10.0, 50.0, 1e5]))
    assert allan[0] == pytest.approx(10.0 * std[0] ** 2)
    assert allan[1] == pytest.approx(std[0] ** 2)
    assert allan[2] == pytest.approx(NOISE**2 / 50.0 + flicker, rel=0.1)
    assert allan[3] == pytest.approx(np.full(6, flicker), rel=1e-3)
    assert found.flicker == pytest.approx(np.full(6, flicker / np.log(4.0)), rel=1e-3)
    at_50_hertz = of_still_segments(StillNoise(duration, std), 50.0)
    assert at_50_hertz.rows == pytest.approx([1.5, 5.0, 50.0])


def _read(kind: str, n: int, rng: np.random.Generator) -> Array:
    """Readings (n, 6) at 1 kHz of a sensor at rest: each anew, held for ten rows, or behind a filter in the sensor."""
    rows = NOISE * rng.normal(size=(n, 6))
    if kind == "held":
        return rows[np.arange(n) // 10 * 10]
    if kind == "filtered":
        rows = np.asarray(lfilter([0.3], [1.0, -0.7], rows, axis=0))
    return rows + (0.2 * NOISE * np.cumsum(rng.normal(size=(n, 6)), axis=0) / np.sqrt(n) if kind == "wanders" else 0.0)


@pytest.mark.parametrize("kind", ["white", "held", "filtered", "wanders"])
def test_fewer_samples_than_the_calibration_had_are_as_noisy_as_some_of_its_rows(kind: str) -> None:
    """A logger that keeps every k-th reading takes no means. Of more samples than that no more is known than before."""
    rng = np.random.default_rng(4)
    still = still_noise_of([_read(kind, 5_000, rng) for _ in range(12)], 0.001)
    assert still is not None
    for every in (10, 20, 50, 100):
        rows = np.concatenate([_read(kind, 5_000, rng)[::every] for _ in range(40)])
        found = of_still_segments(still, 1000.0 / every)
        steps = np.sqrt(0.5 * np.mean(np.diff(rows.reshape(40, -1, 6), axis=1) ** 2, axis=(0, 1)))
        assert np.sqrt(found.white) == pytest.approx(steps, rel=0.15)
    assert of_still_segments(still, 2000.0).white == pytest.approx(
        2.0 * of_still_segments(still, 1000.0).white, rel=0.1
    )


def test_what_poses_differ_by_is_beyond_the_noise_of_their_means() -> None:
    rig, R, rng = example(2, poses=10)
    each = noisy_readings(rig, np.repeat(R, 200, axis=0), NOISE, rng).reshape(10, 200, 6)
    each += (2.0 * NOISE * rng.normal(size=(10, 6)))[:, None]
    repeated = cw.calibrate(cw.Samples(each.reshape(-1, 6), np.repeat(R, 200, axis=0)), "mount")
    assert np.sqrt(between_poses(repeated, NOISE**2)) == pytest.approx(2.0 * NOISE, rel=0.6)
    single = cw.calibrate(cw.Samples(noisy_readings(rig, R, NOISE, rng), R), "mount", noise=NOISE)
    assert between_poses(single, np.zeros(6)) == pytest.approx(single.noise**2)
    assert between_poses(single, single.noise**2) == pytest.approx(np.zeros(6))


def _slow(rng: np.random.Generator, n: int) -> Array:
    """Noise (n, 6) of an arm that shakes at some 15 Hz: far from white."""
    found: Array = NOISE * lfilter([0.44], [1.0, -0.9], rng.normal(size=(n + 200, 6)), axis=0)[200:]
    return found


def test_a_recording_tells_noise_that_is_not_white() -> None:
    """The std behind a low-pass, and contacts that are none, where the noise is given by its size or by a recording."""
    calibration, rig, rng = calibrated(10)
    R = swinging(rng, 4000)
    wrench = readings(rig, R) + _slow(rng, 4000)
    recording = _slow(rng, 4000)
    for noise, honest in ((recording.std(axis=0), False), (recording, True)):
        batch = _usual(calibration, noise=noise, lowpass=20.0, drift=TYPICAL_DRIFT).run(wrench, R, times(4000))
        size = np.sqrt(np.mean((batch.wrench / batch.std)[500:] ** 2))
        assert bool(0.6 < size < 1.2) is honest
        assert (not batch.contacts) is honest
    white = stated_noise(NOISE * rng.normal(size=(40_000, 6)))
    assert white.behind(LowPass(20.0), RATE) == pytest.approx(LowPass(20.0).noise_gain(RATE) * NOISE**2, rel=0.5)


@pytest.mark.slow
@pytest.mark.parametrize("settings", [{}, {"lowpass": 100.0}, {"drift": TYPICAL_DRIFT}])
def test_false_alarms_are_as_many_as_stated(settings: dict[str, Any]) -> None:
    """At 1 % a sample, 12 calibrations of 500 samples: 60 expected, clustered as calibrations err."""
    fired = 0
    for seed in range(12):
        calibration, rig, rng = calibrated(seed)
        R = swinging(rng, 600)
        batch = _usual(calibration, false_alarm_rate=0.01, **settings).run(free(rig, R, rng), R, times(600))
        fired += int(np.sum((batch.statistic > batch.threshold)[100:]))
    assert 30 <= fired <= 120


def _pushed(
    seed: int, push: Array, begin: int = 500, end: int = 900, **settings: Any
) -> tuple[ContactWrenches, Contact | None]:
    calibration, rig, rng = calibrated(seed)
    R = swinging(rng, 1500)
    wrench = free(rig, R, rng)
    wrench[begin:end] += push
    compensator = _usual(calibration, **settings)
    return compensator.run(wrench, R, times(1500)), compensator.last_contact


@pytest.mark.parametrize("seed", range(5))
def test_a_contact_of_1_newton_is_found_and_timed(seed: int) -> None:
    force = np.random.default_rng(seed).normal(size=3)
    push = np.r_[force / np.linalg.norm(force), 0.0, 0.0, 0.0]
    batch, last = _pushed(seed, push)
    assert batch.contact[510:900].all()
    assert not batch.contact[:500].any()
    assert not batch.contact[910:].any()
    (contact,) = batch.contacts
    assert contact is last
    assert contact.onset == pytest.approx(100.5, abs=0.002)
    assert contact.release == pytest.approx(100.9, abs=0.008)
    assert contact.onset_seen
    assert np.abs((contact.mean - push) / np.sqrt(np.diag(contact.covariance))).max() < 5.0
    assert np.linalg.norm(contact.peak[:3]) > 1.0


def test_hysteresis_holds_what_would_flicker() -> None:
    """A push of 4.5 standard deviations: above and below the threshold sample by sample, one contact all the same."""
    batch, _ = _pushed(1, np.r_[5.5 * 0.05, np.zeros(5)])
    fired = (batch.statistic > batch.threshold)[520:900]
    assert 0.2 < fired.mean() < 0.9
    assert len(batch.contacts) <= 2
    assert batch.contact[600:900].mean() > 0.9


def test_a_contact_shorter_than_the_minimum_is_none() -> None:
    push = np.r_[2.0, np.zeros(5)]
    assert not _pushed(2, push, 500, 504)[0].contacts
    assert len(_pushed(2, push, 500, 510)[0].contacts) == 1
    assert not _pushed(2, push, 500, 530, minimum_duration=0.05)[0].contacts


def test_a_contact_that_lasts_is_the_last_contact() -> None:
    batch, last = _pushed(3, np.r_[np.zeros(3), 0.05, 0.0, 0.0], 1000, 1500)
    assert not batch.contacts
    assert last is not None
    assert last.release is None
    assert last.onset == pytest.approx(101.0, abs=0.002)
    assert last.line.reason is not None


def test_the_line_of_a_contact() -> None:
    point, force = np.array([0.02, -0.05, 0.12]), np.array([4.0, -3.0, 1.0])
    batch, _ = _pushed(4, np.r_[force, np.cross(point, force)])
    line = batch.contacts[0].line
    expected = np.cross(force, np.cross(point, force)) / (force @ force)
    off = line.point - expected
    assert off @ np.linalg.pinv(line.point_covariance, rcond=1e-6) @ off < 25.0
    assert np.sqrt(np.trace(line.point_covariance)) < 0.005


def test_a_new_zero_in_another_orientation() -> None:
    """The bias has moved by newtons; zeroed in one pose, the tool is free in all others, within its std."""
    calibration, rig, rng = calibrated(5)
    moved = np.array([2.0, -3.0, 5.0, 0.1, -0.2, 0.05])
    for drift in (None, TYPICAL_DRIFT):
        compensator = _usual(calibration, drift=drift)
        R = still(rng, 300)
        assert compensator.run(free(rig, R, rng) + moved, R, times(300)).contact[20:].all()
        zero = compensator.zero(cw.Samples(free(rig, R, rng) + moved, R))
        assert np.abs((zero.shift - moved) / zero.std).max() < 4.5
        for k in range(3):
            R = still(rng, 300)
            batch = compensator.run(free(rig, R, rng) + moved, R, times(300) + 1.0 + k)
            assert np.abs(batch.wrench / batch.std).max() < 6.0
            assert not (batch.contact == 1).any()
            assert not batch.contacts
    fresh = _usual(calibration)
    fresh.zero(cw.Samples(free(rig, R, rng) + moved, R))
    assert np.abs(fresh(readings(rig, R[:1])[0] + moved, R[0], 5.0).wrench).max() < 0.05
    fresh.reset()
    assert not fresh.drift.any()


def test_no_new_zero_in_contact_whose_beginning_was_seen() -> None:
    calibration, rig, rng = calibrated(6)
    R = still(rng, 1000)
    wrench = free(rig, R, rng)
    wrench[500:, 0] += 2.0
    compensator = _usual(calibration)
    compensator.run(wrench, R, times(1000))
    held = cw.Samples(wrench[600:], R[600:])
    with pytest.raises(InputError) as caught:
        compensator.zero(held)
    assert str(caught.value) == (
        "no new zero: in contact since t = 100.5 s, expected a free tool; let go of it, or, if nothing touches it, "
        "reset() first"
    )
    compensator.reset()
    assert compensator.zero(held).shift[0] == pytest.approx(2.0, abs=0.2)


def test_no_new_zero_while_moving_scattering_or_with_too_few_samples() -> None:
    calibration, rig, rng = calibrated(7)
    compensator = _usual(calibration)
    R = still(rng, 400)
    good = free(rig, R, rng)

    def refusal(samples: cw.Samples) -> str:
        with pytest.raises(InputError) as caught:
            compensator.zero(samples)
        assert not compensator.drift.any()
        return str(caught.value)

    turning = swinging(rng, 400)
    assert refusal(cw.Samples(free(rig, turning, rng), turning)).startswith("no new zero: the arm turns by ")
    shaken = good.copy()
    shaken[:, 3] += 0.02 * np.sin(np.arange(400))
    found = refusal(cw.Samples(shaken, R))
    assert found.startswith("no new zero: tx scatters 7.")
    assert found.endswith(
        " times its noise, expected at most 2.2; keep everything away from the tool, and the arm still"
    )
    touched = good.copy()
    touched[200:, 2] += 0.06
    assert refusal(cw.Samples(touched, R)).startswith("no new zero: fz moves by 1")
    assert refusal(cw.Samples(good[:9], R[:9])) == ("no new zero: found 9 samples, expected at least 10 at rest")
    compensator.zero(cw.Samples(good, R))


@pytest.mark.parametrize(("rows", "push", "refused"), [(slice(60, 61), 0.0, False), (slice(200, 400), 1.0, True)])
def test_a_coarse_and_quiet_sensor_between_two_steps_gets_a_new_zero(rows: slice, push: float, refused: bool) -> None:
    """Steps of 0.2 N, noise of 0.03 N: a load halfway between two of them, and on one but for a single row."""
    calibration, rig, rng = calibrated(8)
    R = still(rng, 400)
    coarse = 0.2 * np.round(free(rig, R, rng) / 0.2)
    coarse[:] = coarse[0]
    coarse[:, 0] += 0.2 * (rng.random(400) < 0.5)
    coarse[rows, 1] += 0.2 + push
    compensator = _usual(calibration)
    if not refused:
        assert np.isfinite(compensator.zero(cw.Samples(coarse, R)).shift).all()
        return
    with pytest.raises(InputError, match="no new zero: fy moves by "):
        compensator.zero(cw.Samples(coarse, R))


def test_a_contact_that_grows_slowly_is_learned_as_drift_and_one_that_comes_quickly_is_not() -> None:
    """What the page says that cannot be told."""
    calibration, rig, rng = calibrated(8)
    n = 30_000
    R = still(rng, n)
    for seconds, learned in ((25.0, True), (0.02, False)):
        wrench = free(rig, R, rng)
        wrench[1000:, 2] += np.minimum(np.arange(n - 1000) / (seconds * RATE), 1.0)
        compensator = cw.Compensator(calibration, rate=RATE, noise=NOISE, drift=40.0 * TYPICAL_DRIFT)
        batch = compensator.run(wrench, R, times(n))
        assert bool(batch.contact[-1] == 0) is learned
        assert bool(abs(compensator.drift[2]) > 0.8) is learned


def test_random_orientations_of_a_batch_are_taken_as_they_are() -> None:
    """Jumps from one orientation to another, as in a table of poses, are refused nowhere and compensated right."""
    calibration, rig, rng = calibrated(9, exact=True)
    R = random_rotations(50, rng)
    batch = _usual(calibration, rate=None).run(readings(rig, R), R, np.arange(50.0) * 0.1)
    assert np.abs(batch.wrench).max() < 1e-6
    assert batch.valid.all()
