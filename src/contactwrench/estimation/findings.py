"""What a result cannot be trusted with, why, and what would mend it; and what `auto` took for granted."""

from __future__ import annotations

import numpy as np

from ..calibration.fields import Finding, Kind, Severity
from ..calibration.observability import advice_on_poses, natural_jacobian
from ..geometry.arrays import Array
from ..model import AXES, gravity_in_flange
from ..samples.poses import Pose
from ..samples.recorded_poses import RecordedPoses
from ..statistics import two_digits
from .affine import force_matrix
from .bias_drift import in_words
from .estimate import Beliefs, Estimate, RigidEstimate
from .noise import PoseReadings
from .priors import Question, rows_of

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
AFFINE_PARAMETERS, RIGID_PARAMETERS = 24.0, 13.0
POOR_SHARE = 0.10
"""Of the weight: where more is left in a pose than this, something is wrong."""

RIVAL_ODDS = 20.0
"""To one: a decision with smaller odds is in doubt."""

LARGE_SHARE = 0.25
"""Of the poses: where more are left out, the result hangs on which."""

LIKE_CONTACTS = 0.3
"""Of the poses: so few after a step may as well be in contact, all in the same way."""

MOST_NAMED = 6
MOST_SEGMENTS_NAMED = 3
MOST_MOVED = 1.0 / 3.0
"""Of the segments in which the arm stood: where the reading moves in more of them, the recording is in doubt."""

WELL_SPREAD = 0.1
"""Poses whose least singular value, relative to the largest, is above this are not what makes a fit weak."""


def doubts(
    estimate: Estimate, readings: PoseReadings, question: Question, trade_offs: tuple[str, ...]
) -> list[Finding]:
    """What an estimate from `readings`, those kept, cannot be trusted with."""
    found = uncertain_parameters(estimate, readings, trade_offs)
    estimated = question.noise is None or question.model == "paper"
    found += uncertain_noise(estimate) if estimated else beyond_stated_noise(estimate)
    if isinstance(estimate, RigidEstimate) and question.earlier is None:
        found += [*poor_fit(estimate), *far_centre_of_mass(estimate), *cross_talk(estimate, readings)]
    found += correlated_poses(estimate)
    if question.earlier is not None and isinstance(estimate, RigidEstimate):
        found += contradicts_prior(estimate, question)
    elif estimate.held_out is None:
        text = "no pose can be left out for a held-out error: record more poses"
        found.append(Finding(Kind.NO_HELD_OUT_ERROR, Severity.NOTE, text))
    return found


def uncertain_parameters(fit: Estimate, readings: PoseReadings, trade_offs: tuple[str, ...]) -> list[Finding]:
    """A weight known to worse than 10 %, a com to worse than 10 mm, a force bias to worse than 10 % of the weight, each
    with what it trades off with; then what would mend them.

    `affine` has no weight; the mean singular value of its force matrix stands in.
    """
    uncertain: list[tuple[str, str]] = []
    weight = fit.weight_scale
    if isinstance(fit, RigidEstimate):
        weight, std = fit.tool.weight, np.sqrt(np.diag(fit.covariance))
        if std[0] > weight:
            text = f"weight {weight:.2g} +- {std[0]:.2g} N is not above zero, so com and mounting mean nothing"
            return _with_advice([("weight", text)], fit, readings, trade_offs)
        if std[0] > WEIGHT_SHARE * weight:
            uncertain.append(("weight", f"weight {weight:.3g} +- {std[0]:.2g} N, a std over 10 %"))
        for axis, value in zip("xyz", std[1:4], strict=True):
            if value > COM_STD:
                uncertain.append((f"com_{axis}", f"com_{axis} has a std of {1e3 * value:.1f} mm, over 10 mm"))
    for axis, value in zip("xyz", np.sqrt(np.diag(fit.B_covariance)[3:12:4]), strict=True):
        if value > BIAS_SHARE * weight:
            text = f"bias_f{axis} has a std of {value:.2g} N, over 10 % of the weight"
            uncertain.append((f"bias_f{axis}", text))
    return _with_advice(uncertain, fit, readings, trade_offs) if uncertain else []


