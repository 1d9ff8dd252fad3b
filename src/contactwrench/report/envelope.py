"""Signals of any length as bands that a figure can hold: the least and the most in each of a few thousand bins."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..geometry.arrays import Array

MOST_BINS = 2000
FIRST_WIDTH = 0.005
"""s: of a bin, until there are too many of them."""


@dataclass(frozen=True, eq=False)
class Envelope:
    """Bins of `width` s from `start` s on: the least `low` (m, k) and the most `high` (m, k) of k signals in each, NaN
    where there was no sample.
    """

    start: float
    width: float
    low: Array
    high: Array

    @property
    def t(self) -> Array:
        """The middle of each bin (m,), s."""
        middles: Array = self.start + self.width * (np.arange(len(self.low), dtype=np.float64) + 0.5)
        return middles


def envelope(t: Array, values: Array, before: Envelope | None = None) -> Envelope:
    """The envelope of signals (n, k) at times (n,), s, none before the first of them; `before` goes on with them."""
    fine = np.isfinite(t)
    t, values = t[fine], values[fine]
    if not len(t):
        return before or Envelope(0.0, FIRST_WIDTH, np.empty((0, values.shape[1])), np.empty((0, values.shape[1])))
    if before is None or not len(before.low):
        before = Envelope(float(t.min()), FIRST_WIDTH, np.empty((0, values.shape[1])), np.empty((0, values.shape[1])))
    while (t.max() - before.start) / before.width >= MOST_BINS:
        before = _halved(before)
    place = np.maximum(((t - before.start) / before.width).astype(np.intp), 0)
    grown = _with_rows(before, max(len(before.low), int(place.max()) + 1))
    low, high = grown.low.copy(), grown.high.copy()
    np.fmin.at(low, place, values)
    np.fmax.at(high, place, values)
    return replace(grown, low=low, high=high)


def _halved(one: Envelope) -> Envelope:
    """Bins twice as wide."""
    even = _with_rows(one, len(one.low) + len(one.low) % 2)
    low, high = (values.reshape(-1, 2, values.shape[1]) for values in (even.low, even.high))
    return Envelope(one.start, 2.0 * one.width, np.fmin(low[:, 0], low[:, 1]), np.fmax(high[:, 0], high[:, 1]))


def _with_rows(one: Envelope, rows: int) -> Envelope:
    more = np.full((rows - len(one.low), one.low.shape[1]), np.nan)
    return replace(one, low=np.vstack([one.low, more]), high=np.vstack([one.high, more]))
