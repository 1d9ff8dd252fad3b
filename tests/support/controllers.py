"""What each maker's controller makes of a payload, by its own units: the formulas of their manuals and SDKs.

A payload is read back as `Load`: mass in kg and centre of mass in m, flange axes, from the flange's origin. Of the
controllers themselves only what is published counts; what they compute from a load is physics, in `Load.wrench`.
"""

from __future__ import annotations

import ast
import json
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tests.support.world import Array

KGF = 9.80665
"""N, by definition."""


@dataclass(frozen=True, eq=False)
class Load:
    """A rigid load on a flange: `mass` kg, `com` (3,) m, `inertia` (3, 3) kg m^2 about the centre of mass."""

    mass: float
    com: Array
    inertia: Array = field(default_factory=lambda: np.zeros((3, 3)))

    def wrench(self, R_base_flange: Array, down: Array, g: float) -> Array:
        """What it exerts on the flange (n, 6) at rest, flange axes, about the flange's origin."""
        weight = np.broadcast_to(self.mass * g * down, (len(R_base_flange), 3))
        torque = np.cross(R_base_flange @ self.com, weight)
        in_flange = [(R_base_flange.transpose(0, 2, 1) @ part[..., None])[..., 0] for part in (weight, torque)]
        return np.concatenate(in_flange, axis=1)


def _without(text: str, mark: str) -> str:
    """A program text without its comment lines."""
    return "\n".join(line for line in text.splitlines() if not line.startswith(mark))


def ur(text: str) -> Load:
    """URScript manual: set_payload(m, cog): kg; m, from the tool mount; set_target_payload(m, cog, [Ixx, Iyy, Izz, Ixy,
    Ixz, Iyz]): kg m^2, origin in the CoG, axes those of the tool flange.
    """
    call = re.fullmatch(r"set_(?:target_)?payload(\(.+\))", _without(text, "#").strip())
    assert call
    mass, cog, *rest = ast.literal_eval(call.group(1))
    assert bool(rest) == ("set_target_payload" in call.group())
    xx, yy, zz, xy, xz, yz = rest[0] if rest else [0.0] * 6
    return Load(mass, np.array(cog), np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))


def franka(text: str) -> Load:
    """frankaemika/franka_ros2 franka_msgs/srv/SetLoad.srv; frankaemika/libfranka include/franka/robot.h: kg; m from the
    flange; inertia in kg m^2 column by column.
    """
    fields = dict(line.split(": ") for line in _without(text, "#").splitlines())
    assert list(fields) == ["mass", "center_of_mass", "load_inertia"]
    inertia = np.array(json.loads(fields["load_inertia"])).reshape(3, 3, order="F")
    return Load(float(fields["mass"]), np.array(json.loads(fields["center_of_mass"])), inertia)


def _about(axis: int, angle: float) -> Array:
    """A turn about x, y or z."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    R = np.eye(3)
    R[i, i] = R[j, j] = np.cos(angle)
    R[j, i], R[i, j] = np.sin(angle), -np.sin(angle)
    return R


def kuka(text: str) -> Load:
    """KRL, $config.dat: DECL LOAD: M kg, CM FRAME in mm and deg relative to the flange, J in kg m^2 (Beckhoff TF5120,
    KRC_WriteLoadData) about principal axes that stand by A about z, B about y then, C about x last.
    """
    number = r"(-?\d+\.\d+)"
    frame = r",".join(rf"{axis} {number}" for axis in "XYZABC")
    inertia = r",".join(rf"{axis} {number}" for axis in "XYZ")
    found = re.fullmatch(
        rf"LOAD_DATA\[1\]=\{{M {number},CM \{{{frame}\}},J \{{{inertia}\}}\}}", _without(text, ";").strip()
    )
    assert found
    mass, *rest = map(float, found.groups())
    a, b, c = np.deg2rad(rest[3:6])
    turns = ((a, 2), (b, 1), (c, 0))
    R = np.linalg.multi_dot([_about(axis, angle) for angle, axis in turns])
    return Load(mass, 1e-3 * np.array(rest[:3]), R @ np.diag(rest[6:]) @ R.T)


def abb(text: str) -> Load:
    """RAPID reference manual, loaddata: mass kg, cog mm, aom q1..q4 (scalar first), ix iy iz kg m^2."""
    found = re.fullmatch(r"PERS loaddata \w+:=(\[.+\]);", _without(text, "!").strip())
    assert found
    mass, cog, aom, *moments = json.loads(found.group(1))
    w, *v = aom
    assert abs(np.linalg.norm(aom) - 1.0) < 1e-8
    K = np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
    R = np.eye(3) + 2.0 * w * K + 2.0 * K @ K
    return Load(mass, 1e-3 * np.array(cog), R @ np.diag(np.array(moments, dtype=float)) @ R.T)


def fanuc(text: str) -> Load:
    """The screen MOTION/PAYLOAD SET: kg, cm, kgf cm s^2."""
    units = {"kg": 1.0, "cm": 1e-2, "kgfcms^2": KGF * 1e-2}
    values: dict[str, float] = {}
    for line in _without(text, "#").splitlines():
        found = re.fullmatch(r"(PAYLOAD(?: (?:CENTER|INERTIA) [XYZ])?) +\[(.+)\] +: (-?\d+\.\d+)", line)
        assert found, line
        values[found.group(1)] = units[found.group(2)] * float(found.group(3))
    com = np.array([values[f"PAYLOAD CENTER {axis}"] for axis in "XYZ"])
    return Load(values["PAYLOAD"], com, np.diag([values[f"PAYLOAD INERTIA {axis}"] for axis in "XYZ"]))


class _Recorder:
    """A robot object of an SDK that remembers what it was called with."""

    def __init__(self) -> None:
        self.calls: dict[str, tuple[Any, ...]] = {}

    def __getattr__(self, name: str) -> Callable[..., None]:
        return lambda *arguments: self.calls.update({name: arguments})


def calls(text: str, name: str) -> dict[str, tuple[Any, ...]]:
    """The calls that a Python text makes of the object `name`."""
    recorder = _Recorder()
    exec(text, {name: recorder})
    return recorder.calls


def xarm(text: str) -> Load:
    """xArm-Developer/xArm-Python-SDK xarm/wrapper/xarm_api.py, set_tcp_load: kg, mm."""
    weight, center_of_gravity = calls(text, "arm")["set_tcp_load"]
    return Load(weight, np.array([item / 1000.0 for item in center_of_gravity]))


def fairino(text: str) -> Load:
    """FAIR-INNOVATION/fairino-python-sdk linux/fairino/Robot.py: SetLoadWeight(number, kg), SetLoadCoord in mm."""
    made = calls(text, "robot")
    number, weight = made["SetLoadWeight"]
    assert number == 0
    return Load(weight, 1e-3 * np.array(made["SetLoadCoord"]))


READERS: dict[str, Callable[[str], Load]] = {
    "ur": ur,
    "franka": franka,
    "kuka": kuka,
    "abb": abb,
    "fanuc": fanuc,
    "xarm": xarm,
    "fairino": fairino,
}
