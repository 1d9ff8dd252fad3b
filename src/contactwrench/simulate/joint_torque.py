"""What the torque sensors in the joints read.

A sensor sits between gear and link: the friction of motor and gear, which is by far the largest, never reaches it.
What does is the friction on the link's side, of bearings, seals and cables, and the sensor's own hysteresis.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..geometry.arrays import Array
from .arm import MAX_TORQUE
from .rig import JOINTS, Rig, import_mujoco, site_at
from .settings import JointTorque

SHARE_OF_OFFSET = SHARE_OF_GAIN = 0.01
"""Largest offset, of a joint's largest torque, and largest error of gain: together KUKA's 2 % (see `JointTorque`)."""


def any_robot(sensors: JointTorque, rng: np.random.Generator) -> JointTorque:
    """The sensors of a robot at random: offsets and gains anywhere within the maker's accuracy, the rest as given."""
    offset = rng.uniform(-SHARE_OF_OFFSET, SHARE_OF_OFFSET, JOINTS) * MAX_TORQUE
    gain = 1.0 + rng.uniform(-SHARE_OF_GAIN, SHARE_OF_GAIN, JOINTS)
    return replace(sensors, offset=tuple(offset.tolist()), gain=tuple(gain.tolist()))


def joint_torque_readings(sensors: JointTorque, torque: Array, friction: Array, rng: np.random.Generator) -> Array:
    """Readings (n, 7), N m, where the drives exert `torque` (n, 7) without friction, and `friction` (n, 7) besides."""
    noise = sensors.noise * rng.normal(size=torque.shape)
    readings: Array = (torque + friction) * np.array(sensors.gain) + np.array(sensors.offset) + noise
    return readings


def friction_torque(sensors: JointTorque, velocity: Array, rng: np.random.Generator) -> Array:
    """What Coulomb friction adds to the drives' torque (n, 7), N m, at joint velocities (n, 7), rad/s: all of it along
    the velocity. At rest it is anything up to that, either way, as the joint came to rest; it stays as long as the
    joint does, so a row here is a stay.
    """
    at_rest = rng.uniform(-sensors.friction, sensors.friction, size=velocity.shape)
    friction: Array = np.where(velocity == 0.0, at_rest, sensors.friction * np.sign(velocity))
    return friction


def sensor_jacobians(rig: Rig, joints: Array) -> Array:
    """The Jacobians (n, 6, 7) of the sensor's origin at joints (n, 7), rad: velocity, then angular velocity, in sensor
    axes. Their transposes bring a wrench on the sensor to the joints.
    """
    data = import_mujoco().MjData(rig.model)
    jacobians = np.empty((len(joints), 2, 3, JOINTS))
    for k, q in enumerate(joints):
        R_world_sensor, _, in_world = site_at(rig, data, q, rig.sensor)
        jacobians[k] = R_world_sensor.T @ in_world.reshape(2, 3, JOINTS)
    return jacobians.reshape(-1, 6, JOINTS)


def torque_against(jacobians: Array, contact: Array) -> Array:
    """What the drives exert (n, 7), N m, to stand against contact wrenches (n, 6) on the tool, about the sensor's
    origin and in its axes, at `sensor_jacobians` (n, 6, 7). MuJoCo's inverse dynamics leaves outer forces out.
    """
    torque: Array = -np.einsum("nij,ni->nj", jacobians, contact)
    return torque
