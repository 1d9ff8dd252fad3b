"""Tables of readings and orientations as CSV: columns found by name, units by suffix (design: section 6).

What a column means is decided here; how a table of named columns is read, in table.py.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain
from pathlib import Path

import numpy as np

from ..contact import ContactWrenches
from ..errors import FileFormatError, InputError
from ..files import write_text
from ..orientation import CONVENTIONS, RECOGNISED_BY_NAME, Array, Convention, convention
from ..samples import LARGEST_READING
from .table import Body, Column, find, listed, numbers, opened, optional, require, required, shown

FORCE = {"": 1.0, "n": 1.0}
TORQUE = {"": 1.0, "nm": 1.0, "nmm": 1e3}
TIME = {"": 1.0, "s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}
LENGTH = {"": 1.0, "m": 1.0, "mm": 1e3}
LOAD = {"g": 1e3, "kg": 1.0}
NO_UNIT = {"": 1.0}
ANGLE = {"deg": 180.0 / np.pi, "rad": 1.0}
"""These say how many of a unit make one of SI: a division rounds once, so that 300 ms are 0.3 s to the last digit."""

WRENCH_COLUMNS = ("fx", "fy", "fz", "tx", "ty", "tz")


@dataclass(frozen=True, eq=False)
class Table:
    """What a CSV holds, as its writer meant it: SI units, the file's own sign, frame and direction of rotation."""

    wrench: Array
    orientation: Array
    t: Array | None
    position: Array | None
    load_mass: Array | None


@dataclass(frozen=True, eq=False)
class WrittenOrientation:
    """Columns that hold an orientation, by their names in the file, and their numbers (n, k) as they are written."""

    columns: tuple[str, ...]
    numbers: Array


@dataclass(frozen=True, eq=False)
class AsWritten:
    """What a CSV holds before anything is made of its orientation.

    `wrench` (n, 6) N and N m under `wrench_columns`. `convention`: the one that was asked for or that the names tell,
    which makes the rotations `stated` (n, 3, 3) of the one in `orientations`. Where it cannot, `stated` is None; where
    the names do not tell, `convention` is None too, and `orientations` are all sets of columns that could be one;
    `complaint` then says why. `load_mass` as in `Table`.
    """

    wrench: Array
    wrench_columns: tuple[str, ...]
    orientations: tuple[WrittenOrientation, ...]
    convention: Convention | None
    stated: Array | None
    complaint: str | None
    load_mass: Array | None


def read_csv(path: str | Path, orientation: str = "auto") -> Table:
    """Read a table. Raises `FileAccessError`, and `FileFormatError` naming the file, the row and the column."""
    places, body = opened(path)
    source = body.source
    wrench_columns = _wrench_columns(places, source)
    chosen, orientation_columns = _orientation_columns(places, orientation, source)
    taken = {column.place for column in orientation_columns}
    t = optional(places, ["t"], TIME, taken, source)
    position = optional(places, ["x", "y", "z"], LENGTH, taken, source)
    load = _load_column(places, taken, source)

    columns = [*wrench_columns, *orientation_columns, *t, *position, *load]
    values = numbers(body, columns) / np.array([column.per_si for column in columns])
    wrench, angles, *rest = np.split(
        values, np.cumsum([6, len(orientation_columns), len(t), len(position)]).tolist(), axis=1
    )
    R = _rotations(chosen, orientation_columns, angles, body)
    t_values, position_values, load_values = (block if block.shape[1] else None for block in rest)
    _require_wrench_and_load(wrench, wrench_columns, load_values, load, body)
    return Table(
        wrench,
        R,
        None if t_values is None else t_values[:, 0],
        position_values,
        None if load_values is None else load_values[:, 0],
    )


def orientations(places: dict[str, int], body: Body, orientation: str) -> tuple[Array, set[int]]:
    """Rotations (n, 3, 3) of a table that need not hold readings, and the places of the columns that they are from.

    Raises `FileFormatError` naming the file, the row and the column.
    """
    chosen, columns = _orientation_columns(places, orientation, body.source)
    values = numbers(body, columns) / np.array([column.per_si for column in columns])
    return _rotations(chosen, columns, values, body), {column.place for column in columns}


def read_as_written(path: str | Path, orientation: str = "auto") -> AsWritten:
    """Read a table without making rotations of its orientation. Raises as `read_csv`, but for numbers that are no
    rotation, and where `auto` cannot choose between columns that all could be one.
    """
    places, body = opened(path)
    source = body.source
    wrench_columns = _wrench_columns(places, source)
    convention, complaint, stated = None, None, None
    try:
        convention, told = _orientation_columns(places, orientation, source)
        sets = [told]
    except FileFormatError as error:
        complaint = str(error)
        sets = _whole_sets(places, source) if orientation == "auto" else []
        if not sets:
            raise
    load = _load_column(places, {column.place for columns in sets for column in columns}, source)
    columns = [*wrench_columns, *load, *(column for one in sets for column in one)]
    written = numbers(body, columns)
    in_si = written / np.array([column.per_si for column in columns])
    first, *ends = np.cumsum([6 + len(load), *map(len, sets)]).tolist()
    wrench, load_values = in_si[:, :6], in_si[:, 6:first]
    _require_wrench_and_load(wrench, wrench_columns, load_values if load else None, load, body)
    if convention is not None:
        try:
            stated = _rotations(convention, sets[0], in_si[:, first:], body)
        except FileFormatError as error:
            complaint = str(error)
    orientations = (
        WrittenOrientation(tuple(column.name for column in one), written[:, end - len(one) : end])
        for one, end in zip(sets, ends, strict=True)
    )
    return AsWritten(
        wrench,
        tuple(column.name for column in wrench_columns),
        tuple(orientations),
        convention,
        stated,
        complaint,
        load_values[:, 0] if load else None,
    )


