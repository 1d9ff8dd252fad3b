"""The Compensator without a stated noise: learned from free samples or known from still segments, white and 1/f; what a
strong push leaves; and contacts that do not change.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from importlib.util import find_spec
from typing import Any

import numpy as np
import pytest

import contactwrench as cw
from contactwrench.errors import InputError
from contactwrench.samples.still_noise import still_noise_of
from tests.support.live import RATE, calibrated, free, still, swinging, times
from tests.support.rigs import NOISE
from tests.support.world import Array, random_rotations, readings

LEARNS = "noise unknown: learned from the first second of free samples, until then no contact is judged"


def _compensator(calibration: cw.Calibration, **settings: Any) -> cw.Compensator:
    return cw.Compensator(calibration, **({"rate": RATE} | settings))


def test_without_a_known_noise_no_contact_is_judged_for_a_second() -> None:
    calibration, rig, rng = calibrated(1)
    assert calibration.still_noise is None
    n = 2500
    R = swinging(rng, n)
    wrench = free(rig, R, rng)
    wrench[1800:2200, 1] += 1.0
    compensator = _compensator(calibration)
    batch = compensator.run(wrench, R, times(n))
    assert batch.valid.all()
    assert set(batch.reason[:999]) == {LEARNS}
    assert batch.reason[999] == (
        "noise learned: from 1 s of samples that were taken for free; state noise where they were not"
    )
    assert np.flatnonzero([reason is not None for reason in batch.reason[1000:]]).size == 1
    assert (batch.contact[:1000] == -1).all()
    assert np.isnan(batch.statistic[:1000]).all()
    assert np.isnan(batch.std[:1000]).all()
    assert np.isfinite(batch.std[1001:]).all()
    assert not batch.contact[1000:1800].any()
    assert batch.contact[1810:2200].all()
    assert np.sqrt(batch.std[-1] ** 2 - calibration.wrench_std(R[-1]) ** 2) == pytest.approx(NOISE, rel=0.3)
    sample = _compensator(calibration)(wrench[0], R[0], 0.0)
    assert (sample.contact, sample.reason, sample.valid) == (None, LEARNS, True)
    stated = _compensator(calibration, noise=NOISE).run(wrench[:5], R[:5], times(5))
    assert set(stated.reason) == {None}


def test_slow_samples_take_longer_to_learn_from() -> None:
    calibration, rig, rng = calibrated(2)
    R = still(rng, 100)
    batch = _compensator(calibration, rate=None).run(free(rig, R, rng), R, np.arange(100) / 10.0)
    assert np.flatnonzero(batch.contact == 0)[0] == 50
    assert str(batch.reason[49]).startswith("noise learned: from 5 s")
    assert str(batch.reason[99]).startswith("noise learned: from 5 s")


def test_a_new_zero_before_the_noise_is_learned_stays() -> None:
    """Also where the poses are means, with less noise than a sample."""
    calibration, rig, rng = calibrated(3)
    R = still(rng, 1500)
    wrench = free(rig, R, rng, noise=10.0) + 2.0 * np.ones(6)
    compensator = _compensator(calibration)
    compensator.run(wrench[:100], R[:100], times(100))
    compensator.zero(cw.Samples(wrench[:100], R[:100]))
    batch = compensator.run(wrench[100:], R[100:], times(1500)[100:])
    assert not (batch.contact == 1).any()
    assert np.nanmax(np.abs(batch.wrench / batch.std)) < 6.5


@pytest.mark.slow
@pytest.mark.skipif(find_spec("numba") is None, reason="numba is not installed")
@pytest.mark.parametrize("rate", [200.0, None])
def test_compiled_learns_as_plain_does(rate: float | None) -> None:
    """To the last bit, batches and calls, through learning, what a push leaves, a constant contact."""
    calibration, rig, rng = calibrated(4)
    n = 3200
    R, t = still(rng, n), times(n, 200.0)
    wrench = free(rig, R, rng)
    wrench[300:400, 2] += 30.0
    wrench[400:, 2] += 0.08
    wrench[800:3000, 0] += 1.0
    plain, compiled, single = (_compensator(calibration, rate=rate, lowpass=20.0, fast=f) for f in (False, True, True))
    one, other = plain.run(wrench, R, t), compiled.run(wrench, R, t)
    for name in ("wrench", "std", "valid", "contact", "statistic", "threshold", "reason"):
        assert np.array_equal(getattr(one, name), getattr(other, name), equal_nan=name not in ("reason",)), name
    assert np.array_equal(plain.drift, compiled.drift)
    assert plain.drift[2] > 0.03
    assert "contact or bias: nothing has changed for 10 s; zero() where nothing touches" in one.reason
    for k in range(600):
        sample = single(wrench[k], R[k], t[k])
        assert np.array_equal(sample.wrench, one.wrench[k])
        assert sample.reason == one.reason[k]


def _one_over_f(rng: np.random.Generator, n: int) -> Array:
    """1/f noise (n, 6) by its spectrum, with a std of 1 within a minute at 1 kHz."""
    f = np.fft.rfftfreq(2 * n, 1.0 / RATE)
    f[0] = np.inf
    drawn = rng.normal(size=(len(f), 6, 2)) @ np.array([1.0, 1.0j])
    spectrum = np.sqrt(2 * n * RATE / 4.0 / np.log(30_000.0) / f)
    noise: Array = np.fft.irfft(drawn * spectrum[:, None], 2 * n, axis=0)[:n]
    return noise


@cache
def _from_stops(seed: int, slow: float) -> tuple[cw.Calibration, Array, Array]:
    """A calibration from 24 stops of 2 s with white noise and `slow` times as much 1/f noise; orientations and readings
    of the 20 s that follow.
    """
    rig, rng, live = calibrated(seed)[1], np.random.default_rng((seed, 5)), 20_000
    n, R = 2000, random_rotations(24, rng)
    noise = NOISE * (rng.normal(size=(24 * n + live, 6)) + slow * _one_over_f(rng, 24 * n + live))
    rows = readings(rig, R)[:, None] + noise[: 24 * n].reshape(24, n, 6)
    calibration = cw.calibrate(cw.Samples(rows.reshape(-1, 6), R.repeat(n, axis=0)), "mount")
    swung = swinging(rng, live)
    learned = replace(calibration, still_noise=still_noise_of(list(rows), 1.0 / RATE))
    return learned, swung, readings(rig, swung) + noise[24 * n :]


@pytest.mark.slow
@pytest.mark.parametrize("drift", [None, 0.05])
@pytest.mark.parametrize("slow", [0.0, 0.2, 1.0])
def test_one_over_f_noise_behind_a_low_pass_is_no_contact(slow: float, drift: float | None) -> None:
    """With the calibration's own noise; taken for white, the second makes 4e-3, and the third 0.5 of the samples."""
    calibration, R, wrench = _from_stops(0, slow)
    batch = cw.Compensator(calibration, rate=RATE, lowpass=20.0, drift=drift).run(wrench, R, times(len(R)))
    assert not batch.contacts
    assert 0.6 < np.sqrt(np.mean((batch.wrench / batch.std) ** 2)) < 1.3
    assert np.mean(batch.statistic > batch.threshold) < 1e-3


