"""Every way in which a person could have meant a file: readings of its orientation, times readings of its wrench.

A reading is made by flags where there are flags, by words about the file where there are none.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from itertools import permutations
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..assess.interpretations import OrientationReading, Readings, TorqueUnit, WrenchReading
from ..errors import FileFormatError, InputError
from ..geometry.arrays import Array
from ..geometry.orientation import CONVENTIONS, LONGEST_ROTATION_VECTOR, Convention, convention
from .options import Layout, is_bag
from .tables.column_names import ANGLE
from .tables.table import AsWritten, WrittenOrientation, read_as_written

NAMED, GENERIC, UNIT, INVERSE, FRAME, TORQUE_UNIT = 1.0, 2.5, 1.0, 1.0, 1.0, 1.5
SHIFTED, BOTH_KINDS, ONE_KIND, TORQUE_REVERSED = 2.0, 2.0, 3.0, 2.5
"""What a change costs, in changes as likely as a wrong flag (see diagnose.py): the rarer the mistake, the more."""

MOST_ROWS = 20_000
MOST_STRETCHES = 300
"""A longer recording is thinned: a wrong reading shows in a few dozen poses."""

STILL = float(np.deg2rad(0.2))

TURNED_AXES = tuple("".join(letters) for letters in permutations("XYZ")) + tuple(
    f"{a}{b}{a}" for a in "XYZ" for b in "XYZ" if a != b
)
FORMULAS_OF_ANGLES = (*TURNED_AXES, *(letters.lower() for letters in TURNED_AXES), "rotvec")
PROBE = np.array([[0.3, -0.5, 0.7]])


@dataclass(frozen=True, eq=False)
class _Way:
    """A way to make rotations (n, 3, 3) of an orientation's numbers, and what it takes."""

    flags: tuple[str, ...]
    mends: tuple[str, ...]
    cost: float
    R: Array


def readings(
    path: str | Path,
    orientation: str = "auto",
    wrench_frame: str = "sensor",
    sign: str = "pull",
    *,
    inverse_orientation: bool = False,
    gravity: Array | None = None,
) -> Readings:
    """All readings of a file, the stated one among them; arguments as for `read`, `gravity` (3,) the stated direction.

    Rows with a load or a saturated channel are left out; rows that follow each other at one orientation are averaged.
    Raises `FileAccessError`, and `FileFormatError` where columns are missing or hold no numbers, or all rows have a
    load; `InputError` for arguments that are none.
    """
    if is_bag(path, Layout(orientation, wrench_frame, sign, inverse_orientation)):
        raise FileFormatError(
            f"{path}: found a bag, expected a table: its messages say how an orientation is written, try --sign and "
            "--inverse-orientation"
        )
    written = read_as_written(path, orientation)
    middle, wrench = _stretches(written)
    if not len(middle):
        raise FileFormatError(f"{path}: found no contact-free samples, expected poses without a load")
    picked = _spread(len(middle))
    stated_flags = () if orientation == "auto" else (f"--orientation {orientation}",)
    ways = [] if written.stated is None else [_Way(stated_flags, (), 0.0, written.stated[middle])]
    for one in written.orientations:
        ways += _ways(WrittenOrientation(one.columns, one.numbers[middle]), written.convention)
    seen: set[bytes] = set()
    of_orientation = []
    for reading in sorted(_turned_and_shifted(ways, inverse_orientation, picked), key=lambda reading: reading.cost):
        key = repr(reading.rows).encode() + np.round(reading.R_base_flange, 9).tobytes()
        if key not in seen:
            seen.add(key)
            of_orientation.append(reading)
    return Readings(
        os.fsencode(path).decode(errors="replace"),
        wrench[picked],
        tuple(of_orientation),
        tuple(_wrench_readings(wrench_frame)),
        None if written.stated is None else 0,
        sign,
        gravity,
        _torque_units(written.wrench_columns),
        written.complaint,
    )


