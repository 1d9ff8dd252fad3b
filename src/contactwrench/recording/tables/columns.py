"""Columns of a table in a file of any kind, what was stated of them, and which were taken for what."""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby, takewhile
from operator import itemgetter
from typing import NoReturn, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ...errors import FileFormatError, some_of
from ...geometry.arrays import Array
from ...geometry.orientation import Convention
from .units import ANGLE, per_si, symbol

ROWS = 2**15
"""Rows that are read at once: some 10 MB."""

MOST_COLUMNS, LONGEST_NAME = 10_000, 1_000

Advance: TypeAlias = Callable[[float], None]
"""Is told the part of a recording, 0 to 1, that has been read; NaN where nobody knows its size."""
Tell: TypeAlias = Callable[[str], None]
"""Is told a sentence that is good to know."""

WRENCH_COLUMNS = ("fx", "fy", "fz", "tx", "ty", "tz")
POSITION = ("x", "y", "z")
NANOSECONDS = "nanosec"
"""The role of the second column of times, where they are written as two."""

SATURATED = "saturated"
"""1 or true in the rows in which a channel of the sensor stood at its limit."""

FLAW = "flaw"
"""The last column of a recording of a live session, in words: by it a last row that was not finished is known."""


def unheard(_: object) -> None:
    """In place of who is told something, where nobody listens."""


@dataclass(frozen=True)
class Naming:
    """Which columns of a table are what, as far as it was stated.

    `orientation` as of `read`; None: of two files the one with the wrenches. `wrench_columns` "a,b,c,d,e,f" or a
    slice of a list, "observation.wrench[0:6]"; `time_column` "NAME" or "NAME:UNIT"; columns without names by their
    numbers, from 1; `units` "force=kgf,torque=Nmm"; `hdf5` "wrench=/path,pose=/path,time=/path"; `episode`: which one
    of a set of recordings; `rate` Hz, of the rows of a table without times.
    """

    orientation: str | None = "auto"
    wrench_columns: str | None = None
    time_column: str | None = None
    units: str | None = None
    hdf5: str | None = None
    episode: int | None = None
    rate: float | None = None


AS_NAMED = Naming()


@dataclass(frozen=True)
class Column:
    """A column by its place in the file, its name there, and how many of its unit make one of SI; what it is, `role`,
    by its usual name, and the unit that somebody stated for it, "" where nobody did.
    """

    place: int
    name: str
    per_si: float
    role: str = ""
    unit: str = ""

    @property
    def is_numbered(self) -> bool:
        """Whether its name is its number in the file, from 1, as where no header names it."""
        return self.name.partition(" [")[0] == str(self.place + 1)

    @property
    def is_usual(self) -> bool:
        """Whether its name, in any case, is that of its role, with a suffix for its unit where it has one."""
        suffix = f"_{symbol(self.unit)}" if self.unit else ""
        return self.name.lower() == f"{self.role}{suffix}"


@dataclass(eq=False)
class Body(ABC):
    """Rows of a table, all or a block, by their numbers in the file `source`, as messages give them. `done`: the
    part of the file, 0 to 1, that was read when these rows end; NaN where nobody knows its size.
    """

    rows: NDArray[np.intp]
    source: str
    done: float

    def __len__(self) -> int:
        return len(self.rows)

    def row_of(self, index: int) -> int:
        """The number of the index-th row."""
        return int(self.rows[index])

    @abstractmethod
    def numbers(self, columns: Sequence[Column], may_lack: Collection[Column] = ()) -> Array:
        """The numbers (n, k) of the columns, as written; NaN where a cell of a column in `may_lack` is empty or NaN.
        Raises `FileFormatError` naming row and column of what is no finite number.
        """

    def select(self, kept: NDArray[np.bool_]) -> Self:
        """Some of the rows, by a mask (n,)."""
        return replace(self, rows=self.rows[kept])

    @abstractmethod
    def refuse_lack(self, index: int, column: Column) -> NoReturn:
        """Raise the `FileFormatError` for an empty cell."""


@dataclass(frozen=True, eq=False)
class OpenTable:
    """A table that is open: the place of each column by its name as the file spells it, no two alike in any case, and
    what reads some columns block by block, once. `source`: the file, as messages name it.
    """

    source: str
    places: dict[str, int]
    bodies: Callable[[Collection[Column]], Iterator[Body]]

    def told(self, columns: Collection[Column], advance: Advance) -> Iterator[Body]:
        """The blocks; `advance` is told how far they got."""
        for body in self.bodies(columns):
            yield body
            advance(body.done)