@pytest.mark.parametrize("drift", [None, 0.05])
@pytest.mark.parametrize("memory", [0.3, 5.0, np.inf])
def test_what_a_strong_push_leaves_ends_with_it(memory: float, drift: float | None) -> None:
    """30 N again and again, which leave 0.1 to 0.3 % of themselves, that decays or adds up: every contact ends within a
    second, and nothing of a push is learned.
    """
    calibration, rig, rng = calibrated(6)
    n = 40_000
    R, force = swinging(rng, n), np.zeros((n, 6))
    for start in range(2000, n - 2000, 3000):
        push = rng.normal(size=3)
        push *= 30.0 / np.linalg.norm(push)
        force[start : start + 1000, :3] += push
        left = rng.uniform(0.001, 0.003) * push
        force[start + 1000 :, :3] += left * np.exp(-np.arange(n - start - 1000)[:, None] / RATE / memory)
    compensator = cw.Compensator(calibration, rate=RATE, noise=NOISE, lowpass=20.0, drift=drift)
    batch = compensator.run(free(rig, R, rng) + force, R, times(n))
    assert len(batch.contacts) == 12
    for start, contact in zip(range(2000, n - 2000, 3000), batch.contacts, strict=True):
        assert contact.release == pytest.approx(101.0 + start / RATE, abs=0.2)
        assert batch.contact[start + 50 : start + 1000].all()
    assert np.abs(compensator.drift - force[-1]).max() < 0.05


