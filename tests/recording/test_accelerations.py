"""`--imu`: an accelerometer's readings from a bag, a table beside the recording, and the recording's own columns."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import contactwrench as cw
from contactwrench.errors import ContactWrenchError
from tests.support.bags import Message, header, ns, pose_stamped, vector, wrench_stamped, write_mcap
from tests.support.recordings import PANDA, run
from tests.support.world import Array

T = np.arange(200) / 100.0
READING = np.stack([np.sin(3.0 * T), T, np.cos(T)], axis=1)
R = Rotation.from_euler("x", 0.5 * T[:, None]).as_matrix()
WRENCH = np.tile([1.0, 2.0, 3.0, 0.1, 0.2, 0.3], (len(T), 1)) + 0.01 * np.sin(np.outer(T, np.arange(1, 7)))
QUATERNION = Rotation.from_matrix(R).as_quat()


def _table(path: Path, columns: dict[str, Array]) -> Path:
    names = [name for name, values in columns.items() for _ in range(1 if values.ndim == 1 else 0)]
    np.savetxt(path, np.column_stack(list(columns.values())), "%.12g", ",", header=",".join(names), comments="")
    return path


def _recording(path: Path, **more: Array) -> Path:
    wrench = dict(zip(("fx", "fy", "fz", "tx", "ty", "tz"), WRENCH.T, strict=True))
    pose = dict(zip(("qx", "qy", "qz", "qw"), QUATERNION.T, strict=True))
    return _table(path, {"t": T, **wrench, **pose, **more})


def _axes(*names: str) -> dict[str, Array]:
    return dict(zip(names, READING.T, strict=True))


@pytest.mark.parametrize("names", [("ax", "ay", "az"), ("acc_x", "acc_y", "acc_z"), ("linear_acceleration.x",) * 0])
def test_a_table_beside_the_recording(tmp_path: Path, names: tuple[str, ...]) -> None:
    names = names or tuple(f"linear_acceleration.{axis}" for axis in "xyz")
    other = _table(tmp_path / "imu.csv", {"t": T[::2], **{n: v[::2] for n, v in _axes(*names).items()}})
    found = cw.read(_recording(tmp_path / "run.csv"), imu=str(other)).accelerometer
    assert found is not None
    assert found[:-1] == pytest.approx(READING[:-1], abs=2e-3)
    assert np.isnan(found[-1]).all()


def test_columns_of_the_recording(tmp_path: Path) -> None:
    path = _recording(tmp_path / "run.csv", **_axes("imu1", "imu2", "imu3"))
    found = cw.read(path, imu="imu1,imu2,imu3").accelerometer
    assert found == pytest.approx(READING, abs=1e-9)
    assert cw.read(path).accelerometer is None


def _imu(t: float, reading: Array, topic: str = "/imu") -> Message:
    nothing = {"x": 0.0, "y": 0.0, "z": 0.0}
    fields = {
        "header": header(t),
        "orientation": {**nothing, "w": 1.0},
        "orientation_covariance": np.zeros(9),
        "angular_velocity": nothing,
        "angular_velocity_covariance": np.zeros(9),
        "linear_acceleration": vector(reading),
        "linear_acceleration_covariance": np.zeros(9),
    }
    return Message(topic, "sensor_msgs/msg/Imu", ns(t), fields)


def _bag(path: Path) -> Path:
    messages = []
    for t, wrench, orientation, reading in zip(T, WRENCH, R, READING, strict=True):
        messages += [wrench_stamped(t, wrench), pose_stamped(t, orientation, np.zeros(3)), _imu(t, reading)]
    return write_mcap(path, messages)


def test_a_topic_of_a_bag(tmp_path: Path) -> None:
    found = cw.read(_bag(tmp_path / "run.mcap"), imu="/imu").accelerometer
    assert found is not None
    assert found == pytest.approx(READING[: len(found)], abs=1e-4)


def test_what_is_not_there_is_said(tmp_path: Path) -> None:
    path, bag = _recording(tmp_path / "run.csv"), _bag(tmp_path / "run.mcap")
    without = _table(tmp_path / "other.csv", {"t": T, "a": T})
    timeless = _table(tmp_path / "timeless.csv", _axes("ax", "ay", "az"))
    later = _table(tmp_path / "later.csv", {"t": T + 100.0, **_axes("ax", "ay", "az")})
    two = _table(tmp_path / "two.csv", {"t": T, **_axes("a/ax", "a/ay", "a/az"), **_axes("b/ax", "b/ay", "b/az")})
    both, missing = "t, a/ax, a/ay, a/az, b/ax, b/ay, b/az", tmp_path / "missing.csv"
    columns = "t, fx, fy, fz, tx, ty, tz, qx, qy, qz, qw"
    for file, imu, message in (
        (path, str(without), f"{without}: found t, a, expected one accelerometer's t, ax, ay, az: rename the columns"),
        (path, str(timeless), f"{timeless}: found no column t, expected the time of each acceleration: add it"),
        (
            path,
            str(later),
            f"{later}: found no accelerations at the times of the wrench, expected both on one clock: record them "
            "together",
        ),
        (
            path,
            "ax,ay,az",
            f"{path}: found no column ax, expected a file, or three of {columns} as ax,ay,az",
        ),
        (path, str(two), f"{two}: found {both}, expected one accelerometer's t, ax, ay, az: rename the columns"),
        (path, str(missing), f"{missing}: there is no such file, expected a readable file: check the path"),
        (
            bag,
            "/wrench",
            f"{bag}: topic /wrench is geometry_msgs/WrenchStamped, expected sensor_msgs/Imu, "
            "geometry_msgs/AccelStamped or geometry_msgs/Vector3Stamped: name another with --imu",
        ),
    ):
        with pytest.raises(ContactWrenchError) as refused:
            cw.read(file, imu=imu)
        assert str(refused.value) == message


def test_a_calibration_with_a_prior_needs_no_stops_but_a_motion(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    pytest.importorskip("mujoco")
    from tests.support.in_motion import calibrated

    calibrated().save(tmp_path / "tool.json")
    done = run(
        capsys, "calibrate", _recording(tmp_path / "run.csv"), "--prior", tmp_path / "tool.json", "--model", "yaw"
    )
    assert done.status == 2
    assert "--prior brings its model, found --model yaw: leave one of them out" in done.err


def test_places_that_nobody_filled_in_are_none(tmp_path: Path) -> None:
    assert np.isnan(np.asarray(cw.read(_bag(tmp_path / "run.mcap")).position)).all()


def test_angular_accelerations_beside_them_are_not_taken(tmp_path: Path) -> None:
    others = {f"angular_acceleration.{axis}": T for axis in "xyz"}
    linear = _axes(*(f"linear_acceleration.{axis}" for axis in "xyz"))
    imu = _table(tmp_path / "imu.csv", {"t": T, **linear, **others})
    assert cw.read(_recording(tmp_path / "run.csv"), imu=str(imu)).accelerometer == pytest.approx(READING, abs=1e-9)


def test_one_that_is_not_used_or_cut_off_is_noted(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    from tests.support.in_motion import pushed

    cw.calibrate(pushed().samples()).save(tmp_path / "tool.json")
    path = _recording(tmp_path / "run.csv", **_axes("ax", "ay", "az"))
    done = run(capsys, "compensate", path, "-c", tmp_path / "tool.json", "--imu", "ax,ay,az", "-o", tmp_path / "o.csv")
    said = "--imu is not used: the calibration has no inertia that counts from an accelerometer"
    assert said in " ".join(done.err.split())
    imu = _table(tmp_path / "imu.csv", {"t": T, **_axes("ax", "ay", "az")})
    imu.write_text(imu.read_text().rstrip("\n"))
    done = run(capsys, "compensate", path, "-c", tmp_path / "tool.json", "--imu", imu, "-o", tmp_path / "o2.csv")
    assert f"Note: {imu}: the last line has no line end: its last number may be cut off\n" in done.err


@pytest.mark.skipif(not Path("/proc/self/mem").exists(), reason="a file that opens and cannot be read")
@pytest.mark.parametrize("verb", ["calibrate", "compensate"])
def test_one_that_cannot_be_read_is_said_before_anything_is_written(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, verb: str
) -> None:
    cw.calibrate(cw.read(PANDA), "mount").save(tmp_path / "tool.json")
    imu, output = tmp_path / "imu.csv", tmp_path / ("o.csv" if verb == "compensate" else "o.json")
    imu.symlink_to("/proc/self/mem")
    by = ("-c", tmp_path / "tool.json") if verb == "compensate" else ()
    done = run(capsys, verb, PANDA, *by, "--imu", imu, "-o", output)
    said = f"contactwrench: {imu}: cannot be read (input/output error): check the path and its permissions\n"
    assert (done.status, done.err, output.exists()) == (2, said, False)
