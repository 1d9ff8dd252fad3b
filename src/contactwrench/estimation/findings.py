"""Warnings inside a result: what is weak, why, and what would mend it. They begin with "weak" where a number is."""

from __future__ import annotations

import numpy as np

from ..calibration.observability import advice_on_poses, natural_jacobian
from ..model import AXES, affine_jacobian, gravity_in_flange
from .estimate import Question
from .least_squares import LEAST_LEFT, Fit, PoseReadings
from .robust import POOR_SHARE, RobustEstimate, force_left, weight_of

WEIGHT_SHARE = 0.10
COM_STD = 0.010
BIAS_SHARE = 0.10
FEWEST_DOF = 3.0
NOISE_RATIO = 10.0
GIVEN_NOISE_RATIO = 5.0
FURTHEST_COM = 2.0
"""m: no arm carries a tool that long."""

ALIKE = 0.5
"""Correlation of what is left in poses that follow each other, up to which a std is at most 1.7 times too small."""

ALIKE_SHOWS = 3.3
"""Standard deviations of that correlation; the axes of forces, and of torques, are taken to say one thing each."""

FEWEST_IN_A_ROW = 12
SIGNIFICANCE = 0.001
FEWEST_POSES_FOR_MATRIX = 5
WELL_SPREAD = 0.1
"""Poses whose least singular value, relative to the largest, is above this are not what makes a fit weak."""


def weaknesses(found: RobustEstimate, question: Question, trade_offs: tuple[str, ...]) -> tuple[str, ...]:
    """Every warning of an estimate about what it cannot be trusted with."""
    fit, readings, names = found.found.fit, found.readings, found.found.names
    warnings = weak_parameters(fit, names, readings, trade_offs)
    estimated = question.noise is None or question.model == "paper"
    warnings += weak_noise(fit) if estimated else beyond_given_noise(fit)
    if fit.tool is not None and question.earlier is None:
        warnings += poor_fit(fit)
        warnings += implausible_com(fit)
        warnings += cross_talk(fit, readings)
    warnings += alike_in_a_row(fit)
    if question.earlier is not None:
        warnings += contradicts_earlier(fit)
    elif fit.held_out is None:
        warnings += ("no pose can be left out for a held-out error: record more poses",)
    return warnings


def weak_parameters(
    fit: Fit, names: tuple[str, ...], readings: PoseReadings, trade_offs: tuple[str, ...]
) -> tuple[str, ...]:
    """Warnings for a weight known to worse than 10 %, a com to worse than 10 mm, a force bias to worse than 10 % of
    the weight, each with what it trades off with; then what would mend them.

    `affine` has no weight; the mean singular value of its force matrix stands in.
    """
    warnings: list[str] = []
    weakest: list[str] = []

    def warn(name: str, what: str) -> None:
        weakest.append(name)
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
            return (*warnings, _advice(fit, names, readings, weakest[0]))
        if std[0] > WEIGHT_SHARE * weight:
            warn("weight", f"weight {weight:.3g} +- {std[0]:.2g} N, a std over 10 %")
        for axis, value in zip("xyz", std[1:4], strict=True):
            if value > COM_STD:
                warn(f"com_{axis}", f"com_{axis} has a std of {1e3 * value:.1f} mm, over 10 mm")
    for axis, value in zip("xyz", std_bias, strict=True):
        if value > BIAS_SHARE * weight:
            warn(f"bias_f{axis}", f"bias_f{axis} has a std of {value:.2g} N, over 10 % of the weight")
    return (*warnings, _advice(fit, names, readings, weakest[0])) if warnings else ()


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


def poor_fit(fit: Fit) -> tuple[str, ...]:
    """A warning where far more is left than a sensor and an arm explain: most often the file is read wrongly."""
    left, weight = force_left(fit), weight_of(fit)
    if left <= POOR_SHARE * weight:
        return ()
    return (
        f"weak: {left:.2g} N are left in the poses, {100.0 * left / weight:.0f} % of the weight: the file may be read "
        "wrongly (orientation, sign, units); contactwrench diagnose tries the other ways to read it",
    )


