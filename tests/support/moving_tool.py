"""A tool in any motion: what Pinocchio says that it exerts, and a calibration that knows it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
import pytest

import contactwrench as cw
from contactwrench.calibration.dynamics import Dynamics, inertial_matrix
from contactwrench.model import RigidTool
from contactwrench.samples.flange_motion import FlangeMotion
from tests.support.rigs import noise_free, noisy
from tests.support.world import Array, random_rig, random_rotations
from tests.support.world import Rig as World

pin = pytest.importorskip("pinocchio", reason="Pinocchio has no build for this platform")

STANDARD_GRAVITY = 9.80665


@dataclass(frozen=True, eq=False)
class MovingTool:
    """What is at the flange: the world's rig, the inertia about the centre of mass (3, 3), kg m^2, sensor axes, and
    where the sensor's origin is (3,), m from the flange's, flange axes.
    """

    world: World
    inertia: Array
    offset: Array

    @property
    def mass(self) -> float:
        """kg."""
        return self.world.weight / STANDARD_GRAVITY

    @property
    def tool(self) -> RigidTool:
        """As the package's model has it."""
        w = self.world
        return RigidTool(w.weight, w.com, w.bias, w.R_flange_sensor, w.down)


def any_tool(rng: np.random.Generator) -> MovingTool:
    """Any tool, mounting, sensor's place and base."""
    world = random_rig(rng)
    world = replace(world, down=random_rotations(1, rng)[0][0])
    moments, turn = rng.uniform(0.1, 1.0, 3), random_rotations(1, rng)[0]
    inertia = turn @ np.diag(moments.sum() - moments) @ turn.T * 0.05**2 * world.weight / STANDARD_GRAVITY
    return MovingTool(world, 0.5 * (inertia + inertia.T), 0.1 * rng.normal(size=3))


def any_motion(n: int, rng: np.random.Generator) -> FlangeMotion:
    """Any velocities and accelerations of an arm, and more, at any orientation."""
    omega, alpha, change = (scale * rng.normal(size=(n, 3)) for scale in (3.0, 20.0, 10.0))
    return FlangeMotion(omega, alpha, change, random_rotations(n, rng), np.ones(n, np.bool_))


def exerted(moving: MovingTool, motion: FlangeMotion) -> Array:
    """The readings (n, 6) of a free tool: recursive Newton-Euler, the flange a free flyer with the tool behind a locked
    joint at the sensor.
    """
    w = moving.world
    model = pin.Model()
    model.gravity.linear = STANDARD_GRAVITY * w.down
    flange = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "flange")
    model.appendBodyToJoint(flange, pin.Inertia(3.0, np.array([0.1, 0.0, 0.2]), 0.1 * np.eye(3)), pin.SE3.Identity())
    sensor = model.addJoint(flange, pin.JointModelRZ(), pin.SE3(w.R_flange_sensor, moving.offset), "sensor")
    model.appendBodyToJoint(sensor, pin.Inertia(moving.mass, w.com, moving.inertia), pin.SE3.Identity())
    data = model.createData()
    return np.array([_readings(model, data, motion, k) for k in range(len(motion))]) + w.bias


def _readings(model: Any, data: Any, motion: FlangeMotion, k: int) -> Array:
    omega, velocity = motion.angular_velocity[k], np.array([0.3, -0.2, 0.5])
    spatial = motion.acceleration[k] - np.cross(omega, velocity)
    q = np.concatenate([pin.SE3ToXYZQUAT(pin.SE3(motion.R_base_flange[k], np.ones(3))), [0.0]])
    v = np.concatenate([velocity, omega, [0.0]])
    a = np.concatenate([spatial, motion.angular_acceleration[k], [0.0]])
    pin.rnea(model, data, q, v, a)
    wrench: Array = -data.f[2].vector
    return wrench


@lru_cache
def known(seed: int, model: str = "mount+base", noise: float = 0.0) -> tuple[MovingTool, cw.Calibration]:
    """A tool and a calibration that knows it, of 24 poses, with dynamics as they are, and a covariance of any kind."""
    rng = np.random.default_rng(seed)
    moving = any_tool(rng)
    poses = random_rotations(24, rng)
    samples = noisy(moving.world, poses, rng) if noise else noise_free(moving.world, poses)
    still = cw.calibrate(samples, model, gravity=moving.world.down)
    assert still.com is not None
    assert still.R_flange_sensor is not None
    assert still.weight is not None
    found = RigidTool(still.weight, still.com, still.bias, still.R_flange_sensor, still.gravity_direction)
    unit = np.r_[np.full(6, 1e-4), np.full(3, 1e-3)]
    root = rng.normal(size=(9, 9 + len(still.parameters))) / 3.0
    own = root[:, :9] @ root[:, :9].T * np.outer(unit, unit)
    follows = 1e-2 * unit[:, None] * rng.normal(size=(9, len(still.parameters))) / np.sqrt(np.diag(still.covariance))
    of_stops = follows @ still.covariance
    dynamics = Dynamics(
        matrix=inertial_matrix(found, float(still.mass or 0.0), moving.inertia, moving.offset),
        inertia=moving.inertia,
        sensor_offset=moving.offset,
        covariance=own + of_stops @ follows.T,
        with_parameters=of_stops,
        bandwidth=10.0,
        motion_noise=np.zeros((2, 2)),
        residual_rms=np.zeros(6),
        static_rms=np.zeros(6),
        seconds=10.0,
    )
    return moving, replace(still, dynamics=dynamics)
