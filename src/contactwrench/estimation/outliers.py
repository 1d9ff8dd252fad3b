"""Poses that the tool does not explain: in contact, bumped, read before the arm was still, or mistyped.

A pose is an outlier, not an axis: the loss is on its whitened reading, all six numbers together. First a fit that
outliers cannot pull far, least squares under a multivariate Student's t (Lange, Little and Taylor, 1989), in the model
linearised at the ordinary fit. Then each pose is held against the fit to the others, noise and all: it stays if they
explain it, and that is repeated until nothing changes. So a pose that made its neighbours look bad is forgiven them,
and in clean recordings hardly any is lost.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..geometry.arrays import Array
from .noise import GROUPS

FALSE_ALARMS = 0.08
"""Probability, at most, that a clean recording of `PLENTY` poses or more loses one."""

PLENTY = 24
"""With fewer poses each is dearer, and the probability of losing one falls with the square of their number."""

SURELY_CLEAN = 0.75
"""Of the limit: where no pose is further off than this, none can hide others."""

TAIL = 3.0
"""Degrees of freedom of the Student's t that the robust fit takes the readings to have."""

BEYOND_DOUBT = 0.02
"""A pose that a clean one exceeds with this probability is not among those that the first fit is made of."""

VARIANCE_PASSES = 3
STUDENT_ITERATIONS = 40
SETTLED = 1e-3
ROUNDS = 20
MOST_LEFT_OUT = 0.4
"""Of the poses: where more would have to go, nobody knows which side is right, and none is left out."""

LEAST_DOF = 0.5
LEAST_SHARE = 0.02
"""Of a group's sum of squares: how much a pose leaves to the others is exact for both groups together only."""


@dataclass(frozen=True, eq=False)
class LinearReadings:
    """Readings (n, 6) as a linear function of p parameters, and how the noise of the axes compares.

    `J` (n, 6, p) and `errors` (n, 6) in units of the relative noise of each axis; `known` (q, p) and `known_errors`
    (q,) rows of unit variance.
    """

    J: Array
    errors: Array
    known: Array
    known_errors: Array


def outlying(linear: LinearReadings) -> NDArray[np.bool_]:
    """Which of the poses (n,) the others do not explain; none where too many would be."""
    n = len(linear.errors)
    kept, seen = _kept_by_student(linear), {b""}
    while kept.tobytes() not in seen and len(seen) <= ROUNDS:
        seen.add(kept.tobytes())
        distance, limit = deleted_distances(linear, kept)
        kept = distance <= limit
    return ~kept if np.mean(~kept) <= MOST_LEFT_OUT else np.zeros(n, dtype=bool)


def chance_of_loss(n: int) -> float:
    """Probability, at most, that a clean recording of n poses loses one."""
    return FALSE_ALARMS * min(1.0, (n / PLENTY) ** 2)


def deleted_distances(linear: LinearReadings, kept: NDArray[np.bool_]) -> tuple[Array, float]:
    """Squared distances (n,) of each pose from what the other poses that are `kept` say, in units of the noise that
    these have and of the error of the fit to them; and the limit that a clean recording exceeds anywhere with
    `chance_of_loss`.
    """
    from scipy.special import fdtri

    n = len(linear.errors)
    weight = kept.astype(np.float64)
    fit = weighted_fit(linear, weight)
    of_pose, along = _of_poses(linear, fit.weighted_by)
    of_pose, along = weight[:, None, None] * of_pose, weight[:, None] * along
    inverse = _inverse(fit.information - of_pose)
    without = np.einsum("npq,nq->np", inverse, fit.right - along)
    errors = linear.errors - np.einsum("nip,np->ni", linear.J, without)
    # what the others leave once the pose is gone: its own share goes, and so does its pull on them
    rest = _of_groups(weight[:, None] * fit.left**2).sum(axis=0) - _of_groups(weight[:, None] * fit.left * errors)
    dof = np.maximum(fit.dof - 3.0 * weight[:, None], LEAST_DOF)
    of_all = _of_groups(weight[:, None] * fit.left**2).sum(axis=0)
    of_others = np.maximum(rest, LEAST_SHARE * of_all + 1e-300) / dof
    spread = linear.J @ inverse @ linear.J.transpose(0, 2, 1)
    spread[:, range(6), range(6)] += np.repeat(of_others, 3, axis=1)
    distance = np.einsum("ni,ni->n", errors, np.linalg.solve(spread, errors[..., None])[..., 0])
    return distance, 6.0 * float(fdtri(6.0, 0.5 * float(dof.min(axis=0).sum()), 1.0 - chance_of_loss(n) / n))


