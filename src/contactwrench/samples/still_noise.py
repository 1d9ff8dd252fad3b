"""Readings at rest: the noise of their mean by its length, as no mean is as good as its rows; and creep, the share of
each change of its load that a sensor shows late (method, "Still segments").

Creep reads F(t) + c sum_j dF_j log(t - t_j), with dF_j the change of load at t_j (Boltzmann's superposition). Within
one stop that is no different from a bias that wanders; that all stops go on as their own changes of load have it is.
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
        means = [y[: len(y) // rows * rows].reshape(-1, rows, 6).mean(axis=1) for y in readings if len(y) >= 2 * rows]
        steps = np.concatenate([np.empty((0, 6)), *(np.diff(mean, axis=0) for mean in means)])
        if len(steps) >= FEWEST_PAIRS:
            known.append((duration, np.sqrt(0.5 * np.mean(steps**2, axis=0))))
    if not known:
        return None
    apart = max(round(DURATIONS[0] / period), 1)
    steps = np.concatenate([y[apart:] - y[:-apart] for y in readings])
    row_std = np.sqrt(0.5 * np.mean(steps**2, axis=0))
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


CREEP_BY_CHANCE = 0.01
"""Of noise that looks like creep, by Student's t: doubt without cause is better than creep hidden in 1/f noise."""
USUAL = 0.01
"""Of the share, the standard deviation among sensors: none is without."""
FEWEST_STOPS, FEWEST_ROWS, MOST_STOPS = 4, 10, 500
LEAST = 1e-6
"""N: a load that changes so little tells nothing of creep."""
TIMES_AS_LONG = 100.0
"""As each stop: until then creep is taken to go on, minutes after stops of seconds."""
TOUCHED = 8.0
"""Times as far off what most stops have in common as half of them are: a stop that was touched, which tells nothing."""


@dataclass(frozen=True, eq=False)
class Stop(Frozen):
    """Evenly spaced readings of a force (n, 3), N, from `begin` to `end`, s, of an arm that `came` to rest before, and
    goes on turning by so many rad from the earlier half to the later one, `turn`.
    """

    force: Array
    came: float
    begin: float
    end: float
    turn: float


@dataclass(frozen=True)
class Creep:
    """The `share` of a change of load that stops had still to show, and its standard deviation; `sure`: that it is
    neither noise nor an arm that settles; the rms `change` of the load from stop to stop, N.
    """

    share: float
    std: float
    sure: bool
    change: float

    @property
    def not_excluded(self) -> float:
        """The rms share, by the stops and by what is usual."""
        of_data = USUAL**2 / (USUAL**2 + self.std**2)
        return float(np.hypot(of_data * self.share, np.sqrt(of_data) * self.std))


def creep_of(stops: Sequence[Stop]) -> Creep | None:
    """What stops in the order of time tell of creep; None: they are too few, or of one load."""
    from scipy.special import stdtrit

    known = [stop for stop in stops if len(stop.force) >= FEWEST_ROWS and stop.end > stop.begin][:MOST_STOPS]
    if len(known) < FEWEST_STOPS:
        return None
    came, begin, end = np.array([(stop.came, stop.begin, stop.end) for stop in known[1:]]).T
    level = np.array([stop.force.mean(axis=0) for stop in known])
    change = np.diff(level, axis=0)
    drift = np.array([change_within(stop.force) for stop in known[1:]])
    middle = 0.5 * (begin + end)
    predicted = (_mean_logarithms(came, middle, end) - _mean_logarithms(came, begin, middle)) @ change
    off = np.linalg.norm(drift - _in_common(drift, predicted) * predicted, axis=1)
    alike = off <= TOUCHED * np.median(off)
    drift, predicted = drift[alike], predicted[alike]
    squares = float(np.sum(predicted**2))
    if squares < LEAST**2:
        return None
    per_e_fold = float(np.sum(drift * predicted)) / squares
    dof = predicted.size - 1.0
    std = float(np.sqrt(np.sum((drift - per_e_fold * predicted) ** 2) / dof / squares))
    turned = (np.array([stop.turn for stop in known[1:]])[:, None] * (level - level.mean(axis=0))[1:])[alike]
    by_the_arm = float(np.sqrt(np.sum(turned**2) / squares))
    surely = abs(per_e_fold) > max(float(stdtrit(dof, 1.0 - 0.5 * CREEP_BY_CHANCE)) * std, by_the_arm)
    remaining = np.log(TIMES_AS_LONG * (end - came)) - np.diag(_mean_logarithms(came, begin, end))
    to_share = float(np.median(remaining))
    rms_change = float(np.sqrt(np.mean(np.sum(change**2, axis=1))))
    return Creep(to_share * per_e_fold, to_share * float(np.hypot(std, by_the_arm)), surely, rms_change)


def change_within(readings: Array) -> Array:
    """By how much (k,) the later half of readings (n, k) differs from the earlier one."""
    half = len(readings) // 2
    return np.asarray(readings[half:].mean(axis=0) - readings[:half].mean(axis=0))


def _in_common(drift: Array, predicted: Array) -> float:
    """The part of what is `predicted` (n, 3) that leaves the least sum of sizes of the `drift` (n, 3), not of squares:
    no single stop moves it far.
    """
    size = np.abs(predicted).ravel()
    share = (drift / np.where(predicted == 0.0, 1.0, predicted)).ravel()
    order = np.argsort(share)
    return float(share[order][np.searchsorted(np.cumsum(size[order]), 0.5 * size.sum())])


def _mean_logarithms(came: Array, begin: Array, end: Array) -> Array:
    """The mean of log(t - came) from begin to end, of each stop (row) for each change of load (column) up to its own;
    0 for those to come.
    """
    a, b = (np.maximum(edge[:, None] - came, 0.0) for edge in (begin, end))
    of_a, of_b = (edge * np.log(np.where(edge > 0.0, edge, 1.0)) for edge in (a, b))
    return np.tril((of_b - of_a) / (end - begin)[:, None] - 1.0)
