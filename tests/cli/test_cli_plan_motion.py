"""`contactwrench plan --dynamic`, word for word; and that what it plans calibrates the simulated rig."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import contactwrench as cw
from contactwrench.assess import plan_motion as motion_design
from contactwrench.assess.plan import READINGS, Expected, expected_tool
from contactwrench.assess.plan_motion import DynamicPlan, plan_motion
from contactwrench.calibration.dynamics import DYNAMIC_PARAMETERS, elements
from contactwrench.model import RigidTool
from contactwrench.simulate.settings import Settings
from tests.assess.test_plan_motion import information
from tests.assess.test_robot_arms import urdf_of
from tests.support.recordings import PAPER, run, written

RATE = 200.0
"""Hz, of the recording in motion: the noise of each of its readings counts as that of five."""
GYRATION_OF_RIG = 0.03
"""m: the simulated tool is a ball, as far as its inertia goes."""


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(motion_design, "STEPS", 20)
    monkeypatch.setattr(motion_design, "STARTS", 2)


@pytest.mark.usefixtures("quick")
def test_a_motion_is_said_with_its_limits_and_its_bound(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    done = run(capsys, "plan", "--dynamic", "--robot", "ur5e", "-o", tmp_path / "plan.script")
    assert done.err == ""
    shown = done.out.splitlines()
    assert shown[0].startswith("Plan of 12 stops and 2")
    assert shown[0].endswith(" s in all, model dynamic")
    assert shown[1] == "  assumed: a tool of 10 N, a noise of 0.05 N and 2 mN m in a pose's reading"
    assert shown[2] == "  in motion 0.05 N and 2 mN m in each of 1000 readings a second"
    assert shown[3] == "  with ur5e from 0 -1.571 1.571 -1.571 -1.571 0 rad and back, 1.5 s at each stop"
    assert shown[6].split() == ["at", "most", "q1", "q2", "q3", "q4", "q5", "q6"]
    assert [line.split()[-1] for line in shown[7:10]] == ["deg", "deg/s", "deg/s^2"]
    assert [line.split()[0] for line in shown[15:24]] == list(DYNAMIC_PARAMETERS)
    assert shown[24] == "  Collisions and cables are not checked: run the motion slowly once"
    assert shown[25] == f"Wrote the motion to {tmp_path / 'plan.script'}"
    assert len(shown) == 26


@pytest.mark.usefixtures("quick")
def test_json_is_everything_and_the_noise_a_recording_s(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    arm = written(tmp_path, urdf_of("ur5e"), "arm.urdf")
    stand = ("--robot", arm, "--around", "0,-1.57,1.57,-1.57,-1.57,0", "-n", "2")
    asked = ("--json", "--duration", "15", "--from", PAPER, "--model", "mount", "-o", tmp_path / "plan.src")
    values = json.loads(run(capsys, "plan", "--dynamic", *stand, *asked).out)
    assert values["expected"]["fitted_to"] == str(PAPER)
    assert values["model"] == "dynamic"
    assert len(values["stops"]["joints"]) == 2
    assert values["motion"]["duration"] <= 15.0
    assert np.shape(values["motion"]["sine"]) == np.shape(values["motion"]["cosine"]) == (5, 6)
    assert tuple(values["std"]) == tuple(values["std_after_stops"]) == DYNAMIC_PARAMETERS
    assert len(values["largest"]["speed"]) == 6
    assert (tmp_path / "plan.src").read_text().startswith("DEF plan( )\n")


@pytest.mark.usefixtures("quick")
def test_the_csv_goes_to_stdout_alone(capsys: pytest.CaptureFixture[str]) -> None:
    done = run(capsys, "plan", "--dynamic", "--robot", "panda", "-n", "1", "-o", "-")
    assert done.out.splitlines()[0] == "t,q1,q2,q3,q4,q5,q6,q7"
    assert "too few" in run(capsys, "plan", "--dynamic", "--robot", "panda", "-n", "1").out


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (
            ("--dynamic",),
            "--dynamic plans how the joints move, and there is no robot: give --robot NAME or a URDF",
        ),
        (
            ("--dynamic", "--robot", "ur5e", "-o", "plan.txt"),
            "--output is plan.txt, expected a name that ends in .csv, .script (URScript) or .src (KUKA KRL)",
        ),
        (
            ("--dynamic", "--robot", "iiwa7", "-o", "plan.src"),
            "--output is plan.src, and KRL moves the 6 joints of a KUKA with KRC, given as a URDF, found iiwa7 with 7: "
            "name a .csv",
        ),
        (
            ("--dynamic", "--robot", "panda", "-o", "plan.script"),
            "--output is plan.script, and URScript moves the 6 joints of a Universal Robots arm, found panda with 7: "
            "name a .csv",
        ),
        (
            ("--robot", "ur5e", "-o", "plan.script"),
            "--output is plan.script, and a program moves: add --dynamic, or name a .csv",
        ),
        (("--within", "0.2"), "found --within, which is of a motion: add --dynamic, or leave it out"),
        (
            ("--dynamic", "--robot", "iiwa7", "--around", "0,0.5,0,-1,0,2.0,0"),
            "q6 of iiwa7 stands 5.4 deg from its limit, expected 15 deg or more, to swing: start elsewhere (--around)",
        ),
        (
            ("--dynamic", "--robot", "iiwa7", "--around", "0,1.7,0,-1,0,0.5,0"),
            "the flange of iiwa7 starts -0.199 m above the plane of its base, expected 0.15 m or more: start elsewhere "
            "(--around), or state --above",
        ),
        (
            ("--dynamic", "--robot", "iiwa7", "--duration", "3"),
            "Invalid value for '--duration': found 3, expected 10 to 600 s: try 'contactwrench plan --help'",
        ),
        (
            ("--dynamic", "--robot", "iiwa7", "--within", "200"),
            "Invalid value for '--within': found 200, expected 0.01 to 10 m (is it in mm?): try 'contactwrench plan "
            "--help'",
        ),
    ],
)
def test_bad_use_is_one_line(arguments: tuple[str, ...], complaint: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(capsys, "plan", *arguments).complaint == complaint


@pytest.mark.slow
@pytest.mark.usefixtures("quick")
def test_what_is_planned_calibrates_the_rig(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The simulator runs the plan as it is; all nine are found within four std, which are those of the bound for the
    rig's own noise and tool in the whole recording: 0.89 to 1.14 times, as calibrate takes the noise of each axis from
    what is left below 3 Hz.
    """
    pytest.importorskip("mujoco")
    plans: list[DynamicPlan] = []

    def kept(*arguments: Any, **stated: Any) -> DynamicPlan:
        plans.append(plan_motion(*arguments, **stated))
        return plans[-1]

    monkeypatch.setattr("contactwrench.assess.plan_motion.plan_motion", kept)
    written_plan, recording, calibration = (tmp_path / name for name in ("plan.csv", "sim.csv", "tool.json"))
    run(capsys, "plan", "--dynamic", "--robot", "iiwa7", "-o", written_plan)
    recorded = ("--set", f"recording.rate={RATE}")
    assert run(capsys, "simulate", "--trajectory", written_plan, "-o", recording, *recorded).status == 0
    done = run(capsys, "calibrate", recording, "--model", "dynamic", "-o", calibration)
    assert done.status == 0
    assert "\nVerdict  good: " in done.out
    dynamics = cw.Calibration.load(calibration).dynamics
    assert dynamics is not None
    (plan,), rig, rate = plans, Settings(), 200.0
    tool, noise = rig.tool, rig.sensor.noise
    true = np.r_[tool.mass * GYRATION_OF_RIG**2 * elements(np.eye(3)), 0.0, 0.0, rig.mounting.height]
    found = np.r_[elements(dynamics.inertia), dynamics.sensor_offset]
    assert (np.abs(found - true) < 4.0 * dynamics.std).all()
    parts = tool.mass * rig.gravity, np.array(tool.com), np.zeros(6), rig.R_flange_sensor, rig.gravity_direction
    of_rig = Expected(RigidTool(*parts), np.sqrt(READINGS / RATE) * np.array([*noise.force, *noise.torque]))
    told = information(plan.arm, of_rig, plan.at(np.arange(0.0, plan.duration, 1.0 / rate)), rate)
    bound = np.sqrt(np.diag(np.linalg.inv(told)))
    of_recording = expected_tool(cw.read(recording)).in_motion
    np.testing.assert_allclose(of_recording[:4], of_rig.noise[:4], rtol=0.15)
    np.testing.assert_array_less(dynamics.std, 1.3 * bound)
    np.testing.assert_array_less(0.85 * bound, dynamics.std)
    assert float(np.mean(dynamics.std / bound)) == pytest.approx(1.03, abs=0.06)
