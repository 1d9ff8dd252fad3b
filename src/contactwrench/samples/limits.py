"""Where a channel of the sensor stood at its limit, as the readings alone show it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..geometry.arrays import Array

LONGEST_CHANCE, TIMES_USUAL, ALIVE = 20, 4.0, 0.1
"""Readings in a row at the very largest or smallest value, of which fewer may be chance, or a coarse converter; and as
many times any other run in which that channel does not move.
"""


def at_limit(wrench: Array) -> NDArray[np.bool_]:
    """Whether a channel of readings (n, 6) stands at its limit: (n,)."""
    return np.asarray(channels_at_limit(wrench).any(axis=1))


def channels_at_limit(wrench: Array) -> NDArray[np.bool_]:
    """Which channels of readings (n, 6) stand at their largest or smallest value for far longer than they ever stand
    anywhere else, while others move: (n, 6). So limits show where the recording does not say so; of a dead channel
    nothing does.
    """
    standing, moves = np.zeros(wrench.shape, dtype=bool), np.r_[True, (np.diff(wrench, axis=0) != 0.0).any(axis=1)]
    for k, values in enumerate(wrench.T if len(wrench) else ()):
        first = np.flatnonzero(np.r_[True, np.diff(values) != 0.0])
        length = np.diff(np.r_[first, len(values)])
        level = values[first]
        known = np.isfinite(level)
        extreme = (level == level.max(where=known, initial=-np.inf)) | (level == level.min(where=known, initial=np.inf))
        extreme &= np.add.reduceat(moves, first, dtype=int) > ALIVE * length
        if (other := known & ~extreme).any():
            longest = max(LONGEST_CHANCE, TIMES_USUAL * length[other].max())
            standing[:, k] = np.repeat(extreme & (length >= longest), length)
    return standing
