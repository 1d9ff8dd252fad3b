"""Is a misfit what chance explains? Chi-square, or F where the noise itself was estimated. And numbers as text."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .geometry.arrays import Array

SIGNIFICANCE = 0.01
"""Less probable than this, a misfit is not put down to chance."""

SPOKEN = {
    **{"m": (1e3, "mm"), "rad": (180.0 / np.pi, "deg"), "N m": (1e3, "mN m"), "s": (1e3, "ms")},
    "kg m^2": (1e4, "kg cm^2"),
}
"""What people speak in place of a unit of SI, and how many make one; any other unit they speak as it is."""
LENIENT_DOF = 10.0
LEAST_EIGENVALUE = 1e-12
"""Of a correlation matrix: below, a direction is one that rounding made."""


@dataclass(frozen=True)
class MisfitTest:
    """A misfit of so many readings against a noise that was estimated with `dof` degrees of freedom (0: known)."""

    misfit: float
    readings: int
    dof: float

    @property
    def chi2(self) -> float:
        """Misfit per reading, 1 expected."""
        return self.misfit / self.readings

    @property
    def probability(self) -> float:
        """Probability of a misfit this large or larger: chi-square, or F where the noise was estimated."""
        from scipy.special import chdtrc, fdtrc

        return float(
            fdtrc(self.readings, self.dof, self.chi2) if self.dof > 0.0 else chdtrc(self.readings, self.misfit)
        )

    @property
    def caution(self) -> str:
        """In words, that few degrees of freedom behind the noise make the test lenient."""
        few = 0.0 < self.dof < LENIENT_DOF
        return f"; a lenient test, the noise rests on {self.dof:.2g} degrees of freedom" if few else ""


def products_of_readings(columns: Array, noise: Array, J: Array, covariance: Array) -> Array:
    """`X^T C^-1 X` (k, k) for columns X (m, k) of readings with independent noise variances (m,) and the parameters'
    covariance (p, p) in common, C = diag(noise) + J covariance J^T, by the inversion lemma: nothing of size (m, m) is
    built. Of errors the misfit.
    """
    std = np.sqrt(np.maximum(noise, 1e-300))[:, None]
    A = (J / std) @ square_root(covariance)
    z = columns / std
    along = A.T @ z
    return z.T @ z - along.T @ np.linalg.solve(np.eye(len(along)) + A.T @ A, along)


def misfit_of_parameters(change: Array, covariance: Array) -> float:
    """`d^T C^-1 d` for a change (k,) with covariance (k, k), in units in which every variance is 1. What has no
    variance at all counts only where it changed, and then without bound.
    """
    std = np.sqrt(np.diag(covariance))
    exact = std == 0.0
    if change[exact].any():
        return np.inf
    z = change[~exact] / std[~exact]
    values, vectors = np.linalg.eigh(covariance[np.ix_(~exact, ~exact)] / np.outer(std[~exact], std[~exact]))
    return float(np.sum((vectors.T @ z) ** 2 / np.maximum(values, LEAST_EIGENVALUE)))


def in_standard_deviations(change: Array, std: Array) -> Array:
    """`change / std`, elementwise; 0 where nothing changed."""
    exact = np.where(change == 0.0, 0.0, np.copysign(np.inf, change))
    return np.divide(change, std, out=exact, where=std > 0.0)


def square_root(covariance: Array) -> Array:
    """L (p, p) with `L @ L.T` the covariance, which may be singular."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


def percent(probability: float) -> str:
    """A probability in words, two digits."""
    if probability < 1e-4:
        return "under 0.01 %"
    return f"{100.0 * probability:.0f} %" if probability >= 0.1 else f"{100.0 * probability:.2g} %"


def meaningful_digits(value: float, std: float) -> tuple[str, str]:
    """Value and std with the digits that the std leaves meaningful: two of its own."""
    if not std > 0.0:
        return f"{value:.6g}", "0"
    digits = min(max(0, 1 - int(np.floor(np.log10(std)))), 9)
    return f"{value:.{digits}f}", f"{std:.{digits}f}"


def counted(count: int, noun: str) -> str:
    """A count with its noun, which has an s unless it is one."""
    return f"{count} {noun}{'' if count == 1 else 's'}"


def two_digits(value: float) -> str:
    """A number with two digits, or all before the point, never in powers of ten."""
    rounded = float(f"{value:.2g}")
    return f"{rounded:.0f}" if abs(rounded) >= 10.0 else f"{rounded:g}"


def three_digits(value: float) -> str:
    """A number with three significant figures, never in powers of ten."""
    if value == 0.0 or not np.isfinite(value):
        return f"{value:g}"
    digits = max(0, 2 - int(np.floor(np.log10(abs(value)))))
    return f"{value:.{min(digits, 6)}f}"


def force_and_torque(wrench: Array) -> str:
    """The norms of a wrench (6,) in words, N and mN m."""
    force, torque = float(np.linalg.norm(wrench[:3])), float(np.linalg.norm(wrench[3:]))
    return f"{two_digits(force)} N and {two_digits(1e3 * torque)} mN m"
