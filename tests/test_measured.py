"""Recordings of real robots that are not part of the project (their licences are not known), where they are at hand.

Expected figures: an independent fit of a rigid model, its mounting free.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import contactwrench as cw
from contactwrench.assess.verify import verify
from contactwrench.calibration.findings import Kind
from contactwrench.estimation.noise import readings_of, stated_noise
from contactwrench.estimation.priors import Question
from contactwrench.estimation.rigid import estimated
from contactwrench.samples.accelerometer import mounted_accelerometer
from tests.support.recordings import run
from tests.support.rigs import rotation_angle

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"
KUKA = DATA / "kuka_atigamma" / "0-calibration_fts-accel.csv"
KUKA_AT_REST = DATA / "kuka_atigamma" / "0-steady-state_wrench.csv"
PANDA = DATA / "panda_mini45" / "static_poses.csv"
AXIA = DATA / "axia80_7"
TASK_RUNS = DATA / "task_runs"

needs_kuka = pytest.mark.skipif(not KUKA.exists(), reason=f"{KUKA} is not at hand")
SWING = [DATA / "kuka_atigamma" / f"1-baseline_{what}.csv" for what in ("wrench", "orientations", "accel")]

needs_axia = pytest.mark.skipif(not AXIA.exists(), reason=f"{AXIA} is not at hand")
needs_task_runs = pytest.mark.skipif(not TASK_RUNS.exists(), reason=f"{TASK_RUNS} is not at hand")


def _kuka() -> cw.Samples:
    """The orientation is R_base_sensor: the mounting that is found should be none."""
    return cw.read(KUKA)


def _axia() -> cw.Samples:
    """R_base_sensor as quaternions x, y, z, w; the wrench in base axes."""
    R = Rotation.from_quat(np.loadtxt(AXIA / "pose.txt", delimiter=",")[:, 3:]).as_matrix()
    wrench = np.loadtxt(AXIA / "wrench.txt", delimiter=",")
    in_sensor = [np.einsum("nji,nj->ni", R, part) for part in (wrench[:, :3], wrench[:, 3:])]
    return cw.Samples(np.hstack(in_sensor), R)


FORCE_FIRST = np.array([1e-3, 1e-3, 1e-3, 1.0, 1.0, 1.0])
"""As noise: the forces alone decide on weight and mounting, as in the independent fit."""


def _left_over(calibration: cw.Calibration, samples: cw.Samples) -> tuple[float, float]:
    """RMS of a component of force (N) and torque (N m) over the rows."""
    left = calibration.compensate(samples.wrench, samples.R_base_flange)
    return float(np.sqrt(np.mean(left[:, :3] ** 2))), float(np.sqrt(np.mean(left[:, 3:] ** 2)))


@needs_kuka
def test_kuka_with_ati_gamma() -> None:
    """The independent fit counts 24 rows; here those that repeat an orientation are one pose of 18."""
    samples = _kuka()
    calibration = cw.calibrate(samples, "mount")
    assert len(calibration.poses) == 18
    assert calibration.weight == pytest.approx(9.156, abs=calibration.std["weight"])
    assert calibration.bias[:3] == pytest.approx([9.077, -1.018, 9.985], abs=0.01)
    assert calibration.com == pytest.approx([0.0003, 0.0001, 0.0439], abs=1.5e-4)
    by_force = cw.calibrate(samples, "mount", noise=FORCE_FIRST)
    force, torque = _left_over(by_force, samples)
    assert 0.0802 <= force < 0.083  # 0.0802: least squares over the 24 rows, nothing is smaller
    assert torque < 4.3e-3


@needs_kuka
def test_kuka_mounting_is_none_and_its_base_upright() -> None:
    calibration = cw.calibrate(_kuka(), "mount+base")
    assert calibration.R_flange_sensor is not None
    assert np.rad2deg(rotation_angle(calibration.R_flange_sensor, np.eye(3))) < 1.5
    assert np.rad2deg(np.arccos(-calibration.gravity_direction[2])) < 1.0


@needs_kuka
def test_kuka_scatter_at_rest_is_not_the_noise_of_a_pose() -> None:
    """The mean of a pose scatters by a few mN, the fit leaves 80 mN: a std from the scatter would be far too small."""
    at_rest = np.loadtxt(KUKA_AT_REST, delimiter=",", skiprows=1)
    estimated = cw.calibrate(_kuka(), "mount")
    from_rest = cw.calibrate(_kuka(), "mount", noise=at_rest.std(axis=0, ddof=1) / np.sqrt(len(at_rest)))
    assert from_rest.reduced_chi2 > 400.0
    assert from_rest.std["weight"] == pytest.approx(estimated.std["weight"], rel=0.7)


@needs_kuka
def test_kuka_each_half_predicts_the_other() -> None:
    samples = _kuka()
    even, odd = samples.select(np.arange(0, 24, 2)), samples.select(np.arange(1, 24, 2))
    for mine, other in ((even, odd), (odd, even)):
        calibration = cw.calibrate(mine, "mount")
        assert verify(calibration, other, limit_force=0.5, limit_torque=0.02).passed
        assert calibration.held_out_rms is not None
        left = np.sqrt(np.mean(calibration.compensate(other.wrench, other.R_base_flange) ** 2, axis=0))
        assert np.linalg.norm(left[:3]) < 2.0 * np.linalg.norm(calibration.held_out_rms[:3])


@needs_axia
def test_axia80_by_force_first_is_the_independent_fit_to_its_last_digit() -> None:
    """Where nothing moves and no gain is off; the mean over all that may be lies within its std of it."""
    samples = _axia()
    calibration = cw.calibrate(samples, "mount", noise=FORCE_FIRST)
    assert len(calibration.fitted_poses) == len(calibration.poses)
    question = Question("mount", np.array([0.0, 0.0, -1.0]), stated_noise(FORCE_FIRST))
    plain = estimated(readings_of(calibration.poses, False), question, plain=True)
    assert plain.tool.weight == pytest.approx(10.804, abs=6e-4)
    assert plain.tool.bias[:3] == pytest.approx([-2.137, -2.761, -13.079], abs=6e-4)
    assert plain.tool.com == pytest.approx([-0.0001, -0.0004, 0.0519], abs=6e-5)
    assert float(np.sqrt(np.mean(plain.errors[:, :3] ** 2))) == pytest.approx(0.149, abs=6e-4)
    assert float(np.sqrt(np.mean(plain.errors[:, 3:] ** 2))) == pytest.approx(2.3e-3, abs=6e-5)
    assert calibration.weight == pytest.approx(10.804, abs=2.0 * calibration.std["weight"])


@needs_axia
@pytest.mark.parametrize("model", ["mount", "mount+base"])
def test_axia80_with_the_noise_estimated(model: str) -> None:
    calibration = cw.calibrate(_axia(), model)
    assert calibration.weight == pytest.approx(10.804, abs=2.0 * calibration.std["weight"])
    assert np.all(np.abs(calibration.bias[:3] - [-2.137, -2.761, -13.079]) < 3.0 * calibration.std["bias"][:3])


@pytest.mark.slow
@needs_task_runs
@pytest.mark.parametrize("name", ["franka_1", *(f"ur5e_{k}" for k in (1, 2, 3, 4, 5, "still_11", "still_82"))])
def test_a_task_is_no_calibration(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Contacts and hardly a stop: refused in one line, or called weak or doubtful, and never good."""
    path = TASK_RUNS / f"{name}.csv"
    calibrated = run(capsys, "calibrate", path)
    if calibrated.status == 2:
        assert "stop for a second or two at each" in calibrated.complaint
    else:
        (verdict,) = (line for line in calibrated.out.splitlines() if line.startswith("Verdict"))
        assert any(word in verdict for word in ("weak", "doubtful"))
    diagnosed = run(capsys, "diagnose", path)
    assert diagnosed.status == 0 or "expected 5 or more to tell one interpretation from another" in diagnosed.complaint


