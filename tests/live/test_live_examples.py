"""The examples that run on the lab, as processes, as a person starts them."""

from __future__ import annotations

import runpy
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("mujoco")

import contactwrench as cw
from contactwrench.lab.control import Control
from contactwrench.lab.rig import WORKPIECE, Lab
from contactwrench.lab.sri import Sri
from contactwrench.lab.ur import Ur
from contactwrench.simulate.kinematics import paper_joints
from contactwrench.simulate.recording import record_poses
from contactwrench.simulate.rig import build
from contactwrench.simulate.settings import Settings

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


@pytest.fixture(scope="module")
def calibration(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Of the rig that the lab is."""
    path = tmp_path_factory.mktemp("rig") / "cal.json"
    recorded = record_poses(Settings(), paper_joints(build(Settings())), rng=np.random.default_rng(1))
    cw.calibrate(recorded.samples).save(path)
    return path


@pytest.fixture
def lab() -> Iterator[tuple[Lab, list[str]]]:
    """A lab, as fast as its arm is, and the URIs of its sensor, its robot and its control port."""
    virtual = Lab(Settings(), 1, 1.0)
    with Sri(virtual) as sensor, Ur(virtual.sensor()) as robot, Control(virtual) as control:
        yield virtual, [sensor.uri, robot.uri, control.uri]


def _run(example: str, *arguments: str | Path) -> str:
    command = [sys.executable, str(EXAMPLES / example), *map(str, arguments)]
    done = subprocess.run(command, check=False, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_loop_prints_the_contact_force(lab: tuple[Lab, list[str]], calibration: Path) -> None:
    lines = _run("live_loop.py", *lab[1][:2], calibration, "2.0").splitlines()
    judged = [line for line in lines if line.endswith("N, free")]
    assert len(lines) >= 10
    assert judged
    assert all(float(line.split()[0]) < 0.5 for line in judged)


@pytest.mark.slow
def test_the_guarded_move_stops_at_contact(
    lab: tuple[Lab, list[str]], calibration: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """After a few of its steps, of half a second each: the workpiece lies 2.6 cm higher, 4 mm below the first one."""
    monkeypatch.setattr("contactwrench.lab.rig.WORKPIECE", WORKPIECE + 0.026)
    out = _run("live_guarded_move.py", *lab[1], calibration)
    assert out.startswith("contact at ")
    assert 0.196 < float(out.split()[2]) < 0.21
    assert 0.1 < float(out.split()[-2]) < 30.0
    until = time.monotonic() + 1.0  # in which it brakes
    while lab[0].moving and time.monotonic() < until:
        time.sleep(0.02)
    assert not lab[0].moving


@pytest.mark.parametrize("guarded", [True, False])
def test_at_contact_a_guarded_arm_is_ordered_to_where_it_is(guarded: bool) -> None:
    """At once, and not to the end of its step; where the way is known to be free nothing stops it."""
    orders: list[dict[str, Any]] = []
    there = [0.1, -0.2, 0.3, 0.4, -0.5, 0.6, 0.7]

    def order(what: dict[str, Any]) -> dict[str, Any]:
        orders.append(what)
        return {"joints": there} if "state" in what else {"seconds": 0.0}

    Arm = runpy.run_path(str(EXAMPLES / "live_guarded_move.py"))["Arm"]
    arm = Arm.__new__(Arm)
    arm.last = SimpleNamespace(pose=np.array([[0.5, -0.5, 0.1, 0.7]]), position=np.array([[0.4, 0.1, 0.3]]))
    arm.order, arm.feel = order, lambda: "contact"
    assert arm.go(0.25, guarded=guarded) is guarded
    assert orders[0]["position"] == [0.4, 0.1, 0.25]
    assert orders[1:] == ([{"state": True}, {"move": there}] if guarded else [])


@pytest.mark.parametrize("example", ["live_loop.py", "live_guarded_move.py"])
def test_how_it_is_called_is_said(example: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """What it leaves with is a text, which Python writes to stderr with status 1."""
    monkeypatch.setattr(sys, "argv", [example])
    with pytest.raises(SystemExit) as left:
        runpy.run_path(str(EXAMPLES / example), run_name="__main__")
    assert f"python examples/{example} SENSOR" in str(left.value.code)
