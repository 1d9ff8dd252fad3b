"""What the rows of a recording's table hold, whatever kind of file it is.

How a file becomes named columns of numbers is for csv.py and parquet.py; which of them is what, for meaning.py.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...errors import FileFormatError, InputError
from ...geometry.arrays import Array
from ...geometry.orientation import Convention
from ...samples.samples import LARGEST_READING
from .column_names import TIME, Meaning, meaning_of, orientation_columns, require_times, whole_sets, wrench_columns
from .columns import ROWS, Body, Column, optional, require
from .csv import csv_bodies
from .parquet import is_parquet, parquet_bodies, parquet_body

UNIX_TIMES = (1e9, 4.2e9)
"""s: from 2001 to 2103. A column `t` of a thousand, a million or a milliard times as much holds Unix times in ms, us or
ns; no clock that counts seconds gets there.
"""


@dataclass(frozen=True, eq=False)
class Table:
    """What rows of a file hold, as its writer meant it: SI units, the file's own sign, frame and direction of rotation.

    `wrench` (n, 6), `orientation` (n, 3, 3), `t` (n,), `position` (n, 3), `load_mass` (n,), `saturated` (n,) 0 or 1. In
    a recording with times a row may lack its wrench, with load and saturation, or its orientation, with the position:
    NaN. What is in none of the rows is None.
    """

    wrench: Array
    orientation: Array
    t: Array | None
    position: Array | None
    load_mass: Array | None
    saturated: Array | None

    def __len__(self) -> int:
        return len(self.wrench)

    @property
    def has_wrench(self) -> NDArray[np.bool_]:
        """Whether a row (n,) has a wrench."""
        return ~np.isnan(self.wrench[:, 0])

    @property
    def has_orientation(self) -> NDArray[np.bool_]:
        """Whether a row (n,) has an orientation."""
        return ~np.isnan(self.orientation[:, 0, 0])

    def select(self, rows: slice | NDArray[np.bool_]) -> Table:
        """The rows that a slice or a mask picks."""

        def of(values: Array | None) -> Array | None:
            return None if values is None else values[rows]

        return Table(
            self.wrench[rows],
            self.orientation[rows],
            of(self.t),
            of(self.position),
            of(self.load_mass),
            of(self.saturated),
        )


def joined(tables: Sequence[Table]) -> Table:
    """One table of consecutive ones, which have the same columns."""

    def of(values: list[Array | None]) -> Array | None:
        known = [part for part in values if part is not None]
        return np.concatenate(known) if known else None

    return Table(
        np.concatenate([table.wrench for table in tables]),
        np.concatenate([table.orientation for table in tables]),
        of([table.t for table in tables]),
        of([table.position for table in tables]),
        of([table.load_mass for table in tables]),
        of([table.saturated for table in tables]),
    )


@dataclass(frozen=True, eq=False)
class WrittenOrientation:
    """Columns that hold an orientation, by their names in the file, and their numbers (n, k) as they are written."""

    columns: tuple[str, ...]
    numbers: Array


@dataclass(frozen=True, eq=False)
class AsWritten:
    """What a CSV holds before anything is made of its orientation.

    `wrench` (n, 6) N and N m under `wrench_columns`. `convention`: the one that was asked for or that the names tell,
    which makes the rotations `stated` (n, 3, 3) of the one in `orientations`. Where it cannot, `stated` is None; where
    the names do not tell, `convention` is None too, and `orientations` are all sets of columns that could be one;
    `complaint` then says why. `load_mass` as in `Table`.
    """

    wrench: Array
    wrench_columns: tuple[str, ...]
    orientations: tuple[WrittenOrientation, ...]
    convention: Convention | None
    stated: Array | None
    complaint: str | None
    load_mass: Array | None


Reader = Callable[[Collection[Column]], Iterator[Body]]
"""Reads the rows of some columns, all at once or block by block."""


def opened(path: str | Path) -> tuple[dict[str, int], Body]:
    """The place of each column of a table by its name, and all rows. Raises `FileAccessError`, `FileFormatError`."""
    if is_parquet(path):
        return parquet_body(path)
    places, found = csv_bodies(path)
    return places, next(found)


def _blocks(path: str | Path, rows: int) -> tuple[dict[str, int], Reader]:
    """The place of each column of a table by its name, and what reads about `rows` rows at a time."""
    if is_parquet(path):
        return parquet_bodies(path, rows)
    places, found = csv_bodies(path, rows)
    return places, lambda _: found


def tables(path: str | Path, orientation: str = "auto", rows: int = ROWS) -> Iterator[tuple[Table, float]]:
    """A table, about `rows` rows at a time, each with the part of the file, 0 to 1, read by then (NaN: who knows).

    Raises `FileAccessError`, and `FileFormatError` naming the file, the row and the column.
    """
    places, read = _blocks(path, rows)
    source = str(path)
    wrench = wrench_columns(places, source)
    return _tables(read, meaning_of(places, source, wrench, *orientation_columns(places, orientation, source)))


def wrench_tables(path: str | Path, rows: int = ROWS) -> Iterator[tuple[Table, float]]:
    """The same of that one of two files which has the wrenches: it has times, and no orientation is looked for."""
    places, read = _blocks(path, rows)
    meaning = meaning_of(places, str(path), wrench_columns(places, str(path)), None, [])
    return _tables(read, require_times(meaning, places, str(path)))


def pose_tables(path: str | Path, orientation: str = "auto", rows: int = ROWS) -> Iterator[tuple[Table, float]]:
    """The same of that one of two files which has the orientations: it has times, and no wrench is looked for."""
    places, read = _blocks(path, rows)
    meaning = meaning_of(places, str(path), [], *orientation_columns(places, orientation, str(path)))
    return _tables(read, require_times(meaning, places, str(path)))


def times(places: dict[str, int], body: Body) -> Array | None:
    """The times (n,) of a table's rows, s; None where it has none. Raises `FileFormatError`."""
    column = optional(places, ["t"], TIME, set(), body.source)
    return _in_seconds(body.numbers(column)[:, 0] / column[0].per_si, column[0]) if column else None


