"""Low-pass filters as second-order sections, what they leave of white noise, both ways along a recording and a sample
at a time. The coefficients are scipy's (`scipy.signal.butter`).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import ceil, exp, pi

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError
from ..geometry.arrays import Array
from ..geometry.ranges import CUTOFF
from ..samples.timestamps import SORTED_WITHIN, default_gap
from .state import OCTAVES_HELD, SECTIONS, Matrix, Row, kernel

LAG = (1.0, 1.0, 1.414214, 2.0, 2.613126)
"""Of order 0 to 4, at an angular cut-off of 1 rad/s: the first coefficient of the Butterworth polynomial."""
LEAST_SHARE_OF_RATE = 1e-6
"""Below, the coefficients of a filter of order 4 are those of none: their last digits decide."""
SETTLED = 4.0
"""Times as long as it takes to settle, nothing is left of an impulse."""


@dataclass(frozen=True)
class LowPass:
    """A low-pass filter with `cutoff` Hz (3 dB): a Butterworth of `order` 1 to 4, or, with order 0, the first-order
    filter that sensors and drivers compute, `y += (1 - exp(-2 pi cutoff / rate)) (x - y)`.

    Raises:
        InputError: another order, or a cut-off that is no positive number.
    """

    cutoff: float
    order: int = 2

    def __post_init__(self) -> None:
        if self.order not in range(len(LAG)):
            raise InputError(
                f"order of a low-pass is {self.order}, expected 1 to 4 (Butterworth) or 0 (y += a (x - y))"
            )
        CUTOFF.require(self.cutoff, "cut-off of a low-pass")

    @property
    def lag(self) -> float:
        """How late (s) it makes what changes slowly: the group delay at rest."""
        return LAG[self.order] / (2.0 * pi * self.cutoff)

    def sections(self, rate: float) -> Array:
        """The filter at a `rate`, Hz; its gain at rest is 1.

        Returns:
            Second-order sections (k, 6), b0 b1 b2 1 a1 a2 each.

        Raises:
            InputError: a Butterworth's cut-off that is not below half the rate, or one far below it.
        """
        if self.cutoff < LEAST_SHARE_OF_RATE * rate:
            raise InputError(
                f"cut-off of a low-pass is {self.cutoff:g} Hz at {rate:g} Hz, expected at least "
                f"{LEAST_SHARE_OF_RATE * rate:g} Hz: rounding would be all that is left"
            )
        if self.order == 0:
            left = exp(-2.0 * pi * self.cutoff / rate)
            return np.array([[1.0 - left, 0.0, 0.0, 1.0, -left, 0.0]])
        if self.cutoff >= 0.5 * rate:
            raise InputError(
                f"cut-off of a low-pass is {self.cutoff:g} Hz at {rate:g} Hz, expected less than half the rate, "
                f"{0.5 * rate:g} Hz"
            )
        return _butterworth(self.order, float(self.cutoff), float(rate)).copy()

    def noise_gain(self, rate: float, pulse: ArrayLike = (1.0,)) -> float:
        """What is left of the variance of noise at a `rate`, Hz, that is white pulses of this shape: 0 to 1."""
        from scipy.signal import sosfilt

        shown = sosfilt(self.sections(rate), np.r_[pulse, np.zeros(ceil(SETTLED * self.settles_in(rate)))])
        return float(np.sum(shown**2) / np.sum(np.square(pulse)))

    def settles_in(self, rate: float) -> int:
        """Samples at a `rate`, Hz, after which 1 % is left of its start: a period of the cut-off for each order."""
        return 2 + ceil(max(self.order, 1) * rate / self.cutoff)


@lru_cache(64)
def _butterworth(order: int, cutoff: float, rate: float) -> Array:
    from scipy.signal import butter

    return np.asarray(butter(order, cutoff, fs=rate, output="sos"))


def least_rows(sections: Array) -> int:
    """How many rows `zero_phase` needs: one more than scipy adds at each end, 3 for each coefficient of the filter."""
    return 3 * (2 * len(sections) + 1) + 1


def zero_phase(values: Array, low_pass: LowPass, rate: float) -> Array:
    """A recording filtered forwards and backwards, so that nothing is delayed: not for control.

    Args:
        values: (n, k), of any unit, evenly spaced.
        low_pass: whose attenuation counts twice: 6 dB at the cut-off.
        rate: Hz.

    Returns:
        The filtered values (n, k).

    Raises:
        InputError: a row that is not finite, or a recording that is too short to start the filter on.
    """
    from scipy.signal import sosfiltfilt

    if not np.isfinite(values).all():
        row = int(np.argmax(~np.isfinite(values).all(axis=1)))
        raise InputError(f"row {row} is not finite, expected numbers: filter the stretches before and after it", row)
    sections = low_pass.sections(rate)
    least = least_rows(sections)
    if len(values) < least:
        raise InputError(f"found {len(values)} rows, expected at least {least} to filter both ways")
    return np.asarray(sosfiltfilt(sections, values, axis=0))


def smoothed(t: Array, values: Array, low_pass: LowPass) -> Array:
    """A recording of values (n, k) at times (n,), s, filtered both ways, each section between gaps by itself, in the
    order of its stamps. Rows that are not finite stay as they are, and a section that is too short to start the filter
    on becomes its mean. Raises `InputError` for times without a rate, and a cut-off that is too high for theirs.
    """
    finite = np.isfinite(values).all(axis=1)
    known = t[finite]
    steps = np.diff(known)
    cut = (steps > default_gap(known)) | (steps <= -SORTED_WITHIN)
    spacing = float(steps[~cut].mean()) if not cut.all() else 0.0
    if not spacing > 0.0:
        raise InputError("found times that stand still, expected a recording with a rate: leave the low-pass out")
    filtered, least = values[finite], least_rows(low_pass.sections(1.0 / spacing))
    for section in np.split(np.arange(len(known)), np.flatnonzero(cut) + 1):
        rows = section[np.argsort(known[section], kind="stable")]
        long = len(rows) >= least
        filtered[rows] = zero_phase(filtered[rows], low_pass, 1.0 / spacing) if long else filtered[rows].mean(axis=0)
    result = values.copy()
    result[finite] = filtered
    return result


def use_low_passes(rate: float, *filters: tuple[LowPass | None, Matrix]) -> None:
    """Write the sections of each at a rate, Hz, into its own, as the kernel has them; nothing for none. Raises
    `InputError` where one does not take the rate, and has written none then.
    """
    made = [[] if each is None else each.sections(rate)[:, [0, 1, 2, 4, 5]].tolist() for each, _ in filters]
    for (_, into), sections in zip(filters, made, strict=True):
        for row, section in zip(into, sections, strict=False):
            row[:] = section


def gains_of_poses(low_pass: LowPass | None, rate: float | None) -> list[float]:
    """What a low-pass leaves of the variance of second differences of white noise, held for 1, 2, 4, ... samples. Most
    of that noise is fast, and it leaves little.
    """
    if low_pass is None or rate is None:
        return [1.0] * OCTAVES_HELD
    return [low_pass.noise_gain(rate, np.repeat([1.0, -2.0, 1.0], 2**octave)) for octave in range(OCTAVES_HELD)]


@kernel
def low_pass(filter: Matrix, memory: Matrix, values: Row, count: int, fresh: bool) -> None:
    """Filter `count` values in place: second-order sections, transposed direct form II. A `fresh` filter starts as if
    these values had been there for ever.
    """
    for section in range(SECTIONS):
        c, first, second = filter[section], memory[2 * section], memory[2 * section + 1]
        b0, b1, b2, a1, a2 = c[0], c[1], c[2], c[3], c[4]
        if b0 == 0.0:
            return
        for k in range(count):
            x = values[k]
            if fresh:
                steady = x * (b0 + b1 + b2) / (1.0 + a1 + a2)
                first[k] = steady - b0 * x
                second[k] = b2 * x - a2 * steady
            y = b0 * x + first[k]
            first[k] = b1 * x - a1 * y + second[k]
            second[k] = b2 * x - a2 * y
            values[k] = y
