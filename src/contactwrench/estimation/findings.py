"""What a result cannot be trusted with, why, and what would mend it.

Findings are rows of tables: whether it is so, how bad that is, of what kind, and one sentence. What has to be computed
first stands above its table.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from typing import TypeAlias

import numpy as np

from ..calibration.findings import WEAK_SHARE, Finding, Kind, Severity
from ..calibration.observability import advice_on_poses, natural_jacobian
from ..geometry.arrays import Array
from ..geometry.rotations import spread_rotations
from ..model import AXES, affine_jacobian, gravity_in_flange, wrench_jacobian
from .bias_drift import MOST_STOPS
from .estimate import Estimate, RigidEstimate, alike_to_the_next
from .noise import PoseReadings
from .plausibility import LIGHTEST_TOOL, LIKELIEST_CAUSE, implausible, tilts_widely
from .priors import Question

WEIGHT_SHARE, BIAS_SHARE, POOR_SHARE, MISREAD_SHARE = 0.10, 0.10, 0.10, 0.4
"""Of the weight: the largest std of the weight itself and of a force bias that are no weakness; where more than the
third is left in a pose, or the others miss it by more than the last, something is wrong."""

SENSOR_NOISE, BY_CHANCE = 0.1, 1.5
"""N, an axis of an ordinary sensor in a pose, and times as much that few poses may leave of it: under a light tool that
is no sign of a file that is read wrongly. Of 336 light tools read wrongly none was believed for it.
"""

COM_STD = 0.010
FEWEST_DOF = 3.0
NOISE_RATIO, STATED_NOISE_RATIO = 10.0, 5.0
ALIKE = 0.5
"""Correlation of what is left in poses that follow each other, up to which a std is at most 1.7 times too small."""

ALIKE_SHOWS = 3.3
"""Standard deviations of that correlation: on the way forces say one thing, and torques; of a bias each axis does."""

FAR_MORE = 3.0
"""Times what all poses leave."""
FEWEST_IN_A_ROW = 12
SIGNIFICANCE, SIGNIFICANCE_OF_GAIN = 0.001, 0.01
"""Of a force matrix of its own; of an axis' gain, which in a cone shows little and is wrong all the more beyond."""

DAMAGED = 0.05
"""Share of the load by which an axis' own gain is off that no sensor leaves the factory with."""

FEWEST_POSES_FOR_MATRIX = 5
AFFINE_PARAMETERS, RIGID_PARAMETERS = 24.0, 13.0
WELL_SPREAD = 0.1
"""Poses whose least singular value, relative to the largest, is above this are not what makes a fit weak."""

OF_READING = (Kind.POOR_FIT, Kind.IMPLAUSIBLE_TOOL)
"""Of a file that is read wrongly: where no tool is found and less is left than one weighs, no reading mends that."""

Row: TypeAlias = tuple[bool, Callable[[Kind, str], Finding], Kind, str]
WEAK, DOUBTFUL = Finding.weak, Finding.doubtful
NOTE, WARNING, REFUSED = (
    partial(lambda severity, kind, text: Finding(kind, severity, text), severity)
    for severity in (Severity.NOTE, Severity.WARNING, Severity.REFUSED)
)


def those_that_hold(rows: Iterable[Row]) -> list[Finding]:
    """The findings of a table."""
    return [of_severity(kind, text) for holds, of_severity, kind, text in rows if holds]


def doubts(
    estimate: Estimate, readings: PoseReadings, question: Question, trade_offs: tuple[str, ...]
) -> list[Finding]:
    """What an estimate from `readings`, those kept, cannot be trusted with."""
    of_payload: list[Finding] = []
    stated = question.noise is not None and question.model != "paper"
    rows = _uncertain_noise(estimate, stated)
    if isinstance(estimate, RigidEstimate) and question.earlier is None:
        of_payload = _subtracted_payload(estimate, readings)
        rows.append(_cross_talk(estimate, readings))
        if question.model != "paper":  # which takes one axis' weight for all
            rows.append(_gain_of_axis(estimate, readings))
    uncertain = uncertain_parameters(estimate, readings, trade_offs)
    of_sensor = not uncertain and _is_as_of_a_sensor(estimate, readings)
    if question.earlier is None and not (estimate.reduced_chi2 < STATED_NOISE_RATIO if stated else of_sensor):
        rows.append(poor_fit(estimate))
    rows.append(_correlated_poses(estimate, readings))
    if question.earlier is None:
        rows.append(_unconfirmed(estimate))
        text = "no pose can be left out for a held-out error: record more poses"
        rows.append((estimate.held_out is None, NOTE, Kind.NO_HELD_OUT_ERROR, text))
    found = [*those_that_hold(rows), *(implausible(estimate, question) if question.earlier is None else ())]
    if any(finding.severity is Severity.WEAK for finding in of_payload):
        too_little = estimate.force_left < LIGHTEST_TOOL
        return of_payload + [finding for finding in found if not (too_little and finding.kind in OF_READING)]
    return of_payload + uncertain + found


