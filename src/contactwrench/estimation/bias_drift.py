"""How the bias may have moved while the poses were recorded: not at all, by a step, steadily, warming up, wandering.

A sensor warms up; a driver zeroes it half-way. Each motion is a covariance across poses, `strength^2 L L^T` in units of
the noise, zero at the last pose, so that the constant that is estimated is the LAST bias. Nothing is chosen here: every
motion has a prior probability, and the answer is the mean over all of them by evidence.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..calibration.findings import Kind
from ..geometry.arrays import Array
from .outliers import LEVEL_SHARE, log_half_normal

STRENGTHS = np.geomspace(1.0, 1000.0, 7)
"""Standard deviation of the change over the whole recording, in units of a pose's noise: from what does not show to
what nobody would use."""
APART = float(np.log(STRENGTHS[1] / STRENGTHS[0]))
FEW_COLUMNS, MOST_OF_MANY = 3, 50.0
"""What has more columns can take up all that is left of few readings: strengths beyond are one model with ever less
noise, and would count several times.
"""
STRENGTHS_OF_MANY = STRENGTHS[STRENGTHS < MOST_OF_MANY]

ODDS = {Kind.BIAS_DRIFTED: 0.13, Kind.BIAS_WANDERED: 0.4, Kind.BIAS_STEPPED: 0.09}
"""Before the readings, against a steady bias and independent errors; of a step, that it happened anywhere."""

OF_ONE_POSE = 0.05
"""Of the odds of a step elsewhere, those of one after the first pose or before the last: what one pose alone shows is a
contact, in nearly all cases, and reads the same.
"""

TIME_CONSTANTS = (np.inf, 1.0, 1.0 / 3.0, 0.1)
"""Of a warming sensor, in lengths of the recording; without end: a steady drift."""
BETWEEN = float(np.log(3.0) / np.sqrt(12.0))
"""Standard deviation of the logarithm of a time constant that lies anywhere half-way to its neighbours."""

MOST_POSES = 400
"""With more, a bias that moves is not looked for in each pose, but in so many groups of neighbours."""

SMOOTH = 32
"""Columns of a walk: what is left out has a thousandth of its variance."""

FEWEST_POSES, MOST_STOPS = 3, 100
"""Poses: of so few nothing is looked for; more were taken on the way, most often, and tell little by their order."""

SHARE_OF_WEIGHT: dict[Kind | None, float] = {
    Kind.GAIN: 0.01,
    Kind.CREEP: 0.01,
    Kind.CABLE: 0.05,
    Kind.TWO_LEVELS: LEVEL_SHARE,
}
"""Scale of the error, of a half-normal prior: sensors have gains and cross-talk of a percent or two, cables and
backlash move a reading by some percent of the weight."""


@dataclass(frozen=True, eq=False)
class Drift:
    """One way to move, or to err: the `kind` of finding (None: steady), `columns` (n, q) that the change is made of, of
    a step the index of the first pose after it; or that one, `alone`, of the strength `at`, and beside it a gain that
    is `gain` times as strong.
    """

    kind: Kind | None
    columns: Array
    first_after: int | None = None
    alone: Drift | None = None
    at: float = 0.0
    gain: float = 0.0

    @property
    def strengths(self) -> Array:
        """How strong it may be, in units of the noise."""
        if self.alone is not None:
            return np.array([self.at])
        return STRENGTHS if self.columns.shape[1] <= FEW_COLUMNS else STRENGTHS_OF_MANY

    @property
    def own(self) -> int:
        """How many of the columns are its own, the first ones; the others are of the gain beside it."""
        return int((self.alone or self).columns.shape[1])

    def beside(self, gain: Drift, at: float, strength: float) -> Drift:
        """The same, of the strength `at`, with a `gain` of that `strength`."""
        times = strength / at
        return Drift(self.kind, np.hstack([self.columns, times * gain.columns]), self.first_after, self, at, times)


@dataclass(frozen=True, eq=False)
class Kernels:
    """Covariances across poses, each a drift and a strength: index `drift` (k,) into `drifts`, `strength` (k,) in units
    of the noise, the logarithm of the prior odds `log_prior` (k,) against a steady bias.
    """

    drifts: tuple[Drift, ...]
    drift: NDArray[np.intp]
    strength: Array
    log_prior: Array

    @cached_property
    def causes(self) -> NDArray[np.intp]:
        """Of each kernel (k,) the place of its drift, with a gain beside it or not, among the drifts alone."""
        place = {id(drift): k for k, drift in enumerate(self.drifts)}
        return np.array([place[id(drift.alone or drift)] for drift in self.drifts], dtype=np.intp)[self.drift]

    def joined(self, drifts: list[Drift], log_prior: list[float]) -> Kernels:
        """These and others: every one of the `drifts`, of a prior each, at every strength."""
        strengths = [drift.strengths for drift in drifts]
        each = np.array([len(of_drift) for of_drift in strengths], dtype=np.intp)
        return Kernels(
            (*self.drifts, *drifts),
            np.r_[self.drift, len(self.drifts) + np.repeat(np.arange(len(drifts)), each)],
            np.concatenate([self.strength, *strengths]),
            np.r_[self.log_prior, np.repeat(np.array(log_prior, dtype=np.float64) - np.log(each), each)],
        )

    def select(self, kept: NDArray[np.intp]) -> Kernels:
        """The kernels of an index."""
        return Kernels(self.drifts, self.drift[kept], self.strength[kept], self.log_prior[kept])

    def at_poses(self, kernel: NDArray[np.intp], kept: NDArray[np.bool_]) -> Array:
        """What the poses kept have in common under each `kernel` (k,), (k, m, q), fewer columns filled with zeros."""
        each = [self.strength[k] * self.drifts[self.drift[k]].columns[kept] for k in kernel.tolist()]
        stack = np.zeros((len(each), int(kept.sum()), max((columns.shape[1] for columns in each), default=0)))
        for own, columns in zip(stack, each, strict=True):
            own[:, : columns.shape[1]] = columns
        return stack

    def by_columns(self, kept: NDArray[np.bool_]) -> Iterator[tuple[NDArray[np.intp], NDArray[np.intp], Array]]:
        """For each number of columns q: the kernels (k,) whose drift has so many, the place of its drift among those
        that have, (k,), and the columns of these of the poses kept, (d, m, q).
        """
        columns = np.array([drift.columns.shape[1] for drift in self.drifts])[self.drift]
        for q in np.unique(columns[columns > 0]).tolist():
            kernel = np.flatnonzero(columns == q)
            first = np.diff(self.drift[kernel], prepend=-1) != 0
            of_drifts = np.array([self.drifts[drift].columns for drift in self.drift[kernel[first]].tolist()])
            yield kernel, np.cumsum(first) - 1, of_drifts[:, kept]

    def log_plausible(
        self, kernel: NDArray[np.intp], strength: Array, noise: Array | float, weight: Array | float
    ) -> Array:
        """Logarithm of the prior (m,) of how large an error is as a share of the `weight` N, over that of its
        strengths; `strength` (m,) of the drift of a `kernel`, in units of the `noise` N.
        """
        of_drifts = np.array([SHARE_OF_WEIGHT.get(drift.kind, np.nan) for drift in self.drifts])
        share = strength * noise / (np.maximum(np.abs(weight), 1e-12) * of_drifts[self.drift[kernel]])
        each = [len((drift.alone or drift).strengths) for drift in self.drifts]
        even = 1.0 / (APART * np.array(each))  # density of the logarithm
        plausible = np.where(np.isnan(share), 0.0, log_half_normal(share) - np.log(even[self.drift[kernel]]))
        gain = np.array([drift.gain for drift in self.drifts])[self.drift[kernel]] * strength
        share = gain * noise / (np.maximum(np.abs(weight), 1e-12) * SHARE_OF_WEIGHT[Kind.GAIN])
        return plausible + np.where(gain > 0.0, log_half_normal(share) + np.log(APART), 0.0)


def possible_drifts(time: Array, in_order: float) -> tuple[list[Drift], list[float]]:
    """How the bias of poses may have moved that were taken at these times (n,), s, with the probability `in_order`, and
    the logarithm of the odds of each.
    """
    if (n := len(time)) <= FEWEST_POSES or (in_order < 1.0 and n > MOST_STOPS):
        return [], []
    before = (time[-1] - time) / max(float(time[-1] - time[0]), 1e-300)
    drifts = [Drift(Kind.BIAS_DRIFTED, _warming(before, tau)) for tau in TIME_CONSTANTS]
    each = [float(np.log(ODDS[Kind.BIAS_DRIFTED] / len(drifts)))] * len(drifts)
    places = _places(n)
    drifts.append(Drift(Kind.BIAS_WANDERED, _wandering(before)))
    before_each = (np.arange(n) < places[:, None]).astype(np.float64)[..., None]
    drifts += [Drift(Kind.BIAS_STEPPED, own, k) for own, k in zip(before_each, places.tolist(), strict=True)]
    each.append(float(np.log(ODDS[Kind.BIAS_WANDERED])))
    of_place = ODDS[Kind.BIAS_STEPPED] / len(places) * np.r_[OF_ONE_POSE, np.ones(len(places) - 2), OF_ONE_POSE]
    each += np.log(of_place).tolist()
    return drifts, [log_odds + float(np.log(in_order)) for log_odds in each]


def kernels_of(n: int, drifts: list[Drift], log_prior: list[float]) -> Kernels:
    """Every drift of n poses at every strength; first a steady bias."""
    steady = Kernels((Drift(None, np.zeros((n, 0))),), np.zeros(1, dtype=np.intp), np.zeros(1), np.zeros(1))
    return steady.joined(drifts, log_prior)


def _places(n: int) -> Array:
    """The poses before which a step may have been: all, or of very many every so many."""
    return np.unique(np.linspace(1, n - 1, min(n - 1, MOST_POSES)).astype(int))


def _warming(before: Array, time_constant: float) -> Array:
    """The change still to come, 1 at the first pose, and what another time constant makes of it, to first order (n, 2);
    of a steady drift the change alone (n, 1). `before` (n,) the end, in lengths of the recording.
    """
    if not np.isfinite(time_constant):
        return before[:, None]
    rate = 1.0 / time_constant
    change = np.expm1(before * rate) / np.expm1(rate)
    of_rate = (before * np.exp(before * rate) - change * np.exp(rate)) / np.expm1(rate)
    return np.column_stack([change, -BETWEEN * rate * of_rate])


def _wandering(before: Array) -> Array:
    """Columns (n, q) of a random walk of unit variance over the recording: its increments from the end backwards, those
    of neighbours joined where there are very many.
    """
    n = len(before)
    edges = np.unique(np.linspace(0, n - 1, min(n, MOST_POSES)).astype(int))
    length = before[edges[:-1]] - before[edges[1:]]
    after = np.arange(n)[:, None] <= edges[:-1]
    increments = after * np.sqrt(np.maximum(length, 0.0))
    return np.asarray(increments @ np.linalg.eigh(increments.T @ increments).eigenvectors[:, : -SMOOTH - 1 : -1])
