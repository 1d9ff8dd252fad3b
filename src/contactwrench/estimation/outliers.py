"""Poses that do not belong to the others: in contact, bumped, read before the arm was still.

Each pose comes, with a small probability, from a wide distribution. Contacts mask each other, so the search for clean
poses starts from many small subsets (least trimmed squares with concentration steps; Rousseeuw and Van Driessen, 1999),
never from the fit of all: up to a third of the poses may be wrong. It is always run; what it proposes is then judged by
evidence beside everything else (posterior.py).
"""

from __future__ import annotations

import math
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from ..geometry.arrays import Array

PROBABILITY = 0.4
"""That a recording has such poses at all; that it has k of them goes as 1 / k, up to `MOST_SHARE` of all."""

MOST_SHARE = 0.4
WIDTHS = np.geomspace(3.5, 3500.0, 7)
"""Of the wide distribution, times the noise: one for all such poses, or one for each."""

CLEAN_SHARE = 2.0 / 3.0
SUBSETS, OF_SUBSET = 120, 4
FEW = 8
CONCENTRATIONS, FINALISTS = 2, 12
MOST_CONCENTRATIONS = 20
DOUBTED = 1e-3
"""Probability of a distance this large, beyond which the search doubts a pose."""


def log_prior_outlying(n: int, k: int) -> float:
    """Logarithm of the probability that of n poses a given set of k, and no others, are outlying."""
    if k == 0:
        return float(np.log1p(-PROBABILITY))
    most = max(int(MOST_SHARE * n), 1)
    share = 1.0 / (k * np.sum(1.0 / np.arange(1, most + 1)))
    sets = math.lgamma(n + 1.0) - math.lgamma(k + 1.0) - math.lgamma(n - k + 1.0)
    return float(np.log(PROBABILITY * share) - sets)


def log_density_outlying(errors: Array) -> float:
    """Logarithm of the density of outlying errors (k, 6) in units of the noise: wide with one width for all or one for
    each, or all off by the same, as poses are that touch the same thing in the same way.
    """
    k, squared = len(errors), np.sum(errors**2, axis=1)
    of_each = -6.0 * np.log(WIDTHS) - 0.5 * np.multiply.outer(squared, WIDTHS**-2.0)
    apart = np.logaddexp.reduce(of_each, axis=1).sum() - (k - 1.0) * np.log(len(WIDTHS))
    mean = errors.mean(axis=0)
    spread = 1.0 + k * WIDTHS**2
    alike = -0.5 * (np.sum((errors - mean) ** 2) + k * (mean @ mean) / spread) - 3.0 * np.log(spread)
    options = [np.logaddexp.reduce(of_each.sum(axis=0)), apart, np.logaddexp.reduce(alike)]
    return float(np.logaddexp.reduce(options) - np.log(3.0 * len(WIDTHS)) - 3.0 * np.log(2.0 * np.pi) * k)


def likely_clean(J: Array, errors: Array, information: Array, pull: Array, lever: float) -> NDArray[np.bool_]:
    """The poses (n,) that belong together: `errors` (n, 6) linear in the parameters by `J` (n, 6, q), of which
    `information` (q, q) and `pull` (q,) are known; `lever` m compares a torque with a force.
    """
    from scipy.special import chdtri

    n = len(errors)
    h = max(int(np.ceil(CLEAN_SHARE * n)), min(n - 1, 5))
    if n < 5:
        return np.ones(n, dtype=bool)
    problem = _Trimmed(J, errors, information, pull, lever, h)
    kept = problem.concentrated(_subsets(n), CONCENTRATIONS)
    score = problem.score(kept)
    best = kept[np.argsort(score)[:FINALISTS]]
    best = problem.concentrated(best, MOST_CONCENTRATIONS)
    last = best[int(np.argmin(problem.score(best)))][None]
    limit = float(chdtri(6.0, DOUBTED))
    for _ in range(MOST_CONCENTRATIONS):
        distance = problem.distance(last)[0]
        typical = np.partition(distance, h - 1)[h - 1] / float(chdtri(6.0, max(1.0 - (h - 0.5) / n, 1.0 / (4.0 * n))))
        clean = distance <= limit * max(float(typical), 1e-300)
        if int(clean.sum()) < h or (clean == last[0]).all():
            break
        last = clean[None]
    return np.asarray(last[0], dtype=bool)


