"""How a text file writes its table, by its first lines: header, separator, decimal mark, row of units. What these do
not settle is not decided: what could mean two numbers is left to be refused by row and column.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from ...errors import FileFormatError
from .text_cells import (
    DECIMAL_COMMA,
    NO_TEXT,
    PERHAPS_THOUSANDS,
    cells,
    is_number,
    named_or_numbered,
    numbers_in,
    split,
)
from .units import UNITS, UNREADABLE, in_ascii, unit_of

SEPARATORS = ("\t", ";", ",", " ")
"""A blank stands for any number of them."""

SAMPLE = 10
"""Rows by which a separator is judged."""

OTHER_UNITS = re.compile(r"-|[%‰]|[mk]?hz|[mµμ]?[va]|°?[ck]|k?pa|bar|min|h|(?:m|mm|rad|deg|°)/s(?:\^?2|²)?|")
"""Of columns that no recording needs, in small letters and without blanks. No number is one: readings are no units."""

NO_UNIT = ("", "-", "1")

MOST_REMARKS, FEWEST_NUMBERS, ALIKE = 50, 6, 2
"""Rows above the header; numbers in a row, a wrench at least; and rows below the first that are numbers too: LabVIEW
writes two, X0 and Delta_X, of its own.
"""

COMMENT = "comment"
"""Of the names in LabVIEW's files the last."""
COLUMN_OF = {"force": "fx", "torque": "tx", "time": "t", "angle": "roll", "length": "x"}
USUAL = ("N", "N m", "s", "deg", "m")
"""Columns by which a unit is shown, and the units of those that state none."""
OF_FORCE, OF_TORQUE = re.compile("forc|kraft", re.IGNORECASE), re.compile("torque|moment", re.IGNORECASE)
BESIDE_BLANKS = re.compile(r"[\t;]|\s,|,\s")
"""What parts cells itself; a comma between digits may be a decimal one."""
COUNTS = re.compile(r"\bcounts? (?:per|/)", re.IGNORECASE)
"""Of numbers that are to be divided by as many."""
OF_UNITS = re.compile(r"unit|einheit|pound|ounce|kilogram|\b(?:kg|oz|ozf)\b", re.IGNORECASE)
"""In a remark: that it states a unit, whether that is one which is known here or not."""


@dataclass(frozen=True)
class Layout:
    """Of a text file: the columns' names, what stands between two cells, and the decimal mark; the row of the first
    numbers where no header names them, and the names are the columns' numbers; 0: there is one.
    """

    names: tuple[str, ...]
    separator: str
    decimal: str
    unnamed: int = 0

    @property
    def width(self) -> str:
        """How many cells a row has, and what says so."""
        return f"{len(self.names)} as in the {'first row' if self.unnamed else 'header'}"


def layout_of(lines: Sequence[str], source: str) -> tuple[int, Layout] | None:
    """The row after which the numbers begin, and the layout, by the first lines of a file; None where all are blank or
    comments. Raises `FileFormatError` where units stand above a header, or numbers that no header names may be two.
    """
    rows = [(row, line) for row, line in enumerate(lines, start=1) if is_row(line)]
    if rows and rows[0][1].lower().startswith("sep="):
        rows = rows[1:]
    if not rows:
        return None
    row, header = (rows := _below_remarks(rows, source))[0]
    data = [line for _, line in rows[1:]]
    if any(_is_reading(header, data[:SAMPLE], mark) for mark in SEPARATORS):
        return row - 1, _named_by_comment(lines[: row - 1], [header, *data], row, source)
    separator = _separator(header, data[:SAMPLE])
    names = named_or_numbered(_names(header, separator, row, source))
    names = _as_wide(names, [split(line, separator) for line in data[:SAMPLE]])
    if data and _are_units(units := split(data[0], separator), names):
        units = [UNREADABLE if NO_TEXT in unit else in_ascii(unit).strip("[]() ") for unit in units]
        names = [
            f"{name.removesuffix(f' [{UNREADABLE}]')} [{unit}]" if unit not in NO_UNIT else name
            for name, unit in zip(names, units, strict=True)
        ]
        row, data = rows[1][0], data[1:]
    return row, Layout(tuple(names), separator, _decimal(data, separator))


