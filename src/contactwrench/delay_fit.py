"""The delay that lets a rigid tool explain the most of a moving recording, and how far off it may be.

At a given delay the wrench is linear: bias, gravity in flange axes, accelerations, with free coefficients for each of
the six axes (variable projection: Golub and Pereyra, 1973). Left are the delay and the two angles of a base that does
not stand as stated, found by Gauss-Newton steps. The noise of the axes and its correlations come from the residuals, and
readings far outside it (contacts) count less.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .orientation import Array
from .turning import Turning

GRID = 0.02
"""s: no motion of an arm is over in less, so that between two such steps the misfit has one minimum."""
SCANNED = 6000
"""Means that the search over the whole range looks at."""
SAME = 1e-10
"""Of the largest eigenvalue: columns that a motion does not tell apart have less."""
TILT_SD = 0.1
"""rad: how far the base may stand from its start, where the motion does not tell."""
CONTACT = 4.1
"""Standard deviations, of six axes at once: 1 % of free readings lie beyond (chi-square)."""
MOST_STEPS, CLOSE = 60, 1e-8
"""s."""
ROUNDING = 1e-12
"""Of an axis' variance: numbers in a file are no closer."""


@dataclass(frozen=True, eq=False)
class Means:
    """Readings averaged over cells of time: `t` (n,) s and `wrench` (n, 6)."""

    t: Array
    wrench: Array


@dataclass(frozen=True, eq=False)
class Fit:
    """The `delay` s; `down` (3,) in base axes, up to its sign; what the delay would change by for each residual,
    `influence` (n, 6), s per standard deviation; the residuals in standard deviations, `left` (n, 6), each with its
    weight; the orthonormal `basis` (n, k) that was free to explain them; `bound` s, the standard deviation if the
    residuals were independent; and the `misfit`, log det of the residuals' covariance.
    """

    delay: float
    down: Array
    influence: Array
    left: Array
    basis: Array
    bound: float
    misfit: float


