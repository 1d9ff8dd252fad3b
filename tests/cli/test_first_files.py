"""A new user's five first files, as spreadsheets and loggers write them: one flag at most, and the right weight."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import contactwrench as cw
from tests.support.recordings import run, written
from tests.support.rigs import NOISE
from tests.support.robot_pages import assert_the_tool
from tests.support.world import Array, noisy_readings, random_rig, random_rotations

POSES = 12


def german_spreadsheet(R: Array, wrench: Array) -> str:
    """Names with units in brackets, semicolons, decimal commas, a byte-order mark."""
    header = [f"{kind} {axis} [{unit}]" for kind, unit in (("Force", "N"), ("Torque", "Nm")) for axis in "XYZ"]
    angles = Rotation.from_matrix(R).as_euler("ZYX", degrees=True)
    return "\ufeff" + table([*header, "A [deg]", "B [deg]", "C [deg]"], np.column_stack([wrench, angles]), ";", ",")


def sensor_log(R: Array, wrench: Array) -> str:
    """Fx and Mx, time in ms, the pose as a quaternion of another logger."""
    header = ["Time (ms)", "Fx", "Fy", "Fz", "Mx", "My", "Mz", "qx", "qy", "qz", "qw"]
    return table(header, np.column_stack([20000.0 * np.arange(POSES), wrench, Rotation.from_matrix(R).as_quat()]))


def rtde_recorder(R: Array, wrench: Array) -> str:
    """The columns of UR's record.py, blank-separated, as Python's csv writes them."""
    vectors = [f"{name}_{k}" for name in ("actual_TCP_pose", "ft_raw_wrench") for k in range(6)]
    numbers = np.column_stack(
        [np.arange(POSES) * 10.0, np.zeros((POSES, 3)), Rotation.from_matrix(R).as_rotvec(), wrench]
    )
    text = io.StringIO()
    writer = csv.writer(text, delimiter=" ")
    writer.writerow(["timestamp", *vectors])
    writer.writerows(numbers.tolist())
    return text.getvalue()


def reaction(R: Array, wrench: Array) -> str:
    """A sensor that reports the reaction."""
    header = ["fx", "fy", "fz", "tx", "ty", "tz", *(f"r{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3))]
    return table(header, np.column_stack([-wrench, R.reshape(-1, 9)]))


def newton_millimetres(R: Array, wrench: Array) -> str:
    """Torques in N mm, which only the data sheet says."""
    header = ["Fx", "Fy", "Fz", "Tx", "Ty", "Tz", "roll", "pitch", "yaw"]
    angles = Rotation.from_matrix(R).as_euler("xyz", degrees=True)
    return table(header, np.column_stack([wrench * [1.0, 1.0, 1.0, 1e3, 1e3, 1e3], angles]), "\t")


def table(header: Sequence[str], numbers: Array, between: str = ",", point: str = ".") -> str:
    rows = [between.join(f"{value:.5f}".replace(".", point) for value in row) for row in numbers]
    return "\n".join([between.join(header), *rows, ""])


FILES = {
    german_spreadsheet: (),
    sensor_log: (),
    rtde_recorder: (),
    reaction: ("--sign", "reaction"),
    newton_millimetres: ("--units", "torque=Nmm"),
}


@pytest.mark.parametrize("write", FILES, ids=lambda write: write.__name__)
def test_a_first_file_is_calibrated_with_one_flag_at_most(
    write: object, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert callable(write)
    rng = np.random.default_rng(0)
    rig, R = random_rig(rng), random_rotations(POSES, rng)
    path = written(tmp_path, write(R, noisy_readings(rig, R, NOISE, rng)), "first.txt")
    done = run(capsys, "calibrate", path, "-o", tmp_path / "cal.json", *FILES[write])
    assert done.status == 0, done.err
    assert_the_tool(cw.Calibration.load(tmp_path / "cal.json"), rig)
