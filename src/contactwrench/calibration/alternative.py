"""What another model makes of the same poses."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from ..geometry.arrays import Array, Frozen, Matrix, Vector, shaped
from ..geometry.rotations import spread_rotations
from ..model import free_wrench, gravity_in_flange


@dataclass(frozen=True, eq=False)
class Alternative(Frozen):
    """What another `model` would have made of the same poses: beside a result, so that nobody has to run five.

    `weight` and `weight_std` N, None for `affine`; `force_left` N and `torque_left` N m: RMS norm of what it leaves in
    a pose, degrees of freedom counted; `B` (6, 4) and `gravity_direction` (3,) as in `Calibration`.
    """

    model: str
    weight: float | None
    weight_std: float | None
    force_left: float
    torque_left: float
    B: Matrix = field(metadata=shaped(6, 4))
    gravity_direction: Vector = field(metadata=shaped(3))

    def largest_force_change(self, B: Array, gravity_direction: Array) -> float:
        """The largest difference (N) of the contact force over all orientations, a norm, from that of `B`."""
        R = spread_rotations(288, 24)
        force = free_wrench(B[:3], gravity_in_flange(R, gravity_direction))
        others = free_wrench(self.B[:3], gravity_in_flange(R, self.gravity_direction))
        return float(np.linalg.norm(force - others, axis=1).max())


class Alternatives(Sequence[Alternative]):
    """Those of a calibration, worked out when first looked at: that takes a third as long as the calibration."""

    def __init__(self, work_out: Callable[[], tuple[Alternative, ...]]) -> None:
        self._work_out = work_out

    @cached_property
    def _all(self) -> tuple[Alternative, ...]:
        return self._work_out()

    def __getitem__(self, which: Any) -> Any:
        return self._all[which]

    def __len__(self) -> int:
        return len(self._all)

    def __repr__(self) -> str:
        return repr(self._all)

    def __reduce__(self) -> tuple[Any, ...]:
        return tuple, (self._all,)
