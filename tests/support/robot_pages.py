"""What a page of docs/robots/ leads to: its commands identify the tool, mounted anyhow, from what a recorder writes."""

from __future__ import annotations

import shlex
from pathlib import Path

import numpy as np

from contactwrench import Calibration
from contactwrench.geometry.wrench import STANDARD_GRAVITY
from tests.support.controllers import READERS, Load
from tests.support.rigs import rotation_angle
from tests.support.world import Array, Rig

WRITTEN_BY_PROGRAM = {
    "kuka-iiwa": "pose.csv",
    "franka": "recording.csv",
    "xarm": "recording.csv",
    "my-own": "poses.csv",
}
"""What a page's own program writes."""


def assert_the_tool(calibration: Calibration, rig: Rig) -> None:
    """The weight is right within 3 std; centre of mass and mounting are those of the rig, not another reading's."""
    assert calibration.weight is not None
    assert calibration.com is not None
    assert calibration.R_flange_sensor is not None
    assert abs(calibration.weight - rig.weight) < 3.0 * calibration.std["weight"]
    assert np.abs(calibration.com - rig.com).max() < 5.0 * np.max(calibration.std["com"])
    assert rotation_angle(calibration.R_flange_sensor, rig.R_flange_sensor) < np.deg2rad(3.0)


def assert_the_columns(path: Path, text: str) -> None:
    """The recorder writes those of the page's program."""
    header = path.read_text().partition("\n")[0]
    assert header in text or all(f'"{column}"' in text for column in header.split(",") if "O_T_EE" not in column)


def assert_the_push(path: Path) -> None:
    """In one second of working, 8 N along the sensor's -z; nothing in the rest, the arm's moves included."""
    fz = np.genfromtxt(path, delimiter=",", names=True)["fz"]
    assert abs(fz[fz < -4.0].mean() + 8.0) < 0.5
    assert np.abs(fz[fz > -4.0]).mean() < 0.5


def assert_the_payload(command: str, printed: str, rig: Rig) -> None:
    """What the robot's own reader makes of it is the tool with the sensor that the flags state, within 5 mm and 1 %."""
    words = shlex.split(command)
    flags = dict(zip(words[4::2], words[5::2], strict=True))
    read = READERS.get(flags["--to"])
    if read is None:
        return
    load, hung = read(printed), hanging(rig, flags)
    assert abs(load.mass - hung.mass) < 0.01 * hung.mass
    assert np.abs(load.com - hung.com).max() < 0.005


def hanging(rig: Rig, flags: dict[str, str]) -> Load:
    def vector(flag: str) -> Array:
        return np.array([float(part) for part in flags.get(flag, "0,0,0").split(",")])

    tool, sensor = rig.weight / STANDARD_GRAVITY, float(flags["--sensor-mass"])
    com = tool * (vector("--sensor-offset") + rig.R_flange_sensor @ rig.com) + sensor * vector("--sensor-com")
    return Load(tool + sensor, com / (tool + sensor))
