"""What files that store numbers column by column have in common: lists, rows, and how much they may state."""

from __future__ import annotations

import os
from abc import abstractmethod
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, NoReturn

import numpy as np
from numpy.typing import NDArray

from ...errors import ContactWrenchError, FileFormatError
from ...files import open_bytes
from ...geometry.arrays import Array
from .columns import Body, Column, shown

MOST_ELEMENTS = 64
"""Longer lists are images, spectra and the like: they stand for no columns."""

ROOM, BYTES_PER_ROW, BYTES_PER_PAGE = 2**27, 2**7, 2**10
"""Bytes of memory: of what any file may state to hold, of a row, and of a page. A larger file may state as many rows as
it has bytes: readings have noise, which nothing packs so tightly.
"""


def require_room(path: str | Path, count: int, what: str, each: int = 1) -> None:
    """Raise `FileFormatError` for a file that states so many of something, of so many bytes `each`, as do not fit."""
    size = os.path.getsize(path)
    most = max(ROOM, BYTES_PER_ROW * size) // each
    if count > most:
        raise FileFormatError(
            f"{path}: found {count} {what} in a file of {size} bytes, expected at most {most}: is it damaged, or were "
            "they never written? record or export it again"
        )


def require_room_for_pages(path: Path, columns: Iterable[tuple[int, int]]) -> None:
    """Raise `FileFormatError` where the pages of a Parquet file, whatever its foot says, state more than a file of its
    size holds. `columns`: of each the byte at which its first page begins, and the number of its values.
    """
    pages = unpacked = numbers = 0
    with open_bytes(path) as file, readable(str(path), "Parquet", NO_HEADER):
        for first, values in columns:
            file.seek(first)
            seen = 0
            while seen < values:
                size, count, is_data = _page(file)
                seen += count if is_data else 0
                pages, unpacked, numbers = pages + 1, unpacked + size, numbers + count
                require_room(path, pages, "pages", BYTES_PER_PAGE)
                require_room(path, unpacked, "bytes in pages")
                require_room(path, numbers, "numbers in pages", 8)


def _page(file: BinaryIO) -> tuple[int, int, bool]:
    """Of a page, which is then passed: how many bytes it unpacks to, how many values it has, and whether these are of
    rows, not of a dictionary (PageHeader in parquet-format's parquet.thrift).
    """
    header = _thrift(file)
    count = next((abs(header[kind][1]) for kind in (5, 7, 8) if kind in header), 0)
    file.seek(abs(header[3]), os.SEEK_CUR)
    return abs(header[2]), count, 7 not in header


def _thrift(file: BinaryIO) -> dict[int, Any]:
    """The fields of a struct in Thrift's compact protocol by their numbers: those that a page's header is made of."""
    fields: dict[int, Any] = {}
    number = 0
    while head := file.read(1)[0]:
        number = number + (head >> 4) if head >> 4 else _varint(file)
        fields[number] = VALUES[head & 15](file)
    return fields


def _varint(file: BinaryIO) -> int:
    byte = file.read(1)[0]
    return byte if byte < 128 else (byte & 127) + (_varint(file) << 7)


VALUES: dict[int, Callable[[BinaryIO], Any]] = {
    **dict.fromkeys((1, 2), lambda _: None),
    **dict.fromkeys((4, 5, 6), lambda file: (number := _varint(file)) >> 1 ^ -(number & 1)),
    8: lambda file: file.seek(_varint(file), os.SEEK_CUR),
    12: _thrift,
}
"""Of Thrift's types those that a page's header has: truth values, whole numbers, a text, a struct."""
NO_HEADER = (ArithmeticError, LookupError, OSError, RecursionError, TypeError, ValueError)
"""What bytes raise that are none."""


@dataclass(frozen=True)
class Field:
    """A column by its name, the path of what holds it in the file, and which element of that one's lists of `length` it
    is; None: it is no list.
    """

    name: str
    path: tuple[str, ...]
    element: int | None = None
    length: int = 1


@dataclass(frozen=True)
class Part:
    """A file; of each of its row groups the number of rows, and the least and the greatest episode, where known."""

    path: Path
    rows: tuple[int, ...]
    episodes: tuple[tuple[float, float] | None, ...]

    def with_episode(self, episode: int | None) -> list[int]:
        """The row groups in which rows of an episode may be."""
        ranges = enumerate(self.episodes)
        return [k for k, known in ranges if episode is None or known is None or known[0] <= episode <= known[1]]

    def numbers(self, groups: list[int]) -> NDArray[np.intp]:
        """Of the rows of some groups in the file, from 0."""
        ends = np.cumsum(self.rows)
        each = [np.arange(ends[k] - self.rows[k], ends[k]) for k in groups]
        return np.concatenate(each) if each else np.arange(0)


@contextmanager
def readable(source: str, kind: str, errors: tuple[type[Exception], ...]) -> Iterator[None]:
    """Raise `FileFormatError` for what a library for files of a `kind` cannot read, which raises one of `errors`."""
    try:
        yield
    except (ContactWrenchError, MemoryError):
        raise
    except errors as error:
        bytes(ROOM)  # where memory is short, MemoryError, whatever the library says; asked for, not filled
        reason = shown(str(error).partition("\n")[0].partition(". ")[0], 100)
        raise FileFormatError(
            f"{source}: cannot be read as {kind} ({reason}), expected a whole {kind} file: write it anew"
        ) from None


class Batch(Body):
    """Rows of a file whose columns are read one by one."""

    def refuse_lack(self, index: int, column: Column) -> NoReturn:
        """Raise the `FileFormatError` for a null or a NaN."""
        raise FileFormatError(
            f"{self.source}: row {self.row_of(index)}, column {column.name}: found no number, expected one: fill it in "
            "or leave the row out"
        )

    def numbers(self, columns: Sequence[Column], may_lack: Collection[Column] = ()) -> Array:
        """As of `Body`, whose cells are empty where there is a null or a NaN."""
        values = np.empty((len(self), len(columns)))
        for k, column in enumerate(columns):
            values[:, k] = self.floats(column)
        fine = np.isfinite(values)
        for index, k in np.argwhere(~fine) if not fine.all() else ():
            column, value = columns[k], values[index, k]
            if np.isinf(value):
                raise FileFormatError(
                    f"{self.source}: row {self.row_of(int(index))}, column {column.name}: found {value}, expected a "
                    "finite number: leave the row out"
                )
            if column not in may_lack:
                self.refuse_lack(int(index), column)
        return values

    @abstractmethod
    def floats(self, column: Column) -> Array:
        """The numbers (n,) of a column; NaN where there is none. Raises `FileFormatError` for what are no numbers."""
