"""Named columns of numbers in a text file.

The numbers are parsed by numpy, a block of lines at a time. Only where that fails is the block walked row by row, to
say which row and column is wrong; rows are counted as an editor counts lines, the header included.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain, compress
from math import inf
from pathlib import Path
from typing import NoReturn, Self

import numpy as np
from numpy.typing import NDArray

from ...errors import FileFormatError
from ...files import name_of
from ...geometry.arrays import Array
from ...statistics import counted
from .columns import AS_NAMED, FLAW, SATURATED, WRENCH_COLUMNS, Body, Column, Naming, OpenTable, places_of, shown
from .layout import Layout, is_row, layout_of, refuse_units_above
from .text_cells import PERHAPS_DOTTED, LinesFrom, blocks_of_lines, cells, no_number, seconds_of_date, split, value

SUFFIXES = (".csv", ".tsv", ".txt", ".dat", ".log", ".lvm", "")

LACKING = r"--?|#?n/?a|null|none|<na>|-?nan\((?:ind|snan)\)|-?1\.#(?:qnan|ind)\d*"
"""What stands for no number, in any case, beside nothing and nan: of pandas' `na_values`, and of printf on Windows."""
BOOLEANS = {"true": 1.0, "false": 0.0}
POINT_FOR_COMMA = str.maketrans(",.", ".\0")
"""Of rows with decimal commas; a point among them is made what no number has."""

FIRST_ROWS, LONGEST_HEAD = 100, 100_000
"""The layout is judged by at least so many rows, where there are as many in so many lines."""


def open_csv(path: str | Path, rows: int, naming: Naming = AS_NAMED) -> OpenTable:
    """A text file, `rows` lines at a time. Raises `FileAccessError`, and `FileFormatError` for what is no text, or has
    no header and no column that `naming` tells by its number.
    """
    source = name_of(path)
    blocks = blocks_of_lines(path, rows)
    first: list[LinesFrom] = []
    lines: list[str] = []
    for block in blocks:
        first.append(block)
        lines += block[1]
        if len(lines) > LONGEST_HEAD or sum(map(is_row, lines)) >= FIRST_ROWS:
            break
    found = layout_of(lines, source)
    if found is None:
        said = "found comments only" if any(line.strip() for line in lines) else "the file is empty"
        said = f"found no row in {len(lines)} lines" if len(lines) > LONGEST_HEAD else said
        raise FileFormatError(f"{source}: {said}, expected a header line and rows of numbers")
    header_row, layout = found
    if layout.unnamed and not naming.wrench_columns and "," not in (naming.orientation or ""):
        raise FileFormatError(
            f"{source}: row {layout.unnamed}: found numbers, expected a header with the columns' names: write one, or "
            f"tell the {len(layout.names)} columns by number, as --wrench-columns 1,2,3,4,5,6 --orientation "
            "quat_xyzw:7,8,9,10"
        )
    if layout.unnamed and naming.units is None:
        refuse_units_above(lines, layout.unnamed, source)
    bodies = _bodies(chain(first, blocks), header_row, layout, source)
    return OpenTable(source, places_of(layout.names, source), lambda _: bodies)


def _bodies(blocks: Iterator[LinesFrom], header_row: int, layout: Layout, source: str) -> Iterator[Lines]:
    """The blocks of lines below the header that have rows, or one without any; of a live session that was ended from
    outside, less the row that it was writing (doubts.py tells).
    """
    any_rows, apart = False, replace(layout, separator="\t") if layout.separator == " " else layout
    following = next(blocks, None)
    while following is not None:
        (first_row, every, done), following = following, next(blocks, None)
        if not following and layout.names[-1] == FLAW and every[-1].count(layout.separator) < len(layout.names) - 1:
            every.pop()
        while not following and len(every) > 1 and not every[-1].strip(f"{layout.separator} "):  # Excel's last rows
            every.pop()
        rows = [row for row, line in enumerate(every, start=first_row) if row > header_row and is_row(line)]
        lines = [every[row - first_row] for row in rows]
        if layout.separator == " ":
            lines = ["\t".join(line.split()) for line in lines]
        any_rows = any_rows or bool(rows)
        if rows or not (any_rows or following):
            yield Lines(np.array(rows, dtype=np.intp), source, done, lines, apart)


