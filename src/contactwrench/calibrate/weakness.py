"""Warnings inside a result: what is weak, why, and what would mend it. They begin with "weak" where a number is."""

from __future__ import annotations

import numpy as np

from ..model import AXES, PARAMETERS
from ..observability import natural_jacobian
from ..orientation import Array
from .least_squares import Fit, PoseReadings

WEIGHT_SHARE = 0.10
COM_STD = 0.010
BIAS_SHARE = 0.10
FEWEST_DOF = 3.0
NOISE_RATIO = 10.0
GIVEN_NOISE_RATIO = 5.0
WELL_SPREAD = 0.1
"""Poses whose least singular value, relative to the largest, is above this are not what makes a fit weak."""


def weak_parameters(fit: Fit, model: str, readings: PoseReadings, trade_offs: tuple[str, ...]) -> tuple[str, ...]:
    """Warnings for a weight known to worse than 10 %, a com to worse than 10 mm, a force bias to worse than 10 % of
    the weight, each with what it trades off with; then what would mend them.

    `affine` has no weight; the mean singular value of its force matrix stands in.
    """
    names = PARAMETERS[model]
    warnings: list[str] = []

    def warn(name: str, what: str) -> None:
        rivals = [pair for pair in trade_offs if name in pair.split(": ")[0].split(" and ")]
        warnings.append(f"weak: {what}{f' ({rivals[0]})' if rivals else ''}")

    std_bias = np.sqrt(np.diag(fit.B_covariance)[3::4])[:3]
    tool = fit.tool
    if tool is None:
        weight = float(np.mean(np.linalg.svd(fit.B[:3, :3], compute_uv=False)))
    else:
        weight = tool.weight
        std = np.sqrt(np.diag(fit.covariance))
        if std[0] > weight:
            warn("weight", f"weight {weight:.2g} +- {std[0]:.2g} N is not above zero, so com and mounting mean nothing")
            return (*warnings, _advice(fit, names, readings))
        if std[0] > WEIGHT_SHARE * weight:
            warn("weight", f"weight {weight:.3g} +- {std[0]:.2g} N, a std over 10 %")
        for axis, value in zip("xyz", std[1:4], strict=True):
            if value > COM_STD:
                warn(f"com_{axis}", f"com_{axis} has a std of {1e3 * value:.1f} mm, over 10 mm")
    for axis, value in zip("xyz", std_bias, strict=True):
        if value > BIAS_SHARE * weight:
            warn(f"bias_f{axis}", f"bias_f{axis} has a std of {value:.2g} N, over 10 % of the weight")
    return (*warnings, _advice(fit, names, readings)) if warnings else ()


def beyond_given_noise(fit: Fit) -> tuple[str, ...]:
    """A warning where the poses differ far more than the noise that was given for them."""
    ratio = float(np.sqrt(fit.reduced_chi2))
    if ratio <= GIVEN_NOISE_RATIO:
        return ()
    return (
        f"weak: the residuals are {ratio:.0f} times the given noise: check the noise, the model and each pose, "
        "every std was enlarged by that factor",
    )


def weak_noise(fit: Fit) -> tuple[str, ...]:
    """Warnings for standard deviations that rest on too little: few degrees of freedom, or one axis that the model
    explains far better than its neighbour.
    """
    warnings: list[str] = []
    fewest = float(fit.dof.min())
    if 0.0 < fewest < FEWEST_DOF:
        warnings.append(
            f"weak: every std rests on {fewest:.2g} degrees of freedom, under {FEWEST_DOF:g}, and may be far off: "
            "record more poses"
        )
    for group in (slice(0, 3), slice(3, 6)):
        noise = fit.noise[group]
        low, high = int(np.argmin(noise)), int(np.argmax(noise))
        if noise[high] > NOISE_RATIO * noise[low] > 0.0:
            names = AXES[group]
            warnings.append(
                f"weak: {names[high]} is left {noise[high] / noise[low]:.0f} times noisier than {names[low]}: either "
                "that axis is, or this model does not hold and every std is too small: compare the other models"
            )
    return tuple(warnings)


def _advice(fit: Fit, names: tuple[str, ...], readings: PoseReadings) -> str:
    """Better poses where the natural Jacobian is poorly conditioned; else a better reading of the data, as then the
    poses are good and the model leaves too much.
    """
    if fit.tool is not None:
        s = np.linalg.svd(natural_jacobian(fit.tool, readings.R_base_flange, names), compute_uv=False)
    else:
        s = fit.singular_values
    if s[-1] < WELL_SPREAD * s[0]:
        return "to mend this, add poses that tilt the tool further, to gravity along +-x, +-y and +-z of the sensor"
    left: Array = np.sqrt(np.mean(np.sum(fit.residuals[:, :3] ** 2, axis=1)))
    return (
        f"the poses are well spread, yet {left:.2g} N are left in them: check that the arm was still and free, the "
        "orientation's convention, and the base (--model mount+base); a light tool needs more poses"
    )
