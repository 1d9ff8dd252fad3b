"""How the bias moved while the poses were recorded: not at all, by a step, a steady drift, or a random walk.

A sensor warms up; a driver zeroes it half-way. In the order of time the residuals then show it. Each motion is a few
more columns of the linearised problem, zero at the last pose, so that the bias that is estimated is the LAST one; a
random walk is a covariance between poses. A steady bias is given up only where a test says so, at one false alarm in
130; the motions are then compared by the Bayesian information criterion (Schwarz, 1978), in which leaving a pose out
has a cost too: so a few bumped poses are not a step, and a step is not many bumped poses.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..calibration.fields import Kind
from ..geometry.arrays import Array
from ..statistics import two_digits
from .outliers import LinearReadings, outlying, weighted_fit

FALSE_ALARM = 0.0025
"""Of each of the three tests."""

FEWEST_POSES = 8
HOUR = 3600.0
SIDE = 3
"""A step has at least so many poses on either side."""

OUTLIER_COST = 20.0
"""Of leaving a pose out, in the criterion: about the squared distance at which one is left out."""

MANY_OUTLIERS = 3
SPANNED = 1e-7
MOST_POSES_OF_WALK = 300
"""A walk is a covariance between all poses; of more, a drift and steps have to do."""

WALK_RATIOS = np.geomspace(0.02, 10.0, 25)
"""Of a random walk's std per unit of time to the noise, where the restricted likelihood is looked at."""


@dataclass(frozen=True, eq=False)
class BiasDrift:
    """How the bias moved: the `kind` of finding, None where it did not; `change` (n, 6) N and N m, what each bias was
    off the last one; `first_after` the index of the first pose after a step; which poses are `outlying` (n,);
    `covariance` (p, p), by how much that of the parameters grows because the motion is unknown; `parameters` it took.
    """

    kind: Kind | None
    change: Array
    first_after: int | None
    outlying: NDArray[np.bool_]
    covariance: Array
    parameters: float


def likeliest_drift(linear: LinearReadings, wide: Array, unit: Array, time: Array) -> BiasDrift:
    """The motion that explains the readings best, poses in the order of `time` (n,).

    `wide` (n, 6, q): columns that may explain a residual as well as time does, cross-talk first of all; the tests leave
    it to them. `unit` (6,): the relative noise that `linear` and `wide` are in units of, N and N m.
    """
    n = len(time)
    out = outlying(linear)
    steady = BiasDrift(None, np.zeros((n, 6)), None, out, np.zeros((linear.J.shape[2],) * 2), 0.0)
    if n < FEWEST_POSES:
        return steady
    if not _moves(linear, wide, ~out, time) and np.sum(out) < MANY_OUTLIERS:
        return steady
    steps = _likeliest_steps(linear, n)
    shapes = [(None, _powers(time, 1)), *((k, _step(n, k)) for k in steps)]
    drifts = [_drift_of_shape(linear, shape, k, unit) for k, shape in shapes]
    if n <= MOST_POSES_OF_WALK:
        drifts.append(_walk(linear, time, unit))
    drifts.append((_criterion(linear, np.zeros((n, 0)), out), steady))
    return min(drifts, key=lambda drift: drift[0])[1]


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


def _moves(linear: LinearReadings, wide: Array, kept: NDArray[np.bool_], time: Array) -> bool:
    """Whether a drift, a smooth motion or a step explains the kept poses better than chance would."""
    some = _of(linear, kept)
    n = len(some.errors)
    if n < FEWEST_POSES:
        return False
    fit = weighted_fit(some, np.ones(n))
    scale = np.sqrt(np.repeat(fit.weighted_by, 3))
    columns = np.concatenate([some.J, wide[kept]], axis=2) / scale[:, None]
    return chance_of_steady(columns, fit.left / scale, time[kept]) < FALSE_ALARM


