"""`contactwrench simulate`: recordings of the virtual rig, their truth, and every message word for word.

What is read back is judged by the static balance of tests/support/world.py, by weighings, by the verbs that read it.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

import contactwrench as cw
from contactwrench.simulate import kinematics
from contactwrench.simulate.settings import Settings, changed
from contactwrench.simulate.trajectory import Motion, exciting, sweeping, through
from tests.support.recordings import PAPER, run
from tests.support.world import Rig, readings

pytest.importorskip("mujoco", reason="mujoco is not installed")

Capture = pytest.CaptureFixture[str]
SILENT = [
    f"--set={name}=0" for name in ("sensor.noise.force", "sensor.noise.torque", "sensor.quantum", "sensor.low_pass")
]
SKEWED = ["--set=mounting.tilt_deg=[3,-8]", "--set=base.on=wall", "--set=base.tilt_deg=[4,7]", "--set=tool.mass=1.3"]


def simulated(capsys: Capture, folder: Path, *flags: str) -> tuple[cw.Samples, dict[str, object], np.ndarray]:
    """A recording, its truth, and all of its columns."""
    target = folder / "out.csv"
    done = run(capsys, "simulate", "--force", "-o", target, *flags)
    assert (done.status, done.err) == (0, "")
    truth = json.loads((folder / "out.truth.json").read_text())
    return cw.read(target), truth, np.genfromtxt(target, delimiter=",", names=True)


def true_rig(truth: dict[str, object]) -> Rig:
    com, bias, R, down = (np.array(truth[key]) for key in ("com", "bias", "R_flange_sensor", "gravity_direction"))
    weight = truth["weight"]
    assert isinstance(weight, float)
    return Rig(weight, com, bias, R, down)


@pytest.mark.parametrize("flags", [["--poses=paper"], ["--poses=random:9", *SKEWED, "--set=mounting.yaw_deg=-160"]])
def test_the_readings_are_what_statics_says_of_the_stated_truth(
    tmp_path: Path, capsys: Capture, flags: list[str]
) -> None:
    limitless = "--set=sensor.overload=100"
    samples, truth, _ = simulated(capsys, tmp_path, *flags, *SILENT, limitless)
    assert np.abs(samples.wrench - readings(true_rig(truth), samples.R_base_flange)).max() < 1e-6


def test_the_papers_poses_are_the_papers(tmp_path: Path, capsys: Capture) -> None:
    samples, _, _ = simulated(capsys, tmp_path)
    printed = cw.read(PAPER)
    assert samples.position is not None
    assert printed.position is not None
    assert np.abs(samples.R_base_flange - printed.R_base_flange).max() < 1e-9
    assert np.abs(samples.position - printed.position).max() < 1e-8


@pytest.mark.slow
def test_calibrating_a_recording_finds_the_truth(tmp_path: Path, capsys: Capture) -> None:
    samples, truth, _ = simulated(capsys, tmp_path, "--poses=plan:12", *SKEWED[:1], "--set=sensor.overload=2")
    calibration = cw.calibrate(samples, "mount")
    rig = true_rig(truth)
    off = np.concatenate([[calibration.weight or 0.0], calibration.bias]) - np.concatenate([[rig.weight], rig.bias])
    std = np.concatenate([[calibration.std["weight"]], np.atleast_1d(calibration.std["bias"])])
    assert np.abs(off / std).max() < 4.0


def test_loads_are_weighed_by_what_they_add(tmp_path: Path, capsys: Capture) -> None:
    """Every pose comes with each load; the force that a load adds is its weight, down, in whatever axes."""
    loads = np.array([0.0, 100.0, 500.0, 1000.0])
    wide = "--set=sensor.overload=100"
    _, truth, table = simulated(
        capsys, tmp_path, "--poses=random:5", "--load-g=0,100,500,1000", *SILENT, wide, "--set=gravity=9.81"
    )
    assert np.array_equal(table["load_g"], np.repeat(loads, 5))
    force = np.stack([table[name] for name in ("fx", "fy", "fz")], axis=1).reshape(4, 5, 3)
    torque = np.stack([table[name] for name in ("tx", "ty", "tz")], axis=1).reshape(4, 5, 3)
    added = force - force[0]
    assert np.linalg.norm(added, axis=2) == pytest.approx(np.repeat(loads[:, None] * 9.81e-3, 5, axis=1), abs=1e-5)
    assert isinstance(truth["settings"], dict)
    hook = np.array(truth["settings"]["tool"]["hook"])
    assert np.abs(torque - torque[0] - np.cross(hook, added)).max() < 1e-5


@pytest.mark.slow
def test_a_recording_passes_verification_and_weighing(tmp_path: Path, capsys: Capture) -> None:
    target, loaded = tmp_path / "free.csv", tmp_path / "loaded.csv"
    run(capsys, "simulate", "-o", target, "--poses=plan:10", "--set=sensor.overload=2")
    run(capsys, "simulate", "-o", loaded, "--load-g=0,100,500", "--seed=4", "--set=sensor.overload=2")
    assert run(capsys, "calibrate", target, "-o", tmp_path / "cal.json").status == 0
    assert run(capsys, "verify", loaded, "-c", tmp_path / "cal.json").status == 0


def test_same_seed_same_bytes_and_another_seed_others(tmp_path: Path, capsys: Capture) -> None:
    flags = ["--poses=random:3", "--load-g=0,200", "--set=sensor.drift.walk=0.5", "--set=recording.creep=0.02"]
    contents = []
    for name, seed in (("a", 7), ("b", 7), ("c", 8)):
        target = tmp_path / f"{name}.csv"
        assert run(capsys, "simulate", "-o", target, f"--seed={seed}", *flags).status == 0
        contents.append((target.read_bytes(), (tmp_path / f"{name}.truth.json").read_bytes()))
    assert contents[0] == contents[1]
    assert contents[0][0] != contents[2][0]


def test_a_saturated_reading_is_flagged_and_said(tmp_path: Path, capsys: Capture) -> None:
    """5 kg beyond a bias of 57.7 N are more than 84 N, tool down; without the load there is room."""
    target = tmp_path / "out.csv"
    done = run(capsys, "simulate", "-o", target, "--load-g=0,5000")
    table = np.genfromtxt(target, delimiter=",", names=True)
    assert np.array_equal(table["saturated"], np.repeat([0.0, 1.0], 6))
    assert table["fz"][6:].max() == 84.0
    assert done.out.splitlines()[0] == f"Wrote 12 rows to {target}, and what is true to {tmp_path / 'out.truth.json'}"
    assert done.out.splitlines()[1].startswith("  saturated: fz in 6")
    truth = json.loads((tmp_path / "out.truth.json").read_text())
    assert truth["saturated"]["fz"] == 6
    assert truth["saturated"]["fx"] == 0


def test_the_truth_says_what_is_felt_in_motion_only(tmp_path: Path, capsys: Capture) -> None:
    target = tmp_path / "out.csv"
    inertia = "--set=tool.inertia=[0.004,0.0005,0,0.003,0,0.002]"
    run(capsys, "simulate", "-o", target, inertia, "--set=mounting.height=0.05")
    truth = json.loads((tmp_path / "out.truth.json").read_text())
    assert truth["inertia"] == [[0.004, 0.0005, 0.0], [0.0005, 0.003, 0.0], [0.0, 0.0, 0.002]]
    assert truth["sensor_offset"] == [0.0, 0.0, 0.05]


def test_a_pose_below_the_table_is_said(tmp_path: Path, capsys: Capture) -> None:
    goals = tmp_path / "low.csv"
    goals.write_text("q1,q2,q3,q4,q5,q6,q7\n0,0.5,0,-1,0,1,0\n0,1.9,0,-2,0,-2,0\n")
    done = run(capsys, "simulate", "--force", "-o", tmp_path / "out.csv", f"--poses={goals}", "--set=sensor.bias=0")
    assert done.out.splitlines()[1:] == [
        "  below: in 1 of 2 rows, the first of them row 3, the flange is below the plane that the robot stands on; "
        "nothing stops it here"
    ]


def test_rows_of_a_pose_and_times(tmp_path: Path, capsys: Capture) -> None:
    samples, _, _ = simulated(capsys, tmp_path, "--set=recording.rows=3", "--set=recording.settle=1")
    assert samples.t is not None
    assert np.allclose(samples.t[:6], [1.0, 1.001, 1.002, 2.003, 2.004, 2.005])
    assert np.abs(samples.R_base_flange[0] - samples.R_base_flange[2]).max() == 0.0


@pytest.mark.slow
def test_the_robots_pose_error_is_the_stated_orientations(tmp_path: Path, capsys: Capture) -> None:
    size = 0.3
    flags = ["--poses=random:200", "--seed=5"]
    exact, _, _ = simulated(capsys, tmp_path, *flags)
    off, _, _ = simulated(capsys, tmp_path, *flags, f"--set=recording.orientation_error_deg={size}")
    turn = exact.R_base_flange.transpose(0, 2, 1) @ off.R_base_flange
    angle = np.rad2deg(np.arccos(np.clip((np.trace(turn, axis1=1, axis2=2) - 1.0) / 2.0, -1.0, 1.0)))
    assert np.sqrt(np.mean(angle**2)) == pytest.approx(size * np.sqrt(3.0), rel=0.12)


def test_a_reading_in_motion_is_late_by_filter_and_delay(tmp_path: Path, capsys: Capture) -> None:
    """A slow turn is read as it was a filter's time constant and a delay before: 1 / (2 pi 5 Hz) + 10 ms."""
    flags = ["--poses=random:6", "--seed=2", *SILENT[:3], "--set=sensor.low_pass=5", "--set=sensor.delay=0.01"]
    flags += ["--set=sensor.overload=100"]
    still, _, _ = simulated(capsys, tmp_path, *flags)
    slow, _, _ = simulated(capsys, tmp_path, *flags, "--set=recording.creep=0.001")
    slower, _, _ = simulated(capsys, tmp_path, *flags, "--set=recording.creep=0.002")
    first, second = slow.wrench - still.wrench, slower.wrench - still.wrench
    assert np.abs(first[:, :3]).max() > 1e-5
    assert np.abs(second - 2.0 * first).max() < 0.02 * np.abs(second).max()


