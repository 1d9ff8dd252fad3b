"""The delay that lets a rigid tool explain the most of a moving recording, and how far off it may be.

At a given delay the wrench is linear in bias, gravity and accelerations (variable projection: Golub and Pereyra, 1973);
left are the delay and two angles of a base that does not stand as stated, found by Gauss-Newton steps.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..geometry.arrays import Array
from .motion import ArmMotion
from .samples import WrenchStream
from .spectra import spectral_std

GRID = 0.04
"""s: no motion of an arm is over in less, so that the search misses no minimum; then it goes on in steps of"""
FINE = 0.01
REWEIGHTED = 4
"""Times that contacts are told from the rest before it."""
SAME = 1e-10
"""Of the largest eigenvalue: columns that a motion does not tell apart have less."""
TILT_SD = 0.1
"""rad: how far the base may stand from its start, where the motion does not tell."""
CONTACT = 4.1
"""Standard deviations, of six axes at once: 1 % of free readings lie beyond (chi-square)."""
MOST_STEPS, CLOSE = 40, 1e-7
"""The last step's size, s."""
ROUNDING = 1e-12
"""Of an axis' variance: numbers in a file are no closer."""
STRUCTURED, UNKNOWN_ACCELERATIONS = 1.15, 3.0
"""Where positions are not known, and so much more is left than noise: the flange's accelerations move with the arm, so
that their spectrum says too little; by how much was found on the virtual rig in whole-arm motions.
"""
SOON = 25.0
"""s, within which gravity, free to lean, and noise take up accelerations that are not known: no structure is left."""
BLOCK = 512
"""Rows of a product that one thread makes: with 22 columns each OpenBLAS leaves it to one."""
OVERLAP = 1.5
"""Of the variance of a sum of means whose windows overlap: a quarter of its white noise a mean shares with the next."""
LEAST_PART = 30
PARTS = {2: 5.02, 3: 7.38}
"""Into how many parts a recording is cut, and the chi-square that parts which agree exceed once in 40 times."""


@dataclass(frozen=True, eq=False)
class DelayFit:
    """The `delay` s; `down` (3,) in base axes, up to its sign; what the delay would change by for each residual,
    `influence` (n, 6), s per standard deviation; the residuals in standard deviations, `left` (n, 6), each with its
    weight; the orthonormal `basis` (n, k) that was free to explain them; the `weight` (n,) of each mean and the
    `variance` (6,) of the residuals; `bound` s, the standard deviation if the residuals were white noise, and
    `weightless` s, what it would be of a tool without mass, in whose place noise is fitted; and the `misfit`, the sum
    of the logarithms of the variances.
    """

    delay: float
    down: Array
    influence: Array
    left: Array
    basis: Array
    weight: Array
    variance: Array
    bound: float
    weightless: float
    misfit: float


@dataclass(frozen=True, eq=False)
class Scan:
    """`misfit` (k,) at each delay, the `best` delay s and what is left there, `least`; gravity along `down` (3,)."""

    misfit: Array
    best: float
    least: float
    down: Array


def scans(motion: ArmMotion, thin: WrenchStream, delays: Array, stated: Array) -> tuple[Scan, Scan]:
    """The misfit of a tool at each of `delays` (k,), and the best of them, to 10 ms: under gravity as `stated` (3,),
    and where the base's three axes explain the wrench in its place.

    Down is then what the three have in common: the first singular vector of their coefficients. Contacts are told from
    the rest with gravity anywhere, at no delay first, then at the best of some.
    """
    states, weight = [motion.state_at(thin.t - delay) for delay in delays], np.ones(len(thin))
    along = _to_gravity(stated, _columns(states[0], None).shape[1] + 6)

    def reweighted(delay: float, weight: Array) -> Array:
        for _ in range(REWEIGHTED):
            residual, *_ = _explained(motion.state_at(thin.t - delay), thin.wrench, None, weight)
            weight = _weight(residual, _variance(residual, thin, weight if weight.min() < 1.0 else None))
        return weight

    def misfits(states: list[Array]) -> Array:
        """(2, k): under gravity as stated, and anywhere."""
        left = []
        for state in states:
            columns = np.sqrt(weight)[:, None] * np.column_stack([_columns(state, None), thin.wrench])
            moments = _sums(columns, columns)
            left.append((_left(along.T @ moments @ along), _left(moments)))
        return np.asarray(np.log(np.array(left) / weight.sum() + _least_variance(thin)).sum(axis=2).T)

    def scan(misfit: Array, k: int) -> Scan:
        near = delays[misfit.argmin()] + np.arange(-GRID, GRID + 0.5 * FINE, FINE)
        of_near = misfits([motion.state_at(thin.t - delay) for delay in near])[k]
        return Scan(misfit, float(near[of_near.argmin()]), float(of_near.min()), stated)

    weight = reweighted(0.0, weight)
    weight = reweighted(float(delays[misfits(states)[1].argmin()]), weight)
    as_stated, anywhere = (scan(misfit, k) for k, misfit in enumerate(misfits(states)))
    of_axes = _explained(motion.state_at(thin.t - anywhere.best), thin.wrench, None, weight)[1][1:10].reshape(3, 3, 6)
    noise = np.maximum(thin.wrench.std(axis=0), 1e-300)
    return as_stated, replace(anywhere, down=np.linalg.svd((of_axes / noise).reshape(3, 18))[0][:, 0])


