"""What `compensate` writes and what the reading flags mean, proven by physics in base axes that the package never saw.

A rig hangs on an arm, a person pushes on its tool at the tool centre point with a force that is known in base axes
and without any moment about that point.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

import contactwrench as cw
from tests.support.recordings import MATRIX, WRENCH, Array, Run, beside_its_doubt, csv_text, run, written
from tests.support.rigs import example, noisy
from tests.support.world import Rig, random_rotations, readings

Capture = pytest.CaptureFixture[str]

COLUMNS = ["fx", "fy", "fz", "tx", "ty", "tz", "fx_std", "fy_std", "fz_std", "tx_std", "ty_std", "tz_std"]
TCP = np.array([0.02, -0.05, 0.18])
PUSH = np.array([6.0, -11.0, 4.0])


class Pushed:
    """A calibrated rig and a recording of a push on its tool, as files."""

    def __init__(self, folder: Path) -> None:
        self.rig, poses, rng = example(21)
        tiny = np.array([1e-4] * 3 + [1e-5] * 3)
        self.calibration_file = folder / "tool.json"
        cw.calibrate(noisy(self.rig, poses, rng, tiny), "mount").save(self.calibration_file)
        self.calibration = cw.Calibration.load(self.calibration_file)
        self.R_base_flange = random_rotations(12, rng)
        self.R_base_sensor = self.R_base_flange @ self.rig.R_flange_sensor
        self.wrench = readings(self.rig, self.R_base_flange) + self.in_sensor(pushes(self.R_base_sensor))
        self.t_ms = np.array([300.0, 100.0, 200.0] * 4)
        table = np.column_stack([self.t_ms, self.wrench, self.R_base_flange.reshape(-1, 9)])
        self.recording = written(folder, csv_text(("t_ms", *WRENCH, *MATRIX), table))

    def in_sensor(self, wrench_base: Array) -> Array:
        """Wrenches (n, 6) about the sensor's origin, from base axes to the sensor's."""
        return turned(self.R_base_sensor.transpose(0, 2, 1), wrench_base)

    def compensated(self, capsys: Capture, *flags: str) -> Array:
        done = run(capsys, "compensate", self.recording, "-c", self.calibration_file, "-o", "-", *flags)
        return table_of(done)[:, 1:]


def turned(R: Array, wrench: Array) -> Array:
    """Forces and torques turned by R (n, 3, 3)."""
    return np.column_stack([np.einsum("nij,nj->ni", R, part) for part in (wrench[:, :3], wrench[:, 3:])])


def pushes(R_base_sensor: Array) -> Array:
    """The push in base axes, with its torque about the sensor's origin."""
    return np.column_stack([np.tile(PUSH, (len(R_base_sensor), 1)), np.cross(R_base_sensor @ TCP, PUSH)])


def table_of(done: Run) -> Array:
    assert (done.status, beside_its_doubt(done.err)) == (0, "")
    lines = done.out.splitlines()
    assert lines[0].split(",")[-12:] == COLUMNS
    return np.array([[float(cell) for cell in line.split(",")] for line in lines[1:]])


@pytest.fixture(scope="module")
def pushed(tmp_path_factory: pytest.TempPathFactory) -> Pushed:
    return Pushed(tmp_path_factory.mktemp("pushed"))


def test_a_row_for_each_row_in_order_with_its_time(pushed: Pushed, capsys: Capture, tmp_path: Path) -> None:
    target = tmp_path / "contact.csv"
    done = run(capsys, "compensate", pushed.recording, "-c", pushed.calibration_file, "-o", target)
    assert done == Run(0, f"Wrote the contact wrenches, 12 rows, to {target}\n", "")
    lines = target.read_text().splitlines()
    assert lines[0].split(",") == ["t", *COLUMNS]
    assert [line.split(",")[0] for line in lines[1:4]] == ["0.3", "0.1", "0.2"]
    values = np.array([[float(cell) for cell in line.split(",")] for line in lines[1:]])
    assert values[:, 0].tolist() == (pushed.t_ms / 1e3).tolist()
    assert values[:, 1:7] == pytest.approx(pushed.in_sensor(pushes(pushed.R_base_sensor)), abs=1e-3)
    assert values[:, 7:] == pytest.approx(pushed.calibration.wrench_std(pushed.R_base_flange), rel=1e-8)


def test_without_times_there_is_no_column_t(pushed: Pushed, capsys: Capture, tmp_path: Path) -> None:
    table = np.column_stack([pushed.wrench, pushed.R_base_flange.reshape(-1, 9)])
    path = written(tmp_path, csv_text((*WRENCH, *MATRIX), table))
    done = run(capsys, "compensate", path, "-c", pushed.calibration_file, "-o", "-")
    assert done.out.splitlines()[0].split(",") == COLUMNS
    assert len(done.out.splitlines()) == 13