def chance_of_steady(columns: Array, whitened: Array, time: Array) -> float:
    """Probability that whitened residuals (n, 6) of a steady bias follow `time` (n,) as much, or more, by chance: the
    least of three F tests, of a drift, a cubic and a step anywhere, once `columns` (n, 6, q) had their share.
    """
    n = len(whitened)
    U, s, _ = np.linalg.svd(columns.reshape(6 * n, -1), full_matrices=False)
    U = U[:, s > SPANNED * s[0]]
    whitened = (whitened.ravel() - U @ (U.T @ whitened.ravel())).reshape(n, 6)
    dof = 6.0 * n - float(U.shape[1])
    U = U.reshape(n, 6, -1)
    chances = [_chance(_gain(U, whitened, shape), 6.0 * shape.shape[1], whitened, dof) for shape in _smooth(time)]
    chances.append((n - 2 * SIDE + 1) * _chance(float(np.max(_gain_of_steps(U, whitened))), 6.0, whitened, dof))
    return min(chances)


def _smooth(time: Array) -> tuple[Array, Array]:
    return _powers(time, 1), _powers(time, 3)


def _chance(gain: float, more: float, whitened: Array, dof: float) -> float:
    """Probability that `more` columns explain `gain` of the residuals' sum of squares by chance (F test)."""
    from scipy.special import fdtrc

    left = max(float(np.sum(whitened**2)) - gain, 1e-300)
    return float(fdtrc(more, dof - more, (gain / more) / (left / (dof - more)))) if dof > more else 1.0


def _gain(U: Array, whitened: Array, shape: Array) -> float:
    """By how much six columns for each column of `shape` (n, m) lessen the sum of squares."""
    m = shape.shape[1]
    spanned = np.einsum("nm,nip->mip", shape, U).reshape(6 * m, -1)
    across = np.kron(shape.T @ shape, np.eye(6)) - spanned @ spanned.T
    along = np.einsum("nm,ni->mi", shape, whitened).ravel()
    return float(along @ np.linalg.lstsq(across, along, rcond=None)[0])


def _gain_of_steps(U: Array, whitened: Array) -> Array:
    """The same for a step after each pose but the first and the last `SIDE` - 1."""
    n = len(whitened)
    places = slice(SIDE - 1, n - SIDE)
    spanned = np.cumsum(U, axis=0)[places]
    along = np.cumsum(whitened, axis=0)[places]
    across = np.arange(SIDE, n - SIDE + 1)[:, None, None] * np.eye(6) - spanned @ spanned.transpose(0, 2, 1)
    across += 1e-9 * n * np.eye(6)
    gain: Array = np.einsum("ki,ki->k", along, np.linalg.solve(across, along[..., None])[..., 0])
    return gain


def _likeliest_steps(linear: LinearReadings, n: int) -> list[int]:
    """The places where a step explains most, three of them."""
    fit = weighted_fit(linear, np.ones(n))
    scale = np.sqrt(np.repeat(fit.weighted_by, 3))
    U = np.linalg.qr((linear.J / scale[:, None]).reshape(6 * n, -1))[0].reshape(n, 6, -1)
    gain = _gain_of_steps(U, fit.left / scale)
    return [int(k) + SIDE for k in np.argsort(-gain)[:3]]


def _criterion(linear: LinearReadings, shape: Array, out: NDArray[np.bool_]) -> float:
    """The Bayesian information criterion of columns of this shape with those poses left out."""
    n = len(out)
    fit = weighted_fit(_with(linear, shape), (~out).astype(np.float64))
    cost: float = 6.0 * shape.shape[1] * float(np.log(6.0 * n)) + OUTLIER_COST * float(np.sum(out))
    return 3.0 * n * float(np.sum(np.log(fit.variance))) + cost


def _drift_of_shape(linear: LinearReadings, shape: Array, k: int | None, unit: Array) -> tuple[float, BiasDrift]:
    """A step before pose k, or a drift: the columns' coefficients by least squares, and what not knowing them costs."""
    kind = Kind.BIAS_DRIFTED if k is None else Kind.BIAS_STEPPED
    n, p = len(shape), linear.J.shape[2]
    out = outlying(_with(linear, shape))
    place = 0.0 if k is None else 2.0 * float(np.log(n))
    fit = weighted_fit(_with(linear, shape), (~out).astype(np.float64))
    x = fit.inverse @ fit.right
    change = np.einsum("nm,mi->ni", shape, x[p:].reshape(-1, 6)) * unit
    growth = fit.inverse[:p, :p] - np.linalg.inv(fit.information[:p, :p])
    return _criterion(linear, shape, out) + place, BiasDrift(kind, change, k, out, growth, 6.0 * shape.shape[1])


