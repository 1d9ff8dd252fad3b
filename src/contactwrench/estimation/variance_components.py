"""Noise, a drift and turns of the robot's orientation together, by restricted likelihood.

Where orientations err, poses and axes do not separate, and moments are not enough: here the covariance V of all
readings (error_covariance.py) is taken as it is. Its variances, of each axis' noise, of a drift in units of these, of
turns in rad, are each at its optimum beside the others (Patterson and Thompson, 1971), by Newton's steps in logarithms
with the average information; not quite the joint one, which took good poses for contact. The evidence is Laplace's.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..geometry.arrays import Array
from .bias_drift import APART, SHARE_OF_WEIGHT, STRENGTHS, Drift
from .error_covariance import Turned, of_larger
from .least_squares import Members, Priors
from .noise import ALIKE, LARGEST_STEP, LEAST_DOF, OF_GROUP, OFF_GROUP, NoiseModel

USUAL = 0.01
"""rad: scale of a half-normal prior of the turns' standard deviation, as robots are good to half a degree."""

SHOWING, BEYOND = 0.5, 1e8
"""Of the noise's variance, that of turns from which on they are counted in forces or in torques, as smaller ones pass
for noise, and up to which double precision carries both.
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

    @cached_property
    def told(self) -> Array:
        """The `columns` (q, p) of all parameters, as rows of the identity."""
        return np.eye(self.J.shape[2])[self.columns]


@dataclass(frozen=True, eq=False)
class Optimum:
    """The parameters' best under V: `total` (p + 1, p + 1) products of derivatives and errors under V^-1, the
    `weighted` derivatives (n, 6, p) and what the tool leaves, weighted, `left` (n, 6), both in units of the noise, and
    the `covariance` (p, p).

    Of the variances of the noise of six axes, of the drift and of the turns (8): what each `makes` of the readings as
    they are `left`, (n, 6, 8); their sums of squares `chi2` over the variance, and the `dof` that these have on
    average, those `of_drift` on each axis (6,); of minus the logarithm of their prior the `prior_slope` (8,) and the
    `prior_curvature` (8, 8), in the logarithms of the variances.
    """

    V: Turned
    total: Array
    weighted: Array
    covariance: Array
    left: Array
    makes: Array
    dof: Array
    of_drift: Array
    prior_slope: Array
    prior_curvature: Array

    @cached_property
    def chi2(self) -> Array:
        """(8,)."""
        return np.asarray(self.left.ravel() @ self.makes.reshape(-1, 8))

    @property
    def of_axes(self) -> tuple[Array, Array]:
        """The `chi2` and the `dof` (6,) of noise and drift of each axis."""
        drift = (self.left * self.makes[:, :, 6]).sum(axis=0)
        return self.chi2[:6] + drift, np.maximum(self.dof[:6] + self.of_drift, 0.0)

    @property
    def slope(self) -> Array:
        """Of minus the logarithm of the evidence (8,): where positive, a variance is too large."""
        return np.asarray(0.5 * (self.dof - self.chi2) + self.prior_slope)

    def log_volume(self, component: int) -> float:
        """Twice the logarithm of what Laplace's method gives the variance of the drift or of the turns."""
        curvature = 0.5 * max(float(self.dof[component]), LEAST_DOF) + self.prior_curvature[component, component]
        return float(np.log(2.0 * np.pi / curvature))

    @property
    def curvature(self) -> Array:
        """How the slope changes (8, 8) with the logarithms of the variances, those of the axes with a drift as strong:
        the average of the true and the expected change, which needs no traces (Gilmour, Thompson and Cullis, 1995), no
        less than a quarter of the `dof`: from far above it would leap.
        """
        p, with_drift = len(self.covariance), self.makes.copy()
        with_drift[:, range(6), range(6)] += self.makes[:, :, 6]
        flat, changed = self.makes.reshape(-1, 8), self.V.whitened(with_drift).reshape(-1, 8)
        of_J = self.weighted.reshape(-1, p)
        average = 0.5 * (flat.T @ changed - (of_J.T @ flat).T @ self.covariance @ (of_J.T @ with_drift.reshape(-1, 8)))
        diagonal = average.ravel()[::9]
        np.maximum(diagonal, np.maximum(0.25 * self.dof, LEAST_DOF), out=diagonal)
        return np.asarray(average + self.prior_curvature)


