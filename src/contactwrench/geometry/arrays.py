"""Arrays of float64, and copies that cannot be written to."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array: TypeAlias = NDArray[np.float64]


def read_only(values: ArrayLike) -> Array:
    """A float64 copy that cannot be written to."""
    copy = np.array(values, dtype=np.float64, order="C")
    copy.flags.writeable = False
    return copy


def flags(values: ArrayLike) -> NDArray[np.bool_]:
    """A copy, true or false each, that cannot be written to."""
    copy = np.array(values, dtype=np.bool_)
    copy.flags.writeable = False
    return copy
