"""A pose that comes late: the turn is carried on, and what that cannot know of how the arm turns meanwhile counts."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.compensate.test_delay_in_std import compensator, heavy, turning
from tests.support.live import free, still, times
from tests.support.rigs import NOISE
from tests.support.world import Array


@pytest.mark.parametrize("lowpass", [None, 20.0])
@pytest.mark.parametrize("late", [0.005, 0.02, 0.06])
def test_what_is_carried_on_counts_as_far_as_it_is_off(late: float, lowpass: float | None) -> None:
    calibration, rig, rng = heavy(0)
    batch = compensator(calibration, delay=-late, lowpass=lowpass).run(*turning(rig, rng, -late))
    off, largest = (batch.wrench / batch.std)[300:], float(np.abs(batch.wrench[300:, :3]).max() / NOISE[0])
    assert not (batch.contact == 1).any()
    of_axis = np.sqrt(np.mean(np.square(off), axis=0))
    assert of_axis.min() > 0.7
    assert of_axis.max() < 1.3
    assert np.abs(off).max() < 6.0
    if late == 0.06:
        assert largest > 3.0  # which a std as at rest would call eight of its own behind the low-pass


def test_torques_count_as_forces_do() -> None:
    calibration, rig, rng = heavy(1)
    wrench, R, t = turning(rig, rng, -0.06)
    batch = compensator(calibration, delay=-0.06, lowpass=20.0).run(wrench, R, t)
    grown = (batch.std[300:] / batch.std[300:].min(axis=0)).max(axis=0)
    lever = np.linalg.norm(calibration.B[3:, :3], axis=1) / np.linalg.norm(calibration.B[:3, :3])
    assert grown[:3].max() > 3.0
    assert (grown[3:][lever > 0.05] > 1.5).all()


@pytest.mark.parametrize("along", [0, 1, 2])
def test_a_push_is_felt_all_the_same(along: int) -> None:
    """Along the sensor's axes, one of which at least the arm turns."""
    calibration, rig, rng = heavy(2)
    wrench, R, t = turning(rig, rng, -0.02)
    wrench[1500:1900, along] += 10.0 * NOISE[0]
    batch = compensator(calibration, delay=-0.02, lowpass=20.0).run(wrench, R, t)
    assert (batch.contact[1550:1890] == 1).all()
    assert not (batch.contact[:1500] == 1).any()


def test_an_arm_at_rest_loses_nothing() -> None:
    calibration, rig, rng = heavy(3)
    R = still(rng, 1000)
    wrench = free(rig, R, rng)
    late, known = (
        compensator(calibration, delay=delay, lowpass=20.0).run(wrench, R, times(1000)) for delay in (-0.06, 0.0)
    )
    assert np.array_equal(late.std[500:], known.std[500:])
    assert late.valid[120:].all()
    assert not late.valid[:119].any()


def test_where_the_arm_has_stopped_the_std_is_that_of_rest_again() -> None:
    calibration, rig, rng = heavy(4)
    wrench, R, t = turning(rig, rng, 0.0)
    R[1500:] = R[1500]
    wrench[1500:] = free(rig, R[1500:], rng)
    batch = compensator(calibration, delay=-0.06, lowpass=20.0).run(wrench, R, t)
    assert batch.std[1000:1500].max() > 2.0 * batch.std[2500:].max()
    assert batch.std[2500:] == pytest.approx(np.broadcast_to(batch.std[-1], (500, 6)), rel=1e-3)


def test_nothing_is_learned_of_the_bias_from_it() -> None:
    calibration, rig, rng = heavy(5)
    learned: dict[float, Array] = {}
    for late in (0.0, 0.06):
        told = compensator(calibration, delay=-late, lowpass=20.0, drift=0.5)
        told.run(*turning(rig, rng, -late))
        learned[late] = told.drift
    assert np.abs(learned[0.06][:3]).max() < 0.5 * NOISE[0]


@pytest.mark.parametrize("late", [0.004, 0.06])
def test_calls_batches_plain_and_compiled_say_the_same(late: float) -> None:
    calibration, rig, rng = heavy(0)
    wrench, R, t = (rows[:600] for rows in turning(rig, rng, -late))
    settings: dict[str, Any] = {"delay": -late, "delay_std": 0.003, "lowpass": 20.0, "sensor_filter": 50.0}
    plain, whole, singly = (compensator(calibration, fast=fast, **settings) for fast in (False, None, None))
    one, other = plain.run(wrench, R, t), whole.run(wrench, R, t)
    for name in ("wrench", "std", "statistic", "contact"):
        assert np.array_equal(getattr(one, name), getattr(other, name), equal_nan=True)
    for k in range(len(t)):
        assert np.array_equal(singly(wrench[k], R[k], float(t[k])).std, one.std[k], equal_nan=True)


def test_a_wrench_that_lags_has_two_poses_and_nothing_to_count() -> None:
    calibration, rig, rng = heavy(1)
    batch = compensator(calibration, delay=0.05).run(*turning(rig, rng, 0.05))
    assert batch.std[100:].max(axis=0) == pytest.approx(batch.std[100:].min(axis=0), rel=1e-3)
