"""Poses on the way of an arm that turns slowly: short parts of the motion, whose mean readings gravity explains.

At a few degrees a second a tool is as good as at rest. What the wrench lags behind, and the noise of the parts' means
and their correlation, are found beside it, and are in the covariance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..geometry.arrays import Array
from ..geometry.rotations import procrustes
from ..geometry.wrench import STANDARD_GRAVITY
from .motion import FEWEST_ROWS, Blocks, blocks_of
from .poses import Pose
from .samples import Samples

LEAST_SECONDS, MOST_TURN = 0.5, float(np.deg2rad(5.0))
"""Of a part of the way: shorter parts are no less noisy together, a longer turn has no one orientation."""

MOST_POSES, FEWEST_POSES = 100, 20
REACH = 1.0
"""m from an axis of the arm to the tool."""

MOST_ACCELERATION = 0.01
"""Of gravity: what turns faster is left out."""

MOST_LEFT = 0.05
"""Of the readings' change on the way, that gravity need not explain: else somebody touched it, or the times are wrong.
"""

LARGEST_LAG = 0.3
"""s, a standard deviation: what is expected before the motion tells."""

ROUNDS = 4
OUTLYING = 6.0
"""Standard deviations of a part that does not count for lag and noise."""

MOST_ALIKE = 0.9
MEDIAN_OF_NORMAL = 0.6745
"""Of the absolute value."""


@dataclass(frozen=True, eq=False)
class _Parts:
    """Parts of a motion: their `first` rows (n,), `rows` in each, and how large the `acceleration` (n,) of the tool is,
    of gravity, as far as turning tells.
    """

    first: NDArray[np.intp]
    rows: int
    acceleration: Array


@dataclass(frozen=True, eq=False)
class _Fit:
    """The linear fit of readings to orientations: the mean matrices `R` (n, 9) at the lag found, `lag_std` s of
    it; what one reads there, (9, 6), by `slope`, and how fast that changes, `speed` (n, 6) N/s and N m/s, of which
    `alike` (10, 6) is linear in the orientation and a constant, too; the `noise` (6,) of a part's mean; what is `left`
    of the forces, N.
    """

    R: Array
    lag_std: float
    slope: Array
    speed: Array
    alike: Array
    noise: Array
    left: float


def poses_on_the_way(samples: Samples, elsewhere: Sequence[slice]) -> tuple[tuple[Pose, ...], Array | None]:
    """Poses from where the arm turns slowly, at most `MOST_POSES`; none where it turns too fast or too little, or where
    gravity does not explain the readings. And what a standard deviation of the lag, one for all, makes of a reading, as
    another tool or mounting would, too: [vec(R), 1] (10) times what is returned, (10, 6), N and N m. Rows `elsewhere`,
    where the arm stands, are not used.
    """
    period, runs = blocks_of(samples)
    t = samples.t
    if t is None or not runs:
        return (), None
    parts = _slow_parts(samples, runs, period, elsewhere)
    if len(parts.first) < FEWEST_POSES:
        return (), None
    rows = parts.first[:, None] + np.arange(parts.rows)
    wrench = samples.wrench[rows].mean(axis=1)
    fit = _fitted(wrench, samples, parts, period)
    change = wrench[:, :3].std(axis=0)
    if fit.left > MOST_LEFT * np.linalg.norm(change):
        return (), None
    weight = np.repeat(np.sqrt(wrench.var(axis=0).reshape(2, 3).sum(axis=1)), 3)
    nearest = procrustes(fit.R.reshape(-1, 3, 3))
    at_nearest = wrench + (nearest.reshape(-1, 9) - fit.R) @ fit.slope  # a mean over an arc lies within it
    lagging = fit.lag_std * fit.speed
    variance = fit.noise**2 + (parts.acceleration[:, None] * weight) ** 2
    poses = tuple(
        Pose(R, mean, np.diag(own) + np.outer(v, v), parts.rows, float(t[k[0]]), float(t[k[-1]]), None)
        for R, mean, v, own, k in zip(nearest, at_nearest, lagging, variance, rows, strict=True)
    )
    return poses, fit.lag_std * fit.alike


def _slow_parts(samples: Samples, runs: list[Blocks], period: float, elsewhere: Sequence[slice]) -> _Parts:
    """Parts of equal length of all runs, those `elsewhere` and those that turn too fast left out."""
    turned = sum(float(np.linalg.norm(np.diff(run.path, axis=0), axis=1).sum()) for run in runs)
    seconds = period * sum(run.last - run.first for run in runs)
    longest = min(seconds / MOST_POSES, MOST_TURN * seconds / max(turned, 1e-9))
    rows = max(round(max(LEAST_SECONDS, longest) / period), FEWEST_ROWS)
    taken = np.zeros(len(samples) + 1)
    for each in elsewhere:
        taken[each] = 1.0
    taken = np.r_[0.0, np.cumsum(taken)]
    first, acceleration = [np.empty(0, dtype=np.intp)], [np.empty(0)]
    for run in runs:
        edges = np.arange(run.first, run.last + 1, rows)
        if len(edges) < 3:
            continue
        at = (edges - run.first) / run.rows
        rate = np.diff([np.interp(at, np.arange(len(run.path)), axis) for axis in run.path.T], axis=1).T / (
            rows * period
        )
        square = np.sum(rate**2, axis=1)
        change = np.linalg.norm(np.gradient(rate, rows * period, axis=0), axis=1)
        slow = np.sqrt(square) * rows * period < 2.0 * MOST_TURN
        acceleration.append(np.where(slow, (square + change) * REACH / STANDARD_GRAVITY, np.inf))
        first.append(edges[:-1])
    parts = _Parts(np.concatenate(first), rows, np.concatenate(acceleration))
    free = taken[parts.first + rows] == taken[parts.first]
    keep = np.flatnonzero(free & (parts.acceleration < MOST_ACCELERATION))
    keep = keep[:: max(1, int(np.ceil(len(keep) / MOST_POSES)))]
    return _Parts(parts.first[keep], rows, parts.acceleration[keep])


def _fitted(wrench: Array, samples: Samples, parts: _Parts, period: float) -> _Fit:
    """The linear fit of the parts' `wrench` (n, 6) to their orientation, and its lag, by Gauss and Newton's steps."""
    sums = np.r_[np.zeros((1, 9)), np.cumsum(samples.R_base_flange.reshape(-1, 9), axis=0)]
    row = np.arange(len(sums), dtype=np.float64)
    lag, n = 0.0, len(wrench)
    usual = np.ones(n, dtype=bool)
    for _ in range(ROUNDS):
        start = np.clip(parts.first - lag / period, 1.0, len(samples) - parts.rows - 1.0)
        ends = [
            np.stack([np.interp(start + k, row, c) for c in sums.T], axis=1)
            for k in (-1, 0, 1, parts.rows - 1, parts.rows, parts.rows + 1)
        ]
        R = (ends[4] - ends[1]) / parts.rows
        change = (0.5 * (ends[5] - ends[3]) - 0.5 * (ends[2] - ends[0])) / (parts.rows * period)
        explains = np.column_stack([R, np.ones(n)])
        solution, _, rank, _ = np.linalg.lstsq(explains[usual], wrench[usual], rcond=1e-6)
        left = wrench - explains @ solution
        speed = change @ solution[:9]
        typical = np.median(np.abs(left), axis=0) / MEDIAN_OF_NORMAL * np.sqrt(n / max(n - float(rank), 1.0))
        typical = np.maximum(typical, 1e-9 * np.abs(wrench).max())
        usual = (np.abs(left) < OUTLYING * typical).all(axis=1)
        noise = typical * np.sqrt(_parts_per_independent(left[usual]))
        alike = np.linalg.lstsq(explains[usual], speed[usual], rcond=1e-6)[0]
        own = speed - explains @ alike
        information = float(np.sum((own / noise)[usual] ** 2)) + LARGEST_LAG**-2
        lag -= (float(np.sum((own * left / noise**2)[usual])) + lag * LARGEST_LAG**-2) / information
    return _Fit(R, information**-0.5, solution[:9], speed, alike, noise, float(np.linalg.norm(typical[:3])))


def _parts_per_independent(left: Array) -> Array:
    """How many parts (6,) in a row are worth one, from what is `left` (n, 6): a first-order correlation."""
    alike = np.sum(left[1:] * left[:-1], axis=0) / np.maximum(np.sum(left**2, axis=0), 1e-300)
    alike = np.clip(alike, 0.0, MOST_ALIKE)
    return np.asarray((1.0 + alike) / (1.0 - alike))
