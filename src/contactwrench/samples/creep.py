"""Creep: the share of each change of its load that a sensor shows late.

Strain gauges and their glue follow a new load by most of it at once, and go on by the logarithm of time; what earlier
changes left adds up (Boltzmann's superposition). Within one stop that is no different from a bias that wanders; that
the readings of all stops go on as their own changes of load have it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..geometry.arrays import Array, Frozen

SURE = 3.0
"""Standard deviations."""
FEWEST_STOPS, FEWEST_ROWS = 4, 10
TIMES_AS_LONG = 10.0
"""As each stop: until then creep is taken to go on."""


@dataclass(frozen=True, eq=False)
class Stop(Frozen):
    """Evenly spaced readings of a force (n, 3), N, from `begin` to `end`, s, of an arm that `came` to rest before."""

    force: Array
    came: float
    begin: float
    end: float


@dataclass(frozen=True)
class Creep:
    """The `share` of a change of load that stops had still to show, and what that is in N, `force`, of the changes that
    there were.
    """

    share: float
    force: float


def creep_of(stops: Sequence[Stop]) -> Creep | None:
    """Creep, where stops in the order of time surely show some."""
    known = [stop for stop in stops if len(stop.force) >= FEWEST_ROWS and stop.end > stop.begin]
    if len(known) < FEWEST_STOPS:
        return None
    came, begin, end = np.array([(stop.came, stop.begin, stop.end) for stop in known[1:]]).T
    load = np.diff([stop.force.mean(axis=0) for stop in known], axis=0)
    went_on = np.array([_went_on(stop.force) for stop in known[1:]])
    middle = 0.5 * (begin + end)
    of_load = _mean_logarithms(came, middle, end) - _mean_logarithms(came, begin, middle)
    towards = of_load @ load
    squares = max(float(np.sum(towards**2)), 1e-300)
    per_e_fold = float(np.sum(went_on * towards)) / squares
    std = float(np.sqrt(np.mean((went_on - per_e_fold * towards) ** 2) / squares))
    if abs(per_e_fold) <= SURE * std:
        return None
    to_come = np.log(TIMES_AS_LONG * (end - came)) - np.diag(_mean_logarithms(came, begin, end))
    share = per_e_fold * float(np.median(to_come))
    return Creep(share, abs(share) * float(np.sqrt(np.mean(np.sum(load**2, axis=1)))))


def _went_on(force: Array) -> Array:
    """By how much (3,) the later half differs from the earlier one."""
    half = len(force) // 2
    change: Array = force[half:].mean(axis=0) - force[:half].mean(axis=0)
    return change


def _mean_logarithms(came: Array, begin: Array, end: Array) -> Array:
    """The mean of log(t - came) from begin to end, of each stop (row) for each change of load (column) up to its own;
    0 for those to come.
    """
    a, b = (np.maximum(edge[:, None] - came, 0.0) for edge in (begin, end))
    of_a, of_b = (edge * np.log(np.where(edge > 0.0, edge, 1.0)) for edge in (a, b))
    mean: Array = np.tril((of_b - of_a) / (end - begin)[:, None] - 1.0)
    return mean