def _rotations(convention: Convention, columns: list[Column], values: Array, body: Body) -> Array:
    """Rotations (n, 3, 3) of `values` (n, k) in SI. Raises `FileFormatError` naming row and columns of what is none."""
    try:
        return convention.to_matrices(values)
    except InputError as error:
        names = ",".join(column.name for column in columns)
        where = "" if error.row is None else f"row {body.row_of(error.row)}, "
        found = str(error).replace(f"orientation {error.row} is", "found", 1)
        raise FileFormatError(f"{body.source}: {where}columns {names}: {found}") from None


def _wrench_columns(places: dict[str, int], source: str) -> list[Column]:
    return [required(places, name, TORQUE if name[0] == "t" else FORCE, source) for name in WRENCH_COLUMNS]


def _load_column(places: dict[str, int], taken: set[int], source: str) -> list[Column]:
    if "load" in places:
        raise FileFormatError(f"{source}: column load has no unit, expected load_g or load_kg: rename it")
    return optional(places, ["load"], LOAD, taken, source)


def _require_wrench_and_load(
    wrench: Array, wrench_columns: list[Column], load: Array | None, load_column: list[Column], body: Body
) -> None:
    require(np.abs(wrench) <= LARGEST_READING, wrench, wrench_columns, body, f"at most {LARGEST_READING:g} N or N m")
    if load is not None:
        require(load >= 0.0, load, load_column, body, "0 or more")


def _orientation_columns(places: dict[str, int], orientation: str, source: str) -> tuple[Convention, list[Column]]:
    if orientation != "auto":
        chosen = convention(orientation)
        columns = _columns_of(places, chosen, source)
        missing = [name for name, column in zip(chosen.columns, columns, strict=True) if column is None]
        if missing:
            wanted = ",".join(shown(name) for name in chosen.columns)
            raise FileFormatError(
                f"{source}: found no column {shown(missing[0])}, expected {wanted} for {chosen.name}: name "
                f"the columns, as in --orientation NAME:COLUMNS (found {listed(places)})"
            )
        return chosen, [column for column in columns if column is not None]
    candidates = {name: _columns_of(places, CONVENTIONS[name], source) for name in RECOGNISED_BY_NAME}
    whole = {name: [c for c in columns if c is not None] for name, columns in candidates.items() if None not in columns}
    if len(whole) == 1:
        name, complete = next(iter(whole.items()))
        return CONVENTIONS[name], complete
    if whole:
        raise FileFormatError(
            f"{source}: found the columns of {' and of '.join(whole)}, expected one orientation: choose with "
            f"--orientation {next(iter(whole))}"
        )
    for name, columns in candidates.items():
        if sum(column is not None for column in columns) > len(columns) / 2:
            missing = [want for want, c in zip(CONVENTIONS[name].columns, columns, strict=True) if c is None]
            raise FileFormatError(f"{source}: found no column {missing[0]}, expected all of {name}: add it")
    raise FileFormatError(
        f"{source}: found no orientation columns, expected qx qy qz qw, r11..r33, a b c (KUKA), w p r (FANUC) or rx ry "
        f"rz (UR): rename them, or say --orientation NAME:COLUMNS (found {listed(places)})"
    )


def _whole_sets(places: dict[str, int], source: str) -> list[list[Column]]:
    """Every set of columns that bears the names of a convention, each once."""
    sets: dict[tuple[str, ...], list[Column]] = {}
    for wanted in CONVENTIONS.values():
        columns = [column for column in _columns_of(places, wanted, source) if column is not None]
        if len(columns) == len(wanted.columns):
            sets.setdefault(tuple(sorted(column.name for column in columns)), columns)
    return list(sets.values())


def _columns_of(places: dict[str, int], wanted: Convention, source: str) -> list[Column | None]:
    if wanted.angle_unit is None:
        return [find(places, name, NO_UNIT, source) for name in wanted.columns]
    stated = {"": ANGLE[wanted.angle_unit], **ANGLE}
    columns = []
    for name in wanted.columns:
        unit = name.rpartition("_")[2]
        columns.append(find(places, name, {"": ANGLE[unit]} if unit in ANGLE else stated, source))
    return columns


def write_contact_wrenches(path: str | Path, contact: ContactWrenches) -> None:
    """Write one row per sample, in order: `t` where given, fx..tz the contact wrench, fx_std..tz_std; `-` is stdout."""
    names = [*WRENCH_COLUMNS, *(f"{name}_std" for name in WRENCH_COLUMNS)]
    columns = [contact.wrench, contact.std]
    formats = ["%.9g"] * 12
    if contact.t is not None:
        names, columns, formats = ["t", *names], [contact.t[:, None], *columns], ["%r", *formats]
    row = ",".join(formats)
    table = np.hstack(columns).tolist()
    write_text(path, chain([",".join(names) + "\n"], (row % tuple(values) + "\n" for values in table)))
