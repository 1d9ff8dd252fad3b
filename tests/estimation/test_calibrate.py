"""What `calibrate` refuses, and in which words: what free air cannot tell, and arguments that cannot be meant."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import contactwrench as cw
from contactwrench.errors import AmbiguityError, InputError, UnobservableError
from tests.support.rigs import NOISE, assert_same_tool, example, noise_free, noisy
from tests.support.world import Rig, noisy_readings, random_rotations, readings, tilted_down

BOTH_READINGS = r"(?s)(?=.*--sign reaction)(?=.*--gravity )"
RIGID = ("yaw", "mount", "mount+base")
MIRROR_X = np.array([-1.0, 1.0, 1.0])


def _plain_yaw(rig: Rig) -> Rig:
    c, s = np.cos(0.8), np.sin(0.8)
    return replace(rig, R_flange_sensor=np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]))


@pytest.mark.slow
@pytest.mark.parametrize("model", ["paper", *RIGID])
@pytest.mark.parametrize("seed", range(2))
def test_a_sensor_that_reports_the_reaction_is_refused_with_both_readings(model: str, seed: int) -> None:
    rig, R, rng = example(seed)
    samples = noisy(_plain_yaw(rig), R, rng)
    with pytest.raises(AmbiguityError, match=BOTH_READINGS):
        cw.calibrate(cw.Samples(-samples.wrench, R), model)


@pytest.mark.parametrize("seed", range(2))
def test_each_of_the_two_readings_is_accepted_once_it_is_stated(seed: int) -> None:
    rig, R, rng = example(seed)
    samples = noisy(rig, R, rng)
    reaction = cw.Samples(-samples.wrench, R)
    ceiling = cw.calibrate(reaction, "mount", gravity=(0, 0, 1))
    plain = cw.calibrate(samples, "mount")
    assert ceiling.weight == pytest.approx(plain.weight)
    assert ceiling.gravity_direction == pytest.approx([0.0, 0.0, 1.0])


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
def test_a_ceiling_robot_is_refused_until_gravity_says_so(seed: int) -> None:
    rig, R, rng = example(seed)
    rig = replace(rig, down=np.array([0.0, 0.0, 1.0]))
    samples = noisy(rig, R, rng)
    for model in ("mount", "mount+base"):
        with pytest.raises(AmbiguityError, match=BOTH_READINGS):
            cw.calibrate(samples, model)
    assert_same_tool(cw.calibrate(noise_free(rig, R), "mount+base", gravity=(0, 0, 1)), rig)


@pytest.mark.parametrize("seed", [1, 2])
def test_a_robot_on_a_wall_is_taken_as_it_is_and_one_that_leans_further_is_refused(seed: int) -> None:
    """By noise gravity of a wall comes out on either side of a right angle; one that leans further may be a sign."""
    rig, R, rng = example(seed, 12)
    wall, further = (replace(rig, down=tilted_down(np.deg2rad(deg), rng)) for deg in (90.0, 115.0))
    calibration = cw.calibrate(noisy(wall, R, rng), "mount+base")
    assert calibration.gravity_direction == pytest.approx(wall.down, abs=0.01)
    with pytest.raises(AmbiguityError, match=r"gravity comes out 115 deg from .*--sign reaction, or --gravity "):
        cw.calibrate(noisy(further, R, rng), "mount+base")


def test_the_ceiling_message_gives_the_direction_to_state() -> None:
    rig, R, rng = example(2)
    samples = noisy(replace(rig, down=np.array([0.0, 0.0, 1.0])), R, rng)
    with pytest.raises(AmbiguityError, match=r"--gravity -?0(\.000)?,-?0(\.000)?,1(\.000)?"):
        cw.calibrate(samples, "mount+base")


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("model", ["mount", "mount+base"])
def test_one_mirrored_axis_is_refused(model: str, seed: int) -> None:
    """Force and torque about one axis with the wrong sign: a ceiling robot, with another mounting."""
    rig, R, rng = example(seed)
    samples = noisy(rig, R, rng)
    mirrored = cw.Samples(samples.wrench * np.r_[MIRROR_X, MIRROR_X], R)
    with pytest.raises(AmbiguityError, match=BOTH_READINGS):
        cw.calibrate(mirrored, model)


def test_one_mirrored_force_axis_is_a_ceiling_robot() -> None:
    """The equality of data behind the refusal, shown with physics alone."""
    rig, R, _ = example(6)
    mirror = np.diag(MIRROR_X)
    ceiling = Rig(
        weight=rig.weight,
        com=mirror @ rig.com,
        bias=rig.bias * np.r_[MIRROR_X, -MIRROR_X],
        R_flange_sensor=-rig.R_flange_sensor @ mirror,
        down=-rig.down,
    )
    assert np.linalg.det(ceiling.R_flange_sensor) == pytest.approx(1.0)
    # torque is an axial vector: it mirrors with the other sign
    assert readings(ceiling, R) == pytest.approx(readings(rig, R) * np.r_[MIRROR_X, -MIRROR_X])


@pytest.mark.parametrize("seed", range(2))
def test_a_reversed_torque_alone_is_a_mirrored_centre_of_mass(seed: int) -> None:
    rig, R, rng = example(seed)
    samples = noisy(rig, R, rng)
    reversed_torque = cw.Samples(samples.wrench * np.r_[1.0, 1.0, 1.0, -1.0, -1.0, -1.0], R)
    calibration, plain = cw.calibrate(reversed_torque, "mount"), cw.calibrate(samples, "mount")
    assert plain.com is not None
    assert calibration.com == pytest.approx(-plain.com, abs=1e-6)


def test_affine_says_that_a_mirror_is_no_rotation() -> None:
    rig, R, rng = example(3)
    samples = noisy(rig, R, rng)
    mirrored = cw.calibrate(cw.Samples(samples.wrench * np.r_[MIRROR_X, MIRROR_X], R), "affine")
    assert any("mirrors" in warning for warning in mirrored.warnings)
    assert not any("mirrors" in warning for warning in cw.calibrate(samples, "affine").warnings)


@pytest.mark.parametrize("degrees", [40.0, 80.0])
@pytest.mark.parametrize("seed", range(2))
def test_a_wall_is_found_by_itself(seed: int, degrees: float) -> None:
    rig, R, rng = example(seed)
    rig = replace(rig, down=tilted_down(np.deg2rad(degrees), rng))
    calibration = cw.calibrate(noisy(rig, R, rng), "mount+base")
    assert np.rad2deg(np.arccos(calibration.gravity_direction @ rig.down)) < 2.0


@pytest.mark.parametrize("seed", range(2))
def test_right_readings_are_never_refused_for_their_sign(seed: int) -> None:
    """A light tool in much noise, where the negated readings fit nearly as well by chance."""
    rig, R, rng = example(seed, poses=10)
    rig = replace(rig, weight=0.5)
    calibration = cw.calibrate(noisy(rig, R, rng, 4.0 * NOISE), "mount")
    assert calibration.weight == pytest.approx(0.5, abs=6 * calibration.std["weight"])


@pytest.mark.parametrize("seed", range(6))
def test_no_weight_at_all_is_not_made_up(seed: int) -> None:
    """Nothing but noise: either refused, or a weight that is not significant and is said to be weak."""
    rng = np.random.default_rng(seed)
    samples = cw.Samples(NOISE * rng.normal(size=(10, 6)), random_rotations(10, rng))
    try:
        calibration = cw.calibrate(samples, "mount")
    except (AmbiguityError, UnobservableError):
        return
    assert any(warning.startswith("weak") for warning in calibration.warnings)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"model": "rigid"}, "model 'rigid' is not known, expected one of auto, paper, yaw, mount"),
        ({"gravity": (0, 0, 0)}, "expected three finite numbers X,Y,Z that are not all zero"),
        ({"gravity": (0, 0)}, "expected three finite numbers X,Y,Z"),
        ({"gravity": (0, np.nan, 1)}, "expected three finite numbers X,Y,Z"),
        ({"g": 0.0}, "g is 0, expected 0.1 to 100 m/s\\^2"),
        ({"g": np.inf}, "g is inf, expected 0.1 to 100 m/s\\^2"),
        ({"noise": NOISE[:3]}, "noise must be six standard deviations .*1e-12 to"),
        ({"noise": 0.0}, r"noise must be six .*, one number, N, or a recording .*; found \[0. 0. 0. 0. 0. 0.\]"),
        ({"noise": "0,05"}, "^found '0,05', expected numbers: one in N, or six, N of forces and N m of torques$"),
        ({"noise": 0.0 * NOISE}, "noise must be six standard deviations .*1e-12 to"),
        ({"noise": -NOISE}, "noise must be six standard deviations .*1e-12 to"),
        ({"noise": np.full(6, np.nan)}, "noise must be six standard deviations .*1e-12 to"),
        ({"noise": np.ones((5, 6))}, "a recording at rest \\(n, 6\\) in which every axis moves"),
    ],
)
def test_arguments_that_cannot_be_meant(arguments: dict[str, Any], message: str) -> None:
    rig, R, rng = example(1)
    with pytest.raises(InputError, match=message):
        cw.calibrate(noisy(rig, R, rng), **arguments)


def test_one_number_of_noise_is_in_newtons_as_of_a_compensator() -> None:
    rig, R, rng = example(1)
    samples = noisy(rig, R, rng)
    found, expected = (cw.calibrate(samples, noise=noise) for noise in (0.05, [0.05] * 3 + [0.0025] * 3))
    np.testing.assert_allclose(found.covariance, expected.covariance, rtol=1e-6, atol=1e-12)


def test_no_samples() -> None:
    with pytest.raises(InputError, match="found no contact-free samples"):
        cw.calibrate(cw.Samples(np.empty((0, 6)), np.empty((0, 3, 3))))


def test_loaded_rows_are_left_out_and_said() -> None:
    rig, R, rng = example(4)
    wrench = noisy_readings(rig, R, NOISE, rng)
    load = np.zeros(24)
    load[[3, 7, 8]] = 0.5
    wrench[load > 0.0, 2] += 5.0
    calibration = cw.calibrate(cw.Samples(wrench, R, load_mass=load), "mount")
    without = cw.calibrate(cw.Samples(wrench[load == 0.0], R[load == 0.0]), "mount")
    assert calibration.parameters == pytest.approx(without.parameters)
    assert "3 rows with a load hung on the tool were left out" in calibration.warnings
    with pytest.raises(InputError, match="found no contact-free samples, expected poses without a load"):
        cw.calibrate(cw.Samples(wrench, R, load_mass=np.ones(24)))


def test_too_few_readings_to_estimate_the_noise() -> None:
    """Affine: 4 poses give 24 readings for 24 numbers."""
    rig, R, rng = example(1, poses=4)
    with pytest.raises(UnobservableError, match="4 poses give 24 readings for 24 parameters"):
        cw.calibrate(noisy(rig, R, rng), "affine")


def test_noise_from_a_recording_at_rest() -> None:
    rig, R, rng = example(5)
    samples = noisy(rig, R, rng)
    at_rest = noisy_readings(rig, np.repeat(R[:1], 4000, axis=0), NOISE, rng)
    given = cw.calibrate(samples, "mount", noise=at_rest.std(axis=0, ddof=1))
    as_array = cw.calibrate(samples, "mount", noise=at_rest)
    as_samples = cw.calibrate(samples, "mount", noise=cw.Samples(at_rest, np.repeat(R[:1], 4000, axis=0)))
    assert as_array.parameters == pytest.approx(given.parameters)
    assert as_samples.parameters == pytest.approx(given.parameters)
    assert as_samples.reduced_chi2 == pytest.approx(1.0, abs=0.4)


def test_mass_uses_the_gravity_that_was_stated() -> None:
    rig, R, rng = example(5)
    samples = noisy(rig, R, rng)
    standard, here = cw.calibrate(samples, "mount"), cw.calibrate(samples, "mount", g=9.8321)
    assert standard.mass == pytest.approx(standard.weight / 9.80665)  # type: ignore[operator]
    assert here.mass == pytest.approx(here.weight / 9.8321)  # type: ignore[operator]


@pytest.mark.slow
def test_many_poses_are_kept_as_moments() -> None:
    rig, R, rng = example(6, poses=10_500)
    calibration = cw.calibrate(noisy(rig, R, rng), "mount")
    assert calibration.poses == ()
    assert calibration.moments is not None
    assert calibration.moments.n == pytest.approx(10_500, abs=100)
    assert_same_tool(calibration, rig, 0.02)
