"""What the torque sensors in the joints read.

A sensor sits between gear and link: the friction of motor and gear, which is by far the largest, never reaches it.
What does is the friction on the link's side, of bearings, seals and cables, and the sensor's own hysteresis.
"""

from __future__ import annotations

import numpy as np

from ..geometry.arrays import Array
from .settings import JointTorque


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
