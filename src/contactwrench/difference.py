"""What changed between two calibrations, each change with its standard deviation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .calibration import Calibration
from .model import AXES, gravity_in_flange
from .orientation import Array
from .rotations import rotation_angle, spread_rotations
from .samples import read_only

SIGNIFICANT = 3.0


@dataclass(frozen=True, eq=False)
class Difference:
    """Changes from calibration a to b.

    `names`, `units`, `change` (k,) and `std` (k,): parameters that both have, the calibrations taken as independent.
    `free_wrench` (6,): the largest change of each axis of the free wrench over all orientations (of `R_base_flange`
    in either's own base), N and N m. `mounting_angle` rad between the two mountings, None where one has none;
    `gravity_angle` rad between the two directions of gravity in base axes.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    change: Array
    std: Array
    free_wrench: Array
    mounting_angle: float | None
    gravity_angle: float

    def __post_init__(self) -> None:
        for name in ("change", "std", "free_wrench"):
            object.__setattr__(self, name, read_only(getattr(self, name)))

    @property
    def significant(self) -> tuple[str, ...]:
        """The parameters that changed by more than three standard deviations."""
        moved = np.abs(self.change) > SIGNIFICANT * self.std
        return tuple(name for name, yes in zip(self.names, moved, strict=True) if yes)


def difference(a: Calibration, b: Calibration) -> Difference:
    """The changes from `a` to `b`."""
    names, units, change, std = [], [], [], []

    def add(name: str, unit: str, before: float, after: float, std_before: float, std_after: float) -> None:
        names.append(name)
        units.append(unit)
        change.append(after - before)
        std.append(float(np.hypot(std_before, std_after)))

    if a.weight is not None and b.weight is not None and a.com is not None and b.com is not None:
        add("weight", "N", a.weight, b.weight, a.std["weight"], b.std["weight"])
        for k, axis in enumerate("xyz"):
            add(f"com_{axis}", "m", a.com[k], b.com[k], a.std["com"][k], b.std["com"][k])
    for k, axis in enumerate(AXES):
        add(f"bias_{axis}", "N" if k < 3 else "N m", a.bias[k], b.bias[k], a.std["bias"][k], b.std["bias"][k])
    angle = None
    if a.R_flange_sensor is not None and b.R_flange_sensor is not None and a.yaw is not None and b.yaw is not None:
        turned = (b.yaw - a.yaw + np.pi) % (2.0 * np.pi) - np.pi
        add("yaw", "rad", 0.0, turned, a.std["yaw"], b.std["yaw"])
        angle = rotation_angle(a.R_flange_sensor.T @ b.R_flange_sensor)
    across = float(np.linalg.norm(np.cross(a.gravity_direction, b.gravity_direction)))
    gravity_angle = float(np.arctan2(across, a.gravity_direction @ b.gravity_direction))
    everywhere = spread_rotations(288, 24)
    r_a, r_b = (gravity_in_flange(everywhere, c.gravity_direction) for c in (a, b))
    free = (r_b @ b.B[:, :3].T + b.B[:, 3]) - (r_a @ a.B[:, :3].T + a.B[:, 3])
    largest = np.abs(free).max(axis=0)
    return Difference(tuple(names), tuple(units), np.array(change), np.array(std), largest, angle, gravity_angle)
