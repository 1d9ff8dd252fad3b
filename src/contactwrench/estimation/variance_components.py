"""Noise, a drift and turns of the robot's orientation together, by restricted likelihood.

Where orientations err, poses and axes do not separate, and moments (moments.py) are not enough: here the covariance V
of all readings (error_covariance.py) is taken as it is. Its variances, of each axis' noise, of a drift in units of
these, of turns in rad, are at their joint optimum (Patterson and Thompson, 1971), by steps of Newton's method in their
logarithms, with the expected curvature where the true one is smaller. The evidence is Laplace's.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..geometry.arrays import Array
from .bias_drift import APART, STRENGTHS
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


def look_at(linear: Linear, V: Turned) -> Optimum:
    """The parameters under V, and the widest hypothesis."""
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
    spread = np.einsum("naa->na", V.precision_blocks()) - np.sum((of_J @ covariance) * of_J, axis=2)
    turned, of_parameters = V.pull(weighted) @ step, V.pull(of_J)
    to_turns = V.sd**2 * V.turns.alike_of_kept
    dof = 2.0 * n - float(np.sum(V.turns.inverse_of_kept * V.covariance_of_turns)) / V.sd**2
    dof -= float(np.sum((to_turns @ of_parameters) * (of_parameters @ covariance)))
    usual = (V.sd / USUAL) ** 2
    turns = Component(float(turned @ to_turns @ turned), dof, 0.5 * (usual - 1.0), 0.5 * usual)
    chi2, dof_of_axes = relative @ left**2 * base.variance, relative @ spread * base.variance
    none = Component(0.0, 0.0)
    found = Optimum(V, total, of_J, covariance, left, chi2, dof_of_axes, none, turns, np.zeros((2, 6)))
    if base.strength == 0.0:
        return found
    L = base.columns[base.kept]
    unit = base.strength**2 * base.variance
    of_chi2 = unit * np.sum((L.T @ left) ** 2, axis=0)
    of_dof = unit * np.einsum("aqq->a", along_axes(linear, found, L))
    drift = Component(float(of_chi2.sum()), float(of_dof.sum()))
    of_drift = np.array([of_chi2, of_dof])
    return replace(found, chi2=chi2 + of_chi2, dof=dof_of_axes + of_dof, drift=drift, of_drift=of_drift)


def shows(V: Turned) -> bool:
    """Whether turns count beside the noise."""
    return V.sd > LEAST and float(V.shares[:3].mean()) > SHOWING and float(V.shares.max()) < BEYOND


def at_optimum(linear: Linear, V: Turned, strengths: Array = STRENGTHS) -> Optimum:
    """The best noise, drift and turns, from those of V on, as long as turns show; the drift, which a change of the
    noise leaves as large as it is, within its `strengths`.
    """
    for _ in range(MOST_PASSES):
        found, base = look_at(linear, V), V.base
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


def along_axes(linear: Linear, found: Optimum, L: Array) -> Array:
    """What columns L (n, q) weigh on each axis (6, q, q), the parameters free."""
    n, q = L.shape
    each = np.zeros((n, 6, 6, q))
    each[:, range(6), range(6)] = L[:, None]
    weighted = found.V.precision_times(each.reshape(n, 6, 6 * q)).reshape(n, 6, 6, q)
    own = np.einsum("np,naaq->apq", L, weighted, optimize=True)
    of_L = np.einsum("nq,nap->aqp", L, found.weighted, optimize=True)
    return np.asarray(own - of_L @ found.covariance @ of_L.transpose(0, 2, 1))


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
    """
    m, base = len(J), V.base
    flat = V.precision_times(np.eye(6 * m).reshape(m, 6, 6 * m)).reshape(6 * m, 6 * m)
    of_J = flat @ J.reshape(6 * m, -1)
    P = flat - of_J @ inverse_of(information) @ of_J.T
    root = np.sqrt(np.outer(base.relative[base.kept], base.variance).ravel())
    L = base.strength * base.columns[base.kept]
    of_axes = np.concatenate([np.diag(root), np.kron(L, np.diag(np.sqrt(base.variance)))], axis=1)
    turned = V.root_of_turns.reshape(6 * m, -1)
    both = np.concatenate([of_axes, turned], axis=1)
    one = np.eye(7)[np.r_[np.tile(np.arange(6), m + L.shape[1]), np.full(turned.shape[1], 6)]]
    fisher = 0.5 * one.T @ (both.T @ P @ both) ** 2 @ one
    fisher[:6, :6] += OFF_GROUP / ALIKE**2
    fisher[6, 6] += 0.5 * (V.sd / USUAL) ** 2
    return np.asarray(np.linalg.inv(fisher + LEAST_DOF * np.eye(7)))


def inverse_of(information: Array) -> Array:
    """Of information (..., p, p), its parameters of any size, none of them left free."""
    unit = 1.0 / np.sqrt(np.maximum(np.einsum("...pp->...p", information), 0.0) + 1e-60)
    scale = unit[..., :, None] * unit[..., None, :]
    return np.asarray(np.linalg.inv(information * scale + 1e-12 * np.eye(unit.shape[-1])) * scale)