def _with_advice(
    uncertain: list[tuple[str, str]],
    fit: Estimate,
    readings: PoseReadings,
    trade_offs: tuple[str, ...],
) -> list[Finding]:
    """Findings of uncertain parameters, by name and in words, and last what would mend the first."""
    findings = []
    for name, text in uncertain:
        rivals = [pair for pair in trade_offs if name in pair.split(": ")[0].split(" and ")]
        findings.append(Finding.weak(Kind.UNCERTAIN_PARAMETER, f"{text}{f' ({rivals[0]})' if rivals else ''}"))
    advice = _advice(fit, readings, uncertain[0][0])
    return [*findings, Finding(Kind.ADVICE, Severity.NOTE, advice)]


def _advice(fit: Estimate, readings: PoseReadings, weakest: str) -> str:
    """Where the poses are at fault, why, and what one more would give; else a better reading of the data."""
    s: Array = fit.singular_values
    tool = fit.tool if isinstance(fit, RigidEstimate) else None
    if tool is not None:
        s = np.asarray(np.linalg.svd(natural_jacobian(tool, readings.R_base_flange, fit.names), compute_uv=False))
    if s[-1] < WELL_SPREAD * s[0]:
        return advice_on_poses(tool, fit.covariance, fit.noise, fit.names, weakest, readings.R_base_flange)
    return (
        f"the poses are well spread, yet {fit.force_left:.2g} N are left in them: check that the arm was still and "
        "free, and try contactwrench diagnose; a light tool needs more poses"
    )


def beyond_stated_noise(fit: Estimate) -> list[Finding]:
    """That the poses differ far more than the noise that was stated for them."""
    ratio = float(np.sqrt(fit.reduced_chi2))
    if ratio <= STATED_NOISE_RATIO:
        return []
    text = (
        f"the residuals are {ratio:.0f} times the given noise: check the noise, the model and each pose, every std was "
        "enlarged by that factor"
    )
    return [Finding.weak(Kind.BEYOND_STATED_NOISE, text)]


def uncertain_noise(fit: Estimate) -> list[Finding]:
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


def poor_fit(fit: Estimate) -> list[Finding]:
    """That far more is left than a sensor and an arm explain: most often the file is understood wrongly."""
    left, weight = fit.force_left, fit.weight_scale
    if left <= POOR_SHARE * weight:
        return []
    text = (
        f"{left:.2g} N are left in the poses, {100.0 * left / weight:.0f} % of the weight: the file may be read "
        "wrongly (orientation, sign, units); contactwrench diagnose tries the other ways to read it"
    )
    return [Finding.weak(Kind.POOR_FIT, text)]


def correlated_poses(fit: Estimate) -> list[Finding]:
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


def far_centre_of_mass(fit: RigidEstimate) -> list[Finding]:
    """That the centre of mass lies further off than any tool's: what a wrong unit of torque looks like."""
    distance = float(np.linalg.norm(fit.tool.com))
    if distance <= FURTHEST_COM:
        return []
    text = (
        f"the centre of mass comes out {distance:.2g} m from the sensor: are the torques in N mm? Then rename their "
        "columns tx_nmm ty_nmm tz_nmm; contactwrench diagnose tries this and other ways to read the file"
    )
    return [Finding.weak(Kind.FAR_CENTRE_OF_MASS, text)]


def cross_talk(fit: RigidEstimate, readings: PoseReadings) -> list[Finding]:
    """That a force matrix of its own for each axis explains far more than a rigid tool can (F test)."""
    from scipy.special import fdtrc

    n = len(readings)
    if n < FEWEST_POSES_FOR_MATRIX:
        return []
    A = np.column_stack([gravity_in_flange(readings.R_base_flange, fit.gravity_direction), np.ones(n)])
    whitened = fit.residuals / fit.noise
    more, *_ = np.linalg.lstsq(A, whitened, rcond=None)
    rest = max(float(np.sum((whitened - A @ more) ** 2)), 1e-300)
    gain = float(np.sum(whitened**2)) - rest
    dof = 6.0 * n - AFFINE_PARAMETERS
    added = AFFINE_PARAMETERS - RIGID_PARAMETERS
    if dof < 1.0 or float(fdtrc(added, dof, gain / added / (rest / dof))) > SIGNIFICANCE:
        return []
    B = np.asarray(np.linalg.lstsq(A, readings.wrench, rcond=None)[0].T, dtype=np.float64)
    text = (
        f"no rigid tool explains these readings (chance under 0.1 %): their force matrix has the singular values "
        f"{force_matrix(B)} N, a rigid tool's three equal ones; unequal gains, cross-talk or a cable: compare "
        "--model affine"
    )
    return [Finding.doubtful(Kind.CROSS_TALK, text)]


