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

JUDGED_BY = 8.0
"""s at the begin of a stream, by which it is judged."""
LEAST, MOST = 0.005, 1.0
"""s from one burst to the next: less is a clock that counts coarsely, more are stops, each recorded by itself."""
FEWEST_BURSTS, FEWEST_ROWS = 5, 2
"""Two rows with the very same stamp are one that came twice."""
INSIDE, OUTSIDE = 0.4, 10.0
"""Of the steps from row to row at least so many lie in bursts, and are as many times shorter than the step in which
half of the time passes; of an even stream all are that.
"""
IN_BURSTS = 0.2
"""Of the time: bursts hold no more."""
REGULAR = 0.25
"""Of the time of a burst, that half of them are off by at most: as many rows as the time since the last would hold."""
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
    if len(last) < FEWEST_BURSTS or steps[steps <= 0.5 * usual].sum() > IN_BURSTS * passed[-1]:
        return None
    rows, time = np.diff(last), np.diff(t[last])
    period = float(np.median(time / rows))
    regular = float(np.median(np.abs(rows * period / time - 1.0))) <= REGULAR
    count = int(np.median(rows))
    return Bursts(0.5 * usual, period, count) if regular and count >= FEWEST_ROWS + (short == 0.0) else None


def spread(t: Array, bursts: Bursts | None, before: float = np.nan) -> Array:
    """Stamps (n,), s, of whole bursts, each spread over the time since the burst `before` it."""
    if bursts is None or not len(t):
        return t
    last = np.r_[np.flatnonzero(np.diff(t) > bursts.pause), len(t) - 1]
    rows, end = np.diff(np.r_[-1, last]), t[last]
    step = np.fmin(np.diff(np.r_[before, end]) / rows, LONGEST * bursts.period)
    step[np.isnan(step)] = bursts.period
    return np.asarray(np.repeat(end, rows) - (np.repeat(last, rows) - np.arange(len(t))) * np.repeat(step, rows))


def even_rows(samples: Samples) -> tuple[Samples, tuple[str, ...]]:
    """Samples whose rows each came with an orientation, evenly, and what there is to say of that."""
    bursts = None if samples.t is None else bursts_in(samples.t)
    if samples.t is None or bursts is None:
        return samples, ()
    return replace(samples, t=spread(samples.t, bursts)), (bursts.in_words("recording"),)


class Even:
    """A recording in batches, of which those streams that came in bursts are spread evenly; `notes` say so."""

    def __init__(self) -> None:
        self.notes: tuple[str, ...] = ()

    def whole(self, streams: Streams) -> Streams:
        """A recording that is there as a whole."""
        return next(self.batches([streams]))

    def batches(self, batches: Iterable[Streams]) -> Iterator[Streams]:
        """The same rows in as many batches; a burst that is not whole yet comes with the next."""
        coming, first = iter(batches), list[Streams]()
        for batch in coming:
            first.append(batch)
            if all(_is_long(t) for t in _stamps_of(first)):
                break
        wrench, orientation = (_Handed(t) for t in _stamps_of(first))
        self.notes = (*wrench.notes("wrench"), *orientation.notes("orientation"))
        rest = chain(first, coming)
        if not self.notes:
            yield from rest
            return
        now = next(rest, None)
        while now is not None:
            following = next(rest, None)
            is_last = following is None
            yield replace(
                now,
                wrench=wrench.spread(now.wrench, is_last),
                orientation=orientation.spread(now.orientation, is_last),
            )
            now = following


def _stamps_of(batches: list[Streams]) -> tuple[Array, Array]:
    nothing = np.empty(0)
    return (
        np.concatenate([nothing, *(batch.wrench.t for batch in batches)]),
        np.concatenate([nothing, *(batch.orientation.t for batch in batches)]),
    )


def _is_long(t: Array) -> bool:
    return len(t) > 0 and t[-1] - t[0] > JUDGED_BY


class _Handed:
    """A stream as it is handed on, judged by the stamps (n,) of its begin: the rows that wait for the end of their
    burst, and when the burst before ended.
    """

    def __init__(self, begin: Array) -> None:
        self._bursts, self._waits, self._end = bursts_in(begin), list[Any](), np.nan

    def notes(self, stream: str) -> list[str]:
        """What there is to say of it."""
        return [] if self._bursts is None else [self._bursts.in_words(stream)]

    def spread(self, come: Stream, is_last: bool) -> Stream:
        """The rows whose bursts are whole."""
        if self._bursts is None:
            return come
        rows = type(come).concatenate([*self._waits, come])
        begins = np.flatnonzero(np.diff(rows.t) > self._bursts.pause) + 1
        whole = len(rows) if is_last else int(begins[-1]) if len(begins) else 0
        self._waits, done = [rows.select(slice(whole, None))], rows.select(slice(whole))
        end, self._end = self._end, float(done.t[-1]) if whole else self._end
        return replace(done, t=spread(done.t, self._bursts, end))
