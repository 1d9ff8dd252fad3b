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


@pytest.mark.parametrize(("force", "drift"), [(0.5, 0.2), (3.0, 2.0)])
def test_a_steady_force_that_was_found_stays_a_contact(force: float, drift: float) -> None:
    """However badly the bias may be known by then: nothing has changed that would say that it is over."""
    calibration, rig, rng = calibrated(20)
    n, begin, end = int(1000 * RATE), int(60 * RATE), int(960 * RATE)
    R, pressed = still(rng, n), np.zeros((n, 6))
    pressed[begin:end, 2] = force
    compensator = cw.Compensator(calibration, rate=RATE, noise=NOISE, lowpass=20.0, drift=drift)
    batch = compensator.run(free(rig, R, rng) + pressed, R, stamps(n))
    assert (batch.contact[begin + 30 : end] == 1).all()
    assert not batch.contact[end + 20 :].any()
    assert (np.abs(batch.wrench - pressed)[end + 20 :] < 5.0 * batch.std[end + 20 :]).all()


@pytest.mark.parametrize("seconds", [0.5, 2.0, 5.0])
def test_a_slow_end_of_a_long_contact_is_not_learned(seconds: float) -> None:
    """As its last newton passes for free beside what a bias may have drifted in half an hour."""
    calibration, rig, rng = calibrated(21)
    n, begin, end, lifts = int(2000 * RATE), int(60 * RATE), int(1860 * RATE), int(seconds * RATE)
    R, pressed = still(rng, n), np.zeros((n, 6))
    pressed[begin:end, 2] = 2.0
    pressed[end : end + lifts, 2] = np.linspace(2.0, 0.0, lifts)
    compensator = cw.Compensator(calibration, rate=RATE, noise=NOISE, lowpass=20.0, drift=0.2)
    batch = compensator.run(free(rig, R, rng) + pressed, R, stamps(n))
    after = end + lifts + int(3.0 * RATE)
    assert not batch.contact[after:].any()
    assert (np.abs(batch.wrench[after:].mean(axis=0)) < batch.std[after]).all()


@pytest.mark.parametrize("seed", [22, 25, 28])
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


def test_a_stream_that_slows_down_below_the_filter_goes_on_as_before() -> None:
    calibration, rig, rng = calibrated(24)
    n = 4000
    t = np.r_[np.arange(1500) / 1000.0, 1.5 + np.arange(n - 1500) / 30.0]
    R = still(rng, n)
    batch = cw.Compensator(calibration, noise=NOISE, lowpass=20.0).run(free(rig, R, rng), R, t)
    assert np.isfinite(batch.wrench[2000:]).all()