def _stretches(written: AsWritten) -> tuple[NDArray[np.intp], Array]:
    """The middle row (m,) of every stretch of rows at one orientation, free of a load, and its mean wrench (m, 6)."""
    free = np.arange(len(written.wrench))
    if written.load_mass is not None:
        free = free[written.load_mass == 0.0]
    free = free[:: 1 + len(free) // MOST_ROWS]
    blocks = [one.numbers[free] for one in written.orientations]
    in_deg = [one.shape[1] == 3 and np.abs(one).max(initial=0.0) > LONGEST_ROTATION_VECTOR for one in blocks]
    rows = np.hstack([np.rad2deg(1.0) ** -float(deg) * one for one, deg in zip(blocks, in_deg, strict=True)]).tolist()
    starts: list[int] = []
    for k, row in enumerate(rows):
        if not starts or any(abs(a - b) > STILL for a, b in zip(row, rows[starts[-1]], strict=True)):
            starts.append(k)
    ends = [*starts[1:], len(rows)]
    means = [written.wrench[free[a:b]].mean(axis=0) for a, b in zip(starts, ends, strict=False)]
    middle = free[np.array([(a + b) // 2 for a, b in zip(starts, ends, strict=False)], dtype=np.intp)]
    return middle, np.array(means).reshape(-1, 6)


def _spread(n: int) -> NDArray[np.intp]:
    """All of n stretches, or as many as are wanted, spread evenly."""
    return np.unique(np.linspace(0, n - 1, min(n, MOST_STRETCHES)).astype(np.intp))


def _turned_and_shifted(ways: list[_Way], inverse: bool, picked: NDArray[np.intp]) -> Iterator[OrientationReading]:
    for way in ways:
        for is_inverse in (inverse, not inverse):
            R = way.R.transpose(0, 2, 1) if is_inverse else way.R
            flags = (*way.flags, *(["--inverse-orientation"] if is_inverse else []))
            cost = way.cost + INVERSE * (is_inverse != inverse)
            for shift, mends in _SHIFTS.items():
                there = (picked >= shift) & (picked - shift < len(R))
                rows = slice(int(np.argmax(there)), int(np.argmax(there)) + int(there.sum()))
                own = R[picked[there] - shift]
                yield OrientationReading(flags, (*way.mends, *mends), cost + SHIFTED * bool(shift), own, rows)


_SHIFTS: dict[int, tuple[str, ...]] = {
    0: (),
    1: ("each orientation belonging to the next row's wrench",),
    -1: ("each orientation belonging to the previous row's wrench",),
}


def _ways(written: WrittenOrientation, stated: Convention | None) -> Iterator[_Way]:
    """Every convention that takes so many columns, where it makes rotations."""
    k = len(written.columns)
    made = _of_angles(written, stated) if k == 3 else _of_parts(written)
    for flag, mends, cost, to_matrices, numbers in made:
        try:
            R = to_matrices(numbers)
        except InputError:
            continue
        yield _Way((f"--orientation {flag}",), mends, cost, R)


_Made = tuple[str, tuple[str, ...], float, Callable[[Array], Array], Array]


def _of_parts(written: WrittenOrientation) -> Iterator[_Made]:
    """Quaternions with their scalar in any place that a mistake brings it to; matrices by rows or by columns."""
    k = len(written.columns)
    as_they_stand = list(range(k))
    another = {4: [3, 0, 1, 2], 16: [4 * i + j for j in range(4) for i in range(4)]}.get(k, as_they_stand)
    for named in CONVENTIONS.values():
        for order in (as_they_stand, another) if len(named.columns) == k else ():
            columns = tuple(written.columns[place] for place in order)
            yield _flag(named, columns), (), NAMED, named.to_matrices, written.numbers[:, order]


def _of_angles(written: WrittenOrientation, stated: Convention | None) -> Iterator[_Made]:
    """Every Euler sequence about turned and about fixed axes, and the rotation vector, in degrees and in radians."""
    columns, numbers = written.columns, written.numbers
    suffixes = [name.rpartition("_")[2] if name.rpartition("_")[2] in ANGLE else "" for name in columns]
    said = suffixes[0] if len(set(suffixes)) == 1 else ""
    for unit in ANGLE:
        scale = np.array([ANGLE[suffix if suffix and not said else unit] for suffix in suffixes])
        angles = numbers / scale
        if np.abs(angles).max(initial=0.0) > LONGEST_ROTATION_VECTOR and unit == "rad":
            continue
        renamed = tuple(f"{name.removesuffix(f'_{said}') if said else name}_{unit}" for name in columns)
        rename = f"the angles in {unit} (rename {', '.join(columns)} to {', '.join(renamed)})"
        for letters in FORMULAS_OF_ANGLES:
            to_matrices = _to_matrices(letters)
            named = list(_named(letters))
            same = stated is not None and bool(np.allclose(stated.to_matrices(PROBE), to_matrices(PROBE)))
            fitting = [c for c in named if said or c.angle_unit == unit]
            usual = said or (stated.angle_unit if same and stated else named[0].angle_unit if named else unit)
            cost = (0.0 if same else NAMED if named else GENERIC) + UNIT * (unit != usual)
            must_rename = (bool(said) and unit != said) or (not fitting and letters == "rotvec")
            names = renamed if must_rename else columns
            if must_rename and named:
                fitting = named
            best = min(fitting, key=lambda c: c.columns != _bare(names), default=None)
            flag = _flag(best, names) if best else f"euler:{letters}:{unit}:{','.join(names)}"
            yield flag, (rename,) if must_rename else (), cost, to_matrices, angles


@cache
def _to_matrices(letters: str) -> Callable[[Array], Array]:
    return (
        CONVENTIONS["ur_rotvec"].to_matrices if letters == "rotvec" else convention(f"euler:{letters}:rad").to_matrices
    )


@cache
def _named(letters: str) -> tuple[Convention, ...]:
    """The conventions that have a name and are this formula."""
    R = _to_matrices(letters)(PROBE)
    of_angles = (c for c in CONVENTIONS.values() if len(c.columns) == 3)
    return tuple(c for c in of_angles if np.allclose(c.to_matrices(PROBE), R))


def _bare(columns: tuple[str, ...]) -> tuple[str, ...]:
    """The columns' names without the unit of an angle."""
    return tuple(name.rpartition("_")[0] if name.rpartition("_")[2] in ANGLE else name for name in columns)


def _flag(named: Convention, columns: tuple[str, ...]) -> str:
    """What --orientation takes for a convention of these columns: its name alone where they bear its names."""
    return named.name if _bare(columns) == named.columns else f"{named.name}:{','.join(columns)}"


def _wrench_readings(stated_frame: str) -> Iterator[WrenchReading]:
    """Every reading of the wrench but for its sign, the stated one first."""
    for frame in (stated_frame, "base" if stated_frame == "sensor" else "sensor"):
        flags = ("--wrench-frame base",) if frame == "base" else ()
        for mends, cost, matrix in _axes(frame):
            yield WrenchReading(flags, mends, cost + FRAME * (frame != stated_frame), matrix, frame == "base")


def _axes(frame: str) -> Iterator[tuple[tuple[str, ...], float, Array]]:
    """Axes exchanged, reversed or renamed: of force and torque alike, or of one of them."""
    same = np.eye(3)
    yield (), 0.0, _blocks(same, same)
    for words, R in _axis_changes():
        yield (words.format("fx", "fy", "fz"),), ONE_KIND, _blocks(R, same)
    for words, R in _axis_changes():
        force, torque = (words.format(*(kind + axis for axis in "xyz")) for kind in "ft")
        yield (torque,), ONE_KIND, _blocks(same, R)
        if frame == "base" or np.linalg.det(R) < 0.0:  # in the sensor's axes a rotation of all is another mounting
            yield (force, torque), BOTH_KINDS, _blocks(R, R)
    yield ("tx, ty and tz reversed",), TORQUE_REVERSED, _blocks(same, -same)
    yield ("force and torque exchanged",), BOTH_KINDS, np.roll(np.eye(6), 3, axis=0)


def _axis_changes() -> Iterator[tuple[str, Array]]:
    for i, j in ((0, 1), (1, 2), (2, 0)):
        order = [0, 1, 2]
        order[i], order[j] = j, i
        yield f"{{{i}}} and {{{j}}} exchanged", np.eye(3)[order]
    for i in range(3):
        yield f"{{{i}}} reversed", np.diag([-1.0 if k == i else 1.0 for k in range(3)])
    yield "{0}, {1}, {2} written as {2}, {0}, {1}", np.eye(3)[[1, 2, 0]]
    yield "{0}, {1}, {2} written as {1}, {2}, {0}", np.eye(3)[[2, 0, 1]]


def _blocks(of_force: Array, of_torque: Array) -> Array:
    matrix = np.zeros((6, 6))
    matrix[:3, :3], matrix[3:, 3:] = of_force, of_torque
    return matrix


def _torque_units(wrench_columns: tuple[str, ...]) -> tuple[TorqueUnit, ...]:
    """N mm where the file states N m, and the other way round."""
    in_nmm = wrench_columns[3].endswith("_nmm")
    factor, unit = (1e3, "N m") if in_nmm else (1e-3, "N mm")
    new = ", ".join(name if in_nmm else f"{name}_nmm" for name in ("tx", "ty", "tz"))
    mend = f"the torque in {unit} (rename {', '.join(wrench_columns[3:])} to {new})"
    return (TorqueUnit(factor, mend, TORQUE_UNIT),)