def _subtracted_payload(fit: RigidEstimate, readings: PoseReadings) -> list[Finding]:
    """Next to no weight, though the poses would show one."""
    weight, std = fit.tool.weight, float(np.sqrt(fit.covariance[0, 0]))
    if abs(weight) >= LIGHTEST_TOOL or not tilts_widely(readings.R_base_flange, fit.tool.gravity_direction):
        return []
    found = f"weight {weight:.2g} +- {std:.2g} N is next to nothing, though the poses tilt the tool"
    if std > WEIGHT_SHARE * weight:
        return [WEAK(Kind.PAYLOAD_SUBTRACTED, f"{found}: {LIKELIEST_CAUSE}")]
    return [NOTE(Kind.PAYLOAD_SUBTRACTED, f"{found}; if it weighs more, {LIKELIEST_CAUSE}")]


def uncertain_parameters(fit: Estimate, readings: PoseReadings, trade_offs: tuple[str, ...]) -> list[Finding]:
    """A weight known to worse than 10 %, a com to worse than 10 mm, a force bias to worse than 10 % of the weight, each
    with what it trades off with; the contact force, where none of these says it; then what would mend the first.

    `affine` has no weight; the mean singular value of its force matrix stands in.
    """
    weight, of_tool = fit.weight_scale, []
    if isinstance(fit, RigidEstimate):
        weight, std = fit.tool.weight, np.sqrt(np.diag(fit.covariance))
        none = f"weight {weight:.2g} +- {std[0]:.2g} N is not above zero, so com and mounting mean nothing"
        of_tool = [
            (std[0] > weight, "weight", none),
            (std[0] > WEIGHT_SHARE * weight, "weight", f"weight {weight:.3g} +- {std[0]:.2g} N, a std over 10 %"),
            *(
                (s > COM_STD, f"com_{x}", f"com_{x} has a std of {1e3 * s:.1f} mm, over 10 mm")
                for x, s in zip("xyz", std[1:4], strict=True)
            ),
        ]
    of_bias = [
        (s > BIAS_SHARE * weight, f"bias_f{x}", f"bias_f{x} has a std of {s:.2g} N, over 10 % of the weight")
        for x, s in zip("xyz", np.sqrt(np.diag(fit.B_covariance)[3:12:4]), strict=True)
    ]
    uncertain = [(name, text) for holds, name, text in (*of_tool, *of_bias) if holds]
    if of_tool and of_tool[0][0]:
        uncertain = uncertain[:1]
    elif not uncertain and (largest := largest_force_std(fit)) > WEAK_SHARE * weight:
        text = f"the contact force has a std of {largest:.2g} N at some orientations, over 10 % of the weight"
        uncertain = [("contact force", text)]
    if not uncertain:
        return []
    return [
        *(WEAK(Kind.UNCERTAIN_PARAMETER, _with_rival(name, text, trade_offs)) for name, text in uncertain),
        NOTE(Kind.ADVICE, _advice(fit, readings, uncertain[0][0])),
    ]


def _with_rival(name: str, text: str, trade_offs: tuple[str, ...]) -> str:
    """What is uncertain, with what it trades off with most."""
    rivals = [pair for pair in trade_offs if name in pair.split(": ")[0].split(" and ")]
    return f"{text} ({rivals[0]})" if rivals else text


def largest_force_std(fit: Estimate) -> float:
    """The largest std (N) of the contact force over orientations, a norm over three axes, within a few percent."""
    R = spread_rotations(48, 12)
    r, variance = gravity_in_flange(R, fit.gravity_direction), np.zeros(len(R))
    J = (wrench_jacobian(fit.tool, R, fit.names) if isinstance(fit, RigidEstimate) else affine_jacobian(r))[:, :3]
    if isinstance(fit, RigidEstimate) and fit.gain_covariance is not None:
        A, of_axes = np.column_stack([r, np.ones(len(r))]), fit.gain_covariance.reshape(6, 4, 6, 4)
        variance += np.sum((A @ of_axes[range(3), :, range(3)].sum(axis=0)) * A, axis=1)
    variance += np.sum(np.tensordot(J, fit.covariance, 1) * J, axis=(1, 2))
    return float(np.sqrt(max(variance.max(), 0.0)))  # gains may lessen it in places


