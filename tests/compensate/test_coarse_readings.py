"""Sensors whose steps are wider than their noise: what they are rounded by is another at another load, and no filter
and no learning at rest takes it off.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

import contactwrench as cw
from tests.support.rigs import NOISE
from tests.support.world import Array, Rig, noisy_readings, random_rig

RATE, REST, TURN = 100.0, 1.5, 1.0


def stop_and_go(rng: np.random.Generator, stops: int) -> tuple[Array, Array]:
    """Stamps (n,) and orientations (n, 3, 3) of an arm that rests at so many and turns smoothly between."""
    t = np.arange(0.0, stops * (REST + TURN), 1.0 / RATE)
    stop, within = np.divmod(t, REST + TURN)
    share = 0.5 - 0.5 * np.cos(np.pi * np.clip((within - REST) / TURN, 0.0, 1.0))
    course = Slerp(np.arange(stops + 1), Rotation.random(stops + 1, random_state=rng))
    return t, course(stop + share).as_matrix()


def rounded(rig: Rig, R: Array, rng: np.random.Generator, noises: float) -> Array:
    """Readings (n, 6) in steps of so many noises."""
    step = noises * NOISE
    return np.asarray(np.round(noisy_readings(rig, R, NOISE, rng) / step) * step)


def heavy(seed: int) -> tuple[Rig, np.random.Generator]:
    """A tool of some hundred steps on any mounting."""
    rng = np.random.default_rng((seed, 20261126))
    rig = random_rig(rng)
    return Rig(500.0 * float(NOISE[0]), rig.com, rig.bias, rig.R_flange_sensor, rig.down), rng


def calibrated(rig: Rig, rng: np.random.Generator, noises: float, as_table: bool) -> cw.Calibration:
    t, R = stop_and_go(rng, 16)
    if as_table:
        R = Rotation.random(16, random_state=rng).as_matrix()
        return cw.calibrate(cw.Samples(rounded(rig, R, rng, noises), R), "mount")
    return cw.calibrate(cw.Samples(rounded(rig, R, rng, noises), R, t), "mount")


@pytest.mark.parametrize(
    ("seed", "noises", "lowpass", "as_table"),  # any two of the last three in every combination
    [
        (2, 5.0, None, True),
        (1, 5.0, 5.0, False),
        (2, 10.0, None, False),
        (1, 10.0, 5.0, True),
        (0, 20.0, None, True),
        (0, 20.0, 5.0, False),
    ],
)
def test_a_free_tool_is_free_with_its_bias_followed(
    seed: int, noises: float, lowpass: float | None, as_table: bool
) -> None:
    rig, rng = heavy(seed)
    calibration = calibrated(rig, rng, noises, as_table)
    compensator = cw.Compensator(calibration, rate=RATE, lowpass=lowpass, drift=0.2)
    t, R = stop_and_go(rng, 12)
    batch = compensator.run(rounded(rig, R, rng, noises), R, t)
    assert np.nanmax(np.abs(batch.wrench / batch.std)) < 6.0
    assert not (batch.contact == 1).any()


def test_a_push_of_some_steps_is_found() -> None:
    rig, rng = heavy(4)
    calibration = calibrated(rig, rng, 10.0, as_table=False)
    compensator = cw.Compensator(calibration, rate=RATE, drift=0.2)
    t, R = stop_and_go(rng, 12)
    wrench, pushed = noisy_readings(rig, R, NOISE, rng), slice(1850, 1950)
    wrench[pushed, 1] += 40.0 * NOISE[1]
    step = 10.0 * NOISE
    batch = compensator.run(np.round(wrench / step) * step, R, t)
    assert (batch.contact[1852:1950] == 1).all()
    assert (batch.contact == 1).sum() < 110


def test_steps_that_the_noise_carries_over_count_for_nothing() -> None:
    """At rest, once the bias has been learned, the std falls as it does of a sensor without steps."""
    rig, rng = heavy(5)
    R = np.tile(Rotation.random(random_state=rng).as_matrix(), (1000, 1, 1))
    t = np.arange(1000) / RATE
    stds = []
    for noises in (1e-6, 1.0, 10.0):
        calibration = calibrated(rig, np.random.default_rng(1), noises, as_table=False)
        compensator = cw.Compensator(calibration, rate=RATE, lowpass=5.0, drift=0.05)
        stds.append(compensator.run(rounded(rig, R, np.random.default_rng(2), noises), R, t).std[-1, :3])
    assert stds[1] == pytest.approx(stds[0], rel=0.35)
    assert (stds[2] > 3.0 * stds[0]).all()


def test_readings_that_are_coarser_than_those_of_the_calibration_are_no_contact() -> None:
    """As where a driver rounds them: from the first step on that is seen."""
    rig, rng = heavy(20)
    calibration = calibrated(rig, rng, 1e-6, as_table=False)
    t, R = stop_and_go(rng, 12)
    wrench = rounded(rig, R, rng, 5.0)
    for drift in (None, 0.2):
        batch = cw.Compensator(calibration, rate=RATE, drift=drift).run(wrench, R, t)
        assert not batch.contacts
        assert np.nanmax(np.abs(batch.wrench / batch.std)[20:]) < 6.0
