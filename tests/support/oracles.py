"""What other programs make of a parameter file: their own formulas, written down from their sources.

Each takes the file's text and gives what the program does with a reading: `contact(raw, R_base_flange)`, of the
sensor's reading (6,), force first, N and N m, the contact wrench (6,) in sensor axes. The sensor's frame stands against
the flange as the file says that the robot's description must have it.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import dataclass
from io import StringIO
from typing import Any, TypeAlias
from xml.etree import ElementTree

import numpy as np
from ruamel.yaml import YAML

from tests.support.exports import unwrapped
from tests.support.recordings import rx, ry, rz
from tests.support.world import Array

Contact: TypeAlias = Callable[[Array, Array], Array]


def numbers_behind(text: str, words: str) -> list[float]:
    """The numbers, with commas or blanks between, in the brackets or quotes that follow some words of a file."""
    found = re.search(re.escape(words) + r'[\["]([^\]"]*)[\]"]', unwrapped(text))
    assert found, words
    return [float(part) for part in found.group(1).replace(",", " ").split()]


def described_mounting(text: str) -> Array:
    """`R_flange_sensor` as the file says that URDF's `rpy` must be."""
    found = re.search(r'by rpy=\\?"([^"\\]*)\\?"', unwrapped(text))
    assert found
    roll, pitch, yaw = (float(angle) for angle in found.group(1).split())
    return rz(yaw) @ ry(pitch) @ rx(roll)


def read_yaml(text: str) -> Any:
    """A YAML file; for ROS 1's PyYAML 1e-05 without a point would be no number."""
    assert not re.search(r"^[^#]*[ \[]-?\d+e", text, re.MULTILINE)
    return YAML(typ="safe", pure=True).load(StringIO(text))


def joined(force: Array, torque: Array) -> Array:
    return np.concatenate([force, torque])


def is_double(value: Any) -> bool:
    """ROS 2 refuses an integer where a parameter is declared as a double."""
    return type(value) is float


def admittance_controller(text: str) -> Contact:
    """ros-controls/ros2_controllers, admittance_controller/include/admittance_controller/admittance_rule_impl.hpp:
    `AdmittanceRule::update`, `apply_parameters_update`, `process_wrench_measurements`, once the filter has settled.
    """
    parameters = read_yaml(text)["admittance_controller"]["ros__parameters"]
    gravity, frame = parameters["gravity_compensation"], parameters["ft_sensor"]["frame"]["id"]
    assert is_double(gravity["CoG"]["force"])
    assert all(map(is_double, gravity["CoG"]["pos"]))
    assert gravity["frame"]["id"] == frame
    assert parameters["fixed_world_frame"]["frame"]["id"] == "base_link"
    R_flange_sensor, cog_pos = described_mounting(text), np.array(gravity["CoG"]["pos"])
    end_effector_weight = np.array([0.0, 0.0, -gravity["CoG"]["force"]])

    def contact(raw: Array, R_base_flange: Array) -> Array:
        rot_world_sensor = R_base_flange @ R_flange_sensor
        wrench_world = rot_world_sensor @ np.column_stack([raw[:3], raw[3:]])
        wrench_world[2, 0] -= end_effector_weight[2]
        wrench_world[:, 1] -= np.cross(rot_world_sensor @ cog_pos, end_effector_weight)
        in_sensor = rot_world_sensor.T @ wrench_world
        return joined(in_sensor[:, 0], in_sensor[:, 1])

    return contact


def force_torque_sensor_broadcaster(text: str) -> Contact:
    """ros-controls/ros2_controllers, force_torque_sensor_broadcaster: the offset is added (pull request 1215), then the
    multiplier applied (1647), then the chain (1814); ros-controls/control_toolbox,
    control_toolbox/include/control_filters/gravity_compensation.hpp `compute_internal_params` and
    control_toolbox/src/control_filters/gravity_compensation.cpp `GravityCompensation::update`.
    """
    parameters = read_yaml(text)["force_torque_sensor_broadcaster"]["ros__parameters"]
    offset = _six(parameters["offset"])
    multiplier = _six(parameters["multiplier"]) if "multiplier" in parameters else np.ones(6)
    filter_1 = parameters["sensor_filter_chain"]["filter1"]
    assert filter_1["type"] == "control_filters/GravityCompensationWrench"
    assert filter_1["params"]["sensor_frame"] == parameters["frame_id"]
    assert filter_1["params"]["world_frame"] == "base_link"
    tool = filter_1["params"]["tool"]
    assert all(map(is_double, [tool["mass"], *tool["CoG"], *tool["gravity_field"]]))
    cst_ext_force, cog = np.array(tool["gravity_field"]) * tool["mass"], np.array(tool["CoG"])
    R_flange_sensor = described_mounting(text)

    def contact(raw: Array, R_base_flange: Array) -> Array:
        force = (R_base_flange @ R_flange_sensor).T @ cst_ext_force
        zeroed: Array = (raw + offset) * multiplier
        return zeroed - joined(force, np.cross(cog, force))

    return contact


