"""Noise, a drift and turns of the robot's orientation together, by restricted likelihood.

Where orientations err, poses and axes do not separate, and moments are not enough: here the covariance V of all
readings (error_covariance.py) is taken as it is. Its variances, of each axis' noise, of a drift in units of
these, of turns in rad, are at their joint optimum (Patterson and Thompson, 1971), by steps of Newton's method in their
logarithms, with the expected curvature where the true one is smaller. The evidence is Laplace's.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..geometry.arrays import Array
from .bias_drift import APART, SHARE_OF_WEIGHT, STRENGTHS, Drift
from .error_covariance import Turned
from .least_squares import Members, Priors
from .noise import ALIKE, LARGEST_STEP, LEAST_DOF, OFF_GROUP, NoiseModel

USUAL = 0.01
"""rad: scale of a half-normal prior of the turns' standard deviation, as robots are good to half a degree."""

SHOWING, BEYOND = 0.5, 1e8
"""Of the noise's variance, that of turns from which on they are counted, as smaller ones pass for noise, and up to
which double precision carries both.
"""

LEAST = 1e-5
"""rad: no robot is so exact."""

MOST_PASSES, GAIN = 40, 0.02
"""Of the logarithm of the evidence, by another pass: if less, no more are made."""


@dataclass(frozen=True, eq=False)
class Linear:
    """Errors (n, 6) of the poses kept with derivatives J (n, 6, p), of which `columns` are not the bias, at a tool of
    that `weight` N; what is known of those.
    """

    J: Array
    errors: Array
    columns: list[int]
    weight: float
    priors: Priors
    noise: NoiseModel


@dataclass(frozen=True)
class Component:
    """Of a variance: the sum of squares `chi2` over it, the `dof` that it has on average, and of its prior's logarithm
    the slope and the curvature, in the logarithm of the variance.
    """

    chi2: float
    dof: float
    prior_slope: float = 0.0
    prior_curvature: float = 0.0

    @property
    def slope(self) -> float:
        """Of minus the logarithm of the evidence: where positive, the variance is too large."""
        return 0.5 * (self.dof - self.chi2) + self.prior_slope

    @property
    def step(self) -> float:
        """Of the logarithm of the variance, to its optimum."""
        curvature = 0.5 * max(self.chi2, 0.5 * self.dof, LEAST_DOF) + self.prior_curvature
        return float(np.clip(-self.slope / curvature, -LARGEST_STEP, LARGEST_STEP))

    @property
    def log_volume(self) -> float:
        """Twice the logarithm of what Laplace's method gives it."""
        return float(np.log(2.0 * np.pi / (0.5 * max(self.dof, LEAST_DOF) + self.prior_curvature)))


@dataclass(frozen=True, eq=False)
class Optimum:
    """The parameters' best under V: `total` (p + 1, p + 1) products of derivatives and errors under V^-1, the
    `weighted` derivatives (n, 6, p), the `covariance` (p, p), `left` (n, 6) V^-1 times what the tool leaves, `chi2` and
    `dof` (6,) of the axes, the two other components, and what of `chi2` and `dof` is `of_drift` (2, 6).
    """

    V: Turned
    total: Array
    weighted: Array
    covariance: Array
    left: Array
    chi2: Array
    dof: Array
    drift: Component
    turns: Component
    of_drift: Array


def look_at(linear: Linear, V: Turned, usual_share: float | None = None) -> Optimum:
    """The parameters under V, and the widest hypothesis; the `usual_share` of the weight that its drift has, None: any
    size is as likely.
    """
    hypothesis = np.flatnonzero(linear.priors.apart == ALIKE)[-1]
    n, _, p = linear.J.shape
    base = V.base
    errors = linear.errors + V.sd**2 * linear.weight * linear.J[:, :, 0]
    both = np.concatenate([linear.J, errors[..., None]], axis=2)
    weighted = V.precision_times(both)
    total = both.reshape(6 * n, -1).T @ weighted.reshape(6 * n, -1)
    information, pull = total[:p, :p].copy(), total[:p, p].copy()
    information[np.ix_(linear.columns, linear.columns)] += linear.priors.information[hypothesis]
    pull[linear.columns] += linear.priors.pull[hypothesis]
    covariance = inverse_of(information)
    step = np.r_[-covariance @ pull, 1.0]
    left, of_J = weighted @ step, weighted[:, :, :p]
    relative = base.relative[base.kept]
    spread = np.einsum("naa->na", V.precision_blocks) - np.sum((of_J @ covariance) * of_J, axis=2)
    along, turned = V.along_drift(of_J), V.along_turns(of_J)
    squares = np.sum(V.along_drift(left[..., None])[..., 0] ** 2, axis=0)
    of_drift = np.array([squares, V.dof_of_drift - np.sum((along @ covariance) * along, axis=(0, 2))])
    dof = V.dof_of_turns - float(np.sum((turned @ covariance) * turned))
    turns = Component(float(np.sum(V.along_turns(left[..., None]) ** 2)), dof, *_half_normal(V.sd / USUAL))
    size = base.strength * base.of_forces / max(abs(linear.weight), 1e-12)
    known = _half_normal(size / usual_share) if usual_share else (0.0, 0.0)
    drift = Component(float(of_drift[0].sum()), float(of_drift[1].sum()), *known)
    chi2, dof = np.array([relative @ left**2, relative @ spread]) * base.variance + of_drift
    return Optimum(V, total, of_J, covariance, left, chi2, dof, drift, turns, of_drift)