def contradicts_prior(fit: RigidEstimate, question: Question) -> list[Finding]:
    """That readings and the earlier calibration do not go together."""
    from scipy.special import chdtrc

    known = rows_of(question.knowledge, fit.tool, fit.names)
    off = 0.0 if known is None else float(known.residuals @ known.residuals)
    rows = 1 if known is None else len(known.residuals)
    if fit.reduced_chi2 <= STATED_NOISE_RATIO and float(chdtrc(float(rows), off)) > SIGNIFICANCE:
        return []
    text = (
        "the poses contradict the earlier calibration: tool, mounting or base changed, or the tool touches something; "
        "calibrate anew, without --prior"
    )
    return [Finding.weak(Kind.CONTRADICTS_PRIOR, text)]


def segments_left_out(recorded: RecordedPoses, since: float) -> tuple[Finding, ...]:
    """That still segments of a stream are no pose; the longest with their reasons, times counted from `since` (s)."""
    rejected = recorded.rejected
    if not rejected:
        return ()
    longest = sorted(sorted(rejected, key=lambda pose: -pose.n)[:MOST_SEGMENTS_NAMED], key=_start)
    named = "; ".join(f"t = {_start(pose) - since:.6g} s, {pose.rejected}" for pose in longest)
    more = f"; {len(rejected) - len(longest)} more" if len(rejected) > len(longest) else ""
    stood = len(rejected) + recorded.segments
    text = f"{len(rejected)} of {stood} stretches in which the arm stood were left out: {named}{more}"
    if recorded.moved <= MOST_MOVED * stood:
        return (Finding(Kind.STILL_SEGMENTS_LEFT_OUT, Severity.REFUSED, text),)
    doubt = "do wrench and pose belong together in time, and was the tool let alone?"
    return (Finding.weak(Kind.STILL_SEGMENTS_LEFT_OUT, f"{text}; {doubt}"),)


def on_the_way(recorded: RecordedPoses) -> tuple[Finding, ...]:
    """That the arm stopped at too few orientations, and how many of the poses are of its slow motion."""
    if not recorded.on_the_way:
        return ()
    text = (
        f"{recorded.on_the_way} of {len(recorded.poses)} poses are parts of a slow motion, "
        f"{recorded.segments} still stretches were found: a stop of two seconds at each orientation tells more"
    )
    return (Finding(Kind.POSES_ON_THE_WAY, Severity.WARNING, text),)


def _start(pose: Pose) -> float:
    return 0.0 if pose.t_start is None else pose.t_start


def reasons_left_out(estimate: Estimate) -> tuple[str | None, ...]:
    """Why each pose was left out, None where it was kept."""
    return tuple(
        None if kept else _reason(error, estimate.noise)
        for error, kept in zip(estimate.errors, estimate.kept, strict=True)
    )


def _reason(error: Array, noise: Array) -> str:
    force, torque = float(np.linalg.norm(error[:3])), float(np.linalg.norm(error[3:]))
    return (
        f"{two_digits(force)} N and {two_digits(1e3 * torque)} mN m off what the other poses explain, "
        f"{float(np.linalg.norm(error / noise)):.0f} std: in contact, bumped, or read before the arm was still"
    )


def outliers_and_drift(estimate: Estimate, poses: tuple[Pose, ...], since: float) -> tuple[Finding, ...]:
    """Poses left out, up to `MOST_NAMED` by name, those in doubt, and how the bias moved; times count from `since`."""
    beliefs = estimate.beliefs if isinstance(estimate, RigidEstimate) else None
    if beliefs is None:
        return ()
    names = [_name(k, pose, since) for k, pose in enumerate(poses)]
    reasons = reasons_left_out(estimate)
    texts = [f"{names[k]} was left out: {reason}" for k, reason in enumerate(reasons) if reason is not None]
    if len(texts) > MOST_NAMED:
        texts[MOST_NAMED:] = [f"{len(texts) - MOST_NAMED} more poses were left out for the same reason"]
    findings = [Finding(Kind.POSE_LEFT_OUT, Severity.REFUSED, text) for text in texts]
    findings += _poses_in_doubt(estimate, beliefs, names)
    findings += _bias_moved(beliefs, names, poses)
    took = 1.0 - float(estimate.kept.mean())
    if took > LARGE_SHARE:
        text = f"{int(np.sum(~estimate.kept))} of {len(poses)} poses were left out: record more, free of contact"
        findings.append(Finding.doubtful(Kind.POSE_LEFT_OUT, text))
    return tuple(findings)


