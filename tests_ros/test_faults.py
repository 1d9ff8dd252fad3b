"""What may be wrong around the node, on real rclpy: clocks that are set back, parameters, a tare while it runs."""

from __future__ import annotations

import subprocess
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rcl_interfaces.msg import Log
from rclpy.parameter import Parameter
from scipy.spatial.transform import Rotation

import contactwrench as cw

from .rig import PROGRAM, Rig, free

Make = Callable[..., Rig]
INFO, WARN = 20, 30


@pytest.mark.parametrize("by", [0.3, 3.0])
def test_a_clock_that_is_set_back_makes_no_contact(by: float, rig: Make, calibration: str) -> None:
    """Of all stamps, while the arm turns by 0.9 rad/s; poses 6 ms ahead, as a machine that stalls is not tested."""
    one, start, forces = rig(calibration=calibration), time.time(), []
    for k in range(800):
        t = start + 0.005 * k
        time.sleep(max(0.0, t - time.time()))
        turn = [Rotation.from_rotvec(0.9 * (0.005 * k + ahead) * np.array([0.6, 0.0, 0.8])) for ahead in (0.006, 0.0)]
        back = by * (k >= 400)
        one.stand(turn[0], t - back + 0.006)
        if k > 10:
            one.read(free(turn[1]), t - back)
    one.wait(lambda: any("stamps went back, of " in status.message for status in one.said))
    one.wait(lambda: len(one.found) > 740)
    for message in one.found:
        force = message.wrench.force
        forces.append(np.hypot(np.hypot(force.x, force.y), force.z))
    print(f"{len(forces)} of 789 published, {max(forces):.3f} N at most")
    assert max(forces) < 0.2


@pytest.mark.parametrize(
    ("stated", "said"),
    [
        ("lowpass:='20'", "lowpass is '20', expected a number: write it as 0.0, without quotes"),
        ("lowpass:=-1.0", "lowpass is -1, expected 0 to 10000"),
        ("stale_after:=0.0", "stale_after is 0, expected 0.001 to 10"),
        ("wrench_topic:=''", "wrench_topic is empty, expected a text such as /wrench"),
        ("wrench_topic:='bad topic'", "wrench_topic is 'bad topic', expected a topic such as /wrench"),
    ],
)
def test_a_parameter_that_cannot_be_meant_is_one_line_and_status_2(stated: str, said: str) -> None:
    command = [PROGRAM, "--ros-args", "-p", stated]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stderr) == (2, f"contactwrench: {said}\n")


def test_a_whole_number_is_a_number(rig: Make, calibration: str) -> None:
    one = rig(calibration=calibration, lowpass=20)
    assert repr(one.node.session.settings["lowpass"]) == "20.0"
    done = one.node.set_parameters([Parameter("lowpass", value=30), Parameter("noise", value="0.1")])
    assert [result.successful for result in done] == [True, False]
    assert done[1].reason == "noise is '0.1', expected a number: write it as 0.0, without quotes"
    assert repr(one.node.session.settings["lowpass"]) == "30.0"


def test_a_calibration_remembers_the_topic_and_the_sign(rig: Make, tmp_path: Path) -> None:
    one = rig(save_to=str(tmp_path / "cal.json"), sign="reaction", wrench_topic="wrench")
    assert one.ask("start_calibration").success
    for seed in range(6):
        R = Rotation.random(random_state=seed)
        one.run(R, 0.1, turned=-1.0)
        assert one.ask("capture", partial(one.run, R, 1.2, turned=-1.0)).success
    assert one.ask("finish_calibration").success
    made = cw.Calibration.load(tmp_path / "cal.json")
    known = {name: made.provenance[name] for name in ("sign", "frames", "wrench_topic", "base_frame")}
    assert known == {
        "sign": "reaction",
        "frames": "base_link,tool0",
        "wrench_topic": "/wrench",
        "base_frame": "base_link",
    }
    assert made.weight == pytest.approx(13.7, abs=0.01)


def test_what_is_refused_is_a_warning_and_what_is_done_is_none(rig: Make) -> None:
    one, logged = rig(), list[Any]()
    one.outside.create_subscription(Log, "/rosout", logged.append, 100)
    one.wait(lambda: one.outside.count_subscribers("/rosout") > 0)
    time.sleep(0.5)
    refused, done = one.ask("finish_calibration"), one.ask("start_calibration")
    assert (refused.success, done.success) == (False, True)
    one.wait(lambda: len(logged) > 1)
    said = {each.msg: each.level for each in logged}
    assert (said[refused.message], said[done.message]) == (WARN, INFO)


def test_a_tare_while_it_runs_is_said(rig: Make, calibration: str) -> None:
    one, R, logged = rig(calibration=calibration, noise=0.02), Rotation.random(random_state=8), list[Any]()
    one.outside.create_subscription(Log, "/rosout", logged.append, 100)
    one.run(R, 1.0)
    one.run(R, 12.5, push=3.0)
    said = "; ~/zero where nothing touches"
    one.wait(lambda: any(each.level == WARN and each.msg.endswith(said) for each in logged))
    told = [status for status in one.said if status.message.startswith("contact or bias: nothing has changed for ")]
    assert told
    assert {status.level for status in told} == {b"\x01"}
    assert sum(each.msg.endswith(said) for each in logged) == 1