def _below_remarks(rows: list[tuple[int, str]], source: str) -> list[tuple[int, str]]:
    """The rows from the header on: that of the first numbers which others follow; of few rows that of the first
    numbers; all rows where there is none. Raises `FileFormatError` for units in the remarks above.
    """
    lines = [line for _, line in rows[: MOST_REMARKS + ALIKE]]
    each = ((k, mark, split(line, mark)) for k, line in enumerate(lines[:MOST_REMARKS]) for mark in SEPARATORS)
    of_numbers = [(k, mark, len(found)) for k, mark, found in each if numbers_in(found) >= FEWEST_NUMBERS]
    followed = (
        (k, mark, width)
        for k, mark, width in of_numbers
        if all(
            len(below) == width and numbers_in(below) > 0
            for below in (split(line, mark) for line in lines[k + 1 : k + 1 + ALIKE])
        )
    )
    firsts = [first for first in (next(followed, None), *of_numbers[:1]) if first is not None]
    header = next((k for first in firsts if (k := _header_above(lines, *first)) is not None), 0)
    for row, line in rows[:header]:
        _refuse_units(line, f"{source}: row {row}")
    return rows[header:]


def _header_above(lines: Sequence[str], first: int, mark: str, width: int) -> int | None:
    """Which line is the header of the numbers that begin with the first: as many cells, most of them filled."""
    above = [split(line, mark) for line in lines[:first]]
    filled = [len(found) == width and sum(map(bool, found)) >= FEWEST_NUMBERS for found in above]
    of_labview = [len(_without_comment(found, width)) == width and found[-1].lower() == COMMENT for found in above]
    counted = [False] * first + [first > 0 and _counts_on(split(lines[first], mark))]
    return next((each.index(True) for each in (of_labview, filled, counted) if True in each), None)


def _without_comment(names: list[str], width: int) -> list[str]:
    """The names of as many columns as rows have: LabVIEW names one more at the end, of which few rows have a cell, and
    others write a separator behind the last name.
    """
    return names[:-1] if len(names) == width + 1 and names[-1].lower() in (COMMENT, "") else names


