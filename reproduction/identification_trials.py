"""Identification from six postures, once with each estimator: what one data set gives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from contactwrench.calibration.calibration import Calibration
from contactwrench.errors import ContactWrenchError
from contactwrench.estimation.calibrate import calibrate
from contactwrench.geometry.arrays import Array
from contactwrench.samples.samples import Samples

from .methods import Method, tare, without_bias
from .trials import (
    DEFAULT,
    Free,
    Squared,
    free_readings,
    left_by,
    recordings,
)

MODELS = {"paper": "paper", "yaw": "yaw", "ours": "auto"}
"""The estimators by the names that the tables call them, and the models behind them."""


METHODS = (*MODELS, "gravity only", "tare")


@dataclass(frozen=True, eq=False)
class Trial:
    """One data set. By estimator: the `parameters` and their stated `std` (2, 11) in SI. By method: the contact wrench
    (6, 6) that is `left` in the six poses, N and N m, and what is left at `unseen` orientations.
    """

    parameters: dict[str, Array]
    left: dict[str, Array]
    unseen: dict[str, Squared]


def run(poses: Array, unseen: Array, seed: int, numbers: range) -> list[Trial]:
    """The trials of those numbers, on joints (6, 7) and judged at joints (m, 7), rad."""
    free = free_readings(DEFAULT, unseen)
    rngs = [np.random.default_rng((seed, 1, number)) for number in numbers]
    return [_trial(samples, free) for samples in recordings(DEFAULT, poses, rngs)]


def _trial(samples: Samples, free: Free) -> Trial:
    found: dict[str, Calibration] = {}
    for name, model in MODELS.items():
        try:
            found[name] = calibrate(samples, model)
        except ContactWrenchError:
            continue
    methods = {name: Method(name, one.B, one.gravity_direction) for name, one in found.items()}
    if "ours" in found:
        methods["gravity only"] = without_bias("gravity only", found["ours"])
    methods["tare"] = tare(samples)
    return Trial(
        {name: parameters_of(one) for name, one in found.items()},
        {name: method.contact(samples.wrench, samples.R_base_flange) for name, method in methods.items()},
        {name: left_by(method, free) for name, method in methods.items()},
    )


def parameters_of(calibration: Calibration) -> Array:
    """Values and stated standard deviations (2, 11) in the order of `PARAMETERS`."""
    std = calibration.std
    if calibration.weight is None or calibration.com is None or calibration.yaw is None:
        raise TypeError("a rigid model has a tool")
    values = np.r_[calibration.weight, calibration.com, calibration.yaw, calibration.bias]
    both: Array = np.stack([values, np.r_[std["weight"], std["com"], std["yaw"], std["bias"]]])
    return both
