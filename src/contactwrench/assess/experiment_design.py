"""Which experiments to do: an I-optimal design by exchange (Fedorov, Theory of Optimal Experiments, 1972).

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
    """Up to `n` of the m candidates with derivatives `J` (m, r, p) that make `trace(C M)` least.

    `known` (p, p) is the information that is there before, of full rank; `apart` (m, m) says which pairs may both be
    chosen (none with itself). The best candidate is added n times; then each is exchanged for the best in its place,
    until no exchange gains; of candidates that are as good the first is taken. Fewer than n are returned where no
    candidate is left.
    """
    information = np.einsum("mrp,mrq->mpq", J, J)

    def best_beside(others: list[int]) -> int | None:
        free = np.flatnonzero(apart[others].all(axis=0))
        if not len(free):
            return None
        variance = _variance_with_each(J[free], known + information[others].sum(axis=0), M)
        return int(free[np.argmax(variance <= (1.0 + TIE) * variance.min())])

    def mean_variance(design: list[int]) -> float:
        return float(np.sum(np.linalg.inv(known + information[sorted(design)].sum(axis=0)) * M))

    chosen: list[int] = []
    while len(chosen) < n and (best := best_beside(chosen)) is not None:
        chosen.append(best)
    least, gained = mean_variance(chosen), True
    while gained:
        gained = False
        for k in range(len(chosen)):
            best = best_beside(chosen[:k] + chosen[k + 1 :])
            if best is None:
                continue
            exchanged = [*chosen[:k], best, *chosen[k + 1 :]]
            variance = mean_variance(exchanged)
            if variance < (1.0 - LEAST_GAIN) * least:
                least, chosen, gained = variance, exchanged, True
    return chosen


def _variance_with_each(J: Array, information: Array, M: Array) -> Array:
    """`trace(C M)` (m,) after each of the candidates, by the update of rank r of C (Woodbury)."""
    m, r, p = J.shape
    C = np.linalg.inv(information)
    JC = (J.reshape(m * r, p) @ C).reshape(m, r, p)
    innovation = np.eye(r) + JC @ J.transpose(0, 2, 1)
    told = (JC.reshape(m * r, p) @ M).reshape(m, r, p) @ JC.transpose(0, 2, 1)
    gain = np.trace(np.linalg.solve(innovation, told), axis1=1, axis2=2)
    variance: Array = np.sum(C * M) - gain
    return variance
