"""What free readings teach of the bias, where a contact lasts long, ends slowly, or was the tool's own inertia."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import contactwrench as cw
from tests.support.live import calibrated, free, still
from tests.support.rigs import NOISE
from tests.support.world import Array, random_rotations

RATE = 100.0


def stamps(n: int) -> Array:
    return np.arange(n) / RATE


@pytest.mark.parametrize(("force", "drift"), [(0.5, 0.4), (3.0, 4.0)])
def test_a_steady_force_that_was_found_stays_a_contact(force: float, drift: float) -> None:
    """However badly the bias may be known by then: nothing has changed that would say that it is over. Four minutes are
    a quarter of an hour of a sensor that drifts half as much.
    """
    calibration, rig, rng = calibrated(20)
    n, begin, end = int(290 * RATE), int(60 * RATE), int(285 * RATE)
    R, pressed = still(rng, n), np.zeros((n, 6))
    pressed[begin:end, 2] = force
    compensator = cw.Compensator(calibration, rate=RATE, noise=NOISE, lowpass=20.0, drift=drift)
    batch = compensator.run(free(rig, R, rng) + pressed, R, stamps(n))
    assert (batch.contact[begin + 30 : end] == 1).all()
    assert not batch.contact[end + 20 :].any()
    assert (np.abs(batch.wrench - pressed)[end + 20 :] < 5.0 * batch.std[end + 20 :]).all()


@pytest.mark.parametrize("seconds", [0.5, 5.0])
def test_a_slow_end_of_a_long_contact_is_not_learned(seconds: float) -> None:
    """As its last newton passes for free beside what a bias may have drifted: in five minutes as much as another does
    in half an hour.
    """
    calibration, rig, rng = calibrated(21)
    n, begin, end, lifts = int(400 * RATE), int(60 * RATE), int(348 * RATE), int(seconds * RATE)
    R, pressed = still(rng, n), np.zeros((n, 6))
    pressed[begin:end, 2] = 2.0
    pressed[end : end + lifts, 2] = np.linspace(2.0, 0.0, lifts)
    compensator = cw.Compensator(calibration, rate=RATE, noise=NOISE, lowpass=20.0, drift=0.5)
    batch = compensator.run(free(rig, R, rng) + pressed, R, stamps(n))
    after = end + lifts + int(3.0 * RATE)
    assert not batch.contact[after:].any()
    assert (np.abs(batch.wrench[after:].mean(axis=0)) < batch.std[after]).all()


@pytest.mark.parametrize("seed", [22, 28])
def test_what_a_move_exerts_is_not_learned_at_its_end(seed: int) -> None:
    """An arm that goes from rest to rest, whose tool's inertia nobody knows, has a contact on its way, and none where
    it stands, which a rough calibration would let it learn.
    """
    _, rig, rng = calibrated(seed)
    poses = random_rotations(12, rng)
    calibration = cw.calibrate(cw.Samples(free(rig, poses, rng, 10.0), poses), "mount")
    way, leg = random_rotations(9, rng), int(4.0 * RATE)
    s = np.clip((np.arange(leg) / RATE - 2.0) / 2.0, 0.0, 1.0)
    share, pulse = s**3 * (10.0 - 15.0 * s + 6.0 * s**2), 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) / 5.8
    R, inertia = [], []
    for before, after in pairwise(way):
        turn = (Rotation.from_matrix(before).inv() * Rotation.from_matrix(after)).as_rotvec()
        R.append((Rotation.from_matrix(before) * Rotation.from_rotvec(share[:, None] * turn)).as_matrix())
        push = np.r_[rng.normal(size=3), 0.0, 0.0, 0.0]
        inertia.append(10.0 * pulse[:, None] * push / np.linalg.norm(push))
    orientation = np.concatenate(R)
    wrench = free(rig, orientation, rng) + np.concatenate(inertia)
    batch = cw.Compensator(calibration, rate=RATE, noise=NOISE, lowpass=20.0).run(
        wrench, orientation, stamps(len(wrench))
    )
    stands = np.tile((np.arange(leg) > 0.3 * RATE) & (np.arange(leg) < 2.0 * RATE), len(way) - 1)
    assert (batch.contact[~stands] == 1).mean() > 0.2
    assert (batch.contact[stands] == 1).mean() < 0.02
    left = calibration.compensate(wrench, orientation)
    assert np.abs(batch.wrench[stands, :3]).mean() < np.abs(left[stands, :3]).mean()


@pytest.mark.parametrize("queued", [30, 100, 1000])
def test_the_rate_is_that_of_most_readings_not_of_a_queue_that_was_waiting(queued: int) -> None:
    calibration, rig, rng = calibrated(23)
    n = 6000
    t = np.arange(n) / 1000.0
    t[:queued] = t[queued] - 2e-5 * np.arange(queued, 0, -1)
    R, pushed = still(rng, n), np.zeros((n, 6))
    pushed[4500:5000, 0] = 5.0
    told = cw.Compensator(calibration, rate=1000.0, noise=NOISE, lowpass=20.0)
    found = cw.Compensator(calibration, noise=NOISE, lowpass=20.0)
    wrench = free(rig, R, rng) + pushed
    one, other = (each.run(wrench, R, t) for each in (told, found))
    assert np.abs(other.wrench - one.wrench)[4000:].max() < 0.02
    assert (other.contact == one.contact)[4000:].all()


def test_a_stream_that_slows_down_below_the_filter_goes_on() -> None:
    calibration, rig, rng = calibrated(24)
    n = 4000
    t = np.r_[np.arange(1500) / 1000.0, 1.5 + np.arange(n - 1500) / 30.0]
    R = still(rng, n)
    batch = cw.Compensator(calibration, noise=NOISE, lowpass=20.0).run(free(rig, R, rng), R, t)
    assert np.isfinite(batch.wrench[2000:]).all()
    assert batch.valid[2000:].mean() > 0.99
    assert not (batch.contact[2000:] == 1).any()


@pytest.mark.parametrize("rate", [50.0, 1000.0])
def test_a_rate_that_is_mended_keeps_the_noise_that_was_learned(rate: float) -> None:
    calibration, rig, rng = calibrated(25)
    assert calibration.still_noise is None
    n = int(8.0 * rate)
    t = np.arange(n) / rate
    t[:30] = t[30] - 2e-5 * np.arange(30, 0, -1)
    R = still(rng, n)
    batch = cw.Compensator(calibration, lowpass=10.0).run(free(rig, R, rng), R, t)
    assert not (batch.contact[n // 2 :] == 1).any()
    z = batch.wrench[n // 2 :] / batch.std[n // 2 :]
    assert 0.3 < np.sqrt(np.mean(z**2)) < 1.3


def test_the_bias_is_followed_between_contacts_of_a_tool_that_shakes() -> None:
    """Whose free readings never stay the same."""
    calibration, rig, rng = calibrated(1)
    rate, n = 1000.0, 200_000
    t = np.arange(n) / rate
    moved = np.cumsum(rng.normal(size=n)) * 2.0 / np.sqrt(3600.0 * rate)
    R, pushed, shakes = still(rng, n), np.zeros((n, 6)), np.zeros((n, 6))
    pushed[(t % 20.0 > 10.0) & (t % 20.0 < 12.0), 2] = 1.0
    shakes[:, 2] = 0.05 * np.sin(2.0 * np.pi * 3.0 * t)
    wrench = free(rig, R, rng) + pushed + shakes
    wrench[:, 2] += moved
    compensator = cw.Compensator(calibration, rate=rate, noise=NOISE, lowpass=20.0, drift=2.0)
    batch = compensator.run(wrench, R, t)
    late = t > 100.0
    assert (batch.contact[late & (pushed[:, 2] > 0.0)] == 1).mean() > 0.9
    assert np.sqrt(np.mean((batch.wrench - pushed - shakes)[late, 2] ** 2)) < 0.15


def test_a_contact_that_must_be_quiet_for_long_ends_all_the_same() -> None:
    """Though the bias moved meanwhile by less than it may have."""
    calibration, rig, rng = calibrated(26)
    n, begin, end = int(230 * RATE), int(60 * RATE), int(210 * RATE)
    R, pressed = still(rng, n), np.zeros((n, 6))
    pressed[begin:end, 2] = 3.0
    moved = 0.2 * np.clip((np.arange(n) - begin) / (end - begin), 0.0, 1.0)[:, None] * np.eye(6)[2]
    for wait in (0.005, 0.5):
        compensator = cw.Compensator(
            calibration, rate=RATE, noise=NOISE, lowpass=20.0, drift=1.2, minimum_duration=wait
        )
        batch = compensator.run(free(rig, R, rng) + pressed + moved, R, stamps(n))
        assert (batch.contact[begin + 60 : end] == 1).all()
        assert not batch.contact[end + int(2.0 * RATE) :].any()


def test_what_is_learned_late_makes_no_contact_behind_a_low_pass() -> None:
    """At a high rate `std` falls at once, and a filter that lags behind would stand out."""
    calibration, rig, rng = calibrated(1)
    n, end = 20_000, 9000
    t, R, pushed, left = np.arange(n) / 1000.0, still(rng, n), np.zeros((n, 6)), np.zeros((n, 6))
    pushed[3000:end, 2] = 300.0
    crept = np.minimum(np.maximum(t - 0.001 * end, 0.0), 60.0)
    left[end:, 2] = 0.9 * (1.0 - 0.5 * np.log1p(crept[end:] / 0.1) / np.log(601.0))
    compensator = cw.Compensator(calibration, rate=1000.0, noise=NOISE, lowpass=20.0)
    batch = compensator.run(free(rig, R, rng) + pushed + left, R, t)
    assert len(batch.contacts) == 1
