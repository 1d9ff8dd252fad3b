"""Recordings of every kind as streams, whole or batch by batch, and as samples."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import FileFormatError, InputError
from ..samples.samples import OrientationStream, Samples, Streams, WrenchStream
from .options import AS_USUAL, Layout, is_bag
from .saturation import at_limit
from .tables.columns import ROWS
from .tables.table import Table, joined, pose_tables, tables, wrench_tables

Advance = Callable[[float], None]
"""Is told the part of the recording, 0 to 1, that has been read; NaN where nobody knows its size."""

Tell = Callable[[str], None]


def read_streams(path: str | Path, layout: Layout = AS_USUAL, advance: Advance | None = None) -> Streams:
    """A recording: wrench in N and N m, sensor axes, pull sign; orientations of `R_base_flange`; its own times, in s.

    Of one table a row belongs to both streams, or to one where its other cells are empty. Raises `FileAccessError`,
    `FileFormatError`, `InputError` and `MissingExtraError`.
    """
    if is_bag(path, layout):
        return _bag_as_stated(next(_bag(path, layout, None, advance)), path, layout)
    if layout.pose_file is None:
        table = joined(list(_told(tables(path, layout.orientation), advance)))
        return _streams(_as_stated(table, path, layout), path)
    wrench = joined(list(_told(wrench_tables(path), advance)))
    poses = joined(list(_told(pose_tables(layout.pose_file, layout.orientation), None)))
    return _streams_of_two(_as_stated(wrench, path, layout), _as_stated(poses, layout.pose_file, layout), path, layout)


def batches(
    path: str | Path, layout: Layout = AS_USUAL, rows: int = ROWS, advance: Advance | None = None
) -> Iterator[Streams]:
    """The same in consecutive batches of at most about `rows` rows, each row once and in order; memory for one of them.

    A batch of two files has what both hold up to one moment. Raises as `read_streams`, at once or at a batch.
    """
    if is_bag(path, layout):
        return (_bag_as_stated(streams, path, layout) for streams in _bag(path, layout, rows, advance))
    if layout.pose_file is None:
        blocks = _told(tables(path, layout.orientation, rows), advance)
        return (_streams(_as_stated(table, path, layout), path) for table in blocks)
    wrenches = _told(wrench_tables(path, rows), advance)
    poses = _told(pose_tables(layout.pose_file, layout.orientation, rows), None)
    return _merged(
        (_as_stated(table, path, layout) for table in wrenches),
        (_as_stated(table, layout.pose_file, layout) for table in poses),
        path,
        layout,
    )


def read_samples(
    path: str | Path, layout: Layout = AS_USUAL, advance: Advance | None = None, tell: Tell | None = None
) -> Samples:
    """A recording as samples: of a table in which no wrench lacks an orientation, the rows that have both; else the
    orientation is brought to the wrench's times, and `tell` hears how. Raises as `read_streams`.
    """
    if is_bag(path, layout) or layout.pose_file is not None:
        return _paired(read_streams(path, layout, advance), tell)
    table = _as_stated(joined(list(_told(tables(path, layout.orientation), advance))), path, layout)
    if _lacks_orientations(table):
        return _paired(_streams(table, path), tell)
    return _samples(table, path)


def pairs_in_batches(
    path: str | Path, layout: Layout = AS_USUAL, rows: int = ROWS, advance: Advance | None = None
) -> Iterator[Samples] | None:
    """The samples of a table whose rows are pairs of wrench and orientation, `rows` at a time, memory for one of them.

    None where the orientation has to be brought to the wrench's times: for a bag, two files, or a table in whose first
    rows a wrench has no orientation of its own. Raises as `read_streams`, and `FileFormatError` at a later wrench
    without one.
    """
    if is_bag(path, layout) or layout.pose_file is not None:
        return None
    blocks = (_as_stated(table, path, layout) for table in _told(tables(path, layout.orientation, rows), advance))
    first = next(blocks)
    return None if _lacks_orientations(first) else _pairs(chain([first], blocks), path)


def _pairs(blocks: Iterator[Table], path: str | Path) -> Iterator[Samples]:
    for table in blocks:
        if _lacks_orientations(table):
            lacking = table.has_wrench & ~table.has_orientation
            t = np.nan if table.t is None else table.t[lacking][0]
            raise FileFormatError(
                f"{path}: found a wrench without an orientation at t = {t:.6f} s, expected one in each row as in the "
                "first rows: fill it in, or give wrenches and poses as two files with --wrench and --pose"
            )
        yield _samples(table, path)


def _lacks_orientations(table: Table) -> bool:
    """Whether a wrench has no orientation in its row."""
    return bool((table.has_wrench & ~table.has_orientation).any())


def _samples(table: Table, path: str | Path) -> Samples:
    """The rows of a table that have a wrench, each with its orientation. Raises `FileFormatError`."""
    pairs = table if table.has_wrench.all() else table.select(table.has_wrench)
    try:
        return Samples(
            pairs.wrench,
            pairs.orientation,
            pairs.t,
            pairs.position,
            pairs.load_mass,
            _name(path),
            saturated=None if pairs.saturated is None else pairs.saturated == 1.0,
        )
    except InputError as error:
        raise FileFormatError(f"{path}: {error}") from None


def _paired(streams: Streams, tell: Tell | None) -> Samples:
    """Two streams onto one clock: the delay between them, of free readings, is applied where it is significant. Where
    the recording does not say which channels stood at their limits, its readings do.
    """
    from ..samples.delay import on_one_clock

    if streams.wrench.saturated is None:
        streams = replace(streams, wrench=replace(streams.wrench, saturated=at_limit(streams.wrench.wrench)))
    samples, notes = on_one_clock(streams)
    if tell is not None:
        for note in notes:
            tell(note)
    return samples


def _bag(path: str | Path, layout: Layout, rows: int | None, advance: Advance | None) -> Iterator[Streams]:
    """A bag's streams as it has them, whole (None) or in batches."""
    from .bags.read import bag_batches, bag_streams
    from .urdf import arm_of

    asked: dict[str, Any] = {
        "wrench_topic": layout.wrench_topic,
        "pose_topic": layout.pose_topic,
        "frames": layout.frames,
        "arm": None if layout.robot is None else arm_of(layout.robot),
        "advance": advance,
    }
    yield from [bag_streams(path, **asked)] if rows is None else bag_batches(path, batch=rows, **asked)


