"""The rig in MuJoCo: arm, sensor, tool and load on a base, and its exact physics for given motions.

MuJoCo's force and torque sensors report what holds the tool, at the tool's side; design.md's wrench is what the tool
exerts on the sensor. The sign is turned here, once.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import InputError, MissingExtraError
from ..geometry.arrays import Array, Frozen
from .arm import FLANGE_HEIGHT, arm_xml, numbers
from .settings import Settings, Three

if TYPE_CHECKING:
    import mujoco

JOINTS = 7


@dataclass(frozen=True, eq=False)
class Rig:
    """The machine that `settings` describe, with a load on the tool's hook or none, compiled by MuJoCo."""

    settings: Settings
    model: mujoco.MjModel
    flange: int
    sensor: int
    """Numbers of the sites."""

    @cached_property
    def R_world_base(self) -> Array:
        """As of `settings`."""
        return self.settings.R_world_base


@dataclass(frozen=True, eq=False)
class Physics(Frozen):
    """What is true at each of n moments, without any error of measurement.

    `joints` (n, 7) rad; `wrench` (n, 6) N and N m, what tool and load exert on the sensor, about its origin, in its
    axes; `joint_torque` (n, 7) N m, what the drives exert; `R_base_flange` (n, 3, 3); `position` (n, 3) m of the flange
    in base axes.
    """

    joints: Array
    wrench: Array
    joint_torque: Array
    R_base_flange: Array
    position: Array


def build(
    settings: Settings,
    load_mass: float = 0.0,
    *,
    tool_shape: str = "",
    scene: str = "",
    option: str = "",
    more: str = "",
) -> Rig:
    """Compile the rig.

    Args:
        load_mass: on the tool's hook, kg.
        tool_shape: more XML, in sensor axes.
        scene: more XML, in world axes; bodies whose joints come after the arm's.
        option: more attributes of MuJoCo's `option` element.
        more: XML that stands beside the world, such as actuators.

    Raises:
        InputError: a load below zero.
        MissingExtraError: mujoco is not installed.
    """
    mujoco = import_mujoco()
    if load_mass < 0.0:
        raise InputError(f"the load is {load_mass:g} kg, expected 0 or more")
    xml = f"""<mujoco model="iiwa7">
  <compiler angle="radian" autolimits="true" inertiafromgeom="auto"/>
  <option gravity="0 0 {-settings.gravity!r}" {option}/>
  <visual>
    <headlight ambient="0.45 0.45 0.45" diffuse="0.45 0.45 0.45" specular="0.1 0.1 0.1"/>
    <global offwidth="1280" offheight="960"/>
    <quality shadowsize="4096"/>
  </visual>
  <asset>
    <texture type="skybox" builtin="gradient" rgb1="1 1 1" rgb2="0.93 0.95 0.97" width="64" height="64"/>
  </asset>
  <default><geom contype="0" conaffinity="0" density="0"/></default>
  <worldbody>
    <light pos="1.5 -1.5 3" dir="-0.4 0.4 -1" diffuse="0.5 0.5 0.5"/>
    {scene}
    <body name="base" quat="{_quat(settings.R_world_base)}">{arm_xml(_tool_xml(settings, load_mass, tool_shape))}</body>
  </worldbody>
  <sensor><force name="force" site="sensor"/><torque name="torque" site="sensor"/></sensor>
  {more}
</mujoco>"""
    model = mujoco.MjModel.from_xml_string(xml)
    return Rig(settings, model, model.site("flange").id, model.site("sensor").id)


def inverse_dynamics(
    rig: Rig,
    joints: Array,
    velocity: Array | None = None,
    acceleration: Array | None = None,
    force_on_hook: Array | None = None,
    shaking: Array | None = None,
) -> Physics:
    """The physics of an arm that follows a motion exactly.

    Args:
        joints: (n, 7), rad, of the rig's arm.
        velocity: (n, 7), rad/s; None: at rest.
        acceleration: (n, 7), rad/s^2; None: none.
        force_on_hook: (n, 3), N, base axes, on the tool's hook; None: it touches nothing.
        shaking: (n, 3), m/s^2, base axes, by which all accelerates beside the motion; None: nothing shakes.
    """
    mujoco = import_mujoco()
    data = mujoco.MjData(rig.model)
    n = len(joints)
    wrench, torque, R, position = np.empty((n, 6)), np.empty((n, JOINTS)), np.empty((n, 9)), np.empty((n, 3))
    at, speed, change = data.qpos, data.qvel, data.qacc
    sensed, drives = data.sensordata, data.qfrc_inverse
    R_world_flange, flange_in_world = data.site_xmat[rig.flange], data.site_xpos[rig.flange]
    on_tool = data.xfrc_applied[rig.model.body("tool").id]
    velocity = np.zeros(joints.shape) if velocity is None else velocity
    acceleration = np.zeros(joints.shape) if acceleration is None else acceleration
    pushed = set() if force_on_hook is None else set(np.flatnonzero(force_on_hook.any(axis=1)).tolist())
    gravity, at_rest = rig.model.opt.gravity, rig.model.opt.gravity.copy()
    felt = None if shaking is None else at_rest - shaking @ rig.R_world_base.T
    for k in range(n):
        if felt is not None:
            gravity[:] = felt[k]
        at[:], speed[:], change[:] = joints[k], velocity[k], acceleration[k]
        on_tool[:] = 0.0
        if force_on_hook is not None and k in pushed:
            on_tool[:] = _on_tool(rig, data, force_on_hook[k])
        mujoco.mj_inverse(rig.model, data)
        wrench[k], torque[k] = sensed, drives
        R[k], position[k] = R_world_flange, flange_in_world
    gravity[:] = at_rest
    R_base_world = rig.R_world_base.T
    return Physics(joints, -wrench, torque, R_base_world @ R.reshape(n, 3, 3), position @ R_base_world.T)


