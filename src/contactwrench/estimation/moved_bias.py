"""Readings held against a calibration, and what of their misfit a bias explains that moved since."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..calibration.calibration import Calibration
from ..calibration.findings import Finding, Kind, Severity
from ..geometry.arrays import Array, Frozen
from ..statistics import SIGNIFICANCE, MisfitTest, percent, products_of_readings


@dataclass(frozen=True, eq=False)
class BiasShift(Frozen):
    """The part of the residuals that a bias explains which moved since the calibration.

    `shift` (6,), N and N m, the same in all poses, with its `std` (6,); `chi2` of it, its share of the whole, and the
    `probability` of as much by chance; `rest_chi2` and `rest_probability` of what it leaves; `alone`: whether that is
    what the calibration explains, and no other tool or mounting would do as well.
    """

    shift: Array
    std: Array
    chi2: float
    probability: float
    rest_chi2: float
    rest_probability: float
    alone: bool

    @property
    def finding(self) -> Finding | None:
        """That the bias moved, where it did beyond chance, and what to do."""
        if self.probability >= SIGNIFICANCE:
            return None
        remedy = "another tool or mounting would do as well: tilt the tool further"
        if self.alone:
            remedy = "one pose gives the new zero: contactwrench calibrate FILE --prior CAL.json"
        elif self.rest_probability < SIGNIFICANCE:
            remedy = "more than the bias changed: calibrate anew"
        force, torque = (float(np.linalg.norm(part)) for part in (self.shift[:3], self.shift[3:]))
        far = f"moved by {force:.2g} N and {1e3 * torque:.2g} mN m"
        text = (
            f"{f'the bias {far}, which' if self.alone else f'a bias that {far}'} explains {self.chi2:.3g} of the "
            f"chi-square of {self.chi2 + self.rest_chi2:.3g}; the rest has a probability of "
            f"{percent(self.rest_probability)}; {remedy}"
        )
        return Finding(Kind.BIAS_SHIFTED, Severity.WARNING, text)


def held_against(
    calibration: Calibration, residuals: Array, R_base_flange: Array, variance: Array, dof: float
) -> tuple[MisfitTest, BiasShift | None]:
    """The test of what poses (n, 3, 3) read beside what the calibration predicts, `residuals` (n, 6), whose noise has
    the `variance` (n, 6), known with `dof` degrees of freedom (0: exactly); and what of their misfit a moved bias
    explains, None for a single pose.
    """
    n = len(residuals)
    J = calibration.error_jacobian(R_base_flange).reshape(6 * n, -1)
    of_bias = [name.startswith("bias_") or name.endswith("_1") for name in calibration.error_names]
    columns = [residuals.reshape(-1, 1), np.tile(np.eye(6), (n, 1)), J[:, np.logical_not(of_bias)]]
    products = products_of_readings(np.hstack(columns), variance.ravel(), J, calibration.error_covariance)
    whole = MisfitTest(float(products[0, 0]), 6 * n, dof)
    if n == 1:
        return whole, None
    inverse = np.linalg.inv(products[1:7, 1:7])
    shift = inverse @ products[1:7, 0]
    of_shift = MisfitTest(float(shift @ products[1:7, 0]), 6, dof)
    rest = MisfitTest(whole.misfit - of_shift.misfit, 6 * n - 6, dof)
    by_others = np.linalg.lstsq(products[7:, 7:], products[7:, 0], rcond=None)[0] @ products[7:, 0]
    left = 6 * n - len(products) + 7
    otherwise = left <= 0 or MisfitTest(whole.misfit - float(by_others), left, dof).probability >= SIGNIFICANCE
    return whole, BiasShift(
        shift=shift,
        std=np.sqrt(np.diag(inverse)),
        chi2=of_shift.misfit,
        probability=of_shift.probability,
        rest_chi2=rest.misfit,
        rest_probability=rest.probability,
        alone=rest.probability >= SIGNIFICANCE and not otherwise,
    )


def noise_dof(calibration: Calibration) -> float:
    """Degrees of freedom behind the noise of all axes together, readings less parameters; of model `paper` that of one
    axis, as it estimates each alone. 0 for a known noise.
    """
    if calibration.model == "paper":
        return calibration.dof
    n = len(calibration.fitted_poses) if calibration.moments is None else calibration.moments.n
    return float(max(6 * n - len(calibration.parameters), 0)) if calibration.dof > 0.0 else 0.0
