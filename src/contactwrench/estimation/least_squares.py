"""The fit on moments: normal equations of a rigid tool for a stack of kernels and hypotheses, noise, evidence.

Everything is linearised at one tool. For each kernel K (moments.py) and each axis a, the Gram matrix of the parameters'
derivatives and of what is left of the readings, under Q, is (p + 1, p + 1); weighted with the variances of the axes and
summed it gives the normal equations. The variances are those of restricted maximum likelihood (noise.py; Patterson and
Thompson, 1971). The evidence is Laplace's (MacKay, 1992), in the parameters and in the logarithms of the variances.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..geometry.arrays import Array
from ..model import RigidTool, response_jacobian
from .moments import Moments
from .noise import NoiseModel

MOST_PASSES = 12
SETTLED = 5e-3
"""Relative change of a variance; an estimate changes by far less than a hundredth of its std."""

RIDGE = 1e-13

Pairs: TypeAlias = tuple[NDArray[np.intp], NDArray[np.intp]]


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
class Members:
    """Solutions (m) under pairs of a kernel and a hypothesis: `kernel`, `hypothesis` indices; `step` (m, p) from where
    all was linearised, `covariance` (m, p, p); `variance` (m, 6) of a pose's reading and `dof` (m, 6) behind each axis'
    own; `log_evidence` (m,); `misfit` (m, 6) sums of squares over the variance.
    """

    kernel: NDArray[np.intp]
    hypothesis: NDArray[np.intp]
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
    G: Array,
    moments: Moments,
    log_prior: Array,
    priors: Priors,
    pairs: Pairs,
    noise: NoiseModel,
    passes: int = MOST_PASSES,
) -> Members:
    """The solutions under `pairs` of a kernel, whose `log_prior` (k,) counts, and a hypothesis; noise and parameters at
    their joint optimum, or after so many `passes` close to it.
    """
    kernel, hypothesis = pairs
    own, p = G[kernel], G.shape[-1] - 1
    information, pull = priors.information[hypothesis], priors.pull[hypothesis]
    flat = own.reshape(len(own), 6, -1)
    of_axis = own[..., :p, :p].reshape(len(own), 6, -1)
    log_variance = noise.first(own[:, :, -1, -1] / max(moments.n - 1.0, 1.0))
    for k in range(passes):
        variance = np.exp(log_variance)
        weighted = ((1.0 / variance)[:, None, :] @ flat).reshape(-1, p + 1, p + 1)
        covariance, log_det = _inverse(weighted[:, :p, :p] + information)
        step = (covariance @ (weighted[:, :p, p] + pull)[..., None])[..., 0]
        z = np.concatenate([-step, np.ones((len(step), 1))], axis=1)
        squares = (flat @ (z[:, :, None] * z[:, None, :]).reshape(len(z), -1, 1))[..., 0]
        squares = np.maximum(squares, 1e-12 * own[:, :, -1, -1])
        dof = moments.n - 1.0 - (of_axis @ covariance.reshape(len(z), -1, 1))[..., 0] / variance
        dof = np.maximum(dof, 0.0)
        before, log_variance = log_variance, noise.improved(log_variance, squares, dof, first=k == 0)
        if float(np.max(np.abs(log_variance - before), initial=0.0)) <= SETTLED:
            break
    misfit = squares / np.exp(log_variance)
    of_volume = priors.of_volume[hypothesis]
    log_det = _inverse(weighted[:, :p, :p] + information + of_volume)[1] if of_volume.any() else log_det
    off = np.einsum("mi,mij,mj->m", step, information, step) - 2.0 * np.einsum("mi,mi->m", step, pull)
    evidence = -0.5 * (
        (moments.n - 1.0) * log_variance.sum(axis=1)
        + 6.0 * moments.log_determinant[kernel]
        + misfit.sum(axis=1)
        + priors.misfit[hypothesis]
        + off
        + log_det
        + noise.log_volume(log_variance, dof)
    )
    evidence = evidence + log_prior[kernel] + priors.log_prior[hypothesis]
    return Members(kernel, hypothesis, step, covariance, np.exp(log_variance), dof, evidence, misfit)


def _inverse(information: Array) -> tuple[Array, Array]:
    """Inverses (m, p, p) of symmetric positive matrices whose units differ widely, and log determinants (m,)."""
    unit = np.sqrt(np.maximum(np.einsum("mpp->mp", information), 1e-60))
    scaled = information / (unit[:, :, None] * unit[:, None, :])
    scaled += RIDGE * np.eye(unit.shape[1])
    inverse = np.linalg.inv(scaled) / (unit[:, :, None] * unit[:, None, :])
    return inverse, np.linalg.slogdet(scaled)[1] + 2.0 * np.log(unit).sum(axis=1)
