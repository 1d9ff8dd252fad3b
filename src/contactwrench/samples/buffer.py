"""What a recording in batches holds back: rows that later ones may come before, and what is needed around edges."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..geometry.arrays import Array
from .streams import Streams
from .timestamps import SORTED_WITHIN, Stamps, stamps_after

LONGEST_HOLD = 0.15
"""s: a pose repeated for as long at the most was held by who sent it (robots state theirs at 10 Hz and more), and
counts where it came first; one repeated for longer is an arm at rest.
"""
LARGEST_HELD_STEP = np.deg2rad(20.0)
"""From one held pose to the next: a table of poses without the ways between goes further."""


@dataclass(frozen=True, eq=False)
class Pending:
    """Rows that wait, in the order of their stamps. Of the wrench: `t` (n,) s, `wrench` (n, 6) and `row` (n,), counted
    from 0 as recorded. Of the orientation: `at` (m,) s, `R_base_flange` (m, 3, 3), `position` (m, 3) m or None. The
    `wrench_stamps` and `orientation_stamps` so far, the `origin`, the recording's
    first stamp, and the stamp of the last reading that is done with, `passed`.
    """

    wrench_stamps: Stamps
    orientation_stamps: Stamps
    t: Array
    wrench: Array
    row: NDArray[np.intp]
    at: Array
    R_base_flange: Array
    position: Array | None
    origin: float
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
            return len(self.t)
        in_order = np.searchsorted(self.t, self.wrench_stamps.latest - SORTED_WITHIN)
        return int(min(in_order, np.searchsorted(self.t, until, "right")))

    def after(self, n: int, knots: Knots, delay: float) -> Pending:
        """What still waits when the first `n` readings are done with."""
        earliest = min(self.t[n] if n < len(self.t) else np.inf, self.wrench_stamps.latest - SORTED_WITHIN) - delay
        passed = np.searchsorted(knots.t, earliest, "right") - 1
        first = 0
        if passed >= 0:  # what is left of a rest must still be seen to be one
            first = int(np.searchsorted(self.at, knots.t[passed] - 2.0 * LONGEST_HOLD))
        return replace(
            self,
            t=self.t[n:],
            wrench=self.wrench[n:],
            row=self.row[n:],
            at=self.at[first:],
            R_base_flange=self.R_base_flange[first:],
            position=None if self.position is None else self.position[first:],
            passed=float(self.t[n - 1]) if n else self.passed,
        )


def nothing_pending(batch: Streams) -> Pending:
    """The start of a recording whose first batch this is: its sources, and whether positions come with it."""
    position = None if batch.orientation.position is None else np.empty((0, 3))
    return Pending(
        Stamps("wrench", batch.wrench.source),
        Stamps("orientation", batch.orientation.source),
        np.empty(0),
        np.empty((0, 6)),
        np.empty(0, dtype=np.intp),
        np.empty(0),
        np.empty((0, 3, 3)),
        position,
        np.inf,
    )


def with_batch(pending: Pending, batch: Streams) -> Pending:
    """What waits when a batch has come, in order; of orientations with the same stamp the last one. Raises
    `InputError` for stamps that cannot be put in order, and for positions in some batches only.
    """
    wrench, orientation = batch.wrench, batch.orientation
    if (orientation.position is None) != (pending.position is None) and len(orientation):
        raise InputError(f"{orientation.source}: found positions in some batches only, expected them in all or none")
    stamps = np.r_[pending.origin, wrench.t[np.isfinite(wrench.t)], orientation.t[np.isfinite(orientation.t)]]
    origin = float(stamps.min())
    wrench_stamps = stamps_after(pending.wrench_stamps, wrench.t, origin)
    orientation_stamps = stamps_after(pending.orientation_stamps, orientation.t, origin)
    row = pending.wrench_stamps.rows + np.arange(len(wrench), dtype=np.intp)
    t = np.concatenate([pending.t, wrench.t])
    at = np.concatenate([pending.at, orientation.t])
    in_order, by_stamp = _in_order(t), _in_order(at)
    at = at[by_stamp]
    kept = by_stamp[np.r_[at[1:] > at[:-1], np.ones(min(len(at), 1), dtype=bool)]]

    def of_both(before: Array, new: Array, order: NDArray[np.intp]) -> Array:
        joined = np.concatenate([before, new]) if len(before) else new
        return joined if len(order) == len(joined) and _is_counting(order) else joined[order]

    position = pending.position
    if position is not None and orientation.position is not None:
        position = of_both(position, orientation.position, kept)
    return Pending(
        wrench_stamps,
        orientation_stamps,
        t[in_order],
        of_both(pending.wrench, wrench.wrench, in_order),
        np.concatenate([pending.row, row])[in_order],
        np.concatenate([pending.at, orientation.t])[kept],
        of_both(pending.R_base_flange, orientation.R_base_flange, kept),
        position,
        origin,
        pending.passed,
    )


def _in_order(t: Array) -> NDArray[np.intp]:
    return np.argsort(t, kind="stable")


def _is_counting(order: NDArray[np.intp]) -> bool:
    return bool((order == np.arange(len(order))).all())


@dataclass(frozen=True, eq=False)
class Knots:
    """The orientations to interpolate between: their places `index` (k,) among all that are in order, of which there
    are `count`, and stamps `t` (k,) s. `until` s: up to when what comes later cannot change them.
    """

    index: NDArray[np.intp]
    t: Array
    count: int
    until: float


def knots_of(pending: Pending, longest_gap: float, is_last: bool) -> Knots:
    """All orientations that are in order, less the repetitions of poses that were held.

    A pose that comes again and again until the next one was held for that time: it is where it came first, and taken
    for the others the arm would be half of that time late.
    """
    count = len(pending.at)
    if not is_last:
        count = int(np.searchsorted(pending.at, pending.orientation_stamps.latest - SORTED_WITHIN))
    at, R = pending.at[:count], pending.R_base_flange[:count]
    if count < 2:
        return Knots(np.arange(count), at, count, -np.inf)
    moved = (R[1:] != R[:-1]).any(axis=(1, 2))
    if pending.position is not None:
        moved |= (pending.position[1:count] != pending.position[: count - 1]).any(axis=1)
    start = np.r_[0, np.flatnonzero(moved) + 1]
    end = np.r_[start[1:], count]
    held = np.zeros(len(start), dtype=bool)
    left, come = start[:-1], start[1:]
    cosine = 0.5 * (np.einsum("nij,nij->n", R[left], R[come]) - 1.0)
    held[:-1] = (
        (come - left > 1)
        & (at[come] - at[left] <= LONGEST_HOLD)
        & (at[come] - at[come - 1] <= longest_gap)
        & (cosine >= np.cos(LARGEST_HELD_STEP))
    )
    until = float(at[-1])
    if not is_last and until - at[start[-1]] <= LONGEST_HOLD:
        held[-1], until = True, float(at[start[-1]])
    counts = np.repeat(~held, end - start)
    counts[start] = True
    index = np.flatnonzero(counts)
    return Knots(index, at[index], count, until)
