"""Tables of readings and orientations as CSV: columns found by name, units by suffix (design: section 6).

The numbers are parsed by numpy. Only where that fails is the table walked row by row, to say which row and column
is wrong; rows are counted as an editor counts lines, the header included.
"""

from __future__ import annotations

import codecs
import csv
from collections.abc import Iterator
from dataclasses import dataclass
from io import StringIO
from itertools import chain
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..contact import ContactWrenches
from ..errors import FileFormatError, InputError
from ..files import read_bytes, write_text
from ..orientation import CONVENTIONS, RECOGNISED_BY_NAME, Array, Convention, convention
from ..samples import LARGEST_READING

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


@dataclass(frozen=True)
class _Column:
    """A column by its place in the file, its name there, and how many of its unit make one of SI."""

    place: int
    name: str
    per_si: float


def read_csv(path: str | Path, orientation: str = "auto") -> Table:
    """Read a table. Raises `FileAccessError`, and `FileFormatError` naming the file, the row and the column."""
    source = str(path)
    text = _decoded(read_bytes(path), source)
    delimiter, header_row, header = _header(text, source)
    places = _places(header, source)
    wrench_columns = [_required(places, name, TORQUE if name[0] == "t" else FORCE, source) for name in WRENCH_COLUMNS]
    chosen, orientation_columns = _orientation_columns(places, orientation, source)
    taken = {column.place for column in orientation_columns}
    t = _optional(places, ["t"], TIME, taken, source)
    position = _optional(places, ["x", "y", "z"], LENGTH, taken, source)
    if "load" in places:
        raise FileFormatError(f"{source}: column load has no unit, expected load_g or load_kg: rename it")
    load = _optional(places, ["load"], LOAD, taken, source)

    columns = [*wrench_columns, *orientation_columns, *t, *position, *load]
    body = _Body(text, delimiter, header_row, len(header), source)
    values = _numbers(body, columns) / np.array([column.per_si for column in columns])
    wrench, angles, *rest = np.split(
        values, np.cumsum([6, len(orientation_columns), len(t), len(position)]).tolist(), axis=1
    )
    try:
        R = chosen.to_matrices(angles)
    except InputError as error:
        names = ",".join(column.name for column in orientation_columns)
        where = "" if error.row is None else f"row {body.row_of(error.row)}, "
        found = str(error).replace(f"orientation {error.row} is", "found", 1)
        raise FileFormatError(f"{source}: {where}columns {names}: {found}") from None
    t_values, position_values, load_values = (block if block.shape[1] else None for block in rest)
    _require(np.abs(wrench) <= LARGEST_READING, wrench, wrench_columns, body, f"at most {LARGEST_READING:g} N or N m")
    if load_values is not None:
        _require(load_values >= 0.0, load_values, load, body, "0 or more")
    return Table(
        wrench,
        R,
        None if t_values is None else t_values[:, 0],
        position_values,
        None if load_values is None else load_values[:, 0],
    )


def _require(good: NDArray[np.bool_], values: Array, columns: list[_Column], body: _Body, expected: str) -> None:
    """Raise `FileFormatError` naming the first of `values` (n, k), SI, that is not good, in its column's unit."""
    if not good.all():
        index, k = (int(place) for place in np.argwhere(~good)[0])
        column = columns[k]
        raise FileFormatError(
            f"{body.source}: row {body.row_of(index)}, column {column.name}: found "
            f"{values[index, k] * column.per_si:g}, expected {expected}: correct it or leave the row out"
        )


def _decoded(content: bytes, source: str) -> str:
    if not content.removeprefix(codecs.BOM_UTF8).strip():
        raise FileFormatError(f"{source}: the file is empty, expected a header line and rows of numbers")
    if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)) or b"\0" in content[:4096]:
        raise FileFormatError(f"{source}: found UTF-16 or binary content, expected CSV text in UTF-8: save it as that")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        row = content.count(b"\n", 0, error.start) + 1
        raise FileFormatError(
            f"{source}: row {row}: found a byte that is no UTF-8, expected UTF-8: save it as that"
        ) from None


