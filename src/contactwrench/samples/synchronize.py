"""Two streams onto one clock: the orientation at the times of the wrench, by rotation between recorded orientations.

A reading stamped t belongs to the orientation at t - delay. Orientations are interpolated along the shortest turn, only
where the recording has them: not before the first, not after the last, not in a gap. What is left out says why.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..geometry.arrays import Array, Frozen
from ..geometry.rotations import arcs_through
from ..statistics import counted
from .buffer import Buffer, Nodes, Readings, nodes_at_pace, nodes_of, with_batch
from .bursts import evened
from .samples import ReadAs, Samples, Streams
from .timestamps import default_gap, notes_of, require_common_span, require_times

LARGEST_TURN = np.pi / 2.0
"""Between two orientations: after more, which way round the arm went is a guess."""
MOST_LEFT_OUT = 0.5
"""Of the readings that lie within the recorded orientations: where gaps take more, it is no recording of a motion."""
LONGEST_ON_THE_WAY = 1.5
"""s between two orientations, however rarely they come: in more an arm stops at a third, as in a table of poses."""
GAPS_NAMED = 5

WRENCH_GAP = "in a gap of the wrench"
BEFORE, AFTER = "before the first orientation", "after the last orientation"
GAP, TURN = "in a gap of the orientation", "between two orientations more than 90 deg apart"
NOT_A_NUMBER = "the reading is not a number"
REASONS = (NOT_A_NUMBER, BEFORE, AFTER, GAP, TURN)


@dataclass(frozen=True)
class Hole:
    """Where something is missing: a gap of a stream, or a turn that is too large; `start` and `end` s, as stamped."""

    what: str
    start: float
    end: float


@dataclass(frozen=True, eq=False)
class LeftOut(Frozen):
    """Rows (k,) of the wrench stream, counted from 0 as they were recorded, that have no sample, and the reason."""

    rows: NDArray[np.intp]
    reason: str


@dataclass(frozen=True, eq=False)
class Synchronized(Frozen):
    """`samples`: readings in the order of their stamps, each with the orientation (and position) of its moment; `t` is
    the wrench's stamps. `rows` (k,): the rows of the wrench stream that they are, counted from 0 as recorded.
    `left_out`: all other rows, by reason. `notes`: what was put right or left out, in sentences with times counted from
    the recording's first stamp; of a recording in batches they come with the last.
    """

    samples: Samples
    rows: NDArray[np.intp]
    left_out: tuple[LeftOut, ...]
    notes: tuple[str, ...] = ()


def synchronize(
    streams: Streams,
    delay: float = 0.0,
    delay_std: float | None = None,
    longest_gap: float | None = None,
    at_their_pace: bool = False,
) -> Synchronized:
    """The samples of a recording: every reading with the orientation at its stamp less the delay.

    A pose that is repeated for up to 0.15 s and then changes was held: its first stamp counts. A stream that came in
    bursts is spread evenly (bursts.py).

    Args:
        streams: the recording.
        delay: how much later than the orientation the wrench is stamped, s.
        delay_std: of the delay, s; where it is given, the samples carry both.
        longest_gap: between two orientations with samples between them, s; None: 5 times their median spacing, at
            least 0.05 s and at most 1.5 s.
        at_their_pace: orientations that were sent evenly and stamped as they came are put where they were sent, so that
            an acceleration can be taken from them.

    Returns:
        The samples, which rows of the wrench stream they are, and what was left out and put right.

    Raises:
        InputError: stamps that cannot be put in order, streams without a common span, gaps that leave less than half
            of it.
    """
    return next(synchronized([streams], delay, delay_std, longest_gap, at_their_pace))


def synchronized(
    batches: Iterable[Streams],
    delay: float = 0.0,
    delay_std: float | None = None,
    longest_gap: float | None = None,
    at_their_pace: bool = False,
) -> Iterator[Synchronized]:
    """The same for a long recording in consecutive batches: for each what is decided by then; together exactly what
    `synchronize` makes of the whole, and its errors.

    Held back are 0.1 s, for messages that come late, and what one stream is ahead of the other; everything, where
    orientations are put `at_their_pace`. Where `longest_gap` is None, the rule above is applied to the first
    orientations alone.
    """
    if not np.isfinite(delay):
        raise InputError(f"delay is {delay!r}, expected s")
    if longest_gap is not None and not longest_gap > 0.0:
        raise InputError(f"longest_gap is {longest_gap!r}, expected s above 0")
    pairing = _Pairing(delay, delay_std, longest_gap, at_their_pace)
    batches, of_bursts = evened(batches)
    before: Streams | None = None
    for batch in batches:
        if before is not None:
            yield pairing.with_batch(before, is_last=False)
        before = batch
    if before is not None:
        whole = pairing.with_batch(before, is_last=True)
        yield replace(whole, notes=(*of_bursts, *whole.notes))


class _Pairing:
    """A recording as its batches come: the rows that wait, and what of those before has no sample. The longest times,
    s, between two orientations, and two readings, that are no gap are 0 until they are known.
    """

    def __init__(self, delay: float, delay_std: float | None, longest_gap: float | None, at_their_pace: bool) -> None:
        self._delay, self._delay_std, self._at_their_pace = delay, delay_std, at_their_pace
        self._longest_gap, self._wrench_gap = longest_gap or 0.0, 0.0
        self._buffer: Buffer | None = None
        self._count: Counter[str] = Counter()
        self._holes: Counter[Hole] = Counter()
        self._read_as: ReadAs = {}
        self._pose_period: float | None = None

    def with_batch(self, batch: Streams, is_last: bool) -> Synchronized:
        """The samples that a batch decides."""
        self._read_as = batch.read_as
        buffer = self._buffer = with_batch(self._buffer, batch)
        if is_last:
            _require_two_streams(buffer, self._delay)
        if not self._wrench_gap and (is_last or buffer.is_begun):
            self._longest_gap = self._longest_gap or min(default_gap(buffer.orientations.t), LONGEST_ON_THE_WAY)
            self._wrench_gap = default_gap(buffer.readings.t)
        if not self._wrench_gap or (self._at_their_pace and not is_last):
            return self._nothing(buffer)
        nodes = nodes_of(buffer, self._longest_gap, is_last)
        if self._at_their_pace and len(nodes.t) > 2:
            nodes = nodes_at_pace(buffer, nodes)
        if self._pose_period is None and len(nodes.t) > 1:
            self._pose_period = float(np.median(np.diff(nodes.t)))
        n = buffer.decided(nodes.until + self._delay, is_last) if len(nodes.t) > 1 else 0  # one alone: none is between
        pairs = self._paired(buffer, n, nodes) if n else self._nothing(buffer)
        self._count.update({part.reason: len(part.rows) for part in pairs.left_out}, paired=len(pairs.rows))
        t = np.r_[buffer.passed, buffer.readings.t[:n]]
        for k in np.flatnonzero(np.diff(t) > self._wrench_gap):
            self._holes[Hole(WRENCH_GAP, float(t[k]), float(t[k + 1]))] += 1
        self._buffer = buffer.after(n, nodes, self._delay)
        if not is_last:
            return pairs
        self._require_enough(buffer)
        return replace(pairs, notes=self._notes(buffer))

    def _nothing(self, buffer: Buffer) -> Synchronized:
        nowhere = None if buffer.orientations.position is None else np.empty((0, 3))
        readings = buffer.readings.select(slice(0))
        return Synchronized(self._samples(readings, np.empty((0, 3, 3)), nowhere), readings.row, ())

    def _samples(self, readings: Readings, R_base_flange: Array, position: Array | None) -> Samples:
        return Samples(
            readings.wrench,
            R_base_flange,
            readings.t,
            position,
            readings.load_mass,
            readings.source,
            self._delay if self._delay_std is not None or self._delay else None,
            0.0 if self._delay_std is None and self._delay else self._delay_std,  # stated
            readings.saturated,
            self._read_as,
            pose_period=self._pose_period,
        )

    def _paired(self, buffer: Buffer, n: int, nodes: Nodes) -> Synchronized:
        """Of the first n readings that wait the samples, and those left out."""
        readings, orientations = buffer.readings.select(slice(n)), buffer.orientations
        tau, t = readings.t - self._delay, orientations.t[: nodes.count]
        arcs = arcs_through(orientations.R_base_flange[nodes.index])
        arc, between_nodes = _interval(nodes.t, tau)
        step, between_rows = _interval(t, tau)
        applies = [
            ~np.isfinite(readings.wrench).all(axis=1),
            tau < t[0],
            tau > t[-1],
            between_rows & (np.diff(t) > self._longest_gap)[step],
            between_nodes & (arcs.angle > LARGEST_TURN)[arc],
        ]
        reason = np.select(applies, [*range(len(REASONS))], -1)
        for what, start, end in ((GAP, t[step], t[step + 1]), (TURN, nodes.t[arc], nodes.t[arc + 1])):
            inside = reason == REASONS.index(what)
            for a, b in zip(start[inside].tolist(), end[inside].tolist(), strict=True):
                self._holes[Hole(what, a, b)] += 1
        codes = np.unique(reason[reason >= 0]).tolist()
        left_out = tuple(LeftOut(readings.row[reason == code], REASONS[code]) for code in codes)
        kept = reason < 0
        readings, arc, tau = readings.select(kept), arc[kept], tau[kept]
        share = (tau - nodes.t[arc]) / np.diff(nodes.t)[arc]
        position = None
        if orientations.position is not None:
            start_of = orientations.position[nodes.index]
            position = start_of[arc] + share[:, None] * (start_of[arc + 1] - start_of[arc])
        return Synchronized(self._samples(readings, arcs.at(arc, share), position), readings.row, left_out)

    def _require_enough(self, buffer: Buffer) -> None:
        count, source = self._count, buffer.wrench_stamps.source
        lost = count[GAP] + count[TURN]
        inside = count["paired"] + lost
        if lost > MOST_LEFT_OUT * inside:
            what = GAP if count[GAP] >= count[TURN] else TURN
            words = {
                GAP: f"in gaps of the orientation longer than {self._longest_gap:.3g} s",
                TURN: "between orientations more than 90 deg apart, where the way round is not known",
            }[what]
            first = next(hole for hole in self._holes if hole.what == what)
            longer = ", or state a longer gap" if what == GAP else ""
            raise InputError(
                f"{source}: {lost} of {inside} readings lie {words} (the first {_from_to(first, buffer)}), expected at "
                f"most half: record the orientation more often{longer}"
            )
        if not count["paired"]:
            reasons = ", ".join(f"{count[reason]} {reason}" for reason in REASONS if count[reason])
            raise InputError(
                f"{source}: none of {sum(count.values())} readings has an orientation ({reasons}), expected both at "
                "the same time: record them together"
            )

    def _notes(self, buffer: Buffer) -> tuple[str, ...]:
        count = self._count
        notes = [*notes_of(buffer.wrench_stamps), *notes_of(buffer.orientation_stamps)]
        notes += [
            f"{counted(count[reason], 'reading')} {reason} left out" for reason in (BEFORE, AFTER) if count[reason]
        ]
        for what, words in (
            (GAP, "no orientation {}: {} left out"),
            (TURN, "the orientation turns by more than 90 deg {}, which way round is not known: {} left out"),
            (WRENCH_GAP, "no readings {}"),
        ):
            holes = {hole: n for hole, n in self._holes.items() if hole.what == what}
            named = list(holes)[:GAPS_NAMED]
            notes += [words.format(_from_to(hole, buffer), counted(holes.pop(hole), "reading")) for hole in named]
            if holes:
                left_out = "" if what == WRENCH_GAP else f", {counted(sum(holes.values()), 'reading')} left out"
                notes.append(f"and {len(holes)} more of these{left_out}")
        if n := count[NOT_A_NUMBER]:
            notes.append(f"{counted(n, 'reading')} that {'is not a number' if n == 1 else 'are not numbers'} left out")
        return tuple(notes)


def _require_two_streams(buffer: Buffer, delay: float) -> None:
    wrench, orientation = buffer.wrench_stamps, buffer.orientation_stamps
    require_times(wrench)
    require_times(orientation)
    if orientation.rows < 2:
        raise InputError(f"{orientation.source}: found 1 orientation, expected 2 or more to interpolate between")
    require_common_span(wrench, orientation, delay)


def _interval(t: Array, moments: Array) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """For each moment the place of the interval of `t` that holds it, and whether it lies inside, not on its ends."""
    place = np.clip(np.searchsorted(t, moments, "right") - 1, 0, len(t) - 2)
    return place, (t[place] < moments) & (moments < t[place + 1])


def _from_to(hole: Hole, buffer: Buffer) -> str:
    return f"from {hole.start - buffer.origin:.3f} s to {hole.end - buffer.origin:.3f} s"