def alike_in_a_row(fit: Fit) -> tuple[str, ...]:
    """A warning where what is left in one pose is left in the next as well: poses are taken for independent, which rows
    taken on the way are not, and no std holds.
    """
    n = len(fit.residuals)
    rms = np.sqrt(np.mean(fit.residuals**2, axis=0))
    if n < FEWEST_IN_A_ROW or not (rms > 0.0).all():
        return ()
    left = fit.residuals / rms
    alike = float(np.mean(left[1:] * left[:-1]))
    if alike <= max(ALIKE, ALIKE_SHOWS / np.sqrt(2.0 * n)):
        return ()
    worth = (1.0 - alike) / (1.0 + alike)
    return (
        f"weak: what is left in one pose is left in the next too (correlation {alike:.2f}), as in rows taken while the "
        f"arm moves: these {n} poses tell as much as {max(worth * n, 1.0):.0f}, and every std is too small: stop at "
        "each orientation, and give the times in a column t",
    )


def implausible_com(fit: Fit) -> tuple[str, ...]:
    """A warning where the centre of mass lies further off than any tool's: what a wrong unit of torque looks like."""
    if fit.tool is None:
        return ()
    distance = float(np.linalg.norm(fit.tool.com))
    if distance <= FURTHEST_COM:
        return ()
    return (
        f"weak: the centre of mass comes out {distance:.2g} m from the sensor: are the torques in N mm? Then rename "
        "their columns tx_nmm ty_nmm tz_nmm; contactwrench diagnose tries this and other ways to read the file",
    )


def cross_talk(fit: Fit, readings: PoseReadings) -> tuple[str, ...]:
    """A warning where a force matrix of its own for each axis explains far more than a rigid tool can (F test)."""
    from scipy.special import fdtrc

    linear, n = fit.linear, len(readings)
    if linear is None or n < FEWEST_POSES_FOR_MATRIX:
        return ()
    r = gravity_in_flange(readings.R_base_flange, fit.gravity_direction)
    columns = affine_jacobian(r)
    whitened = (linear.whitener @ columns).reshape(6 * n, 24)
    spanned = linear.U.reshape(6 * n, -1)
    across = whitened - spanned @ (spanned.T @ whitened)
    left, s, _ = np.linalg.svd(across, full_matrices=False)
    new = left[:, s > 1e-6 * max(float(s[0]), 1e-300)]
    errors = linear.whitened.ravel()
    gain, more = float(np.sum((new.T @ errors) ** 2)), float(new.shape[1])
    rest, dof = max(linear.chi2_of_readings - gain, 1e-300), linear.readings_left - more
    if more == 0.0 or dof < LEAST_LEFT or float(fdtrc(more, dof, gain / more / (rest / dof))) > SIGNIFICANCE:
        return ()
    B = np.linalg.lstsq(columns.reshape(6 * n, 24), readings.wrench.ravel(), rcond=None)[0].reshape(6, 4)
    values = ", ".join(f"{value:.4g}" for value in np.linalg.svd(B[:3, :3], compute_uv=False))
    return (
        f"no rigid tool explains these readings (chance under 0.1 %): their force matrix has the singular values "
        f"{values} N, a rigid tool's three equal ones; unequal gains, cross-talk or a cable: compare --model affine",
    )


def contradicts_earlier(fit: Fit) -> tuple[str, ...]:
    """A warning where readings and the earlier calibration do not go together."""
    from scipy.special import chdtrc

    linear = fit.linear
    if linear is None:
        return ()
    off = float(linear.prior @ linear.prior)
    if fit.reduced_chi2 <= GIVEN_NOISE_RATIO and float(chdtrc(float(len(linear.prior)), off)) > SIGNIFICANCE:
        return ()
    return (
        "weak: the poses contradict the earlier calibration: tool, mounting or base changed, or the tool touches "
        "something; calibrate anew, without --prior",
    )


def _advice(fit: Fit, names: tuple[str, ...], readings: PoseReadings, weakest: str) -> str:
    """Where the poses are at fault, why, and what one more would give; else a better reading of the data."""
    if fit.tool is not None:
        s = np.linalg.svd(natural_jacobian(fit.tool, readings.R_base_flange, names), compute_uv=False)
    else:
        s = fit.singular_values
    if s[-1] < WELL_SPREAD * s[0]:
        return advice_on_poses(fit.tool, fit.covariance, fit.noise, names, weakest, readings.R_base_flange)
    return (
        f"the poses are well spread, yet {force_left(fit):.2g} N are left in them: check that the arm was still and "
        "free, and try contactwrench diagnose; a light tool needs more poses"
    )
