"""Creep: the share of each change of its load that a sensor shows late (method, "Still segments").

The reading is F(t) + c sum_j dF_j log(t - t_j), with dF_j the change of load at t_j (Boltzmann's superposition). Within
one stop that is no different from a bias that wanders; that the readings of all stops go on as their own changes of
load have it is. Of the logarithm only differences enter, so its unit of time does not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..geometry.arrays import Array, Frozen

CHANCE = 0.01
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
    surely = abs(per_e_fold) > max(float(stdtrit(dof, 1.0 - 0.5 * CHANCE)) * std, by_the_arm)
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