def _subsets(n: int) -> NDArray[np.bool_]:
    """Masks (k, n): of few poses all but one or two, of more some at random, always the same ones."""
    if n <= FEW:
        left_out = [c for k in (0, 1, 2) for c in combinations(range(n), k) if n - k >= OF_SUBSET]
        masks = np.ones((len(left_out), n), dtype=bool)
        for mask, out in zip(masks, left_out, strict=True):
            mask[list(out)] = False
        return masks
    order = np.argsort(np.random.default_rng(n).random((SUBSETS, n)), axis=1)
    masks = np.zeros((SUBSETS, n), dtype=bool)
    np.put_along_axis(masks, order[:, :OF_SUBSET], True, axis=1)
    np.put_along_axis(masks[::2], order[::2, : 2 * OF_SUBSET], True, axis=1)
    masks[0] = True
    return masks


class _Trimmed:
    """Least squares on subsets of the poses, in stacks."""

    def __init__(self, J: Array, errors: Array, information: Array, pull: Array, lever: float, h: int) -> None:
        self.J, self.errors, self.information, self.pull, self.h = J, errors, information, pull, h
        self.unit = np.array([1.0, 1.0, 1.0, lever, lever, lever])
        n, _, q = J.shape
        columns = np.concatenate([J, errors[..., None]], axis=2)
        groups = columns.reshape(n, 2, 3, q + 1)
        self.products = np.einsum("ngap,ngaq->gnpq", groups, groups).reshape(2, n, -1)

    def distance(self, kept: NDArray[np.bool_]) -> Array:
        """Squared distances (k, n) from the fits to the poses kept (k, n), in units of what is left in those."""
        k, n = kept.shape
        q = self.J.shape[2]
        products = (kept.astype(np.float64) @ self.products).reshape(2, k, q + 1, q + 1)
        variance = np.ones((2, k)) * np.array([1.0, self.unit[3] ** 2])[:, None] * self._rough()
        for _ in range(3):
            total = np.einsum("gkpq,gk->kpq", products, 1.0 / variance)
            information = total[:, :q, :q] + self.information
            unit = np.sqrt(np.einsum("kpp->kp", information)) + 1e-300
            units = unit[:, :, None] * unit[:, None, :]
            scaled = information / units + 1e-10 * np.eye(q)
            step = np.linalg.solve(scaled, ((total[:, :q, q] + self.pull) / unit)[..., None])[..., 0] / unit
            left = self.errors - np.einsum("nap,kp->kna", self.J, step, optimize=True)
            squares = (left**2).reshape(k, n, 2, 3).sum(axis=3)
            count = kept.sum(axis=1)
            freedom = np.maximum(3.0 * count - 0.5 * q, 0.25 * count)
            variance = np.maximum(np.einsum("kng,kn->gk", squares, kept) / freedom, 1e-24)
        result: Array = np.einsum("kng,gk->kn", squares, 1.0 / variance)
        self.variance = variance
        return result

    def _rough(self) -> float:
        return max(float(np.median(np.sum((self.errors / self.unit) ** 2, axis=1))) / 6.0, 1e-20)

    def concentrated(self, kept: NDArray[np.bool_], times: int) -> NDArray[np.bool_]:
        """Each set replaced by the `h` poses nearest to its own fit, so many times."""
        for _ in range(times):
            distance = self.distance(kept)
            before, nearest = kept, np.argpartition(distance, self.h - 1, axis=1)[:, : self.h]
            kept = np.zeros_like(before)
            np.put_along_axis(kept, nearest, True, axis=1)
            if (kept == before).all():
                break
        return kept

    def score(self, kept: NDArray[np.bool_]) -> Array:
        """What is left of forces and of torques in sets of equal size, the least the best."""
        self.distance(kept)
        score: Array = np.log(self.variance).sum(axis=0)
        return score