@dataclass(frozen=True)
class ColumnRoles:
    """Which columns of a table are what; empty where it has none. `convention` makes rotations of `orientation`; None:
    its numbers stay as they are. `numbered`: where columns are told by their number alone, how many of such the table
    has, all that tells it from another.
    """

    wrench: tuple[Column, ...]
    convention: Convention | None
    orientation: tuple[Column, ...]
    t: tuple[Column, ...]
    position: tuple[Column, ...]
    load: tuple[Column, ...]
    saturated: tuple[Column, ...]
    numbered: tuple[int, ...] = ()

    @property
    def of_wrench(self) -> tuple[Column, ...]:
        """What a row has with its wrench or not at all."""
        return *self.wrench, *self.load, *self.saturated

    @property
    def of_pose(self) -> tuple[Column, ...]:
        """What a row has with its orientation or not at all."""
        return *self.orientation, *self.position

    @property
    def understood(self) -> str:
        """Which column was taken for what, as `fx..fz from "Force X (N)".."Force Z (N)"`; of usual names nothing."""
        parts = []
        for columns in (self.wrench, self.orientation, self.t, self.position, self.load, self.saturated):
            if not all(column.is_usual for column in columns):
                angles = columns == self.orientation and self.convention is not None and self.convention.angle_unit
                parts.append(taken_for(columns) + (f" as {self.convention.name}" if self.convention and angles else ""))
        return ", ".join(parts)

    @property
    def units_read(self) -> dict[str, str]:
        """The stated units that are not the usual ones, as `--units` takes them, by their quantity."""
        usual_angle = self.convention.angle_unit if self.convention is not None else None
        return {
            quantity: symbol(columns[0].unit)
            for quantity, columns in self.with_units.items()
            if columns[0].unit and columns[0].per_si != per_si(quantity, (usual_angle or "") * (quantity == "angle"))
        }

    @property
    def with_units(self) -> dict[str, tuple[Column, ...]]:
        """The columns whose unit decides what is read, by their quantity."""
        angles = self.orientation if self.convention is not None and self.convention.angle_unit else ()
        parts = {"force": self.wrench[:3], "torque": self.wrench[3:], "angle": angles}
        return {quantity: columns for quantity, columns in parts.items() if columns}

    @property
    def columns(self) -> tuple[Column, ...]:
        """All of them."""
        return *self.t, *self.of_wrench, *self.of_pose


def counted_times(rate: float) -> str:
    """The name of the column of times that a table of so many rows a second is given."""
    return f"rows at {rate:g} Hz"


def taken_for(columns: Sequence[Column]) -> str:
    """What columns of one kind, or of several one after the other, were taken for."""
    if all(column.is_usual for column in columns):
        return " ".join(column.name for column in columns)
    parts = [columns[:3], columns[3:]] if len(columns) == len(WRENCH_COLUMNS) else [columns]
    return ", ".join(map(_of_one_kind, parts)) if columns else ""


def _of_one_kind(columns: Sequence[Column]) -> str:
    of_angle = {per_si: unit for unit, per_si in ANGLE.items()}  # the only ones that nobody needs to state
    units = [f" in {each.unit or of_angle[each.per_si]}" if each.per_si != 1.0 else "" for each in columns]
    names = [f'"{shown(column.name)}"' for column in columns]
    if columns[-1].role == NANOSECONDS:
        return f"t from {' and '.join(names)}"
    if len(sliced := list(with_slices(without_own_name(column.name) for column in columns))) == 1 < len(columns):
        return f'{columns[0].role}..{columns[-1].role} from "{shown(sliced[0])}"{units[0]}'
    if len(columns) > 1 and len(set(units)) == 1 and _in_turn([column.name for column in columns]):
        return f"{columns[0].role}..{columns[-1].role} from {names[0]}..{names[-1]}{units[0]}"
    taken = zip(columns, names, units, strict=True)
    return ", ".join(f"{column.role} from {name}{unit}" for column, name, unit in taken)


def _in_turn(names: list[str]) -> bool:
    """Whether names differ in an axis or a number only, which go on by one."""
    lower = [name.lower() for name in names]
    before, after = _alike(lower), _alike([name[::-1] for name in lower])
    parts = [name[before : len(name) - after] for name in lower]
    if parts[0].isdecimal() and all(part.isdecimal() for part in parts):
        return [int(part) - int(parts[0]) for part in parts] == list(range(len(parts)))
    return " ".join(parts) in ("x y z", "x y z w", "w x y z", "a b c", "w p r", "roll pitch yaw")


def _alike(names: list[str]) -> int:
    """How many letters names begin with that are the same in all of them."""
    return sum(1 for _ in takewhile(lambda letters: len(set(letters)) == 1, zip(*names, strict=False)))


def places_of(names: Iterable[str], source: str) -> dict[str, int]:
    """The place of each column by its name. Raises `FileFormatError` for a name twice, in any case, and too much."""
    places: dict[str, int] = {}
    lower: set[str] = set()
    for place, name in enumerate(names):
        if place == MOST_COLUMNS or len(name) > LONGEST_NAME:
            what = f"more than {place} columns" if place == MOST_COLUMNS else f"a column's name of {len(name)} letters"
            raise FileFormatError(f"{source}: found {what}, expected columns of a recording: leave out what is none")
        if name.lower() in lower:
            raise FileFormatError(f"{source}: column {shown(name)} is there twice, expected once: rename or remove one")
        if name:
            places[name] = place
            lower.add(name.lower())
    return places


def with_slices(names: Iterable[str]) -> Iterator[str]:
    """Columns' names, elements of a list that follow each other as one slice of it."""
    parts = [(name, re.fullmatch(r"(.*)\[(\d+)\]", name)) for name in names]
    of_list = [(part and (part[1], int(part[2]) - k), name) for k, (name, part) in enumerate(parts)]
    for one, group in groupby(of_list, key=itemgetter(0)):
        members = [name for _, name in group]
        first = 0 if one is None else int(members[0][len(one[0]) + 1 : -1])
        yield from members if one is None else [f"{one[0]}[{first}:{first + len(members)}]"]


def without_own_name(element: str) -> str:
    """`a[3]` of `a[3].fx`, an element of a list that has a name of its own."""
    return re.sub(r"(?<=\d\])\..*$", "", element)


def listed(places: Iterable[str]) -> str:
    """The columns' names as a message can show them."""
    return some_of(map(shown, with_slices(places)), 20)


def shown(name: str, length: int = 40) -> str:
    """A column's name as a message can show it: short, begin and end of it, and without control characters."""
    short = name if len(name) <= length else f"{name[: length // 2]}…{name[1 - length // 2 :]}"
    return "".join(letter if letter.isprintable() else "?" for letter in short)
