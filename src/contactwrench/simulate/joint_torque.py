"""What the torque sensors in the joints read."""

from __future__ import annotations

import numpy as np

from ..orientation import Array
from .settings import JointTorque


def joint_torque_readings(sensors: JointTorque, torque: Array, velocity: Array, rng: np.random.Generator) -> Array:
    """Readings (n, 7), N m, of the drives' torques (n, 7) at joint velocities (n, 7), rad/s."""
    at_rest = rng.uniform(-sensors.friction, sensors.friction, size=torque.shape)
    friction = np.where(velocity == 0.0, at_rest, sensors.friction * np.sign(velocity))
    noise = sensors.noise * rng.normal(size=torque.shape)
    readings: Array = (torque + friction) * np.array(sensors.gain) + np.array(sensors.offset) + noise
    return readings
