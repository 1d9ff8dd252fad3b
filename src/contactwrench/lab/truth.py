"""What a fake device shows: rows of a wrench and poses of a flange, of the rig or plain ones for tests."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import atan2, sqrt
from typing import Protocol

import numpy as np

from ..geometry.arrays import Array
from ..geometry.orientation import to_quat_xyzw

NOTHING = (0.0,) * 6


@dataclass(frozen=True, eq=False)
class FlangePose:
    """`R_base_flange` (3, 3), the same as `quat_xyzw` (4,), `position` (3,) m in base axes, `joints` (k,) rad."""

    R_base_flange: Array
    quat_xyzw: Array
    position: Array
    joints: Array

    @property
    def rotation_vector(self) -> Array:
        """Of the orientation (3,), rad, of a half turn at most."""
        axis, scalar = self.quat_xyzw[:3], float(self.quat_xyzw[3])
        length = sqrt(axis @ axis)
        return axis * (2.0 * atan2(length if scalar >= 0.0 else -length, abs(scalar)) / max(length, 1e-300))


class Truth(Protocol):
    """What a device is on."""

    def wrench_rows(self, t0: float, n: int, rate: float) -> Array:
        """What its sensor reads (n, 6), N and N m, sensor axes, at `t0 + k / rate`: the rows after the last ones."""

    def pose_at(self, t: float) -> FlangePose:
        """Where the flange is."""

    def true_contact(self, t: float) -> Array:
        """What the environment exerts on the sensor (6,), N and N m, sensor axes."""


@dataclass
class Plain:
    """A truth without physics: row k of the wrench is `wrench + k * step`, so that a step of (1, 0, 0, 0, 0, 0) numbers
    the rows in fx, and the flange stays. `rows` counts those that were asked for.
    """

    wrench: Sequence[float] = NOTHING
    step: Sequence[float] = NOTHING
    R_base_flange: Array = field(default_factory=lambda: np.eye(3))
    position: Sequence[float] = (0.0, 0.0, 0.0)
    joints: Sequence[float] = NOTHING
    rows: int = 0

    def __post_init__(self) -> None:
        quat_xyzw = to_quat_xyzw(self.R_base_flange)
        self._pose = FlangePose(self.R_base_flange, quat_xyzw, np.array(self.position), np.array(self.joints))

    def wrench_rows(self, t0: float, n: int, rate: float) -> Array:
        """The next rows, whatever the time."""
        number = np.arange(self.rows, self.rows + n)
        self.rows += n
        return np.asarray(np.array(self.wrench) + number[:, None] * np.array(self.step))

    def pose_at(self, t: float) -> FlangePose:
        """The pose, whatever the time."""
        return self._pose

    def true_contact(self, t: float) -> Array:
        """None."""
        return np.zeros(6)