def _on_tool(rig: Rig, data: mujoco.MjData, force_on_hook: Array) -> Array:
    """Of a force (3,), base axes, on the hook: force and torque (6,) about the tool's centre of mass, world axes."""
    import_mujoco().mj_kinematics(rig.model, data)
    tool, (fx, fy, fz) = data.body("tool"), (rig.R_world_base @ force_on_hook).tolist()
    x, y, z = (tool.xpos + tool.xmat.reshape(3, 3) @ rig.settings.tool.hook - tool.xipos).tolist()
    return np.array([fx, fy, fz, y * fz - z * fy, z * fx - x * fz, x * fy - y * fx])  # np.cross takes ten times as long


def site_at(rig: Rig, data: Any, joints: Array, site: int) -> tuple[Array, Array, Array]:
    """Of a site, at joints (7,), its axes (3, 3), position (3,) and Jacobian (6, 7: velocity, then angular velocity) in
    the world; `data` is MuJoCo's, to work in.
    """
    mujoco = import_mujoco()
    data.qpos[:] = joints
    mujoco.mj_kinematics(rig.model, data)
    mujoco.mj_comPos(rig.model, data)
    jacobian = np.zeros((6, JOINTS))
    mujoco.mj_jacSite(rig.model, data, jacobian[:3], jacobian[3:], site)
    return data.site_xmat[site].reshape(3, 3).copy(), data.site_xpos[site].copy(), jacobian


def import_mujoco() -> Any:
    """MuJoCo, or the error that says how to install it."""
    try:
        import mujoco
    except ImportError:
        raise MissingExtraError(
            "the virtual rig needs mujoco, which is not installed: pip install 'contactwrench[sim]'"
        ) from None
    return mujoco


def _tool_xml(settings: Settings, load_mass: float, tool_shape: str) -> str:
    """The sensor's moving side, in sensor axes: the tool, with the load on its hook.

    A load is a ball of 6 kg per litre.
    """
    tool, height = settings.tool, settings.mounting.height
    moments, axes = np.linalg.eigh(settings.inertia)
    axes[:, 2] *= np.linalg.det(axes)
    load = ""
    if load_mass > 0.0:
        radius = 0.02 * (max(load_mass, 1e-3) / 0.2) ** (1.0 / 3.0)
        load = (
            f'<body name="load" pos="{numbers(tool.hook)}"><inertial pos="0 0 0" mass="{load_mass!r}" '
            f'diaginertia="{numbers((0.4 * load_mass * radius**2,) * 3)}"/>'
            f'<geom type="sphere" size="{radius!r}" rgba="0.55 0.42 0.2 1"/></body>'
        )
    shape = tool_shape or (
        '<geom type="cylinder" fromto="0 0 0 0 0 0.025" size="0.036" rgba="0.16 0.35 0.55 1"/>'
        f"{_between((0.0, 0.0, 0.025), tool.hook, 'capsule', 0.012, '0.45 0.47 0.5 1')}"
    )
    housing = _between((0.0, 0.0, -height), (0.0, 0.0, 0.0), "cylinder", 0.0405, "0.16 0.17 0.19 1")
    return (
        f'<body name="tool" pos="0 0 {FLANGE_HEIGHT + height!r}" quat="{_quat(settings.R_flange_sensor)}">'
        f'<inertial pos="{numbers(tool.com)}" quat="{_quat(axes)}" mass="{tool.mass!r}" '
        f'diaginertia="{numbers(moments)}"/>'
        f'<site name="sensor" size="0.004" rgba="0 0 0 0"/>{housing}{shape}{load}</body>'
    )


def _between(start: Three, end: Three, shape: str, radius: float, colour: str) -> str:
    """What is drawn from one point to another; nothing where they are one, which MuJoCo refuses to draw."""
    if np.allclose(start, end, rtol=0.0, atol=1e-6):
        return ""
    return f'<geom type="{shape}" fromto="{numbers(start)} {numbers(end)}" size="{radius}" rgba="{colour}"/>'


def _quat(R: Array) -> str:
    """MuJoCo's quaternion, scalar first, of a rotation matrix."""
    from scipy.spatial.transform import Rotation

    return numbers(Rotation.from_matrix(R).as_quat(scalar_first=True))
