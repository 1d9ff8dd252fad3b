"""What the rows of a recording's table hold, whatever kind of file it is."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...errors import FileFormatError, InputError
from ...files import name_of
from ...geometry.arrays import Array, Rows, column
from ...geometry.orientation import Convention, require_whole_turn
from ...geometry.ranges import LOAD_KG, TIME, Range, per_second
from ...samples.samples import CODES, LARGEST_READING, ReadAs, lost, stands_for_none
from ...statistics import counted
from . import csv, hdf5, parquet
from .columns import AS_NAMED, ROWS, Advance, Body, Column, ColumnRoles, Naming, OpenTable, unheard, with_slices
from .csv import open_csv
from .episodes import at_rate, one_episode
from .hdf5 import is_hdf5, open_hdf5
from .parquet import is_parquet, open_parquet
from .roles import roles_of
from .units import ANGLE

SUFFIXES = (*csv.SUFFIXES, *parquet.SUFFIXES, *hdf5.SUFFIXES)


@dataclass(frozen=True, eq=False)
class Table(Rows):
    """What rows of a file hold, as its writer meant it: SI units, the file's own sign, frame and direction of rotation.

    `wrench` (n, 6), `orientation` (n, 3, 3), `t` (n,), `position` (n, 3), `load_mass` (n,), `saturated` (n,): NaN in a
    row of a recording with times that lacks it, None where no row has it. `source` and `read_as` as in `Samples`.
    """

    wrench: Array = field(metadata=column(6))
    orientation: Array = field(metadata=column(3, 3))
    t: Array | None = field(metadata=column())
    position: Array | None = field(metadata=column(3))
    load_mass: Array | None = field(metadata=column())
    saturated: NDArray[np.bool_] | None = field(metadata=column(kind=np.bool_))
    source: str
    read_as: ReadAs

    @property
    def has_wrench(self) -> NDArray[np.bool_]:
        """Whether a row (n,) has a wrench, or a part of one, which is no reading."""
        return np.asarray(~np.isnan(self.wrench).all(axis=1))

    @property
    def has_reading(self) -> NDArray[np.bool_]:
        """Whether a row (n,) has a whole wrench."""
        return np.asarray(~np.isnan(self.wrench).any(axis=1))

    @property
    def has_orientation(self) -> NDArray[np.bool_]:
        """Whether a row (n,) has an orientation."""
        return ~np.isnan(self.orientation[:, 0, 0])

    @property
    def lacks_orientations(self) -> bool:
        """Whether a wrench has no orientation in its row."""
        return bool((self.has_wrench & ~self.has_orientation).any())


@dataclass(frozen=True, eq=False)
class WrittenRows:
    """A block of rows before rotations are made of its orientation: the `roles` of its columns, and what is in each of
    them, SI: `t` (n, 1), `wrench` (n, 6), `load` (n, 1), `saturated` (n, 1), `orientation` (n, k), `position` (n, 3),
    or (n, 0) where there is none; `has_wrench`, or a part of one, and `has_orientation` (n,).
    """

    body: Body
    roles: ColumnRoles
    t: Array
    wrench: Array
    load: Array
    saturated: Array
    orientation: Array
    position: Array
    has_wrench: NDArray[np.bool_]
    has_orientation: NDArray[np.bool_]


def open_table(path: str | Path, naming: Naming = AS_NAMED, rows: int = ROWS) -> OpenTable:
    """The columns of a table, and what reads them block by block; of a set of recordings one. Raises `FileAccessError`,
    `FileFormatError`, and `InputError` for datasets of HDF5 stated of another file, and a rate beside times.
    """
    table = one_episode(open_set(path, naming, rows), naming.episode)
    return table if naming.rate is None else at_rate(table, naming, naming.rate)


def open_set(path: str | Path, naming: Naming = AS_NAMED, rows: int = ROWS) -> OpenTable:
    """The same with all the recordings of a set."""
    if is_hdf5(path):
        return open_hdf5(path, naming, rows)
    if naming.hdf5 is not None:
        raise InputError(f"{path}: found no HDF5 file, and hdf5 {naming.hdf5}, which is for those: leave it out")
    return open_parquet(path, rows, naming.episode) if is_parquet(path) else open_csv(path, rows, naming)


def tables(
    path: str | Path, naming: Naming = AS_NAMED, rows: int = ROWS, advance: Advance = unheard, *, wrench: bool = True
) -> Iterator[Table]:
    """A table, or a folder of Parquet files, in blocks of about so many `rows`; without a `wrench`, of two files the
    one with the orientations. Raises `FileAccessError`, and `FileFormatError` naming the file, the row and the column.
    """
    table = open_table(path, naming, rows)
    roles = roles_of(table, naming, wrench=wrench)
    return (_table(written_rows(body, roles)) for body in table.told(roles.columns, advance))


def _table(written: WrittenRows) -> Table:
    """The rows with rotations made of their orientation. Raises `FileFormatError` for what is none."""
    roles, there, posed, n = written.roles, written.has_wrench, written.has_orientation, len(written.body)
    R = np.full((n, 3, 3), np.nan)
    if roles.convention is not None:
        R[posed] = rotations(roles.convention, roles.orientation, written.orientation[posed], written.body, posed)
    return Table(
        wrench=written.wrench if roles.wrench else np.full((n, 6), np.nan),
        orientation=R,
        t=in_seconds(written.t, roles.t),
        position=written.position if roles.position else None,
        load_mass=np.where(there, written.load[:, 0], np.nan) if roles.load else None,
        saturated=there & (written.saturated[:, 0] == 1.0) if roles.saturated else None,
        source=name_of(written.body.source),
        read_as=_read_as(roles),
    )


def _read_as(roles: ColumnRoles) -> ReadAs:
    """What the columns' names told, and which units were stated."""
    told = {
        "columns": roles.understood,
        "units_read": ",".join(f"{quantity}={unit}" for quantity, unit in roles.units_read.items()),
        "orientation": "" if roles.convention is None else roles.convention.name,
        "numbered": ",".join(map(str, roles.numbered)),
    }
    return {name: what for name, what in told.items() if what}


