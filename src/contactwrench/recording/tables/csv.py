"""Named columns of numbers in a text file.

The numbers are parsed by numpy, a block of lines at a time. Only where that fails is the block walked row by row, to
say which row and column is wrong; rows are counted as an editor counts lines, the header included.
"""

from __future__ import annotations

import codecs
import csv
from collections.abc import Collection, Iterator, Sequence
from functools import partial
from itertools import chain
from pathlib import Path
from typing import NoReturn

import numpy as np

from ...errors import FileFormatError
from ...files import blocks_of_lines
from ...geometry.arrays import Array
from .columns import SATURATED, Column, OpenTable, places_of

SUFFIXES = (".csv", ".tsv", ".txt", ".dat", "")

BOOLEANS = {"true": 1.0, "false": 0.0}


def open_csv(path: str | Path, rows: int) -> OpenTable:
    """A text file, `rows` lines at a time. Raises `FileAccessError`, and `FileFormatError` for what is no text or has
    no header.
    """
    source = str(path)
    blocks = _blocks_of_text(path, source, rows)
    blank = True
    for first_row, text, done in blocks:
        lines = text.split("\n")
        header = _header(lines, first_row, source)
        blank = blank and not text.strip()
        if header is not None:
            row, delimiter, names = header
            first = (row + 1, "\n".join(lines[row - first_row + 1 :]), done)
            bodies = (Lines(*block, delimiter, len(names), source) for block in chain([first], blocks))
            return OpenTable(source, places_of(names, source), partial(_with_rows, bodies))
    if blank:
        raise FileFormatError(f"{source}: the file is empty, expected a header line and rows of numbers")
    raise FileFormatError(f"{source}: found comments only, expected a header line and rows of numbers")


def _blocks_of_text(path: str | Path, source: str, rows: int) -> Iterator[tuple[int, str, float]]:
    """The row at which a block of lines begins, its text, and the part of the file that ends with it."""
    row = 1
    for content, done in blocks_of_lines(path, rows):
        if row == 1 and (content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)) or b"\0" in content[:4096]):
            raise FileFormatError(
                f"{source}: found UTF-16 or binary content, expected CSV text in UTF-8: save it as that"
            )
        try:
            text = content.decode("utf-8-sig" if row == 1 else "utf-8")
        except UnicodeDecodeError as error:
            where = row + content.count(b"\n", 0, error.start)
            raise FileFormatError(
                f"{source}: row {where}: found a byte that is no UTF-8, expected UTF-8: save it as that"
            ) from None
        if "\r" in text:
            text = text.replace("\r\n", "\n").replace("\r", "\n")
        yield row, text, done
        row += text.count("\n")


def _header(lines: list[str], first_row: int, source: str) -> tuple[int, str, list[str]] | None:
    """Row number, delimiter and the names of the header line; None where there is none."""
    for row, line in enumerate(lines, start=first_row):
        if not _is_row(line) or line.lower().startswith("sep="):
            continue
        delimiter = max(",;\t", key=line.count)
        names = _cells(line, delimiter, row, source)
        if all(_is_number(name) for name in names):
            raise FileFormatError(f"{source}: row {row}: found numbers, expected a header with the columns' names")
        return row, delimiter, names
    return None


def _with_rows(blocks: Iterator[Lines], columns: Collection[Column]) -> Iterator[Lines]:
    """The blocks that have rows, or one without any, whatever the columns are of which numbers will be asked for."""
    empty, any_rows = None, False
    for block in blocks:
        if len(block):
            any_rows = True
            yield block
        else:
            empty = block
    if empty is not None and not any_rows:
        yield empty


