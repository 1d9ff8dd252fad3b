"""The standard deviation of an estimate whose noise is correlated in time, from the spectrum of what is left."""

from __future__ import annotations

import numpy as np

from ..geometry.arrays import Array

SMOOTHED, LEAST_BINS = 0.3, 4
"""Hz to each side, and at least so many frequencies of the recording, over which a spectrum is averaged."""
LEAST_THERE = 0.1
"""Of the noise at a frequency, whatever the free coefficients took out of it."""


def spectral_std(residuals: Array, gain: Array, taken_out: Array, t: Array) -> float:
    """The standard deviation of `sum gain * noise` for means at t (n,) whose noise is correlated in time: `residuals`
    and `gain` (n, 6), and the orthonormal columns (n, q) that were fitted, `taken_out`.

    The noise's spectrum is that of the residuals, averaged over neighbouring frequencies; what the free coefficients
    took out of it is counted as missing. With the influence's spectrum it gives the variance (Parseval).
    """
    n = len(residuals)
    left = np.fft.rfft(residuals, axis=0, norm="ortho")
    influence = np.fft.rfft(gain, axis=0, norm="ortho")
    basis = np.fft.rfft(taken_out, axis=0, norm="ortho")
    taken = (np.abs(basis) ** 2).sum(axis=1)
    reach = max(LEAST_BINS, round(SMOOTHED * n * float(np.median(np.diff(t)))))
    there = np.maximum(_smoothed(1.0 - taken, reach), LEAST_THERE)
    power = np.zeros(len(left))
    for i in range(6):
        for j in range(6):
            noise = left[:, i] * left[:, j].conj()
            cross = _smoothed(noise.real, reach) + 1j * _smoothed(noise.imag, reach)
            power += (influence[:, i].conj() * cross * influence[:, j]).real
    twice = np.full(len(left), 2.0)
    twice[0] = 1.0
    if n % 2 == 0:
        twice[-1] = 1.0
    return float(np.sqrt(max(np.sum(twice * power / there), 0.0)))


def _smoothed(values: Array, reach: int) -> Array:
    """Means over `reach` neighbours to each side, as far as there are."""
    total = np.concatenate([np.zeros(1), np.cumsum(values)])
    place = np.arange(len(values))
    low, high = np.maximum(place - reach, 0), np.minimum(place + reach + 1, len(values))
    return np.asarray((total[high] - total[low]) / (high - low))