def _half_normal(size: float) -> tuple[float, float]:
    """Slope and curvature of minus the logarithm of its density, in the logarithm of the square of a `size`."""
    return 0.5 * (size**2 - 1.0), 0.5 * size**2


def shows(V: Turned) -> bool:
    """Whether turns count beside the noise."""
    return V.sd > LEAST and float(V.shares[:3].mean()) > SHOWING and float(V.shares.max()) < BEYOND


def at_optimum(linear: Linear, V: Turned, drift: Drift | None = None) -> Optimum:
    """The best noise, turns and strength of a `drift`, from those of V on, as long as turns show; a change of the noise
    leaves the drift as large as it is.
    """
    usual_share = None if drift is None else SHARE_OF_WEIGHT.get(drift.kind)
    strengths = STRENGTHS if drift is None else drift.strengths
    for _ in range(MOST_PASSES):
        found, base = look_at(linear, V, usual_share), V.base
        log_variance, (chi2, dof) = np.log(base.variance), np.array([found.chi2, found.dof]) - found.of_drift
        squares, dof = (chi2 * base.variance)[None], np.maximum(dof, 0.0)[None]
        better = linear.noise.improved(log_variance[None], squares, dof, np.array([ALIKE]), first=False)[0]
        better = np.maximum(better, np.log(V.beyond_first_order))
        gain = dof[0] @ (better - log_variance) ** 2 + found.turns.dof * found.turns.step**2
        strength = base.strength
        if strength > 0.0:
            as_large = float(np.exp(0.5 * np.mean(log_variance - better)))
            strength = float(np.clip(strength * as_large * np.exp(0.5 * found.drift.step), *strengths[[0, -1]]))
            gain += found.drift.dof * (2.0 * np.log(strength / (base.strength * as_large))) ** 2
        if 0.25 * gain < GAIN or not shows(V):
            break
        base = replace(base, variance=np.exp(better), strength=strength)
        V = replace(V, base=base, sd=V.sd * np.exp(0.5 * found.turns.step))
    return found


def along_axes(found: Optimum, L: Array) -> Array:
    """Columns L (m, k) weighed along each axis (6, m, k), the parameters free."""
    V = found.V
    W, known = _in_common(V, found.weighted, found.covariance)
    W = W.transpose(1, 0, 2)
    first = V.first_precision @ L if V.drift_first else np.einsum("maa->am", V.first_precision)[:, :, None] * L
    return np.asarray((first - W @ (known @ (W.transpose(0, 2, 1) @ L))) / V.base.variance[:, None, None])


def _in_common(V: Turned, weighted: Array, covariance: Array) -> tuple[Array, Array]:
    """What readings have in common by a drift, turns and parameters, in units of the noise and weighed by what each has
    for itself, (m, 6, r), and its covariance (r, r) given the readings; `weighted` derivatives (m, 6, p) under V^-1.
    """
    c, p = V.columns.shape[2], len(covariance)
    known = np.block([[V.left_in_common, np.zeros((c, p))], [np.zeros((p, c)), covariance]])
    return np.concatenate([V.weighted_columns, weighted * V.noise[:, None]], axis=2), known


def members_of(
    linear: Linear, optimum: Optimum, kernel: int, strengths: Array, log_prior: float, robot: int
) -> Members:
    """The solutions under each hypothesis that has the axes alike; the `strengths` of the drift of a `kernel`, and
    `robot`: which way its errors go on.
    """
    V, p, priors = optimum.V, linear.J.shape[2], linear.priors
    h = np.flatnonzero(priors.apart == ALIKE)
    m, place = len(h), np.ix_(range(len(h)), linear.columns, linear.columns)
    information, pull = np.tile(optimum.total[:p, :p], (m, 1, 1)), np.tile(optimum.total[:p, p], (m, 1))
    information[place] += priors.information[h]
    pull[:, linear.columns] += priors.pull[h]
    covariance = inverse_of(information)
    step = (covariance @ pull[..., None])[..., 0]
    misfit = optimum.total[p, p] - np.einsum("hp,hp->h", step, pull) + priors.misfit[h]
    information[place] += priors.of_volume[h]
    log_det = np.linalg.slogdet(information)[1]
    log_evidence = 0.5 * (_log_volume(linear, optimum, strengths) - V.log_determinant - log_det - misfit)
    return Members(
        np.full(m, kernel, dtype=np.intp),
        h,
        step[:, linear.columns],
        covariance[place],
        np.tile(V.base.variance, (m, 1)),
        np.tile(optimum.dof, (m, 1)),
        log_evidence + log_prior + priors.log_prior[h],
        np.tile(optimum.chi2, (m, 1)),
        np.full(m, V.base.strength),
        np.full(m, robot, dtype=np.intp),
        np.full(m, V.sd),
    )