def _kept_by_student(linear: LinearReadings) -> NDArray[np.bool_]:
    """Which poses (n,) a fit under a multivariate Student's t does not doubt; half of all poses count as clean."""
    from scipy.special import chdtri

    weight, variance = np.ones(len(linear.errors)), np.ones(2)
    distance = np.zeros(len(weight))
    for _ in range(STUDENT_ITERATIONS):
        fit = _weighted(linear, weight, variance)
        variance = fit.variance
        distance = np.sum(fit.left**2 / np.repeat(variance, 3), axis=1)
        before, weight = weight, (TAIL + 6.0) / (TAIL + distance)
        if float(np.abs(weight - before).max()) <= SETTLED:
            break
    typical = float(np.median(distance)) / float(chdtri(6.0, 0.5))
    doubted: NDArray[np.bool_] = distance > typical * float(chdtri(6.0, BEYOND_DOUBT))
    return ~doubted


@dataclass(frozen=True, eq=False)
class WeightedFit:
    """A weighted fit: normal equations (p, p) and (p,), the `inverse` of the former, what is `left` (n, 6), and of
    forces and of torques (2,) the `variance` that is left, its `dof`, and the one that the readings were `weighted_by`.
    """

    information: Array
    right: Array
    inverse: Array
    left: Array
    variance: Array
    dof: Array
    weighted_by: Array


def weighted_fit(linear: LinearReadings, weight: Array) -> WeightedFit:
    """The fit to poses of `weight` (n,), with the variances of forces and of torques that it finds itself."""
    fit = _weighted(linear, weight, np.ones(2))
    for _ in range(VARIANCE_PASSES):
        fit = _weighted(linear, weight, fit.variance)
    return fit


def _weighted(linear: LinearReadings, weight: Array, variance: Array) -> WeightedFit:
    n, _, p = linear.J.shape
    flat = linear.J.reshape(6 * n, p)
    weighted = flat * np.outer(weight, 1.0 / np.repeat(variance, 3)).reshape(-1, 1)
    information = weighted.T @ flat + linear.known.T @ linear.known
    right = weighted.T @ linear.errors.ravel() + linear.known.T @ linear.known_errors
    inverse = _inverse(information)
    left = linear.errors - (flat @ (inverse @ right)).reshape(n, 6)
    taken = np.sum((flat @ inverse) * weighted, axis=1).reshape(n, 6)
    dof = np.maximum(3.0 * weight.sum() - _of_groups(taken).sum(axis=0), LEAST_DOF)
    squares = _of_groups(weight[:, None] * left**2).sum(axis=0)
    return WeightedFit(information, right, inverse, left, np.maximum(squares / dof, 1e-12 * variance), dof, variance)


def _of_poses(linear: LinearReadings, variance: Array) -> tuple[Array, Array]:
    """Normal equations of each pose alone, (n, p, p) and (n, p)."""
    weighted = linear.J.transpose(0, 2, 1) / np.repeat(variance, 3)
    return weighted @ linear.J, np.einsum("npi,ni->np", weighted, linear.errors)


def _of_groups(values: Array) -> Array:
    """Sums (n, 2) of values (n, 6) over the forces and over the torques."""
    return np.stack([values[:, group].sum(axis=1) for group in GROUPS], axis=1)


def _inverse(information: Array) -> Array:
    """Inverses (..., p, p) of symmetric positive matrices whose units differ widely; huge where one is singular."""
    unit = np.sqrt(np.maximum(np.einsum("...pp->...p", information), 0.0))
    unit = np.where(unit > 0.0, unit, 1.0)
    units = unit[..., :, None] * unit[..., None, :]
    inverse: Array = np.linalg.inv(information / units + 1e-12 * np.eye(unit.shape[-1])) / units
    return inverse