def _advice(fit: Estimate, readings: PoseReadings, weakest: str) -> str:
    """Where the poses are at fault, why, and what one more would give; else a better reading of the data."""
    if weakest.startswith("bias") and not fit.kept[-1]:
        return "the last pose was left out: if the bias stepped before it, the one given is wrong: record one more pose"
    s: Array = fit.singular_values
    tool = fit.tool if isinstance(fit, RigidEstimate) else None
    if tool is not None:
        s = np.asarray(np.linalg.svd(natural_jacobian(tool, readings.R_base_flange, fit.names), compute_uv=False))
    if s[-1] < WELL_SPREAD * s[0]:
        return advice_on_poses(tool, fit.covariance, fit.noise, fit.names, weakest, readings.R_base_flange)
    return (
        f"the poses are well spread, yet {fit.force_left:.2g} N and {1e3 * fit.torque_left:.2g} mN m are left in them: "
        "check that the arm was still and free, and try contactwrench diagnose; a light tool needs more poses"
    )


def _uncertain_noise(fit: Estimate, stated: bool) -> list[Row]:
    """Poses that differ far more than the noise that was stated for them; or, where none was, standard deviations that
    rest on few degrees of freedom, and an axis that the model explains far better than its neighbour.
    """
    ratio, fewest = float(np.sqrt(fit.reduced_chi2)), float(fit.dof.min())
    if stated:
        beyond = (
            f"the residuals are {ratio:.0f} times the given noise: check the noise, the model and each pose, every std "
            "was enlarged by that factor"
        )
        return [(ratio > STATED_NOISE_RATIO, WEAK, Kind.BEYOND_STATED_NOISE, beyond)]
    few = (
        f"every std rests on {np.floor(10.0 * fewest) / 10.0:g} degrees of freedom, under {FEWEST_DOF:g}, and may be "
        "far off: record more poses"
    )
    rows: list[Row] = [(0.0 < fewest < FEWEST_DOF, WEAK, Kind.FEW_DEGREES_OF_FREEDOM, few)]
    for group in (slice(0, 3), slice(3, 6)):
        noise, axes = fit.noise[group], AXES[group]
        low, high = int(np.argmin(noise)), int(np.argmax(noise))
        ratio = float(noise[high] / noise[low]) if noise[low] > 0.0 else 0.0
        unequal = (
            f"{axes[high]} is left {ratio:.0f} times noisier than {axes[low]}: either that axis is, or this model "
            "does not hold and every std is too small: compare the other models"
        )
        rows.append((ratio > NOISE_RATIO, WEAK, Kind.UNEQUAL_NOISE, unequal))
    return rows


def _is_as_of_a_sensor(fit: Estimate, readings: PoseReadings) -> bool:
    """Whether as little force is left as a sensor's noise and the digits of its readings leave, under any tool."""
    of_axes = np.maximum(readings.least_variance[:3], SENSOR_NOISE**2)
    return bool(fit.force_left < BY_CHANCE * np.sqrt(np.sum(of_axes)))


def poor_fit(fit: Estimate) -> Row:
    """Far more is left than a sensor and an arm explain, or of a pose left out: most often a file is read wrongly."""
    left, missed = (off / max(fit.weight_scale, 1e-300) for off in (fit.force_left, fit.force_missed))
    of_fit = f"{fit.force_left:.2g} N are left in the poses, {100.0 * left:.0f} % of the weight"
    text = (
        f"{of_fit if left > POOR_SHARE else 'each pose explains itself'}: the file may be read wrongly (orientation, "
        "sign, units); contactwrench diagnose tries the other ways to read it"
    )
    return max(left / POOR_SHARE, missed / MISREAD_SHARE) > 1.0, WEAK, Kind.POOR_FIT, text


def _unconfirmed(fit: Estimate) -> Row:
    """Left out, poses are missed far: with what else there may be, each explains itself."""
    share = (missed := fit.force_missed) / max(fit.weight_scale, 1e-300)
    text = (
        f"the other poses miss what a pose reads by {missed:.2g} N, {100.0 * share:.0f} % of the weight, though all "
        "together leave far less: nothing confirms what explains them; check the orientations, and record more poses"
    )
    return share > POOR_SHARE and missed > FAR_MORE * fit.force_left, DOUBTFUL, Kind.UNCONFIRMED, text