def scan(motion: Turning, means: Means, delays: Array) -> tuple[Array, Array]:
    """For each of `delays` (k,) the misfit (k,) of a tool under gravity from any direction, and down (3,) at the best.

    The means must be known at all of them. The base's three axes explain the wrench in place of gravity's direction,
    which is what they have in common: the first singular vector of their coefficients.
    """
    n = len(means.t)
    pick = slice(None, None, -(-n // SCANNED))
    t, wrench = means.t[pick], means.wrench[pick]

    def explained(delay: float) -> tuple[float, Array]:
        basis, unit = _orthonormal(_columns(motion, t - delay, None))
        found = basis.T @ wrench
        return _log_det(_floored((wrench - basis @ found), wrench)), unit @ found

    misfit = np.array([explained(delay)[0] for delay in delays])
    coefficients = explained(float(delays[int(misfit.argmin())]))[1][1:10].reshape(3, 18)
    noise = np.maximum(wrench.std(axis=0), 1e-300)
    U = np.linalg.svd((coefficients.reshape(3, 3, 6) / noise).reshape(3, 18))[0]
    return misfit, U[:, 0]


def fitted(motion: Turning, means: Means, delay: float, down: Array) -> Fit:
    """The best fit near `delay` and `down` (3,)."""
    start, weight = down, np.ones(len(means.t))
    noise: Array | None = None
    for _ in range(MOST_STEPS):
        tau = means.t - delay
        columns = _columns(motion, tau, down)
        root = np.sqrt(weight)[:, None]
        basis, unit = _orthonormal(columns * root)
        coefficients = unit @ (basis.T @ (root * means.wrench))
        residual = means.wrench - columns @ coefficients
        if noise is None:
            robust = 1.4826 * np.median(np.abs(residual - np.median(residual, axis=0)), axis=0)
            noise = np.diag(robust**2) + _floor(means.wrench)
        distance = np.sqrt(np.maximum(np.einsum("ni,ij,nj->n", residual, np.linalg.inv(noise), residual), 1e-300))
        weight = np.minimum(1.0, CONTACT / distance) ** 2
        noise = (residual * weight[:, None]).T @ residual / weight.sum() + _floor(means.wrench)
        whiten = np.linalg.cholesky(np.linalg.inv(noise))
        gravity = coefficients[1:4]
        across = np.linalg.svd(down[None])[2][1:]
        slopes = [-np.einsum("nji,j->ni", motion.change_at(tau), down) @ gravity]
        slopes += [np.einsum("nji,j->ni", motion.axes_at(tau), turn) @ gravity for turn in across]
        free = []
        for slope in slopes:
            part = root * (slope @ whiten)
            free.append(part - basis @ (basis.T @ part))
        left = root * (residual @ whiten)
        H = np.array([[np.vdot(a, b) for b in free] for a in free])
        gradient = np.array([np.vdot(a, left) for a in free])
        H[1:, 1:] += np.eye(2) / TILT_SD**2
        gradient[1:] -= across @ (down - start) / TILT_SD**2
        if H[0, 0] <= 0.0:
            return Fit(delay, down, np.zeros_like(left), left, basis, np.inf, _log_det(noise))
        inverse = np.linalg.inv(H)
        step = inverse @ gradient
        if abs(step[0]) < CLOSE:
            break
        delay += float(np.clip(step[0], -GRID, GRID))
        down = down + step[1:] @ across
        down = down / np.linalg.norm(down)
    influence = np.einsum("k,kni->ni", inverse[0], np.array(free))
    return Fit(delay, down, influence, left, basis, float(np.sqrt(inverse[0, 0])), _log_det(noise))


def _columns(motion: Turning, tau: Array, down: Array | None) -> Array:
    """What explains a wrench at tau (n,): 1, gravity (3) or the base's axes (9), accelerations (9 or 12)."""
    axes = motion.axes_at(tau)
    gravity = axes.reshape(-1, 9) if down is None else np.einsum("nji,j->ni", axes, down)
    return np.column_stack([np.ones(len(tau)), gravity, motion.accelerations_at(tau)])


def _orthonormal(columns: Array) -> tuple[Array, Array]:
    """An orthonormal basis (n, k) of columns (n, p), and what turns coefficients on it into those of the columns (p, k),
    the smallest where columns say the same.
    """
    size = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    values, vectors = np.linalg.eigh((columns / size).T @ (columns / size))
    kept = values > SAME * values[-1]
    unit: Array = vectors[:, kept] / np.sqrt(values[kept]) / size[:, None]
    return columns @ unit, unit


def _floor(wrench: Array) -> Array:
    return np.diag(ROUNDING * wrench.var(axis=0) + 1e-24)


def _floored(residual: Array, wrench: Array) -> Array:
    covariance: Array = residual.T @ residual / len(residual) + _floor(wrench)
    return covariance


def _log_det(covariance: Array) -> float:
    return float(np.linalg.slogdet(covariance)[1])


def standard_deviation(fit: Fit, spacing: float) -> float:
    """The standard deviation of the delay, s, with residuals that are correlated in time; means come every `spacing` s.

    The noise's spectrum is that of the residuals, averaged over neighbouring frequencies; what the free coefficients
    took out of it is counted as missing. Its sum over the influence's spectrum is the variance (as in Hannan, 1970).
    """
    n = len(fit.left)
    left = np.fft.rfft(fit.left, axis=0, norm="ortho")
    influence = np.fft.rfft(fit.influence, axis=0, norm="ortho")
    basis = np.fft.rfft(fit.basis, axis=0, norm="ortho")
    taken = (np.abs(basis) ** 2).sum(axis=1)
    reach = max(LEAST_BINS, round(SMOOTHED * n * spacing))
    there = np.maximum(_smoothed(1.0 - taken, reach), LEAST_THERE)
    power = np.zeros(len(left))
    for i in range(6):
        for j in range(6):
            cross = _smoothed(left[:, i] * left[:, j].conj(), reach)
            power += (influence[:, i].conj() * cross * influence[:, j]).real
    twice = np.full(len(left), 2.0)
    twice[0] = 1.0
    if n % 2 == 0:
        twice[-1] = 1.0
    return max(float(np.sqrt(np.sum(twice * power / there))), fit.bound)


SMOOTHED = 0.3
"""Hz to each side, and at least so many frequencies of the recording."""
LEAST_BINS = 4
LEAST_THERE = 0.1


def _smoothed(values: Array, reach: int) -> Array:
    """Means over `reach` neighbours to each side, as far as there are."""
    total = np.concatenate([np.zeros(1, values.dtype), np.cumsum(values)])
    place = np.arange(len(values))
    low, high = np.maximum(place - reach, 0), np.minimum(place + reach + 1, len(values))
    mean: Array = (total[high] - total[low]) / (high - low)
    return mean