@dataclass(eq=False)
class Lines(Body):
    """Rows of a text file, by the lines that hold them and the numbers of these."""

    lines: list[str]
    layout: Layout

    def select(self, kept: NDArray[np.bool_]) -> Self:
        """As of `Body`."""
        return replace(self, rows=self.rows[kept], lines=list(compress(self.lines, kept.tolist())))

    def refuse_lack(self, index: int, column: Column) -> NoReturn:
        """Raise the `FileFormatError` for a cell that is empty, or NaN."""
        row = self.row_of(index)
        raise self._lack(cells(self.lines[index], self.layout.separator, row, self.source)[column.place], column, row)

    def numbers(self, columns: Sequence[Column], may_lack: Collection[Column] = ()) -> Array:
        """As of `Body`."""
        if not self.lines:
            raise FileFormatError(
                f"{self.source}: found a header and no rows, expected a row for each reading: add them"
            )
        values = self._parsed(columns, bool(may_lack))
        if values is not None:
            lacking = [column in may_lack for column in columns]
            fine = np.isfinite(values)
            if fine.all() or (fine | (np.isnan(values) & lacking)).all():
                of_wrench = [column for column in columns if column.role in WRENCH_COLUMNS]
                if _may_be_thousands(values[:, [column in of_wrench for column in columns]]):
                    self._refuse_thousands(of_wrench)
                return values
        rows = zip(self.rows.tolist(), self.lines, strict=True)
        return np.array([self._row(row, line, columns, may_lack) for row, line in rows], dtype=np.float64)

    def _refuse_thousands(self, columns: Sequence[Column]) -> None:
        """Raise `FileFormatError` where every number with a decimal mark has three decimals, as thousands have."""
        mark = self.layout.decimal
        rows = zip(self.rows.tolist(), self.lines, strict=True)
        of_each = [(row, cells(line, self.layout.separator, row, self.source)) for row, line in rows]
        found = [(row, column, of_row[column.place]) for row, of_row in of_each for column in columns]
        marked = [(row, column, cell) for row, column, cell in found if mark in cell]
        whole = any(mark not in cell and cell.strip("+-0") for *_, cell in found)
        if whole and all(PERHAPS_DOTTED.fullmatch(cell) for *_, cell in marked):
            row, column, cell = marked[0]
            raise FileFormatError(
                f"{self.source}: row {row}, column {column.name}: found {cell!r} beside whole numbers, which may be "
                "thousands or a number with decimals, expected digits and decimals in all rows: write them so"
            )

    def _parsed(self, columns: Sequence[Column], gaps: bool) -> Array | None:
        """The numbers by numpy, NaN in gaps; None where it cannot tell, or a row has other than `width` cells."""
        whole = {line.count(self.layout.separator) for line in self.lines} == {len(self.layout.names) - 1}
        if any('"' in line for line in self.lines) or not whole:
            whole = all(map(self._is_whole, self.lines))
        values = self._loaded(self.lines, columns) if whole else None
        return self._loaded(self._filled(), columns) if whole and gaps and values is None else values

    def _loaded(self, lines: list[str], columns: Sequence[Column]) -> Array | None:
        try:
            values: Array = np.loadtxt(
                lines if self.layout.decimal == "." else [line.translate(POINT_FOR_COMMA) for line in lines],
                delimiter=self.layout.separator,
                usecols=[column.place for column in columns],
                converters={column.place: partial(_date, column) for column in columns if self._has_dates(column)},
                ndmin=2,
                comments=None,
                quotechar='"',
                dtype=np.float64,
                encoding=None,
            )
        except ValueError:
            return None
        return values if len(values) == len(lines) else None

    def _has_dates(self, column: Column) -> bool:
        """Whether a column of times is written as dates: in the first row, and so in all."""
        try:
            cell = split(self.lines[0], self.layout.separator)[column.place] if column.role == "t" else ""
            return seconds_of_date(cell) < inf
        except (ValueError, IndexError):
            return False

    def _filled(self) -> list[str]:
        """The rows with nan in cells that lack a number."""
        d = self.layout.separator
        lacking = re.compile(rf"([{d}\n])(?:{LACKING})?(?=[{d}\n])", re.IGNORECASE)
        return lacking.sub(r"\1nan", "\n".join(["", *self.lines, ""])).split("\n")[1:-1]

    def _is_whole(self, line: str) -> bool:
        """Whether a row has as many cells as the header; a quoted cell may hold the delimiter."""
        separator, width = self.layout.separator, len(self.layout.names)
        return (len(split(line, separator)) if '"' in line else line.count(separator) + 1) == width

    def _row(self, row: int, line: str, columns: Sequence[Column], may_lack: Collection[Column]) -> list[float]:
        """The numbers of one row, slowly: the first thing that is wrong is named. Raises `FileFormatError`."""
        separator, width = self.layout.separator, len(self.layout.names)
        found = cells(line, separator, row, self.source)
        if len(found) == width:
            return [self._number(found[column.place], column, row, column in may_lack) for column in columns]
        if separator == "," and 2 * len(found) >= 3 * width:
            raise FileFormatError(
                f"{self.source}: row {row}, from column {shown(self.layout.names[0])} on: found "
                f"{counted(len(found), 'value')} between commas, expected {self.layout.width}: if these are decimal "
                "commas, write them as points, or separate the cells by semicolons"
            )
        raise FileFormatError(
            f"{self.source}: row {row}: found {counted(len(found), 'value')}, expected {self.layout.width}: complete "
            "the row, and write decimals with a point"
        )

    def _number(self, cell: str, column: Column, row: int, may_lack: bool) -> float:
        if column.role == SATURATED and cell.lower() in BOOLEANS:
            return BOOLEANS[cell.lower()]
        comma = self.layout.decimal == ","
        try:
            lacks = not cell or (may_lack and re.fullmatch(LACKING, cell, re.IGNORECASE))
            read = partial(_date, column) if self._has_dates(column) else value
            number = np.nan if lacks else read(cell.translate(POINT_FOR_COMMA) if comma else cell)
        except ValueError:
            where = f"{self.source}: row {row}, column {column.name}"
            wrong = no_number(cell, column.name, comma=comma, of_times=column.role == "t")
            raise FileFormatError(f"{where}: {wrong}") from None
        if not (np.isfinite(number) or (may_lack and np.isnan(number))):
            raise self._lack(cell, column, row)
        return number

    def _lack(self, cell: str, column: Column, row: int) -> FileFormatError:
        where = f"{self.source}: row {row}, column {column.name}"
        if not cell:
            return FileFormatError(f"{where}: found nothing, expected a number: fill it in or leave the row out")
        return FileFormatError(f"{where}: found {cell[:40]}, expected a finite number: leave the row out")


def _date(column: Column, cell: str) -> float:
    """A date in the unit of its column; the point of its seconds may be that of a file with decimal commas."""
    return np.nan if cell == "nan" else seconds_of_date(cell.replace("\0", ".")) * column.per_si


def _may_be_thousands(values: Array) -> bool:
    """Whether numbers (n, k), as written, may be whole ones of which those from 1000 on have a point: such as have
    decimals have three at most and are 1 at least, and others are whole and below 1000.
    """
    size = np.abs(values[np.isfinite(values)])
    whole = size == np.round(size)
    if whole.all() or not (whole & (size > 0.0)).any() or (size >= 1000.0).any():
        return False
    return bool((size[~whole] >= 1.0).all() and np.allclose(1e3 * size, np.round(1e3 * size), rtol=0.0, atol=1e-6))
