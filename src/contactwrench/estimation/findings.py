"""What a result cannot be trusted with, why, and what would mend it; and what `auto` took for granted."""

from __future__ import annotations

import numpy as np

from ..calibration.fields import Finding, Kind, Severity
from ..calibration.observability import advice_on_poses, natural_jacobian
from ..geometry.arrays import Array
from ..model import AXES, RigidTool, affine_jacobian, gravity_in_flange
from .auto import AutoFit
from .least_squares import LEAST_LEFT, Fit
from .noise import PoseReadings
from .priors import Question
from .robust import POOR_SHARE, RobustEstimate, force_left, weight_of

WEIGHT_SHARE = 0.10
COM_STD = 0.010
BIAS_SHARE = 0.10
FEWEST_DOF = 3.0
NOISE_RATIO = 10.0
STATED_NOISE_RATIO = 5.0
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


def doubts(robust: RobustEstimate, question: Question, trade_offs: tuple[str, ...]) -> tuple[Finding, ...]:
    """What an estimate cannot be trusted with."""
    fit, readings, names = robust.estimate.fit, robust.readings, robust.estimate.names
    found = [*uncertain_parameters(fit, names, readings, trade_offs)]
    estimated = question.noise is None or question.model == "paper"
    found += uncertain_noise(fit) if estimated else beyond_stated_noise(fit)
    if fit.tool is not None and question.earlier is None:
        found += [*poor_fit(fit), *far_centre_of_mass(fit), *cross_talk(fit, readings)]
    found += correlated_poses(fit)
    if question.earlier is not None:
        found += contradicts_prior(fit)
    elif fit.held_out is None:
        text = "no pose can be left out for a held-out error: record more poses"
        found.append(Finding(Kind.NO_HELD_OUT_ERROR, Severity.NOTE, text))
    return tuple(found)


def uncertain_parameters(
    fit: Fit, names: tuple[str, ...], readings: PoseReadings, trade_offs: tuple[str, ...]
) -> list[Finding]:
    """A weight known to worse than 10 %, a com to worse than 10 mm, a force bias to worse than 10 % of the weight, each
    with what it trades off with; then what would mend them.

    `affine` has no weight; the mean singular value of its force matrix stands in.
    """
    uncertain: list[tuple[str, str]] = []
    weight = weight_of(fit)
    if fit.tool is not None:
        weight, std = fit.tool.weight, np.sqrt(np.diag(fit.covariance))
        if std[0] > weight:
            text = f"weight {weight:.2g} +- {std[0]:.2g} N is not above zero, so com and mounting mean nothing"
            return _with_advice([("weight", text)], fit, names, readings, trade_offs)
        if std[0] > WEIGHT_SHARE * weight:
            uncertain.append(("weight", f"weight {weight:.3g} +- {std[0]:.2g} N, a std over 10 %"))
        for axis, value in zip("xyz", std[1:4], strict=True):
            if value > COM_STD:
                uncertain.append((f"com_{axis}", f"com_{axis} has a std of {1e3 * value:.1f} mm, over 10 mm"))
    for axis, value in zip("xyz", np.sqrt(np.diag(fit.B_covariance)[3:12:4]), strict=True):
        if value > BIAS_SHARE * weight:
            text = f"bias_f{axis} has a std of {value:.2g} N, over 10 % of the weight"
            uncertain.append((f"bias_f{axis}", text))
    return _with_advice(uncertain, fit, names, readings, trade_offs) if uncertain else []


def _with_advice(
    uncertain: list[tuple[str, str]],
    fit: Fit,
    names: tuple[str, ...],
    readings: PoseReadings,
    trade_offs: tuple[str, ...],
) -> list[Finding]:
    """Findings of uncertain parameters, by name and in words, and last what would mend the first."""
    findings = []
    for name, text in uncertain:
        rivals = [pair for pair in trade_offs if name in pair.split(": ")[0].split(" and ")]
        findings.append(Finding.weak(Kind.UNCERTAIN_PARAMETER, f"{text}{f' ({rivals[0]})' if rivals else ''}"))
    advice = _advice(fit, names, readings, uncertain[0][0])
    return [*findings, Finding(Kind.ADVICE, Severity.NOTE, advice)]


