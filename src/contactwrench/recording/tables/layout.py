"""How a text file writes its table, found from its first lines: header, separator, decimal mark, row of units.

Nothing is decided that the lines do not settle: what could mean two numbers is left to be refused by row and column.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from ...errors import FileFormatError
from .units import UNITS, unit_of

SEPARATORS = ("\t", ";", ",", " ")
"""A blank stands for any number of them."""

SAMPLE = 10
"""Rows by which a separator is judged."""

OTHER_UNITS = re.compile(r"-|%|[mk]?hz|[mµμ]?[va]|°?[ck]|k?pa|bar|min|h|(?:m|mm|rad|deg|°)/s(?:\^?2|²)?|")
"""Of columns that no recording needs, in small letters and without blanks. No number is a unit, so that no row of
readings is taken for units.
"""

NO_UNIT = ("", "-", "1")

MOST_REMARKS, FEWEST_NUMBERS = 50, 6
"""Rows above the header; and numbers in a row, a wrench at least."""

COLUMN_OF = {"force": "fx", "torque": "tx", "time": "t", "angle": "roll", "length": "x"}
USUAL = ("N", "N m", "s", "deg", "m")
"""Columns by which a unit is shown, and the units of those that state none."""
OF_UNITS = re.compile(r"unit|einheit|pound|ounce|kilogram|\b(?:kg|oz|ozf)\b", re.IGNORECASE)
"""In a remark: that it states a unit, whether that is one which is known here or not."""

DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+(?:[eE][+-]?\d+)?")
PERHAPS_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2},\d{3}")
PERHAPS_DOTTED = re.compile(r"[+-]?[1-9]\d{0,2}[.,]\d{3}")
CLOCK = re.compile(r"\d[-/.:]\d+[-/.:]\d")
THOUSANDS = re.compile(r"[+-]?\d{1,3}(?:[., '\u2019\u00a0\u202f]\d{3})+(?:[.,]\d+)?")


@dataclass(frozen=True)
class Layout:
    """Of a text file: the columns' names, what stands between two cells, and the decimal mark."""

    names: tuple[str, ...]
    separator: str
    decimal: str


def layout_of(lines: Sequence[str], source: str) -> tuple[int, Layout] | None:
    """The row after which the numbers begin, and the layout, by the first lines of a file; None where all are blank or
    comments. Raises `FileFormatError` where the first row is numbers that no comment above it names, or units stand
    above a header.
    """
    rows = [(row, line) for row, line in enumerate(lines, start=1) if is_row(line)]
    if rows and rows[0][1].lower().startswith("sep="):
        rows = rows[1:]
    if not rows:
        return None
    row, header = (rows := _below_remarks(rows, source))[0]
    data = [line for _, line in rows[1:]]
    if any(_numbers_in(each := split(header, mark)) == len(each) > 0 for mark in SEPARATORS):
        return row - 1, _named_by_comment(lines[: row - 1], [header, *data], row, source)
    separator = _separator(header, data[:SAMPLE])
    names = _names(header, separator, row, source)
    if data and _are_units(units := split(data[0], separator), names):
        units = [unit.strip("[]() ") for unit in units]
        names = [f"{name} [{unit}]" if unit not in NO_UNIT else name for name, unit in zip(names, units, strict=True)]
        row, data = rows[1][0], data[1:]
    return row, Layout(tuple(names), separator, _decimal(data, separator))


def _below_remarks(rows: list[tuple[int, str]], source: str) -> list[tuple[int, str]]:
    """The rows from the header on, the first with as many cells, most of them filled, as the first row of numbers:
    loggers write of themselves above it. All rows where none is so. Raises `FileFormatError` for units up there.
    """
    each = ((k, mark, split(line, mark)) for k, (_, line) in enumerate(rows[:MOST_REMARKS]) for mark in SEPARATORS)
    k, mark, width = next(
        ((k, mark, len(found)) for k, mark, found in each if _numbers_in(found) >= FEWEST_NUMBERS), (0, "", 0)
    )
    above = [split(line, mark) for _, line in rows[:k]]
    filled = [len(found) == width and sum(map(bool, found)) >= FEWEST_NUMBERS for found in above]
    header = filled.index(True) if True in filled else 0
    for row, line in rows[:header]:
        _refuse_units(line, f"{source}: row {row}")
    return rows[header:]


def _refuse_units(remark: str, where: str) -> None:
    """Raise `FileFormatError` for what may be a unit other than those that columns without one have."""
    words = re.findall(r"[\w·.*^°-]+", remark)
    for word in (*map(" ".join, pairwise(words)), *words):
        for quantity, column in COLUMN_OF.items():
            unit = unit_of(quantity, word)
            if unit is not None and unit not in USUAL:
                raise FileFormatError(
                    f"{where}: found {word} above the header, expected units beside the names, as in "
                    f"{column} [{unit}]: write it there, and # before that row"
                )
    if OF_UNITS.search(remark) and not any(unit_of("force", word) == "N" for word in words):
        raise FileFormatError(
            f"{where}: found {remark[:40]!r} above the header, expected units beside the names, as in fx [N], tx [Nm]: "
            "write them there, and # before that row"
        )


