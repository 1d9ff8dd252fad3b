"""Known masses hung on the tool and weighed by each estimator: what one data set gives."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from contactwrench.geometry.arrays import Array
from contactwrench.samples.samples import Samples
from contactwrench.simulate.recording import read_poses, true_poses
from contactwrench.simulate.rig import Physics
from contactwrench.simulate.settings import Settings
from contactwrench.subtract import compensate

from .methods import METHODS, Learn, Method, calibrated
from .trials import (
    DEFAULT,
    learned,
    recordings,
)

LOADS = (0.1, 0.2, 0.5, 1.0)
"""kg: the paper's, Table IX."""


ORIENTATIONS = 12


CLEAR_OF_LIMIT = 6.0
"""Standard deviations of the noise between a reading and the sensor's limit."""


ESTIMATORS: dict[str, Learn] = {
    "paper": METHODS["paper"],
    "yaw": calibrated("yaw", "yaw"),
    "ours": METHODS["ours"],
    "tare": METHODS["tare"],
}


SCALES = ("norm", "along gravity")


@dataclass(frozen=True, eq=False)
class Weighed:
    """One trial: by estimator and scale the masses read, g, `down` (4,) with the tool down, `anywhere` (4, m) in the
    other orientations; by estimator the tool's `weight`, N, and the force that is `left` in the six poses, N RMS.
    """

    down: dict[tuple[str, str], Array]
    anywhere: dict[tuple[str, str], Array]
    weight: dict[str, float]
    left: dict[str, float]


def in_range(joints: Array) -> NDArray[np.intp]:
    """The numbers (k,) of the joints (m, 7), rad, at which no channel of the sensor reaches its limit with any load."""
    sensor = DEFAULT.sensor
    limit = sensor.overload * np.array(sensor.ranges)
    room = CLEAR_OF_LIMIT * np.array([*sensor.noise.force, *sensor.noise.torque])
    fits = np.ones(len(joints), dtype=bool)
    for load in LOADS:
        reading = true_poses(DEFAULT, joints, load, np.zeros_like(joints)).wrench + np.array(sensor.bias)
        fits &= np.all(np.abs(reading) + room < limit, axis=1)
    return np.flatnonzero(fits)


def run(settings: Settings, poses: Array, weighing: Array, seed: int, numbers: range) -> list[Weighed]:
    """The trials of those numbers, on joints (6, 7); masses hang in the first of joints (m, 7), rad, which has the tool
    down, and in some of the others, drawn anew for each trial.
    """
    truth = [true_poses(settings, weighing, load, np.zeros_like(weighing)) for load in LOADS]
    rngs = [np.random.default_rng((seed, 3, number)) for number in numbers]
    trials = []
    for samples, rng in zip(recordings(settings, poses, rngs), rngs, strict=True):
        drawn = np.r_[0, rng.choice(np.arange(1, len(weighing)), ORIENTATIONS, replace=False)]
        hung = read_poses(settings, [_of_poses(physics, drawn) for physics in truth], LOADS, rng).samples
        methods = {name: learned(learn, samples) for name, learn in ESTIMATORS.items()}
        read = {
            (name, scale): masses(method, hung, scale, settings.gravity).reshape(len(LOADS), -1)
            for name, method in methods.items()
            if method is not None
            for scale in SCALES
            if scale == "norm" or np.any(method.B[:3, :3])
        }
        trials.append(
            Weighed(
                {key: one[:, 0] for key, one in read.items()},
                {key: one[:, 1:] for key, one in read.items()},
                {name: _weight(method) for name, method in methods.items() if method is not None},
                {name: _left(method, samples) for name, method in methods.items() if method is not None},
            )
        )
    return trials


def _of_poses(physics: Physics, poses: NDArray[np.intp]) -> Physics:
    return Physics(*(getattr(physics, field.name)[poses] for field in fields(physics)))


def masses(method: Method, hung: Samples, scale: str, g: float) -> Array:
    """The masses (n,), g, that a method reads from the contact force: its `norm`, or its component `along gravity`."""
    force = method.contact(hung.wrench, hung.R_base_flange)[:, :3]
    if scale == "norm":
        weight: Array = np.linalg.norm(force, axis=1)
        return 1e3 * weight / g
    linear = np.column_stack([method.B[:, :3], np.zeros(6)])
    down = -compensate(linear, method.gravity_direction, np.zeros((len(hung), 6)), hung.R_base_flange)[:, :3]
    along: Array = np.sum(force * down, axis=1) / np.linalg.norm(down, axis=1)
    return 1e3 * along / g


def _weight(method: Method) -> float:
    """The weight of the tool, N, that a method takes off: its force part is the weight times a rotation."""
    return float(np.linalg.norm(method.B[:3, :3]) / np.sqrt(3.0))


def _left(method: Method, samples: Samples) -> float:
    force = method.contact(samples.wrench, samples.R_base_flange)[:, :3]
    return float(np.sqrt(np.sum(force**2, axis=1).mean()))
