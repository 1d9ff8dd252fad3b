"""The package against Pinocchio: a random tool behind a sensor on the kinematics of a UR5e.

Kinematics: Denavit-Hartenberg parameters that Universal Robots publishes for the UR5e ("DH parameters for
calculations of kinematics and dynamics"). Pinocchio's recursive Newton-Euler gives, at rest, the wrench that holds
the tool; the sensor reads what the tool exerts on it, so the sign is turned.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import contactwrench as cw
from tests.support.rigs import rotation_angle
from tests.support.world import DOWN, Array, random_rotations, tilted_down

pin = pytest.importorskip("pinocchio", reason="Pinocchio has no build for this platform")

UR5E_A = (0.0, -0.425, -0.3922, 0.0, 0.0, 0.0)
UR5E_D = (0.1625, 0.0, 0.0, 0.1333, 0.0997, 0.0996)
UR5E_ALPHA = (np.pi / 2, 0.0, 0.0, np.pi / 2, -np.pi / 2, 0.0)
STANDARD_GRAVITY = 9.80665


@dataclass(frozen=True, eq=False)
class Arm:
    """The arm, the joint after which the flange comes, and the (locked) joint at the sensor that carries the tool."""

    model: Any
    wrist: int
    flange: Any
    sensor: int


def _arm(R_flange_sensor: Array, tool: Any, down: Array, rng: np.random.Generator) -> Arm:
    model = pin.Model()
    model.gravity.linear = STANDARD_GRAVITY * down
    joint, placement = 0, pin.SE3.Identity()
    for k, (a, d, alpha) in enumerate(zip(UR5E_A, UR5E_D, UR5E_ALPHA, strict=True)):
        joint = model.addJoint(joint, pin.JointModelRZ(), placement, f"joint_{k}")
        link = pin.Inertia(rng.uniform(1.0, 8.0), 0.1 * rng.normal(size=3), 0.02 * np.eye(3))
        model.appendBodyToJoint(joint, link, pin.SE3.Identity())
        placement = pin.SE3(Rotation.from_euler("x", alpha).as_matrix(), np.array([a, 0.0, d]))
    behind_flange = placement * pin.SE3(R_flange_sensor, 0.1 * rng.normal(size=3))
    sensor = model.addJoint(joint, pin.JointModelRZ(), behind_flange, "sensor")
    model.appendBodyToJoint(sensor, tool, pin.SE3.Identity())
    return Arm(model, joint, placement, sensor)


def _readings(arm: Arm, angles: Array, bias: Array) -> cw.Samples:
    data = arm.model.createData()
    wrench, R_base_flange = np.empty((len(angles), 6)), np.empty((len(angles), 3, 3))
    rest = np.zeros(arm.model.nv)
    for k, six in enumerate(angles):
        configuration = np.append(six, 0.0)
        pin.forwardKinematics(arm.model, data, configuration)
        pin.rnea(arm.model, data, configuration, rest, rest)
        wrench[k] = bias - data.f[arm.sensor].vector
        R_base_flange[k] = (data.oMi[arm.wrist] * arm.flange).rotation
    return cw.Samples(wrench=wrench, R_base_flange=R_base_flange)


def _case(seed: int, down: Array = DOWN) -> tuple[Arm, Array, float, Array, Array, np.random.Generator]:
    rng = np.random.default_rng(seed)
    mass, com = rng.uniform(0.3, 4.0), rng.normal(size=3) * np.array([0.03, 0.03, 0.08])
    R_flange_sensor = random_rotations(1, rng)[0]
    bias = rng.normal(size=6) * np.array([5.0, 5.0, 20.0, 0.5, 0.5, 0.2])
    turn = random_rotations(1, rng)[0]
    tool = pin.Inertia(mass, com, turn @ np.diag([0.004, 0.003, 0.002]) @ turn.T)
    return _arm(R_flange_sensor, tool, down, rng), R_flange_sensor, mass, com, bias, rng


def test_the_arm_is_a_ur5e() -> None:
    arm = _case(0)[0]
    data = arm.model.createData()
    pin.forwardKinematics(arm.model, data, np.zeros(7))
    flange = data.oMi[arm.wrist] * arm.flange
    assert flange.translation == pytest.approx([-0.8172, -0.2329, 0.0628], abs=1e-9)


@pytest.mark.parametrize("seed", range(8))
def test_calibrating_on_pinocchio_returns_the_tool(seed: int) -> None:
    arm, R_flange_sensor, mass, com, bias, rng = _case(seed)
    calibration = cw.calibrate(_readings(arm, rng.uniform(-np.pi, np.pi, (12, 6)), bias), "mount")
    assert calibration.mass == pytest.approx(mass, abs=1e-9)
    assert calibration.com == pytest.approx(com, abs=1e-9)
    assert calibration.bias == pytest.approx(bias, abs=1e-9)
    assert calibration.R_flange_sensor is not None
    assert rotation_angle(calibration.R_flange_sensor, R_flange_sensor) < 1e-9


@pytest.mark.parametrize("seed", range(8))
def test_predictions_and_compensation_agree_with_pinocchio_elsewhere(seed: int) -> None:
    arm, _, _, _, bias, rng = _case(seed)
    calibration = cw.calibrate(_readings(arm, rng.uniform(-np.pi, np.pi, (12, 6)), bias), "mount")
    unseen = _readings(arm, rng.uniform(-np.pi, np.pi, (200, 6)), bias)
    assert np.abs(calibration.predict(unseen.R_base_flange) - unseen.wrench).max() < 1e-9
    push = rng.normal(size=(200, 6))
    contact = calibration.compensate(unseen.wrench + push, unseen.R_base_flange)
    assert np.abs(contact - push).max() < 1e-9


@pytest.mark.parametrize("seed", range(4))
def test_an_arm_on_a_slanted_wall_is_found_out(seed: int) -> None:
    down = tilted_down(np.deg2rad(75.0), np.random.default_rng(100 + seed))
    arm, R_flange_sensor, mass, com, bias, rng = _case(seed, down)
    calibration = cw.calibrate(_readings(arm, rng.uniform(-np.pi, np.pi, (20, 6)), bias), "mount+base")
    assert calibration.gravity_direction == pytest.approx(down, abs=1e-9)
    assert calibration.mass == pytest.approx(mass, abs=1e-9)
    assert calibration.com == pytest.approx(com, abs=1e-9)
    assert calibration.R_flange_sensor is not None
    assert rotation_angle(calibration.R_flange_sensor, R_flange_sensor) < 1e-8