@pytest.mark.slow
@pytest.mark.parametrize("motion", ["excite", "sweep"])
def test_a_motion_is_a_recording_at_the_sensors_rate(tmp_path: Path, capsys: Capture, motion: str) -> None:
    samples, truth, table = simulated(
        capsys, tmp_path, f"--trajectory={motion}", "--set=recording.duration=10", *SILENT, "--set=sensor.delay=0"
    )
    assert len(samples) == 10001
    assert samples.t is not None
    assert np.allclose(np.diff(samples.t), 1e-3)
    assert table["q2"][0] == pytest.approx(np.deg2rad(30.0))
    rig = true_rig(truth)
    felt = np.linalg.norm(samples.wrench[:, :3] - rig.bias[:3], axis=1)
    assert felt.mean() == pytest.approx(rig.weight, rel=0.05)
    tilt = np.rad2deg(np.arccos(np.clip(-samples.R_base_flange[:, 2, 2], -1.0, 1.0)))
    assert tilt.max() - tilt.min() > 20.0


@pytest.mark.slow
def test_a_motion_with_stops_rests_at_each(tmp_path: Path, capsys: Capture) -> None:
    flags = ["--trajectory=stops:4", "--set=recording.rest=0.8", "--set=recording.rate=200"]
    samples, _, table = simulated(capsys, tmp_path, *flags)
    joints = np.stack([table[f"q{k}"] for k in range(1, 8)], axis=1)
    still = np.concatenate([[False], np.abs(np.diff(joints, axis=0)).max(axis=1) < 1e-9])
    edges = np.flatnonzero(np.diff(still.astype(int)))
    lengths = np.diff(np.r_[edges, len(still) - 1])[::2] / 200.0
    assert lengths == pytest.approx(np.full(5, 0.8), abs=0.05)  # at home, and at each of the four poses
    directions = samples.R_base_flange[edges[2::2] + 5, 2]
    assert np.linalg.norm(directions[:, None] - directions, axis=2)[np.triu_indices(4, 1)].min() > 0.5


