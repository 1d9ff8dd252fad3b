"""Readings of a channel that stands at its limit, in recordings that do not say so: flat tops."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..geometry.arrays import Array

LONGEST_CHANCE = 20
"""Readings in a row at the very largest or smallest value: fewer may be chance, or a coarse converter."""
TIMES_USUAL = 4.0
"""As long as this many times any other run of readings in which that channel does not move."""


def at_limit(wrench: Array) -> NDArray[np.bool_]:
    """Whether a channel of readings (n, 6) stands at its largest or smallest value for far longer than it ever stands
    anywhere else: (n,). A channel that is never still for one reading longer than chance stands nowhere.
    """
    standing = np.zeros(len(wrench), dtype=bool)
    for values in wrench.T if len(wrench) else ():
        first = np.flatnonzero(np.r_[True, np.diff(values) != 0.0])
        length = np.diff(np.r_[first, len(values)])
        known = np.isfinite(values[first])
        if not known.any():
            continue
        level = values[first]
        extreme = (level == level[known].max()) | (level == level[known].min())
        elsewhere = int(length[~extreme].max(initial=1))
        flat = extreme & (length >= max(LONGEST_CHANCE, TIMES_USUAL * elsewhere))
        standing |= np.repeat(flat, length)
    return standing
