"""Streams: a wrench and an orientation, each at its own times, before they are brought onto one clock."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ..geometry.arrays import Array, Rows, column, read_only
from ..geometry.orientation import nearest_rotations

LONGEST_CHANCE = 20
"""Readings in a row at the very largest or smallest value: fewer may be chance, or a coarse converter."""
TIMES_USUAL = 4.0
"""As long as this many times any other run of readings in which that channel does not move."""


@dataclass(frozen=True, eq=False)
class WrenchStream(Rows):
    """What the sensor read: `t` (n,) s, in the order in which it was recorded; `wrench` (n, 6) N and N m, sensor axes,
    pull sign. A reading may be NaN: a sample that is there and says nothing. `source` says where it comes from.
    `load_mass` (n,) kg hung on the tool and `saturated` (n,), as in `Samples`, where they were recorded.
    """

    t: Array = field(metadata=column())
    wrench: Array = field(metadata=column(6))
    source: str = "arrays"
    load_mass: Array | None = field(default=None, metadata=column())
    saturated: NDArray[np.bool_] | None = field(default=None, metadata=column(kind=np.bool_))


@dataclass(frozen=True, eq=False)
class OrientationStream(Rows):
    """Where the arm was: `t` (m,) s, in the order in which it was recorded; `R_base_flange` (m, 3, 3); `position`
    (m, 3) m of the flange in base axes, where it is known. `source` says where it comes from.
    """

    t: Array = field(metadata=column())
    R_base_flange: Array = field(metadata=column(3, 3))
    position: Array | None = field(default=None, metadata=column(3))
    source: str = "arrays"

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self):
            object.__setattr__(self, "R_base_flange", read_only(nearest_rotations(self.R_base_flange)))


@dataclass(frozen=True, eq=False)
class Streams:
    """A recording as it is: what the sensor read, and where the arm was."""

    wrench: WrenchStream
    orientation: OrientationStream

    @classmethod
    def concatenate(cls, parts: Sequence[Streams]) -> Streams:
        """All rows, part after part."""
        return cls(_concatenated([part.wrench for part in parts]), _concatenated([part.orientation for part in parts]))


_Stream = TypeVar("_Stream", WrenchStream, OrientationStream)


def _concatenated(parts: list[_Stream]) -> _Stream:
    """One stream of several; one without rows need not have the columns of the others."""
    with_rows = [part for part in parts if len(part)]
    return type(parts[0]).concatenate(with_rows or parts[:1])


def at_limit(wrench: Array) -> NDArray[np.bool_]:
    """Whether a channel of readings (n, 6) stands at its largest or smallest value for far longer than it ever stands
    anywhere else: (n,). A channel that is never still for one reading longer than chance stands nowhere.
    """
    standing = np.zeros(len(wrench), dtype=bool)
    for values in wrench.T if len(wrench) else ():
        first = np.flatnonzero(np.r_[True, np.diff(values) != 0.0])
        length = np.diff(np.r_[first, len(values)])
        known = np.isfinite(values[first])
        if not known.any():
            continue
        level = values[first]
        extreme = (level == level[known].max()) | (level == level[known].min())
        elsewhere = int(length[~extreme].max(initial=1))
        flat = extreme & (length >= max(LONGEST_CHANCE, TIMES_USUAL * elsewhere))
        standing |= np.repeat(flat, length)
    return standing