def orientations(places: dict[str, int], body: Body, orientation: str) -> tuple[Array, set[int]]:
    """Rotations (n, 3, 3) of a table that need not hold readings, and the places of the columns that they are from.

    Raises `FileFormatError` naming the file, the row and the column.
    """
    chosen, columns = orientation_columns(places, orientation, body.source)
    values = body.numbers(columns) / np.array([column.per_si for column in columns])
    return _rotations(chosen, columns, values, body), {column.place for column in columns}


def _tables(read: Reader, meaning: Meaning) -> Iterator[tuple[Table, float]]:
    for body in read([*meaning.t, *meaning.of_wrench, *meaning.of_pose]):
        yield _table(body, meaning), body.done


def _table(body: Body, meaning: Meaning) -> Table:
    """What the rows of `body` hold. Raises `FileFormatError` naming row and column of what cannot be."""
    of_wrench, of_pose = meaning.of_wrench, meaning.of_pose
    columns = [*meaning.t, *of_wrench, *of_pose]
    written = body.numbers(columns, may_lack=[*of_wrench, *of_pose] if meaning.t else ())
    n, values = len(written), written / np.array([column.per_si for column in columns])
    t, wrench, load, saturated, angles, position = np.split(
        values,
        np.cumsum(
            [*map(len, (meaning.t, meaning.wrench, meaning.load, meaning.saturated, meaning.orientation))]
        ).tolist(),
        axis=1,
    )
    there = _rows_there(body, of_wrench, np.hstack([wrench, load, saturated]), len(meaning.wrench))
    _require_wrench_and_load(wrench, load, saturated, meaning, body)
    R = np.full((n, 3, 3), np.nan)
    if meaning.convention is not None:
        posed = _rows_there(body, of_pose, np.hstack([angles, position]), len(meaning.orientation))
        R[posed] = _rotations(meaning.convention, list(meaning.orientation), angles[posed], body, posed)
    return Table(
        wrench if meaning.wrench else np.full((n, 6), np.nan),
        R,
        _in_seconds(t[:, 0], meaning.t[0]) if meaning.t else None,
        position if meaning.position else None,
        np.where(there, load[:, 0], np.nan) if meaning.load else None,
        np.where(there, saturated[:, 0], np.nan) if meaning.saturated else None,
    )


def _rows_there(body: Body, columns: list[Column], values: Array, core: int) -> NDArray[np.bool_]:
    """The rows (n,) that have what `columns` hold, values (n, k): by the first `core` of them, all or none of which are
    there. Raises `FileFormatError` naming a cell that is empty beside others that are not.
    """
    lacking: NDArray[np.bool_] = np.isnan(values)
    there: NDArray[np.bool_] = ~np.all(lacking[:, :core], axis=1)
    half = lacking & there[:, None]
    if half.any():
        index, k = (int(place) for place in np.argwhere(half)[0])
        body.refuse_lack(index, columns[k])
    return there


