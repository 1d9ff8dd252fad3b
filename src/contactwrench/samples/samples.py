"""Samples: paired readings and orientations, checked once, then read-only."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError
from ..geometry.arrays import Array, flags, read_only
from ..geometry.orientation import nearest_rotations

LARGEST_READING = 1e9
"""N and N m: no sensor reads more, and sums of squares of much larger numbers overflow."""


@dataclass(frozen=True, eq=False)
class Samples:
    """Readings of the sensor, each with the arm's orientation at that moment.

    Args:
        wrench: readings (n, 6), N and N m, sensor axes, pull sign.
        R_base_flange: rotation matrices (n, 3, 3), from flange to base axes.
        t: times (n,), s.
        position: of the flange (n, 3), m, base axes.
        load_mass: hung on the tool (n,), kg; 0 is none.
        source: where they come from, in words.
        delay: of wrench behind orientation, s, where it was estimated when the two were paired.
        delay_std: of `delay`, s.
        saturated: (n,), whether a channel of the sensor stood at its limit, where that was recorded.

    Raises:
        InputError: a wrong shape, a NaN, a reading beyond `LARGEST_READING`, no rotation, a negative load.
    """

    wrench: Array
    R_base_flange: Array
    t: Array | None = None
    position: Array | None = None
    load_mass: Array | None = None
    source: str = "arrays"
    delay: float | None = None
    delay_std: float | None = None
    saturated: NDArray[np.bool_] | None = None

    def __post_init__(self) -> None:
        n = len(np.atleast_1d(np.asarray(self.wrench)))
        shapes = {
            "wrench": (n, 6),
            "R_base_flange": (n, 3, 3),
            "t": (n,),
            "position": (n, 3),
            "load_mass": (n,),
        }
        for name, shape in shapes.items():
            values = getattr(self, name)
            if values is None:
                continue
            array = read_only(values)
            if array.shape != shape:
                pairs = "" if name == "wrench" else f" with n = {n} as in wrench"
                raise InputError(f"{name} has shape {array.shape}, expected {_with_n(name)}{pairs}")
            with np.errstate(over="ignore", invalid="ignore"):
                suspect = not np.isfinite(array.sum())
            if suspect:
                self._refuse_not_finite(name, array)
            if name == "R_base_flange":
                array = read_only(nearest_rotations(array)) if n else array
            object.__setattr__(self, name, array)
        if self.saturated is not None:
            object.__setattr__(self, "saturated", flags(self.saturated))
            if self.saturated.shape != (n,):
                raise InputError(f"saturated has shape {self.saturated.shape}, expected (n,) with n = {n} as in wrench")
        if n and max(self.wrench.max(), -self.wrench.min()) > LARGEST_READING:
            row, axis = (int(k) for k in np.argwhere(np.abs(self.wrench) > LARGEST_READING)[0])
            raise InputError(
                f"wrench in sample {row} is {self.wrench[row, axis]:g}, expected at most {LARGEST_READING:g} N or N m: "
                "leave such samples out",
                row,
            )
        if self.load_mass is not None and (self.load_mass < 0.0).any():
            row = int(np.argmax(self.load_mass < 0.0))
            raise InputError(f"load_mass in sample {row} is {self.load_mass[row]:g} kg, expected 0 or more", row)

    @staticmethod
    def _refuse_not_finite(name: str, array: Array) -> None:
        bad = np.argwhere(~np.isfinite(array))
        if len(bad):
            raise InputError(
                f"{name} in sample {bad[0][0]} is {array[tuple(bad[0])]}, expected a finite number: "
                "leave such samples out",
                int(bad[0][0]),
            )

    def __len__(self) -> int:
        return len(self.wrench)

    def select(self, rows: ArrayLike | slice) -> Samples:
        """The samples that `rows` (a mask, indices or a slice) picks, in that order."""
        pick = rows if isinstance(rows, slice) else np.asarray(rows)

        def of(values: Array | None) -> Array | None:
            return None if values is None else values[pick]

        return Samples(
            self.wrench[pick],
            self.R_base_flange[pick],
            of(self.t),
            of(self.position),
            of(self.load_mass),
            self.source,
            self.delay,
            self.delay_std,
            None if self.saturated is None else self.saturated[pick],
        )

    def unsaturated(self) -> tuple[Samples, tuple[str, ...]]:
        """The samples less those with a saturated channel, and a note where there are such."""
        if self.saturated is None or not self.saturated.any():
            return self, ()
        count = int(self.saturated.sum())
        return self.select(~self.saturated), (f"{count} rows with a saturated channel were left out",)


def _with_n(name: str) -> str:
    return {
        "wrench": "(n, 6)",
        "R_base_flange": "(n, 3, 3)",
        "t": "(n,)",
        "position": "(n, 3)",
        "load_mass": "(n,)",
    }[name]
