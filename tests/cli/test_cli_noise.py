"""`calibrate --noise`, and what is said where a calibration knows no noise of a sample."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import contactwrench as cw
from tests.support.recordings import PANDA, WRENCH, csv_text, matrix_table, run, written
from tests.support.rigs import example
from tests.support.world import noisy_readings, readings
from tests.support.written import QUAT, quat

Capture = pytest.CaptureFixture[str]

RIG, R, RNG = example(8)
NOISE = np.array([0.1, 0.1, 0.1, 0.005, 0.005, 0.005])
LEARNED = "noise of a sample unknown: a Compensator takes its first second for free air"


@pytest.fixture
def poses(tmp_path: Path) -> Path:
    return written(tmp_path, matrix_table(noisy_readings(RIG, R, NOISE, RNG), R))


def test_a_number_is_the_std_of_a_poses_force_and_of_its_torque_at_5_cm(
    tmp_path: Path, capsys: Capture, poses: Path
) -> None:
    assert run(capsys, "calibrate", poses, "--noise", "0.2", "-o", tmp_path / "tool.json").status == 0
    stated = cw.Calibration.load(tmp_path / "tool.json")
    expected = cw.calibrate(cw.read(poses), noise=np.array([0.2, 0.2, 0.2, 0.01, 0.01, 0.01]))
    np.testing.assert_allclose(stated.covariance, expected.covariance, rtol=1e-9)
    np.testing.assert_allclose(stated.noise, expected.noise, rtol=1e-12)


def test_a_file_is_a_recording_at_rest_read_with_the_same_options(tmp_path: Path, capsys: Capture) -> None:
    still = np.tile(R[:1], (200, 1, 1))
    content = -noisy_readings(RIG, still, NOISE, RNG)
    rest = written(tmp_path, csv_text((*WRENCH, *QUAT), np.column_stack([content, quat(still)])), "rest.csv")
    free = written(tmp_path, csv_text((*WRENCH, *QUAT), np.column_stack([-readings(RIG, R), quat(R)])), "free.csv")
    tool = tmp_path / "tool.json"
    assert run(capsys, "calibrate", free, "--noise", rest, "--sign", "reaction", "-o", tool).status == 0
    read = [cw.read(path, sign="reaction") for path in (free, rest)]
    assert np.array_equal(cw.Calibration.load(tool).covariance, cw.calibrate(read[0], noise=read[1]).covariance)


def test_six_numbers_are_the_std_of_each_axis(tmp_path: Path, capsys: Capture, poses: Path) -> None:
    six = ",".join(map(str, NOISE))
    assert run(capsys, "calibrate", poses, "--noise", six, "-o", tmp_path / "tool.json").status == 0
    stated = cw.Calibration.load(tmp_path / "tool.json")
    np.testing.assert_allclose(stated.covariance, cw.calibrate(cw.read(poses), noise=NOISE).covariance, rtol=1e-9)


@pytest.mark.parametrize("noise", ["0", "-1", "nan", "inf", "0.1N", "0,1", "0.1,0.1,0.1", "0.1,0.1,0.1,0.1,0.1,0"])
def test_a_noise_that_is_none(capsys: Capture, poses: Path, noise: str) -> None:
    complaint = run(capsys, "calibrate", poses, f"--noise={noise}").complaint
    assert (
        complaint
        == f"--noise is {noise}, expected 1e-09 to 1e+06 N, six with commas, fx..tz, or a recording of a sensor at rest"
    )


def test_a_noise_that_is_no_file(capsys: Capture, poses: Path) -> None:
    complaint = run(capsys, "calibrate", poses, "--noise", "rest.csv").complaint
    assert complaint.startswith("rest.csv: ")


def test_what_a_compensator_assumes_is_said_where_no_rows_in_turn_tell_the_noise(
    tmp_path: Path, capsys: Capture, poses: Path
) -> None:
    tool, out = tmp_path / "tool.json", tmp_path / "out.csv"
    assert LEARNED in run(capsys, "calibrate", poses, "-o", tool).out
    n = 400
    t, still = 0.01 * np.arange(n), np.tile(R[:1], (n, 1, 1))
    rows = np.column_stack([t, noisy_readings(RIG, still, NOISE, RNG), quat(still)])
    stream = written(tmp_path, csv_text(("t", *WRENCH, *QUAT), rows), "stream.csv")
    note = f"Note: {LEARNED}; --noise states it"
    assert note in run(capsys, "compensate", stream, "-c", tool, "-o", out, "--contact").err
    assert note not in run(capsys, "compensate", stream, "-c", tool, "-o", out, "--contact", "--noise", "0.1").err
    assert note not in run(capsys, "compensate", stream, "-c", tool, "-o", out).err
    rows = np.repeat(R[:6], 50, axis=0)
    columns = np.column_stack([0.01 * np.arange(300), noisy_readings(RIG, rows, NOISE, RNG), quat(rows)])
    stops = written(tmp_path, csv_text(("t", *WRENCH, *QUAT), columns), "stops.csv")
    assert LEARNED not in run(capsys, "calibrate", stops, "-o", tool).out
    assert LEARNED in run(capsys, "calibrate", PANDA).out