def _six(parts: dict[str, dict[str, float]]) -> Array:
    values = [parts[part][axis] for part in ("force", "torque") for axis in "xyz"]
    assert all(map(is_double, values))
    return np.array(values)


def force_torque_tools(text: str, imu_base: Array) -> Contact:
    """kth-ros-pkg/force_torque_tools, gravity_compensation/src/gravity_compensation.cpp: `GravityCompensation::Zero`
    and `Compensate`; gravity_compensation_node.cpp `getROSParameters`. `imu_base` (3,), m/s^2: the topic imu, base
    axes.
    """
    parameters = read_yaml(text)
    pose, mass = parameters["gripper_com_pose"], parameters["gripper_mass"]
    bias: Array = np.array(parameters["bias"])
    assert bias.shape == (6,)
    assert pose[3:] == [0.0, 0.0, 0.0]
    assert mass > 0.0
    assert parameters["gripper_com_frame_id"] == "ft_frame"
    R_flange_sensor = described_mounting(text)

    def contact(raw: Array, R_base_flange: Array) -> Array:
        force: Array = (R_base_flange @ R_flange_sensor).T @ imu_base * mass
        return raw - bias - joined(force, np.cross(pose[:3], force))

    return contact


def ft_tools_ros2(text: str, gravity: tuple[float, ...] = (0.0, 0.0, -9.81)) -> Contact:
    """tpoignonec/ft_tools_ros2, ft_tools/src/ft_parameters.cpp `FtParameters::from_yaml`, ft_tools/src/
    ft_estimation.cpp `FtEstimation::remove_weight`; ft_tools/src/ft_estimation_node_parameters.yaml: the default of
    `gravity_in_reference_frame`, m/s^2.
    """
    parameters = read_yaml(text)
    com = np.array(parameters["sensor_frame_to_com"])
    offset: Array = np.array([*parameters["force_offset"], *parameters["torque_offset"]])
    R_flange_sensor = described_mounting(text)

    def contact(raw: Array, R_base_flange: Array) -> Array:
        forces_g: Array = parameters["mass"] * (R_base_flange @ R_flange_sensor).T @ np.array(gravity)
        return raw - joined(forces_g, np.cross(com, forces_g)) - offset

    return contact


class CartesianForceController:
    """fzi-forschungszentrum-informatik/cartesian_controllers (ROS 1), cartesian_force_controller/include/
    cartesian_force_controller/cartesian_force_controller.hpp: `init`, `compensateGravity(KDL::Wrench&)`,
    `signalTaringCallback`.
    """

    def __init__(self, text: str) -> None:
        parameters = read_yaml(text)["cartesian_force_controller"]
        assert parameters["ft_sensor_ref_link"] == "ft_frame"
        tool, gravity = parameters["tool"], parameters["gravity"]
        self.com = np.array([tool["com_x"], tool["com_y"], tool["com_z"]])
        self.weight = tool["mass"] * np.array([gravity["x"], gravity["y"], gravity["z"]])
        self.during_taring = joined(self.weight, np.zeros(3))
        self.R_flange_sensor = described_mounting(text)

    def signal_taring(self, R_base_flange: Array) -> None:
        self.during_taring = self._gravity(R_base_flange)

    def contact(self, raw: Array, R_base_flange: Array) -> Array:
        return raw - self._gravity(R_base_flange) + self.during_taring

    def _gravity(self, R_base_flange: Array) -> Array:
        force = (R_base_flange @ self.R_flange_sensor).T @ self.weight
        return joined(force, np.cross(self.com, force))


@dataclass(frozen=True)
class PTransform:
    """jrl-umi3218/SpaceVecAlg, src/SpaceVecAlg/PTransform.h: `E` turns coordinates into the new frame's, `r` is that
    frame's origin in the old one.
    """

    E: Array
    r: Array

    def __mul__(self, other: PTransform) -> PTransform:
        return PTransform(self.E @ other.E, other.r + other.E.T @ self.r)

    def inv(self) -> PTransform:
        return PTransform(self.E.T, -self.E @ self.r)

    def trans_mul(self, couple: Array, force: Array) -> tuple[Array, Array]:
        turned = self.E.T @ force
        return self.E.T @ couple + np.cross(self.r, turned), turned


def mc_rtc(text: str, sensor_in_parent: Array) -> Contact:
    """jrl-umi3218/mc_rtc, src/mc_rbdyn/ForceSensor.cpp: `ForceSensorCalibData::loadData`, `wfToSensor`,
    `ForceSensor::wrenchWithoutGravity`; include/mc_rbdyn/rpy_utils.h `rpyToMat`, whose RotX, RotY, RotZ are the
    transposed ones of SpaceVecAlg; include/mc_rtc/constants.h: gravity. The model's sensor has the parent's axes and is
    at `sensor_in_parent` (3,), m.
    """
    assert re.match(r"(?:\S+\n){13}", text), "a file that ends with the last number is refused"
    tokens = [float(token) for token in text.split()[:13]]
    mass, rpy, com, offset = tokens[0], tokens[1:4], np.array(tokens[4:7]), np.array(tokens[7:])
    world_force = -mass * np.array([0.0, 0.0, 9.80665])
    X_f_ds = PTransform(rx(rpy[0]).T @ ry(rpy[1]).T @ rz(rpy[2]).T, np.zeros(3))
    X_p_vb, X_p_f = PTransform(np.eye(3), com), PTransform(np.eye(3), sensor_in_parent)

    def contact(raw: Array, R_base_flange: Array) -> Array:
        X_0_p = PTransform(R_base_flange.T, np.array([0.3, -0.2, 0.7]))
        X_0_ds = X_f_ds * X_p_f * X_0_p
        X_0_vb = PTransform(X_0_ds.inv().E, (X_p_vb * X_0_p * X_0_ds.inv()).r)
        couple, force = X_0_vb.trans_mul(np.zeros(3), world_force)
        return raw - joined(offset[3:] + force, offset[:3] + couple)

    return contact