def look_at(linear: Linear, V: Turned, usual_share: float | None = None) -> Optimum:
    """The parameters under V, and the widest hypothesis; the `usual_share` of the weight that its drift has, None: any
    size is as likely.
    """
    m, _, p = linear.J.shape
    both = np.concatenate([linear.J, linear.errors[..., None]], axis=2) / V.noise[:, None]
    both[:, :, p] += V.sd**2 * linear.weight * both[:, :, 0]
    weighted = V.whitened(both)
    total = both.reshape(6 * m, -1).T @ weighted.reshape(6 * m, -1)
    told, priors, h = linear.told, linear.priors, np.flatnonzero(linear.priors.apart == ALIKE)[-1]
    covariance = inverse_of(total[:p, :p] + told.T @ priors.information[h] @ told)
    left, of_J = weighted @ np.append(-covariance @ (total[:p, p] + priors.pull[h] @ told), 1.0), weighted[:, :, :p]
    dof = np.zeros(8)
    along = (V.base.drift.T @ of_J.reshape(m, -1)).reshape(-1, 6, p)
    of_drift = V.dof_of_drift - ((along @ covariance) * along).sum(axis=(0, 2))
    dof[:6] = V.base.relative_of_kept @ (V.precision_diagonal - ((of_J @ covariance) * of_J).sum(axis=2))
    dof[6] = of_drift.sum()
    dof[7] = 6.0 * m - (covariance * total[:p, :p]).sum() - dof[:7].sum()
    prior = _prior(linear, V, usual_share)
    return Optimum(V, total, of_J, covariance, left, V.parts_times(left), np.maximum(dof, 0.0), of_drift, *prior)


def _prior(linear: Linear, V: Turned, usual_share: float | None) -> tuple[Array, Array]:
    """Slope (8,) and curvature (8, 8) of minus the logarithm of the variances' prior: axes are alike, and turns and the
    size of a drift are half-normal.
    """
    base, slope, curvature = V.base, np.zeros(8), np.zeros((8, 8))
    curvature[:6, :6] = OFF_GROUP / ALIKE**2
    slope[:6] = curvature[:6, :6] @ np.log(base.variance)
    usual = (V.sd / USUAL) ** 2
    slope[7], curvature[7, 7] = 0.5 * (usual - 1.0), 0.5 * usual
    if usual_share and base.strength > 0.0:
        usual = (base.strength * base.of_forces / (usual_share * max(abs(linear.weight), 1e-12))) ** 2
        slope[6], curvature[6, 6] = 0.5 * (usual - 1.0), 0.5 * usual
    return slope, curvature


def shows(V: Turned) -> bool:
    """Whether turns count beside the noise."""
    return V.sd > LEAST and of_larger(V.shares) > SHOWING and float(V.shares.max()) < BEYOND


