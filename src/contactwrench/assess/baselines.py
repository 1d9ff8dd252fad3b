"""What people do without this package, for comparison: gravity alone, and a tare in one pose.

The paper's Tables VI to VIII compare what is left of the reading in each contact-free pose; `compare` makes that
comparison for any recording, with the raw reading beside it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..calibration.calibration import Calibration
from ..geometry.arrays import Array, Frozen
from ..samples.poses import Pose


@dataclass(frozen=True, eq=False)
class LeftOver(Frozen):
    """What one method of compensation leaves of a contact-free recording: `wrench` (n, 6), pose by pose, N and N m."""

    name: str
    wrench: Array

    @property
    def mean_abs(self) -> Array:
        """Mean of the absolute values (6,): the paper's average error, Tables VII and VIII."""
        mean: Array = np.abs(self.wrench).mean(axis=0)
        return mean

    @property
    def max_abs(self) -> Array:
        """Largest absolute values (6,): the paper's maximum error."""
        largest: Array = np.abs(self.wrench).max(axis=0)
        return largest

    @property
    def rms(self) -> tuple[float, float]:
        """Root mean square of the norms of force (N) and torque (N m)."""
        squares = self.wrench**2
        return float(np.sqrt(squares[:, :3].sum(axis=1).mean())), float(np.sqrt(squares[:, 3:].sum(axis=1).mean()))


def compare(calibration: Calibration, poses: tuple[Pose, ...]) -> tuple[LeftOver, ...]:
    """The contact wrench left over in contact-free poses: full compensation, tare, gravity only, raw."""
    R = np.array([pose.R_base_flange for pose in poses])
    raw = np.array([pose.wrench for pose in poses])
    return (
        LeftOver("full", calibration.compensate(raw, R)),
        LeftOver("tare", tared(raw)),
        LeftOver("gravity only", without_gravity(calibration, raw, R)),
        LeftOver("raw", raw),
    )


def tared(wrench: Array) -> Array:
    """Readings (n, 6) less the first one: a sensor zeroed in one pose, whose tool then turns."""
    left: Array = wrench - wrench[0]
    return left


def without_gravity(calibration: Calibration, wrench: Array, R_base_flange: Array) -> Array:
    """Readings (n, 6) less the tool's gravity, the bias left in (the paper's Table VIII)."""
    return calibration.compensate(wrench, R_base_flange) + calibration.bias
