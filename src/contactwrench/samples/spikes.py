"""Single readings that jump and are back in the next row: a bad contact, a lost bit."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..geometry.arrays import Array
from .limits import LONGEST_CHANCE
from .samples import SLOWEST, Samples

SPIKE, SPIKE_OF_SPAN, SPAN_LEAST, AGREE = 30.0, 0.5, 0.05, 0.1
"""Times the usual jump from row to row, and of what the channel spans but for so much at each end: a spike jumps
further, and its neighbours differ by no more of it than that. Of nine measured recordings one has any, 5 in contact.
"""
MOST_LOOKED_AT, IN_CACHE = 100_000, 4096
"""Readings that tell what is usual, drawn at random from more; and so many are looked at at once as a cache holds."""
STAYS = 0.1
"""Of a rotation's entries: rows that are apart by more do not tell what a reading in between should be."""


def spikes(samples: Samples) -> NDArray[np.bool_]:
    """Whether readings (n,) jump from both neighbours, which agree, as no tool and no push does while the arm stays."""
    wrench, R, t, spiked = samples.wrench, samples.R_base_flange, samples.t, np.zeros(len(samples), dtype=bool)
    if t is None or len(wrench) <= LONGEST_CHANCE:
        return spiked
    close = (np.diff(t) > 0.0) & (np.diff(t) <= SLOWEST)
    if not (close[1:] & close[:-1]).any():
        return spiked
    least = _least_jump(wrench)
    k = np.concatenate([_beyond(wrench, least, first) for first in range(1, len(wrench) - 1, IN_CACHE)])
    jump, apart = _jumps(wrench[k - 1], wrench[k], wrench[k + 1]), np.abs(wrench[k + 1] - wrench[k - 1])
    spiked[k] = np.any((jump > least) & (apart < AGREE * jump), axis=1)
    for i in (k - 1, k):
        spiked[k] &= close[i] & (np.abs(R[i + 1] - R[i]).max(axis=(1, 2)) < STAYS)
    return spiked


def _least_jump(wrench: Array) -> Array:
    """How far a spike jumps at the least, on each channel (6,); of so many readings always by the same draw."""
    n = len(wrench)
    k = np.arange(1, n - 1) if n <= MOST_LOOKED_AT else np.random.default_rng(n).integers(1, n - 1, MOST_LOOKED_AT)
    jumps = _jumps(wrench[k - 1], wrench[k], wrench[k + 1]).T
    usual = [np.median(each[each > 0.0]) if each.any() else np.inf for each in jumps]  # digits that stay jump by none
    span = np.ptp(np.quantile(wrench[k], [SPAN_LEAST, 1.0 - SPAN_LEAST], axis=0), axis=0)
    return np.asarray(np.maximum(SPIKE * np.array(usual), SPIKE_OF_SPAN * span))


def _beyond(wrench: Array, least: Array, first: int) -> NDArray[np.intp]:
    """The readings from the `first` on, as many as the cache holds, that jump so far."""
    last = min(first + IN_CACHE, len(wrench) - 1)
    far = _jumps(*(wrench[first + k : last + k] for k in (-1, 0, 1))) > least
    return first + np.unique(np.flatnonzero(far) // 6)


def _jumps(before: Array, now: Array, after: Array) -> Array:
    """How far readings (n, 6) are from the mean of their neighbours."""
    return np.abs(now - 0.5 * (before + after))