def _bag_as_stated(streams: Streams, path: str | Path, layout: Layout) -> Streams:
    if layout.wrench_frame == "base":
        raise InputError(f"{path}: {IN_BASE_AXES}")
    wrench, poses = streams.wrench, streams.orientation
    if layout.sign == "reaction":
        wrench = replace(wrench, wrench=-wrench.wrench)
    if layout.inverse_orientation:
        poses = replace(poses, R_base_flange=poses.R_base_flange.transpose(0, 2, 1))
    return Streams(wrench, poses)


IN_BASE_AXES = (
    "found a wrench in base axes without an orientation in its row, expected both in each row: record them together, "
    "or the wrench in sensor axes"
)


def _as_stated(table: Table, path: str | Path, layout: Layout) -> Table:
    """Wrenches in sensor axes, pull sign, and orientations of `R_base_flange`. Raises `FileFormatError`."""
    R = table.orientation.transpose(0, 2, 1) if layout.inverse_orientation else table.orientation
    wrench = -table.wrench if layout.sign == "reaction" else table.wrench
    if layout.wrench_frame == "base":
        if _lacks_orientations(table):
            raise FileFormatError(f"{path}: {IN_BASE_AXES}")
        wrench = np.concatenate(
            [np.einsum("nij,ni->nj", R, wrench[:, :3]), np.einsum("nij,ni->nj", R, wrench[:, 3:])], axis=1
        )
    return replace(table, wrench=wrench, orientation=R)


def _streams(table: Table, path: str | Path) -> Streams:
    return _streams_of_two(table, table, path, AS_USUAL)


def _streams_of_two(wrenches: Table, poses: Table, path: str | Path, layout: Layout) -> Streams:
    """The streams of a table's rows that have a wrench, and of another's, or the same one's, that have an orientation.

    Raises `FileFormatError` where there are no times.
    """
    read, posed = wrenches.select(wrenches.has_wrench), poses.select(poses.has_orientation)
    if read.t is None or posed.t is None:
        raise FileFormatError(
            f"{path}: found no column t, expected the time of each row of a recording: add it, or use the file as a "
            "table of poses"
        )
    pose_path = path if layout.pose_file is None else layout.pose_file
    try:
        orientation = OrientationStream(posed.t, posed.orientation, posed.position, _name(pose_path))
    except InputError as error:
        raise FileFormatError(f"{pose_path}: {error}") from None
    saturated = None if read.saturated is None else read.saturated == 1.0
    return Streams(WrenchStream(read.t, read.wrench, _name(path), read.load_mass, saturated), orientation)


def _merged(wrenches: Iterator[Table], poses: Iterator[Table], path: str | Path, layout: Layout) -> Iterator[Streams]:
    """Batches of two tables, in each what both hold up to the moment at which a block of one of them ends."""
    wrench, pose = next(wrenches), next(poses)
    without_wrench, without_pose = wrench.select(slice(0)), pose.select(slice(0))
    more = True
    while more:
        until = min(_end(wrench), _end(pose))
        read, wrench_left = _cut(wrench, until)
        posed, pose_left = _cut(pose, until)
        yield _streams_of_two(read, posed, path, layout)
        wrench = wrench_left if len(wrench_left) else next(wrenches, without_wrench)
        pose = pose_left if len(pose_left) else next(poses, without_pose)
        more = bool(len(wrench) or len(pose))


def _end(table: Table) -> float:
    return float(table.t[-1]) if table.t is not None and len(table) else np.inf


def _cut(table: Table, until: float) -> tuple[Table, Table]:
    """The rows before the first one that is later than `until`, all where the last one is not; and the others."""
    if table.t is None or _end(table) <= until or not len(table):
        return table, table.select(slice(0))
    first_later = int(np.argmax(table.t > until))
    return table.select(slice(first_later)), table.select(slice(first_later, None))


def _told(blocks: Iterator[tuple[Table, float]], advance: Advance | None) -> Iterator[Table]:
    """The tables alone; how far they got is told to `advance`."""
    for table, done in blocks:
        yield table
        if advance is not None:
            advance(done)


def _name(path: str | Path) -> str:
    return os.fsencode(path).decode(errors="replace")


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
) -> Samples:
    """Read a recording: a table (CSV, Parquet), two tables, or a bag.

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

    Returns:
        Wrenches (n, 6), N and N m, sensor axes, pull sign, each with its `R_base_flange`.

    Raises:
        FileAccessError: the file cannot be opened.
        FileFormatError: it cannot be understood; the message names row and column.
        InputError: the arguments do not fit the kind of file.
        MissingExtraError: a package that this kind of file needs is not installed.
    """
    layout = Layout(
        orientation,
        wrench_frame,
        sign,
        inverse_orientation,
        wrench_topic,
        pose_topic,
        frames,
        robot,
        None if pose_file is None else Path(pose_file),
    )
    return read_samples(path, layout)