def hrpsys(text: str, notes: str) -> Contact:
    """fkanehiro/hrpsys-base, rtc/RemoveForceSensorLinkOffset/RemoveForceSensorLinkOffset.cpp
    `loadForceMomentOffsetParams`, `onExecute`, and its header for `grav`. The mounting is in the `notes` on stderr.
    """
    name, *tokens = text.split()
    assert name == "ft_sensor"
    assert len(tokens) == 10
    values = np.array([float(token) for token in tokens])
    force_offset, moment_offset, centroid, mass = values[:3], values[3:6], values[6:9], values[9]
    mg = np.array([0.0, 0.0, mass * 9.80665 * -1.0])
    R_flange_sensor = described_mounting(notes)

    def contact(raw: Array, R_base_flange: Array) -> Array:
        sensor_R = R_base_flange @ R_flange_sensor
        off_force = sensor_R @ (raw[:3] - force_offset) - mg
        off_moment = sensor_R @ (raw[3:] - moment_offset) - np.cross(sensor_R @ centroid, mg)
        return joined(sensor_R.T @ off_force, sensor_R.T @ off_moment)

    return contact


def yarp(text: str) -> Contact:
    """robotology/whole-body-estimators, devices/wholeBodyDynamics/SixAxisForceTorqueMeasureHelpers.cpp
    `SixAxisForceTorqueMeasureProcessor::filt`, WholeBodyDynamicsDevice.cpp `loadSecondaryCalibrationSettingsFromConfig`
    and `loadFTSensorOffsetFromConfig`; then the weight of the links as the file says that the URDF must have them.
    """
    device = ElementTree.fromstring(f"<device>{text}</device>")
    groups = {group.attrib["name"]: group for group in device.findall("group")}
    C = np.eye(6)
    if "FT_SECONDARY_CALIBRATION" in groups:
        C = _listed(groups["FT_SECONDARY_CALIBRATION"], 36).reshape(6, 6)
    offset = _listed(groups["FT_OFFSET"], 6)
    found = re.search(r"have a mass of (\S+) kg", unwrapped(text))
    assert found
    com = np.array(numbers_behind(text, "their centre of mass at "))
    gravity = next(_values(each) for each in device.findall("param") if each.attrib["name"] == "fixedFrameGravity")
    weight, R_flange_sensor = gravity * float(found.group(1)), described_mounting(text)

    def contact(raw: Array, R_base_flange: Array) -> Array:
        force = (R_base_flange @ R_flange_sensor).T @ weight
        measured: Array = C @ raw - offset
        return measured - joined(force, np.cross(com, force))

    return contact


def _values(element: ElementTree.Element) -> Array:
    assert element.text is not None
    tokens = element.text.strip().removeprefix("(").removesuffix(")").split(",")
    assert all("." in token for token in tokens), "YARP takes a number without a point for an integer"
    return np.array([float(token) for token in tokens])


def _listed(group: ElementTree.Element, count: int) -> Array:
    element = group.find("param")
    assert element is not None
    assert element.attrib["name"] == "ft_sensor"
    values = _values(element)
    assert values.shape == (count,)
    return values


def rh20t(text: str) -> Contact:
    """rh20t/rh20t_api, rh20t_api/configurations.py `Configuration.__init__` and rh20t_api/online.py
    `zeroed_force_torque_base`, turned back into sensor axes.
    """
    values = json.loads(text)
    centroid, tcp2sensor_rot = (np.array(values[key]) for key in ("centroid", "ts_rot"))
    offset: Array = np.array(values["offset"])
    gravity = np.array(values["gravity"]).reshape(4, 1)
    assert offset.shape == (6,)
    assert centroid.shape == (3,)
    assert tcp2sensor_rot.shape == (4, 4)
    sensor2tcp_rot = np.linalg.inv(tcp2sensor_rot)

    def contact(raw: Array, R_base_flange: Array) -> Array:
        tcp = np.eye(4)
        tcp[:3, :3], tcp[:3, 3] = R_base_flange, [0.4, -0.1, 0.6]
        turned = (np.linalg.inv(tcp @ sensor2tcp_rot) @ gravity)[:3, 0]
        return raw - offset - joined(turned, np.cross(centroid, turned))

    return contact