def _to_gravity(down: Array, p: int) -> Array:
    """What turns p columns, of which nine are the base's axes, into those with gravity along `down` (3,) for these."""
    one = np.eye(p)
    return np.column_stack([one[:, :1], one[:, 1:10] @ np.kron(down[:, None], np.eye(3)), one[:, 10:]])


def _left(moments: Array) -> Array:
    """The sums of squares (6,) that columns leave of readings, the last six of those with these moments."""
    explained = _independent(moments[:-6, :-6]).T @ moments[:-6, -6:]
    return np.asarray(np.maximum(np.diag(moments)[-6:] - (explained**2).sum(axis=0), 0.0))


def _explained(state: Array, wrench: Array, down: Array | None, weight: Array) -> tuple[Array, Array, Array, Array]:
    """The linear fit of readings (n, 6) by the motion's state at their moments, with these weights (n,): residuals
    (n, 6), coefficients (p, 6), an orthonormal basis (n, k) of the weighted columns, and what turns coefficients on it
    into those of the columns (p, k), the smallest where columns say the same.
    """
    root = np.sqrt(weight)[:, None]
    columns = _columns(state, down)
    weighted = columns * root
    unit = _independent(_sums(weighted, weighted))
    basis = _times(weighted, unit)
    coefficients = unit @ _sums(basis, root * wrench)
    return wrench - _times(columns, coefficients), coefficients, basis, unit


def _columns(state: Array, down: Array | None, one: float = 1.0) -> Array:
    """The columns (n, p) of a state (n, m) of the motion, or of its change (then `one` is 0): 1, gravity (3) or the
    base's axes (9), accelerations (9 or 12).
    """
    axes = state[:, :9]
    gravity = axes if down is None else np.einsum("nji,j->ni", axes.reshape(-1, 3, 3), down)
    return np.column_stack([np.full(len(state), one), gravity, state[:, 9:]])


def _variance(residual: Array, means: WrenchStream, weight: Array | None = None) -> Array:
    """Variances (6,) with these weights (n,); without, by the median, which half of the readings cannot move."""
    if weight is None:
        variance = (1.4826 * np.median(np.abs(residual), axis=0)) ** 2
    else:
        variance = _sums(weight[:, None], residual**2)[0] / weight.sum()
    return np.asarray(variance + _least_variance(means))


def _least_variance(means: WrenchStream) -> Array:
    """Of an axis (6,), as the digits of a file have it."""
    return np.asarray(ROUNDING * means.wrench.var(axis=0) + 1e-24)


def _weight(residual: Array, variance: Array) -> Array:
    """Of each row: 1, and for one far outside the noise the less the further."""
    distance = np.sqrt(np.maximum((residual**2 / variance).sum(axis=1), 1e-300))
    return np.asarray(np.minimum(1.0, CONTACT / distance) ** 2)


def fitted(motion: ArmMotion, means: WrenchStream, delay: float, down: Array) -> DelayFit:
    """The best fit near `delay` and `down` (3,)."""
    start, weight = down, np.ones(len(means.t))
    variance: Array | None = None
    for _ in range(MOST_STEPS):
        step, residual, fit = _step(motion, means, delay, down, start, weight, variance)
        weight = _weight(residual, fit.variance)
        variance = _variance(residual, means, weight)
        if not np.isfinite(fit.bound) or abs(step[0]) < CLOSE:
            break
        delay += float(np.clip(step[0], -FINE, FINE))
        down = down + step[1:]
        down = down / np.linalg.norm(down)
    return fit


