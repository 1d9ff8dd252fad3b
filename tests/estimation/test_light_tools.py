"""A light tool on an ordinary sensor is not refused for noise alone; one that is read wrongly is not believed."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import contactwrench as cw
from contactwrench.calibration.findings import Kind
from contactwrench.errors import ContactWrenchError
from tests.support.world import Array

POSES = 16
READ_WRONGLY: dict[str, Callable[[Rotation, Array], tuple[Array, Array]]] = {
    "the other way round": lambda R, wrench: (R.inv().as_matrix(), wrench),
    "ZYX for xyz": lambda R, wrench: (Rotation.from_euler("ZYX", R.as_euler("xyz")).as_matrix(), wrench),
    "w first": lambda R, wrench: (Rotation.from_quat(np.roll(R.as_quat(), 1, axis=1)).as_matrix(), wrench),
    "deg for rad": lambda R, wrench: (Rotation.from_rotvec(np.rad2deg(R.as_rotvec())).as_matrix(), wrench),
    "a row late": lambda R, wrench: (np.roll(R.as_matrix(), 1, axis=0), wrench),
    "in base axes": lambda R, wrench: (R.as_matrix(), np.hstack([R.apply(wrench[:, :3]), R.apply(wrench[:, 3:])])),
    "another tool half-way": lambda R, wrench: (R.as_matrix(), np.vstack([wrench[:8], 2.0 * wrench[8:]])),
}


def recorded(seed: int, grams: float, noise: float) -> tuple[Rotation, Array]:
    """Orientations, and what a tool reads in them on any mounting; `noise` N, and 4 cm of that."""
    rng = np.random.default_rng(seed)
    weight, com, mount = 9.80665e-3 * grams, np.array([0.005, -0.01, 0.05]), Rotation.random(random_state=rng)
    poses = Rotation.random(POSES, random_state=rng)
    force = (poses * mount).inv().apply([0.0, 0.0, -weight])
    bias = rng.normal(size=6) * np.repeat([5.0, 0.2], 3)
    of_sensor = noise * np.repeat([1.0, 0.04], 3) * rng.normal(size=(POSES, 6))
    return poses, np.hstack([force, np.cross(com, force)]) + bias + of_sensor


def poor_fit(calibration: cw.Calibration) -> list[str]:
    return [finding.text for finding in calibration.findings if finding.kind is Kind.POOR_FIT]


@pytest.mark.parametrize(("grams", "noise"), [(50.0, 0.05), (100.0, 0.1), (150.0, 0.1)])
def test_the_noise_of_an_ordinary_sensor_is_no_poor_fit(grams: float, noise: float) -> None:
    good = 0
    for seed in range(6):
        R, wrench = recorded(seed, grams, noise)
        calibration = cw.calibrate(cw.Samples(wrench, R.as_matrix()))
        assert calibration.weight is not None
        off = abs(calibration.weight - 9.80665e-3 * grams)
        assert off < 4.0 * calibration.std["weight"]
        weak = [finding for finding in calibration.findings if finding.kind is Kind.UNCERTAIN_PARAMETER]
        assert bool(poor_fit(calibration)) is bool(weak)
        good += calibration.verdict == "good"
    assert good >= 4


@pytest.mark.parametrize("how", READ_WRONGLY.values(), ids=READ_WRONGLY)
def test_a_light_tool_that_is_read_wrongly_is_not_believed(
    how: Callable[[Rotation, Array], tuple[Array, Array]],
) -> None:
    for seed, grams in ((0, 50.0), (1, 100.0)):  # where the fewest findings speak against it
        R, wrench = how(*recorded(seed, grams, 0.05))
        try:
            calibration = cw.calibrate(cw.Samples(wrench, R))
        except ContactWrenchError:
            continue
        assert calibration.verdict != "good"


def test_more_than_a_sensor_s_noise_is_left_of_a_heavier_tool() -> None:
    R, wrench = recorded(1, 150.0, 0.25)
    calibration = cw.calibrate(cw.Samples(wrench, R.as_matrix()))
    assert len(poor_fit(calibration)) == 1
    assert "% of the weight: the file may be read wrongly (orientation, sign, units)" in poor_fit(calibration)[0]


def test_readings_in_coarse_steps_are_no_poor_fit() -> None:
    R, wrench = recorded(2, 300.0, 0.02)
    coarse = np.round(wrench / np.repeat([0.5, 0.01], 3)) * np.repeat([0.5, 0.01], 3)
    calibration = cw.calibrate(cw.Samples(coarse, R.as_matrix()))
    assert not poor_fit(calibration)
