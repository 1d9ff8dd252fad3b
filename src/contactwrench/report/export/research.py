"""Parameters of programs of research labs. What each of them computes stands, with its source, in
tests/support/oracles.py.
"""

from __future__ import annotations

import json

import numpy as np

from ...calibration.calibration import Calibration
from ...errors import InputError
from ...geometry.wrench import STANDARD_GRAVITY
from ...model import wrench_matrix
from .target import (
    DOWN,
    Parameters,
    Setup,
    Target,
    below,
    in_json,
    in_xml,
    mounting_remark,
    number,
    numbers,
    rigid_tool,
    roll_pitch_yaw,
)

FIXED_GRAVITY = f"such that mass x {STANDARD_GRAVITY} m/s^2, this program's gravity, is the weight"


def _mc_rtc(c: Calibration, setup: Setup) -> Parameters:
    tool = rigid_tool(c, setup, "mc_rtc")
    if setup.sensor_offset is None:
        raise InputError(
            "mc_rtc counts from the flange, and no reading tells where the sensor's origin is: give --sensor-offset "
            "X,Y,Z, m from the flange's origin, flange axes (data sheets of sensor and adapter, or the URDF)"
        )
    com = tool.R_flange_sensor @ tool.com + setup.sensor_offset
    rpy = roll_pitch_yaw(tool.R_flange_sensor)
    values = [tool.weight / STANDARD_GRAVITY, *rpy, *com, *tool.bias[3:], *tool.bias[:3]]
    remarks = (
        f"the file is calib_data.{setup.sensor_name} in the robot module's calib_dir",
        f"mass in kg, {FIXED_GRAVITY}; roll, pitch, yaw in rad; centre of mass in m from the parent body's origin, its "
        "axes; offset tx ty tz in N m, fx fy fz in N",
        "taken for granted: the parent body is the flange of the recording; the robot module's force sensor has the "
        f"parent's axes and is at [{numbers(setup.sensor_offset)}] m in it; the base stands upright",
    )
    return Parameters(numbers(values, "\n") + "\n", remarks, wrench_matrix(tool), DOWN)


def _hrpsys(c: Calibration, setup: Setup) -> Parameters:
    tool = rigid_tool(c, setup, "hrpsys")
    values = [*tool.bias, *tool.com, tool.weight / STANDARD_GRAVITY]
    remarks = (
        "in the file: the sensor's name in the robot's model, force offset in N, moment offset in N m, centre of mass "
        f"in m from the sensor's origin, sensor axes, mass in kg, {FIXED_GRAVITY}",
        mounting_remark(tool, setup.sensor_name),
        "taken for granted: the base stands upright, or the model's acceleration sensor tells its lean",
    )
    return Parameters(f"{setup.sensor_name} {numbers(values, ' ')}\n", remarks, wrench_matrix(tool), DOWN)


def _yarp(c: Calibration, setup: Setup) -> Parameters:
    tool = rigid_tool(c, setup, "yarp")
    reaction = c.provenance.get("sign") == "reaction"
    rows = ",\n        ".join(numbers(row, ",") for row in -np.eye(6))
    turned = f"""<group name="FT_SECONDARY_CALIBRATION">
    <param name="{setup.sensor_name}">({rows})</param>
</group>
"""
    body = f"""<param name="fixedFrameGravity">({numbers(c.g * tool.gravity_direction, ",")})</param>
<group name="FT_OFFSET">
    <param name="{setup.sensor_name}">({numbers(tool.bias, ",")})</param>
</group>
{turned if reaction else ""}"""
    remarks = (
        "offset fx fy fz in N, tx ty tz in N m, is subtracted; fixedFrameGravity in m/s^2, axes of the recording's "
        "base",
        "the tool's weight comes from the URDF: all links behind the sensor together have a mass of "
        f"{number(tool.weight / c.g)} kg, their centre of mass at [{numbers(tool.com)}] m from the sensor's origin, "
        "sensor axes",
        mounting_remark(tool, setup.sensor_name),
        "taken for granted: the URDF's sensor measures child_to_parent, what the tool exerts on the arm",
    )
    return Parameters(body, remarks, wrench_matrix(tool), tool.gravity_direction, takes_reaction=True)


def _rh20t(c: Calibration, setup: Setup) -> Parameters:
    tool = rigid_tool(c, setup, "rh20t")
    ts_rot = np.eye(4)
    ts_rot[:3, :3] = tool.R_flange_sensor.T
    body = {
        "offset": tool.bias.tolist(),
        "centroid": tool.com.tolist(),
        "gravity": [*(tool.weight * tool.gravity_direction).tolist(), 0.0],
        "ts_rot": ts_rot.tolist(),
    }
    remarks = (
        "keys of one configuration in configs.json: offset in N and N m, subtracted; centroid in m from the sensor's "
        "origin, sensor axes; gravity is the weight as a vector, N, base axes; ts_rot turns TCP axes into sensor axes",
        "taken for granted: the TCP pose has the orientation of the flange of the recording",
    )
    lines = ",\n".join(f"  {json.dumps(key)}: {json.dumps(value)}" for key, value in body.items())
    return Parameters(f"{{\n{lines}\n}}\n", remarks, wrench_matrix(tool), tool.gravity_direction)


TARGETS = (
    Target(
        "mc_rtc",
        "mc_rtc's force sensors",
        "--sensor-offset",
        "a base that leans",
        _mc_rtc,
        below,
        ("sensor_offset", "sensor_name"),
    ),
    Target(
        "hrpsys",
        "hrpsys' RemoveForceSensorLinkOffset",
        "the sensor's frame in the model",
        "a base that leans (without an acceleration sensor)",
        _hrpsys,
        None,
        ("sensor_name",),
    ),
    Target(
        "yarp",
        "whole-body-estimators' wholebodydynamics (YARP)",
        "the tool in the URDF",
        "",
        _yarp,
        in_xml,
        ("sensor_name",),
    ),
    Target("rh20t", "RH20T's API", "", "", _rh20t, in_json),
)