def _walk(linear: LinearReadings, time: Array, unit: Array) -> tuple[float, BiasDrift]:
    """A random walk: generalised least squares with the walk's covariance between poses, its strength where the
    restricted likelihood is largest; then the walk itself, the best linear prediction. Outliers are told from a
    cubic.
    """
    n = len(time)
    out = outlying(_with(linear, _powers(time, 3)))
    some = _of(linear, ~out)
    before = (time[-1] - time) / max(float(time[-1] - time[0]), 1e-300)
    together = np.minimum.outer(before, before)[:, ~out]
    fits = []
    for ratio in WALK_RATIOS:
        walk = ratio**2 * n * together
        noise = np.eye(len(some.errors)) + walk[~out]
        factor = np.linalg.cholesky(noise)
        unmixed = np.asarray(np.linalg.inv(factor), dtype=np.float64)
        J = np.tensordot(unmixed, some.J, axes=1)
        whitened = LinearReadings(J, unmixed @ some.errors, some.known, some.known_errors)
        fit = weighted_fit(whitened, np.ones(len(noise)))
        of_walk = 12.0 * float(np.sum(np.log(np.diag(factor))))
        spread = 3.0 * len(noise) * float(np.sum(np.log(fit.variance)))
        restricted = spread + float(np.linalg.slogdet(fit.information)[1]) + of_walk
        criterion = float(3.0 * n * np.sum(np.log(fit.variance))) + of_walk
        fits.append((restricted, criterion, fit, ratio))
    _, criterion, fit, ratio = min(fits, key=lambda fit: fit[0])
    walk = ratio**2 * n * together
    smooth = walk @ np.linalg.inv(np.eye(len(some.errors)) + walk[~out])
    change = smooth @ (some.errors - some.J @ (fit.inverse @ fit.right)) * unit
    steady = np.einsum("nip,i,niq->pq", some.J, np.repeat(1.0 / fit.weighted_by, 3), some.J)
    growth = fit.inverse - np.linalg.inv(steady + linear.known.T @ linear.known)
    cost = float(np.log(6.0 * n)) + OUTLIER_COST * float(np.sum(out))
    taken = 6.0 * float(np.trace(smooth[~out]))
    return criterion + cost, BiasDrift(Kind.BIAS_WANDERED, change, None, out, growth, taken)


def in_words(drift: BiasDrift, names: list[str], t_first: float | None, t_last: float | None) -> str:
    """How the bias moved, of poses with those names, from the begin of the first to the end of the last (s)."""
    if drift.first_after is not None:
        before, after = names[drift.first_after - 1 : drift.first_after + 1]
        return (
            f"the bias stepped by {_wrench(-drift.change[0])} between {before} and {after}: both sides share the "
            "tool, and the bias is that of the last pose; was the sensor zeroed there?"
        )
    span, per = float(len(names) - 1), "a pose"
    if t_first is not None and t_last is not None and t_last > t_first:
        span, per = (t_last - t_first) / HOUR, "an hour"
    if drift.kind is Kind.BIAS_DRIFTED:
        return (
            f"the bias drifted by {_wrench(-drift.change[0] / span)} {per}, steadily: the bias is that of the last "
            "pose; let the sensor warm up before the next calibration"
        )
    steps = np.diff(drift.change, axis=0)
    strength = np.sqrt(np.sum(steps**2, axis=0) / span)
    furthest = float(np.linalg.norm(drift.change[:, :3], axis=1).max())
    return (
        f"the bias wandered by up to {furthest:.2g} N, as a random walk of {_wrench(strength)} per root of {per}: the "
        "bias is that of the last pose; let the sensor warm up before the next calibration"
    )


def _wrench(values: Array) -> str:
    force, torque = (", ".join(two_digits(value) for value in part) for part in (values[:3], 1e3 * values[3:]))
    return f"({force}) N and ({torque}) mN m"
