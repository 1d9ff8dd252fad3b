"""Ways to read a file: one of its orientation times one of its wrench, and what each of them takes.

They are made where files are read (recording/interpretations.py), and judged in diagnose.py.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..geometry.arrays import Array


@dataclass(frozen=True, eq=False)
class OrientationReading:
    """A way to read the orientation: `R_base_flange` (m, 3, 3), belonging to the file's readings in `rows` (m).

    `flags` make it so on the command line; `mends` is what else to change in the file, in words; `cost` is 0 for what
    was stated, about 1 for each change.
    """

    flags: tuple[str, ...]
    mends: tuple[str, ...]
    cost: float
    R_base_flange: Array
    rows: slice


@dataclass(frozen=True, eq=False)
class WrenchReading:
    """A way to read the wrench, but for its sign: `matrix` (6, 6) turns the file's columns into fx..tz, `in_base` axes
    or the sensor's; the rest as in `OrientationReading`.
    """

    flags: tuple[str, ...]
    mends: tuple[str, ...]
    cost: float
    matrix: Array
    in_base: bool


@dataclass(frozen=True)
class TorqueUnit:
    """Another unit of the torque, in the unit that was stated: only the centre of mass can tell."""

    factor: float
    mend: str
    cost: float


@dataclass(frozen=True, eq=False)
class Readings:
    """A file's readings (n, 6), N and N m as stated, and all ways to read them.

    `given` is the index of the stated one of `orientations`, None where it cannot be read (`complaint` says why); the
    stated one of `wrenches` is the first. `sign` pull or reaction, as stated; `gravity` direction (3,) in base axes, as
    stated, or None.
    """

    source: str
    wrench: Array
    orientations: tuple[OrientationReading, ...]
    wrenches: tuple[WrenchReading, ...]
    given: int | None
    sign: str
    gravity: Array | None
    torque_units: tuple[TorqueUnit, ...] = ()
    complaint: str | None = None


@dataclass(frozen=True)
class Reading:
    """One way to read a file: the `flags` that make it so, all of them, and the `mends` that no flag makes.

    `orientation`, `wrench` are indices into `Readings`; `negated`: the readings as they stand in the file;
    `reversed_gravity`: the stated direction; `torque_factor` turns the stated unit of the torque into N m. `cost`: of
    its changes from what was stated.
    """

    flags: tuple[str, ...]
    mends: tuple[str, ...]
    cost: float
    orientation: int
    wrench: int
    negated: bool
    reversed_gravity: bool
    torque_factor: float = 1.0


def as_read(readings: Readings, reading: Reading) -> tuple[Array, Array]:
    """`R_base_flange` (m, 3, 3) and the wrench (m, 6), N and N m, sensor axes, pull sign, that a reading makes."""
    o, w = readings.orientations[reading.orientation], readings.wrenches[reading.wrench]
    in_si = np.repeat([1.0, reading.torque_factor], 3)[:, None] * w.matrix
    R = o.R_base_flange
    return R, _read_wrench(readings.wrench[o.rows], -in_si if reading.negated else in_si, R if w.in_base else None)


def _read_wrench(wrench: Array, matrix: Array, R_base_flange: Array | None) -> Array:
    """The wrench (n, 6) in sensor axes, read by `matrix` (6, 6), which turns columns of the file into fx..tz; given
    in base axes where `R_base_flange` (n, 3, 3) is given, and then turned back.
    """
    read: Array = wrench @ matrix.T
    if R_base_flange is None:
        return read
    return np.concatenate([np.einsum("nij,ni->nj", R_base_flange, part) for part in (read[:, :3], read[:, 3:])], axis=1)