def _header(text: str, source: str) -> tuple[str, int, list[str]]:
    """Delimiter, row number and the names of the header line, in small letters."""
    for row, line in enumerate(StringIO(text, newline=None), start=1):
        if not line.strip() or line.lstrip().startswith("#") or line.lower().startswith("sep="):
            continue
        delimiter = max(",;\t", key=line.count)
        names = [name.lower() for name in _cells(line, delimiter, row, source)]
        if all(_is_number(name) for name in names):
            raise FileFormatError(f"{source}: row {row}: found numbers, expected a header with the columns' names")
        return delimiter, row, names
    raise FileFormatError(f"{source}: found comments only, expected a header line and rows of numbers")


def _places(header: list[str], source: str) -> dict[str, int]:
    places: dict[str, int] = {}
    for place, name in enumerate(header):
        if name in places:
            raise FileFormatError(
                f"{source}: column {_shown(name)} is there twice, expected once: rename or remove one"
            )
        if name:
            places[name] = place
    return places


def _find(places: dict[str, int], name: str, units: dict[str, float], source: str) -> _Column | None:
    """The column `name` or `name_unit`; None where there is none."""
    spelled = {name if not unit else f"{name}_{unit}": per_si for unit, per_si in units.items()}
    found = [_Column(places[key], key, per_si) for key, per_si in spelled.items() if key in places]
    if len(found) > 1:
        names = " and ".join(column.name for column in found)
        raise FileFormatError(f"{source}: found columns {names}, expected one of them: remove the other")
    return found[0] if found else None


def _required(places: dict[str, int], name: str, units: dict[str, float], source: str) -> _Column:
    column = _find(places, name, units, source)
    if column is None:
        raise FileFormatError(
            f"{source}: found no column {name}, expected fx fy fz tx ty tz and an orientation: add it, or rename the "
            f"one that holds it (found {_listed(places)})"
        )
    return column


def _optional(
    places: dict[str, int], names: list[str], units: dict[str, float], taken: set[int], source: str
) -> list[_Column]:
    """The columns `names` if all are there and none is part of the orientation, else none."""
    found = [_find(places, name, units, source) for name in names]
    columns = [column for column in found if column is not None and column.place not in taken]
    return columns if len(columns) == len(names) else []


def _orientation_columns(places: dict[str, int], orientation: str, source: str) -> tuple[Convention, list[_Column]]:
    if orientation != "auto":
        chosen = convention(orientation)
        columns = _columns_of(places, chosen, source)
        missing = [name for name, column in zip(chosen.columns, columns, strict=True) if column is None]
        if missing:
            wanted = ",".join(_shown(name) for name in chosen.columns)
            raise FileFormatError(
                f"{source}: found no column {_shown(missing[0])}, expected {wanted} for {chosen.name}: name "
                f"the columns, as in --orientation NAME:COLUMNS (found {_listed(places)})"
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
        f"rz (UR): rename them, or say --orientation NAME:COLUMNS (found {_listed(places)})"
    )


def _columns_of(places: dict[str, int], wanted: Convention, source: str) -> list[_Column | None]:
    if wanted.angle_unit is None:
        return [_find(places, name, NO_UNIT, source) for name in wanted.columns]
    stated = {"": ANGLE[wanted.angle_unit], **ANGLE}
    columns = []
    for name in wanted.columns:
        unit = name.rpartition("_")[2]
        columns.append(_find(places, name, {"": ANGLE[unit]} if unit in ANGLE else stated, source))
    return columns


def _listed(places: dict[str, int]) -> str:
    names = [_shown(name) for name in places]
    return ", ".join(names[:20]) + (", ..." if len(names) > 20 else "")


