"""The joint torque sensors of robots at random, and what a wrench on the wrist sensor is to them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from contactwrench.geometry.arrays import Array
from contactwrench.simulate.arm import MAX_TORQUE
from contactwrench.simulate.rig import JOINTS, Rig, import_mujoco, site_at
from contactwrench.simulate.settings import JointTorque

SHARE_OF_OFFSET = SHARE_OF_GAIN = 0.01
"""Largest offset, of a joint's largest torque, and largest error of gain: together KUKA's 2 % (see `JointTorque`)."""


def any_robot(sensors: JointTorque, rng: np.random.Generator) -> JointTorque:
    """The sensors of a robot at random: offsets and gains anywhere within the maker's accuracy, the rest as given."""
    offset = rng.uniform(-SHARE_OF_OFFSET, SHARE_OF_OFFSET, JOINTS) * MAX_TORQUE
    gain = 1.0 + rng.uniform(-SHARE_OF_GAIN, SHARE_OF_GAIN, JOINTS)
    return replace(sensors, offset=tuple(offset.tolist()), gain=tuple(gain.tolist()))


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
