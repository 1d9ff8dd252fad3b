"""What a recording in batches holds back: rows that later ones may come before, and what is needed around edges."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..geometry.arrays import Array, Rows, column
from .samples import Streams, WrenchStream
from .timestamps import SORTED_WITHIN, Stamps, at_pace, stamps_after

LONGEST_HOLD = 0.15
"""s: a pose repeated for as long at the most was held by who sent it (robots state theirs at 10 Hz and more), and
counts where it came first; one repeated for longer is an arm at rest.
"""
LARGEST_HELD_STEP = np.deg2rad(20.0)
"""From one held pose to the next: a table of poses without the ways between goes further."""

Table = TypeVar("Table", bound=Rows)


@dataclass(frozen=True, eq=False)
class Readings(WrenchStream):
    """Readings that wait; the `row` (n,) of each is counted from 0 as recorded."""

    row: NDArray[np.intp] = field(kw_only=True, metadata=column(kind=np.intp))


@dataclass(frozen=True, eq=False)
class Orientations(Rows):
    """Orientations that wait, as an `OrientationStream` has checked them."""

    t: Array = field(metadata=column())
    R_base_flange: Array = field(metadata=column(3, 3))
    position: Array | None = field(metadata=column(3))


@dataclass(frozen=True, eq=False)
class Buffer:
    """Rows that wait, in the order of their stamps; the stamps of both streams so far; the recording's first stamp, the
    `origin`; and the stamp of the last reading that is done with, `passed`.
    """

    readings: Readings
    orientations: Orientations
    wrench_stamps: Stamps
    orientation_stamps: Stamps
    origin: float = np.inf
    passed: float = np.nan

    @property
    def is_begun(self) -> bool:
        """Whether no row can come that is earlier than all others, in either stream."""
        return all(
            s.rows > 0 and s.latest - s.first > SORTED_WITHIN for s in (self.wrench_stamps, self.orientation_stamps)
        )

    def decided(self, until: float, is_last: bool) -> int:
        """How many readings come before all later ones and, being stamped `until` or before, have their orientation."""
        if is_last:
            return len(self.readings)
        in_order = np.searchsorted(self.readings.t, self.wrench_stamps.latest - SORTED_WITHIN)
        return int(min(in_order, np.searchsorted(self.readings.t, until, "right")))

    def after(self, n: int, nodes: Nodes, delay: float) -> Buffer:
        """What still waits when the first `n` readings are done with."""
        t = self.readings.t
        earliest = min(t[n] if n < len(t) else np.inf, self.wrench_stamps.latest - SORTED_WITHIN) - delay
        passed = np.searchsorted(nodes.t, earliest, "right") - 1
        first = 0
        if passed >= 0:  # what is left of a rest must still be seen to be one
            first = int(np.searchsorted(self.orientations.t, nodes.t[passed] - 2.0 * LONGEST_HOLD))
        return replace(
            self,
            readings=self.readings.select(slice(n, None)),
            orientations=self.orientations.select(slice(first, None)),
            passed=float(t[n - 1]) if n else self.passed,
        )


def with_batch(before: Buffer | None, batch: Streams) -> Buffer:
    """What waits when a batch has come; `before`: what waited, None before the first. Of orientations with the same
    stamp the last one counts. Raises `InputError` for stamps that cannot be put in order, or positions in some batches.
    """
    wrench, orientation = batch.wrench, batch.orientation
    row = np.arange(len(wrench), dtype=np.intp) + (0 if before is None else before.wrench_stamps.rows)
    readings = Readings(wrench.t, wrench.wrench, wrench.source, wrench.load_mass, wrench.saturated, row=row)
    orientations = Orientations(orientation.t, orientation.R_base_flange, orientation.position)
    if before is None:
        stamps = Stamps("wrench", wrench.source), Stamps("orientation", orientation.source)
        before = Buffer(readings.select(slice(0)), orientations.select(slice(0)), *stamps)
    if (orientation.position is None) != (before.orientations.position is None) and len(orientation):
        raise InputError(f"{orientation.source}: found positions in some batches only, expected them in all or none")
    finite = np.r_[before.origin, wrench.t[np.isfinite(wrench.t)], orientation.t[np.isfinite(orientation.t)]]
    origin = float(finite.min())
    wrench_stamps = stamps_after(before.wrench_stamps, wrench.t, origin)
    orientation_stamps = stamps_after(before.orientation_stamps, orientation.t, origin)
    readings = Readings.concatenate([before.readings, readings])
    orientations = Orientations.concatenate([before.orientations, orientations])
    by_stamp = np.argsort(orientations.t, kind="stable")
    t = orientations.t[by_stamp]
    kept = by_stamp[np.r_[t[1:] > t[:-1], np.ones(min(len(t), 1), dtype=bool)]]
    return Buffer(
        _in_order(readings, np.argsort(readings.t, kind="stable")),
        _in_order(orientations, kept),
        wrench_stamps,
        orientation_stamps,
        origin,
        before.passed,
    )


def _in_order(rows: Table, order: NDArray[np.intp]) -> Table:
    is_so = len(order) == len(rows) and bool((order == np.arange(len(order))).all())
    return rows if is_so else rows.select(order)


@dataclass(frozen=True, eq=False)
class Nodes:
    """The orientations to interpolate between: their places `index` (k,) among all that are in order, of which there
    are `count`, and stamps `t` (k,) s. `until` s: up to when what comes later cannot change them.
    """

    index: NDArray[np.intp]
    t: Array
    count: int
    until: float


def nodes_of(buffer: Buffer, longest_gap: float, is_last: bool) -> Nodes:
    """All orientations that are in order, less the repetitions of poses that were held: a pose that comes again and
    again until the next one, in less than the `longest_gap` s, is where it came first, and taken for the others the arm
    would be half of that time late. `is_last`: no more rows will come.
    """
    count = len(buffer.orientations)
    if not is_last:
        count = int(np.searchsorted(buffer.orientations.t, buffer.orientation_stamps.latest - SORTED_WITHIN))
    t, R = buffer.orientations.t[:count], buffer.orientations.R_base_flange[:count]
    position = buffer.orientations.position
    if count < 2:
        return Nodes(np.arange(count), t, count, -np.inf)
    moved = (R[1:] != R[:-1]).any(axis=(1, 2))
    if position is not None:
        moved |= (position[1:count] != position[: count - 1]).any(axis=1)
    start = np.r_[0, np.flatnonzero(moved) + 1]
    end = np.r_[start[1:], count]
    held = np.zeros(len(start), dtype=bool)
    left, come = start[:-1], start[1:]
    cosine = 0.5 * (np.einsum("nij,nij->n", R[left], R[come]) - 1.0)
    held[:-1] = (
        (come - left > 1)
        & (t[come] - t[left] <= LONGEST_HOLD)
        & (t[come] - t[come - 1] <= longest_gap)
        & (cosine >= np.cos(LARGEST_HELD_STEP))
    )
    until = float(t[-1])
    if not is_last and until - t[start[-1]] <= LONGEST_HOLD:
        held[-1], until = True, float(t[start[-1]])
    counts = np.repeat(~held, end - start)
    counts[start] = True
    index = np.flatnonzero(counts)
    return Nodes(index, t[index], count, until)


def nodes_at_pace(buffer: Buffer, nodes: Nodes) -> Nodes:
    """The nodes of a whole recording at the stamps that `at_pace` gives their poses."""
    of_nodes = buffer.orientations.select(nodes.index)
    values = of_nodes.R_base_flange.reshape(-1, 9)
    if of_nodes.position is not None:
        values = np.hstack([values, np.nan_to_num(of_nodes.position)])
    return replace(nodes, t=at_pace(nodes.t, values))