def _log_volume(linear: Linear, found: Optimum, strengths: Array) -> float:
    """Twice the logarithm of what Laplace's method gives noise, drift and turns, with the prior of the turns; that of a
    drift's strength is even over its logarithm, and where readings say nothing it may be any.
    """
    usual = (found.V.sd / USUAL) ** 2
    volume = found.turns.log_volume + np.log(0.5 / np.pi * usual) - usual
    if found.V.base.strength > 0.0:
        volume += min(found.drift.log_volume - 2.0 * np.log(2.0 * APART), 2.0 * np.log(len(strengths)))
    variance, dof = np.log(found.V.base.variance)[None], np.maximum(found.dof, 0.0)[None]
    return float(volume - linear.noise.log_volume(variance, dof, np.array([ALIKE]))[0])


def log_spread(V: Turned, J: Array, information: Array) -> Array:
    """Covariance (7, 7) of the logarithms of the axes' variances, and of the turns': they share what is left, so that
    each is known less well than alone (`NoiseModel.log_spread`). J (m, 6, p), `information` (p, p) of the parameters.

    V is a sum of seven parts of a variance each: an entry of Fisher's information is half the trace of P V_i P V_k. And
    P is what was inverted first less `W known W^T`, of few columns.
    """
    W, known = _in_common(V, V.precision_times(J), inverse_of(information))
    fisher = 0.5 * (_of_pairs_drift_first(V, W, known) if V.drift_first else _of_pairs_turns_first(V, W, known))
    fisher[:6, :6] += OFF_GROUP / ALIKE**2
    fisher[6, 6] += 0.5 * (V.sd / USUAL) ** 2
    return np.asarray(np.linalg.inv(fisher + LEAST_DOF * np.eye(7)))


def _of_pairs_drift_first(V: Turned, W: Array, known: Array) -> Array:
    """The traces (7, 7), where an axis has the same K, of noise and drift, as the others."""
    K, m = V.first_covariance, len(W)
    of_axes = W.transpose(1, 0, 2)
    shared = known @ (of_axes.transpose(0, 2, 1) @ (K @ of_axes))
    c, of_J = V.columns.shape[2], W[:, :, V.columns.shape[2] :]
    of_turns = W[:, :, :c] @ known[:c, :c]  # V^-1 times the turns: no difference of what is nearly equal
    of_turns = of_turns - of_J @ (known[c:, c:] @ np.tensordot(of_J, V.columns, ((0, 1), (0, 1))))
    traces = np.zeros((7, 7))
    traces[:6, :6] = np.einsum("aij,bji->ab", shared, shared)
    traces[range(6), range(6)] += m - 2.0 * np.trace(shared, axis1=1, axis2=2)
    traces[:6, 6] = traces[6, :6] = np.sum(of_turns * np.tensordot(K, of_turns, 1), axis=(0, 2))
    traces[6, 6] = np.sum(np.tensordot(V.columns, of_turns, ((0, 1), (0, 1))) ** 2)
    return traces


def _of_pairs_turns_first(V: Turned, W: Array, known: Array) -> Array:
    """The same where V is a sum of z z^T, some of one pose each: the sums of (z^T P z')^2 over the z of one part and
    the z' of another.
    """
    (m, q), c = V.drift.shape, V.columns.shape[2]
    root = np.sqrt(V.base.relative[V.base.kept])[:, None, None]
    each = np.concatenate([root * np.eye(6), V.turned], axis=2)  # the z (m, 6, 8) that each pose has for itself
    of_each = each.transpose(0, 2, 1) @ W
    own = each.transpose(0, 2, 1) @ V.first_precision @ each
    products = known @ (of_each.transpose(1, 2, 0) @ of_each.transpose(1, 0, 2))  # (8, r, r)
    of_columns = V.columns.reshape(6 * m, c).T @ W.reshape(6 * m, -1)
    across = V.weighted_columns.transpose(0, 2, 1) @ each - of_columns @ known @ of_each.transpose(0, 2, 1)
    within = of_columns[:, :c] - of_columns @ known @ of_columns.T
    one = np.eye(7)[np.r_[np.arange(6), 6, 6, np.tile(np.arange(6), q)]]
    squares = np.zeros((8 + c, 8 + c))
    squares[:8, :8] = np.sum(own * (own - 2.0 * of_each @ known @ of_each.transpose(0, 2, 1)), axis=0)
    squares[:8, :8] += np.tensordot(products, products.transpose(0, 2, 1), ((1, 2), (1, 2)))
    squares[8:, :8] = np.sum(across**2, axis=0)
    squares[:8, 8:], squares[8:, 8:] = squares[8:, :8].T, within**2
    return np.asarray(one.T @ squares @ one)


def inverse_of(information: Array) -> Array:
    """Of information (..., p, p), its parameters of any size, none of them left free."""
    unit = 1.0 / np.sqrt(np.maximum(np.einsum("...pp->...p", information), 0.0) + 1e-60)
    scale = unit[..., :, None] * unit[..., None, :]
    return np.asarray(np.linalg.inv(information * scale + 1e-12 * np.eye(unit.shape[-1])) * scale)
