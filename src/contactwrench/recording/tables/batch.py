"""What files that store their numbers column by column have in common: lists as columns, and rows of numbers."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from ...errors import ContactWrenchError, FileFormatError
from ...geometry.arrays import Array
from .columns import Column, shown

MOST_ELEMENTS = 64
"""Longer lists are images, spectra and the like: they stand for no columns."""

ROOM, BYTES_PER_ROW = 2**27, 2**7
"""Bytes of memory: of what any file may state to hold, and of a row. A larger file may state as many rows as it has
bytes: readings have noise, which nothing packs so tightly.
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


@dataclass(frozen=True)
class Field:
    """A column by its name, the path of what holds it in the file, and which element of that one's lists of `length` it
    is; None: it is no list.
    """

    name: str
    path: tuple[str, ...]
    element: int | None = None
    length: int = 1


@contextmanager
def readable(source: str, kind: str, errors: tuple[type[Exception], ...]) -> Iterator[None]:
    """Raise `FileFormatError` for what a library for files of a `kind` cannot read, which raises one of `errors`."""
    try:
        yield
    except ContactWrenchError:
        raise
    except errors as error:
        reason = shown(str(error).partition("\n")[0].partition(". ")[0], 100)
        raise FileFormatError(
            f"{source}: cannot be read as {kind} ({reason}), expected a whole {kind} file: write it anew"
        ) from None


class Batch(ABC):
    """Rows of a file, by their numbers (n,) in it from 0. A `Body`."""

    def __init__(self, rows: NDArray[np.intp], source: str, done: float) -> None:
        self._rows, self.source, self.done = rows, source, done

    def __len__(self) -> int:
        return len(self._rows)

    def row_of(self, index: int) -> int:
        """The number of the index-th row in the file, from 1."""
        return int(self._rows[index]) + 1

    def refuse_lack(self, index: int, column: Column) -> NoReturn:
        """Raise the `FileFormatError` for a null or a NaN."""
        raise FileFormatError(
            f"{self.source}: row {self.row_of(index)}, column {column.name}: found no number, expected one: fill it in "
            "or leave the row out"
        )

    def numbers(self, columns: Sequence[Column], may_lack: Collection[Column] = ()) -> Array:
        """The numbers (n, k) of the columns, as written; NaN where a column in `may_lack` has a null or a NaN.

        Raises `FileFormatError` naming row and column of what is no finite number.
        """
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
