"""The fit on moments: normal equations of a rigid tool for a stack of kernels and hypotheses, noise, evidence.

Everything is linearised at one tool. For each kernel K (moments.py) and each axis a, the Gram matrix of the parameters'
derivatives and of what is left of the readings, under Q, is (p + 1, p + 1); weighted with the axes' variances and summed
it gives the normal equations. The variances are those of restricted maximum likelihood (Patterson and Thompson, 1971):
one for the forces and one for the torques, each axis free to differ by a factor whose logarithm has a prior, so that a
handful of poses cannot make one axis exact. The evidence is Laplace's (MacKay, 1992), in the parameters and in the
logarithms of the variances.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..geometry.arrays import Array
from ..model import RigidTool, response_jacobian
from .moments import Moments
from .noise import StatedNoise

AXIS_SCALE = 0.2
"""Of the logarithm of an axis' variance about that of its group: up to that, chance is believed rather than the axis."""

AXIS_PASSES = 8
MOST_PASSES = 40
SETTLED = 1e-3
"""Relative change of a variance; an estimate changes by far less than a hundredth of its std."""

LEAST_DOF = 0.05
RIDGE = 1e-13


@dataclass(frozen=True, eq=False)
class Priors:
    """Of each of h hypotheses: information (h, p, p) and pull (h, p) of what is known beforehand, linearised, its
    misfit (h,), what joins the information in the evidence's determinant only, (h, p, p), and the logarithm (h,) of
    its normalised probability.
    """

    information: Array
    pull: Array
    misfit: Array
    of_volume: Array
    log_prior: Array


@dataclass(frozen=True, eq=False)
class NoiseModel:
    """What is known of the variances: `least` (6,), at least; `stated` up to one scale, or None; `start` (6,)."""

    least: Array
    stated: StatedNoise | None
    start: Array


@dataclass(frozen=True, eq=False)
class Members:
    """Solutions (m) under pairs of a kernel and a hypothesis: `kernel`, `hypothesis` indices; `step` (m, p) from where
    all was linearised, `covariance` (m, p, p); `variance` (m, 6) of a pose's reading and `dof` (m, 6) behind each axis'
    own; `log_evidence` (m,); `misfit` (m, 6) sums of squares over the variance.
    """

    kernel: Array
    hypothesis: Array
    step: Array
    covariance: Array
    variance: Array
    dof: Array
    log_evidence: Array
    misfit: Array

    def select(self, kept: Array) -> Members:
        """Those of an index or a mask."""
        return Members(*(getattr(self, name)[kept] for name in self.__dataclass_fields__))


def gram(tool: RigidTool, names: tuple[str, ...], S: Array) -> Array:
    """Gram matrices (k, 6, p + 1, p + 1) of derivatives and errors, moments S (k, 15, 15) of [vec(R), error]."""
    J = response_jacobian(tool, names)
    W = np.zeros((6, len(J) + 1, 15))
    W[:, :-1, :9] = J.transpose(1, 0, 2)
    W[range(6), -1, range(9, 15)] = 1.0
    wide = W.reshape(-1, 15) @ S  # (k, 6 (p + 1), 15)
    G: Array = wide.reshape(len(S), 6, -1, 15) @ W.transpose(0, 2, 1)
    return G


def solved(
    G: Array, moments: Moments, log_prior: Array, priors: Priors, pairs: tuple[Array, Array], noise: NoiseModel
) -> Members:
    """The solutions under `pairs` of a kernel, whose `log_prior` (k,) counts, and a hypothesis; noise and parameters at
    their joint optimum.
    """
    kernel, hypothesis = pairs
    own, p = G[kernel], G.shape[-1] - 1
    information, pull = priors.information[hypothesis], priors.pull[hypothesis]
    of_axis = own[..., :p, :p]
    variance = np.broadcast_to(noise.start, (len(kernel), 6)).copy()
    for _ in range(MOST_PASSES):
        weighted = np.einsum("ma,maij->mij", 1.0 / variance, own)
        total = weighted[:, :p, :p] + information
        covariance, log_det = _inverse(total)
        step = np.einsum("mij,mj->mi", covariance, weighted[:, :p, p] + pull)
        z = np.concatenate([-step, np.ones((len(step), 1))], axis=1)
        squares = np.maximum(np.einsum("mi,maij,mj->ma", z, own, z, optimize=True), 0.0)
        taken = np.einsum("mij,maij->ma", covariance, of_axis) / variance
        dof = np.maximum(moments.n - 1.0 - taken, 0.0)
        before, (variance, spread) = variance, variances(squares, dof, noise)
        if float(np.max(np.abs(variance - before) / variance, initial=0.0)) <= SETTLED:
            break
    misfit = squares / variance
    of_volume = priors.of_volume[hypothesis]
    log_det = _inverse(total + of_volume)[1] if of_volume.any() else log_det
    off = np.einsum("mi,mij,mj->m", step, information, step) - 2.0 * np.einsum("mi,mi->m", step, pull)
    evidence = -0.5 * (
        (moments.n - 1.0) * np.log(variance).sum(axis=1)
        + 6.0 * moments.log_determinant[kernel]
        + misfit.sum(axis=1)
        + priors.misfit[hypothesis]
        + off
        + log_det
        + spread
    )
    evidence = evidence + log_prior[kernel] + priors.log_prior[hypothesis]
    return Members(kernel, hypothesis, step, covariance, variance, dof, evidence, misfit)


