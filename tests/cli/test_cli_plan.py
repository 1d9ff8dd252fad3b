"""`contactwrench plan`, word for word."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import contactwrench as cw
from benchmarks.plan import A_KILOGRAM, DECENT
from contactwrench.assess.robot_arms import ARMS, flange_orientation
from tests.assess.test_robot_arms import urdf_of
from tests.support.recordings import PAPER, run, written
from tests.support.rigs import rotation_angle
from tests.support.world import noisy_readings


def lines(text: str) -> list[str]:
    return text.splitlines()


def test_a_plan_is_a_table_of_poses_and_what_they_are_worth(capsys: pytest.CaptureFixture[str]) -> None:
    done = run(capsys, "plan")
    assert done.status == 0
    assert done.err == ""
    shown = lines(done.out)
    assert shown[0] == "Plan of 8 poses after 0, model auto"
    assert shown[1] == "  assumed: a tool of 10 N, a noise of 0.05 N and 2 mN m in a pose's reading"
    assert shown[3].split() == ["down,", "in", "flange", "axes", "flange", "z", "turn"]
    assert shown[4].split() == ["pose", "x", "y", "z", "from", "down", "qx", "qy", "qz", "qw"]
    assert [line.split()[0] for line in shown[5:13]] == [str(k) for k in range(1, 9)]
    assert shown[14] == "  std of the contact wrench because of the calibration, over all orientations"
    assert shown[16].split()[0::2] == ["after", "N", "mN", *shown[16].split()[6::2]]
    assert len(shown) == 17
    assert max(map(len, shown)) <= 80


def test_where_only_the_yaw_is_open_six_poses_do(capsys: pytest.CaptureFixture[str]) -> None:
    assert lines(run(capsys, "plan", "--model", "yaw").out)[0] == "Plan of 6 poses after 0, model yaw"


def test_the_poses_of_a_plan_do_for_any_mounting(capsys: pytest.CaptureFixture[str]) -> None:
    """Six leave too few degrees of freedom in one of five tables."""
    planned = json.loads(run(capsys, "plan", "--json").out)
    R = Rotation.from_quat([pose["quat_xyzw"] for pose in planned["poses"]])
    for seed in range(12):
        rng = np.random.default_rng(seed)
        mount, com = Rotation.random(random_state=rng), np.array([0.01, 0.0, 0.06])
        force = (R * mount).inv().apply([0.0, 0.0, -rng.uniform(5.0, 20.0)])
        noise = rng.normal(size=(len(force), 6)) * np.repeat([0.05, 0.002], 3)
        calibration = cw.calibrate(cw.Samples(np.hstack([force, np.cross(com, force)]) + noise, R.as_matrix()))
        assert calibration.verdict != "weak"


def test_poses_after_a_recording_say_what_was_before(capsys: pytest.CaptureFixture[str]) -> None:
    shown = lines(run(capsys, "plan", "-n", "2", "--from", PAPER, "--model", "mount").out)
    assert shown[0] == "Plan of 2 poses after 6, model mount"
    assert shown[1].startswith(f"  fitted to {PAPER}: a tool of 6.86 N, a noise of ")
    assert [line.split()[0] for line in shown[-2:]] == ["before", "after"]


def test_a_recording_that_cannot_be_calibrated_says_why(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    text = "\n".join([line for line in PAPER.read_text().splitlines() if not line.startswith("#")][:3]) + "\n"
    path = written(tmp_path, text)
    shown = lines(run(capsys, "plan", "-n", "1", "--from", path, "--model", "mount").out)
    assert shown[1].startswith(f"  {path}: cannot separate ")
    assert shown[2].startswith("  assumed: a tool of 10 N")
    assert shown[-2].split() == ["before", "cannot", "be", "calibrated"]
    assert shown[-1].split()[0] == "after"


def test_too_few_poses_are_said_to_be(capsys: pytest.CaptureFixture[str]) -> None:
    shown = lines(run(capsys, "plan", "-n", "1").out)
    assert shown[0] == "Plan of 1 pose after 0, model auto"
    assert shown[-1] == "  These poses are too few to calibrate with: plan more"


@pytest.mark.slow
def test_the_csv_is_what_calibrate_reads_once_the_readings_are_in(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    done = run(capsys, "plan", "-n", "8", "--model", "mount", "--robot", "iiwa 14", "-o", tmp_path / "plan.csv")
    assert done.out.endswith(f"Wrote the poses to {tmp_path / 'plan.csv'}\n")
    header, *rows = lines((tmp_path / "plan.csv").read_text())
    assert header == "qx,qy,qz,qw,q1,q2,q3,q4,q5,q6,q7"
    table = np.array([[float(cell) for cell in row.split(",")] for row in rows])
    assert table.shape == (8, 11)
    R = flange_orientation(ARMS["iiwa14"], table[:, 4:])
    readings = noisy_readings(A_KILOGRAM, R, DECENT, np.random.default_rng(1))
    filled = [row + "," + ",".join(map(repr, reading)) for row, reading in zip(rows, readings.tolist(), strict=True)]
    path = written(tmp_path, "\n".join([header + ",fx,fy,fz,tx,ty,tz", *filled]) + "\n")
    samples = cw.read(path)
    assert max(rotation_angle(a, b) for a, b in zip(samples.R_base_flange, R, strict=True)) < 1e-8
    assert run(capsys, "calibrate", path, "--model", "mount").status == 0


def test_the_csv_goes_to_stdout_alone(capsys: pytest.CaptureFixture[str]) -> None:
    done = run(capsys, "plan", "-n", "3", "-o", "-")
    assert lines(done.out)[0] == "qx,qy,qz,qw"
    assert len(lines(done.out)) == 4
    assert np.linalg.norm([float(cell) for cell in lines(done.out)[1].split(",")]) == pytest.approx(1.0, abs=1e-8)


@pytest.mark.slow
def test_json_is_everything_and_nothing_else(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    done = run(capsys, "plan", "-n", "2", "--from", PAPER, "--robot", "ur5e", "--json", "-o", tmp_path / "plan.csv")
    values = json.loads(done.out)
    assert set(values) == {"model", "expected", "recorded", "robot", "poses", "before", "after", "anywhere"}
    assert set(values["robot"]) == {"arm", "around"}
    assert values["recorded"] == 6
    assert values["expected"]["fitted_to"] == str(PAPER)
    assert values["before"]["force"] > values["after"]["force"]
    assert set(values["poses"][0]) == {"quat_xyzw", "joints", "down_in_flange", "turn"}
    assert len(values["poses"][1]["joints"]) == 6
    assert (tmp_path / "plan.csv").exists()
    assert json.loads(run(capsys, "plan", "-n", "1", "--json").out)["robot"] is None


def test_a_robot_moves_its_wrist_around_where_it_stands(capsys: pytest.CaptureFixture[str]) -> None:
    shown = lines(run(capsys, "plan", "-n", "4", "--robot", "panda", "--around", "0,-0.5,0.1,-2,0,1.5,0.8").out)
    assert shown[2] == "  by the wrist of panda around 0 -0.5 0.1 -2 0 1.5 0.8 rad; joints that stay: q1 q2 q3 q4"
    assert shown[11].split() == ["pose", "q1", "q2", "q3", "q4", "q5", "q6", "q7", "rad"]
    assert shown[12].split()[:5] == ["1", "0.0000", "-0.5000", "0.1000", "-2.0000"]
    assert shown[-1] == "  Collisions and cables are not checked: run the poses slowly once"


def test_a_urdf_is_a_robot(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    path = written(tmp_path, urdf_of("panda"), "arm.urdf")
    assert "by the wrist of arm.urdf:tool0 around" in run(capsys, "plan", "-n", "3", "--robot", path).out
    assert "by the wrist of arm.urdf:l6 around" in run(capsys, "plan", "-n", "3", "--robot", f"{path}:l6").out


def test_a_wrist_that_reaches_little_is_said_to_cost(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    advice = "  The wrist cannot reach the best orientations from here: try another place (--around)"
    narrow = written(tmp_path, urdf_of("ur5e", -0.5, 0.5), "narrow.urdf")
    wide = written(tmp_path, urdf_of("ur5e", -3.0, 3.0), "wide.urdf")
    assert advice in lines(run(capsys, "plan", "-n", "4", "--robot", narrow).out)
    assert advice not in lines(run(capsys, "plan", "-n", "4", "--robot", wide).out)


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (("-n", "0"), "Invalid value for '-n': found 0, expected 1 to 100: try 'contactwrench plan --help'"),
        (("--model", "affine"), "model 'affine' cannot be planned for, expected one of auto, yaw, mount, mount+base"),
        (
            ("--robot", "kr16"),
            "robot 'kr16' is not known, expected iiwa7, iiwa14, ur3e, ur5e, ur10e, ur16e, ur20, panda, fr3 or a file "
            "that ends in .urdf",
        ),
        (
            ("--around", "0,0,0"),
            "--around says where a robot stands, and there is none: give --robot, or leave it out",
        ),
        (
            ("--robot", "ur5e", "--around", "0,x"),
            "--around is '0,x', expected joint angles Q1,Q2,..., -1000 to 1000 rad",
        ),
        (
            ("--robot", "ur5e", "--around", "0,0"),
            "found 2 joint angles, expected 6 for ur5e: give one a joint, rad",
        ),
        (
            ("--robot", "iiwa7", "--around", "0,0,0,0,0,2.2,0"),
            "q6 of iiwa7 is 2.2 rad, expected -2.094 to 2.094",
        ),
        (
            ("--sign", "reaction", "--units", "torque=Nmm"),
            "found --sign, --units and no recording to read so: give --from FILE, or leave them out",
        ),
        (
            ("--json", "-o", "-"),
            "--json and --output - both write to stdout, expected one of them: name a file for --output",
        ),
        (("--robot", "gone.urdf"), "gone.urdf: there is no such file, expected a readable file: check the path"),
        (("--from", "gone.csv"), "gone.csv: there is no such file, expected a readable file: check the path"),
    ],
)
def test_bad_use_is_one_line(
    arguments: tuple[str, ...], complaint: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    assert run(capsys, "plan", *arguments).complaint == complaint


def test_a_recording_is_read_by_the_options_of_every_verb(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    usual = json.loads(run(capsys, "plan", "-n", "1", "--from", PAPER, "--json").out)
    text = PAPER.read_text().replace("fx,fy,fz,tx,ty,tz", "g1,g2,g3,g4,g5,g6", 1)
    renamed = written(tmp_path, text)
    done = run(capsys, "plan", "-n", "1", "--from", renamed, "--json", "--wrench-columns", "g1,g2,g3,g4,g5,g6")
    assert json.loads(done.out)["poses"] == usual["poses"]


def test_what_is_read_is_not_overwritten(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    recording = written(tmp_path, PAPER.read_text())
    done = run(capsys, "plan", "--from", recording, "-o", recording)
    assert done.complaint == f"{recording}: found what is read as {recording}, expected another file to write: name one"
    arm = written(tmp_path, urdf_of("ur5e"), "arm.urdf")
    done = run(capsys, "plan", "--robot", f"{arm}:tool0", "-o", arm)
    assert done.complaint == f"{arm}: found what is read as {arm}, expected another file to write: name one"
