"""How far the mean reading of a free tool at rest scatters, by the time it is taken over."""

from __future__ import annotations

from dataclasses import dataclass

from ..geometry.arrays import Frozen, Matrix, Vector


@dataclass(frozen=True, eq=False)
class StillNoise(Frozen):
    """`std` (k, 6), N and N m, of means over `duration` (k,) s, ascending, within the still segments of a recording:
    the Allan deviation, half the mean square of how far a mean differs from the next, and its root.
    """

    duration: Vector
    std: Matrix
