"""What a fake device shows: rows of a wrench and poses of a flange, of the rig or plain ones for tests."""

from __future__ import annotations

from dataclasses import dataclass
from math import atan2, sqrt
from typing import Protocol

import numpy as np

from ..geometry.arrays import Array

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
        vector: Array = axis * (2.0 * atan2(length if scalar >= 0.0 else -length, abs(scalar)) / max(length, 1e-300))
        return vector


class Signal(Protocol):
    """What a device is on."""

    def wrench_rows(self, t0: float, n: int, rate: float) -> Array:
        """What its sensor reads (n, 6), N and N m, sensor axes, at `t0 + k / rate`: the rows after the last ones."""
        ...

    def pose_at(self, t: float) -> FlangePose:
        """Where the flange is."""
        ...

    def true_contact(self, t: float) -> Array:
        """What the environment exerts on the sensor (6,), N and N m, sensor axes."""
        ...


class Plain:
    """A signal without physics: row k of the wrench is `wrench + k * step`, and the flange stays.

    A step of (1, 0, 0, 0, 0, 0) numbers the rows in fx. `rows` counts those that were asked for.
    """

    def __init__(
        self,
        wrench: tuple[float, ...] = NOTHING,
        step: tuple[float, ...] = NOTHING,
        R_base_flange: Array | None = None,
        position: tuple[float, float, float] = (0.0, 0.0, 0.0),
        joints: tuple[float, ...] = NOTHING,
    ) -> None:
        from scipy.spatial.transform import Rotation

        self.rows = 0
        self._wrench, self._step = np.array(wrench), np.array(step)
        R = np.eye(3) if R_base_flange is None else R_base_flange
        self._pose = FlangePose(R, Rotation.from_matrix(R).as_quat(), np.array(position), np.array(joints))

    def wrench_rows(self, t0: float, n: int, rate: float) -> Array:
        """The next rows, whatever the time."""
        number = np.arange(self.rows, self.rows + n)
        self.rows += n
        rows: Array = self._wrench + number[:, None] * self._step
        return rows

    def pose_at(self, t: float) -> FlangePose:
        """The pose, whatever the time."""
        return self._pose

    def true_contact(self, t: float) -> Array:
        """None."""
        return np.zeros(6)
