"""Model `affine`: B (6, 4) itself, 24 free numbers, `F = A r + F0, T = A_t r + T0` (method, "The models").

What cannot be a rigid tool, unequal gains or cross-talk, shows here; each axis is a regression of its own.
"""

from __future__ import annotations

import numpy as np

from ..calibration.findings import Finding, Kind, Severity
from ..calibration.observability import require_separable
from ..model import PARAMETERS, free_wrench, gravity_in_flange
from .estimate import Estimate
from .noise import APART, NoiseModel, PoseReadings, relative_variances
from .priors import Question

PASSES = 20
COLUMNS = ("B_*_rx", "B_*_ry", "B_*_rz", "B_*_1")
MIRRORED = Finding(
    Kind.MIRRORED_AXIS,
    Severity.WEAK,
    "weak: the force matrix A mirrors: an axis has the wrong sign, or the sensor reports the reaction",
)


def fit_affine(readings: PoseReadings, question: Question) -> Estimate:
    """The least-squares B. Raises `UnobservableError` where the poses do not separate its columns."""
    d, n = question.gravity_direction, len(readings)
    r = gravity_in_flange(readings.R_base_flange, d)
    A = np.column_stack([r, np.ones(n)])
    require_separable(A, COLUMNS, readings.R_base_flange, d)
    U, s, Vt = np.linalg.svd(A, full_matrices=False)
    B = (Vt.T / s @ (U.T @ readings.wrench)).T
    residuals = readings.wrench - free_wrench(B, r)
    left = np.full((1, 6), n - 4.0)
    noise = NoiseModel(readings.least_variance, question.noise, relative_variances(question.noise))
    log_variance, squares = np.log(noise.start)[None], np.sum(residuals**2, axis=0)[None]
    for k in range(PASSES):
        log_variance = noise.improved(log_variance, squares, left, np.array([APART]), first=k == 0)
    variance = np.exp(log_variance[0])
    covariance = np.kron(np.diag(variance), (Vt.T / s**2) @ Vt)
    leverage = 1.0 - np.sum(U**2, axis=1)
    stated = question.noise
    chi2 = 1.0 if stated is None else float(np.sum((residuals / stated.std) ** 2)) / max(float(left.sum()), 1.0)
    return Estimate(
        names=PARAMETERS["affine"],
        gravity_direction=d,
        B=B,
        B_covariance=covariance,
        covariance=covariance,
        noise=np.sqrt(variance),
        dof=np.full(24, n - 4.0 if stated is None else 6.0 * (n - 4.0) + stated.dof),
        kept=np.ones(n, dtype=bool),
        errors=residuals,
        held_out=residuals / leverage[:, None] if float(leverage.min()) > 1e-9 else None,
        reduced_chi2=chi2,
        readings_left=np.full(2, 3.0 * (n - 4.0)),
        singular_values=np.linalg.svd(
            np.kron(np.diag(1.0 / np.sqrt(variance)), A / np.linalg.norm(A, axis=0)), compute_uv=False
        ),
    )