def test_a_push_is_felt_at_the_sensor_as_statics_says(tmp_path: Path, capsys: Capture) -> None:
    """A force f on the hook p: R_sensor_base f, and the torque p x that, whatever the arm does meanwhile."""
    flags = ["--trajectory=excite", "--set=recording.duration=12", "--set=recording.rate=100", *SILENT, *SKEWED]
    flags += ["--set=sensor.delay=0", "--set=sensor.overload=100", "--set=tool.hook=[0.02,-0.05,0.11]", "--seed=3"]
    free, _, _ = simulated(capsys, tmp_path, *flags)
    pushed, truth, _ = simulated(capsys, tmp_path, *flags, "--pushes=3")
    assert free.t is not None
    added = pushed.wrench - free.wrench
    rig = true_rig(truth)
    pushes = truth["pushes"]
    assert isinstance(pushes, list)
    assert len(pushes) == 3
    inside = np.zeros(len(free), dtype=bool)
    for push in pushes:
        whole = (free.t > push["t_start"] + 0.04) & (free.t < push["t_end"] - 0.04)
        inside |= (free.t >= push["t_start"]) & (free.t <= push["t_end"])
        force = np.einsum("nji,j->ni", pushed.R_base_flange[whole] @ rig.R_flange_sensor, push["force"])
        assert whole.sum() > 10
        assert 1.0 <= np.linalg.norm(push["force"]) <= 10.0
        assert np.abs(added[whole, :3] - force).max() < 2e-6
        assert np.abs(added[whole, 3:] - np.cross([0.02, -0.05, 0.11], force)).max() < 2e-6
    assert np.abs(added[~inside]).max() == 0.0


