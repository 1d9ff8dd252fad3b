"""A delay is known within its std: what that leaves of the weight counts while the arm turns, and only then."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import norm

import contactwrench as cw
from contactwrench.compensate.contact_wrenches import ContactWrenches
from tests.support.live import RATE, free, still, times
from tests.support.rigs import NOISE
from tests.support.world import Array, Rig, noisy_readings, random_rig, random_rotations, readings

STD = 0.02
"""s, which at 1 rad/s makes ten noises of the weight."""


def heavy(seed: int) -> tuple[cw.Calibration, Rig, np.random.Generator]:
    """A calibration of a tool of 500 noises on any mounting, exact; what is true; what drew it."""
    return *_heavy(seed)[:2], deepcopy(_heavy(seed)[2])


@cache
def _heavy(seed: int) -> tuple[cw.Calibration, Rig, np.random.Generator]:
    rng = np.random.default_rng((seed, 20261126))
    rig = replace(random_rig(rng), weight=500.0 * float(NOISE[0]))
    R = random_rotations(24, rng)
    return cw.calibrate(cw.Samples(readings(rig, R), R), "mount", noise=NOISE), rig, rng


def compensator(calibration: cw.Calibration, **settings: Any) -> cw.Compensator:
    return cw.Compensator(calibration, rate=RATE, noise=NOISE, **settings)


def turning(rig: Rig, rng: np.random.Generator, late: float, held: int = 1) -> tuple[Array, Array, Array]:
    """Readings (n, 6) `late` s behind orientations, each of which stands for `held` samples, of an arm that turns to
    and fro by up to 1 rad/s about two axes, and stamps.
    """
    t = times(3000)
    begin, axes = Rotation.random(random_state=rng), rng.normal(size=(2, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)

    def course(at: Array) -> Array:
        angles = np.stack([np.sin(2.0 * at), 0.7 * np.sin(1.3 * at + 1.0)], axis=1)
        matrices: Array = (begin * Rotation.from_rotvec(0.5 * angles @ axes)).as_matrix()
        return matrices

    return noisy_readings(rig, course(t - late), NOISE, rng), course(t)[np.arange(len(t)) // held * held], t


def off(batch: ContactWrenches) -> Array:
    """In units of the std, behind the first moments."""
    return np.asarray((batch.wrench / batch.std)[100:])


@pytest.mark.parametrize(("seed", "held"), [(0, 1), (1, 8), (2, 8)])
def test_it_covers_what_such_delays_leave(seed: int, held: int) -> None:
    calibration, rig, rng = heavy(seed)
    for late in (STD, -STD, 1.5 * STD):
        batch = compensator(calibration, delay=0.0, delay_std=STD).run(*turning(rig, rng, late, held))
        assert np.abs(off(batch)).max() < 6.0
        assert not (batch.contact[2 * held :] == 1).any()


def test_left_out_it_is_taken_for_contact() -> None:
    calibration, rig, rng = heavy(1)
    batch = compensator(calibration, delay=0.0).run(*turning(rig, rng, STD))
    assert np.abs(off(batch)).max() > 8.0
    assert (batch.contact == 1).any()


@pytest.mark.parametrize(("seed", "held"), [(0, 8), (1, 20)])
def test_a_pose_that_is_held_is_as_old_as_it_is(seed: int, held: int) -> None:
    """From the second one on: by it the arm is seen to turn."""
    calibration, rig, rng = heavy(seed)
    wrench, R, t = turning(rig, rng, 0.0, held)
    batch = compensator(calibration).run(wrench, R, t)
    assert np.abs(off(batch)).max() < 6.0
    assert not (batch.contact[2 * held :] == 1).any()
    assert np.abs(batch.wrench[100:, :3]).max() > 4.0 * NOISE[0]
    assert batch.std[:, 0].min() == pytest.approx(NOISE[0], rel=0.01)


def test_what_it_covers_is_as_much_as_there_is() -> None:
    """Delays spread as the std says, by quantiles: the contact wrench over its std is as of a standard normal, and the
    statistic as of chi-square with 6 degrees of freedom.
    """
    z, statistic = [], []
    quantiles = norm.ppf((np.arange(12) + 0.5) / 12)
    for k, late in enumerate(STD * quantiles / np.std(quantiles)):
        calibration, rig, rng = heavy(k % 6)
        wrench, R, t = turning(rig, rng, float(late))
        batch = compensator(calibration, delay=0.0, delay_std=STD).run(wrench, R, t)
        z.append(np.mean(off(batch) ** 2))
        statistic.append(np.mean(batch.statistic[100:]))
    assert np.mean(z) == pytest.approx(1.0, abs=0.35)
    assert np.mean(statistic) == pytest.approx(6.0, abs=0.8)


def test_at_rest_it_counts_for_nothing() -> None:
    calibration, rig, rng = heavy(3)
    R = still(rng, 500)
    wrench = free(rig, R, rng)
    one, other = (compensator(calibration, delay_std=std).run(wrench, R, times(500)) for std in (None, 0.05))
    assert np.array_equal(one.std, other.std)
    assert one.statistic == pytest.approx(other.statistic, rel=1e-12)


def test_a_push_across_the_turn_is_found_all_the_same() -> None:
    calibration, rig, rng = heavy(5)
    wrench, R, t = turning(rig, rng, 0.0)
    pushed = slice(1500, 1900)
    wrench[pushed, :3] += 10.0 * NOISE[0] * (rig.down @ R[pushed] @ rig.R_flange_sensor)  # which no turn changes
    batch = compensator(calibration, delay=0.0, delay_std=5.0 * STD).run(wrench, R, t)
    assert (batch.contact[1550:1900] == 1).all()
    assert not (batch.contact[:1500] == 1).any()


def test_the_calibrations_own_counts_unless_another_is_stated() -> None:
    calibration, rig, rng = heavy(2)
    wrench, R, t = turning(rig, rng, 0.0)

    def added(of: float | None, std: float | None, **stated: Any) -> float:
        """What the std of the last forces has beside that at rest, s, with a calibration's delay `of`, and its std."""
        known = replace(calibration, delay=of, delay_std=std)
        without, told = (compensator(known, delay=0.0, **each).run(wrench, R, t) for each in ({}, {"delay_std": 0.01}))
        asked = compensator(known, **stated).run(wrench, R, t)
        of_one = np.sum(told.std[-500:] ** 2 - without.std[-500:] ** 2)
        return float(0.01 * np.sqrt(np.sum(asked.std[-500:] ** 2 - without.std[-500:] ** 2) / of_one))

    assert added(None, None) == 0.0
    assert added(0.03, 0.004) == pytest.approx(0.004, rel=0.1)  # made up for
    assert added(0.006, 0.004) == pytest.approx(np.hypot(0.006, 0.004), rel=0.02)  # not
    assert added(0.1, 1.0) == pytest.approx(0.05, rel=0.01)  # nothing is known of it: as delays usually are
    assert added(0.006, 0.004, delay=0.0) == 0.0
    assert added(0.006, 0.004, delay_std=0.02) == pytest.approx(0.02, rel=1e-6)


