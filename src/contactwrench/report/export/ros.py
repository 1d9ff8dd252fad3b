"""Parameters of ROS programs. What each of them computes is written down, with its source, in tests/support/oracles.py.

All of them turn gravity by the transforms of the robot's description, so the sensor's frame in it has to be turned
against the flange as the calibration found it: no parameter file holds that.
"""

from __future__ import annotations

import json
import re
from dataclasses import replace

import numpy as np

from ...assess.robot_arms import R_between
from ...calibration.calibration import Calibration
from ...geometry.arrays import Array
from ...model import wrench_matrix
from .target import DOWN, NAME, Parameters, Setup, Target, largest_error, mounting_remark, number, numbers, rigid_tool

NODE_GRAVITY = 9.81
"""m/s^2: the default of `gravity_in_reference_frame` of ft_tools_ros2."""
BROADCASTER = "force_torque_sensor_broadcaster"
"""It exports what it makes of the readings, with `offset` and `multiplier` and before its filters, to other controllers
as BROADCASTER/SENSOR: ros-controls/ros2_controllers, its `on_export_state_interfaces`.
"""


def _base_frame(c: Calibration, setup: Setup) -> str:
    """The name of the base in ROS: as stated, or the recording's where that is one; "ur5e base" is a maker's."""
    own = _own_base(c)
    return setup.base_frame or (own if re.fullmatch(NAME, own) else "base_link")


def _own_base(c: Calibration) -> str:
    return str(c.provenance.get("base_frame") or "").removeprefix("/")


def _recorded_base(c: Calibration) -> str:
    own = _own_base(c)
    return f"the base of the recording's orientations{f', {own}' if own else ''}"


def _gravity_in(frame: str, c: Calibration) -> tuple[Array, str]:
    """The direction of gravity (3,) in a program's base frame, and how that stands to the recording's, or has to."""
    own = _own_base(c)
    R_frame_own = R_between(frame, own)
    if frame == own or R_frame_own is None:
        return c.gravity_direction, f"taken for granted: {frame} is {_recorded_base(c)} (--base-frame names another)"
    return R_frame_own @ c.gravity_direction, f"gravity_field was turned into {frame} from {_recorded_base(c)}"


def _xyz(values: Array) -> str:
    return "{" + ", ".join(f"{axis}: {number(v)}" for axis, v in zip("xyz", values, strict=True)) + "}"


def _admittance_controller(c: Calibration, setup: Setup) -> Parameters:
    tool = rigid_tool(c, setup, "admittance_controller")
    base = _base_frame(c, setup)
    frame = json.dumps(setup.sensor_frame)
    body = f"""admittance_controller:
  ros__parameters:
    ft_sensor:
      name: {json.dumps(setup.sensor_name)}
      frame:
        id: {frame}
    fixed_world_frame:
      frame:
        id: {json.dumps(base)}
    gravity_compensation:
      frame:
        id: {frame}
      CoG:
        pos: [{numbers(tool.com)}]
        force: {number(tool.weight)}
"""
    remarks = (
        "CoG.pos in m from the sensor's origin, sensor axes; CoG.force is the weight, N",
        mounting_remark(tool, setup.sensor_frame),
        f"gravity is -z of {base}, which is {_recorded_base(c)}: another fixed world frame is turned the wrong way by "
        "this program",
    )
    bias = (
        f"the bias is not in here, this program has no parameter for it: `offset` of {BROADCASTER} takes it (export "
        f"--to {BROADCASTER} writes it); set ft_sensor.name here to {BROADCASTER}/{setup.sensor_name}, which that "
        f"program exports, or let the driver subtract [{numbers(tool.bias)}] (N, N m)"
    )
    unbiased = wrench_matrix(replace(tool, bias=np.zeros(6)))
    return Parameters(body, remarks, unbiased, DOWN, cautions=(bias,))


def _broadcaster(c: Calibration, setup: Setup) -> Parameters:
    tool = rigid_tool(c, setup, BROADCASTER)
    base = _base_frame(c, setup)
    reaction = c.provenance.get("sign") == "reaction"
    offset = tool.bias if reaction else -tool.bias
    direction, of_base = _gravity_in(base, c)
    turned = _xyz(-np.ones(3))
    multiplier = f"\n    multiplier:\n      force: {turned}\n      torque: {turned}" if reaction else ""
    body = f"""{BROADCASTER}:
  ros__parameters:
    sensor_name: {json.dumps(setup.sensor_name)}
    frame_id: {json.dumps(setup.sensor_frame)}
    offset:
      force: {_xyz(offset[:3])}
      torque: {_xyz(offset[3:])}{multiplier}
    sensor_filter_chain:
      filter1:
        name: "gravity_compensation"
        type: "control_filters/GravityCompensationWrench"
        params:
          world_frame: {json.dumps(base)}
          sensor_frame: {json.dumps(setup.sensor_frame)}
          tool:
            mass: {number(tool.weight / c.g)}
            CoG: [{numbers(tool.com)}]
            gravity_field: [{numbers(c.g * direction)}]
"""
    remarks = (
        "offset, N and N m, is added: it is minus the bias; the contact wrench is on the topic wrench_filtered",
        f"mass in kg; CoG in m from the sensor's origin, sensor axes; gravity_field in m/s^2, axes of {base}",
        mounting_remark(tool, setup.sensor_frame),
        of_base,
        *(["multiplier, after the offset, turns the reaction that the sensor gives into what acts on it"] * reaction),
    )
    return Parameters(body, remarks, wrench_matrix(tool), tool.gravity_direction, takes_reaction=True)