def test_times_in_unix_microseconds_come_back_as_seconds_to_the_last_digit(
    pushed: Pushed, capsys: Capture, tmp_path: Path
) -> None:
    table = pushed.recording.read_text().replace("t_ms", "t_us").replace("\n300.0,", "\n1700000000123457,", 1)
    path = written(tmp_path, table)
    done = run(capsys, "compensate", path, "-c", pushed.calibration_file, "-o", "-")
    assert done.out.splitlines()[1].startswith("1700000000.123457,")


def test_in_base_axes_the_force_is_the_push_and_its_torque_is_arm_cross_force(pushed: Pushed, capsys: Capture) -> None:
    wrench = pushed.compensated(capsys, "--output-frame", "base")[:, :6]
    assert wrench == pytest.approx(pushes(pushed.R_base_sensor), abs=1e-3)


def test_in_flange_axes_the_push_is_turned_by_the_flange(pushed: Pushed, capsys: Capture) -> None:
    wrench = pushed.compensated(capsys, "--output-frame", "flange")[:, :6]
    R_flange_base = pushed.R_base_flange.transpose(0, 2, 1)
    assert wrench == pytest.approx(turned(R_flange_base, pushes(pushed.R_base_sensor)), abs=1e-3)


@pytest.mark.parametrize("frame", ["sensor", "flange", "base"])
def test_about_the_tool_centre_point_the_push_has_no_torque(pushed: Pushed, capsys: Capture, frame: str) -> None:
    at = ",".join(map(str, TCP))
    wrench = pushed.compensated(capsys, "--at", at, "--output-frame", frame)[:, :6]
    assert np.abs(wrench[:, 3:]).max() < 1e-3
    assert np.linalg.norm(wrench[:, :3], axis=1) == pytest.approx(np.linalg.norm(PUSH), abs=1e-3)


def test_a_point_off_the_push_gives_the_torque_of_the_rest_of_the_arm(pushed: Pushed, capsys: Capture) -> None:
    off = np.array([0.0, 0.1, 0.0])
    wrench = pushed.compensated(capsys, "--at=" + ",".join(map(str, TCP + off)), "--output-frame", "base")[:, :6]
    assert wrench[:, 3:] == pytest.approx(np.cross(pushed.R_base_sensor @ -off, PUSH), abs=1e-3)


@pytest.mark.parametrize("frame", ["sensor", "flange", "base"])
@pytest.mark.parametrize("point", [np.zeros(3), TCP])
def test_the_standard_deviations_carry_the_whole_covariance(
    pushed: Pushed, capsys: Capture, frame: str, point: Array
) -> None:
    """The std of a Monte Carlo over calibrations: parameters drawn from their covariance, moved by hand; in flange and
    base axes the push turns with the mounting that is drawn.
    """
    std = pushed.compensated(capsys, "--at=" + ",".join(map(str, point)), "--output-frame", frame)[:, 6:]
    J = pushed.calibration.free_wrench_jacobian(pushed.R_base_flange)
    draws = np.random.default_rng(5).multivariate_normal(np.zeros(13), pushed.calibration.covariance, size=20_000)
    errors = np.einsum("nip,sp->sni", J, draws)
    errors[:, :, 3:] -= np.cross(point, errors[:, :, :3])
    if frame != "sensor":
        push = pushed.in_sensor(pushes(pushed.R_base_sensor))
        push[:, 3:] -= np.cross(point, push[:, :3])
        delta = draws[:, None, 10:13]
        errors -= np.concatenate([np.cross(delta, push[:, :3]), np.cross(delta, push[:, 3:])], axis=2)
    R = {
        "sensor": np.tile(np.eye(3), (12, 1, 1)),
        "flange": np.tile(pushed.rig.R_flange_sensor, (12, 1, 1)),
        "base": pushed.R_base_sensor,
    }[frame]
    drawn = np.concatenate([np.einsum("nij,snj->sni", R, part) for part in (errors[..., :3], errors[..., 3:])], axis=2)
    assert std == pytest.approx(drawn.std(axis=0), rel=0.03)


def as_the_controller_writes_it(rig: Rig, R: Array, flags: Sequence[str]) -> str:
    """A contact-free recording (mounting: identity) by a controller that does what the flags say."""
    wrench = readings(rig, R)
    if "base" in flags:
        wrench = turned(R, wrench)
    if "reaction" in flags:
        wrench = -wrench
    columns = R.transpose(0, 2, 1) if "--inverse-orientation" in flags else R
    return csv_text((*WRENCH, *MATRIX), np.column_stack([wrench, columns.reshape(-1, 9)]))


