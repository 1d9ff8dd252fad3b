"""Which columns of a table are what, in a file of any kind: found by name, units by suffix (design: section 6)."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import NoReturn, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ...errors import FileFormatError
from ...geometry.arrays import Array
from ...geometry.orientation import CONVENTIONS, RECOGNISED_BY_NAME, Convention, convention

ROWS = 2**15
"""Rows that are read at once: some 10 MB."""

Advance: TypeAlias = Callable[[float], None]
"""Is told the part of a recording, 0 to 1, that has been read; NaN where nobody knows its size."""

FORCE = {"": 1.0, "n": 1.0}
TORQUE = {"": 1.0, "nm": 1.0, "nmm": 1e3}
TIME = {"": 1.0, "s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}
LENGTH = {"": 1.0, "m": 1.0, "mm": 1e3}
LOAD = {"g": 1e3, "kg": 1.0}
NO_UNIT = {"": 1.0}
ANGLE = {"deg": 180.0 / np.pi, "rad": 1.0}
"""These say how many of a unit make one of SI: a division rounds once, so that 300 ms are 0.3 s to the last digit."""

WRENCH_COLUMNS = ("fx", "fy", "fz", "tx", "ty", "tz")
SATURATED = "saturated"
"""1 or true in the rows in which a channel of the sensor stood at its limit."""


@dataclass(frozen=True)
class Naming:
    """Which columns of a table are what, as far as it was stated.

    `orientation` as in `Options`; None: of two files the one with the wrenches. `wrench_columns` "a,b,c,d,e,f" or a
    slice of a list, "observation.wrench[0:6]"; `time_column` "NAME" or "NAME:UNIT"; `units` "force=kgf,torque=Nmm";
    `hdf5` "wrench=/path,pose=/path,time=/path"; `episode`: which one of a set of recordings.
    """

    orientation: str | None = "auto"
    wrench_columns: str | None = None
    time_column: str | None = None
    units: str | None = None
    hdf5: str | None = None
    episode: int | None = None


AS_NAMED = Naming()


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

    def numbers(self, columns: Sequence[Column], may_lack: Collection[Column] = ()) -> Array:
        """The numbers (n, k) of the columns, as written; NaN where a cell of a column in `may_lack` is empty.

        Raises `FileFormatError` naming row and column of what is no finite number.
        """

    def select(self, kept: NDArray[np.bool_]) -> Body:
        """Some of the rows, by a mask (n,)."""

    def row_of(self, index: int) -> int:
        """The number of the index-th row, as a message gives it."""

    def refuse_lack(self, index: int, column: Column) -> NoReturn:
        """Raise the `FileFormatError` for an empty cell."""


@dataclass(frozen=True, eq=False)
class OpenTable:
    """A table that is open: the place of each column by its name, in small letters, and what reads some columns block
    by block, once. `source`: the file, as messages name it.
    """

    source: str
    places: dict[str, int]
    bodies: Callable[[Collection[Column]], Iterator[Body]]

    def told(self, columns: Collection[Column], advance: Advance | None) -> Iterator[Body]:
        """The blocks; `advance` is told how far they got."""
        for body in self.bodies(columns):
            yield body
            if advance is not None:
                advance(body.done)


@dataclass(frozen=True)
class ColumnRoles:
    """Which columns of a table are what; empty where it has none.

    `convention` makes rotations of `orientation`; None: its numbers stay as they are. `gaps`: whether a row may lack
    its wrench or its orientation, as in a recording with times.
    """

    wrench: tuple[Column, ...]
    convention: Convention | None
    orientation: tuple[Column, ...]
    t: tuple[Column, ...]
    position: tuple[Column, ...]
    load: tuple[Column, ...]
    saturated: tuple[Column, ...]
    gaps: bool

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
        """Which column was taken for what, as `fx from "Force X (N)", ...`; empty where all bear the usual names."""
        return ""

    @property
    def columns(self) -> tuple[Column, ...]:
        """All of them."""
        return *self.t, *self.of_wrench, *self.of_pose


def roles_of(table: OpenTable, naming: Naming, *, wrench: bool = True) -> ColumnRoles:
    """Which columns of a recording are what.

    Args:
        table: the recording, or one of two files.
        naming: what was stated.
        wrench: False: of two files the one with the orientations, no wrench is looked for.

    Raises:
        FileFormatError: for a column that is missing, times of two files among them.
    """
    of_wrench = wrench_columns(table) if wrench else []
    chosen, angles = (None, []) if naming.orientation is None else orientation_columns(table, naming.orientation)
    roles = roles_beside(table, of_wrench, chosen, angles)
    if not roles.t and not (of_wrench and angles):
        raise FileFormatError(
            f"{table.source}: found no column t, expected one in each of two files, on one clock: add the times (found "
            f"{listed(table.places)})"
        )
    return roles


def roles_beside(
    table: OpenTable, wrench: list[Column], chosen: Convention | None, angles: list[Column]
) -> ColumnRoles:
    """What the other columns are where those of the wrench and of the orientation are chosen already."""
    taken = {column.place for column in angles}
    t = optional(table, ["t"], TIME, taken)
    if wrench and "load" in table.places:
        raise FileFormatError(f"{table.source}: column load has no unit, expected load_g or load_kg: rename it")
    return ColumnRoles(
        wrench=tuple(wrench),
        convention=chosen,
        orientation=tuple(angles),
        t=t,
        position=optional(table, ["x", "y", "z"], LENGTH, taken) if chosen else (),
        load=optional(table, ["load"], LOAD, taken) if wrench else (),
        saturated=optional(table, [SATURATED], NO_UNIT, taken) if wrench else (),
        gaps=bool(t),
    )


def wrench_columns(table: OpenTable) -> list[Column]:
    """The columns fx..tz. Raises `FileFormatError` where one is not there."""
    columns = []
    for name in WRENCH_COLUMNS:
        column = find(table, name, TORQUE if name[0] == "t" else FORCE)
        if column is None:
            raise FileFormatError(
                f"{table.source}: found no column {name}, expected fx fy fz tx ty tz and an orientation: add it, or "
                f"rename the one that holds it (found {listed(table.places)})"
            )
        columns.append(column)
    return columns


def orientation_columns(table: OpenTable, orientation: str) -> tuple[Convention, list[Column]]:
    """The columns of the orientation, and what they are; `orientation` as in `Options`. Raises `FileFormatError`."""
    if orientation != "auto":
        chosen = convention(orientation)
        columns = _columns_of(table, chosen)
        missing = [name for name, column in zip(chosen.columns, columns, strict=True) if column is None]
        if missing:
            wanted = ",".join(shown(name) for name in chosen.columns)
            raise FileFormatError(
                f"{table.source}: found no column {shown(missing[0])}, expected {wanted} for {chosen.name}: name "
                f"the columns, as in --orientation NAME:COLUMNS (found {listed(table.places)})"
            )
        return chosen, [column for column in columns if column is not None]
    candidates = {name: _columns_of(table, CONVENTIONS[name]) for name in RECOGNISED_BY_NAME}
    whole = {name: [c for c in columns if c is not None] for name, columns in candidates.items() if None not in columns}
    if len(whole) == 1:
        name, complete = next(iter(whole.items()))
        return CONVENTIONS[name], complete
    if whole:
        raise FileFormatError(
            f"{table.source}: found the columns of {' and of '.join(whole)}, expected one orientation: choose with "
            f"--orientation {next(iter(whole))}"
        )
    for name, columns in candidates.items():
        if sum(column is not None for column in columns) > len(columns) / 2:
            missing = [want for want, c in zip(CONVENTIONS[name].columns, columns, strict=True) if c is None]
            raise FileFormatError(f"{table.source}: found no column {missing[0]}, expected all of {name}: add it")
    raise FileFormatError(
        f"{table.source}: found no orientation columns, expected qx qy qz qw, r11..r33, a b c (KUKA), w p r (FANUC) or "
        f"rx ry rz (UR): rename them, or say --orientation NAME:COLUMNS (found {listed(table.places)})"
    )


def whole_sets(table: OpenTable) -> list[list[Column]]:
    """Every set of columns that bears the names of a convention, each once."""
    sets: dict[tuple[str, ...], list[Column]] = {}
    for wanted in CONVENTIONS.values():
        columns = [column for column in _columns_of(table, wanted) if column is not None]
        if len(columns) == len(wanted.columns):
            sets.setdefault(tuple(sorted(column.name for column in columns)), columns)
    return list(sets.values())


def _columns_of(table: OpenTable, wanted: Convention) -> list[Column | None]:
    if wanted.angle_unit is None:
        return [find(table, name, NO_UNIT) for name in wanted.columns]
    stated = {"": ANGLE[wanted.angle_unit], **ANGLE}
    columns = []
    for name in wanted.columns:
        unit = name.rpartition("_")[2]
        columns.append(find(table, name, {"": ANGLE[unit]} if unit in ANGLE else stated))
    return columns


def find(table: OpenTable, name: str, units: dict[str, float]) -> Column | None:
    """The column `name` or `name_unit`; None where there is none. Raises `FileFormatError` where there are both."""
    spelled = {name if not unit else f"{name}_{unit}": per_si for unit, per_si in units.items()}
    there = [Column(table.places[key], key, per_si) for key, per_si in spelled.items() if key in table.places]
    if len(there) > 1:
        names = " and ".join(column.name for column in there)
        raise FileFormatError(f"{table.source}: found columns {names}, expected one of them: remove the other")
    return there[0] if there else None


def optional(
    table: OpenTable, names: list[str], units: dict[str, float], taken: Collection[int] = ()
) -> tuple[Column, ...]:
    """The columns `names` if all are there and none is part of the orientation, at places `taken`; else none."""
    there = [find(table, name, units) for name in names]
    columns = tuple(column for column in there if column is not None and column.place not in taken)
    return columns if len(columns) == len(names) else ()


def places_of(names: Iterable[str], source: str) -> dict[str, int]:
    """The place of each column by its name. Raises `FileFormatError` for a name that is there twice."""
    places: dict[str, int] = {}
    for place, name in enumerate(names):
        if name in places:
            raise FileFormatError(f"{source}: column {shown(name)} is there twice, expected once: rename or remove one")
        if name:
            places[name] = place
    return places


def listed(places: Iterable[str]) -> str:
    """The columns' names as a message can show them."""
    names = [shown(name) for name in places]
    return ", ".join(names[:20]) + (", ..." if len(names) > 20 else "")


def shown(name: str, length: int = 40) -> str:
    """A column's name as a message can show it: short, and without control characters."""
    return "".join(letter if letter.isprintable() else "?" for letter in name[:length])
