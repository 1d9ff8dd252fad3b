"""Ways of compensation, each learned from one recording and applied to any reading.

Every one of them subtracts something affine in the direction of gravity, so a way is a matrix (6, 4) and a direction.
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
class Way:
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


Learn: TypeAlias = Callable[[Samples], Way]
"""From contact-free samples (no load) to a way. May raise what `calibrate` raises."""


def calibrated(model: str, name: str) -> Learn:
    """The way of one of our models, by `calibrate`."""

    def learn(samples: Samples) -> Way:
        calibration = calibrate(samples, model)
        return Way(name, calibration.B, calibration.gravity_direction)

    return learn


def tare(samples: Samples) -> Way:
    """The sensor zeroed in the first pose."""
    return Way("tare", np.column_stack([np.zeros((6, 3)), samples.wrench[0]]), DOWN)


def gravity_only(samples: Samples) -> Way:
    """The tool's gravity as our calibration finds it, the bias left in (the paper's Table VIII)."""
    return without_bias("gravity only", calibrate(samples, "auto"))


def without_bias(name: str, calibration: Calibration) -> Way:
    """The calibration with its bias left in."""
    B = calibration.B.copy()
    B[:, 3] -= calibration.bias
    return Way(name, B, calibration.gravity_direction)


ours = calibrated("auto", "ours")
paper = calibrated("paper", "paper")

WAYS: dict[str, Learn] = {"ours": ours, "paper": paper, "tare": tare, "gravity only": gravity_only}
"""What every part compares; parts add others."""
