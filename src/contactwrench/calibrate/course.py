"""The course of the bias while the poses were recorded: steady, a step, a steady drift, or a random walk.

A sensor warms up; a driver zeroes it half-way. In the order of time the residuals then show it. Each course is a few
more columns of the linearised problem, zero at the last pose, so that the bias that is estimated is the LAST one; a
random walk is a covariance between poses. A steady bias is given up only where a test says so, at one false alarm in
130; the courses are then compared by the Bayesian information criterion (Schwarz, 1978), in which leaving a pose out
costs what six parameters cost: so a few bumped poses are not a step, and a step is not many bumped poses.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..orientation import Array
from .noise import GROUPS
from .outliers import LinearReadings, WeightedFit, outlying, weighted_fit

FALSE_ALARM = 0.0025
"""Of each of the three tests."""

FEWEST_POSES = 8
SIDE = 2
"""A step has at least so many poses on either side."""

MANY_OUTLIERS = 3
WALK_RATIOS = np.geomspace(0.02, 10.0, 25)
"""Of a random walk's std per unit of time to the noise, where the restricted likelihood is looked at."""


@dataclass(frozen=True, eq=False)
class Course:
    """How the bias went: `kind` steady, step, drift or walk; `change` (n, 6) N and N m, what each pose's bias was off
    the last one; `first_after` the index of the first pose after a step; which poses are `outlying` (n,); `covariance`
    (p, p), by how much that of the parameters grows because the course is unknown; `parameters` that it took.
    """

    kind: str
    change: Array
    first_after: int | None
    outlying: NDArray[np.bool_]
    covariance: Array
    parameters: float


def course_of_bias(linear: LinearReadings, unit: Array, time: Array) -> Course:
    """The course that explains the readings best, poses in the order of `time` (n,).

    `unit` (6,): the relative noise that `linear` is in units of, N and N m.
    """
    n = len(time)
    out = outlying(linear)
    steady = Course("steady", np.zeros((n, 6)), None, out, np.zeros((linear.J.shape[2],) * 2), 0.0)
    if n < FEWEST_POSES:
        return steady
    if not _moves(linear, ~out, time) and np.sum(out) < MANY_OUTLIERS:
        return steady
    candidates = [_Candidate("steady", None, np.zeros((n, 0)), out)]
    shapes: list[tuple[str, int | None, Array]] = [("drift", None, _powers(time, 1)), ("walk", None, _powers(time, 3))]
    shapes += [("step", k, _step(n, k)) for k in _likeliest_steps(linear, n)]
    for kind, k, shape in shapes:
        candidates.append(_Candidate(kind, k, shape, outlying(_with(linear, shape))))
    best = min(candidates, key=lambda candidate: _criterion(linear, candidate))
    if best.kind == "steady":
        return steady
    if best.kind == "walk":
        return _walk(linear, best, time, unit)
    return _fixed(linear, best, unit)


@dataclass(frozen=True, eq=False)
class _Candidate:
    kind: str
    first_after: int | None
    shape: Array
    outlying: NDArray[np.bool_]


def _powers(time: Array, degree: int) -> Array:
    """Powers (n, degree) of the time before the last pose, 0 to 1."""
    before = (time[-1] - time) / max(float(time[-1] - time[0]), 1e-300)
    return np.stack([before**k for k in range(1, degree + 1)], axis=1)


def _step(n: int, k: int) -> Array:
    return (np.arange(n) < k).astype(np.float64)[:, None]


def _with(linear: LinearReadings, shape: Array) -> LinearReadings:
    """Six more columns for each column of `shape` (n, m); readings are in units of their noise, so are these."""
    n, m = shape.shape
    columns = np.einsum("nm,ij->nimj", shape, np.eye(6)).reshape(n, 6, 6 * m)
    known = np.hstack([linear.known, np.zeros((len(linear.known), 6 * m))])
    return LinearReadings(np.concatenate([linear.J, columns], axis=2), linear.errors, known, linear.known_errors)


def _of(linear: LinearReadings, kept: NDArray[np.bool_]) -> LinearReadings:
    return LinearReadings(linear.J[kept], linear.errors[kept], linear.known, linear.known_errors)


def _moves(linear: LinearReadings, kept: NDArray[np.bool_], time: Array) -> bool:
    """Whether a drift, a smooth course or a step explains the kept poses better than chance would."""
    some, when = _of(linear, kept), time[kept]
    n = len(when)
    if n < FEWEST_POSES:
        return False
    if min(_chance(some, _powers(when, degree)) for degree in (1, 3)) < FALSE_ALARM:
        return True
    places = range(SIDE, n - SIDE + 1)
    return min(_chance(some, _step(n, k)) for k in places) < FALSE_ALARM / len(places)