class Lines:
    """Rows of a text file, by the lines that hold them. A `Body`."""

    def __init__(self, first_row: int, text: str, done: float, delimiter: str, width: int, source: str) -> None:
        self._all, self._first_row, self._delimiter, self._width = text.split("\n"), first_row, delimiter, width
        self._lines = [line for line in self._all if (start := line.lstrip()) and start[0] != "#"]
        self.source, self.done = source, done

    def __len__(self) -> int:
        return len(self._lines)

    def row_of(self, index: int) -> int:
        """The number of the line of the index-th row."""
        return next(row for k, (row, _) in enumerate(self._numbered()) if k == index)

    def refuse_lack(self, index: int, column: Column) -> NoReturn:
        """Raise the `FileFormatError` for a cell that is empty, or NaN."""
        row = self.row_of(index)
        cell = _cells(self._lines[index], self._delimiter, row, self.source)[column.place]
        raise self._lack(cell, column, row)

    def numbers(self, columns: Sequence[Column], may_lack: Collection[Column] = ()) -> Array:
        """The numbers (n, k) of the columns, as written; NaN where a cell of a column in `may_lack` is empty or NaN.

        Raises `FileFormatError` naming row and column of what is no finite number.
        """
        if not self._lines:
            raise FileFormatError(
                f"{self.source}: found a header and no rows, expected a row for each reading: add them"
            )
        values = self._parsed([column.place for column in columns], bool(may_lack))
        if values is not None:
            lacking = [column in may_lack for column in columns]
            fine = np.isfinite(values)
            if fine.all() or (fine | (np.isnan(values) & lacking)).all():
                return values
        return np.array([self._row(row, line, columns, may_lack) for row, line in self._numbered()], dtype=np.float64)

    def _parsed(self, places: list[int], gaps: bool) -> Array | None:
        """The numbers by numpy, NaN in gaps; None where it cannot tell, or a row has other than `width` cells."""
        whole = {line.count(self._delimiter) for line in self._lines} == {self._width - 1}
        if any('"' in line for line in self._lines) or not whole:
            whole = all(map(self._is_whole, self._lines))
        values = self._loaded(self._lines, places) if whole else None
        return self._loaded(self._filled(), places) if whole and gaps and values is None else values

    def _loaded(self, lines: list[str], places: list[int]) -> Array | None:
        try:
            values: Array = np.loadtxt(
                lines,
                delimiter=self._delimiter,
                usecols=places,
                ndmin=2,
                comments=None,
                quotechar='"',
                dtype=np.float64,
            )
        except ValueError:
            return None
        return values if len(values) == len(lines) else None

    def _filled(self) -> list[str]:
        """The rows with nan in cells that are empty."""
        d = self._delimiter
        text = "\n".join(["", *self._lines, ""])
        for _ in range(2):  # a match of one gap takes the delimiter in which the next would begin
            text = text.replace(d + d, f"{d}nan{d}")
        return text.replace(d + "\n", f"{d}nan\n").replace("\n" + d, f"\nnan{d}").split("\n")[1:-1]

    def _is_whole(self, line: str) -> bool:
        """Whether a row has as many cells as the header; a quoted cell may hold the delimiter."""
        if '"' not in line:
            return line.count(self._delimiter) == self._width - 1
        try:
            return len(next(csv.reader([line], delimiter=self._delimiter))) == self._width
        except csv.Error:
            return False

    def _numbered(self) -> Iterator[tuple[int, str]]:
        """Row number and text of every row of data."""
        return ((row, line) for row, line in enumerate(self._all, start=self._first_row) if _is_row(line))

    def _row(self, row: int, line: str, columns: Sequence[Column], may_lack: Collection[Column]) -> list[float]:
        """The numbers of one row, slowly: the first thing that is wrong is named. Raises `FileFormatError`."""
        cells = _cells(line, self._delimiter, row, self.source)
        if len(cells) != self._width:
            raise FileFormatError(
                f"{self.source}: row {row}: found {len(cells)} values, expected {self._width} as in the header: "
                "complete the row, and write decimals with a point"
            )
        return [self._number(cells[column.place], column, row, column in may_lack) for column in columns]

    def _number(self, cell: str, column: Column, row: int, may_lack: bool) -> float:
        where = f"{self.source}: row {row}, column {column.name}"
        if column.role == SATURATED and cell.lower() in BOOLEANS:
            return BOOLEANS[cell.lower()]
        try:
            value = _value(cell) if cell else np.nan
        except ValueError:
            if _is_number(cell.replace(",", ".")):
                raise FileFormatError(
                    f"{where}: found the decimal comma {cell!r}, expected a point: write it so"
                ) from None
            mend = "leave the times out with --time-column none" if column.role == "t" else "leave the row out"
            raise FileFormatError(f"{where}: found {cell[:40]!r}, expected a number: correct it or {mend}") from None
        if not (np.isfinite(value) or (may_lack and np.isnan(value))):
            raise self._lack(cell, column, row)
        return value

    def _lack(self, cell: str, column: Column, row: int) -> FileFormatError:
        where = f"{self.source}: row {row}, column {column.name}"
        if not cell:
            return FileFormatError(f"{where}: found nothing, expected a number: fill it in or leave the row out")
        return FileFormatError(f"{where}: found {cell}, expected a finite number: leave the row out")


def _is_row(line: str) -> bool:
    """Whether a line is neither blank nor a comment."""
    start = line.lstrip()
    return bool(start) and start[0] != "#"


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
