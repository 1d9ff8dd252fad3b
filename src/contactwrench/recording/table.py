"""Named columns of numbers in a text file: found by name, units by suffix.

The numbers are parsed by numpy. Only where that fails is the table walked row by row, to say which row and column
is wrong; rows are counted as an editor counts lines, the header included.
"""

from __future__ import annotations

import codecs
import csv
from collections.abc import Iterator
from dataclasses import dataclass
from io import StringIO
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import FileFormatError
from ..files import read_bytes
from ..orientation import Array


@dataclass(frozen=True)
class Column:
    """A column by its place in the file, its name there, and how many of its unit make one of SI."""

    place: int
    name: str
    per_si: float


def opened(path: str | Path) -> tuple[dict[str, int], Body]:
    """The place of each column by its name, and the rows below the header."""
    source = str(path)
    text = _decoded(read_bytes(path), source)
    delimiter, header_row, header = _header(text, source)
    return _places(header, source), Body(text, delimiter, header_row, len(header), source)


def require(good: NDArray[np.bool_], values: Array, columns: list[Column], body: Body, expected: str) -> None:
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
            raise FileFormatError(f"{source}: column {shown(name)} is there twice, expected once: rename or remove one")
        if name:
            places[name] = place
    return places


def find(places: dict[str, int], name: str, units: dict[str, float], source: str) -> Column | None:
    """The column `name` or `name_unit`; None where there is none."""
    spelled = {name if not unit else f"{name}_{unit}": per_si for unit, per_si in units.items()}
    found = [Column(places[key], key, per_si) for key, per_si in spelled.items() if key in places]
    if len(found) > 1:
        names = " and ".join(column.name for column in found)
        raise FileFormatError(f"{source}: found columns {names}, expected one of them: remove the other")
    return found[0] if found else None


def required(places: dict[str, int], name: str, units: dict[str, float], source: str) -> Column:
    """The column `name` or `name_unit`. Raises `FileFormatError` where there is none."""
    column = find(places, name, units, source)
    if column is None:
        raise FileFormatError(
            f"{source}: found no column {name}, expected fx fy fz tx ty tz and an orientation: add it, or rename the "
            f"one that holds it (found {listed(places)})"
        )
    return column


def optional(
    places: dict[str, int], names: list[str], units: dict[str, float], taken: set[int], source: str
) -> list[Column]:
    """The columns `names` if all are there and none is part of the orientation, else none."""
    found = [find(places, name, units, source) for name in names]
    columns = [column for column in found if column is not None and column.place not in taken]
    return columns if len(columns) == len(names) else []


def listed(places: dict[str, int]) -> str:
    """The columns' names as a message can show them."""
    names = [shown(name) for name in places]
    return ", ".join(names[:20]) + (", ..." if len(names) > 20 else "")


def shown(name: str) -> str:
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


class Body:
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


def numbers(body: Body, columns: list[Column]) -> Array:
    """The numbers (n, k) of the columns, as written. Raises `FileFormatError` naming row and column of what is none."""
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


def _numbers_row_by_row(body: Body, columns: list[Column]) -> Array:
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


def _number(cell: str, column: Column, row: int, body: Body) -> float:
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
