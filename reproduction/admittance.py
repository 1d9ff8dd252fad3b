"""The standard admittance controller: a force moves a virtual mass on a damper and a spring.

`mass x'' + damping x' + stiffness x = force`, each axis by itself: Hogan, Impedance control: an approach to
manipulation, ASME J. Dyn. Sys. Meas. Control 107 (1985) 1-24; in the form for position-controlled arms, Villani and De
Schutter, Force control, in the Springer Handbook of Robotics (2016), chapter 9.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from contactwrench.errors import InputError
from contactwrench.geometry.arrays import Array, read_only


@dataclass(frozen=True, eq=False)
class Admittance:
    """Of k axes: `mass` (k,) kg or kg m^2, `damping` (k,) N s/m or N m s/rad, `stiffness` (k,) N/m or N m/rad."""

    mass: Array
    damping: Array
    stiffness: Array

    def __post_init__(self) -> None:
        for name in ("mass", "damping", "stiffness"):
            object.__setattr__(self, name, read_only(getattr(self, name)))
        if not (np.all(self.mass > 0.0) and np.all(self.damping >= 0.0) and np.all(self.stiffness >= 0.0)):
            raise InputError(
                f"an admittance of mass {self.mass}, damping {self.damping} and stiffness {self.stiffness}, expected "
                "every mass to be more than 0 and nothing negative"
            )

    def step(self, displacement: Array, velocity: Array, force: Array, period: float) -> tuple[Array, Array]:
        """Displacement and velocity (k,) one `period` (s) on, under a constant force (k,).

        Implicit in damping and spring, so that no period makes it unstable.
        """
        resistance = self.mass + period * (self.damping + period * self.stiffness)
        velocity = (self.mass * velocity + period * (force - self.stiffness * displacement)) / resistance
        return displacement + period * velocity, velocity