def at_optimum(linear: Linear, V: Turned, drift: Drift | None = None) -> Optimum:
    """The best noise, turns and strength of a `drift`, from those of V on, as long as turns show."""
    usual_share = None if drift is None else SHARE_OF_WEIGHT.get(drift.kind)
    weakest, strongest = (STRENGTHS if drift is None else drift.strengths)[[0, -1]]
    for _ in range(MOST_PASSES):
        found, base = look_at(linear, V, usual_share), V.base
        least = np.log(np.maximum(linear.noise.least, V.beyond_first_order))
        slope, curvature, log_variance = found.slope, found.curvature, np.log(base.variance)
        nothing_left = found.dof[:6] @ OF_GROUP <= 3.0 * LEAST_DOF  # of readings: their noise would vanish
        held = np.append(((log_variance <= least) | nothing_left) & (slope[:6] > 0.0), [False, False])
        held[6] = base.strength <= weakest if slope[6] > 0.0 else base.strength >= strongest
        held[6] |= base.strength == 0.0
        curvature[held], curvature[:, held], slope[held] = 0.0, 0.0, 0.0
        curvature[held, held] = 1.0
        step = -np.linalg.solve(curvature, slope)
        if -0.5 * slope @ step < GAIN or not shows(V):
            break
        step *= min(1.0, LARGEST_STEP / float(np.abs(step).max()))
        better = np.maximum(log_variance + step[:6], least)
        by = np.exp(0.5 * step[6:])
        strength = float(np.clip(base.strength * by[0], weakest, strongest)) if base.strength else 0.0
        V = replace(V, base=replace(base, variance=np.exp(better), strength=strength), sd=V.sd * float(by[1]))
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
    for itself, (m, 6, r), and its covariance (r, r) given the readings; `weighted` derivatives (m, 6, p), likewise.
    """
    c, p = V.columns.shape[2], len(covariance)
    known = np.block([[V.left_in_common, np.zeros((c, p))], [np.zeros((p, c)), covariance]])
    return np.concatenate([V.weighted_columns, weighted], axis=2), known


def members_of(
    linear: Linear, optimum: Optimum, kernel: int, strengths: Array, log_prior: float, robot: int
) -> Members:
    """The solutions under each hypothesis that has the axes alike; the `strengths` of the drift of a `kernel`, and
    `robot`: which way its errors go on.
    """
    V, p, priors, (chi2, dof) = optimum.V, linear.J.shape[2], linear.priors, optimum.of_axes
    h = np.flatnonzero(priors.apart == ALIKE)
    m, told = len(h), linear.told
    information = optimum.total[:p, :p] + told.T @ priors.information[h] @ told
    pull = optimum.total[:p, p] + priors.pull[h] @ told
    covariance = inverse_of(information)
    step = (covariance @ pull[..., None])[..., 0]
    misfit = optimum.total[p, p] - np.einsum("hp,hp->h", step, pull) + priors.precision[h] @ priors.known.residuals**2
    log_det = np.linalg.slogdet(information + told.T @ priors.of_volume[h] @ told)[1]
    log_evidence = 0.5 * (_log_volume(linear, optimum, strengths) - V.log_determinant - log_det - misfit)
    return Members(
        np.full(m, kernel, dtype=np.intp),
        h,
        step @ told.T,
        told @ covariance @ told.T,
        np.tile(V.base.variance, (m, 1)),
        np.tile(dof, (m, 1)),
        log_evidence + log_prior + priors.log_prior[h],
        np.tile(chi2, (m, 1)),
        np.full(m, V.base.strength),
        np.full(m, robot, dtype=np.intp),
        np.full(m, V.sd),
    )


def _log_volume(linear: Linear, found: Optimum, strengths: Array) -> float:
    """Twice the logarithm of what Laplace's method gives noise, drift and turns, with the prior of the turns; that of a
    drift's strength is even over its logarithm, and where readings say nothing it may be any.
    """
    usual = (found.V.sd / USUAL) ** 2
    volume = found.log_volume(7) + np.log(0.5 / np.pi * usual) - usual
    if found.V.base.strength > 0.0:
        volume += min(found.log_volume(6) - 2.0 * np.log(2.0 * APART), 2.0 * np.log(len(strengths)))
    variance, dof = np.log(found.V.base.variance)[None], found.of_axes[1][None]
    return float(volume - linear.noise.log_volume(variance, dof, np.array([ALIKE]))[0])


def log_spread(V: Turned, J: Array, information: Array) -> Array:
    """Covariance (7, 7) of the logarithms of the axes' variances, and of the turns': they share what is left, so that
    each is known less well than alone (`NoiseModel.log_spread`). J (m, 6, p), `information` (p, p) of the parameters.

    V is a sum of seven parts of a variance each: an entry of Fisher's information is half the trace of P V_i P V_k. And
    P is what was inverted first less `W known W^T`, of few columns.
    """
    W, known = _in_common(V, V.whitened(J / V.noise[:, None]), inverse_of(information))
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
    (m, q), c = V.base.drift.shape, V.columns.shape[2]
    root = np.sqrt(V.base.relative_of_kept)[:, None, None]
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
