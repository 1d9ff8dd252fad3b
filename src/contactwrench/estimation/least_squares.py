"""The fit on moments: normal equations of a rigid tool for a stack of kernels and hypotheses, noise, evidence.

All that a fit needs of the poses are second moments S (15, 15) of [vec(R_i), y_i], the constant bias taken out (method,
"One inference"). For K = D + s^2 L L^T, with D the diagonal of the poses' own variances, S is that of a steady bias
less a few outer products, for every strength s: so all strengths and shapes cost little more than one.

Everything is linearised at one tool. For each kernel and each axis, the Gram matrix of the parameters' derivatives and
of what is left of the readings is (p + 1, p + 1); weighted with the variances of the axes and summed it gives the
normal equations. The variances are those of restricted maximum likelihood (noise.py; Patterson and Thompson, 1971). The
evidence is Laplace's (MacKay, 1992), in the parameters and in the logarithms of the variances.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..geometry.arrays import Array
from ..model import RigidTool, response_jacobian
from .bias_drift import Kernels
from .noise import LEAST_DOF, NoiseModel
from .priors import PriorRows

MOST_PASSES = 12
SETTLED = 1e-2
"""Relative change of a variance; an estimate changes by far less than a hundredth of its std."""

STILL_MOVING = 0.25
"""Of a stack: when no more are, these go on alone, as a pass costs what its stack is large (a fifth of `auto`)."""

RIDGE, MOST_TAKEN = 1e-12, 1.0 - 1e-9

Pairs: TypeAlias = tuple[NDArray[np.intp], NDArray[np.intp]]


@dataclass(frozen=True, eq=False)
class Moments:
    """Gram matrices (k, 6, p + 1, p + 1) of derivatives and errors on each axis for a stack of kernels, the
    `log_determinant` (k,) of K where a constant was taken out, `n` poses.
    """

    gram: Array
    log_determinant: Array
    n: int


def columns_of_axes(tool: RigidTool, names: tuple[str, ...]) -> Array:
    """W (6, p + 1, 15): derivatives and error of each axis are `W @ [vec(R), error]`."""
    J = response_jacobian(tool, names)
    W = np.zeros((6, len(J) + 1, 15))
    W[:, :-1, :9] = J.transpose(1, 0, 2)
    W[range(6), -1, range(9, 15)] = 1.0
    return W


def moments_of(X: Array, variance: Array, kernels: Kernels, W: Array, kept: NDArray[np.bool_]) -> Moments:
    """W S W^T of rows X (m, 15) of the poses kept, of relative variances (m,), under each kernel; W (a, c, 15)."""
    rows = centred(X, variance)
    G = np.tile(W @ (rows.T @ rows) @ W.transpose(0, 2, 1), (len(kernels.drift), 1, 1, 1))
    determinant = np.full(len(G), float(np.sum(np.log(variance)) + np.log(np.sum(1.0 / variance))))
    for here, of_kernel, columns in kernels.by_columns(kept):
        L = centred(columns, variance)
        length, vectors = np.linalg.eigh(L.transpose(0, 2, 1) @ L)
        Z = W @ (rows.T @ L @ vectors)[:, None]
        squared = kernels.strength[here, None] ** 2
        grown = squared * length[of_kernel]
        G[here] -= (Z[of_kernel] * (squared / (1.0 + grown))[:, None, None]) @ Z.transpose(0, 1, 3, 2)[of_kernel]
        determinant[here] += np.log1p(grown).sum(axis=1)
    return Moments(G, determinant, len(X))


def centred(rows: Array, variance: Array) -> Array:
    """Rows (..., n, c) over the roots of their variances (n,), a constant taken out."""
    mean = (1.0 / variance)[None] @ rows / np.sum(1.0 / variance)
    return np.asarray((rows - mean) / np.sqrt(variance)[:, None])


def log_odds(X: Array, variance: Array, kernels: Kernels, W: Array, kept: NDArray[np.bool_], steady: Members) -> Array:
    """Of each kernel (k,) with one column against the `steady` member, without priors of the axes, the noise of each as
    it is left beside the column; inf of the others. Rows X (m, 15) of the poses kept, W (6, p + 1, 15), as of moments.
    """
    odds, noise, dof = np.full(len(kernels.drift), np.inf), steady.variance[0], steady.dof[0]
    for single, of_kernel, columns in kernels.by_columns(kept):
        if columns.shape[2] > 1:
            continue
        h = centred(columns, variance)[:, :, 0]
        along = (W @ (centred(X, variance).T @ h.T)).transpose(2, 0, 1)
        pull, along = along @ np.append(-steady.step[0], 1.0), along[:, :, :-1]
        length = np.sum(h**2, axis=1)[:, None] - np.sum((along @ steady.covariance[0]) * along, axis=2) / noise
        squared = kernels.strength[single, None] ** 2
        grown = squared * np.maximum(length, 0.0)[of_kernel]
        taken = squared * (pull**2 / noise)[of_kernel] / (1.0 + grown) / np.maximum(dof, LEAST_DOF)
        gain = -dof * np.log1p(-np.minimum(taken, MOST_TAKEN)) - np.log1p(grown)
        odds[single] = kernels.log_prior[single] + 0.5 * gain.sum(axis=1)
    return odds


@dataclass(frozen=True, eq=False)
class Priors:
    """What is `known` (q rows) beforehand, linearised, and the `precision` (h, q) of these under each of h hypotheses;
    what joins the information in the evidence's determinant only, (h, p, p), the logarithm (h,) of the normalised
    probability of each, and how far `apart` (h,) the noises of axes are (noise.py).
    """

    known: PriorRows
    precision: Array
    of_volume: Array
    log_prior: Array
    apart: Array

    @cached_property
    def information(self) -> Array:
        """Of the parameters, (h, p, p)."""
        J = self.known.jacobian
        return np.asarray((J.T * self.precision[:, None, :]) @ J)

    @cached_property
    def pull(self) -> Array:
        """Towards what is known, (h, p)."""
        return np.asarray((self.precision * self.known.residuals) @ self.known.jacobian)


@dataclass(frozen=True, eq=False)
class Members:
    """Solutions (m) under pairs of a kernel and a hypothesis: `kernel`, `hypothesis` indices; `step` (m, p) from where
    all was linearised, `covariance` (m, p, p); `variance` (m, 6) of a pose's reading and `dof` (m, 6) behind each axis'
    own; `log_evidence` (m,); `misfit` (m, 6) sums of squares over the variance; `strength` (m,) of the kernel; how the
    `robot`'s errors go on (m,), -1 where it has none, by a `turn` (m,) rad, standard deviation.
    """

    kernel: NDArray[np.intp]
    hypothesis: NDArray[np.intp]
    step: Array
    covariance: Array
    variance: Array
    dof: Array
    log_evidence: Array
    misfit: Array
    strength: Array
    robot: NDArray[np.intp]
    turn: Array

    def select(self, kept: NDArray[np.bool_] | NDArray[np.intp]) -> Members:
        """Those of an index or a mask."""
        return Members(*(getattr(self, name)[kept] for name in self.__dataclass_fields__))

    def joined(self, others: Members) -> Members:
        """These and others."""
        names = self.__dataclass_fields__
        return Members(*(np.concatenate([getattr(self, name), getattr(others, name)]) for name in names))


def solved(
    moments: Moments,
    kernels: Kernels,
    priors: Priors,
    pairs: Pairs,
    noise: NoiseModel,
    passes: int = MOST_PASSES,
    begin: Array | None = None,
) -> Members:
    """The solutions under `pairs` of one of the `kernels` and a hypothesis; noise and parameters at
    their joint optimum, or after so many `passes` close to it; `begin`: the logarithms of the variances (m, 6) that the
    first pass has, None: those of `noise`.
    """
    kernel, hypothesis = pairs
    own, m, p = moments.gram[kernel], len(kernel), moments.gram.shape[-1] - 1
    at_tool = own[:, :, p, p]
    information, pull = priors.information[hypothesis], priors.pull[hypothesis]
    apart = priors.apart[hypothesis]
    log_variance = noise.first(at_tool / max(moments.n - 1.0, 1.0)) if begin is None else begin
    unit = np.ones((m, p + 1))  # of the parameters, which differ widely, each its std
    flat = own.reshape(m, 6, -1)
    of_readings = (np.exp(-log_variance)[:, None] @ flat[:, :, : -1 : p + 2])[:, 0]  # on the diagonals
    unit[:, :p] = of_readings + np.einsum("mpp->mp", information)
    unit = 1.0 / np.sqrt(np.maximum(unit, 1e-60))
    own *= (unit[:, :, None] * unit[:, None, :])[:, None]
    scale = unit[:, :p, None] * unit[:, None, :p]
    scaled_information, scaled_pull = information * scale, pull * unit[:, :p]
    after, of_products = np.ones((m, p + 1)), np.zeros((m, 2, p + 1, p + 1))
    for k in range(passes):
        precision = np.exp(-log_variance)
        weighted = (precision[:, None, :] @ flat).reshape(m, p + 1, p + 1)
        normal = _regular(weighted[:, :p, :p] + scaled_information)
        covariance = np.linalg.inv(normal)
        np.negative((covariance @ (weighted[:, :p, p] + scaled_pull)[..., None])[..., 0], out=after[:, :p])
        np.multiply(after[:, :, None], after[:, None, :], out=of_products[:, 0])
        of_products[:, 1, :p, :p] = covariance
        sums = flat @ of_products.reshape(m, 2, -1).transpose(0, 2, 1)
        squares = np.maximum(sums[:, :, 0], 1e-12 * at_tool)
        dof = np.maximum(moments.n - 1.0 - sums[:, :, 1] * precision, 0.0)
        before = log_variance
        log_variance = noise.improved(before, squares, dof, apart, first=begin is None and k == 0)
        moving = np.flatnonzero(np.abs(log_variance - before).max(axis=1) > SETTLED)
        if len(moving) <= STILL_MOVING * m:
            break
    of_volume = priors.of_volume[hypothesis]
    if of_volume.any():
        normal = _regular(normal + of_volume * scale)
    log_det = np.linalg.slogdet(normal)[1] - 2.0 * np.log(unit).sum(axis=1)
    step, misfit = -after[:, :p] * unit[:, :p], squares * np.exp(-log_variance)
    off = np.einsum("mi,mij,mj->m", step, information, step) - 2.0 * np.einsum("mi,mi->m", step, pull)
    evidence = -0.5 * (
        (moments.n - 1.0) * log_variance.sum(axis=1)
        + 6.0 * moments.log_determinant[kernel]
        + misfit.sum(axis=1)
        + priors.precision[hypothesis] @ priors.known.residuals**2
        + off
        + log_det
        + noise.log_volume(log_variance, dof, apart)
    )
    evidence = evidence + kernels.log_prior[kernel] + priors.log_prior[hypothesis]
    strength, variance = kernels.strength[kernel], np.exp(log_variance)
    none, turn = np.full(m, -1, dtype=np.intp), np.zeros(m)
    found = Members(kernel, hypothesis, step, covariance * scale, variance, dof, evidence, misfit, strength, none, turn)
    left = passes - k - 1
    if len(moving) and left:
        pairs, place = (kernel[moving], hypothesis[moving]), np.arange(m)
        place[moving] = m + np.arange(len(moving))
        return found.joined(solved(moments, kernels, priors, pairs, noise, left, log_variance[moving])).select(place)
    return found


def _regular(information: Array) -> Array:
    """The same (m, p, p), its diagonal raised so little that nothing but a singular one shows it."""
    diagonal = np.einsum("mpp->mp", information)
    diagonal += RIDGE * diagonal + 1e-60
    return information
