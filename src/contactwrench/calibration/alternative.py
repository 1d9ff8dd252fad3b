"""What another model would have made of the same poses: beside a result, so that nobody has to run five."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..geometry.arrays import Array, read_only
from ..geometry.rotations import spread_rotations
from ..model import gravity_in_flange


@dataclass(frozen=True, eq=False)
class Alternative:
    """A rung of the ladder of models, fitted to the poses of a calibration.

    `weight` and `weight_std` N (None for `affine`); `force_left` N and `torque_left` N m, the RMS norms of what it
    leaves in a pose, degrees of freedom counted; `B` (6, 4) and `gravity_direction` (3,) as in `Calibration`.
    """

    model: str
    weight: float | None
    weight_std: float | None
    force_left: float
    torque_left: float
    B: Array
    gravity_direction: Array

    def __post_init__(self) -> None:
        for name in ("B", "gravity_direction"):
            object.__setattr__(self, name, read_only(getattr(self, name)))


def largest_force_change(B: Array, gravity_direction: Array, other: Alternative) -> float:
    """The largest difference (N) of the contact force over all orientations, a norm, from that of `B`."""
    R = spread_rotations(288, 24)
    force = gravity_in_flange(R, gravity_direction) @ B[:3, :3].T + B[:3, 3]
    others = gravity_in_flange(R, other.gravity_direction) @ other.B[:3, :3].T + other.B[:3, 3]
    return float(np.linalg.norm(force - others, axis=1).max())