def _force_torque_tools(c: Calibration, setup: Setup) -> Parameters:
    tool = rigid_tool(c, setup, "force_torque_tools")
    reaction = c.provenance.get("sign") == "reaction"
    body = f"""bias: [{numbers(-tool.bias if reaction else tool.bias)}]
gripper_com_frame_id: {json.dumps(setup.sensor_frame)}
gripper_com_pose: [{numbers([*tool.com, 0.0, 0.0, 0.0])}]
gripper_mass: {number(tool.weight / c.g)}
"""
    imu = (
        "the topic imu is an accelerometer that reads +g upwards at rest, as the sensor gives the reaction"
        if reaction
        else "the topic imu must be gravity, DOWN: minus what an accelerometer at rest reads, as the sensor gives what "
        "acts on it; with an accelerometer's own sign the weight is added, not subtracted"
    )
    remarks = (
        "bias, N and N m, is subtracted; gripper_com_pose in m from the sensor's origin, sensor axes; gripper_mass in "
        "kg",
        mounting_remark(tool, setup.sensor_frame),
        imu,
        f"the length of imu is {number(c.g)} m/s^2 at rest; gripper_com_child_frame_id comes from its launch file",
    )
    return Parameters(body, remarks, wrench_matrix(tool), tool.gravity_direction, takes_reaction=True)


def _ft_tools_ros2(c: Calibration, setup: Setup) -> Parameters:
    tool = rigid_tool(c, setup, "ft_tools_ros2")
    body = f"""mass: {number(tool.weight / NODE_GRAVITY)}
sensor_frame_to_com: [{numbers(tool.com)}]
force_offset: [{numbers(tool.bias[:3])}]
torque_offset: [{numbers(tool.bias[3:])}]
"""
    remarks = (
        f"mass in kg, such that mass x {NODE_GRAVITY} m/s^2, this program's gravity, is the weight; "
        "sensor_frame_to_com in m from the sensor's origin, sensor axes; the offsets, N and N m, are subtracted",
        mounting_remark(tool, setup.sensor_frame),
        "taken for granted: reference_frame is the base of the recording's orientations, and upright; the node's "
        f"parameter gravity_in_reference_frame: [{numbers(NODE_GRAVITY * tool.gravity_direction)}] has its lean",
    )
    return Parameters(body, remarks, wrench_matrix(tool), DOWN)


def _cartesian_controllers(c: Calibration, setup: Setup) -> Parameters:
    tool = rigid_tool(c, setup, "cartesian_controllers")
    body = f"""cartesian_force_controller:
  ft_sensor_ref_link: {json.dumps(setup.sensor_frame)}
  gravity: {_xyz(c.g * tool.gravity_direction)}
  tool:
    mass: {number(tool.weight / c.g)}
    com_x: {number(tool.com[0])}
    com_y: {number(tool.com[1])}
    com_z: {number(tool.com[2])}
"""
    never_tared = wrench_matrix(tool)
    never_tared[:, 3] = 0.0
    never_tared[:3, 3] = -tool.weight * tool.gravity_direction
    force, torque = largest_error(c, never_tared, tool.gravity_direction)
    remarks = (
        "ROS 1; gravity in m/s^2, axes of robot_base_link, the recording's base; mass in kg; com in m from the "
        "sensor's origin, sensor axes",
        mounting_remark(tool, setup.sensor_frame),
        "it knows no bias: in one pose, free of contact, zero the sensor and call the service signal_taring; before "
        f"that the contact force is off by up to {force:.4g} N and the torque by up to {torque:.4g} N m",
        "taken for granted: a version that compensates in sensor axes (compensateGravity takes the sensor's wrench); "
        "those before it take the force's compensation back",
    )
    return Parameters(body, remarks, wrench_matrix(tool), tool.gravity_direction)


TARGETS = (
    Target(
        "admittance_controller",
        "ros2_controllers' admittance_controller (ROS 2)",
        "the sensor's frame in the URDF",
        "the bias, a base that leans",
        _admittance_controller,
        uses=("sensor_name", "sensor_frame", "base_frame"),
    ),
    Target(
        BROADCASTER,
        "force_torque_sensor_broadcaster of ros2_controllers, control_filters (ROS 2)",
        "the sensor's frame in the URDF",
        "",
        _broadcaster,
        uses=("sensor_name", "sensor_frame", "base_frame"),
    ),
    Target(
        "force_torque_tools",
        "force_torque_tools' gravity_compensation (ROS 1)",
        "the sensor's frame in the URDF, an accelerometer",
        "",
        _force_torque_tools,
        uses=("sensor_frame",),
    ),
    Target(
        "ft_tools_ros2",
        "ft_tools_ros2's ft_estimation_node (ROS 2)",
        "the sensor's frame in the URDF",
        "a base that leans (a parameter of its node)",
        _ft_tools_ros2,
        uses=("sensor_frame",),
    ),
    Target(
        "cartesian_controllers",
        "cartesian_controllers' cartesian_force_controller (ROS 1)",
        "the sensor's frame in the URDF, a taring",
        "the bias (tared)",
        _cartesian_controllers,
        uses=("sensor_frame",),
    ),
)
