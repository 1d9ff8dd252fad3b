"""Second moments of poses, all that a fit needs of them, under every way in which the bias may have moved.

With X = [vec(R_i), y_i] (n, 15) and K the covariance of the errors across poses, in units of the noise,

    Q = K^-1 - K^-1 1 1^T K^-1 / (1^T K^-1 1)        S = X^T Q X  (15, 15)

Q takes out the constant bias; the residual sums of any rigid or affine tool, their derivatives and the Gauss-Newton
matrix are products of S with small matrices. For K = D + s^2 L L^T, with D the diagonal of the poses' own variances, S
is that of a steady bias less a few outer products, for every strength s: so all strengths and shapes cost little more
than one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..geometry.arrays import Array
from .bias_drift import Kernels


@dataclass(frozen=True, eq=False)
class Moments:
    """S (k, 15, 15) for a stack of kernels, `log_determinant` (k,) of K where a constant was taken out, `n` poses."""

    S: Array
    log_determinant: Array
    n: int


def moments_of(X: Array, variance: Array, kernels: Kernels) -> Moments:
    """The moments of rows X (n, 15) with relative variances (n,) under each kernel, with columns for the same poses."""
    root = np.sqrt(variance)
    rows, one = X / root[:, None], 1.0 / root
    count = float(one @ one)
    centred = rows - np.outer(one, one @ rows / count)
    steady = centred.T @ centred
    S = np.broadcast_to(steady, (len(kernels.drift), 15, 15)).copy()
    determinant = np.full(len(S), float(np.sum(np.log(variance)) + np.log(count)))
    columns = np.array([kernels.drifts[k].columns.shape[1] for k in kernels.drift])

    single = np.flatnonzero(columns == 1)
    if len(single):
        drifts, of_kernel = np.unique(kernels.drift[single], return_inverse=True)
        h = np.concatenate([kernels.drifts[k].columns for k in drifts], axis=1) / root[:, None]
        h = h - np.outer(one, one @ h / count)
        length = np.sum(h * h, axis=0)
        along = (centred.T @ h)[:, of_kernel].T
        squared = kernels.strength[single] ** 2
        share = squared / (1.0 + squared * length[of_kernel])
        S[single] -= share[:, None, None] * along[:, :, None] * along[:, None, :]
        determinant[single] += np.log1p(squared * length[of_kernel])
    for drift in np.unique(kernels.drift[columns > 1]):
        here = np.flatnonzero(kernels.drift == drift)
        L = kernels.drifts[drift].columns / root[:, None]
        U, s, _ = np.linalg.svd(L - np.outer(one, one @ L / count), full_matrices=False)
        eigenvalue = np.multiply.outer(kernels.strength[here] ** 2, s**2)
        Z = centred.T @ U
        S[here] -= (Z * (eigenvalue / (1.0 + eigenvalue))[:, None, :]) @ Z.T
        determinant[here] += np.log1p(eigenvalue).sum(axis=1)
    return Moments(S, determinant, len(X))


def precision_times(columns: Array, strength: float, variance: Array, values: Array) -> Array:
    """`K^-1 values` (n, m) for K = diag(variance) + strength^2 columns columns^T (inversion lemma)."""
    scaled = values / variance[:, None]
    if strength == 0.0 or not columns.shape[1]:
        return scaled
    L = strength * columns
    weighted = L / variance[:, None]
    inner = np.linalg.solve(np.eye(L.shape[1]) + L.T @ weighted, L.T @ scaled)
    return scaled - weighted @ inner


def precision_diagonal(columns: Array, strength: float, variance: Array) -> Array:
    """The diagonal (n,) of that `K^-1`."""
    L = strength * columns
    weighted = L / variance[:, None]
    inner = np.linalg.solve(np.eye(L.shape[1]) + L.T @ weighted, weighted.T)
    return np.asarray(1.0 / variance - np.einsum("nq,qn->n", weighted, inner))