def _printed() -> cw.Samples:
    """2,000 rows at each of 12 orientations, no times."""
    return cw.read(DATA / "printed_sensor" / "rows.csv", orientation="euler:xyz:rad:roll,pitch,yaw")


@needs_kuka
@pytest.mark.parametrize(
    ("recorded", "weight"),
    [(_kuka, 9.156), (_axia, 10.804), (_printed, 3.031), (lambda: cw.read(PANDA), 0.78813 * 9.81)],
    ids=["kuka", "axia", "printed", "panda"],
)
def test_the_stated_weight_lies_within_three_std_from_rows_and_from_means(
    recorded: Callable[[], cw.Samples], weight: float
) -> None:
    rows = cw.calibrate(recorded())
    means = cw.Samples(
        np.array([pose.wrench for pose in rows.poses]), np.array([pose.R_base_flange for pose in rows.poses])
    )
    for calibration in (rows, cw.calibrate(means)):
        assert calibration.weight is not None
        assert abs(calibration.weight - weight) < 3.0 * calibration.std["weight"]
        assert calibration.std["weight"] < 0.05 * weight


@needs_kuka
def test_a_swing_without_positions_is_calibrated_by_an_accelerometer(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """An arm that turns about one axis, with the tool of the static poses: what one axis leaves untold is named, and
    free motion is free of contact, a quarter of which is contact without the inertia.
    """
    tool, swing = tmp_path / "tool.json", tmp_path / "swing.json"
    assert run(capsys, "calibrate", KUKA, "-o", tool).status == 0
    wrench, pose, imu = SWING
    recording = ("--wrench", wrench, "--pose", pose, "--imu", imu)
    assert run(capsys, "calibrate", *recording, "--prior", tool, "--model", "dynamic", "-o", swing).status == 0
    found = cw.Calibration.load(swing)
    dynamics = found.dynamics
    assert dynamics is not None
    assert dynamics.accelerometer is not None
    assert dynamics.accelerometer.unit == "g"
    assert not dynamics.accelerometer.mirrors
    assert dynamics.accelerometer.delay == pytest.approx(0.0065, abs=0.001)
    assert found.verdict == "weak"
    untold = next(finding.text for finding in found.findings if finding.kind is Kind.UNTOLD_BY_MOTION)
    assert "the motion tells nothing of inertia_xx, " in untold
    assert "offset_y" in untold
    assert dynamics.residual_rms[0] < 0.8 * dynamics.static_rms[0]
    shares = []
    for calibration in (tool, swing):
        contact = tmp_path / f"{calibration.stem}.csv"
        assert run(capsys, "compensate", *recording, "-c", calibration, "--contact", "-o", contact).status == 0
        header, *rows = contact.read_text().splitlines()
        place = header.split(",").index("contact")
        shares.append(np.mean([row.split(",")[place] == "1" for row in rows]))
    assert shares[0] > 0.2
    assert shares[1] <= 0.01
    _feels_nothing_sample_by_sample(found, cw.read(wrench, pose_file=pose, imu=str(imu)))


def _feels_nothing_sample_by_sample(swing: cw.Calibration, samples: cw.Samples) -> None:
    """Though the accelerometer is 6 ms late: what shakes is in the std, and below 10 Hz less is left than without."""
    left = []
    for lowpass, given in ((None, samples.accelerometer), (10.0, samples.accelerometer), (10.0, None)):
        compensator = cw.Compensator(swing, rate=697.8, lowpass=lowpass)
        found = compensator.run(samples.wrench, samples.R_base_flange, np.asarray(samples.t), acceleration=given)
        left.append(float(np.sqrt(np.mean(found.wrench[200:, :3] ** 2))))
        assert given is None or not (found.contact == 1).any()
    assert left[1] < 0.75 * left[2]


@needs_kuka
def test_its_accelerometer_sits_as_in_the_static_poses() -> None:
    """Whose readings beside each pose tell it by themselves."""
    columns = np.genfromtxt(KUKA, delimiter=",", names=True)
    reading = np.stack([columns[name] for name in ("ax", "ay", "az")], axis=1)
    force = _kuka().R_base_flange[:, 2] * 9.81  # against gravity
    least_squares = np.linalg.lstsq(np.column_stack([force, np.ones(len(force))]), reading, rcond=None)[0]
    wrench, pose, imu = SWING
    samples = cw.read(wrench, pose_file=pose, imu=str(imu))
    sits, _ = mounted_accelerometer(samples, np.array([0.0, 0.0, -9.81]))
    assert sits.matrix == pytest.approx(least_squares[:3].T, abs=0.004)
    assert sits.bias == pytest.approx(least_squares[3], abs=0.01)