def _named_by_comment(above: Sequence[str], data: Sequence[str], row: int, source: str) -> Layout:
    """The layout of rows whose names stand in the last comment above them, as numpy.savetxt writes them."""
    comment = next((line.strip().lstrip("#% ") for line in reversed(above) if line.strip()), "")
    separator = _separator(comment, data[:SAMPLE])
    names = _names(comment, separator, row, source)
    if len(names) < 2 or len(names) != len(split(data[0], separator)) or any(map(is_number, names)):
        raise FileFormatError(f"{source}: row {row}: found numbers, expected a header with the columns' names")
    return Layout(tuple(names), separator, _decimal(data, separator))


def _names(header: str, separator: str, row: int, source: str) -> list[str]:
    """The columns' names; between blanks, brackets alone are the unit of the name before: `time [s]  Fx [N]`."""
    if separator == " " and '"' not in header:
        return re.findall(r"\S+(?:\s+[\[(][^\[\]()]*[\])])*", header)
    return cells(header, separator, row, source)


def _separator(header: str, data: Sequence[str]) -> str:
    """What stands between two cells: that by which the most cells of rows as wide as the header are numbers, else the
    most frequent one of the header.
    """
    bare = re.sub(r'"[^"]*"', "", header)
    candidates = [mark for mark in SEPARATORS[:-1] if mark in bare] or [" "]
    best, most = max(candidates, key=bare.count), 0
    for candidate in candidates:
        width = len(split(header, candidate))
        rows = [row for line in data if len(row := split(line, candidate)) == width]
        count = sum(map(_numbers_in, rows))
        if count > most:
            best, most = candidate, count
    return best


def _are_units(units: Sequence[str], names: Sequence[str]) -> bool:
    """Whether a row is the units of the columns: each cell a word for a unit, empty, or in brackets and no number."""
    words = [unit.strip("[]() ").lower().replace(" ", "") for unit in units]
    sure = all(
        _is_unit(word) or (word != unit.lower() and (word == "1" or not is_number(word)))
        for word, unit in zip(words, (unit.replace(" ", "") for unit in units), strict=True)
    )
    return sure and len(units) == len(names) and any(word not in NO_UNIT for word in words)


def _is_unit(word: str) -> bool:
    return OTHER_UNITS.fullmatch(word) is not None or any(unit_of(quantity, word) for quantity in UNITS)


def _decimal(data: Sequence[str], separator: str) -> str:
    """The decimal mark: a comma where it separates no cells and some number has one that can be nothing else."""
    if separator == ",":
        return "."
    for line in data:
        if "," in line and any(
            DECIMAL_COMMA.fullmatch(cell) and not PERHAPS_THOUSANDS.fullmatch(cell) for cell in split(line, separator)
        ):
            return ","
    return "."


def _numbers_in(row: Sequence[str]) -> int:
    """How many cells are numbers, with either decimal mark."""
    return sum(is_number(cell) or DECIMAL_COMMA.fullmatch(cell) is not None for cell in row)


def is_row(line: str) -> bool:
    """Whether a line is neither blank nor a comment, with `#` or MATLAB's `% `; a spreadsheet's `#N/A` is none, nor is
    rostopic's `%time`.
    """
    start = line.lstrip()
    return bool(start) and (start[0] != "#" or start.startswith("#N/A")) and not start.startswith("% ")


def cells(line: str, separator: str, row: int, source: str) -> list[str]:
    """The cells of one line, without the space around them. Raises `FileFormatError`."""
    try:
        blanks = separator == " "
        reader = csv.reader([line.strip() if blanks else line, ""], delimiter=separator, skipinitialspace=blanks)
        found = next(reader)
        if reader.line_num > 1:
            raise csv.Error("a quote is not closed")
        return [cell.strip() for cell in found]
    except csv.Error as error:
        raise FileFormatError(
            f"{source}: row {row}: found what is no CSV ({error}), expected cells of names and numbers: correct it"
        ) from None


def split(line: str, separator: str) -> list[str]:
    """The same; none where they cannot be told apart."""
    try:
        return cells(line, separator, 0, "")
    except FileFormatError:
        return []


def value(text: str) -> float:
    """The number that `text` is. Raises `ValueError`, also for the underscores that Python allows in a number."""
    if "_" in text:
        raise ValueError(text)
    return float(text)


def is_number(text: str) -> bool:
    """Whether a text is a number with a decimal point."""
    try:
        value(text)
    except ValueError:
        return False
    return True


def no_number(cell: str, name: str, *, comma: bool, of_times: bool) -> str:
    """What is wrong with a cell below a `name`, no number in a file whose decimal mark is a comma, or a point."""
    if PERHAPS_THOUSANDS.fullmatch(cell):
        return f"found {cell!r}, which may be a decimal comma or thousands, expected a point: write it so"
    if DECIMAL_COMMA.fullmatch(cell):
        return f"found the decimal comma {cell!r}, expected a point: write it so"
    if THOUSANDS.fullmatch(cell) and not is_number(cell):
        return f"found thousands set apart in {cell[:40]!r}, expected digits and one decimal mark: write it so"
    if comma and is_number(cell):
        return f"found the decimal point {cell[:40]!r} in a file with decimal commas, expected one mark: write it so"
    mend = "leave the times out, if the rows are poses, with --time-column none" if of_times else "leave the row out"
    if of_times and CLOCK.search(cell):
        mend = f"write those, or {mend}"
        return f"found {cell[:40]!r}, a date or time of day, expected seconds since the first row: {mend}"
    again = "found the header again, expected one recording: cut the file there"
    return again if cell == name else f"found {cell[:40]!r}, expected a number: correct it or {mend}"
