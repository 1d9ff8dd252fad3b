"""Readings in motion as moments by frequency: all that a fit to them needs, a few numbers for each second.

The recording is seen through sine windows that overlap by half, so that each reading counts once (their squares sum to
1). In each window the readings and whatever a tool's wrench is linear in are taken apart by frequency, and in each band
of frequencies their products are summed. Noise of any colour is then one variance for each band (Whittle, 1953), and a
window in which something else was felt shows by itself.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..calibration.dynamics import TERMS
from ..geometry.arrays import Array
from ..samples.flange_motion import FlangeMotion
from ..samples.samples import Samples
from ..samples.timestamps import default_gap, spread_evenly

WINDOW = 2.0
"""s."""
BANDS = (0.75, 1.75, 3.25, 5.25, 7.75, 11.0, 15.5, 22.0, 31.0, 44.0, 62.0)
"""Hz, where a band ends and the next begins."""
FLAT = 0.75
"""Of the bandwidth: so far the motion is as it was."""
NEARLY_ALL, LEVER = 0.999, 0.1
"""Of the power of an acceleration, m from the flange: up to where that is, bands are used. Beyond, a window shows what
leaks from below, the same in all bands, and would count as often as there are bands.
"""
MOSTLY = 0.99
"""Of that power: what is beyond is an edge of it, as of a motion whose acceleration jumps."""
MOST_WINDOWS = 600
"""Of ten minutes; of a longer recording as many, evenly."""
MOVING = 0.02
"""rad/s and m/s^2, RMS over a window: slower, the arm stands."""
ORIENTATION, ONE, MOTION = slice(0, 9), 9, slice(10, 10 + TERMS)
REGRESSORS = 10 + TERMS
"""The first columns: `R_base_flange` row by row, 1, and the `terms` of the motion."""
CHANGES, BENDS = slice(REGRESSORS, 2 * REGRESSORS), slice(2 * REGRESSORS, 3 * REGRESSORS)
READINGS = slice(3 * REGRESSORS, 3 * REGRESSORS + 6)
"""Then their first and second derivatives, 1/s and 1/s^2, and the six of the wrench."""


@dataclass(frozen=True, eq=False)
class MotionMoments:
    """Of w windows of so many `rows`, and b bands up to `most` Hz: `products` (w, b, 72, 72) of the columns and the
    readings, and how many frequencies, both signs counted, each band has in a window, `count` (b,). Up to `usual` Hz is
    most of the motion.
    """

    products: Array
    count: Array
    rows: int
    most: float
    usual: float

    @property
    def seconds(self) -> float:
        """Of motion, that the windows show."""
        return 0.5 * WINDOW * len(self.products)


def motion_moments(samples: Samples, motion: FlangeMotion) -> MotionMoments:
    """The moments of the windows in which the arm moves, up to where it does, within the motion's bandwidth."""
    t = spread_evenly(np.asarray(samples.t))
    period = float(np.median(np.diff(t)))
    rows = max(2 * round(0.5 * WINDOW / period), 4)
    starts = _moving_windows(t, motion, rows)
    if len(starts) > MOST_WINDOWS:
        starts = starts[np.linspace(0, len(starts) - 1, MOST_WINDOWS).astype(int)]
    frequency = np.fft.rfftfreq(rows, period)
    if not len(starts):
        return MotionMoments(np.empty((0, 1, READINGS.stop, READINGS.stop)), np.ones(1), rows, 0.0, 0.0)
    most, usual = (
        min(FLAT * motion.bandwidth, up_to) for up_to in _where_shares_are(motion, rows, period, (NEARLY_ALL, MOSTLY))
    )
    ends = np.array([*(edge for edge in BANDS if edge < most), np.inf])
    band = np.searchsorted(ends, frequency, "right")
    band[frequency > most] = -1
    both = np.where(frequency > 0.0, 2.0, 1.0)
    taper = np.sin(np.pi * (np.arange(rows) + 0.5) / rows)[:, None]
    regressors = np.column_stack([motion.R_base_flange.reshape(-1, 9), np.ones(len(t)), motion.terms])
    changes = np.gradient(regressors, t, axis=0)
    columns = np.concatenate([regressors, changes, np.gradient(changes, t, axis=0), samples.wrench], axis=1)
    used = [(b, np.flatnonzero(band == b)) for b in range(len(ends))]
    used = [(b, place) for b, place in used if len(place)]
    products = np.empty((len(starts), len(used), columns.shape[1], columns.shape[1]))
    for k, start in enumerate(starts.tolist()):
        seen = np.fft.rfft(columns[start : start + rows] * taper, axis=0, norm="ortho") * np.sqrt(both)[:, None]
        for b, (_, place) in enumerate(used):
            products[k, b] = (seen[place].conj().T @ seen[place]).real
    return MotionMoments(products, np.array([both[place].sum() for _, place in used]), rows, most, usual)


def _where_shares_are(motion: FlangeMotion, rows: int, period: float, shares: tuple[float, ...]) -> list[float]:
    """Hz, up to which such shares of the power of the motion's accelerations lie."""
    from scipy.signal import welch

    accelerations = LEVER * motion.angular_acceleration
    if not motion.of_accelerometer:  # whose own noise, up to its Nyquist frequency, is no motion
        accelerations = np.column_stack([motion.acceleration, accelerations])
    known = accelerations * motion.inside[:, None]
    frequency, power = welch(known, 1.0 / period, "hann", rows, detrend=False, scaling="spectrum", axis=0)
    share = np.cumsum(power.sum(axis=1)) / max(float(power.sum()), 1e-300)
    return [float(frequency[int(np.searchsorted(share, each))]) for each in shares]


def _moving_windows(t: Array, motion: FlangeMotion, rows: int) -> NDArray[np.intp]:
    """The first rows of the windows without a gap in which the arm moves, and the motion is known."""
    starts = np.arange(0, max(len(t) - rows + 1, 0), rows // 2)
    broken = np.r_[0, np.cumsum(np.r_[np.diff(t) > default_gap(t), False] | ~motion.inside)]
    squares = np.sum(motion.angular_velocity**2, axis=1), np.sum(motion.acceleration**2, axis=1)
    sums = [np.r_[0.0, np.cumsum(square)] for square in squares]
    whole = broken[starts + rows] == broken[starts]
    moves = np.any([total[starts + rows] - total[starts] > rows * MOVING**2 for total in sums], axis=0)
    return np.asarray(starts[whole & moves])
