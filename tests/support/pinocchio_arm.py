"""The rig's arm in Pinocchio, built by its own calls from the table of links and the settings, not from XML."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from contactwrench.simulate.arm import FLANGE_HEIGHT, JOINT_RANGE, LINKS
from contactwrench.simulate.settings import Base, Mounting, Settings, Tool
from tests.support.world import Array

pin = pytest.importorskip("pinocchio", reason="Pinocchio has no build for this platform")

TOOL_RADIUS_OF_GYRATION = 0.03
LOAD_RADIUS, LOAD_OF_THAT_RADIUS = 0.02, 0.2
"""m and kg: loads are balls of one density."""

UP = {
    "table": np.eye(3),
    "wall": Rotation.from_euler("y", 90.0, degrees=True).as_matrix(),
    "ceiling": Rotation.from_euler("x", 180.0, degrees=True).as_matrix(),
}


@dataclass(frozen=True, eq=False)
class Arm:
    """`free` has seven joints; in `sensing` an eighth, locked, stands at the sensor and carries the tool."""

    free: Any
    sensing: Any
    base: Any
    flange: Any
    """Placements: of the base in the world, of the flange on the last link."""


@dataclass(frozen=True, eq=False)
class Judged:
    """What Pinocchio says of one moment, in the words of the rig's `Physics`."""

    wrench: Array
    joint_torque: Array
    R_base_flange: Array
    position: Array


def arm_of(settings: Settings, load_mass: float = 0.0) -> Arm:
    """The arm that the settings describe."""
    base = pin.SE3(UP[settings.base.on] @ _turn([*settings.base.tilt_deg, 0.0]), np.zeros(3))
    flange = pin.SE3(np.eye(3), np.array([0.0, 0.0, FLANGE_HEIGHT]))
    mounting = _turn([*settings.mounting.tilt_deg, 0.0]) @ _turn([0.0, 0.0, settings.mounting.yaw_deg])
    on_flange = flange * pin.SE3(mounting, np.array([0.0, 0.0, settings.mounting.height]))
    tool = settings.tool
    carried = pin.Inertia(tool.mass, np.array(tool.com), _inertia(tool))
    if load_mass > 0.0:
        radius = LOAD_RADIUS * np.cbrt(load_mass / LOAD_OF_THAT_RADIUS)
        carried += pin.Inertia.FromSphere(load_mass, radius).se3Action(pin.SE3(np.eye(3), np.array(tool.hook)))
    models = []
    for locked in (False, True):
        model = pin.Model()
        model.gravity.linear = np.array([0.0, 0.0, -settings.gravity])
        joint, before = 0, base
        for number, link in enumerate(LINKS, start=1):
            twist = Rotation.from_euler("x", link.twist_deg, degrees=True).as_matrix()
            placement = before * pin.SE3(twist, np.array(link.position))
            joint = model.addJoint(joint, pin.JointModelRZ(), placement, f"q{number}")
            inertia = pin.Inertia(link.mass, np.array(link.com), np.diag(link.inertia))
            model.appendBodyToJoint(joint, inertia, pin.SE3.Identity())
            before = pin.SE3.Identity()
        if locked:
            sensor = model.addJoint(joint, pin.JointModelRZ(), on_flange, "sensor")
            model.appendBodyToJoint(sensor, carried, pin.SE3.Identity())
        else:
            model.appendBodyToJoint(joint, carried, on_flange)
        models.append(model)
    return Arm(models[0], models[1], base, flange)


def judge(
    arm: Arm, joints: Array, velocity: Array | None = None, acceleration: Array | None = None, push: Array | None = None
) -> Judged:
    """The moment with joints, velocities and accelerations (7,); `push` (6,) is what the surroundings exert on the
    tool, about the sensor's origin and in its axes.
    """
    rest = np.zeros(7)
    q, v, a = (np.append(rest if part is None else part, 0.0) for part in (joints, velocity, acceleration))
    data = arm.sensing.createData()
    outside = [pin.Force.Zero() for _ in range(arm.sensing.njoints)]
    outside[8] = pin.Force(np.zeros(6) if push is None else push)
    torque = pin.rnea(arm.sensing, data, q, v, a, outside)
    pin.forwardKinematics(arm.sensing, data, q)
    at = arm.base.inverse() * data.oMi[7] * arm.flange
    return Judged(-data.f[8].vector, torque[:7], at.rotation.copy(), at.translation.copy())


def forward(arm: Arm, data: Any, joints: Array, velocity: Array, torque: Array) -> Array:
    """The accelerations (7,) under drive torques (7,), by the articulated-body algorithm."""
    acceleration: Array = pin.aba(arm.free, data, joints, velocity, torque).copy()
    return acceleration


def any_settings(rng: np.random.Generator) -> Settings:
    """Any tool, mounting and base, gravity of any planet."""
    gravity, mass = rng.uniform(1.0, 25.0), rng.uniform(0.05, 5.0)
    com, hook = _three(0.1 * rng.normal(size=3)), _three(0.2 * rng.normal(size=3))
    return Settings(
        gravity=float(gravity),
        tool=Tool(float(mass), com, hook, _any_inertia(rng)),
        mounting=Mounting(*_mounting(rng)),
        base=Base(("table", "wall", "ceiling")[int(rng.integers(3))], _two(rng.uniform(-90.0, 90.0, 2))),
    )


def any_joints(rng: np.random.Generator, n: int) -> Array:
    """Joints (n, 7) within the limits."""
    joints: Array = rng.uniform(-JOINT_RANGE, JOINT_RANGE, (n, 7))
    return joints


def _mounting(rng: np.random.Generator) -> tuple[float, tuple[float, float], float]:
    return float(rng.uniform(-180.0, 180.0)), _two(rng.uniform(-180.0, 180.0, 2)), float(rng.uniform(0.0, 0.1))


def _inertia(tool: Tool) -> Array:
    """About the centre of mass (3, 3), kg m^2: as it is set, or a ball's."""
    if not any(tool.inertia):
        ball: Array = tool.mass * TOOL_RADIUS_OF_GYRATION**2 * np.eye(3)
        return ball
    upper = np.zeros((3, 3))
    upper[np.triu_indices(3)] = tool.inertia
    matrix: Array = upper + np.triu(upper, 1).T
    return matrix


def _any_inertia(rng: np.random.Generator) -> tuple[float, float, float, float, float, float]:
    """xx, xy, xz, yy, yz, zz kg m^2, of four masses about 0.1 m apart."""
    places, masses = 0.1 * rng.normal(size=(4, 3)), rng.uniform(0.1, 1.0, 4)
    places -= masses @ places / masses.sum()
    second = (places.T * masses) @ places
    xx, xy, xz, yy, yz, zz = (np.trace(second) * np.eye(3) - second)[np.triu_indices(3)].tolist()
    return xx, xy, xz, yy, yz, zz


def _turn(vector_deg: list[float]) -> Array:
    R: Array = Rotation.from_rotvec(vector_deg, degrees=True).as_matrix()
    return R


def _two(values: Array) -> tuple[float, float]:
    return float(values[0]), float(values[1])


def _three(values: Array) -> tuple[float, float, float]:
    return float(values[0]), float(values[1]), float(values[2])
