"""A tool of known weight on a sensor, by the formula of design.md, section 1, and a session of the node with it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

import contactwrench as cw
from contactwrench.geometry.arrays import Array
from contactwrench.geometry.quaternions import Quat
from contactwrench_ros.parameters import defaults
from contactwrench_ros.session import Session

WEIGHT, COM = 13.7, np.array([0.012, -0.031, 0.074])
BIAS = np.array([3.0, -5.0, 20.0, 0.2, -0.1, 0.05])
MOUNTING = Rotation.from_euler("zyx", [37.0, 1.5, -2.0], degrees=True)
NOISE = np.array([0.02, 0.02, 0.02, 0.001, 0.001, 0.001])


def free(R: Rotation) -> Array:
    """What a free tool reads."""
    pull = (R * MOUNTING).inv().apply([0.0, 0.0, -WEIGHT])
    reading: Array = np.hstack([pull, np.cross(COM, pull)]) + BIAS
    return reading


def settings(**changes: Any) -> dict[str, Any]:
    return {**defaults(), **changes}


def save_calibration(path: Path, **read_as: str) -> str:
    """Of this tool, with what its provenance has of how it was read."""
    rng, poses = np.random.default_rng(3), Rotation.random(16, random_state=3)
    wrench = np.array([free(R) for R in poses]) + 1e-3 * NOISE * rng.normal(size=(16, 6))
    samples = cw.Samples(wrench, poses.as_matrix(), read_as={"base_frame": "base_link", **read_as})
    cw.calibrate(samples, model="mount").save(path)
    return str(path)


def quat(rotation: Rotation) -> Quat:
    x, y, z, w = rotation.as_quat().tolist()
    return x, y, z, w


def second(
    session: Session, R: Rotation, start: float, push: Array | float = 0.0, seed: int = 0, turned: float = 1.0
) -> list[Array | None]:
    """A second of readings at 500 Hz, poses at 100 Hz, at rest; `turned`: -1 with the other sign."""
    found = []
    wrench = turned * (free(R) + push * np.ones(6) + NOISE * np.random.default_rng(seed).normal(size=(500, 6)))
    for k in range(500):
        t = start + k / 500.0
        if k % 5 == 0:
            session.orientations.hear(t, quat(R))
        found.append(session.read(t, wrench[k]))
    return found