def _advice(fit: Fit, names: tuple[str, ...], readings: PoseReadings, weakest: str) -> str:
    """Where the poses are at fault, why, and what one more would give; else a better reading of the data."""
    s: Array = fit.singular_values
    if fit.tool is not None:
        s = np.asarray(np.linalg.svd(natural_jacobian(fit.tool, readings.R_base_flange, names), compute_uv=False))
    if s[-1] < WELL_SPREAD * s[0]:
        return advice_on_poses(fit.tool, fit.covariance, fit.noise, names, weakest, readings.R_base_flange)
    return (
        f"the poses are well spread, yet {force_left(fit):.2g} N are left in them: check that the arm was still and "
        "free, and try contactwrench diagnose; a light tool needs more poses"
    )


def beyond_stated_noise(fit: Fit) -> list[Finding]:
    """That the poses differ far more than the noise that was stated for them."""
    ratio = float(np.sqrt(fit.reduced_chi2))
    if ratio <= STATED_NOISE_RATIO:
        return []
    text = (
        f"the residuals are {ratio:.0f} times the given noise: check the noise, the model and each pose, every std was "
        "enlarged by that factor"
    )
    return [Finding.weak(Kind.BEYOND_STATED_NOISE, text)]


def uncertain_noise(fit: Fit) -> list[Finding]:
    """Standard deviations that rest on too little: few degrees of freedom, or one axis that the model explains far
    better than its neighbour.
    """
    found = []
    fewest = float(fit.dof.min())
    if 0.0 < fewest < FEWEST_DOF:
        text = (
            f"every std rests on {fewest:.2g} degrees of freedom, under {FEWEST_DOF:g}, and may be far off: record "
            "more poses"
        )
        found.append(Finding.weak(Kind.FEW_DEGREES_OF_FREEDOM, text))
    for group in (slice(0, 3), slice(3, 6)):
        noise, axes = fit.noise[group], AXES[group]
        low, high = int(np.argmin(noise)), int(np.argmax(noise))
        if noise[high] > NOISE_RATIO * noise[low] > 0.0:
            text = (
                f"{axes[high]} is left {noise[high] / noise[low]:.0f} times noisier than {axes[low]}: either that axis "
                "is, or this model does not hold and every std is too small: compare the other models"
            )
            found.append(Finding.weak(Kind.UNEQUAL_NOISE, text))
    return found


def poor_fit(fit: Fit) -> list[Finding]:
    """That far more is left than a sensor and an arm explain: most often the file is understood wrongly."""
    left, weight = force_left(fit), weight_of(fit)
    if left <= POOR_SHARE * weight:
        return []
    text = (
        f"{left:.2g} N are left in the poses, {100.0 * left / weight:.0f} % of the weight: the file may be read "
        "wrongly (orientation, sign, units); contactwrench diagnose tries the other ways to read it"
    )
    return [Finding.weak(Kind.POOR_FIT, text)]


def correlated_poses(fit: Fit) -> list[Finding]:
    """That what is left in one pose is left in the next as well: poses are taken for independent, which rows taken on
    the way are not, and no std holds.
    """
    n = len(fit.residuals)
    rms = np.sqrt(np.mean(fit.residuals**2, axis=0))
    if n < FEWEST_IN_A_ROW or not (rms > 0.0).all():
        return []
    left = fit.residuals / rms
    alike = float(np.mean(left[1:] * left[:-1]))
    if alike <= max(ALIKE, ALIKE_SHOWS / np.sqrt(2.0 * n)):
        return []
    worth = (1.0 - alike) / (1.0 + alike)
    text = (
        f"what is left in one pose is left in the next too (correlation {alike:.2f}), as in rows taken while the arm "
        f"moves: these {n} poses tell as much as {max(worth * n, 1.0):.0f}, and every std is too small: stop at each "
        "orientation, and give the times in a column t"
    )
    return [Finding.weak(Kind.CORRELATED_POSES, text)]


