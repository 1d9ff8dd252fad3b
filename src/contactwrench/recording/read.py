"""Recordings of every kind, in blocks, as streams and as samples; the suffix tells the reader."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import starmap
from pathlib import Path
from typing import TypeAlias, TypeGuard, TypeVar

import numpy as np

from ..errors import FileFormatError, InputError
from ..files import name_of
from ..samples.accelerometer import with_accelerometer
from ..samples.bursts import even_rows
from ..samples.limits import at_limit
from ..samples.recorded_poses import is_stream
from ..samples.samples import OrientationStream, Samples, Streams, WrenchStream
from ..samples.timestamps import begins_anew, counted_on
from .accelerations import accelerometer_of
from .bags.open import SUFFIXES_OF_BAGS, is_bag
from .bags.read import bag_batches, pose_in_doubt
from .options import AS_USUAL, Options
from .tables.columns import ROWS, Advance, Tell, unheard
from .tables.doubts import angles_in_doubt, times_in_doubt, turns_little
from .tables.parquet import is_parquet
from .tables.table import SUFFIXES as SUFFIXES_OF_TABLES
from .tables.table import Table, merged, read_as_of_both, tables, without_reading

Part = TypeVar("Part", Samples, Streams)

MANY_AT_A_LIMIT = 0.1
"""Of the readings."""
Block: TypeAlias = Table | Streams
"""Of one table with wrench and orientation side by side; of a bag, or of two files, both streams up to one moment."""


def read_as_bag(path: str | Path, options: Options = AS_USUAL) -> bool:
    """Whether a recording is a bag; else it is a table, or two. Raises `FileFormatError` for a suffix of neither, and
    `InputError` for what `options` says of the other kind.
    """
    is_one = _is_bag(path)
    if options.pose_file is not None and (bags := [each for each in (path, options.pose_file) if _is_bag(each)]):
        raise InputError(f"{bags[0]}: found a bag as one of two files, expected tables: give it alone")
    options.require_for(path, bag=is_one)
    return is_one


def _is_bag(path: str | Path) -> bool:
    path = path if isinstance(path, Path) else Path(name_of(path))
    if os.path.isdir(path):
        return is_bag(path) and not is_parquet(path)
    if (suffix := path.suffix.lower()) not in (*SUFFIXES_OF_TABLES, *SUFFIXES_OF_BAGS):
        raise FileFormatError(
            f"{path}: found the suffix {suffix}, expected .csv, .parquet, .h5, .bag, .db3 or .mcap: export the "
            "recording as one of them"
        )
    return suffix in SUFFIXES_OF_BAGS


def blocks(
    path: str | Path, options: Options = AS_USUAL, rows: int = ROWS, advance: Advance = unheard
) -> Iterator[Block]:
    """A recording in consecutive blocks of about so many `rows`, each row once and in order. Raises as `read`."""
    if read_as_bag(path, options):
        return bag_batches(path, options, rows, advance)
    if options.pose_file is None:
        return map(options.applied, tables(path, options, rows, advance))
    wrenches = tables(path, replace(options, orientation=None), rows, advance)
    poses = tables(options.pose_file, options, rows, wrench=False)
    return starmap(_streams, merged(map(options.applied, wrenches), map(options.applied, poses)))


def are_pairs(block: Block) -> TypeGuard[Table]:
    """Whether each wrench of a block has its orientation in its row, and need not be brought to the wrench's time."""
    return isinstance(block, Table) and not block.lacks_orientations


def begins_with_pairs(path: str | Path, options: Options = AS_USUAL) -> bool:
    """Whether the first rows of a recording are pairs. Raises as `read`."""
    return not read_as_bag(path, options) and options.pose_file is None and are_pairs(next(blocks(path, options)))


def read_streams(path: str | Path, options: Options = AS_USUAL) -> Streams:
    """A recording as it is, each stream at its own times: wrench in N and N m, sensor axes, pull sign, NaN where there
    is none; orientations of `R_base_flange`; s. Raises as `read`.
    """
    return Streams.concatenate(list(batches(path, options)))


def batches(
    path: str | Path, options: Options = AS_USUAL, rows: int = ROWS, advance: Advance = unheard
) -> Iterator[Streams]:
    """The same in consecutive batches of about so many `rows`, each row once and in order. Raises as `read`."""
    return map(as_streams, blocks(path, options, rows, advance))


