"""What a Compensator is told, checked, and the flat sequences that its kernel takes."""

from __future__ import annotations

from math import inf
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..calibration.calibration import Calibration
from ..errors import InputError
from ..geometry.arrays import Array
from ..samples.delay import is_significant
from .filters import LowPass


def arrays(values: Array) -> Any:
    """Numbers as the compiled kernel takes them."""
    return np.array(values)


def lists(values: Array) -> Any:
    """Numbers as the plain kernel takes them."""
    return values.tolist()


def delay_of(calibration: Calibration, sensor_filter: LowPass | None = None) -> float:
    """The calibration's delay where its data tell it from zero, else 0; less the lag of a filter that is made up for by
    itself: what was estimated from a motion contains it.
    """
    if calibration.delay is None or calibration.delay_std is None:
        return 0.0
    if not is_significant(calibration.delay, calibration.delay_std):
        return 0.0
    return calibration.delay - (0.0 if sensor_filter is None else sensor_filter.lag)


def six(values: ArrayLike | None, what: str, default: float, least: float = -inf) -> Array:
    """Six finite numbers of at least `least`, or the default. Raises `InputError` that names `what`."""
    if values is None:
        return np.full(6, default)
    array = np.asarray(values, dtype=np.float64)
    if array.shape != (6,) or not np.isfinite(array).all() or (array < least).any():
        raise InputError(
            f"{what} is {array.tolist()}, expected six {'positive ' if least > -inf else ''}finite numbers"
        )
    return array


def positive(value: float, what: str, unit: str) -> float:
    """A positive, finite number. Raises `InputError` that names `what`."""
    if not 0.0 < value < inf:
        raise InputError(f"{what} is {value:g} {unit}, expected a positive number")
    return float(value)
