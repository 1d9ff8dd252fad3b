"""The lines of a text table, and their cells: apart, as numbers, and what is wrong with those that are none."""

from __future__ import annotations

import csv
import os
import re
from codecs import BOM_UTF8, BOM_UTF16_BE, BOM_UTF16_LE, getincrementaldecoder
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TypeAlias

from ...errors import FileFormatError
from ...files import TEXT_AT_ONCE, name_of, open_bytes
from .units import UNREADABLE

LinesFrom: TypeAlias = tuple[int, list[str], float]
"""The row of the first of some lines, the lines, and the part of the file, 0 to 1, that was read; NaN for a pipe."""

DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+(?:[eE][+-]?\d+)?")
PERHAPS_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2},\d{3}")
PERHAPS_DOTTED = re.compile(r"[+-]?[1-9]\d{0,2}[.,]\d{3}")
CLOCK = re.compile(r"\d[-/.:]\d+[-/.:]\d")
THOUSANDS = re.compile(r"[+-]?\d{1,3}(?:[., '\u2019\u00a0\u202f]\d{3})+(?:[.,]\d+)?")

_no_text = re.compile("[\ufffd¡¢£¤¥¦¨©ª¬®¯¸¹¼½¾¿¶‚ƒ„†‡ˆ‰‹›]|[–—‘“”•˜™][À-ÿ]|[À-ÿ]{3}").sub
NO_TEXT = "\N{REPLACEMENT CHARACTER}"
"""What no name in Windows' 1252 has, and names of another code (Shift JIS, GBK, EUC-KR, Windows' 1251) become where
that is taken for it; and what stands instead. Brackets of full width always become so, and any unit in them.
"""
OTHER_KINDS = {
    b"\x1f\x8b": "a gzip file, expected text: unpack it",
    b"PK\3\4": "an Excel workbook or a zip file, expected text: export it as CSV, or unpack it",
    b"\xd0\xcf\x11\xe0": "an Excel workbook, expected text: export it as CSV",
    b"PAR1": "a Parquet file, expected text: name it .parquet",
    b"\x89HDF": "an HDF5 file, expected text: name it .h5",
    b"MATLAB": "a MAT-file, expected text: name it .mat",
    b"\x93NUMPY": "an array of numpy, expected text: write it with numpy.savetxt",
}
"""By what they begin with."""
UNIT_AT_END = re.compile(r"[\[(]([\w\s/*.^%-]+)[\])]\s*$", re.ASCII)


def blocks_of_lines(path: str | Path, most: int) -> Iterator[LinesFrom]:
    """The lines of a text file, at most so many at once. Raises `FileAccessError`, and `FileFormatError` for a line
    longer than `TEXT_AT_ONCE`, and what is no text.
    """
    source = name_of(path)
    with open_bytes(path) as file:
        size, row, rest, content = os.fstat(file.fileno()).st_size, 1, b"", b" "
        wide = file.peek(2)[:2] in (BOM_UTF16_LE, BOM_UTF16_BE)
        utf16, done = getincrementaldecoder("utf-16")("replace"), 0
        while content:
            content = file.read(TEXT_AT_ONCE)
            whole = rest + (utf16.decode(content, final=not content).encode() if wide else content)
            end = max(whole.rfind(b"\n"), whole.rfind(b"\r", 0, -1)) + 1 if content else len(whole)
            if not end and len(whole) >= TEXT_AT_ONCE:
                raise FileFormatError(
                    f"{source}: row {row}: found a line of more than {TEXT_AT_ONCE // 2**20} MiB, expected a table "
                    "with a row for each reading: write it so"
                )
            text, rest, done = _decoded(whole[:end], row, source), whole[end:], done + len(content)
            lines = text.removesuffix("\n").split("\n") if end else []
            for first in range(0, len(lines), most):
                yield row + first, lines[first : first + most], min(done / size, 1.0) if size else float("nan")
            row += len(lines)


def _decoded(content: bytes, row: int, source: str) -> str:
    """Lines from that row on as text, with line feeds between. Raises `FileFormatError` for what is none."""
    if row == 1 and (kind := next((kind for start, kind in OTHER_KINDS.items() if content.startswith(start)), "")):
        raise FileFormatError(f"{source}: found {kind}")
    if row == 1 and b"\0" in content[:4096]:  # UTF-16 with its mark comes as UTF-8
        raise FileFormatError(f"{source}: found UTF-16 or binary content, expected CSV text in UTF-8: save it as that")
    try:
        text = content.decode("utf-8-sig" if row == 1 else "utf-8")
    except UnicodeDecodeError as error:
        if row == 1 and content.startswith(BOM_UTF8):
            where = row + content.count(b"\n", 0, error.start)
            raise FileFormatError(
                f"{source}: row {where}: found a byte that is no UTF-8, expected UTF-8: save it as that"
            ) from None
        text = of_unknown_code(content)
    text = text.replace("\N{MINUS SIGN}", "-")
    return text.replace("\r\n", "\n").replace("\r", "\n") if "\r" in text else text


def of_unknown_code(content: bytes) -> str:
    """Text that is no UTF-8: names and remarks, as no number has such a byte."""
    return _no_text(lambda found: NO_TEXT * len(found[0]), content.decode("cp1252", errors="replace"))


def named_or_numbered(names: Sequence[str]) -> list[str]:
    """The columns' names; in a code that is not known, instead of one that nobody can read or type, its number, from 1,
    with its unit: that which is in brackets and can be read, else `UNREADABLE`.
    """
    if not any(NO_TEXT in name for name in names):
        return list(names)
    units = [UNIT_AT_END.search(name) for name in names]
    known = [unit[1] if unit is not None else UNREADABLE for unit in units]
    each = enumerate(zip(names, known, strict=True), start=1)
    return [name if name.isascii() else f"{number} [{unit}]" for number, (name, unit) in each]


def numbers_in(row: Sequence[str]) -> int:
    """How many cells are numbers, with either decimal mark."""
    return sum(is_number(cell) or DECIMAL_COMMA.fullmatch(cell) is not None for cell in row)


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


def seconds_of_date(text: str) -> float:
    """Seconds since 1970 of a date with a time of day, as ISO 8601 has it, in UTC where it names no zone.
    Raises `ValueError` for anything else.
    """
    if ":" not in text:
        raise ValueError(text)
    date = datetime.fromisoformat(text)
    return (date if date.tzinfo is not None else date.replace(tzinfo=UTC)).timestamp()


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
        return f"found {cell[:40]!r}, a date or time of day, expected s, or 2024-05-01 12:00:00: {mend}"
    again = "found the header again, expected one recording: cut the file there"
    return again if cell == name else f"found {cell[:40]!r}, expected a number: correct it or {mend}"
