"""What a recording holds of contact-free poses before anything is made of how it writes its orientation.

The poses are those that `calibrate` takes: of a stream its still segments, of a table its rows at one orientation, but
each visit for itself, so that what belongs to the next or the previous one can be tried.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..errors import FileFormatError
from ..estimation.noise import in_time
from ..files import name_of
from ..geometry.arrays import Array
from ..geometry.orientation import Convention
from ..samples.recorded_poses import is_stream, recorded_poses
from ..samples.samples import Samples
from .options import IN_BASE_AXES, Options
from .read import read_as_bag, read_streams
from .tables.columns import Column, ColumnRoles, Naming, OpenTable
from .tables.orientations import orientation_columns, whole_sets
from .tables.roles import roles_beside, wrench_columns
from .tables.table import WrittenRows, in_seconds, open_table, rotations, written_rows
from .tables.units import ANGLE

ColumnSet: TypeAlias = tuple[tuple[str, ...], Array]
APART = 0.01, 0.001
"""Of the range of an orientation's numbers, and of the largest: more is another pose."""


@dataclass(frozen=True, eq=False)
class Written:
    """Contact-free rows of a recording as they stand, or poses of them: `wrench` (n, 6) N and N m, in the file's sign
    and axes; `t` (n,) s or None.

    `sets` of columns that could be an orientation, by their names, whose `places` in the file are told, and their
    numbers (n, k): one that was asked for or that the names tell, which `convention` makes the rotations `stated`
    (n, 3, 3) of, `in_degrees` or not; else all; of a bag, whose messages say how they are meant, none. `complaint`: why
    there is no convention, or no rotation. `in_rows`: whether each wrench came with an orientation of its own.
    """

    source: str
    wrench: Array
    t: Array | None
    stated: Array | None
    wrench_columns: tuple[Column, ...] = ()
    sets: tuple[ColumnSet, ...] = ()
    places: Mapping[str, int] = field(default_factory=dict)
    convention: Convention | None = None
    in_degrees: bool = False
    complaint: str | None = None
    in_rows: bool = False

    def at(self, rows: NDArray[np.intp], wrench: Array) -> Written:
        """Poses: the orientations as they stand in `rows`, each with a mean `wrench`."""
        return replace(
            self,
            wrench=wrench,
            t=None if self.t is None else self.t[rows],
            sets=tuple((names, numbers[rows]) for names, numbers in self.sets),
            stated=None if self.stated is None else self.stated[rows],
        )


def poses_of(written: Written, R_base_flange: Array) -> Written:
    """The poses of a recording where its orientation makes the rotations (n, 3, 3), whatever that is worth: an arm
    stands still by any convention. Raises `InputError` as `calibrate` does for a recording without poses.
    """
    samples = Samples(written.wrench, R_base_flange, written.t, source=written.source)
    stream = is_stream(samples)
    t = samples.t if stream and samples.t is not None else np.arange(len(samples), dtype=np.float64)
    recorded = recorded_poses(replace(samples, t=t), len(samples) + 1, stream)
    poses, rows, means = in_time(recorded.visits or recorded.poses), [], []
    order = np.argsort(t, kind="stable")
    sizes = [(x, float(np.ptp(x, axis=0).max()), float(np.abs(x).max())) for _, x in written.sets]
    sets = [(numbers, max(APART[0] * span, APART[1] * most)) for numbers, span, most in sizes]
    for pose in poses:
        start, end = np.array([pose.t_start, pose.t_end], dtype=np.float64)
        during = order[np.searchsorted(t[order], start) : np.searchsorted(t[order], end, "right")]
        if stream:
            off = np.sum((samples.R_base_flange[during] - pose.R_base_flange) ** 2, axis=(1, 2))
            rows.append(during[np.argmin(off)])
            means.append(pose.wrench)
            continue
        for at_one in _groups(sets, during):
            rows.append(at_one[0])
            means.append(written.wrench[at_one].mean(axis=0))
    return written.at(np.array(rows, dtype=np.intp), np.array(means).reshape(-1, 6))


def _groups(sets: list[tuple[Array, float]], rows: NDArray[np.intp]) -> Iterator[NDArray[np.intp]]:
    """Rows of one pose each (n,), by how near the numbers of an orientation are: two poses may be one by a convention
    that is not theirs. `sets` of numbers, and by how much they differ from pose to pose.
    """
    while len(rows):
        near = np.ones(len(rows), dtype=bool)
        for numbers, apart in sets:
            near &= np.abs(numbers[rows] - numbers[rows[0]]).max(axis=1) <= apart
        yield rows[near]
        rows = rows[~near]


