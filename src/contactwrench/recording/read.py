"""Recordings of every kind, in blocks, as streams and as samples; the suffix tells the reader."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import TypeAlias

import numpy as np

from ..errors import FileFormatError, InputError
from ..files import name_of
from ..samples.bursts import even_rows
from ..samples.recorded_poses import is_stream
from ..samples.samples import OrientationStream, Samples, Streams, WrenchStream, at_limit
from ..samples.timestamps import begins_anew, counted_on
from .accelerations import with_accelerations
from .bags.open import SUFFIXES_OF_BAGS, is_bag
from .bags.read import bag_batches
from .options import AS_USUAL, Options
from .tables.columns import ROWS, Advance, Tell, unheard
from .tables.doubts import angles_in_doubt, times_in_doubt, turns_little
from .tables.parquet import is_parquet
from .tables.table import SUFFIXES as SUFFIXES_OF_TABLES
from .tables.table import Table, merged, read_as_of_both, tables, without_reading


def table_blocks(path: str | Path, options: Options, rows: int, advance: Advance) -> Iterator[Table]:
    """A table, or a folder of them, with wrench and orientation side by side."""
    return (options.applied(table, path) for table in tables(path, options, rows, advance))


def two_file_blocks(path: str | Path, options: Options, rows: int, advance: Advance) -> Iterator[Streams]:
    """A table of wrenches, and the `pose_file` with the orientations: a block has what both hold up to one moment."""
    pose_path = options.pose_file or path
    wrenches = tables(path, replace(options, orientation=None), rows, advance)
    poses = tables(pose_path, options, rows, wrench=False)
    both = merged(
        (options.applied(table, path) for table in wrenches), (options.applied(table, pose_path) for table in poses)
    )
    return (_streams(wrench, pose, path, pose_path) for wrench, pose in both)


MANY_AT_A_LIMIT = 0.1
"""Of the readings."""
Block: TypeAlias = Table | Streams
Reader: TypeAlias = Callable[[str | Path, Options, int, Advance], Iterator[Block]]

READERS: dict[str, Reader] = {
    **dict.fromkeys(SUFFIXES_OF_TABLES, table_blocks),
    **dict.fromkeys(SUFFIXES_OF_BAGS, bag_batches),
}
"""What gives a recording in blocks of about so many rows, each row once and in order, by its suffix."""


def reader_of(path: str | Path, options: Options = AS_USUAL) -> Reader:
    """The reader of a recording: by the suffix of a file, by what is in a folder, and of two files where `options`
    names the second.

    Raises `FileFormatError` for a suffix of none, and `InputError` for what `options` says of another kind.
    """
    reader = _by_name(Path(name_of(path)) if not isinstance(path, Path) else path)
    if options.pose_file is not None:
        if bags := [file for file in (path, options.pose_file) if _by_name(Path(file)) is bag_batches]:
            raise InputError(f"{bags[0]}: found a bag as one of two files, expected tables: give it alone")
        reader = two_file_blocks
    options.require_for(path, bag=reader is bag_batches)
    return reader


def _by_name(path: Path) -> Reader:
    if os.path.isdir(path):
        return bag_batches if is_bag(path) and not is_parquet(path) else table_blocks
    if (suffix := path.suffix.lower()) not in READERS:
        raise FileFormatError(
            f"{path}: found the suffix {suffix}, expected .csv, .parquet, .h5, .bag, .db3 or .mcap: export the "
            "recording as one of them"
        )
    return READERS[suffix]


def read_streams(path: str | Path, options: Options = AS_USUAL) -> Streams:
    """A recording as it is, each stream at its own times. Of one table a row belongs to both streams, or to one where
    its other cells are empty. Raises as `read`.

    Args:
        path: the file or folder.
        options: how it is written.

    Returns:
        Wrench in N and N m, sensor axes, pull sign, NaN where there is none; orientations of `R_base_flange`; s.
    """
    return Streams.concatenate(list(batches(path, options)))


def batches(
    path: str | Path, options: Options = AS_USUAL, rows: int = ROWS, advance: Advance = unheard, *, every: bool = False
) -> Iterator[Streams]:
    """The same in consecutive batches of at most about `rows` rows, each row once and in order; memory for one of them.
    Of a table of pairs `every` row is a reading, if of no numbers. Raises as `read`, at once or at a batch.
    """
    if every and (pairs := pairs_in_batches(path, options, rows, advance)) is not None:
        return (_streams(table, table, path, path, every=not table.lacks_orientations) for table in pairs)
    return (_as_streams(block, path) for block in reader_of(path, options)(path, options, rows, advance))


def pairs_in_batches(
    path: str | Path, options: Options = AS_USUAL, rows: int = ROWS, advance: Advance = unheard
) -> Iterator[Table] | None:
    """A table whose rows are pairs of wrench and orientation, `rows` at a time, memory for one of them. None
    where the orientation has to be brought to the wrench's times: for a bag, two files, or a table in whose first
    rows a wrench has no orientation of its own. Raises as `read`.
    """
    if reader_of(path, options) is not table_blocks:
        return None
    blocks = table_blocks(path, options, rows, advance)
    first = next(blocks)
    return None if first.lacks_orientations else chain([first], blocks)


def read_samples(
    path: str | Path, options: Options, advance: Advance = unheard, tell: Tell = unheard, begin: Tell = unheard
) -> Samples:
    """A recording as samples: of a table in which no wrench lacks an orientation, the rows that have both; else the
    orientation is brought to the wrench's times, `begin` hears that this begins, and `tell` how. Raises as `read`.

    The delay between two streams, of free readings, is applied where it is significant. Where a recording with times
    does not say which channels stood at their limits, its readings do.
    """
    blocks = list(reader_of(path, options)(path, options, ROWS, advance))
    if columns := blocks[0].read_as.get("columns"):
        tell(f"columns: {columns}")
    paired = [block for block in blocks if isinstance(block, Table) and not block.lacks_orientations]
    if len(paired) == len(blocks):
        whole = Table.concatenate(paired)
        said = (without_reading(lacking),) if (lacking := int(np.sum(~whole.has_reading))) else ()
        return _completed(samples_of(whole, path), path, options, tell, said)
    from ..samples.delay import on_one_clock

    begin(f"finding the delay in {Path(path).name}")
    streams = Streams.concatenate([_as_streams(block, path) for block in blocks])
    if streams.wrench.saturated is None:
        streams = replace(streams, wrench=replace(streams.wrench, saturated=at_limit(streams.wrench.wrench)))
    samples, notes = on_one_clock(streams)
    both = samples.source if options.pose_file is None else f"{samples.source}, {name_of(options.pose_file)}"
    return _completed(replace(samples, damage=streams.damage, source=both), path, options, tell, notes)


def _completed(samples: Samples, path: str | Path, options: Options, tell: Tell, before: tuple[str, ...]) -> Samples:
    """With an accelerometer's readings, and what is doubtful in how angles were read; `tell` hears of times, and of
    many readings at a limit, which leave too little of what will be asked for.
    """
    samples, notes = even_rows(samples)
    samples = with_accelerations(samples, path, options)
    if begins_anew(samples) and is_stream(samples):
        samples, anew = counted_on(samples)
        notes += anew
    for note in (*before, *notes):
        tell(note)
    if samples.saturated is None and samples.t is not None:
        samples = replace(samples, saturated=at_limit(samples.wrench))
    if samples.saturated is not None and samples.saturated.sum() > MANY_AT_A_LIMIT * len(samples):
        tell(f"{samples.unsaturated()[1][0]}: set the sensor's range larger, or load it less")
    if reader_of(path, options) is bag_batches:
        return samples
    if said := times_in_doubt(path, options, samples.t):
        tell(said)
    doubt = angles_in_doubt(options.pose_file or path, options) if turns_little(samples.R_base_flange) else ""
    return replace(samples, doubt=doubt) if doubt else samples


def read(
    path: str | Path,
    orientation: str = "auto",
    wrench_frame: str = "sensor",
    sign: str = "pull",
    *,
    inverse_orientation: bool = False,
    pose_file: str | Path | None = None,
    wrench_topic: str | None = None,
    pose_topic: str | None = None,
    frames: tuple[str, str] | None = None,
    robot: str | None = None,
    wrench_columns: str | None = None,
    time_column: str | None = None,
    units: str | None = None,
    hdf5: str | None = None,
    episode: int | None = None,
    rate: float | None = None,
    base_frame: str | None = None,
    accept_damaged: bool = False,
    imu: str | None = None,
) -> Samples:
    """Read a recording: a table (CSV, Parquet, HDF5), two tables, or a bag.

    Where a wrench lacks an orientation of its own, one is interpolated, after the delay between the two was estimated.

    Args:
        path: a table of wrenches and orientations, or of wrenches alone with `pose_file`, or a bag.
        orientation: `auto`, by the columns' names, or `NAME[:COLUMNS]` of a convention.
        wrench_frame: `sensor`, or `base` where the controller turns it into base axes; it comes back in flange axes.
        sign: `pull`, what acts on the sensor, or `reaction`, what the sensor exerts, which is negated.
        inverse_orientation: whether the file holds `R_flange_base`.
        pose_file: a second table, with the orientations.
        wrench_topic: which one of a bag.
        pose_topic: which one of a bag.
        frames: names of base and flange in a bag's tree of transforms.
        robot: whose joint angles a bag has: a known arm's name, or a URDF as PATH[:LINK].
        wrench_columns: the six columns of the wrench, "a,b,c,d,e,f", or a slice of a list, "observation.wrench[0:6]".
        time_column: the column of the times, "NAME" or "NAME:UNIT".
        units: of columns whose names do not say, "force=kgf,torque=Nmm".
        hdf5: which datasets of an HDF5 file, "wrench=/path,pose=/path,time=/path".
        episode: which one of a set of recordings.
        rate: Hz, of the rows of a table without times, of which these are made.
        base_frame: name of the frame in which the orientations are; None: what a bag, or the robot, says.
        accept_damaged: read what is left of a damaged bag; else it is refused.
        imu: an accelerometer on the tool: a topic of the bag, a table, or three columns "ax,ay,az" of the table.

    Returns:
        Wrenches (n, 6), N and N m, sensor axes, pull sign, each with its `R_base_flange`; `notes` say what was done.

    Raises:
        FileAccessError: the file cannot be opened.
        FileFormatError: it cannot be understood; the message names row and column.
        InputError: the arguments do not fit the kind of file.
        MissingExtraError: a package that this kind of file needs is not installed.
    """
    options = Options(
        orientation=orientation,
        wrench_columns=wrench_columns,
        time_column=time_column,
        units=units,
        hdf5=hdf5,
        episode=episode,
        rate=rate,
        wrench_frame=wrench_frame,
        sign=sign,
        inverse_orientation=inverse_orientation,
        wrench_topic=wrench_topic,
        pose_topic=pose_topic,
        frames=frames,
        robot=robot,
        pose_file=None if pose_file is None else Path(pose_file),
        base_frame=base_frame,
        accept_damaged=accept_damaged,
        imu=imu,
    )
    notes = list[str]()
    samples = read_samples(path, options, tell=notes.append)
    return replace(samples, notes=tuple(notes))


def _as_streams(block: Block, path: str | Path) -> Streams:
    return block if isinstance(block, Streams) else _streams(block, block, path, path)


def _streams(wrenches: Table, poses: Table, path: str | Path, pose_path: str | Path, *, every: bool = False) -> Streams:
    """The rows of a table that have a wrench, or `every` one, and those of another, or the same, with an orientation.
    Raises `FileFormatError` where there are no times.
    """
    wrench = wrenches if every else wrenches.select(wrenches.has_wrench)
    pose = poses.select(poses.has_orientation)
    if wrench.t is None or pose.t is None:
        raise FileFormatError(
            f"{name_of(path)}: found no column t, expected the time of each row of a recording: add it, or say "
            "--rate HZ, or use the file as a table of poses"
        )
    try:
        orientation = OrientationStream(pose.t, pose.orientation, pose.position, name_of(pose_path))
    except InputError as error:
        raise FileFormatError(f"{pose_path}: {error}") from None
    readings = WrenchStream(wrench.t, wrench.wrench, name_of(path), wrench.load_mass, wrench.saturated)
    return Streams(readings, orientation, read_as_of_both(wrench, pose))


def samples_of(table: Table, path: str | Path) -> Samples:
    """The rows that have a reading, each with its orientation. Raises `FileFormatError`, also where one has none."""
    if table.lacks_orientations:
        lacking = table.has_wrench & ~table.has_orientation
        t = np.nan if table.t is None else table.t[lacking][0]
        raise FileFormatError(
            f"{name_of(path)}: found a wrench without an orientation at t = {t:.6f} s, expected one in each row as in "
            "the first rows: fill it in, or give wrenches and poses as two files with --wrench and --pose"
        )
    rows = table if table.has_reading.all() else table.select(table.has_reading)
    try:
        of_each = rows.wrench, rows.orientation, rows.t, rows.position, rows.load_mass
        return Samples(*of_each, name_of(path), saturated=rows.saturated, read_as=rows.read_as)
    except InputError as error:
        raise FileFormatError(f"{name_of(path)}: {error}") from None