@pytest.mark.slow
@pytest.mark.parametrize(
    "flags",
    [
        [],
        ["--wrench-frame", "base"],
        ["--sign", "reaction"],
        ["--inverse-orientation"],
        ["--wrench-frame", "base", "--sign", "reaction", "--inverse-orientation", "--orientation", "matrix"],
    ],
)
def test_every_verb_that_reads_takes_the_reading_flags(tmp_path: Path, capsys: Capture, flags: list[str]) -> None:
    rig, R, rng = example(31)
    rig = Rig(rig.weight, rig.com, rig.bias, np.eye(3), rig.down)
    calibration, recording = tmp_path / "tool.json", tmp_path / "again.csv"
    first = written(tmp_path, as_the_controller_writes_it(rig, R, flags))
    recording.write_text(as_the_controller_writes_it(rig, random_rotations(5, rng), flags))

    assert run(capsys, "calibrate", first, "-o", calibration, *flags).status == 0
    loaded = cw.Calibration.load(calibration)
    assert loaded.weight == pytest.approx(rig.weight, abs=1e-6)
    assert loaded.com == pytest.approx(rig.com, abs=1e-6)
    assert loaded.R_flange_sensor == pytest.approx(np.eye(3), abs=1e-6)

    contact = table_of(run(capsys, "compensate", recording, "-c", calibration, "-o", "-", *flags))
    assert np.abs(contact[:, :6]).max() < 1e-6
    limits = ["--limit-force", "1e-5", "--limit-torque", "1e-5"]
    assert run(capsys, "verify", recording, "-c", calibration, *limits, *flags).status == 0


@pytest.mark.slow
def test_a_robot_that_hangs_from_the_ceiling_needs_its_gravity(tmp_path: Path, capsys: Capture) -> None:
    rig, R, _ = example(32)
    hanging = Rig(rig.weight, rig.com, rig.bias, rig.R_flange_sensor, -rig.down)
    path = written(tmp_path, as_the_controller_writes_it(hanging, R, []))
    calibration = tmp_path / "tool.json"
    assert "--gravity 0,0,1" in run(capsys, "calibrate", path, "-o", calibration).complaint
    assert run(capsys, "calibrate", path, "-o", calibration, "--gravity", "0,0,2").status == 0
    assert cw.Calibration.load(calibration).gravity_direction == pytest.approx([0.0, 0.0, 1.0], abs=1e-6)
    assert cw.Calibration.load(calibration).weight == pytest.approx(rig.weight, abs=1e-6)


def test_a_calibration_serves_on_a_robot_that_hangs_otherwise(tmp_path: Path, capsys: Capture, pushed: Pushed) -> None:
    side = np.array([0.6, 0.0, -0.8])
    moved = Rig(pushed.rig.weight, pushed.rig.com, pushed.rig.bias, pushed.rig.R_flange_sensor, side)
    path = written(tmp_path, as_the_controller_writes_it(moved, pushed.R_base_flange, []))
    flags = ["-c", str(pushed.calibration_file), "--gravity=0.6,0,-0.8"]
    contact = table_of(run(capsys, "compensate", path, *flags, "-o", "-"))
    assert np.abs(contact[:, :6]).max() < 1e-3
    assert run(capsys, "verify", path, *flags, "--limit-force", "1e-3").status == 0
    assert run(capsys, "verify", path, *flags[:2], "--limit-force", "1e-3").status == 1
    assert np.array_equal(pushed.calibration.gravity_direction, [0.0, 0.0, -1.0])


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        (["--output-frame", "tool"], "output frame is 'tool', expected sensor, flange, base"),
        (["--at", "1,2"], "--at is '1,2', expected three numbers X,Y,Z, -10 to 10 m (is it in mm?)"),
        (["--at", "1,2,inf"], "--at is '1,2,inf', expected three numbers X,Y,Z, -10 to 10 m (is it in mm?)"),
        (["--at", "tcp"], "--at is 'tcp', expected three numbers X,Y,Z, -10 to 10 m (is it in mm?)"),
    ],
)
def test_bad_frames_and_points_are_refused(pushed: Pushed, capsys: Capture, flags: list[str], message: str) -> None:
    arguments = ["compensate", str(pushed.recording), "-c", str(pushed.calibration_file), "-o", "-", *flags]
    assert run(capsys, *arguments).complaint == message


def test_an_affine_calibration_has_sensor_axes_only(pushed: Pushed, tmp_path: Path, capsys: Capture) -> None:
    rig, R, rng = example(33)
    cw.calibrate(noisy(rig, R, rng), "affine").save(tmp_path / "affine.json")
    arguments = ["compensate", str(pushed.recording), "-c", str(tmp_path / "affine.json"), "-o", "-"]
    assert run(capsys, *arguments, "--at=0,0,0.1").status == 0
    assert run(capsys, *arguments, "--output-frame", "base").complaint == (
        "model affine has no mounting, so no base axes: use sensor, or another model"
    )