def _in_seconds(t: Array, column: Column) -> Array:
    """Times in s; of a column without a unit that is too large for seconds, as what it must be (see `UNIX_TIMES`)."""
    if column.name != "t" or not len(t):
        return t
    for per_s in (1e3, 1e6, 1e9):
        if UNIX_TIMES[0] * per_s <= t[0] <= UNIX_TIMES[1] * per_s:
            return t / per_s
    return t


def read_as_written(path: str | Path, orientation: str = "auto") -> AsWritten:
    """Read a table without making rotations of its orientation. Raises as `tables`, but for numbers that are no
    rotation, and where `auto` cannot choose between columns that all could be one.

    Of a recording with times only rows that have a wrench and an orientation are kept, and none with a saturated
    channel.
    """
    places, body = opened(path)
    source = body.source
    of_readings = wrench_columns(places, source)
    convention, complaint, stated = None, None, None
    try:
        convention, told = orientation_columns(places, orientation, source)
        sets = [told]
    except FileFormatError as error:
        complaint = str(error)
        sets = whole_sets(places, source) if orientation == "auto" else []
        if not sets:
            raise
    angle_columns = [column for one in sets for column in one]
    meaning = meaning_of(places, source, of_readings, None, angle_columns)
    of_wrench = meaning.of_wrench
    columns = [*of_wrench, *angle_columns]
    written = body.numbers(columns, may_lack=columns if meaning.t else ())
    in_si = written / np.array([column.per_si for column in columns])
    width = len(of_wrench)
    rows = np.flatnonzero(
        _rows_there(body, of_wrench, in_si[:, :width], 6)
        & _rows_there(body, angle_columns, in_si[:, width:], len(angle_columns))
    )
    load, saturated = in_si[:, 6 : 6 + len(meaning.load)], in_si[:, 6 + len(meaning.load) : width]
    _require_wrench_and_load(in_si[:, :6], load, saturated, meaning, body)
    if meaning.saturated:
        rows = rows[saturated[rows, 0] == 0.0]
    written, in_si, load = written[rows], in_si[rows], load[rows]
    first, *ends = (width + np.cumsum([0, *map(len, sets)])).tolist()
    if convention is not None:
        try:
            stated = _rotations(convention, sets[0], in_si[:, first:], body, rows)
        except FileFormatError as error:
            complaint = str(error)
    orientations = (
        WrittenOrientation(tuple(column.name for column in one), written[:, end - len(one) : end])
        for one, end in zip(sets, ends, strict=True)
    )
    return AsWritten(
        in_si[:, :6],
        tuple(column.name for column in of_readings),
        tuple(orientations),
        convention,
        stated,
        complaint,
        load[:, 0] if meaning.load else None,
    )


def _rotations(
    convention: Convention,
    columns: list[Column],
    values: Array,
    body: Body,
    rows: NDArray[np.bool_] | NDArray[np.intp] | None = None,
) -> Array:
    """Rotations (n, 3, 3) of `values` (n, k) in SI, which are those `rows` of `body`, or all. Raises `FileFormatError`
    naming row and columns of what is none.
    """
    try:
        return convention.to_matrices(values)
    except InputError as error:
        names = ",".join(column.name for column in columns)
        where = ""
        if error.row is not None:
            index = error.row if rows is None else int(np.arange(len(body))[rows][error.row])
            where = f"row {body.row_of(index)}, "
        found = str(error).replace(f"orientation {error.row} is", "found", 1)
        raise FileFormatError(f"{body.source}: {where}columns {names}: {found}") from None


def _require_wrench_and_load(wrench: Array, load: Array, saturated: Array, meaning: Meaning, body: Body) -> None:
    limit = f"at most {LARGEST_READING:g} N or N m"
    require(~(np.abs(wrench) > LARGEST_READING), wrench, list(meaning.wrench), body, limit)
    require(~(load < 0.0), load, list(meaning.load), body, "0 or more")
    require(
        (saturated == 0.0) | (saturated == 1.0) | np.isnan(saturated),
        saturated,
        list(meaning.saturated),
        body,
        "0 or 1",
    )