def _step(
    motion: ArmMotion,
    means: WrenchStream,
    delay: float,
    down: Array,
    start: Array,
    weight: Array,
    variance: Array | None,
) -> tuple[Array, Array, DelayFit]:
    """How far (4,) the delay and down are from the best for these weights (n,) and variances (6,) (None: robust ones);
    the residuals (n, 6) here, and the fit.
    """
    tau, root = means.t - delay, np.sqrt(weight)[:, None]
    state = motion.state_at(tau)
    residual, coefficients, basis, unit = _explained(state, means.wrench, down, weight)
    if variance is None:
        variance = _variance(residual, means)
    scale, across = root / np.sqrt(variance), np.linalg.svd(down[None])[2][1:]
    change = _columns(-motion.change_at(tau), down, 0.0)
    slopes = [scale * _times(change, coefficients)]
    slopes += [scale * _times(state[:, :9], np.outer(turn, coefficients[1:4]).reshape(9, 6)) for turn in across]
    free = np.array([_beside(slope, basis) for slope in slopes])
    left = scale * residual
    H = np.einsum("ani,bni->ab", free, free)
    gradient = np.einsum("ani,ni->a", free, left)
    H[1:, 1:] += np.eye(2) / TILT_SD**2
    gradient[1:] -= across @ (down - start) / TILT_SD**2
    misfit = float(np.log(variance).sum())
    if H[0, 0] <= SAME * (slopes[0] ** 2).sum():
        blind = DelayFit(delay, down, np.zeros_like(left), left, basis, weight, variance, np.inf, np.inf, misfit)
        return np.zeros(4), residual, blind
    inverse = np.linalg.inv(H)
    step = inverse @ gradient
    influence = np.einsum("a,ani->ni", inverse[0], free)
    bound = float(np.sqrt(OVERLAP * inverse[0, 0]))
    noisy = _times(_beside(root * change, basis), unit)
    weightless = float(np.sqrt(OVERLAP / max(6.0 * (noisy**2).sum(), 1e-300)))
    moved: Array = np.r_[step[0], step[1:] @ across]
    return moved, residual, DelayFit(delay, down, influence, left, basis, weight, variance, bound, weightless, misfit)


def _independent(moments: Array) -> Array:
    """What makes an orthonormal basis (p, k) of columns with these moments (p, p)."""
    size = np.sqrt(np.maximum(np.diag(moments), 0.0))
    size = np.where(size > SAME * size[0], size, np.inf)
    values, vectors = np.linalg.eigh(moments / np.outer(size, size))
    kept = values > SAME * values[-1]
    return np.asarray(vectors[:, kept] / np.sqrt(values[kept]) / size[:, None])


def _times(tall: Array, matrix: Array) -> Array:
    """`tall @ matrix`, in blocks that are too small to be shared among threads, which costs ten times the work."""
    return np.concatenate([tall[k : k + BLOCK] @ matrix for k in range(0, len(tall), BLOCK)])


def _sums(a: Array, b: Array) -> Array:
    """`a.T @ b` of tall arrays, likewise."""
    return np.asarray(np.sum([a[k : k + BLOCK].T @ b[k : k + BLOCK] for k in range(0, len(a), BLOCK)], axis=0))


def _beside(columns: Array, basis: Array) -> Array:
    """What of the columns (n, p) an orthonormal basis (n, k) does not explain."""
    return columns - _times(basis, _sums(basis, columns))


def standard_deviation(motion: ArmMotion, means: WrenchStream, fit: DelayFit) -> float:
    """The standard deviation of the delay, s: that of residuals which are correlated in time, more where parts of the
    recording disagree by more than theirs (Birge, 1932), and no less than the bound.

    The arm turns as far in each part, which has coefficients of its own. Parts disagree where the model is wrong: the
    arm accelerates and its positions were not recorded, or a clock drifts.
    """
    if not np.isfinite(fit.bound):
        return np.inf
    turned = np.cumsum(np.linalg.norm(motion.change_at(means.t - fit.delay)[:, :9], axis=1))
    factor = 1.0
    for count, limit in PARTS.items():
        cut = np.searchsorted(turned, turned[-1] * np.arange(1, count) / count)
        offs, stds = [], []
        for rows in np.split(np.arange(len(means.t)), cut):
            if len(rows) < LEAST_PART:
                continue
            part = means.select(rows)
            step, _, of_part = _step(motion, part, fit.delay, fit.down, fit.down, fit.weight[rows], fit.variance)
            if np.isfinite(of_part.bound):
                offs.append(step[0])
                stds.append(max(spectral_std(of_part.left, of_part.influence, of_part.basis, part.t), of_part.bound))
        if len(offs) < 2:
            continue
        precision = np.array(stds) ** -2.0
        chi2 = float(precision @ (offs - np.average(offs, weights=precision)) ** 2)
        if chi2 > limit:
            factor = max(factor, float(np.sqrt(chi2 / (len(offs) - 1))))
    if not motion.knows_positions and (_structure(fit.left) > STRUCTURED or np.ptp(means.t) < SOON):
        factor *= UNKNOWN_ACCELERATIONS
    return factor * max(spectral_std(fit.left, fit.influence, fit.basis, means.t), fit.bound)


def _structure(left: Array) -> float:
    """The variance of residuals (n, 6) over that of white noise that changes as much from one to the next but one, with
    which its window has nothing in common: the largest of the axes.
    """
    fresh = 0.5 * np.mean((left[2:] - left[:-2]) ** 2, axis=0)
    return float(np.max(np.mean(left**2, axis=0) / np.maximum(fresh, 1e-300)))
