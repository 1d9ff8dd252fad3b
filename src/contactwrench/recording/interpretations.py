"""Every interpretation of a file that a person could have meant: of its orientation, times those of its wrench.

One is made by options where there are options, by words about the file where there are none.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache
from itertools import permutations
from pathlib import Path
from typing import TypeAlias

import numpy as np

from ..assess.interpretations import (
    Interpretations,
    OrientationInterpretation,
    still_poses,
    torque_units,
    turned_and_shifted,
    wrench_interpretations,
)
from ..errors import FileFormatError, InputError
from ..geometry.arrays import Array
from ..geometry.orientation import CONVENTIONS, LONGEST_ROTATION_VECTOR, Convention, convention
from .options import AS_USUAL, Options
from .read import bag_blocks, name_of, reader_of
from .tables.columns import ANGLE, orientation_columns, roles_beside, whole_sets, wrench_columns
from .tables.table import open_table, rotations, written_rows

NAMED, GENERIC, UNIT = 1.0, 2.5, 1.0
"""What a change costs, in changes as likely as a wrong option (see assess/interpretations.py)."""

MOST_POSES = 300
"""Of a longer recording: a wrong interpretation shows in a few dozen poses."""

TURNED_AXES = tuple("".join(letters) for letters in permutations("XYZ")) + tuple(
    f"{a}{b}{a}" for a in "XYZ" for b in "XYZ" if a != b
)
FORMULAS_OF_ANGLES = (*TURNED_AXES, *(letters.lower() for letters in TURNED_AXES), "rotvec")
PROBE = np.array([[0.3, -0.5, 0.7]])
WHOLE = slice(None)

Candidates: TypeAlias = Iterator[OrientationInterpretation]


@dataclass(frozen=True, eq=False)
class _Written:
    """What a table holds before anything is made of its orientation.

    `wrench` (n, 6) N and N m. `sets` of columns that could be an orientation, by their names in the file, and their
    numbers (n, k) as they stand: one that was asked for or that the names tell, which `convention` makes the rotations
    `stated` (n, 3, 3) of; else all. `complaint`: why there is no convention, or no rotation. `load_mass` (n,) kg.
    """

    wrench: Array
    wrench_columns: tuple[str, ...]
    sets: tuple[tuple[tuple[str, ...], Array], ...]
    convention: Convention | None
    stated: Array | None
    complaint: str | None
    load_mass: Array | None


def interpretations(path: str | Path, options: Options = AS_USUAL, gravity: Array | None = None) -> Interpretations:
    """All interpretations of a file: of its orientation, times those of its wrench.

    Rows with a load or a saturated channel are left out; rows that follow each other at one orientation are averaged.

    Args:
        path: a table.
        options: the stated interpretation.
        gravity: (3,) the stated direction, base axes.

    Raises:
        FileAccessError: where the file cannot be read.
        FileFormatError: for a bag, and where columns are missing or hold no numbers, or all rows have a load.
        InputError: for options that are none.
    """
    if reader_of(path, options) is bag_blocks:
        raise FileFormatError(
            f"{path}: found a bag, expected a table: its messages say how an orientation is written, try --sign and "
            "--inverse-orientation"
        )
    written = _written(path, options.orientation)
    middle, wrench = still_poses(written.wrench, [numbers for _, numbers in written.sets], written.load_mass)
    if not len(middle):
        raise FileFormatError(f"{path}: found no contact-free samples, expected poses without a load")
    picked = np.unique(np.linspace(0, len(middle) - 1, min(len(middle), MOST_POSES)).astype(np.intp))
    stated_flags = () if options.orientation == "auto" else (f"--orientation {options.orientation}",)
    candidates = []
    if written.stated is not None:
        candidates.append(OrientationInterpretation(stated_flags, (), 0.0, written.stated[middle], WHOLE))
    for columns, numbers in written.sets:
        candidates += _candidates(columns, numbers[middle], written.convention)
    distinct: dict[bytes, OrientationInterpretation] = {}
    for one in sorted(turned_and_shifted(candidates, options.inverse_orientation, picked), key=lambda one: one.cost):
        distinct.setdefault(repr(one.rows).encode() + np.round(one.R_base_flange, 9).tobytes(), one)
    return Interpretations(
        name_of(path),
        wrench[picked],
        tuple(distinct.values()),
        tuple(wrench_interpretations(options.wrench_frame)),
        None if written.stated is None else 0,
        options.sign,
        gravity,
        torque_units(written.wrench_columns),
        written.complaint,
    )


def _written(path: str | Path, orientation: str) -> _Written:
    """Read a table without making rotations of its orientation, but for those that it states. Raises as `read`, but not
    for numbers that are no rotation, nor where `auto` cannot choose between columns that all could be one.

    Of a recording with times only rows that have a wrench and an orientation are kept, and none with a saturated
    channel.
    """
    table = open_table(path)
    of_wrench = wrench_columns(table)
    convention, complaint = None, None
    try:
        convention, angles = orientation_columns(table, orientation)
        sets = [angles]
    except FileFormatError as error:
        complaint = str(error)
        sets = whole_sets(table) if orientation == "auto" else []
        if not sets:
            raise
    as_they_stand = [replace(column, per_si=1.0) for columns in sets for column in columns]
    roles = replace(roles_beside(table, of_wrench, None, as_they_stand), t=())
    parts, stated = [], []
    for body in table.bodies(roles.columns):
        rows = written_rows(body, roles)
        kept = rows.has_wrench & rows.has_orientation & ~(rows.saturated == 1.0).any(axis=1)
        parts.append((rows.wrench[kept], rows.load[kept], rows.orientation[kept]))
        if convention is not None and complaint is None:
            in_si = parts[-1][2] / np.array([column.per_si for column in sets[0]])
            try:
                stated.append(rotations(convention, sets[0], in_si, body, kept))
            except FileFormatError as error:
                complaint = str(error)
    wrench, load, numbers = (np.concatenate(values) for values in zip(*parts, strict=True))
    of_sets = np.split(numbers, np.cumsum([len(columns) for columns in sets])[:-1].tolist(), axis=1)
    names = [tuple(column.name for column in columns) for columns in (of_wrench, *sets)]
    return _Written(
        wrench,
        names[0],
        tuple(zip(names[1:], of_sets, strict=True)),
        convention,
        np.concatenate(stated) if complaint is None else None,
        complaint,
        load[:, 0] if roles.load else None,
    )


def _candidate(
    flag: str, mends: tuple[str, ...], cost: float, to_matrices: Callable[[Array], Array], numbers: Array
) -> Candidates:
    """One, where the numbers make rotations."""
    try:
        R = to_matrices(numbers)
    except InputError:
        return
    yield OrientationInterpretation((f"--orientation {flag}",), mends, cost, R, WHOLE)


def _candidates(names: tuple[str, ...], numbers: Array, stated: Convention | None) -> Candidates:
    """Angles; quaternions with their scalar in any place that a mistake brings it to; matrices by rows or columns."""
    k = len(names)
    if k == 3:
        yield from _of_angles(names, numbers, stated)
        return
    as_they_stand = list(range(k))
    another = {4: [3, 0, 1, 2], 16: [4 * i + j for j in range(4) for i in range(4)]}.get(k, as_they_stand)
    for named in CONVENTIONS.values():
        for order in (as_they_stand, another) if len(named.columns) == k else ():
            columns = tuple(names[place] for place in order)
            yield from _candidate(_flag(named, columns), (), NAMED, named.to_matrices, numbers[:, order])


def _of_angles(columns: tuple[str, ...], numbers: Array, stated: Convention | None) -> Candidates:
    """Every Euler sequence about turned and about fixed axes, and the rotation vector, in degrees and in radians."""
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
            yield from _candidate(flag, (rename,) if must_rename else (), cost, to_matrices, angles)


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
