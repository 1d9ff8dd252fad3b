"""Streams: a wrench and an orientation, each at its own times, before they are brought onto one clock."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..geometry.arrays import Array, flags, read_only
from ..geometry.orientation import nearest_rotations


@dataclass(frozen=True, eq=False)
class WrenchStream:
    """What the sensor read: `t` (n,) s, in the order in which it was recorded; `wrench` (n, 6) N and N m, sensor axes,
    pull sign. A reading may be NaN: a sample that is there and says nothing. `source` says where it comes from.
    `load_mass` (n,) kg hung on the tool and `saturated` (n,), as in `Samples`, where they were recorded.
    """

    t: Array
    wrench: Array
    source: str = "arrays"
    load_mass: Array | None = None
    saturated: NDArray[np.bool_] | None = None

    def __post_init__(self) -> None:
        _require_pairs(self, {"t": (), "wrench": (6,), "load_mass": ()})
        if self.saturated is not None:
            object.__setattr__(self, "saturated", flags(self.saturated))
            if self.saturated.shape != (len(self),):
                raise InputError(
                    f"saturated has shape {self.saturated.shape}, expected {(len(self),)}: one for each time"
                )

    def __len__(self) -> int:
        return len(self.t)


@dataclass(frozen=True, eq=False)
class OrientationStream:
    """Where the arm was: `t` (m,) s, in the order in which it was recorded; `R_base_flange` (m, 3, 3); `position`
    (m, 3) m of the flange in base axes, where it is known. `source` says where it comes from.
    """

    t: Array
    R_base_flange: Array
    position: Array | None = None
    source: str = "arrays"

    def __post_init__(self) -> None:
        _require_pairs(self, {"t": (), "R_base_flange": (3, 3), "position": (3,)})
        if len(self):
            object.__setattr__(self, "R_base_flange", read_only(nearest_rotations(self.R_base_flange)))

    def __len__(self) -> int:
        return len(self.t)


@dataclass(frozen=True, eq=False)
class Streams:
    """A recording as it is: what the sensor read, and where the arm was."""

    wrench: WrenchStream
    orientation: OrientationStream


def _require_pairs(stream: WrenchStream | OrientationStream, row: dict[str, tuple[int, ...]]) -> None:
    """Raise `InputError` unless every array has a row, of that shape, for each time; make them read-only."""
    n = len(stream.t)
    for name, shape in row.items():
        values = getattr(stream, name)
        if values is None:
            continue
        array = read_only(values)
        if array.shape != (n, *shape):
            raise InputError(f"{name} has shape {array.shape}, expected {(n, *shape)}: one row for each time")
        object.__setattr__(stream, name, array)