def test_poses_and_motions_from_files(tmp_path: Path, capsys: Capture) -> None:
    joints = np.array([[0.1, 0.5, -0.2, -1.0, 0.3, 1.2, 0.4], [0.4, 0.3, 0.1, -1.2, -0.3, 1.0, -0.6]])
    names = ",".join(f"q{k}" for k in range(1, 8))
    by_joints = tmp_path / "joints.csv"
    by_joints.write_text(names + "\n" + "\n".join(",".join(map(str, row)) for row in joints) + "\n")
    _, _, table = simulated(capsys, tmp_path, f"--poses={by_joints}")
    assert np.abs(np.stack([table[f"q{k}"] for k in range(1, 8)], axis=1) - joints).max() < 1e-9

    by_pose = tmp_path / "poses.csv"
    by_pose.write_text("a,b,c,x_mm,y_mm,z_mm\n30,10,170,500,100,400\n40,-10,160,450,-100,500\n")
    samples, _, _ = simulated(capsys, tmp_path, f"--poses={by_pose}")
    assert samples.position is not None
    assert np.abs(samples.position - [[0.5, 0.1, 0.4], [0.45, -0.1, 0.5]]).max() < 1e-8

    turned = tmp_path / "turned.csv"
    turned.write_text("qx,qy,qz,qw\n0.8,0,0.6,0\n0.6,0.6,0.4,0.34641016151\n")
    samples, _, _ = simulated(capsys, tmp_path, f"--poses={turned}")
    assert samples.R_base_flange[0] == pytest.approx(
        np.array([[0.28, 0.0, 0.96], [0.0, -1.0, 0.0], [0.96, 0.0, -0.28]]), abs=1e-9
    )

    moving = tmp_path / "motion.csv"
    rows = "\n".join(f"{t}," + ",".join(map(str, row)) for t, row in zip((0, 1.5), joints, strict=True))
    moving.write_text(f"t,{names}\n{rows}\n")
    _, _, table = simulated(capsys, tmp_path, f"--trajectory={moving}")
    assert len(table) == 1501
    assert table["q1"][[0, -1]] == pytest.approx(joints[:, 0])