def _shown(name: str) -> str:
    """A column's name as a message can show it: short, and without control characters."""
    return "".join(letter if letter.isprintable() else "?" for letter in name[:40])


def _cells(line: str, delimiter: str, row: int, source: str) -> list[str]:
    """The cells of one line, without the space around them."""
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter))]
    except csv.Error as error:
        raise FileFormatError(
            f"{source}: row {row}: found what is no CSV ({error}), expected cells of names and numbers: correct it"
        ) from None


def _value(text: str) -> float:
    """The number that `text` is. Raises `ValueError`, also for the underscores that Python allows in a number."""
    if "_" in text:
        raise ValueError(text)
    return float(text)


def _is_number(text: str) -> bool:
    try:
        _value(text)
    except ValueError:
        return False
    return True


class _Body:
    """The rows below the header."""

    def __init__(self, text: str, delimiter: str, header_row: int, width: int, source: str) -> None:
        self.text, self.delimiter, self.header_row, self.width, self.source = (
            text,
            delimiter,
            header_row,
            width,
            source,
        )

    def lines(self) -> Iterator[tuple[int, str]]:
        """Row number and text of every row of data."""
        for row, line in enumerate(StringIO(self.text, newline=None), start=1):
            if row > self.header_row and line.strip() and not line.lstrip().startswith("#"):
                yield row, line

    def is_whole(self, line: str) -> bool:
        """Whether a row has as many cells as the header; a quoted cell may hold the delimiter."""
        if '"' not in line:
            return line.count(self.delimiter) == self.width - 1
        try:
            return len(next(csv.reader([line], delimiter=self.delimiter))) == self.width
        except csv.Error:
            return False

    def row_of(self, index: int) -> int:
        """The row number of the index-th row of data."""
        return next(row for k, (row, _) in enumerate(self.lines()) if k == index)


def _numbers(body: _Body, columns: list[_Column]) -> Array:
    lines = [line for _, line in body.lines()]
    if not lines:
        raise FileFormatError(f"{body.source}: found a header and no rows, expected a row for each reading: add them")
    places = [column.place for column in columns]
    values: Array | None = None
    if all(body.is_whole(line) for line in lines):
        try:
            values = np.loadtxt(
                lines,
                delimiter=body.delimiter,
                usecols=places,
                ndmin=2,
                comments=None,
                quotechar='"',
                dtype=np.float64,
            )
        except ValueError:
            values = None
    if values is None or not np.isfinite(values).all() or len(values) != len(lines):
        return _numbers_row_by_row(body, columns)
    return values


def _numbers_row_by_row(body: _Body, columns: list[_Column]) -> Array:
    """The numbers once more, slowly: the first thing that is wrong is named. Raises `FileFormatError`."""
    values = []
    for row, line in body.lines():
        cells = _cells(line, body.delimiter, row, body.source)
        if len(cells) != body.width:
            raise FileFormatError(
                f"{body.source}: row {row}: found {len(cells)} values, expected {body.width} as in the header: "
                "complete the row, and write decimals with a point"
            )
        values.append([_number(cells[column.place], column, row, body) for column in columns])
    return np.array(values, dtype=np.float64)


def _number(cell: str, column: _Column, row: int, body: _Body) -> float:
    where = f"{body.source}: row {row}, column {column.name}"
    if not cell:
        raise FileFormatError(f"{where}: found nothing, expected a number: fill it in or leave the row out")
    try:
        value = _value(cell)
    except ValueError:
        if _is_number(cell.replace(",", ".")):
            raise FileFormatError(f"{where}: found the decimal comma {cell!r}, expected a point: write it so") from None
        raise FileFormatError(
            f"{where}: found {cell[:40]!r}, expected a number: correct it or leave the row out"
        ) from None
    if not np.isfinite(value):
        raise FileFormatError(f"{where}: found {cell}, expected a finite number: leave the row out")
    return value


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