def rows_as_written(path: str | Path, options: Options) -> Written:
    """Read a recording without making rotations of its orientation, but for those that it states. Raises as `read`, but
    not for numbers that are no rotation, nor where `auto` cannot choose. Rows with a saturated channel or a load are
    left out. A wrench without an orientation in its row has the nearest in time.
    """
    if read_as_bag(path, options):
        return _of_bag(path, options)
    table = open_table(path, options)
    pose_table = table if options.pose_file is None else open_table(options.pose_file, options)
    of_wrench = wrench_columns(table, options)
    beside_the_wrench = options if pose_table is table else replace(options, wrench_columns=None)
    convention, sets, complaint = _orientation(pose_table, beside_the_wrench)
    columns = [column for columns in sets for column in columns]
    as_they_stand = [replace(column, per_si=1.0) for column in columns]
    if pose_table is table:
        blocks = pose_blocks = _blocks(table, roles_beside(table, options, of_wrench, None, as_they_stand))
    else:
        blocks = _blocks(table, roles_beside(table, options, of_wrench, None, []))
        pose_blocks = _blocks(pose_table, roles_beside(pose_table, options, [], None, as_they_stand))
    stated = None
    if convention is not None:
        try:
            stated = np.concatenate([_rotations(block, convention, sets[0]) for block in pose_blocks])
        except FileFormatError as error:
            complaint = str(error)
    posed = np.concatenate([block.has_orientation for block in pose_blocks])
    loaded = [((block.saturated == 1.0).any(axis=1) | (block.load > 0.0).any(axis=1)) for block in blocks]
    free = ~np.isnan(np.concatenate([block.wrench for block in blocks])).any(axis=1) & ~np.concatenate(loaded)
    t, pose_t = _times(blocks), _times(pose_blocks)
    in_rows = pose_table is table and not (free & ~posed).any()
    if in_rows:
        place = (np.cumsum(posed) - 1)[free]
    elif t is None or pose_t is None:
        raise FileFormatError(
            f"{name_of(path)}: found no column t, expected one in each of two files, on one clock: add the times"
        )
    elif options.wrench_frame == "base":
        raise FileFormatError(f"{name_of(path)}: {IN_BASE_AXES}")
    else:
        place = _nearest(t[free], pose_t[posed])
    numbers = np.concatenate([block.orientation[block.has_orientation] for block in pose_blocks])[place]
    of_sets = np.split(numbers, np.cumsum([len(columns) for columns in sets])[:-1].tolist(), axis=1)
    names = [tuple(column.name for column in columns) for columns in sets]
    return Written(
        source=name_of(path),
        wrench_columns=tuple(of_wrench),
        wrench=np.concatenate([block.wrench for block in blocks])[free],
        t=None if t is None else t[free],
        sets=tuple(zip(names, of_sets, strict=True)),
        places={column.name: column.place for column in columns},
        convention=convention,
        in_degrees=any(column.per_si == ANGLE["deg"] for column in columns),
        stated=None if stated is None else stated[place],
        complaint=complaint,
        in_rows=in_rows,
    )


def _of_bag(path: str | Path, options: Options) -> Written:
    streams = read_streams(path, replace(options, sign="pull", inverse_orientation=False))
    wrench, orientation = streams.wrench, streams.orientation
    wrench = wrench.select(np.isfinite(wrench.wrench).all(axis=1))
    stated = orientation.R_base_flange[_nearest(wrench.t, orientation.t)]
    return Written(name_of(path), wrench.wrench, wrench.t, stated)


def _orientation(table: OpenTable, naming: Naming) -> tuple[Convention | None, list[list[Column]], str | None]:
    """What the orientation's columns are, or all that could be one, and the complaint."""
    try:
        convention, columns = orientation_columns(table, naming)
    except FileFormatError as error:
        if naming.orientation != "auto" or not (sets := whole_sets(table, naming)):
            raise
        return None, sets, str(error)
    return convention, [columns], None


def _blocks(table: OpenTable, roles: ColumnRoles) -> list[WrittenRows]:
    return [written_rows(body, roles) for body in table.bodies(roles.columns)]


def _rotations(block: WrittenRows, convention: Convention, columns: list[Column]) -> Array:
    there = block.has_orientation
    in_si = block.orientation[there] / np.array([column.per_si for column in columns])
    return rotations(convention, columns, in_si, block.body, there)


def _times(blocks: list[WrittenRows]) -> Array | None:
    return in_seconds(np.concatenate([block.t for block in blocks]), blocks[0].roles.t) if blocks else None


def _nearest(t: Array, of: Array) -> NDArray[np.intp]:
    """The place (n,) of the time in `of` (m,) that is nearest to each of t (n,)."""
    order = np.argsort(of, kind="stable")
    after = np.clip(np.searchsorted(of[order], t), 1, len(of) - 1) if len(of) > 1 else np.zeros(len(t), dtype=np.intp)
    nearer = np.where(t - of[order][after - 1] < of[order][after] - t, after - 1, after)
    return order[nearer]
