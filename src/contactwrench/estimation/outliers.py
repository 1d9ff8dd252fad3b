"""Poses that do not belong to the others: in contact, bumped, read before the arm was still.

Contacts mask each other, so the search for clean poses starts from many small subsets (least trimmed squares with
concentration steps; Rousseeuw and Van Driessen, 1999), and from where the errors of the fit of all fall in two. What it
proposes is then judged by evidence beside everything else (posterior.py).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..calibration.observability import LEVER
from ..geometry.arrays import Array

PROBABILITY = 0.25
"""That a recording has such poses at all; that it has k of them goes as 1 / k, up to `MOST_SHARE` of all."""

MOST_SHARE = 0.34
ON_A_LEVEL = 0.3
"""Of the poses: more than so many that are all off by the same are on a level of their own, as backlash makes it. A
single one may be, too, which nothing shows."""

TWO_LEVELS = 0.4
"""Odds that there are two levels, before the readings; each pose is on either alike."""

LEVEL_SHARE, USUAL_SHARE = 0.02, 0.0125
"""Of the weight: how far a level is off, the scale of a half-normal prior; and where that alone tells a level from a
contact."""

MOST_SCATTER = 3.0
"""Times the variance of the noise: errors that scatter less are alike."""

WIDTHS = np.geomspace(3.5, 3500.0, 7)
"""Of the wide distribution, times the noise: one for all such poses, or one for each."""

E_FOLDS = len(WIDTHS) * np.log(WIDTHS[1] / WIDTHS[0])
"""Over which these spread the prior of how far off such a pose is."""

WAYS_TO_TOUCH = 3.0
"""As widely off, each in its own way, or all by the same: alike before the readings."""

CLEAN_SHARE = 2.0 / 3.0
SUBSETS, OF_SUBSET = 120, 4
FEW = 8
CONCENTRATIONS, FINALISTS = 2, 12
MOST_CONCENTRATIONS = 20
SPLITS = 3
VARIANCE_PASSES = 3
FEWEST_POSES = 5
EACH, FURTHER = 200, 60
"""Up to so many poses that may be left out every number is tried; beyond, so many numbers, some 3 % apart."""
LogPrior: TypeAlias = Callable[[int, int], float]
"""Logarithm of the probability that of n poses a given set of k is left out."""

COMPARED = np.array([1.0, LEVER])
"""Of forces and torques, N and N m: as much, as long as their noise is not known."""
OF_GROUPS = np.repeat(np.eye(2), 3, axis=0)
"""(6, 2): sums over the forces, and over the torques."""


def log_prior_outlying(n: int, k: int) -> float:
    """Logarithm of the probability that of n poses a given set of k, and no others, are outlying."""
    if k == 0:
        return float(np.log1p(-PROBABILITY))
    most = max(int(MOST_SHARE * n), 1)
    if k > most:
        return -np.inf
    share = 1.0 / (k * np.sum(1.0 / np.arange(1, most + 1)))
    sets = math.lgamma(n + 1.0) - math.lgamma(k + 1.0) - math.lgamma(n - k + 1.0)
    return float(np.log(PROBABILITY * share) - sets)


def log_prior_two_levels(n: int, k: int) -> float:
    """Logarithm of the odds that of n poses a given set of k, the smaller one, is on a level of its own."""
    if k <= max(1.0, ON_A_LEVEL * n):
        return -np.inf
    return float(np.log(TWO_LEVELS) - (n - 1.0) * np.log(2.0))


def probability_of_a_level(n: int, errors: Array, scale: Array, weight: float) -> float:
    """That those of n poses that are off by `errors` (k, 6), of noise `scale` (6,), are on a level of their own and not
    in contact, as far as no reading tells: they are all off by the same. A tool of that `weight` (N) has only so much
    backlash.
    """
    k = len(errors)
    if not k or not alike(errors / scale):
        return 0.0
    halfway = 0.5 * errors.mean(axis=0)
    force = max(float(np.linalg.norm(halfway[:3])), float(np.linalg.norm(halfway[3:])) / LEVER)
    share = force / (USUAL_SHARE * max(abs(weight), 1e-12))
    of_level = np.log(TWO_LEVELS) - (n - 1.0) * np.log(2.0) + float(log_half_normal(share))
    of_contact = log_prior_outlying(n, k) - (np.log(WAYS_TO_TOUCH) if k > 1 else 0.0) - np.log(E_FOLDS)
    return float(1.0 / (1.0 + np.exp(min(of_contact - of_level, 700.0))))


def log_half_normal(share: Array | float) -> Array:
    """Logarithm of the half-normal prior, by the logarithm of the size, of what is `share` times its scale."""
    return np.asarray(np.log(np.sqrt(2.0 / np.pi) * np.maximum(share, 1e-300)) - 0.5 * np.square(share))


def alike(errors: Array) -> bool:
    """Whether errors (k, 6) in units of the noise differ from each other by no more than that."""
    off = errors - errors.mean(axis=0)
    return float(np.sum(off**2)) <= MOST_SCATTER * 6.0 * (len(errors) - 1.0)


def log_density_outlying(errors: Array, out: NDArray[np.bool_] | None = None) -> Array:
    """Logarithm of the density of outlying errors (..., n, 6) in units of the noise, those that are `out` (..., n), or
    all: wide with one width for all or one for each, or all off by the same, as poses are that touch the same thing in
    the same way.
    """
    out = np.ones(errors.shape[:-1], dtype=bool) if out is None else out
    k, squared = out.sum(axis=-1), np.einsum("...na,...na->...n", errors, errors) * out
    of_each, each = -6.0 * np.log(WIDTHS) - 0.5 * np.multiply.outer(squared[out], WIDTHS**-2.0), np.zeros(out.shape)
    most = of_each.max(axis=-1)
    each[out] = most + np.log(np.exp(of_each - most[:, None]).sum(axis=-1))
    apart = each.sum(axis=-1) - (k - 1.0) * np.log(len(WIDTHS))
    of_all = -6.0 * np.multiply.outer(k, np.log(WIDTHS)) - 0.5 * np.multiply.outer(squared.sum(axis=-1), WIDTHS**-2.0)
    total = (out[..., None, :].astype(np.float64) @ errors)[..., 0, :]
    along, spread = np.sum(total**2, axis=-1) / np.maximum(k, 1), 1.0 + np.multiply.outer(k, WIDTHS**2)
    off = (squared.sum(axis=-1) - along)[..., None]
    alike = np.logaddexp.reduce(-0.5 * (off + along[..., None] / spread) - 3.0 * np.log(spread), axis=-1)
    options = np.logaddexp.reduce([np.logaddexp.reduce(of_all, axis=-1), apart, alike], axis=0)
    return np.asarray(options - np.log(WAYS_TO_TOUCH * len(WIDTHS)) - 3.0 * np.log(2.0 * np.pi) * k)


def likely_clean(
    J: Array, errors: Array, information: Array, pull: Array
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """The poses (n,) that belong together, where the others are outliers, and where they are on a level of their own:
    `errors` (n, 6) linear in the parameters by `J` (n, 6, q), of which `information` (q, q) and `pull` (q,) are known.

    In the order in which the poses are off the best trimmed fit, or beyond where the fit of all falls in two, those are
    left out that the evidence of a steady bias would leave out: many that are off by the same hide in a trimmed fit.
    """
    n = len(errors)
    if n < FEWEST_POSES:
        return np.ones(n, dtype=bool), np.ones(n, dtype=bool)
    h = max(int(np.ceil(CLEAN_SHARE * n)), min(n - 1, FEWEST_POSES))
    problem = _Trimmed(J, errors, information, pull, h)
    kept = problem.concentrated(_subsets(n), CONCENTRATIONS)
    best = kept[np.argsort(problem.fit(kept, 1).variance.prod(axis=0))[:FINALISTS]]
    best = problem.concentrated(best, MOST_CONCENTRATIONS)
    fits = problem.fit(best)
    far = fits.distance[[np.argmin(fits.variance.prod(axis=0))]]
    if n > FEW:
        of_all = problem.fit(np.ones((1, n), dtype=bool))
        far = np.vstack([far, beyond_the_cut(of_all.left[0] / np.sqrt(OF_GROUPS @ of_all.variance[:, 0]))])
    return problem.settled(far, log_prior_outlying), problem.settled(far, log_prior_two_levels)


def beyond_the_cut(errors: Array) -> Array:
    """How far (n,) errors (n, 6) in units of the noise are beyond the likeliest cut in two sets about means of their
    own, of as many ways to cut, along the direction that tells the two apart best (Fisher, 1936), of few the one along
    which they differ most: above 0 in the smaller set.
    """
    n, below = len(errors), np.arange(1, len(errors))
    log_factorial = np.append(0.0, np.cumsum(np.log(np.arange(1.0, n + 1.0))))
    log_ways = log_factorial[n] - log_factorial[below] - log_factorial[n - below]
    off = errors - errors.mean(axis=0)
    off = off / max(float(np.sqrt(np.mean(off**2))), 1e-300)
    inverse = np.linalg.inv(off.T @ off / n + (6.0 / n) ** 2 * np.eye(6))  # few always fall in two somewhere
    directions = np.concatenate([np.eye(6), np.linalg.svd(off, full_matrices=False)[2]])
    for _ in range(SPLITS):
        along = directions @ off.T
        order = np.argsort(along, axis=1)
        sums = np.cumsum(off[order], axis=1)[:, :-1]
        apart = np.sum(sums @ inverse * sums, axis=2) / (below * (n - below))  # of all scatter, that of the two means
        odds = -0.5 * n * np.log(np.maximum(1.0 - apart, 1e-12)) - log_ways
        cut = np.argmax(odds, axis=1)[:, None]
        directions = np.take_along_axis(sums, cut[..., None], axis=1)[:, 0] @ inverse
    best = int(np.argmax(np.take_along_axis(odds, cut, axis=1)))
    first = int(cut[best, 0])
    beyond = along[best] - along[best, order[best, first : first + 2]].mean()
    return np.asarray(beyond if 2 * below[first] >= n else -beyond)


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

    def __init__(self, J: Array, errors: Array, information: Array, pull: Array, h: int) -> None:
        n, _, q = J.shape
        unit = 1.0 / np.sqrt(np.sum((J / (OF_GROUPS @ COMPARED)[:, None]) ** 2, axis=(0, 1)) + 1e-60)
        J, self.errors, self.h, self.known = J * unit, errors, h, np.zeros((q + 1, q + 1))
        self.known[:q, :q], self.known[:q, q] = information * unit * unit[:, None], pull * unit
        self.flat = J.reshape(6 * n, q).T
        each = min(n // 2, EACH)
        self.numbers = np.unique(np.r_[: each + 1, np.geomspace(each, n // 2, FURTHER).astype(np.intp)])  # left out
        columns = np.concatenate([J, errors[..., None]], axis=2)
        groups = columns.reshape(n, 2, 3, q + 1)
        squared = np.sum((errors / (OF_GROUPS @ COMPARED)) ** 2, axis=1)
        self.rough = COMPARED**2 * max(float(np.median(squared)) / 6.0, 1e-20)
        self.products = np.einsum("ngap,ngaq->gnpq", groups, groups).reshape(2, n, -1)
        self.at_first = np.tensordot(1.0 / self.rough, self.products, 1)

    def fit(self, kept: NDArray[np.bool_], passes: int = VARIANCE_PASSES) -> _Fits:
        """The fits to the poses kept (k, n), forces and torques with variances of their own."""
        k, n = kept.shape
        q, share = len(self.flat), kept.astype(np.float64)
        total = (share @ self.at_first).reshape(k, q + 1, q + 1)
        products = (share @ self.products if passes > 1 else self.products[:, :0]).reshape(2, -1, q + 1, q + 1)
        count = kept.sum(axis=1)
        freedom = np.maximum(3.0 * count - 0.5 * q, 0.25 * count)
        for left_to_do in range(passes)[::-1]:
            total += self.known
            normal = total[:, :q, :q]
            diagonal = np.einsum("kpp->kp", normal)
            diagonal += 1e-10 * diagonal + 1e-60
            step = np.linalg.solve(normal, total[:, :q, q:])[..., 0]
            left = self.errors - (step @ self.flat).reshape(k, n, 6)
            squares = left**2 @ OF_GROUPS
            variance = np.maximum((share[:, None, :] @ squares)[:, 0].T / freedom, 1e-24)
            if left_to_do:
                total = np.einsum("gkpq,gk->kpq", products, 1.0 / variance)
        return _Fits((squares @ (1.0 / variance).T[:, :, None])[:, :, 0], left, variance, normal)

    def concentrated(self, kept: NDArray[np.bool_], times: int) -> NDArray[np.bool_]:
        """Each set replaced by the `h` poses nearest to its own fit, so many times."""
        for _ in range(times):
            before, nearest = kept, np.argpartition(self.fit(kept, 1).distance, self.h - 1, axis=1)[:, : self.h]
            kept = np.zeros_like(before)
            np.put_along_axis(kept, nearest, True, axis=1)
            if (kept == before).all():
                break
        return kept

    def settled(self, far: Array, log_prior: LogPrior) -> NDArray[np.bool_]:
        """The likeliest set that is reached from how `far` off (m, n) the poses are in some ways to see it."""
        log_priors = np.array([log_prior(len(self.errors), out) for out in self.numbers.tolist()])
        k, log_priors = self.numbers[np.isfinite(log_priors)], log_priors[np.isfinite(log_priors)]
        clean, most = np.ones(len(self.errors), dtype=bool), -np.inf
        for _ in range(MOST_CONCENTRATIONS):
            evidence, rival, far = self.likeliest(far, k, log_priors)
            if evidence <= most:
                break
            clean, most = rival, evidence
        return clean

    def likeliest(self, far: Array, k: NDArray[np.intp], log_priors: Array) -> tuple[float, NDArray[np.bool_], Array]:
        """Of the sets that leave out the k (s,) poses furthest off, in each way to see it, `far` (m, n), the largest
        evidence, that set, and the distances (1, n) from its fit.
        """
        m, n = far.shape
        place = np.empty((m, n), dtype=np.intp)
        np.put_along_axis(place, np.argsort(-far, axis=1), np.arange(n)[None], axis=1)
        masks = (place[:, None] >= k[:, None]).reshape(-1, n)
        fits, k, log_priors = self.fit(masks), np.tile(k, m), np.tile(log_priors, m)
        log_variance = np.log(fits.variance)
        log_det = np.linalg.slogdet(fits.normal)[1]  # but for what all have in common
        z = fits.left / np.sqrt(np.repeat(fits.variance, 3, axis=0).T[:, None])
        density = np.where(k > 0, log_density_outlying(z, ~masks), 0.0) + log_priors
        density -= 3.0 * (np.log(2.0 * np.pi) + 1.0) * (n - k)
        evidence = density - 0.5 * log_det - 1.5 * n * log_variance.sum(axis=0)
        best = int(np.argmax(evidence))
        return float(evidence[best]), masks[best], fits.distance[best][None]


@dataclass(frozen=True, eq=False)
class _Fits:
    """Of a stack of fits: squared distances (k, n) of all poses in units of what is left in those kept, errors `left`
    (k, n, 6), `variance` (2, k) of forces and of torques, and the `normal` matrices (k, q, q) of parameters in units
    that are the same for all.
    """

    distance: Array
    left: Array
    variance: Array
    normal: Array
