"""Which experiments to do: an I-optimal design by exchange (Fedorov, Theory of Optimal Experiments, 1972), and in
which order to visit them so that the tour is short.

An experiment whose outcome has the derivative J with respect to the parameters, in standard deviations of its noise,
adds `J^T J` to what is known of them; their covariance C is the inverse of the sum. What is asked of the parameters is
a mean variance that is linear in C, `trace(C M)`: the less, the better the design.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..geometry.arrays import Array

TIE = 1e-4
"""Of the mean variance: candidates this close to the best are as good, so that rounding, which differs from machine to
machine, does not decide between them.
"""

LEAST_GAIN = 1e-3
"""Of the mean variance: an exchange that gains less is not worth making."""


def chosen_experiments(n: int, J: Array, known: Array, M: Array, apart: NDArray[np.bool_]) -> list[int]:
    """Up to `n` of m candidates that make `trace(C M)` least.

    The best candidate is added n times; then each is exchanged for the best in its place, until no exchange gains; of
    candidates that are as good the first is taken. Gives their indices, fewer than n where none is left. `J` (m, r, p):
    derivatives of the outcomes, in standard deviations of their noise; `known` (p, p): information that is there
    before, of full rank; `M` (p, p): what is asked of the parameters; `apart` (m, m): which pairs may both be chosen,
    none with itself.
    """
    information = np.einsum("mrp,mrq->mpq", J, J)

    def best_beside(others: list[int]) -> list[int]:
        """The best candidate that is free, if any is."""
        free = np.flatnonzero(apart[others].all(axis=0))
        if not len(free):
            return []
        variance = _variance_with_each(J[free], known + information[others].sum(axis=0), M)
        return [int(free[np.argmax(variance <= (1.0 + TIE) * variance.min())])]

    def mean_variance(design: list[int]) -> float:
        return float(np.sum(np.linalg.inv(known + information[sorted(design)].sum(axis=0)) * M))

    chosen: list[int] = []
    while len(chosen) < n and (best := best_beside(chosen)):
        chosen += best
    least, gained = mean_variance(chosen), True
    while gained:
        gained = False
        for k in range(len(chosen)):
            candidate = [*chosen[:k], *best_beside(chosen[:k] + chosen[k + 1 :]), *chosen[k + 1 :]]
            variance = mean_variance(candidate)
            if variance < (1.0 - LEAST_GAIN) * least:
                least, chosen, gained = variance, candidate, True
    return chosen


def _variance_with_each(J: Array, information: Array, M: Array) -> Array:
    """`trace(C M)` (m,) after each of the candidates, by the update of rank r of C (Woodbury)."""
    m, r, p = J.shape
    C = np.linalg.inv(information)
    JC = (J.reshape(m * r, p) @ C).reshape(m, r, p)
    innovation = np.eye(r) + JC @ J.transpose(0, 2, 1)
    told = (JC.reshape(m * r, p) @ M).reshape(m, r, p) @ JC.transpose(0, 2, 1)
    gain = np.trace(np.linalg.solve(innovation, told), axis1=1, axis2=2)
    return np.asarray(np.sum(C * M) - gain)


def short_order(between: Array, from_start: Array | None) -> list[int]:
    """An order of the places 0 .. n-1 whose open tour is short: the shortest there is, or within a few per cent of it.

    From every first place on always the nearest one left, then the piece whose reversal shortens the tour most is
    reversed until none does (2-opt; Croes 1958); the shortest of these tours is kept. Distances `between` (n, n) are
    the same in both directions; those `from_start` (n,) are from where the tour begins, None: at any place.
    """
    n = len(between)
    # The start is one more place, number n: at no distance from anywhere where the tour may begin anywhere.
    distance = np.zeros((n + 1, n + 1))
    distance[:n, :n] = between
    if from_start is not None:
        distance[n, :n] = distance[:n, n] = from_start
    tours = []
    for first in range(n):
        tour, left = [n, first], set(range(n)) - {first}
        while left:
            tour.append(min(left, key=lambda place: (distance[tour[-1], place], place)))
            left.remove(tour[-1])
        tours.append(_without_crossings(tour, distance))
    return min(tours, key=lambda tour: float(distance[tour[:-1], tour[1:]].sum()))[1:]


def _without_crossings(tour: list[int], distance: Array) -> list[int]:
    n = len(tour) - 1
    while True:
        d = distance[np.ix_(tour, tour)]
        step = np.append(d.diagonal(1), 0.0)  # from each place to the next; the tour ends after the last
        # Reversing places a..b replaces the steps a-1 -> a and b -> b+1 by a-1 -> b and a -> b+1.
        onward = np.hstack([d[1:, 2:], np.zeros((n, 1))])
        gain = np.triu(step[:-1, None] + step[None, 1:] - d[:-1, 1:] - onward, 1)
        a, b = np.unravel_index(int(np.argmax(gain)), gain.shape)
        if gain[a, b] <= 1e-9:
            return tour
        tour = tour[: a + 1] + tour[a + 1 : b + 2][::-1] + tour[b + 2 :]
