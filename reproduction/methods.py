"""Methods of compensation, each learned from one recording and applied to any reading.

Every one of them subtracts something affine in the direction of gravity, so a method is a B (6, 4) and a direction.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from contactwrench.calibration.calibration import Calibration
from contactwrench.estimation.calibrate import calibrate
from contactwrench.geometry.arrays import Array, read_only
from contactwrench.samples.samples import Samples
from contactwrench.subtract import compensate

DOWN = np.array([0.0, 0.0, -1.0])


@dataclass(frozen=True, eq=False)
class Method:
    """`contact = reading - B [r, 1]` with r = `gravity_direction` (base axes) as the flange sees it; `B` (6, 4)."""

    name: str
    B: Array
    gravity_direction: Array

    def __post_init__(self) -> None:
        for name in ("B", "gravity_direction"):
            object.__setattr__(self, name, read_only(getattr(self, name)))

    def contact(self, wrench: Array, R_base_flange: Array) -> Array:
        """The contact wrench (n, 6) or (6,) of readings at flange orientations, N and N m, sensor axes."""
        return compensate(self.B, self.gravity_direction, wrench, R_base_flange)


Learn: TypeAlias = Callable[[Samples], Method]
"""From contact-free samples (no load) to a method. May raise what `calibrate` raises."""


def calibrated(model: str, name: str) -> Learn:
    """The method of one of our models, by `calibrate`."""

    def learn(samples: Samples) -> Method:
        calibration = calibrate(samples, model)
        return Method(name, calibration.B, calibration.gravity_direction)

    return learn


def tare(samples: Samples) -> Method:
    """The sensor zeroed in the first pose."""
    return Method("tare", np.column_stack([np.zeros((6, 3)), samples.wrench[0]]), DOWN)


def gravity_only(samples: Samples) -> Method:
    """The tool's gravity as our calibration finds it, the bias left in (the paper's Table VIII)."""
    return without_bias("gravity only", calibrate(samples, "auto"))


def without_bias(name: str, calibration: Calibration) -> Method:
    """The calibration with its bias left in."""
    B = calibration.B.copy()
    B[:, 3] -= calibration.bias
    return Method(name, B, calibration.gravity_direction)


ours = calibrated("auto", "ours")
paper = calibrated("paper", "paper")

METHODS: dict[str, Learn] = {"ours": ours, "paper": paper, "tare": tare, "gravity only": gravity_only}
"""What every part compares; parts add others."""