BAD_FILES = {
    "many.csv": "qx,qy,qz,qw\n" + "0,0,0,1\n" * 10_001,
    "far.csv": "qx,qy,qz,qw,x,y,z\n0,0,0,1,3,0,0\n",
    "mm.csv": "a,b,c,x,y,z\n0,0,180,500,0,600\n",
    "ms.csv": "t,q1,q2,q3,q4,q5,q6,q7\n0,0,0,0,0,0,0,0\n1000000,0,0,0,0,0,0,0.1\n",
    "degrees.csv": "q1,q2,q3,q4,q5,q6,q7\n10,30,0,-60,0,90,0\n",
    "one.csv": "t,q1,q2,q3,q4,q5,q6,q7\n0,0,0,0,0,0,0,0\n",
    "back.csv": "t,q1,q2,q3,q4,q5,q6,q7\n0,0,0,0,0,0,0,0\n0,0,0,0,0,0,0,0.1\n",
    "fast.csv": "t,q1,q2,q3,q4,q5,q6,q7\n0,0,0,0,0,0,0,0\n0.1,0,0,0,0,0,0,1\n",
    "untimed.csv": "q1,q2,q3,q4,q5,q6,q7\n0,0,0,0,0,0,0\n",
    "nothing.csv": "a,b\n1,2\n",
}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("flags", "message"),
    [
        (["--poses=foo"], "--poses is foo, expected paper, plan, plan:N, random:N (1 to 10000) or a CSV file"),
        (
            ["--poses=random:0"],
            "--poses is random:0, expected paper, plan, plan:N, random:N (1 to 10000) or a CSV file",
        ),
        (["--poses=many.csv"], "many.csv: found 10001 poses, expected at most 10000: leave rows out"),
        (["--poses=gone.csv"], "gone.csv: there is no such file, expected a readable file: check the path"),
        (
            ["--poses=far.csv"],
            "far.csv: pose 1: the iiwa 7 was not found to reach a flange pose at 3, 0, 0 m, expected one in its "
            "workspace: move it",
        ),
        (
            ["--poses=mm.csv"],
            "mm.csv: pose 1: the iiwa 7 was not found to reach a flange pose at 500, 0, 600 m, expected one in its "
            "workspace (are these mm?): move it",
        ),
        (
            ["--trajectory=ms.csv"],
            "ms.csv: t goes over 1e+06 s, expected at most 10000 s at 1000 Hz: is it in seconds?",
        ),
        (["--poses=degrees.csv"], "degrees.csv: q1 of iiwa7 is 10 rad, expected -2.967 to 2.967 (are these degrees?)"),
        (
            ["--poses=nothing.csv"],
            "nothing.csv: found no column c, expected all of kuka_abc: add it; or give joint angles q1 to q7",
        ),
        (
            ["--trajectory=foo"],
            "--trajectory is foo, expected stops, stops:N, excite, sweep or a CSV file with t and q1 to q7",
        ),
        (["--pushes=3"], "found --pushes 3 without a motion, expected --trajectory: add it"),
        (
            ["--trajectory=sweep", "--orientation=rpy"],
            "found --orientation rpy and no file of poses, expected --poses FILE: leave it out",
        ),
        (
            ["--poses=plan:3", "--orientation=kuka_abc"],
            "found --orientation kuka_abc and no file of poses, expected --poses FILE: leave it out",
        ),
        (
            ["--pushes=30", "--trajectory=sweep"],
            "30 pushes do not fit into 20 s, expected 91 s or more, or fewer pushes",
        ),
        (["--trajectory=one.csv"], "one.csv: found 1 points of a trajectory, expected 2 or more: add points"),
        (["--trajectory=back.csv"], "back.csv: t in point 2 is 0 s, expected more than 0: sort the points"),
        (
            ["--trajectory=fast.csv"],
            "fast.csv: q7 turns at 859 deg/s, expected at most 180: take more time",
        ),
        (["--trajectory=untimed.csv"], "untimed.csv: found no t, expected t and q1 to q7: add it"),
        (
            ["--trajectory=sweep", "--load-g=1,2"],
            "found 2 loads for a motion, expected one: simulate a file for each",
        ),
        (
            ["--trajectory=sweep", "--poses=paper"],
            "found both --poses and --trajectory, expected one of them: leave the other out",
        ),
        (
            [f"--load-g={','.join(['1'] * 5000)}"],
            "found 6 poses with 5000 loads each, expected at most 10000 readings in all: leave some out",
        ),
        (
            ["--poses=random:10000", "--load-g=1,2"],
            "found 10000 poses with 2 loads each, expected at most 10000 readings in all: leave some out",
        ),
        (
            ["--poses=random:1000", "--set=recording.settle=60"],
            "number of rows, settling included, is 6.0001e+07, expected 0 to 1e+07 (fewer, or a lower rate)",
        ),
        (["--load-g=a"], "--load-g is 'a', expected numbers like 100,200,500, 0 or 0.001 to 1e+06 g"),
        (["--load-g=-1"], "--load-g is '-1', expected numbers like 100,200,500, 0 or 0.001 to 1e+06 g"),
        (["--set=base.on=roof"], "base.on is roof, expected one of: table, wall, ceiling"),
        (["--poses=far.csv", "-o", "far.csv"], "far.csv: found what is read as far.csv, expected another file to "
         "write: name one"),
        (["-o", "out.txt"], "--output is out.txt, expected a name that ends in .csv, .mcap, .db3 or .bag: the truth "
         "goes beside it"),
    ],
)  # fmt: skip
def test_what_cannot_be_simulated_is_said_word_for_word(
    tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch, flags: list[str], message: str
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(kinematics, "TRIES", 2)  # of a pose that is out of reach, more find no more
    for name, text in BAD_FILES.items():
        (tmp_path / name).write_text(text)
    output = [] if "-o" in flags else ["-o", "out.csv"]
    done = run(capsys, "simulate", *output, *flags)
    assert (done.status, done.out, done.err) == (2, "", f"contactwrench: {message}\n")
    assert {path.name for path in tmp_path.iterdir()} == set(BAD_FILES)


def motions(seed: int) -> list[Motion]:
    rng = np.random.default_rng(seed)
    joints = np.cumsum(rng.uniform(-0.1, 0.1, size=(6, 7)), axis=0)
    return [
        exciting(10.0, 500.0, rng),
        sweeping(20.0, 500.0),
        through(np.cumsum(rng.uniform(0.5, 1.0, 6)), joints, 500.0),
    ]


@pytest.mark.parametrize("kind", [0, 1, 2])
def test_a_motions_speeds_are_its_joints_differences(kind: int) -> None:
    for seed in range(3):
        motion = motions(seed)[kind]
        step = motion.t[1]
        speed = (motion.joints[2:] - motion.joints[:-2]) / (2.0 * step)
        change = (motion.velocity[2:] - motion.velocity[:-2]) / (2.0 * step)
        assert np.abs(speed - motion.velocity[1:-1]).max() < 2e-3
        assert np.abs(change - motion.acceleration[1:-1]).max() < 0.3
        assert np.abs(motion.velocity[0]).max() < 1e-9


def test_settings_are_in_the_truth(tmp_path: Path, capsys: Capture) -> None:
    _, truth, _ = simulated(capsys, tmp_path, "--set=sensor.gain=0.974", "--load-g=100")
    settings = truth["settings"]
    assert isinstance(settings, dict)
    assert settings["sensor"]["gain"] == [0.974] * 6
    assert truth["command"] == {"poses": "paper", "load_g": [100.0], "seed": 0}
    assert changed(Settings(), []) == Settings()


@pytest.mark.parametrize(("text", "force"), [("1/f", 0.035), ("1/f:0.1", 0.1)])
def test_one_over_f_noise_is_a_setting(tmp_path: Path, capsys: Capture, text: str, force: float) -> None:
    _, truth, _ = simulated(capsys, tmp_path, "--noise", text)
    settings: Any = truth["settings"]
    assert settings["sensor"]["noise"]["one_over_f"] == pytest.approx([force] * 3 + [0.02 * force] * 3)


@pytest.mark.parametrize("text", ["white", "1/f:0", "1/f:x", "1/f:-1", "1/f:inf"])
def test_another_noise_is_refused(tmp_path: Path, capsys: Capture, text: str) -> None:
    done = run(capsys, "simulate", "-o", tmp_path / "out.csv", "--noise", text)
    assert done.status == 2
    assert f"--noise is {text}, expected 1/f or 1/f:N with N 1e-09 to 1e+06 N, as in 1/f:0.05" in done.err


def test_the_page_on_the_rig_has_every_setting_with_its_default() -> None:
    page = (Path(__file__).parents[2] / "docs" / "simulating.md").read_text(encoding="utf-8")
    stated = dict(re.findall(r"^\| `([a-z_.]+)` \| ([^|]*) \|", page, flags=re.MULTILINE))
    defaults = dict(flat("", msgspec.to_builtins(Settings())))
    assert stated.keys() == defaults.keys()
    for name, text in stated.items():
        default = defaults[name]
        if isinstance(default, str):
            assert text == default, name
        elif not text.endswith("..."):
            numbers = np.array([float(number) for number in text.split(",")])
            stands_for = numbers if len(numbers) > 1 else np.full(np.shape(default), numbers[0])
            assert stands_for == pytest.approx(np.array(default), abs=1e-4), name


def flat(path: str, values: Any) -> Iterator[tuple[str, Any]]:
    if isinstance(values, dict):
        for key, value in values.items():
            yield from flat(f"{path}.{key}".strip("."), value)
    else:
        yield path, values