def _as_wide(names: list[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """The names of as many columns as rows have, of which each may end with a separator."""
    if rows and all(len(row) == len(names) + 1 and not row[-1] for row in rows):
        return [*names, ""]
    return _without_comment(names, len(rows[0])) if rows else names


def _refuse_units(remark: str, where: str) -> None:
    """Raise `FileFormatError` for what may be a unit other than those that columns without one have."""
    if (stated := _unit_in(remark)) is not None:
        word, unit, column = stated
        raise FileFormatError(
            f"{where}: found {word} above the header, expected units beside the names, as in "
            f"{column} [{unit}]: write it there, and # before that row"
        )
    usual = [unit_of(quantity, word) in USUAL for quantity in ("force", "torque") for word in _words(remark)]
    of_torque = OF_TORQUE.search(remark) and not OF_FORCE.search(remark)
    if COUNTS.search(remark) or (OF_UNITS.search(remark) and not any(usual if of_torque else usual[: len(usual) // 2])):
        raise FileFormatError(
            f"{where}: found {remark[:40]!r} above the header, expected units beside the names, as in fx [N], tx [Nm]: "
            "write them there, and # before that row"
        )


def refuse_units_above(lines: Sequence[str], row: int, source: str) -> None:
    """Raise `FileFormatError` for a unit in the remarks above numbers without a header, beside which it could stand."""
    for above, remark in enumerate(lines[: row - 1], start=1):
        if (stated := _unit_in(remark)) is not None:
            raise FileFormatError(
                f"{source}: row {above}: found {stated[0]} above columns without names, expected to be told the units: "
                "say --units force=N,torque=Nm, or what else they are"
            )


def _unit_in(remark: str) -> tuple[str, str, str] | None:
    """What may be a unit other than those that columns without one have: the word, the unit, and a column of it."""
    words = _words(remark)
    for word in (*map(" ".join, pairwise(words)), *words):
        for quantity, column in COLUMN_OF.items():
            unit = unit_of(quantity, word)
            if unit is not None and unit not in USUAL:
                return word, unit, column
    return None


def _words(remark: str) -> list[str]:
    words = re.findall(r"[\w·.*^°-]+", remark)
    if NO_TEXT in remark:  # a letter may be the half of a sign before it
        apart = re.findall(r"(?<![0-9A-Za-z])[A-Za-z][A-Za-z-]+", remark)
        words += [*apart, *(word[1:] for word in apart)]
    return words


def _is_reading(line: str, data: Sequence[str], mark: str) -> bool:
    """Whether a row above others is numbers, not names: all of it, or a wrench at least, beside what is no number in
    the others either, as a time of day. Whole numbers that count on are the names that pandas gives. Where no other is
    as wide, blanks about a separator part no cells: `force 1 ; force 2` is two names.
    """
    row = split(line, mark)
    numbers = numbers_in(row)
    if numbers < min(len(row), FEWEST_NUMBERS) or not row or (data and _counts_on(row)):
        return False
    alike = [other for other in (split(below, mark) for below in data) if len(other) == len(row)]
    if not alike and mark == " " and BESIDE_BLANKS.search(line):
        return False
    words = [k for k, cell in enumerate(row) if cell and not numbers_in([cell])]
    return not any(numbers_in([other[k]]) for other in alike for k in words)


def _counts_on(row: Sequence[str]) -> bool:
    """Whether the numbers in a row are 0, 1, 2 and so on, or 1, 2, 3."""
    numbers = [cell for cell in row if numbers_in([cell])]
    return len(numbers) > 1 and numbers in [[str(first + k) for k in range(len(numbers))] for first in (0, 1)]


def _named_by_comment(above: Sequence[str], data: Sequence[str], row: int, source: str) -> Layout:
    """The layout of rows whose names stand in the last comment above them, as numpy.savetxt writes them, or nowhere."""
    comment = next((line.strip().lstrip("#% ") for line in reversed(above) if line.strip()), "")
    separator = _separator(comment, data[:SAMPLE])
    names = named_or_numbered(_names(comment, separator, row, source))
    if len(names) > 1 and len(names) == len(split(data[0], separator)) and not any(map(is_number, names)):
        return Layout(tuple(names), separator, _decimal(data, separator))
    sample = data[: SAMPLE + 1]
    separator = max(SEPARATORS, key=lambda mark: sum(numbers_in(split(line, mark)) for line in sample))
    if separator == "," and _may_be_halves(sample):
        raise FileFormatError(
            f"{source}: row {row}: found numbers between commas, which may be decimal commas, and no header, "
            "expected a header, or decimals with a point: write them so"
        )
    names = [str(k) for k in range(1, len(split(data[0], separator)) + 1)]
    return Layout(tuple(names), separator, _decimal(data, separator), row)


def _may_be_halves(lines: Sequence[str]) -> bool:
    """Whether cells between commas may be the two halves of numbers with decimal commas: some begin with a zero, as no
    whole number does; or all are whole, and every second one, from the last, digits alone, or some apart by blanks, or
    the rows too few to tell.
    """
    rows = [[cell.lower().partition("e")[0] for cell in split(line, ",")] for line in lines]
    every = [cell for row in rows for cell in row]
    if any(re.fullmatch(r"0\d+", cell) for cell in every):
        return True
    if not all(re.fullmatch(r"[+-]?\d+", cell) for cell in every):
        return False
    apart = any(re.search(r",\s", line) and re.search(r",\S", line) for line in lines)
    decimals = all(cell.isdecimal() for row in rows for cell in row[::-2])
    return max(map(len, every)) > 1 and (apart or decimals or len(lines) <= ALIKE)


def _names(header: str, separator: str, row: int, source: str) -> list[str]:
    """The columns' names; between blanks, brackets alone are the unit of the name before: `time [s]  Fx [N]`."""
    if separator == " " and '"' not in header:
        return re.findall(r"\S+(?:\s+[\[(][^\[\]()]*[\])])*", header)
    return cells(header, separator, row, source)


def _separator(header: str, data: Sequence[str]) -> str:
    """The separator by which most cells of rows as wide as the header are numbers, else its most frequent one."""
    bare = re.sub(r'"[^"]*"', "", header)
    candidates = [mark for mark in SEPARATORS[:-1] if mark in bare] or [" "]
    best, most = max(candidates, key=bare.count), 0
    for candidate in candidates:
        width = len(split(header, candidate))
        rows = [row for line in data if len(row := split(line, candidate)) == width]
        count = sum(map(numbers_in, rows))
        if count > most:
            best, most = candidate, count
    return best


def _are_units(units: Sequence[str], names: Sequence[str]) -> bool:
    """Whether a row is the units of the columns: each cell a word for a unit, empty, or in brackets and no number."""
    words = [in_ascii(unit).strip("[]() ").lower().replace(" ", "") for unit in units]
    sure = all(
        OTHER_UNITS.fullmatch(word)
        or any(unit_of(quantity, word) for quantity in UNITS)
        or NO_TEXT in word
        or (word != unit.replace(" ", "").lower() and (word == "1" or not is_number(word)))
        for word, unit in zip(words, units, strict=True)
    )
    known = any(word not in NO_UNIT and NO_TEXT not in word for word in words)
    return sure and known and len(units) == len(names)


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


def is_row(line: str) -> bool:
    """Whether a line is neither blank nor a comment (`#`, MATLAB's `% `), as `#N/A` and rostopic's `%time` are none."""
    start = line.lstrip()
    return bool(start) and (start[0] != "#" or start.startswith("#N/A")) and not start.startswith("% ")