@pytest.mark.parametrize(("lowpass", "fast"), [(50.0, None), (5.0, False), (2.0, None)])
def test_behind_a_low_pass_it_is_as_late_as_the_contact_wrench(lowpass: float, fast: bool | None) -> None:
    calibration, rig, rng = heavy(2)
    settings: dict[str, Any] = {"rate": RATE, "noise": NOISE, "lowpass": lowpass, "fast": fast}
    for late, held in ((STD, 1), (0.0, 8)):
        wrench, R, t = turning(rig, rng, late, held)
        batch = cw.Compensator(calibration, delay=0.0, delay_std=late, **settings).run(wrench, R, t)
        begun = int(1.0 * RATE / lowpass) + 2 * held
        assert np.abs(batch.wrench / batch.std)[begun:].max() < 6.0
        assert not (batch.contact[begun:] == 1).any()


@pytest.mark.parametrize("delay", [0.004, 0.01, 0.03, -0.004, -0.01])
@pytest.mark.parametrize("held", [8, 20])
def test_a_pose_that_is_looked_up_or_carried_on_with_is_as_old_as_it_may_be(delay: float, held: int) -> None:
    calibration, rig, rng = heavy(3)
    batch = compensator(calibration, delay=delay).run(*turning(rig, rng, delay, held))
    assert np.abs((batch.wrench / batch.std)[200:]).max() < 6.0
    assert not (batch.contact[200:] == 1).any()


def test_nothing_is_learned_of_the_bias_while_it_decides() -> None:
    calibration, rig, rng = heavy(4)
    wrench, R, t = turning(rig, rng, 0.2 * STD)
    told, not_told = (compensator(calibration, delay=0.0, delay_std=std, drift=0.5) for std in (20.0 * STD, 0.0))
    for each in (told, not_told):
        each.run(wrench, R, t)
    assert np.abs(told.drift[:3]).max() < 0.1 * np.abs(not_told.drift[:3]).max()
