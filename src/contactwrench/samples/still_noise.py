"""The noise of mean readings at rest, by their length: a sensor creeps and wanders, and no mean is as good as its rows.

One figure serves: how far means over some length differ from those over the length before, within stops (Allan 1966).
For white noise it falls as the length grows, for 1/f noise it stays, for creep it grows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from ..geometry.arrays import Array, Frozen, Matrix, Vector, shaped
from .timestamps import FINEST

DURATIONS = (0.01, 0.03, 0.1, 1.0)
WITHIN = 0.25
"""Of a duration, by which a number of rows may miss it."""
FEWEST_PAIRS = 6
"""Of means, that tell their noise."""

PARTS = 8
"""Of a mean, that show how slow its noise is; fewer rows are taken for independent."""

WHITE_HALVES, WHITE_QUARTERS = 0.25, 0.5
WHITE_COUNT = 4.0
"""The Allan variance of halves and of quarters, of the variance of the eighths, in white noise; and so many means count
for white beforehand."""

LOG_OF_CHANCE, CHANCE = -0.15, 0.33
"""Mean and variance of the logarithm of a variance that has seven degrees of freedom."""


@dataclass(frozen=True, eq=False)
class StillNoise(Frozen):
    """The noise of mean readings while arm and tool are at rest.

    Attributes:
        duration: s (k,), ascending, those of 0.01, 0.03, 0.1 and 1.0 that the recording can tell.
        std: N and N m (k, 6), of the mean reading over each duration: the Allan deviation, the root of half the mean
            square of how far it differs from the mean before, within the still segments, of all of them.
        row_std: N and N m (6,), of a row beside others far from it: the root of half the mean square of how far rows
            differ that are 10 ms apart, or the next if that is more; None: not known.
    """

    duration: Vector
    std: Matrix = field(metadata=shaped("k", 6, least=0.0))
    row_std: Vector | None = field(default=None, metadata=shaped(6, least=0.0))


def still_noise_of(readings: Sequence[Array], period: float) -> StillNoise | None:
    """The noise of still segments (n, 6), `period` s from row to row; None where they are too short to tell."""
    known = []
    for duration in DURATIONS:
        rows = round(duration / period) if period > FINEST else 0
        if rows < 1 or abs(rows * period - duration) > WITHIN * duration:
            continue
        even, parts = np.full(rows, 1.0 / rows), (y[: len(y) // rows * rows].reshape(-1, rows, 6) for y in readings)
        means = [even @ part for part in parts if len(part) >= 2]
        steps = np.concatenate([np.empty((0, 6)), *(np.diff(mean, axis=0) for mean in means)])
        if len(steps) >= FEWEST_PAIRS:
            known.append((duration, np.sqrt(0.5 * np.mean(steps**2, axis=0))))
    if not known:
        return None
    apart = max(round(DURATIONS[0] / period), 1)
    moved = [y[apart:] - y[:-apart] for y in readings]
    squares = np.sum([np.einsum("na,na->a", steps, steps) for steps in moved], axis=0)
    row_std = np.sqrt(0.5 * squares / sum(map(len, moved)))
    return StillNoise(np.array([d for d, _ in known]), np.array([std for _, std in known]), row_std)


def covariances_of_means(readings: Sequence[Array]) -> list[Array]:
    """The covariance (6, 6) of the mean of each of some readings (n, 6), every one at one orientation, in the order in
    which they were recorded; zero for a single row.

    Its variance is that of the movement between eighths, carried on to the whole length as it grows from quarters to
    halves, of all readings together, and of each as far as it moves more or less than chance makes the others do.
    """
    covariances, parts, longer = [], [], []
    for k, wrench in enumerate(readings):
        n = len(wrench)
        if n == 1:
            covariances.append(np.zeros((6, 6)))
            continue
        off = wrench - wrench[0]  # so that rows which repeat exactly have a scatter of exactly zero
        mean = np.ones(n) @ off / n
        covariances.append((off.T @ off - n * np.outer(mean, mean)) / (n * max(n - 1.0, 1.0)))
        if n >= PARTS:
            edges = n * np.arange(PARTS + 1) // PARTS
            parts.append(np.add.reduceat(off, edges[:-1]) / np.diff(edges)[:, None])
            longer.append(k)
    if longer:
        rows = np.array([len(readings[k]) for k in longer])
        for k, variance in zip(longer, _variances(np.array(parts), rows), strict=True):
            of_rows = np.diag(covariances[k])
            scale = np.sqrt(np.divide(variance, of_rows, out=np.zeros(6), where=of_rows > 0.0))
            constant = np.diag(np.where(of_rows > 0.0, 0.0, variance))  # coarse readings that happened not to move
            covariances[k] = scale[:, None] * covariances[k] * scale + constant
    return covariances


def _variances(parts: Array, rows: Array) -> Array:
    """The variance (k, 6) of means of so many `rows` (k,) from those of their `parts` (k, 8, 6)."""
    own = parts.var(axis=1, ddof=1)
    moved = own > 0.0
    scaled = parts / np.sqrt(np.where(moved, own, 1.0))[:, None]

    def usual_allan(length: int, white: float) -> Array:
        """Of means of so many parts, and of all readings, in units of the variance of their parts."""
        means = scaled.reshape(len(parts), -1, length, 6).mean(axis=2)
        allan = 0.5 * np.mean(np.diff(means, axis=1) ** 2, axis=1)
        return _of_axes((np.sum(allan, axis=0, where=moved) + WHITE_COUNT * white) / (moved.sum(axis=0) + WHITE_COUNT))

    of_half, of_quarter = usual_allan(PARTS // 2, WHITE_HALVES), usual_allan(PARTS // 4, WHITE_QUARTERS)
    growth = np.clip(of_half / of_quarter, 0.5, 2.0)  # with twice the length: 1/2 for white noise
    with_length = rows[:, None] ** np.log2(growth)
    of_row = own / with_length
    log = np.log(np.where(moved, of_row, 1.0))
    count = np.maximum(moved.sum(axis=0), 1)
    usual = np.sum(log, axis=0, where=moved) / count
    squares = np.sum((log - usual) ** 2, axis=0, where=moved)
    spread = _of_axes((squares + WHITE_COUNT * CHANCE) / (count - 1 + WHITE_COUNT))
    believed = 1.0 - CHANCE / np.maximum(spread, CHANCE)
    weighed = (1.0 - believed) * np.exp(usual - LOG_OF_CHANCE) + believed * of_row
    return np.asarray(moved.any(axis=0) * of_half * np.minimum(growth, 1.0) * weighed * with_length)


def _of_axes(values: Array) -> Array:
    """Values (6,) each half-way to the mean of its group, forces or torques."""
    return np.asarray(0.5 * (values + np.repeat(values.reshape(2, 3).mean(axis=1), 3)))