def _inverse(information: Array) -> tuple[Array, Array]:
    """Inverses (m, p, p) of symmetric positive matrices whose units differ widely, and log determinants (m,)."""
    unit = np.sqrt(np.maximum(np.einsum("mpp->mp", information), 1e-60))
    scaled = information / (unit[:, :, None] * unit[:, None, :])
    scaled += RIDGE * np.eye(unit.shape[1])
    inverse = np.linalg.inv(scaled) / (unit[:, :, None] * unit[:, None, :])
    return inverse, np.linalg.slogdet(scaled)[1] + 2.0 * np.log(unit).sum(axis=1)


def axis_precision(log_variance: Array, dof: Array) -> Array:
    """Precision (6, 6) of the logarithms (6,) of the axes' variances about their optimum, from the `dof` of each."""
    pull = _pull(log_variance.reshape(1, 2, 3))[0]
    precision = np.diag(0.5 * np.maximum(dof, LEAST_DOF))
    for group, strength in zip((slice(0, 3), slice(3, 6)), pull, strict=True):
        precision[group, group] += strength * (np.eye(3) - 1.0 / 3.0)
    return precision


def variances(squares: Array, dof: Array, noise: NoiseModel) -> tuple[Array, Array]:
    """The axes' variances (m, 6) at their optimum, given the sums of squares and their dof, and -2 log of the volume
    that Laplace's method gives them, less that of their prior (m,).

    The axes of a group differ as much as they must: their prior is a Student's t of one degree of freedom, narrow, so
    that a few poses share one variance, and with tails that let a plain difference be.
    """
    if noise.stated is not None:
        given = noise.stated.std**2
        total = np.maximum(dof.sum(axis=1) + noise.stated.dof, LEAST_DOF)
        scale = ((squares / given).sum(axis=1) + noise.stated.dof) / total
        variance = np.maximum(scale[:, None] * given, noise.least)
        return variance, np.log(total)
    grouped, left = squares.reshape(-1, 2, 3), np.maximum(dof, LEAST_DOF).reshape(-1, 2, 3)
    least = noise.least.reshape(2, 3)
    level = np.log(np.maximum(grouped.sum(axis=2) / left.sum(axis=2), least.mean(axis=1)))
    log_variance = np.repeat(level[:, :, None], 3, axis=2)
    for _ in range(AXIS_PASSES):
        pull = _pull(log_variance)
        off = log_variance - log_variance.mean(axis=2, keepdims=True)
        chi2 = grouped * np.exp(-log_variance)
        slope = 0.5 * (left - chi2) + pull[:, :, None] * off
        stiff = 0.5 * np.maximum(left, chi2) + pull[:, :, None]
        step = slope / stiff  # of diag(stiff) less a third of the pull everywhere (Sherman and Morrison, 1950)
        third = pull / 3.0
        step += (third * step.sum(axis=2) / (1.0 - third * (1.0 / stiff).sum(axis=2)))[:, :, None] / stiff
        log_variance = log_variance - np.clip(step, -2.0, 2.0)
    log_variance = np.maximum(log_variance, np.log(least))
    off = log_variance - log_variance.mean(axis=2, keepdims=True)
    pull = _pull(log_variance)
    stiff = 0.5 * left + pull[:, :, None]
    volume = np.log(stiff).sum(axis=2) + np.log1p(-pull / 3.0 * (1.0 / stiff).sum(axis=2))
    tail = 3.0 * np.log1p(np.sum(off**2, axis=2) / AXIS_SCALE**2)
    return np.exp(log_variance).reshape(-1, 6), (volume + tail).sum(axis=1)


def _pull(log_variance: Array) -> Array:
    """Of each group (m, 2): the precision with which its axes (m, 2, 3) are drawn to their mean, by that prior."""
    off = log_variance - log_variance.mean(axis=2, keepdims=True)
    pull: Array = 3.0 / (AXIS_SCALE**2 + np.sum(off**2, axis=2))
    return pull
