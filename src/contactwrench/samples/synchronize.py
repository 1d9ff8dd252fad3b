"""Two streams onto one clock: the orientation at the times of the wrench, by rotation between recorded orientations.

A reading stamped t belongs to the orientation at t - delay. Orientations are interpolated along the shortest turn, only
where the recording has them: not before the first, not after the last, not in a gap. What is left out says why.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..geometry.arrays import Array
from ..geometry.rotations import arcs_through
from .buffer import Knots, Pending, knots_of, nothing_pending, with_batch
from .samples import Samples
from .streams import Streams
from .timestamps import notes_of, require_common_span, require_times

LEAST_GAP, GAP_SPACINGS = 0.05, 5.0
"""A gap is longer than this many s and longer than this many median spacings of the stream, where no limit is given."""
LARGEST_TURN = np.pi / 2.0
"""Between two orientations: after more, which way round the arm went is a guess."""
MOST_LEFT_OUT = 0.5
"""Of the readings that lie within the recorded orientations: where gaps take more, it is no recording of a motion."""
GAPS_NAMED = 5

WRENCH_GAP = "in a gap of the wrench"
BEFORE, AFTER = "before the first orientation", "after the last orientation"
GAP, TURN = "in a gap of the orientation", "between two orientations more than 90 deg apart"
NOT_A_NUMBER = "the reading is not a number"
REASONS = (NOT_A_NUMBER, BEFORE, AFTER, GAP, TURN)


@dataclass(frozen=True)
class Limits:
    """The longest times, s, between two rows that are no gap: of the `orientation` and of the `wrench`."""

    orientation: float
    wrench: float


@dataclass(frozen=True)
class Hole:
    """Where something is missing: a gap of a stream, or a turn that is too large; `start` and `end` s, as stamped."""

    what: str
    start: float
    end: float


@dataclass(frozen=True, eq=False)
class LeftOut:
    """Rows (k,) of the wrench stream, counted from 0 as they were recorded, that have no sample, and the reason."""

    rows: NDArray[np.intp]
    reason: str


@dataclass(frozen=True, eq=False)
class Synchronized:
    """`samples`: readings in the order of their stamps, each with the orientation (and position) of its moment; `t` is
    the wrench's stamps. `rows` (k,): the rows of the wrench stream that they are, counted from 0 as recorded.
    `left_out`: all other rows, by reason. `notes`: what was put right or left out, in sentences with times counted from
    the recording's first stamp; of a recording in batches they come with the last.
    """

    samples: Samples
    rows: NDArray[np.intp]
    left_out: tuple[LeftOut, ...]
    notes: tuple[str, ...]

    @property
    def reasons(self) -> dict[int, str]:
        """Why a row of the wrench stream has no sample."""
        return {int(row): part.reason for part in self.left_out for row in part.rows}


def synchronize(
    streams: Streams, delay: float = 0.0, delay_std: float | None = None, longest_gap: float | None = None
) -> Synchronized:
    """The samples of a recording: every reading with the orientation at its stamp less `delay` (s: how much later than
    the orientation the wrench is stamped).

    Where `delay_std` s is given, the samples carry both. Between two orientations more than `longest_gap` s apart there
    are no samples; None: 5 times their median spacing and at least 0.05 s. A pose that is repeated for up to 0.15 s and
    then changes was held: its first stamp counts. Raises `InputError` for stamps that cannot be put in order, streams
    without a common span, and gaps that leave less than half of it.
    """
    return next(synchronized([streams], delay, delay_std, longest_gap))


def synchronized(
    batches: Iterable[Streams], delay: float = 0.0, delay_std: float | None = None, longest_gap: float | None = None
) -> Iterator[Synchronized]:
    """The same for a long recording in consecutive batches: for each what is decided by then; together exactly what
    `synchronize` makes of the whole, and its errors.

    Held back are 0.1 s, for messages that come late, and what one stream is ahead of the other. Where `longest_gap` is
    None, the rule above is applied to the first orientations alone.
    """
    if not np.isfinite(delay):
        raise InputError(f"delay is {delay!r}, expected s")
    if longest_gap is not None and not longest_gap > 0.0:
        raise InputError(f"longest_gap is {longest_gap!r}, expected s above 0")
    pending: Pending | None = None
    limits: Limits | None = None
    count: Counter[str] = Counter()
    holes: Counter[Hole] = Counter()
    for batch, is_last in _with_last(batches):
        pending = with_batch(nothing_pending(batch) if pending is None else pending, batch)
        if is_last:
            _require_two_streams(pending, delay)
        if limits is None and (is_last or pending.is_begun):
            limits = Limits(longest_gap or default_gap(pending.at), default_gap(pending.t))
        if limits is None:
            yield _nothing(pending, delay, delay_std)
            continue
        knots = knots_of(pending, limits.orientation, is_last)
        n = pending.decided(knots.until + delay, is_last)
        left_out, kept, samples = _paired(pending, n, knots, delay, delay_std, limits, holes)
        count.update({part.reason: len(part.rows) for part in left_out}, paired=len(samples))
        rows = pending.row[:n][kept]
        _count_missing_readings(pending, n, limits, holes)
        if is_last:
            _require_enough(count, holes, limits, pending)
        notes = _notes(count, holes, limits, pending) if is_last else ()
        pending = pending.after(n, knots, delay)
        yield Synchronized(samples, rows, left_out, notes)


def default_gap(t: Array) -> float:
    """The longest time between two rows at `t` (n,), s, that is no gap."""
    steps = np.diff(t)
    return max(LEAST_GAP, GAP_SPACINGS * float(np.median(steps))) if len(steps) else LEAST_GAP


def _with_last(batches: Iterable[Streams]) -> Iterator[tuple[Streams, bool]]:
    """Each batch, and whether it is the last."""
    before: Streams | None = None
    for batch in batches:
        if before is not None:
            yield before, False
        before = batch
    if before is not None:
        yield before, True


def _require_two_streams(pending: Pending, delay: float) -> None:
    wrench, orientation = pending.wrench_stamps, pending.orientation_stamps
    require_times(wrench)
    require_times(orientation)
    if orientation.rows < 2:
        raise InputError(f"{orientation.source}: found 1 orientation, expected 2 or more to interpolate between")
    require_common_span(wrench, orientation, delay)


def _nothing(pending: Pending, delay: float, delay_std: float | None) -> Synchronized:
    nowhere = None if pending.position is None else np.empty((0, 3))
    samples = _samples(pending, np.empty((0, 6)), np.empty((0, 3, 3)), np.empty(0), nowhere, delay, delay_std)
    return Synchronized(samples, np.empty(0, dtype=np.intp), (), ())


def _samples(
    pending: Pending,
    wrench: Array,
    R_base_flange: Array,
    t: Array,
    position: Array | None,
    delay: float,
    delay_std: float | None,
) -> Samples:
    known = delay if delay_std is not None else None
    source = pending.wrench_stamps.source
    return Samples(wrench, R_base_flange, t, position, None, source, known, delay_std)


def _paired(
    pending: Pending,
    n: int,
    knots: Knots,
    delay: float,
    delay_std: float | None,
    limits: Limits,
    holes: Counter[Hole],
) -> tuple[tuple[LeftOut, ...], NDArray[np.bool_], Samples]:
    """Of the first n readings that wait: those left out, which are kept, and their samples; `holes` is added to."""
    t, wrench, row = pending.t[:n], pending.wrench[:n], pending.row[:n]
    if n == 0:
        return (), np.zeros(0, dtype=bool), _nothing(pending, delay, delay_std).samples
    tau = t - delay
    at, R = pending.at[: knots.count], pending.R_base_flange[knots.index]
    arcs = arcs_through(R)
    arc, between_knots = _interval(knots.t, tau)
    step, between_rows = _interval(at, tau)
    reason = np.full(n, -1)
    for code, applies in enumerate(
        (
            ~np.isfinite(wrench).all(axis=1),
            tau < at[0],
            tau > at[-1],
            between_rows & (np.diff(at) > limits.orientation)[step],
            between_knots & (arcs.angle > LARGEST_TURN)[arc],
        )
    ):
        reason[(reason < 0) & applies] = code
    for what, start, end in ((GAP, at[step], at[step + 1]), (TURN, knots.t[arc], knots.t[arc + 1])):
        inside = reason == REASONS.index(what)
        for a, b in zip(start[inside].tolist(), end[inside].tolist(), strict=True):
            holes[Hole(what, a, b)] += 1
    kept = reason < 0
    left_out = tuple(
        LeftOut(row[reason == code], REASONS[code]) for code in range(len(REASONS)) if (reason == code).any()
    )
    arc, tau = arc[kept], tau[kept]
    share = (tau - knots.t[arc]) / np.diff(knots.t)[arc]
    position = None
    if pending.position is not None:
        start_of = pending.position[knots.index]
        position = start_of[arc] + share[:, None] * (start_of[arc + 1] - start_of[arc])
    samples = _samples(pending, wrench[kept], arcs.at(arc, share), t[kept], position, delay, delay_std)
    return left_out, kept, samples


def _interval(t: Array, moments: Array) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """For each moment the place of the interval of `t` that holds it, and whether it lies inside, not on its ends."""
    place = np.clip(np.searchsorted(t, moments, "right") - 1, 0, len(t) - 2)
    return place, (t[place] < moments) & (moments < t[place + 1])


def _count_missing_readings(pending: Pending, n: int, limits: Limits, holes: Counter[Hole]) -> None:
    t = np.r_[pending.passed, pending.t[:n]]
    for k in np.flatnonzero(np.diff(t) > limits.wrench):
        holes[Hole(WRENCH_GAP, float(t[k]), float(t[k + 1]))] += 1


def _require_enough(count: Counter[str], holes: Counter[Hole], limits: Limits, pending: Pending) -> None:
    source = pending.wrench_stamps.source
    lost = count[GAP] + count[TURN]
    inside = count["paired"] + lost
    if lost > MOST_LEFT_OUT * inside:
        what = GAP if count[GAP] >= count[TURN] else TURN
        words = {
            GAP: f"in gaps of the orientation longer than {limits.orientation:.3g} s",
            TURN: "between orientations more than 90 deg apart, where the way round is not known",
        }[what]
        first = next(hole for hole in holes if hole.what == what)
        raise InputError(
            f"{source}: {lost} of {inside} readings lie {words} (the first {_from_to(first, pending)}), expected at "
            f"most half: record the orientation more often{', or state a longer gap' if what == GAP else ''}"
        )
    if not count["paired"]:
        reasons = ", ".join(f"{count[reason]} {reason}" for reason in REASONS if count[reason])
        raise InputError(
            f"{source}: none of {sum(count.values())} readings has an orientation ({reasons}), expected both at the "
            "same time: record them together"
        )


def _notes(count: Counter[str], holes: Counter[Hole], limits: Limits, pending: Pending) -> tuple[str, ...]:
    notes = [*notes_of(pending.wrench_stamps), *notes_of(pending.orientation_stamps)]
    for reason in (BEFORE, AFTER):
        if count[reason]:
            notes.append(f"{_readings(count[reason])} {reason} left out")
    for what, words in (
        (GAP, "no orientation {}: {} left out"),
        (TURN, "the orientation turns by more than 90 deg {}, which way round is not known: {} left out"),
        (WRENCH_GAP, "no readings {}"),
    ):
        found = [hole for hole in holes if hole.what == what]
        notes += [words.format(_from_to(hole, pending), _readings(holes[hole])) for hole in found[:GAPS_NAMED]]
        if len(found) > GAPS_NAMED:
            more = sum(holes[hole] for hole in found[GAPS_NAMED:])
            left_out = "" if what == WRENCH_GAP else f", {_readings(more)} left out"
            notes.append(f"and {len(found) - GAPS_NAMED} more of these{left_out}")
    if n := count[NOT_A_NUMBER]:
        notes.append(f"{_readings(n)} that {'is not a number' if n == 1 else 'are not numbers'} left out")
    return tuple(notes)


def _from_to(hole: Hole, pending: Pending) -> str:
    return f"from {hole.start - pending.origin:.3f} s to {hole.end - pending.origin:.3f} s"


def _readings(n: int) -> str:
    return "1 reading" if n == 1 else f"{n} readings"
