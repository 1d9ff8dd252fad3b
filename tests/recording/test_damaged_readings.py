"""Flat tops and spikes: channels that stand at their limit and readings that jump are seen, and nothing else is taken
for one; and which file is named.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import contactwrench as cw
from contactwrench.errors import InputError
from contactwrench.samples.flange_motion import flange_motion
from contactwrench.samples.limits import at_limit
from contactwrench.samples.spikes import spikes
from tests.support.recordings import WRENCH, csv_text, run, written

QUAT = ("qx", "qy", "qz", "qw")
T = np.arange(5000) / 1000.0


def swinging(noise: float, seed: int = 1) -> np.ndarray:
    phase = np.arange(6)
    return 10.0 * np.sin(2.0 * T[:, None] + phase) + noise * np.random.default_rng(seed).normal(size=(5000, 6))


@pytest.mark.parametrize("quantum", [0.0, 0.01])
def test_clipped_channels_are_seen(quantum: float) -> None:
    wrench = swinging(0.02)
    wrench[:, 1], wrench[:, 4] = np.minimum(wrench[:, 1], 8.0), np.maximum(wrench[:, 4], -9.0)
    wrench = np.rint(wrench / quantum) * quantum if quantum else wrench
    clipped = (wrench[:, 1] >= 8.0) | (wrench[:, 4] <= -9.0)
    found = at_limit(wrench)
    assert not (found & ~clipped).any()
    assert found[clipped].mean() > 0.9


def in_files(folder: Path, wrench: np.ndarray, turns: np.ndarray, files: int) -> list[str | Path]:
    t = 0.001 * np.arange(len(wrench))
    if files == 1:
        return [written(folder, csv_text(("t", *WRENCH, *QUAT), np.column_stack([t, wrench, turns])), "both.csv")]
    readings = written(folder, csv_text(("t", *WRENCH), np.column_stack([t, wrench])), "wrench.csv")
    poses = written(folder, csv_text(("t", *QUAT), np.column_stack([t, turns])), "poses.csv")
    return ["--wrench", readings, "--pose", poses]


@pytest.mark.parametrize("files", [1, 2])
@pytest.mark.parametrize(("limit", "said"), [(8.0, True), (9.9, False), (11.0, False)])
def test_many_readings_at_a_limit_are_said_before_anything_is_asked_of_the_rest(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], limit: float, said: bool, files: int
) -> None:
    wrench = swinging(0.02)
    wrench[:, 1] = np.minimum(wrench[:, 1], limit)
    turns = Rotation.from_rotvec(np.outer(T, [0.3, 0.1, 0.0])).as_quat()
    done = run(capsys, "calibrate", *in_files(tmp_path, wrench, turns, files))
    lost = (
        f"Note: {at_limit(wrench).sum()} of 5000 rows with a saturated channel (fy) were left out: "
        "set the sensor's range larger, or load it less\n"
    )
    assert (lost in done.err, "saturated" in done.err) == (said, said), done.err


@pytest.mark.parametrize("quantum", [0.0, 0.01, 0.5])
def test_what_is_not_clipped_is_not_taken_for_it(quantum: float) -> None:
    wrench = swinging(0.02)
    assert not at_limit(np.rint(wrench / quantum) * quantum if quantum else wrench).any()


def test_an_arm_at_rest_without_noise_stands_at_no_limit() -> None:
    levels = np.repeat(np.random.default_rng(2).normal(size=(10, 6)), 500, axis=0)
    assert not at_limit(levels).any()
    assert not at_limit(np.full((100, 6), np.nan)).any()
    assert not at_limit(np.repeat([[1.0], [2.0]], 500, axis=0) * np.ones(6)).any()
    assert not at_limit(np.repeat(levels[::500], [30, 30, 30, 900, 30, 30, 30, 30, 30, 30], axis=0)).any()


@pytest.mark.parametrize("files", [1, 2])
def test_a_sensor_without_torques_is_calibrated_and_its_zeros_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], files: int
) -> None:
    rng = np.random.default_rng(4)
    stops, t = np.repeat(rng.normal(size=(10, 3)), 2, axis=0), np.arange(0.0, 20.0, 0.0025)
    when = np.ravel([[2.0 * k, 2.0 * k + 1.5] for k in range(10)])
    R = Rotation.from_rotvec(np.column_stack([np.interp(t, when, each) for each in stops.T]))
    wrench = np.zeros((len(R), 6))
    wrench[:, :3] = R.inv().apply([0.0, 0.0, -8.0]) + [1.0, -2.0, 3.0] + 0.05 * rng.normal(size=(len(R), 3))
    done = run(capsys, "calibrate", "--json", *in_files(tmp_path, wrench, R.as_quat(), files))
    calibration = json.loads(done.out)
    assert abs(calibration["weight"] - 8.0) < 4.0 * calibration["std"]["weight"] < 0.1, done.err
    (said,) = (found["text"] for found in calibration["findings"] if found["severity"] == "doubtful")
    rows = calibration["provenance"]["rows"]
    assert said == (
        f"doubtful: tx = 0, ty = 0, tz = 0 in all {rows} rows, though these tilt the tool: a dead channel, or one that "
        "was not recorded?"
    )


def test_without_readings_none_stands_at_a_limit() -> None:
    assert not at_limit(np.empty((0, 6))).any()


def turning(wrench: np.ndarray, period: float = 0.002) -> cw.Samples:
    t = period * np.arange(float(len(wrench)))
    return cw.Samples(wrench, Rotation.from_rotvec(np.outer(t, [0.3, 0.1, 0.0])).as_matrix(), t)


@pytest.mark.parametrize("quantum", [0.0, 0.01, 0.5])
def test_single_readings_that_jump_are_seen(quantum: float) -> None:
    wrench, jumped = swinging(0.02), np.random.default_rng(2).random(5000) < 0.003
    jumped[1:] &= ~jumped[:-1]
    jumped[[0, -1]] = False
    wrench[jumped, 3] -= 40.0
    wrench = np.rint(wrench / quantum) * quantum if quantum else wrench
    assert jumped.sum() > 5
    assert np.array_equal(spikes(turning(wrench)), jumped)


def test_motion_noise_steps_and_pushes_are_no_spikes() -> None:
    stepped, pushed, coarse = swinging(0.02), swinging(0.02), np.rint(swinging(0.0) / 5.0) * 5.0
    stepped[2500:] += 40.0
    pushed[2500:2503] += 40.0
    still = np.rint(np.random.default_rng(4).normal(0.0, 0.3, (5000, 6)))  # one digit comes and goes
    one_digit = np.zeros((5000, 6))
    one_digit[2000, 2] = 0.1
    for wrench in (swinging(0.0), swinging(3.0), stepped, pushed, coarse, still, one_digit, np.zeros((5, 6))):
        assert not spikes(turning(wrench)).any()
    assert not spikes(turning(swinging(0.02)[::100], 0.2)).any()


def test_a_pose_of_a_single_row_in_a_table_with_times_is_no_spike() -> None:
    """A home pose, five times, then another, once; and rows in no order."""
    R, wrench = np.tile(np.eye(3), (60, 1, 1)), np.random.default_rng(5).normal(0.0, 0.02, (60, 6))
    R[5::6] = Rotation.from_rotvec([0.7, 0.2, 0.1]).as_matrix()
    wrench[5::6] += 8.0
    assert not spikes(cw.Samples(wrench, R, 0.1 * np.arange(60.0))).any()
    assert not spikes(cw.Samples(wrench, np.tile(np.eye(3), (60, 1, 1)), -0.1 * np.arange(60.0))).any()


def test_of_two_files_both_are_named_as_what_lacks_may_be_of_either(tmp_path: Path) -> None:
    readings = written(tmp_path, csv_text(("t", *WRENCH), np.column_stack([T, swinging(0.02)])), "wrench.csv")
    turns = Rotation.from_rotvec(np.outer(T, [0.3, 0.1, 0.0])).as_quat()
    poses = written(tmp_path, csv_text(("t", "x", "y", *QUAT), np.column_stack([T, T, T, turns])), "poses.csv")
    samples = cw.read(readings, pose_file=poses)
    with pytest.raises(InputError) as refused:
        flange_motion(samples)
    assert str(refused.value) == (
        f"{readings}, {poses}: found no positions, expected t and all of the flange's x, y, z in each row, from which "
        "its acceleration is taken: record them, name an accelerometer with --imu, or calibrate without inertia"
    )
