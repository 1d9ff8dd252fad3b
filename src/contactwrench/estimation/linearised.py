"""One Gauss-Newton step of whitened least squares, with whatever is known beforehand as further rows.

The Jacobian's columns are scaled to unit length and decomposed once; the step, the covariance of the parameters, the
leverage of each pose and the degrees of freedom that are left all follow from that decomposition.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..geometry.arrays import Array

NEGLIGIBLE = 1e-10
"""Of the largest singular value: below, a direction is not determined and the step leaves it alone."""


@dataclass(frozen=True, eq=False)
class PriorRows:
    """What is known before the readings, as rows of unit variance.

    `residuals` (q,): what is known less what the state says, in standard deviations; `jacobian` (q, p): the derivative
    of what the state says, likewise.
    """

    residuals: Array
    jacobian: Array


@dataclass(frozen=True, eq=False)
class Linearised:
    """The whitened problem at one point, and the singular value decomposition of its Jacobian by way of QR.

    `residuals` (n, 6) and `whitened` (n, 6) of the readings, `prior` (q,) those of the prior; `U` (n, 6, p) and
    `U_prior` (q, p) together have orthonormal columns.
    """

    residuals: Array
    whitener: Array
    whitened: Array
    prior: Array
    U: Array
    U_prior: Array
    s: Array
    Vt: Array
    column_length: Array

    @property
    def chi2(self) -> float:
        """Sum of the squared whitened residuals, the prior's included: what the step makes smaller."""
        return self.chi2_of_readings + float(self.prior @ self.prior)

    @property
    def chi2_of_readings(self) -> float:
        """Sum of the squared whitened residuals of the readings alone."""
        return float(np.sum(self.whitened**2))

    @property
    def readings_left(self) -> float:
        """Degrees of freedom that the readings have left; a parameter that the prior settles costs them none."""
        return self.whitened.size - float(np.sum(self.U**2))

    def inverse(self) -> Array:
        """A (p, p): `A @ U^T @ whitened` is the least-squares step, of least length where nothing determines it;
        `A @ A.T` is the covariance of the parameters.
        """
        inverse: Array = (self.Vt.T / np.where(self.s > 0.0, self.s, np.inf)) / self.column_length[:, None]
        return inverse

    def step(self) -> Array:
        """The Gauss-Newton step (p,)."""
        step: Array = self.inverse() @ self.gradient()
        return step

    def gradient(self) -> Array:
        """The whitened residuals along the columns of U (p,): zero at the optimum."""
        along: Array = self.U.reshape(-1, len(self.s)).T @ self.whitened.ravel() + self.U_prior.T @ self.prior
        return along

    def whitened_after_step(self) -> Array:
        """The whitened residuals (n, 6) of the readings that the step will leave, to first order."""
        left: Array = self.whitened - np.einsum("nkp,p->nk", self.U, self.gradient())
        return left

    def step_size(self) -> float:
        """Length of the next step in standard deviations of the readings, relative to the misfit that is left."""
        return float(np.linalg.norm(self.gradient())) / max(1.0, float(np.sqrt(self.chi2)))


def linearise(residuals: Array, jacobian: Array, whitener: Array, prior: PriorRows | None = None) -> Linearised:
    """Whiten residuals (n, 6) and Jacobian (n, 6, p), add the prior's rows, scale columns to unit length, decompose."""
    n, _, p = jacobian.shape
    J = (whitener @ jacobian).reshape(6 * n, p)
    if prior is not None:
        J = np.vstack([J, prior.jacobian])
    length = np.sqrt(np.einsum("ip,ip->p", J, J))
    length[length == 0.0] = 1.0
    Q, triangle = np.linalg.qr(J / length)
    left, s, Vt = np.linalg.svd(triangle)
    s[s < NEGLIGIBLE * s[0]] = 0.0
    U = (Q @ left[:, : len(s)]) * (s > 0.0)
    return Linearised(
        residuals=residuals,
        whitener=whitener,
        whitened=np.einsum("nij,nj->ni", whitener, residuals),
        prior=np.empty(0) if prior is None else prior.residuals,
        U=U[: 6 * n].reshape(n, 6, -1),
        U_prior=U[6 * n :],
        s=s,
        Vt=Vt[: len(s)],
        column_length=length,
    )