def test_a_light_contact_after_a_strong_push_is_neither_lost_nor_learned() -> None:
    calibration, rig, rng = calibrated(7)
    n = 60_000
    R = still(rng, n)
    wrench = free(rig, R, rng)
    wrench[2000:3000, 2] += 30.0
    wrench[6000:, 0] += 0.6
    compensator = cw.Compensator(calibration, rate=RATE, noise=NOISE, lowpass=20.0, drift=0.05)
    batch = compensator.run(wrench, R, times(n))
    assert batch.contact[6100:].all()
    assert abs(compensator.drift[0]) < 0.05


def test_a_contact_that_never_changes_may_be_a_bias_that_stepped() -> None:
    calibration, rig, rng = calibrated(8)
    n = 15_000
    R = still(rng, n)
    wrench = free(rig, R, rng)
    wrench[1000:, 1] += 1.0
    compensator = cw.Compensator(calibration, rate=RATE, noise=NOISE)
    early = compensator.run(wrench[:6000], R[:6000], times(n)[:6000])
    assert set(early.reason) == {None}
    held = cw.Samples(wrench[5000:6000], R[5000:6000])
    with pytest.raises(InputError, match="no new zero: in contact since"):
        compensator.zero(held)
    batch = compensator.run(wrench[6000:], R[6000:], times(n)[6000:])
    said = [reason for reason in batch.reason if reason]
    assert 3.7 < len(said) / RATE < 4.0
    assert said[0] == "contact or bias: nothing has changed for 10 s; zero() where nothing touches"
    assert (batch.contact == 1).all()
    assert batch.valid.all()
    assert compensator.zero(held).shift[1] == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize("share", [0.0, 0.01])
def test_a_zero_that_moves_while_the_arm_does_may_be_one(share: float) -> None:
    """Somebody tares the sensor on the way: a contact from then on, the same in sensor axes however the arm turns, but
    for a gain that is 1 % off.
    """
    calibration, rig, rng = calibrated(9)
    n = 15_000
    R = swinging(rng, n)
    wrench = free(rig, R, rng)
    wrench += share * (readings(rig, R) - rig.bias)
    wrench[1000:] -= wrench[1000]
    batch = cw.Compensator(calibration, rate=RATE, noise=NOISE).run(wrench, R, times(n))
    assert batch.contact[1100:].all()
    assert batch.reason[10_500] is None
    assert batch.reason[-1] == "contact or bias: nothing has changed for 14 s; zero() where nothing touches"
    assert batch.valid.all()


@pytest.mark.parametrize("what", ["a hand", "a steady hand", "the arm turns"])
def test_a_contact_that_changes_is_one(what: str) -> None:
    """By a hand, if by 2 %, or a weight, which turns in sensor axes as the arm does."""
    calibration, rig, rng = calibrated(9)
    n = 15_000
    R = swinging(rng, n) if what == "the arm turns" else still(rng, n)
    wrench = free(rig, R, rng)
    wrench[1000:, :3] += (R @ rig.R_flange_sensor)[1000:, 2]
    if what == "a hand":
        wrench[:, 1] += 0.3 * np.sin(0.5 * times(n))
    if what == "a steady hand":
        wrench[1000:, 2] += 19.0 + 0.4 * np.sin(0.5 * times(n))[1000:]
    batch = cw.Compensator(calibration, rate=RATE, noise=NOISE).run(wrench, R, times(n))
    assert batch.contact[1100:].all()
    assert set(batch.reason) == {None}


def test_a_touch_in_the_first_second_does_not_stay_in_the_noise() -> None:
    """It made no contact, and the noise a hundred times too large, for ever."""
    calibration, rig, rng = calibrated(9)
    n = 12_000
    R, pushed = still(rng, n), np.zeros((n, 6))
    pushed[300:1300, 2] = 10.0
    pushed[11_000:, 0] = 1.0
    batch = cw.Compensator(calibration, rate=RATE, lowpass=20.0).run(free(rig, R, rng) + pushed, R, times(n))
    assert batch.std[2000, 2] > 10.0 * NOISE[2]
    assert (batch.std[10_000:] < 2.0 * NOISE).all()
    assert batch.contact[11_100:].all()
    assert not batch.contact[9000:11_000].any()
