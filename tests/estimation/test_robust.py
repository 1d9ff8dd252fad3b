"""Recordings that are not clean: poses in contact, a bias that steps or drifts, and clean ones that are left alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import contactwrench as cw
from tests.support.rigs import NOISE, example, noisy
from tests.support.world import Array, Rig, noisy_readings, random_rotations, readings

BAD = [3, 8, 9, 20]
RIGID = ("auto", "yaw", "mount", "mount+base")


def _rig(seed: int) -> tuple[Rig, Array, np.random.Generator]:
    rig, R, rng = example(seed)
    yaw = rng.uniform(-np.pi, np.pi)
    upright = np.array([[np.cos(yaw), -np.sin(yaw), 0.0], [np.sin(yaw), np.cos(yaw), 0.0], [0.0, 0.0, 1.0]])
    return replace(rig, weight=10.0, R_flange_sensor=upright), R, rng


def _left_out(calibration: cw.Calibration) -> list[int]:
    return [k for k, pose in enumerate(calibration.poses) if pose.rejected is not None]


def _of_bias(calibration: cw.Calibration) -> list[str]:
    return [text for text in calibration.warnings if text.startswith("the bias")]


def _off(calibration: cw.Calibration, rig: Rig) -> float:
    unseen = random_rotations(60, np.random.default_rng(5))
    return float(np.sqrt(np.mean((calibration.predict(unseen) - readings(rig, unseen))[:, :3] ** 2)))


@pytest.mark.slow
@pytest.mark.parametrize("model", RIGID)
@pytest.mark.parametrize("size", [8.0, 40.0, 1000.0])
def test_poses_in_contact_are_left_out(model: str, size: float) -> None:
    """Offsets of `size` standard deviations, in a random direction of the whitened reading each."""
    rig, R, rng = _rig(1)
    wrench = noisy_readings(rig, R, NOISE, rng)
    direction = rng.normal(size=(len(BAD), 6))
    wrench[BAD] += size * NOISE * direction / np.linalg.norm(direction, axis=1, keepdims=True)
    calibration = cw.calibrate(cw.Samples(wrench, R), model)
    assert set(BAD) <= set(_left_out(calibration))
    assert len(_left_out(calibration)) <= len(BAD) + 1
    assert len(calibration.fitted_poses) == len(R) - len(_left_out(calibration))
    good = np.delete(np.arange(len(R)), BAD)
    without = cw.calibrate(cw.Samples(wrench[good], R[good]), model)
    assert _off(calibration, rig) < 1.5 * _off(without, rig) + 0.01
    assert calibration.noise == pytest.approx(without.noise, rel=0.3)


@pytest.mark.slow
def test_a_pose_says_why_it_was_left_out(tmp_path: object) -> None:
    rig, R, rng = _rig(2)
    wrench = noisy_readings(rig, R, NOISE, rng)
    wrench[7, 2] -= 4.0
    calibration = cw.calibrate(cw.Samples(wrench, R))
    (warning,) = (text for text in calibration.warnings if "left out" in text)
    assert warning.startswith("pose 8 was left out: 4 N and ")
    assert warning.endswith("std: in contact, bumped, or read before the arm was still")
    assert calibration.poses[7].rejected is not None
    assert f"pose 8 was left out: {calibration.poses[7].rejected}" == warning
    calibration.save(f"{tmp_path}/tool.json")
    assert cw.Calibration.load(f"{tmp_path}/tool.json").poses[7].rejected == calibration.poses[7].rejected


@pytest.mark.slow
def test_the_same_offset_in_every_axis_alone_is_found() -> None:
    """A pose is an outlier, not an axis: whichever axis carries it."""
    rig, R, rng = _rig(3)
    for axis in range(6):
        wrench = noisy_readings(rig, R, NOISE, rng)
        wrench[5, axis] += 12.0 * NOISE[axis]
        assert 5 in _left_out(cw.calibrate(cw.Samples(wrench, R), "mount"))


@pytest.mark.slow
@pytest.mark.parametrize("poses", [6, 12, 24])
def test_clean_recordings_lose_hardly_a_pose_and_no_bias_moves(poses: int) -> None:
    lost = moved = 0
    for seed in range(60):
        rig, _, rng = _rig(seed)
        R = random_rotations(poses, rng)
        calibration = cw.calibrate(noisy(rig, R, rng), "mount")
        lost += bool(_left_out(calibration))
        moved += bool(_of_bias(calibration))
    assert lost <= 10
    assert moved <= 2


def test_most_poses_bad_is_nobody_s_outlier() -> None:
    rig, R, rng = _rig(4)
    wrench = noisy_readings(rig, R, NOISE, rng)
    wrench[::2] += 3.0 * rng.normal(size=(12, 6))
    calibration = cw.calibrate(cw.Samples(wrench, R), "mount")
    assert _left_out(calibration) == []


@pytest.mark.slow
def test_a_file_that_is_read_wrongly_is_not_cleaned_until_it_fits() -> None:
    """The inverse orientation fits no tool: the poses are not to blame, and diagnose is named."""
    rig, R, rng = _rig(5)
    rig = replace(rig, R_flange_sensor=random_rotations(1, rng)[0])
    wrench = noisy_readings(rig, R, NOISE, rng)
    calibration = cw.calibrate(cw.Samples(wrench, R.transpose(0, 2, 1)), "mount+base")
    assert _left_out(calibration) == []
    assert any("contactwrench diagnose" in text for text in calibration.warnings)


@pytest.mark.slow
@pytest.mark.parametrize("model", ["auto", "mount"])
@pytest.mark.parametrize("after", [6, 12, 19])
def test_a_step_of_the_bias_is_located_and_the_last_bias_kept(model: str, after: int) -> None:
    rig, R, rng = _rig(6)
    step = np.array([0.8, -0.5, 1.5, 0.02, 0.0, -0.03])
    wrench = noisy_readings(rig, R, NOISE, rng)
    wrench[:after] += step
    calibration = cw.calibrate(cw.Samples(wrench, R, t=10.0 * np.arange(24.0)), model)
    (warning,) = _of_bias(calibration)
    assert warning.startswith("the bias stepped by (")
    assert f"between pose {after} (t = {10 * (after - 1)} s) and pose {after + 1} (t = {10 * after} s)" in warning
    assert np.abs((calibration.bias - rig.bias) / calibration.std["bias"]).max() < 4.5
    assert calibration.weight == pytest.approx(rig.weight, abs=5.0 * calibration.std["weight"])


def test_a_step_among_bumped_poses() -> None:
    rig, R, rng = _rig(7)
    wrench = noisy_readings(rig, R, NOISE, rng)
    wrench[:11] += np.array([1.0, 1.0, -2.0, 0.0, 0.05, 0.0])
    wrench[[4, 17]] += np.array([3.0, 0.0, 2.0, 0.1, 0.0, 0.2])
    calibration = cw.calibrate(cw.Samples(wrench, R))
    assert _left_out(calibration) == [4, 17]
    assert "between pose 11 and pose 12" in _of_bias(calibration)[0]


@pytest.mark.slow
def test_a_steady_drift_is_reported_by_the_hour_where_time_is_known() -> None:
    rig, R, rng = _rig(8)
    t = 60.0 * np.arange(24.0)
    rate = np.array([1.2, -2.4, 4.8, 0.0, 0.0, 0.0]) / 3600.0
    wrench = noisy_readings(rig, R, NOISE, rng) + np.outer(t - t[-1], rate)
    timed = cw.calibrate(cw.Samples(wrench, R, t=t))
    (warning,) = _of_bias(timed)
    assert warning.startswith("the bias drifted by (")
    assert " an hour, steadily: " in warning
    said = [float(number) for number in warning.partition("(")[2].partition(")")[0].split(",")]
    assert said == pytest.approx([1.2, -2.4, 4.8], abs=0.35)
    assert np.abs((timed.bias - rig.bias) / timed.std["bias"]).max() < 4.5
    (warning,) = _of_bias(cw.calibrate(cw.Samples(wrench, R)))
    assert " a pose, steadily: " in warning


def test_a_random_walk_is_followed_to_its_end() -> None:
    rig, R, rng = _rig(9)
    walk = np.cumsum(6.0 * NOISE * rng.normal(size=(24, 6)), axis=0)
    wrench = noisy_readings(rig, R, NOISE, rng) + walk - walk[-1]
    calibration = cw.calibrate(cw.Samples(wrench, R))
    (warning,) = _of_bias(calibration)
    assert warning.startswith("the bias wandered by up to ")
    assert "as a random walk of (" in warning
    assert np.abs((calibration.bias - rig.bias) / calibration.std["bias"]).max() < 4.5


@pytest.mark.slow
def test_the_same_push_in_four_poses() -> None:
    for seed, size in ((21, 10.0), (22, 30.0), (23, 100.0), (24, 1000.0)):
        rig, R, rng = _rig(seed)
        wrench = noisy_readings(rig, R, NOISE, rng)
        push = rng.normal(size=6)
        wrench[BAD] += size * NOISE * push / np.linalg.norm(push)
        assert set(BAD) <= set(_left_out(cw.calibrate(cw.Samples(wrench, R)))), (seed, size)


@pytest.mark.slow
def test_a_thousand_poses_take_no_walk() -> None:
    """A drift in a long recording is followed without a covariance between all of its poses."""
    rig, _, rng = _rig(25)
    R = random_rotations(400, rng)
    wrench = noisy_readings(rig, R, NOISE, rng) + np.outer(np.linspace(-1.0, 0.0, 400), 10.0 * NOISE)
    assert _of_bias(cw.calibrate(cw.Samples(wrench, R), "mount"))[0].startswith("the bias drifted by (")


@pytest.mark.slow
def test_visits_to_the_same_pose_tell_a_drift() -> None:
    """Two orientations more than once: averaged they would hide it."""
    rig, R, rng = _rig(10)
    again = np.concatenate([R[:12], R[:12]])
    wrench = noisy_readings(rig, again, NOISE, rng)
    wrench[:12] += np.array([1.0, 0.0, -1.0, 0.03, 0.0, 0.0])
    calibration = cw.calibrate(cw.Samples(wrench, again))
    assert "between pose 12 and pose 13" in _of_bias(calibration)[0]
    assert len(calibration.poses) == 24
    assert len(cw.calibrate(cw.Samples(noisy_readings(rig, again, NOISE, rng), again)).poses) == 12


@pytest.mark.slow
def test_order_in_the_file_does_not_matter_where_time_is_known() -> None:
    rig, R, rng = _rig(11)
    t = 10.0 * np.arange(24.0)
    wrench = noisy_readings(rig, R, NOISE, rng)
    wrench[:9] += np.array([0.0, 2.0, 0.0, 0.0, 0.0, 0.05])
    shuffled = rng.permutation(24)
    straight = cw.calibrate(cw.Samples(wrench, R, t=t))
    mixed = cw.calibrate(cw.Samples(wrench[shuffled], R[shuffled], t=t[shuffled]))
    assert mixed.parameters == pytest.approx(straight.parameters, abs=1e-9)
    assert _of_bias(mixed) == _of_bias(straight)


def test_the_paper_s_estimator_and_affine_take_the_readings_as_they_are() -> None:
    rig, R, rng = _rig(12)
    wrench = noisy_readings(rig, R, NOISE, rng)
    wrench[7] += 1.0
    for model in ("paper", "affine"):
        assert _left_out(cw.calibrate(cw.Samples(wrench, R), model)) == []


@pytest.mark.slow
def test_torques_in_newton_millimetres_are_told_by_the_com() -> None:
    rig, R, rng = _rig(14)
    rig = replace(rig, com=np.array([0.0, 0.01, 0.05]))
    wrench = noisy_readings(rig, R, NOISE, rng)
    assert not [text for text in cw.calibrate(cw.Samples(wrench, R)).warnings if "N mm" in text]
    wrench[:, 3:] *= 1e3
    (warning,) = (text for text in cw.calibrate(cw.Samples(wrench, R)).warnings if "N mm" in text)
    assert warning.startswith("weak: the centre of mass comes out 51 m from the sensor: are the torques in N mm? ")


def test_unequal_gains_are_said_with_the_singular_values_and_equal_ones_are_not() -> None:
    rig, R, rng = _rig(13)
    wrench = noisy_readings(rig, R, NOISE, rng)
    assert not [text for text in cw.calibrate(cw.Samples(wrench, R)).warnings if "rigid tool" in text]
    wrench[:, :3] *= np.array([1.1, 1.0, 0.95])
    (warning,) = (text for text in cw.calibrate(cw.Samples(wrench, R)).warnings if "rigid tool" in text)
    assert warning.startswith("doubtful: no rigid tool explains these readings (chance under 0.1 %): ")
    assert warning.endswith("compare --model affine")
    values = [float(v) for v in warning.partition("singular values ")[2].partition(" N")[0].split(", ")]
    assert values == pytest.approx([11.0, 10.0, 9.5], abs=0.1)