def _chance(linear: LinearReadings, shape: Array) -> float:
    """Probability that columns of this shape explain so much, or more, of readings with a steady bias (F test)."""
    from scipy.special import fdtrc

    everything = np.ones(len(shape))
    without = weighted_fit(linear, everything)
    extended = weighted_fit(_with(linear, shape), everything)
    more = 6.0 * shape.shape[1]
    gain = sum(
        float(np.sum(without.left[:, group] ** 2) - np.sum(extended.left[:, group] ** 2)) / variance
        for group, variance in zip(GROUPS, extended.variance, strict=True)
    )
    return float(fdtrc(more, float(extended.dof.sum()), max(gain, 0.0) / more))


def _likeliest_steps(linear: LinearReadings, n: int) -> list[int]:
    """The places where a step leaves least, three of them."""
    everything = np.ones(n)
    left = {
        k: float(np.sum(np.log(weighted_fit(_with(linear, _step(n, k)), everything).variance)))
        for k in range(SIDE, n - SIDE + 1)
    }
    return sorted(left, key=lambda k: left[k])[:3]


def _criterion(linear: LinearReadings, candidate: _Candidate) -> float:
    n = len(candidate.outlying)
    fit = weighted_fit(_with(linear, candidate.shape), (~candidate.outlying).astype(np.float64))
    parameters = 6.0 * candidate.shape.shape[1] + 6.0 * float(np.sum(candidate.outlying))
    place = 2.0 * np.log(n) if candidate.first_after is not None else 0.0
    return float(3.0 * n * np.sum(np.log(fit.variance)) + parameters * np.log(6.0 * n) + place)


def _fixed(linear: LinearReadings, candidate: _Candidate, unit: Array) -> Course:
    """A step or a drift: the columns' coefficients by least squares, and what not knowing them costs."""
    p = linear.J.shape[2]
    kept = (~candidate.outlying).astype(np.float64)
    fit = weighted_fit(_with(linear, candidate.shape), kept)
    x = fit.inverse @ fit.right
    change = np.einsum("nm,mi->ni", candidate.shape, x[p:].reshape(-1, 6)) * unit
    alone = np.linalg.inv(fit.information[:p, :p])
    growth = fit.inverse[:p, :p] - alone
    return Course(
        candidate.kind, change, candidate.first_after, candidate.outlying, growth, 6.0 * candidate.shape.shape[1]
    )


def _walk(linear: LinearReadings, candidate: _Candidate, time: Array, unit: Array) -> Course:
    """A random walk: generalised least squares with the walk's covariance between poses, its strength where the
    restricted likelihood is largest; then the course itself, the best linear prediction.
    """
    n, p = len(time), linear.J.shape[2]
    kept = ~candidate.outlying
    before = (time[-1] - time) / max(float(time[-1] - time[0]), 1e-300)
    together = np.minimum.outer(before, before)
    some = _of(linear, kept)
    best: tuple[float, Array, Array, WeightedFit] | None = None
    for ratio in WALK_RATIOS:
        noise = np.eye(int(kept.sum())) + ratio**2 * n * together[np.ix_(kept, kept)]
        factor = np.linalg.cholesky(noise)
        whitened = LinearReadings(
            np.linalg.solve(factor, some.J.reshape(len(noise), -1)).reshape(some.J.shape),
            np.linalg.solve(factor, some.errors),
            some.known,
            some.known_errors,
        )
        fit = weighted_fit(whitened, np.ones(len(noise)))
        deviance = float(
            fit.dof @ np.log(fit.variance)
            + 12.0 * np.sum(np.log(np.diag(factor)))
            + np.linalg.slogdet(fit.information)[1]
        )
        if best is None or deviance < best[0]:
            x = fit.inverse @ fit.right
            smooth = ratio**2 * n * together[:, kept] @ np.linalg.inv(noise)
            best = (deviance, smooth, x, fit)
    if best is None:
        raise TypeError("there are ratios to try")
    _, smooth, x, fit = best
    change = smooth @ (some.errors - some.J @ x) * unit
    steady = np.einsum("nip,i,niq->pq", some.J, np.repeat(1.0 / fit.weighted_by, 3), some.J)
    growth = fit.inverse - np.linalg.inv(steady + linear.known.T @ linear.known)
    return Course("walk", change, None, candidate.outlying, growth, 6.0 * float(np.trace(smooth[kept])))
