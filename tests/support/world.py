"""The judge: a tool on a sensor in world-frame physics, and the Cramer-Rao bound of what its readings can tell.

Nothing here comes from the package. Gravity pulls on the centre of mass in base axes; its force and its torque about
the sensor's origin, `arm x force`, are formed in base axes and only then turned into the sensor's, which adds its
bias and noise. The bound is from central differences of these readings.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array: TypeAlias = NDArray[np.float64]

DOWN = np.array([0.0, 0.0, -1.0])
FREE_ROTATIONS = {"yaw": 1, "mount": 3, "mount+base": 5}


@dataclass(frozen=True, eq=False)
class Rig:
    """A tool of `weight` (N) with its centre of mass at `com` (m, sensor axes) on a sensor with `bias` (6,), mounted
    at `R_flange_sensor`, where gravity pulls along the unit vector `down` (base axes).
    """

    weight: float
    com: Array
    bias: Array
    R_flange_sensor: Array
    down: Array


def readings(rig: Rig, R_base_flange: Array) -> Array:
    """What the sensor reads, (n, 6), without noise, at flange orientations (n, 3, 3)."""
    R_base_sensor = R_base_flange @ rig.R_flange_sensor
    force = np.broadcast_to(rig.weight * rig.down, (len(R_base_sensor), 3))
    arm = R_base_sensor @ rig.com
    torque = np.cross(arm, force)
    in_sensor = [(R_base_sensor.transpose(0, 2, 1) @ part[..., None])[..., 0] for part in (force, torque)]
    return np.concatenate(in_sensor, axis=1) + rig.bias


def noisy_readings(rig: Rig, R_base_flange: Array, noise: Array, rng: np.random.Generator) -> Array:
    """`readings` with independent normal noise of standard deviations (6,)."""
    return readings(rig, R_base_flange) + noise * rng.normal(size=(len(R_base_flange), 6))


def random_rotations(n: int, rng: np.random.Generator) -> Array:
    """Rotations (n, 3, 3), uniform."""
    matrices: Array = Rotation.random(n, random_state=rng).as_matrix()
    return matrices


def random_rig(rng: np.random.Generator) -> Rig:
    """Any tool of 2 to 50 N, mounted anyhow, on an upright robot."""
    return Rig(
        weight=float(np.exp(rng.uniform(np.log(2.0), np.log(50.0)))),
        com=rng.normal(size=3) * 0.04,
        bias=rng.normal(size=6) * np.array([5.0, 5.0, 20.0, 0.5, 0.5, 0.2]),
        R_flange_sensor=random_rotations(1, rng)[0],
        down=DOWN,
    )


def tilted_down(angle: float, rng: np.random.Generator) -> Array:
    """A direction (3,) `angle` rad from down, towards a random side."""
    side = rng.uniform(0.0, 2.0 * np.pi)
    return np.array([np.sin(angle) * np.cos(side), np.sin(angle) * np.sin(side), -np.cos(angle)])


def perturbed(rig: Rig, step: Array) -> Rig:
    """The rig after a small step: weight, com (3), bias (6), then yaw (1), or mounting (3), or mounting and gravity
    (3 + 2); the mounting turns about the sensor's axes, gravity about two axes at right angles to it.
    """
    rotation, turn = step[10:], np.zeros(3)
    down = rig.down
    if len(rotation) == 1:
        turn[2] = rotation[0]
    else:
        turn = rotation[:3]
    if len(rotation) == 5:
        axes = np.linalg.svd(down[None])[2][1:]
        down = Rotation.from_rotvec(rotation[3:] @ axes).as_matrix() @ down
    return Rig(
        weight=rig.weight + float(step[0]),
        com=rig.com + step[1:4],
        bias=rig.bias + step[4:10],
        R_flange_sensor=rig.R_flange_sensor @ Rotation.from_rotvec(turn).as_matrix(),
        down=down,
    )


def derivatives(rig: Rig, model: str, R_base_flange: Array) -> Array:
    """Central differences (n, 6, p) of the readings with respect to the model's parameters."""
    p = 10 + FREE_ROTATIONS[model]
    columns = []
    for k in range(p):
        step = np.zeros(p)
        step[k] = 1e-5
        ahead, behind = perturbed(rig, step), perturbed(rig, -step)
        columns.append((readings(ahead, R_base_flange) - readings(behind, R_base_flange)) / 2e-5)
    return np.stack(columns, axis=2)


def cramer_rao(rig: Rig, model: str, R_base_flange: Array, noise: Array) -> Array:
    """The least covariance (p, p) that an unbiased estimate from these poses can have."""
    whitened = (derivatives(rig, model, R_base_flange) / noise[:, None]).reshape(6 * len(R_base_flange), -1)
    inverse = np.linalg.pinv(whitened, rcond=1e-12)
    covariance: Array = inverse @ inverse.T
    return covariance


def bound_on_prediction(rig: Rig, model: str, R_base_flange: Array, noise: Array, unseen: Array) -> tuple[float, float]:
    """The least RMS error of the predicted force (N) and torque (N m) at the orientations `unseen` (m, 3, 3)."""
    J = derivatives(rig, model, unseen)
    variance = np.einsum("nip,pq,niq->ni", J, cramer_rao(rig, model, R_base_flange, noise), J)
    force, torque = variance[:, :3].sum(axis=1).mean(), variance[:, 3:].sum(axis=1).mean()
    return float(np.sqrt(force)), float(np.sqrt(torque))


def with_down(rig: Rig, down: Array) -> Rig:
    """The same rig on a base in which gravity pulls along `down`."""
    return replace(rig, down=down)