def without_reading(rows: int) -> str:
    """That so many rows of a recording have none."""
    return (
        f"found no whole reading (nothing, NaN, zeros alone, or -9999 and the like) in {counted(rows, 'row')}: not used"
    )


def read_as_of_both(wrench: Table, pose: Table) -> ReadAs:
    """What two tables told, or one of which some rows have wrenches and others poses."""
    joined = {}
    for name, mark in (("columns", "; "), ("units_read", ","), ("numbered", ",")):
        if told := dict.fromkeys(str(table.read_as[name]) for table in (wrench, pose) if name in table.read_as):
            joined[name] = mark.join(told)
    return {**wrench.read_as, **pose.read_as, **joined}


def written_rows(body: Body, roles: ColumnRoles) -> WrittenRows:
    """What the rows of `body` hold. Raises `FileFormatError` naming row and column of what cannot be."""
    of_wrench, of_pose = roles.of_wrench, roles.of_pose
    may_lack = (*of_wrench, *of_pose) if roles.t else roles.position
    parts = in_si(body, (roles.t, of_wrench, of_pose), may_lack)
    t, with_wrench, with_pose = parts
    wrench, load, saturated = np.split(with_wrench, np.cumsum([len(roles.wrench), len(roles.load)]).tolist(), axis=1)
    per_si = np.array([column.per_si for column in roles.wrench])
    with np.errstate(over="ignore"):
        wrench = np.where(stands_for_none(wrench * per_si, CODES[0]), np.nan, wrench)
    if roles.t and roles.wrench:
        wrench[lost(wrench)] = np.nan
    has_wrench = _rows_there(body, of_wrench, with_wrench, len(roles.wrench), may_be_half=True)
    limit = f"at most {LARGEST_READING:g} N or N m"
    _require(~(np.abs(wrench) > LARGEST_READING), wrench, roles.wrench, body, limit)
    _require(LOAD_KG.holds(load) | np.isnan(load), load, roles.load, body, LOAD_KG)
    _require(TIME.holds(t), t, roles.t, body, TIME)
    is_flag = (saturated == 0.0) | (saturated == 1.0) | np.isnan(saturated)
    _require(is_flag, saturated, roles.saturated, body, "0 or 1")
    _require((t[:, 1:] >= 0.0) & (t[:, 1:] < 1.0), t[:, 1:], roles.t[1:], body, "nanoseconds of 0 to 1e9")
    orientation, position = np.split(with_pose, [len(roles.orientation)], axis=1)
    if roles.t and len(roles.orientation) in (4, 9):  # no quaternion and no matrix is all zeros
        orientation = np.where(np.any(orientation != 0.0, axis=1, keepdims=True), orientation, np.nan)
    has_orientation = _rows_there(body, roles.orientation, orientation, len(roles.orientation))
    return WrittenRows(body, roles, t, wrench, load, saturated, orientation, position, has_wrench, has_orientation)


def in_si(body: Body, groups: Sequence[Sequence[Column]], may_lack: Sequence[Column] = ()) -> list[Array]:
    """The numbers of some groups of columns, SI: (n, k) for each group. Raises as `Body.numbers`."""
    columns = [column for group in groups for column in group]
    values = body.numbers(columns, may_lack) / np.array([column.per_si for column in columns])
    return np.split(values, np.cumsum([len(group) for group in groups])[:-1].tolist(), axis=1)