def _correlated_poses(fit: Estimate, readings: PoseReadings) -> Row:
    """What is left in one pose is left in the next as well: poses are taken for independent, which rows on the way are
    not, and no std holds; or a bias moved that nothing follows. Alike may be what is counted: the robot's errors.
    """
    n = len(fit.residuals)
    of_axes = alike_to_the_next(fit.beyond_robot if len(readings) <= MOST_STOPS else fit.residuals)
    alike, of_one = float(of_axes.mean()), float(of_axes.max())
    worth = n * (1.0 - alike) / max(1.0 + alike, 1e-300)
    found = "what is left in one pose is left in the next too (correlation"
    text = (
        f"{found} {alike:.2f}), as in rows taken while the arm moves: these {n} poses tell as much as "
        f"{max(worth, 1.0):.0f}, and every std is too small: stop at each orientation, and give the times in a column t"
    )
    if n >= FEWEST_IN_A_ROW and alike > max(ALIKE, ALIKE_SHOWS / np.sqrt(2.0 * n)):
        return True, WEAK, Kind.CORRELATED_POSES, text
    text = f"{found} {of_one:.2f}), as of a bias that moves, or a cable: give the times (a column t)"
    shows = readings.in_order < 1.0 and max(alike * np.sqrt(6.0), of_one) * np.sqrt(n) > ALIKE_SHOWS
    return shows, DOUBTFUL, Kind.DRIFT_IN_DOUBT, text


def _cross_talk(fit: RigidEstimate, readings: PoseReadings) -> Row:
    """A force matrix of its own for each axis explains far more than a rigid tool can (F test)."""
    from scipy.special import fdtrc

    n = len(readings)
    A = np.column_stack([gravity_in_flange(readings.R_base_flange, fit.gravity_direction), np.ones(n)])
    whitened = fit.beyond_robot / fit.noise
    rest = float(np.sum((whitened - A @ np.linalg.lstsq(A, whitened, rcond=None)[0]) ** 2))
    gain = float(np.sum(whitened**2)) - rest
    dof, added = 6.0 * n - AFFINE_PARAMETERS, AFFINE_PARAMETERS - RIGID_PARAMETERS
    left = max(rest / max(dof, 1.0), float(np.mean(readings.least_variance / fit.noise**2)))
    shows = n >= FEWEST_POSES_FOR_MATRIX and float(fdtrc(added, dof, gain / added / left)) <= SIGNIFICANCE
    B = np.asarray(np.linalg.lstsq(A, readings.wrench - fit.change[fit.kept], rcond=None)[0].T, dtype=np.float64)
    values = ", ".join(f"{value:.4g}" for value in np.linalg.svd(B[:3, :3], compute_uv=False))
    text = (
        f"no rigid tool explains these readings (chance under 0.1 %): their force matrix has the singular values "
        f"{values} N, a rigid tool's three equal ones; unequal gains, cross-talk or a cable: compare --model affine"
    )
    return shows, DOUBTFUL, Kind.CROSS_TALK, text


def _gain_of_axis(fit: RigidEstimate, readings: PoseReadings) -> Row:
    """What a rigid tool leaves of an axis goes as its load does (F test, against what else is left of that axis alone):
    that the axis reads a share of it only would pass for its noise.
    """
    from scipy.special import fdtrc

    n = len(readings)
    load = gravity_in_flange(readings.R_base_flange, fit.gravity_direction) @ fit.B[:, :3].T
    load, left = load - load.mean(axis=0), fit.residuals - fit.residuals.mean(axis=0)
    size = np.maximum(np.sum(load**2, axis=0), 1e-300)
    share = np.sum(left * load, axis=0) / size
    rest = np.sum((left - share * load) ** 2, axis=0) / max(n - 2.0, 1.0)
    std = np.sqrt(np.maximum(rest, readings.least_variance) / size)
    chances = 6.0 * fdtrc(1.0, n - 2.0, (share / std) ** 2)
    axis = int(np.argmin(np.where(np.abs(share) > DAMAGED, chances, 1.0)))
    shows = n >= FEWEST_POSES_FOR_MATRIX and abs(share[axis]) > DAMAGED and chances[axis] <= SIGNIFICANCE_OF_GAIN
    text = (
        f"{AXES[axis]} reads {1.0 + share[axis]:.2f} of the load that the other axes tell (chance under 1 %), "
        "and beyond these orientations the error grows: a dead or damaged channel, a wrong gain, or "
        "something that holds the tool: check that axis"
    )
    return bool(shows), DOUBTFUL, Kind.CROSS_TALK, text