def far_centre_of_mass(fit: Fit) -> list[Finding]:
    """That the centre of mass lies further off than any tool's: what a wrong unit of torque looks like."""
    distance = 0.0 if fit.tool is None else float(np.linalg.norm(fit.tool.com))
    if distance <= FURTHEST_COM:
        return []
    text = (
        f"the centre of mass comes out {distance:.2g} m from the sensor: are the torques in N mm? Then rename their "
        "columns tx_nmm ty_nmm tz_nmm; contactwrench diagnose tries this and other ways to read the file"
    )
    return [Finding.weak(Kind.FAR_CENTRE_OF_MASS, text)]


def cross_talk(fit: Fit, readings: PoseReadings) -> list[Finding]:
    """That a force matrix of its own for each axis explains far more than a rigid tool can (F test)."""
    from scipy.special import fdtrc

    linear, n = fit.linear, len(readings)
    if linear is None or n < FEWEST_POSES_FOR_MATRIX:
        return []
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
        return []
    B = np.linalg.lstsq(columns.reshape(6 * n, 24), readings.wrench.ravel(), rcond=None)[0].reshape(6, 4)
    values = ", ".join(f"{value:.4g}" for value in np.linalg.svd(B[:3, :3], compute_uv=False))
    text = (
        f"no rigid tool explains these readings (chance under 0.1 %): their force matrix has the singular values "
        f"{values} N, a rigid tool's three equal ones; unequal gains, cross-talk or a cable: compare --model affine"
    )
    return [Finding.doubtful(Kind.CROSS_TALK, text)]


def contradicts_prior(fit: Fit) -> list[Finding]:
    """That readings and the earlier calibration do not go together."""
    from scipy.special import chdtrc

    linear = fit.linear
    if linear is None:
        return []
    off = float(linear.prior @ linear.prior)
    if fit.reduced_chi2 <= STATED_NOISE_RATIO and float(chdtrc(float(len(linear.prior)), off)) > SIGNIFICANCE:
        return []
    text = (
        "the poses contradict the earlier calibration: tool, mounting or base changed, or the tool touches something; "
        "calibrate anew, without --prior"
    )
    return [Finding.weak(Kind.CONTRADICTS_PRIOR, text)]


def assumptions_in_words(auto: AutoFit, question: Question) -> tuple[str, ...]:
    """One sentence on the mounting, one on the base."""
    tool = auto.fit.rigid_tool
    side = "along" if tool.R_flange_sensor[2, 2] >= 0.0 else "against"
    tilt, lean = _tilt_of_mounting(tool), _angle(float(tool.gravity_direction @ question.gravity_direction))
    priors = question.priors
    if priors.mount is None:
        of_mounting = f"mounting: as known; sensor's z is found {tilt:.2f} deg off the flange's"
    elif auto.mounting_exact is None:
        of_mounting = f"mounting: sensor's z is {tilt:.1f} deg off the flange's, {_overruled(auto, priors.mount)}"
    else:
        of_mounting = (
            f"mounting: sensor's z {side} the flange's, {_an_axis(priors.mount)}; found {tilt:.2f} deg off, exactly "
            f"parallel has a probability of {_percent(auto.mounting_exact)}"
        )
    if priors.base is None:
        of_base = f"base: as known; gravity is found {lean:.2f} deg off that direction"
    elif auto.base_exact is None:
        of_base = f"base: gravity is {lean:.1f} deg off the stated direction, {_overruled(auto, priors.base)}"
    else:
        of_base = (
            f"base: gravity in the stated direction, {_an_axis(priors.base)}; found {lean:.2f} deg off, exactly "
            f"level has a probability of {_percent(auto.base_exact)}"
        )
    return of_mounting, of_base


def _an_axis(sd: float) -> str:
    return f"+- {np.rad2deg(sd):.3g} deg an axis"


def _overruled(auto: AutoFit, sd: float) -> str:
    odds = auto.log_odds / np.log(10.0)
    return f"which the readings favour 10^{odds:.0f} : 1 over a tilt of {np.rad2deg(sd):.3g} deg an axis"


def _tilt_of_mounting(tool: RigidTool) -> float:
    return min(_angle(float(tool.R_flange_sensor[2, 2])), _angle(-float(tool.R_flange_sensor[2, 2])))


def _angle(cosine: float) -> float:
    return float(np.rad2deg(np.arccos(np.clip(cosine, -1.0, 1.0))))


def _percent(probability: float) -> str:
    return f"{100.0 * probability:.0f} %"