def whole_columns(table: OpenTable, *groups: Sequence[Column], may_lack: Sequence[Column] = ()) -> list[Array]:
    """All rows of some groups of columns, as `in_si` gives those of a block."""
    blocks = (in_si(body, groups, may_lack) for body in table.bodies([column for group in groups for column in group]))
    return [np.concatenate(parts) for parts in zip(*blocks, strict=True)]


def _rows_there(
    body: Body, columns: Sequence[Column], values: Array, core: int, *, may_be_half: bool = False
) -> NDArray[np.bool_]:
    """The rows (n,) that have what `columns` hold, values (n, k): by the first `core` of them, of which all or none are
    there, unless they `may_be_half`. Raises `FileFormatError` naming a cell that is empty beside others that are not.
    """
    lacking: NDArray[np.bool_] = np.isnan(values)
    there: NDArray[np.bool_] = ~np.all(lacking[:, :core], axis=1)
    half = lacking & there[:, None]
    half[:, :core] &= not may_be_half
    if half.any():
        index, k = (int(place) for place in np.argwhere(half)[0])
        body.refuse_lack(index, columns[k])
    return there


def _require(
    good: NDArray[np.bool_], values: Array, columns: Sequence[Column], body: Body, expected: str | Range
) -> None:
    """Raise `FileFormatError` naming the first of `values` (n, k), SI, that is not good, in its column's unit."""
    if not good.all():
        index, k = (int(place) for place in np.argwhere(~good)[0])
        value, name, per_si = values[index, k] * columns[k].per_si, columns[k].name, columns[k].per_si
        if isinstance(expected, Range):
            unit = columns[k].unit or expected.unit
            expected = replace(expected, least=expected.least * per_si, most=expected.most * per_si, unit=unit)
        raise FileFormatError(
            f"{body.source}: row {body.row_of(index)}, column {name}: found {value:g}, expected {expected}: correct it "
            "or leave the row out"
        )


def in_seconds(t: Array, columns: Sequence[Column]) -> Array | None:
    """Times (n,) s of the columns (n, k) of times, whose sum they are, None where there are none; of a column without a
    unit that is too large for seconds, as what it must be.
    """
    if not columns:
        return None
    times: Array = t.sum(axis=1)
    return times if columns[0].unit or not len(times) else times / per_second(float(times[0]))


def rotations(
    convention: Convention,
    columns: Sequence[Column],
    values: Array,
    body: Body,
    rows: NDArray[np.bool_] | slice = slice(None),
) -> Array:
    """Rotations (n, 3, 3) of `values` (n, k) in SI, which are those `rows` of `body`. Raises `FileFormatError` naming
    row and columns of what is none, and of angles in rad beyond a whole turn.
    """
    try:
        angles = convention.angle_unit is not None and convention.name != "ur_rotvec"
        if angles and all(column.per_si == ANGLE["rad"] for column in columns):
            require_whole_turn(values)
        return convention.to_matrices(values)
    except InputError as error:
        row = body.row_of(int(np.arange(len(body))[rows][error.row or 0]))
        names = ",".join(with_slices(column.name for column in columns))
        said = str(error).replace(f"orientation {error.row} is", "found", 1)
        raise FileFormatError(f"{body.source}: row {row}, columns {names}: {said}") from None


def merged(wrenches: Iterator[Table], poses: Iterator[Table]) -> Iterator[tuple[Table, Table]]:
    """Two tables up to the moment at which a block of one of them ends."""
    wrench, pose = next(wrenches), next(poses)
    without_wrench, without_pose = wrench.select(slice(0)), pose.select(slice(0))
    while len(wrench) or len(pose):
        until = min(_end(wrench), _end(pose))
        (wrench_now, wrench_left), (pose_now, pose_left) = _cut(wrench, until), _cut(pose, until)
        yield wrench_now, pose_now
        wrench = wrench_left if len(wrench_left) else next(wrenches, without_wrench)
        pose = pose_left if len(pose_left) else next(poses, without_pose)


def _end(table: Table) -> float:
    return float(table.t[-1]) if table.t is not None and len(table) else np.inf


def _cut(table: Table, until: float) -> tuple[Table, Table]:
    """The rows before the first one that is later than `until`, all where the last one is not; and the others."""
    if table.t is None or _end(table) <= until or not len(table):
        return table, table.select(slice(0))
    first_later = int(np.argmax(table.t > until))
    return table.select(slice(first_later)), table.select(slice(first_later, None))
