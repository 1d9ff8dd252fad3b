"""Columns of numbers by their names, the same for every kind of table: found by name, units by suffix."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass
from typing import NoReturn, Protocol

import numpy as np
from numpy.typing import NDArray

from ...errors import FileFormatError
from ...geometry.arrays import Array

ROWS = 2**15
"""Rows that are read at once: some 10 MB."""

SATURATED = "saturated"
"""1 or true in the rows in which a channel of the sensor stood at its limit."""


@dataclass(frozen=True)
class Column:
    """A column by its place in the file, its name there, and how many of its unit make one of SI."""

    place: int
    name: str
    per_si: float


class Body(Protocol):
    """Rows of a table, all of them or a block; `done` is the part of the file, 0 to 1, that ends with them."""

    @property
    def source(self) -> str:
        """The file, as messages name it."""

    @property
    def done(self) -> float:
        """The part of the file, 0 to 1, that was read when these rows end; NaN where nobody knows its size."""

    def __len__(self) -> int:
        """Number of rows."""

    def numbers(self, columns: list[Column], may_lack: Collection[Column] = ()) -> Array:
        """The numbers (n, k) of the columns, as written; NaN where a cell of a column in `may_lack` is empty.

        Raises `FileFormatError` naming row and column of what is no finite number.
        """

    def row_of(self, index: int) -> int:
        """The number of the index-th row, as a message gives it."""

    def refuse_lack(self, index: int, column: Column) -> NoReturn:
        """Raise the `FileFormatError` for an empty cell."""


def places_of(names: Iterable[str], source: str) -> dict[str, int]:
    """The place of each column by its name. Raises `FileFormatError` for a name that is there twice."""
    places: dict[str, int] = {}
    for place, name in enumerate(names):
        if name in places:
            raise FileFormatError(f"{source}: column {shown(name)} is there twice, expected once: rename or remove one")
        if name:
            places[name] = place
    return places


def require(good: NDArray[np.bool_], values: Array, columns: list[Column], body: Body, expected: str) -> None:
    """Raise `FileFormatError` naming the first of `values` (n, k), SI, that is not good, in its column's unit."""
    if not good.all():
        index, k = (int(place) for place in np.argwhere(~good)[0])
        column = columns[k]
        raise FileFormatError(
            f"{body.source}: row {body.row_of(index)}, column {column.name}: found "
            f"{values[index, k] * column.per_si:g}, expected {expected}: correct it or leave the row out"
        )


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


def shown(name: str, length: int = 40) -> str:
    """A column's name as a message can show it: short, and without control characters."""
    return "".join(letter if letter.isprintable() else "?" for letter in name[:length])
