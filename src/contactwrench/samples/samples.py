"""Samples, paired readings and orientations, and the streams they are made of: checked once, then read-only."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError
from ..geometry.arrays import Array, Frozen, Rows, TimesLike, column, read_only
from ..geometry.orientation import ORIENTATIONS, OrientationLike, nearest_rotations, rotation_matrices
from ..geometry.ranges import ENTRY, LOAD_KG, PLACE, READING, TIME, Range, require_seconds
from ..geometry.wrench import WRENCH_AXES, require_axes
from .limits import LONGEST_CHANCE

ReadAs: TypeAlias = Mapping[str, str | float]
"""How a file was read, by the names of the options of reading."""

LARGEST_READING = READING.most
"""N and N m: no sensor reads more, and sums of squares of much larger numbers overflow."""
CODES, CODE_BEYOND = 10.0 ** np.arange(3, 10) - 1.0, 5.0
"""What stands for no number, 999 to 999999999; and times the largest other number of its column."""
FEWEST_LOST, MOST_LOST, AS_POSES = 3, 10, 1_000
"""Rows of zeros that are packets which did not come: at least, in up to so many rows, as a tare reads so once; and at
most one after the other: more are stuck.
"""
NOT_KNOWN = "delay_std", np.inf  # of two clocks
SLOWEST = 0.25
"""s from row to row: a stream has four rows a second or more."""


@dataclass(frozen=True, eq=False)
class Samples(Rows):
    """Readings of the sensor, each with the arm's orientation at that moment.

    Args:
        wrench: readings (n, 6), N and N m, sensor axes, pull sign.
        R_base_flange: rotation matrices (n, 3, 3), from flange to base axes; made of quaternions x, y, z, w (n, 4) or a
            scipy Rotation, if such are given.
        t: times (n,), s; or dates, of numpy, pandas or Python, as s since 1970, UTC where they state no time zone.
        position: of the flange (n, 3), m, base axes; what is no place, as a NaN, is not known.
        load_mass: hung on the tool (n,), kg; 0 is none.
        came: when the arm had come to rest at the orientation (n,), s, at `t` or before; None: not known.
        source: where they come from, in words.
        delay: of wrench behind orientation, s, where it was estimated or stated when the two were paired.
        delay_std: of `delay`, s; 0 of a stated one.
        saturated: (n,), whether a channel of the sensor stood at its limit, where that was recorded.
        read_as: how their file was read: options of reading, and what was found, under the names that the provenance of
            a calibration has for them.
        doubt: what may be wrong in how a file was read, one sentence; empty: nothing.
        pose_period: s, between the poses that orientation and position were interpolated between; None: each row has
            its own.
        damage: what of a damaged file could not be read, one sentence; empty: nothing.
        accelerometer: what one on the tool read (n, 3), own axes and unit; NaN: not known.
        accelerometer_period: s, between the readings that these were interpolated between; None: each row has its own.
        notes: what was done and left out as a file was read, a sentence each.

    Raises:
        InputError: a wrong shape, a NaN, a number that stands for none (-9999), a reading beyond `LARGEST_READING`, no
            rotation, a time or a load that nobody could mean.
    """

    wrench: Array = field(metadata=column(6))
    R_base_flange: Array = field(metadata=column(3, 3))
    t: Array | None = field(default=None, metadata=column())
    position: Array | None = field(default=None, metadata=column(3))
    load_mass: Array | None = field(default=None, metadata=column())
    source: str = "arrays"
    delay: float | None = None
    delay_std: float | None = None
    saturated: NDArray[np.bool_] | None = field(default=None, metadata=column(kind=np.bool_))
    read_as: ReadAs = field(default_factory=dict)
    doubt: str = ""
    damage: str = ""
    came: Array | None = field(default=None, metadata=column())
    pose_period: float | None = None
    accelerometer: Array | None = field(default=None, metadata=column(3))
    accelerometer_period: float | None = None
    notes: tuple[str, ...] = ()

    if TYPE_CHECKING:  # what is taken is more than what the fields are then

        def __init__(
            self,
            wrench: ArrayLike,
            R_base_flange: OrientationLike,
            t: TimesLike | None = None,
            position: ArrayLike | None = None,
            load_mass: ArrayLike | None = None,
            source: str = "arrays",
            delay: float | None = None,
            delay_std: float | None = None,
            saturated: ArrayLike | None = None,
            read_as: ReadAs = ...,
            doubt: str = "",
            damage: str = "",
            came: TimesLike | None = None,
            pose_period: float | None = None,
            accelerometer: ArrayLike | None = None,
            accelerometer_period: float | None = None,
            notes: tuple[str, ...] = (),
        ) -> None: ...

    def __post_init__(self) -> None:
        shape: tuple[int, ...] = ()
        with suppress(ValueError):  # of lists that are no numbers, which is said below
            shape = np.shape(self.R_base_flange)
        if hasattr(self.R_base_flange, "as_matrix") or shape[1:] == (4,):
            object.__setattr__(self, "R_base_flange", rotation_matrices(self.R_base_flange)[0])
        elif len(shape) > 1 and shape[1:] != (3, 3):
            raise InputError(f"R_base_flange has shape {shape}, expected {ORIENTATIONS}")
        require_axes(self.wrench)
        super().__post_init__()
        for name in ("delay", "delay_std", "pose_period", "accelerometer_period"):
            stated = getattr(self, name)
            if stated is not None and (name, stated) != NOT_KNOWN:
                TIME.require(stated, name)
        ranges = {"wrench": READING, "R_base_flange": ENTRY, "t": TIME, "load_mass": LOAD_KG, "came": TIME}
        for name, within in ranges.items():
            _require_within(name, getattr(self, name), within)
        if (codes := stands_for_none(self.wrench)).any():
            row, axis = (int(place) for place in np.argwhere(codes)[0])
            found = f"wrench in sample {row} is {self.wrench[row, axis]:g}, which stands for no reading"
            raise InputError(f"{found}: leave such samples out", row)
        if self.t is not None:
            require_seconds(float(self.t.max(initial=0.0)))
        if self.came is not None and (self.t is None or (self.came > self.t).any()):
            raise InputError("came is later than t, or there is no t, expected when the arm had come to rest: before t")
        object.__setattr__(self, "position", _known(self.position))
        object.__setattr__(self, "R_base_flange", _rotations(self.R_base_flange))

    def __repr__(self) -> str:
        return f"<Samples: {len(self)} of {self.source}>"

    def unsaturated(self) -> tuple[Samples, tuple[str, ...]]:
        """The samples less those with a saturated channel, and a note where there are such, with the channels that
        stand at their largest or smallest value there.
        """
        if self.saturated is None or not self.saturated.any():
            return self, ()
        lost, most, least = self.wrench[self.saturated], self.wrench.max(axis=0), self.wrench.min(axis=0)
        standing = np.maximum((lost == most).sum(axis=0), (lost == least).sum(axis=0)) >= LONGEST_CHANCE
        stuck = ", ".join(np.array(WRENCH_AXES)[standing])
        of = f"{len(lost)} of {len(self)} rows with a saturated channel"
        return self.select(~self.saturated), (f"{of}{f' ({stuck})' if stuck else ''} were left out",)


def require_samples(samples: object) -> None:
    """Raise `InputError` for what is none: an array, a path."""
    if not isinstance(samples, Samples):
        found = type(samples).__name__
        raise InputError(f"found {found}, expected Samples: cw.read(path) or cw.Samples(wrench=, ...)")


@dataclass(frozen=True, eq=False)
class WrenchStream(Rows):
    """What the sensor read, before it is brought onto one clock with the orientation.

    Args:
        t: stamps (n,), s, in the order in which the readings were recorded.
        wrench: readings (n, 6), N and N m, sensor axes, pull sign; a NaN, as what stands for one becomes, is a sample
            that is there and says nothing.
        source: where it comes from, in words.
        load_mass: hung on the tool (n,), kg, where it was recorded.
        saturated: (n,), whether a channel of the sensor stood at its limit, where that was recorded.

    Raises:
        InputError: a wrong shape, a reading that no sensor gives; NaN and inf are none.
    """

    t: Array = field(metadata=column())
    wrench: Array = field(metadata=column(6))
    source: str = "arrays"
    load_mass: Array | None = field(default=None, metadata=column())
    saturated: NDArray[np.bool_] | None = field(default=None, metadata=column(kind=np.bool_))

    if TYPE_CHECKING:  # as of `Samples`

        def __init__(
            self,
            t: TimesLike,
            wrench: ArrayLike,
            source: str = "arrays",
            load_mass: ArrayLike | None = None,
            saturated: ArrayLike | None = None,
        ) -> None: ...

    def __post_init__(self) -> None:
        super().__post_init__()
        _require_within("wrench", np.where(np.isfinite(self.wrench), self.wrench, 0.0), READING)
        if (none := stands_for_none(self.wrench) | lost(self.wrench)[:, None]).any():
            object.__setattr__(self, "wrench", read_only(np.where(none, np.nan, self.wrench)))


@dataclass(frozen=True, eq=False)
class OrientationStream(Rows):
    """Where the arm was.

    Args:
        t: stamps (m,), s, in the order in which the orientations were recorded.
        R_base_flange: rotation matrices (m, 3, 3), from flange to base axes.
        position: of the flange (m, 3), m, base axes, where it is known.
        source: where it comes from, in words.

    Raises:
        InputError: a wrong shape, a matrix that is no rotation.
    """

    t: Array = field(metadata=column())
    R_base_flange: Array = field(metadata=column(3, 3))
    position: Array | None = field(default=None, metadata=column(3))
    source: str = "arrays"

    if TYPE_CHECKING:  # as of `Samples`

        def __init__(
            self, t: TimesLike, R_base_flange: ArrayLike, position: ArrayLike | None = None, source: str = "arrays"
        ) -> None: ...

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "R_base_flange", _rotations(self.R_base_flange))
        object.__setattr__(self, "position", _known(self.position))


@dataclass(frozen=True, eq=False)
class Streams(Frozen):
    """A recording as it is: what the sensor read, `wrench` (n), and where the arm was, `orientation` (m), each at
    its own times, s; `read_as` and `damage` as in `Samples`.
    """

    wrench: WrenchStream
    orientation: OrientationStream
    read_as: ReadAs = field(default_factory=dict)
    damage: str = ""

    @classmethod
    def concatenate(cls, parts: Sequence[Streams]) -> Streams:
        """All rows, part after part."""
        return cls(
            WrenchStream.concatenate([part.wrench for part in parts]),
            OrientationStream.concatenate([part.orientation for part in parts]),
            parts[0].read_as,
            parts[-1].damage,
        )


def stands_for_none(written: Array, least: float = CODES[1]) -> NDArray[np.bool_]:
    """Which of the numbers (n, k) stand for no reading: nines alone, of either sign, `least` or more (of a few rows
    999 N may be a reading), far beyond all other numbers of the column, and in fewer than half of its rows.
    """
    if not (large := np.abs(written) >= least - 0.5).any():
        return np.asarray(large)
    with np.errstate(over="ignore"):
        size = np.minimum(np.abs(written), 10.0 * CODES[-1])
    is_code = np.isin(np.rint(size), CODES) & (np.abs(size - np.rint(size)) < 1e-6)
    largest = np.max(np.where(is_code | np.isnan(size), 0.0, size), axis=0)
    return np.asarray(is_code & large & (size > CODE_BEYOND * largest) & (is_code.mean(axis=0) < 0.5))


def lost(wrench: Array) -> NDArray[np.bool_]:
    """Which readings (n, 6), one after the other, are packets that did not come: a few rows of zeros alone here and
    there, where no other row has three of them.
    """
    count = np.sum(wrench == 0.0, axis=1)
    zeros: NDArray[np.bool_] = count == 6
    some = zeros.sum() >= (FEWEST_LOST if len(wrench) <= AS_POSES else 1)
    if not some or zeros.mean() >= 0.5 or ((count > 2) & (count < 6)).any():
        return np.zeros_like(zeros)
    begins = np.flatnonzero(np.diff(zeros, prepend=False, append=False)).reshape(-1, 2)
    for first, end in begins[np.diff(begins)[:, 0] > MOST_LOST]:
        zeros[first:end] = False
    return zeros


def _rotations(R: Array) -> Array:
    """The rotations nearest to (n, 3, 3) matrices, read-only: the matrices themselves where they are exact."""
    nearest = nearest_rotations(R) if len(R) else R
    return R if nearest is R else read_only(nearest)


def _known(position: Array | None) -> Array | None:
    """Positions (n, 3), read-only: a NaN wherever a coordinate is no place that an arm reaches; nobody needs them."""
    if position is None or not len(PLACE.outside(position)):
        return position
    return read_only(np.where(PLACE.holds(position), position, np.nan))


def _require_within(name: str, values: Array | None, within: Range) -> None:
    if values is not None and len(beyond := within.outside(values)):
        row = int(np.argwhere(~within.holds(values))[0][0])
        raise InputError(f"{name} in sample {row} is {beyond[0]:g}, expected {within}: leave such samples out", row)