def read_samples(
    path: str | Path, options: Options, advance: Advance = unheard, tell: Tell = unheard, begin: Tell = unheard
) -> Samples:
    """A recording as samples: of a table in which no wrench lacks an orientation, the rows that have both; else the
    orientation is brought to the wrench's times, with the delay where it is significant: `begin` hears that this
    begins, and `tell` how. Where nobody says which channels stood at their limits, the readings do. Raises as `read`.
    """
    parts = list(blocks(path, options, advance=advance))
    if columns := parts[0].read_as.get("columns"):
        tell(f"columns: {columns}")
    pairs = [part for part in parts if are_pairs(part)]
    if len(pairs) == len(parts):
        whole = Table.concatenate(pairs)
        said = (without_reading(lacking),) if (lacking := int(np.sum(~whole.has_reading))) else ()
        return _completed(samples_of(whole), path, options, tell, said)
    from ..samples.delay import on_one_clock

    begin(f"finding the delay in {Path(path).name}")
    streams = Streams.concatenate([*map(as_streams, parts)])
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
    samples = with_accelerometer(samples, accelerometer_of(path, options))
    if begins_anew(samples) and is_stream(samples):
        samples, anew = counted_on(samples)
        notes += anew
    for note in (*before, *notes):
        tell(note)
    if samples.saturated is None and samples.t is not None:
        samples = replace(samples, saturated=at_limit(samples.wrench))
    if samples.saturated is not None and samples.saturated.sum() > MANY_AT_A_LIMIT * len(samples):
        tell(f"{samples.unsaturated()[1][0]}: set the sensor's range larger, or load it less")
    is_one = read_as_bag(path, options)
    if said := pose_in_doubt(path, options) if is_one else times_in_doubt(path, options, samples.t):
        tell(said)
    if is_one or not turns_little(samples.R_base_flange):
        return samples
    return replace(samples, doubt=angles_in_doubt(options.pose_file or path, options))


def telling(parts: Iterable[Part], path: str | Path, options: Options, note: Tell) -> Iterator[Part]:
    """The same parts of a recording; which columns were taken for what is noted, and what is in doubt or damaged."""
    damage, of_table = "", not read_as_bag(path, options)
    little = of_table
    for k, part in enumerate(parts):
        if k == 0 and (columns := part.read_as.get("columns")):
            note(f"columns: {columns}")
        t = part.t if isinstance(part, Samples) else part.wrench.t
        poses = part if isinstance(part, Samples) else part.orientation
        if k == 0 and of_table and (doubt := times_in_doubt(path, options, t)):
            note(doubt)
        little = little and turns_little(poses.R_base_flange)
        yield part
        damage = part.damage
    if damage:
        note(damage)
    if little and (doubt := angles_in_doubt(options.pose_file or path, options)):
        note(doubt)


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
        wrench_columns: the six columns of the wrench, "a,b,c,d,e,f", a slice of a list, "observation.wrench[0:6]", or
            numbers, from 1, of columns without names.
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
    stated = {name: value for name, value in locals().items() if name != "path"}
    options = Options(**stated | {"pose_file": None if pose_file is None else Path(pose_file)})
    notes = list[str]()
    samples = read_samples(path, options, tell=notes.append)
    return replace(samples, notes=tuple(notes))


def as_streams(block: Block, *, every: bool = False) -> Streams:
    """A block as both streams: the rows with a wrench, or of pairs `every` one, and those with an orientation."""
    return block if isinstance(block, Streams) else _streams(block, block, every=every and are_pairs(block))


def _streams(wrenches: Table, poses: Table, *, every: bool = False) -> Streams:
    wrench = wrenches if every else wrenches.select(wrenches.has_wrench)
    pose = poses.select(poses.has_orientation)
    if wrench.t is None or pose.t is None:
        raise FileFormatError(
            f"{wrench.source}: found no column t, expected the time of each row of a recording: add it, or say "
            "--rate HZ, or use the file as a table of poses"
        )
    orientation = OrientationStream(pose.t, pose.orientation, pose.position, pose.source)
    readings = WrenchStream(wrench.t, wrench.wrench, wrench.source, wrench.load_mass, wrench.saturated)
    return Streams(readings, orientation, read_as_of_both(wrench, pose))


def samples_of(table: Table) -> Samples:
    """The rows that have a reading, each with its orientation. Raises `FileFormatError`, also where one has none."""
    if table.lacks_orientations:
        lacking = table.has_wrench & ~table.has_orientation
        t = np.nan if table.t is None else table.t[lacking][0]
        raise FileFormatError(
            f"{table.source}: found a wrench without an orientation at t = {t:.6f} s, expected one in each row as in "
            "the first rows: fill it in, or give wrenches and poses as two files with --wrench and --pose"
        )
    rows = table if table.has_reading.all() else table.select(table.has_reading)
    try:
        of_each = rows.wrench, rows.orientation, rows.t, rows.position, rows.load_mass
        return Samples(*of_each, table.source, saturated=rows.saturated, read_as=rows.read_as)
    except InputError as error:
        raise FileFormatError(f"{table.source}: {error}") from None