def _poses_in_doubt(estimate: Estimate, beliefs: Beliefs, names: list[str]) -> list[Finding]:
    """Poses that nearly were left out, or nearly were not, and a last one whose error may be a step of the bias."""
    found = []
    for k, probability in enumerate(beliefs.outlying):
        if 1.0 / RIVAL_ODDS < probability < 1.0 - 1.0 / RIVAL_ODDS:
            text = (
                f"{names[k]} may be in contact, with a probability of {_percent(float(probability))}: the result "
                "counts both cases; record that orientation again"
            )
            found.append(Finding.doubtful(Kind.POSE_IN_DOUBT, text))
    if not estimate.kept[-1] and len(names) > 1:
        text = (
            f"{names[-1]}, the last one, was left out: if the bias stepped there instead, it is off by that; record "
            "one more pose"
        )
        found.append(Finding.doubtful(Kind.POSE_IN_DOUBT, text))
    return found


def _bias_moved(beliefs: Beliefs, names: list[str], poses: tuple[Pose, ...]) -> list[Finding]:
    moved = sum(beliefs.moved.values())
    if beliefs.drift is None or beliefs.drift.kind is None or moved < 0.5:
        return []
    text = in_words(beliefs.drift, beliefs.change, moved, names, poses[0].t_start, poses[-1].t_end)
    after = len(names) - (beliefs.drift.first_after or 0)
    if beliefs.drift.kind is Kind.BIAS_STEPPED and after <= LIKE_CONTACTS * len(names):
        text += "; poses that touch something alike would look the same: record more after it"
    elif moved >= 1.0 - 1.0 / RIVAL_ODDS:
        return [Finding(beliefs.drift.kind, Severity.WARNING, text)]
    return [Finding.doubtful(beliefs.drift.kind, text)]


def _name(k: int, pose: Pose, since: float) -> str:
    return f"pose {k + 1}" + ("" if pose.t_start is None else f" (t = {pose.t_start - since:.6g} s)")


def assumptions_in_words(estimate: RigidEstimate, question: Question) -> tuple[str, ...]:
    """One sentence on the mounting, one on the base."""
    tool, beliefs, priors = estimate.tool, estimate.beliefs, question.priors
    if beliefs is None or question.model != "auto" or question.earlier is not None:
        return ()
    side = "along" if tool.R_flange_sensor[2, 2] >= 0.0 else "against"
    tilt, lean = (
        _angle(abs(float(tool.R_flange_sensor[2, 2]))),
        _angle(float(tool.gravity_direction @ question.gravity_direction)),
    )
    if priors.mount is None:
        of_mounting = f"mounting: as known; sensor's z is found {tilt:.2f} deg off the flange's"
    elif beliefs.any_mounting > 0.5:
        of_mounting = (
            f"mounting: sensor's z is {tilt:.1f} deg off the flange's, {_overruled(beliefs.any_mounting, priors.mount)}"
        )
    else:
        of_mounting = (
            f"mounting: sensor's z {side} the flange's, {_an_axis(priors.mount)}; found {tilt:.2f} deg off, exactly "
            f"parallel has a probability of {_percent(beliefs.mounting_exact)}"
        )
    if priors.base is None:
        of_base = f"base: as known; gravity is found {lean:.2f} deg off that direction"
    elif beliefs.any_base > 0.5:
        of_base = (
            f"base: gravity is {lean:.1f} deg off the stated direction, {_overruled(beliefs.any_base, priors.base)}"
        )
    else:
        of_base = (
            f"base: gravity in the stated direction, {_an_axis(priors.base)}; found {lean:.2f} deg off, exactly "
            f"level has a probability of {_percent(beliefs.base_exact)}"
        )
    return of_mounting, of_base


def _an_axis(sd: float) -> str:
    return f"+- {np.rad2deg(sd):.3g} deg an axis"


def _overruled(probability: float, sd: float) -> str:
    return f"not within {np.rad2deg(sd):.3g} deg an axis (probability {_percent(min(probability, 0.999))})"


def _angle(cosine: float) -> float:
    return float(np.rad2deg(np.arccos(np.clip(cosine, -1.0, 1.0))))


def _percent(probability: float) -> str:
    return f"{100.0 * probability:.3g} %"
