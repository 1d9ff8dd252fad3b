"""Rows that a program handed on many at a time: a buffer that is emptied five times a second stamps them alike.

Sensor and robot took them evenly. A burst is spread over the time since the burst before, of which its last row is the
newest; by how much that one was late all the same, the search for a delay finds.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import chain
from typing import Any, TypeVar

import numpy as np

from ..geometry.arrays import Array
from .samples import OrientationStream, Samples, Streams, WrenchStream
from .timestamps import Stamps, stamps_after

JUDGED_BY, LOOKED_AHEAD = 8.0, 24.0
"""s at the begin of a stream, by which it is judged; where the other lasts so long, what has come has to do."""
LEAST, MOST = 0.005, 1.0
"""s from one burst to the next: less is a clock that counts coarsely, more are stops, each recorded by itself."""
FEWEST_BURSTS, FEWEST_ROWS = 5, 3
"""Of two rows with nearly the same stamp, one is a message that came twice, as a rule."""
INSIDE, OUTSIDE = 0.4, 10.0
"""Of the steps from row to row at least so many lie in bursts, and are as many times shorter than the step in which
half of the time passes; of an even stream all are that.
"""
WITHIN = 0.2
"""Of the time passes within bursts, at most."""
REGULAR = 0.25
"""Part by which the rows of half of the bursts are off, at most, those that the time since the last would hold."""
ON_A_GRID = 0.05
"""Of a tick, that all stamps are off a whole number of ticks, at most, where a clock counts so coarsely."""
LONGEST = 1.5
"""Times the period of its rows, that a burst is spread over: before it is a gap."""

Stream = TypeVar("Stream", WrenchStream, OrientationStream)


@dataclass(frozen=True)
class Bursts:
    """A new burst begins after more than `pause` s; `period`, s from row to row as they were taken; how many `rows` a
    burst has.
    """

    pause: float
    period: float
    rows: int

    def in_words(self, stream: str) -> str:
        """What is said of the stream."""
        each = 1e3 * self.rows * self.period
        return f"the {stream} came in bursts of {self.rows} rows each {each:.3g} ms: spread evenly between them"


def bursts_in(t: Array) -> Bursts | None:
    """The bursts of a stream with stamps (n,), s; None where its rows come evenly, out of order, or too few."""
    steps = np.diff(t[t <= t[0] + JUDGED_BY]) if len(t) else t
    if len(steps) < FEWEST_BURSTS * FEWEST_ROWS or not steps.min() >= 0.0:
        return None
    by_length = np.sort(steps)
    passed = np.cumsum(by_length)
    usual = float(by_length[np.searchsorted(passed, 0.5 * passed[-1])])
    short = float(np.quantile(steps, INSIDE))
    if not LEAST <= usual <= MOST or usual < OUTSIDE * short:
        return None
    last = np.flatnonzero(steps > 0.5 * usual)
    if len(last) < FEWEST_BURSTS or steps[steps <= 0.5 * usual].sum() > WITHIN * passed[-1]:
        return None
    ticks = steps[steps > 0.0] / steps[steps > 0.0].min()
    if short == 0.0 and float(np.abs(ticks - np.rint(ticks)).max()) < ON_A_GRID:
        return None
    rows, time = np.diff(last), np.diff(t[last])
    period = float(np.median(time / rows))
    regular = float(np.median(np.abs(rows * period / time - 1.0))) <= REGULAR
    count = int(np.median(rows))
    return Bursts(0.5 * usual, period, count) if regular and count >= FEWEST_ROWS else None


def spread(t: Array, bursts: Bursts | None, before: float = np.nan, begun: float = np.nan) -> Array:
    """Stamps (n,), s, each burst spread over the time since the one that ended at `before`; rows that come evenly, or
    out of order, stay. `begun`: when the first rows began to come, where others of them are done with.
    """
    if bursts is None or not len(t):
        return t
    steps = np.diff(t)
    last = np.r_[np.flatnonzero(steps > bursts.pause), len(t) - 1]
    first = np.r_[0, last[:-1] + 1]
    rows, end, start = last - first + 1, t[last], t[first]
    start[0] = np.fmin(start[0], begun)
    inner = np.r_[0.0, steps]
    inner[first] = 0.0
    handed_on = (np.minimum.reduceat(inner, first) >= 0.0) & (end - start <= bursts.pause)
    step = np.diff(np.r_[before, end]) / rows
    step[~(step <= LONGEST * bursts.period)] = bursts.period
    evenly = np.repeat(end, rows) - (np.repeat(last, rows) - np.arange(len(t))) * np.repeat(step, rows)
    return np.where(np.repeat(handed_on, rows), evenly, t)


def even_rows(samples: Samples) -> tuple[Samples, tuple[str, ...]]:
    """Samples whose rows each came with an orientation, evenly, and what there is to say of that."""
    bursts = None if samples.t is None else bursts_in(samples.t)
    if samples.t is None or bursts is None:
        return samples, ()
    return replace(samples, t=spread(samples.t, bursts)), (bursts.in_words("recording"),)


def evened(batches: Iterable[Streams]) -> tuple[Iterator[Streams], tuple[str, ...]]:
    """The rows of a recording in batches, in which those streams that came in bursts are spread evenly, and what there
    is to say of that; a burst that is not whole yet comes with the next batch. Raises `InputError` for the stamps of a
    stream that came in bursts, where these cannot be put in order.
    """
    coming, first = iter(batches), list[Streams]()
    for batch in coming:
        first.append(batch)
        lasts = [float(t[-1] - t[0]) if len(t) else 0.0 for t in _stamps_of(first)]
        if min(lasts) > JUDGED_BY or max(lasts) > LOOKED_AHEAD:
            break
    wrench, orientation = map(_Handed, ("wrench", "orientation"), _stamps_of(first))
    notes, every = (*wrench.notes, *orientation.notes), chain(first, coming)

    def with_bursts_spread() -> Iterator[Streams]:
        now = next(every, None)
        while now is not None:
            following = next(every, None)
            is_last = following is None
            yield replace(
                now,
                wrench=wrench.spread(now.wrench, is_last),
                orientation=orientation.spread(now.orientation, is_last),
            )
            now = following

    return with_bursts_spread() if notes else every, notes


def _stamps_of(batches: list[Streams]) -> tuple[Array, Array]:
    nothing = np.empty(0)
    return (
        np.concatenate([nothing, *(batch.wrench.t for batch in batches)]),
        np.concatenate([nothing, *(batch.orientation.t for batch in batches)]),
    )


class _Handed:
    """The stream `name` as it is handed on, judged by the stamps (n,) of its begin: the rows that wait for the end of
    their burst, when these began to come, and when the burst before ended.
    """

    def __init__(self, name: str, begin: Array) -> None:
        self._name, self._bursts, self._waits = name, bursts_in(begin), list[Any]()
        self._end = self._begun = np.nan
        self._stamps: Stamps | None = None
        self.notes = [] if self._bursts is None else [self._bursts.in_words(name)]

    def spread(self, come: Stream, is_last: bool) -> Stream:
        """The rows whose bursts are whole, and those that come evenly meanwhile."""
        if self._bursts is None or not len(come) + len(self._waits):
            return come
        before = self._stamps or Stamps(self._name, come.source)
        self._stamps = stamps_after(before, come.t, min(before.first, float(come.t.min(initial=np.inf))))
        rows = type(come).concatenate([*self._waits, come])
        t, begin = rows.t, 0
        if len(later := np.flatnonzero(np.diff(t) > self._bursts.pause)):
            begin = int(later[-1]) + 1
        since = float(t[begin]) if begin else float(np.fmin(t[:1].min(initial=np.inf), self._begun))
        is_even = len(t) > 0 and t[-1] - since > self._bursts.pause
        whole = len(t) if is_last or is_even else begin
        done, end, begun = rows.select(slice(whole)), self._end, self._begun
        self._waits, self._begun = [rows.select(slice(whole, None))], since if is_even else np.nan
        self._end = float(done.t[-1]) if whole else end
        return replace(done, t=spread(done.t, self._bursts, end, begun))
