"""One estimate from clean poses, by the model that is asked for, with the checks that make it worth returning.

A fit is handed on only if the poses separate every parameter, something is left to estimate the noise from, and the
readings do not contradict the sign or the side of the base that they were given with: free air cannot tell those two
apart (method, section 4b). Negating force and torque of an upright robot gives exactly the data of a robot that hangs
from the ceiling; a mirrored axis looks the same, with another mounting. So such readings are refused, both ways to
understand them named. Where they fit both ways alike, as they do when gravity's directions all lie in one plane of the
sensor, what was stated is taken, and a finding says that it was not confirmed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..calibration.fields import Alternative, Finding, Kind, Severity
from ..calibration.observability import require_full_rank, require_separable
from ..errors import AmbiguityError, UnobservableError
from ..geometry.arrays import Array
from ..model import PARAMETERS, RigidTool, gravity_in_flange
from .auto import AutoFit, fit_auto, tilt_priors
from .initial_guess import SEARCH_OF_MODEL, explained_by_guess
from .least_squares import LEAST_LEFT, Fit
from .noise import PoseReadings, StatedNoise
from .paper import fit_paper
from .priors import Knowledge, Question, rows_of
from .rigid import RigidProblem, finished_rigid, fit_affine, fit_rigid, solved_from

FEWEST_POSES_WITH_BASE = 4
MODEL_OF_AUTO = "mount+base"
HELD_GRAVITY = ("yaw", "mount")
MIRRORED = Finding(
    Kind.MIRRORED_AXIS,
    Severity.WEAK,
    "weak: the force matrix A mirrors: an axis has the wrong sign, or the sensor reports the reaction",
)
OTHER_MODELS = ("yaw", "mount", "mount+base", "affine")
PAPER_HINT = "the paper's model takes the sensor's z along the flange's (--model mount finds any mounting); or "
SIGNIFICANCE = 0.001
NEAR_TIE = 0.9
SURE_SIDE = 4.0
SURE_WEIGHT = 3.0
"""Standard deviations: a fit whose weight is less sure explains nothing, so that a tie with it says nothing either."""

NOT_CONFIRMED = Finding(
    Kind.SIGN_NOT_CONFIRMED,
    Severity.WARNING,
    "the sign of the readings is taken as given: the negated readings fit as well, mostly because gravity's directions "
    "lie close to one plane of the sensor; confirm it by a push, or tilt the tool about another axis",
)


@dataclass(frozen=True, eq=False)
class Estimate:
    """A fit of the parameters `names`, the `knowledge` that joined the readings, and what there is to say of it; `auto`
    where that made it, `weight_xy` and `weight_z` by the paper.
    """

    fit: Fit
    names: tuple[str, ...]
    knowledge: tuple[Knowledge, ...] = ()
    findings: tuple[Finding, ...] = ()
    auto: AutoFit | None = None
    weight_xy: float | None = None
    weight_z: float | None = None


def fitted(readings: PoseReadings, question: Question) -> Estimate:
    """The fit alone, as it comes."""
    stated, noise = question.gravity_direction, question.noise
    names = PARAMETERS[model_fitted(question.model)]
    if question.model == "paper":
        paper = fit_paper(readings, stated)
        return Estimate(paper.fit, names, weight_xy=paper.weight_xy, weight_z=paper.weight_z)
    if question.model == "affine":
        r = gravity_in_flange(readings.R_base_flange, stated)
        columns = np.column_stack([r, np.ones(len(r))])
        columns_of_B = ("B_*_rx", "B_*_ry", "B_*_rz", "B_*_1")
        require_separable(columns, columns_of_B, readings.R_base_flange, stated)
        return Estimate(fit_affine(readings, stated, noise), names)
    if question.earlier is not None:
        problem = RigidProblem(readings.R_base_flange, readings.wrench, names, question.knowledge)
        tool, solved = solved_from(problem, [question.earlier], readings, noise)
        return Estimate(finished_rigid(tool, names, solved), names, question.knowledge)
    if question.model == "auto":
        auto = fit_auto(readings, question)
        tilts = tilt_priors(auto.assumption, question)
        return Estimate(auto.fit, names, (*question.knowledge, *(tilt for tilt, _ in tilts)), auto=auto)
    fit = fit_rigid(readings, question.model, stated, noise, question.knowledge)
    return Estimate(fit, names, question.knowledge)


def model_fitted(model: str) -> str:
    """The model whose parameters another one estimates."""
    return MODEL_OF_AUTO if model == "auto" else model


def checked(estimate: Estimate, readings: PoseReadings, as_recorded: PoseReadings, question: Question) -> Estimate:
    """The estimate from `readings` with what there is to say of it. Raises `UnobservableError` and `AmbiguityError`
    where it may not be returned. The sign is judged on the readings `as_recorded`: whoever leaves out enough explains
    any sign.
    """
    stated = question.gravity_direction
    fit = estimate.fit
    if estimate.weight_z is not None:
        findings = check_sign(fit_rigid(readings, "yaw", stated, None), readings, "yaw", stated, None)
        require_positive_weight(estimate.weight_z, stated, PAPER_HINT)
    elif fit.tool is None:
        _require_noise(readings, 24, fit.readings_left, question)
        findings = (MIRRORED,) if np.linalg.det(fit.B[:3, :3]) < 0.0 else ()
    elif question.earlier is not None:
        require_positive_weight(fit.tool.weight, stated)
        findings = ()
    else:
        model = question.model if estimate.auto is None else _model_freed(estimate.auto)
        findings = _checked(fit, readings, as_recorded, model, question)
    return replace(estimate, findings=findings)


def _model_freed(auto: AutoFit) -> str:
    """The model whose rotations are free under the assumptions that `auto` kept."""
    if not auto.assumption.nominal_base:
        return "mount+base"
    return "yaw" if auto.assumption.nominal_mounting else "mount"


def _checked(
    fit: Fit, readings: PoseReadings, as_recorded: PoseReadings, model: str, question: Question
) -> tuple[Finding, ...]:
    """What to say of a rigid fit whose free rotations are those of `model`. Raises where it may not be returned."""
    require_answerable(fit, readings, model, question)
    tool, stated = fit.rigid_tool, question.gravity_direction
    if model not in HELD_GRAVITY:
        require_stated_side(tool, stated, float(np.sqrt(np.linalg.eigvalsh(fit.covariance[-2:, -2:])[-1])))
    if as_recorded is not readings:
        check_sign(fit, as_recorded, model, stated, question.noise)
    findings = check_sign(fit, readings, model, stated, question.noise)
    require_positive_weight(tool.weight, stated)
    return findings


def require_answerable(fit: Fit, readings: PoseReadings, model: str, question: Question) -> None:
    """Raise `UnobservableError` unless the poses separate the parameters of a rigid `model`, and leave its noise some
    readings.
    """
    tool, names, stated = fit.rigid_tool, PARAMETERS[model], question.gravity_direction
    known = rows_of(question.knowledge, tool, names)
    if model in HELD_GRAVITY:
        tool = replace(tool, gravity_direction=stated)  # a tilt that the prior lets in is not what separates
    require_full_rank(tool, readings.R_base_flange, names, None if known is None else known.jacobian)
    if model == "mount+base" and known is None and len(readings) < FEWEST_POSES_WITH_BASE:
        raise UnobservableError(
            f"found {len(readings)} distinct orientations, expected {FEWEST_POSES_WITH_BASE} or more for mount+base: "
            "with fewer, several tools and bases fit alike; record 6 or more that turn about two axes"
        )
    left = fit.readings_left if fit.linear is None else fit.linear.least_left
    _require_noise(readings, len(names), left, question)
    if not fit.singular_values[-1] > 0.0:
        raise UnobservableError(
            "the readings do not tell the parameters apart: they hardly change from pose to pose; check that the "
            "columns hold what the sensor read"
        )


def _require_noise(readings: PoseReadings, parameters: int, left: float, question: Question) -> None:
    n = len(readings)
    if question.noise is None and left < LEAST_LEFT:
        raise UnobservableError(
            f"{n} poses give {6 * n} readings for {parameters} parameters: nothing is left to estimate the noise "
            "from; record more poses, or give noise"
        )


def alternatives_to(readings: PoseReadings, question: Question) -> tuple[Alternative, ...]:
    """What the other models make of the same poses; those that the poses cannot tell are left out."""
    alternatives = []
    for model in OTHER_MODELS:
        as_asked = replace(question, model=model)
        try:
            fit = fitted(readings, as_asked).fit
            if fit.tool is not None:
                require_answerable(fit, readings, model, as_asked)
        except UnobservableError:
            continue
        freedom = max(fit.readings_left, LEAST_LEFT) / 6.0
        force, torque = (np.sqrt(np.sum(part**2) / freedom) for part in np.hsplit(fit.residuals, 2))
        alternatives.append(
            Alternative(
                model=model,
                weight=None if fit.tool is None else fit.tool.weight,
                weight_std=None if fit.tool is None else float(np.sqrt(fit.covariance[0, 0])),
                force_left=float(force),
                torque_left=float(torque),
                B=fit.B,
                gravity_direction=fit.gravity_direction,
            )
        )
    return tuple(alternatives)


def check_sign(
    fit: Fit, readings: PoseReadings, model: str, gravity_direction: Array, noise: StatedNoise | None
) -> tuple[Finding, ...]:
    """Refuse readings that a tool explains much better once they are negated (or, the same, gravity is).

    `model` yaw, mount or mount+base is fitted to the negated readings; arguments as for `fit_rigid`. Returns a
    finding where both fit alike, else nothing. Raises `AmbiguityError` naming both interpretations.
    """
    R, wrench = readings.R_base_flange, readings.wrench
    as_given = explained_by_guess(R, wrench, SEARCH_OF_MODEL[model], gravity_direction)
    if explained_by_guess(R, -wrench, SEARCH_OF_MODEL[model], gravity_direction) < NEAR_TIE * as_given:
        return ()
    rival = fit_rigid(readings, model, gravity_direction, noise, sign=-1.0)
    dof = max(6 * len(readings) - len(PARAMETERS[model]), 1)
    left, left_negated = (
        float(np.sqrt(np.mean(np.sum(e[:, :3] ** 2, axis=1)))) for e in (fit.residuals, rival.residuals)
    )
    if left_negated < 0.5 * left and _fits_worse(fit.residuals, rival, dof):
        raise AmbiguityError(
            f"a tool explains these readings only with a negative weight: {left:.3g} N are left as given, "
            f"{left_negated:.3g} N with force and torque negated; either the sensor reports the reaction (--sign "
            f"reaction), or gravity points the other way (--gravity {negated(gravity_direction)}), or one axis is "
            "mirrored; free air cannot tell, one push by hand can"
        )
    explained = fit.tool is not None and fit.tool.weight > SURE_WEIGHT * float(np.sqrt(fit.covariance[0, 0]))
    on_stated_side = rival.gravity_direction @ gravity_direction >= 0.0
    tie = explained and on_stated_side and not _fits_worse(rival.residuals, fit, dof)
    return (NOT_CONFIRMED,) if tie else ()


def require_stated_side(tool: RigidTool, stated: Array, std: float) -> None:
    """Raise `AmbiguityError` if gravity was found surely more than 90 deg from the stated direction (3,): a robot on a
    wall is right there, give or take `std` rad.
    """
    angle = np.rad2deg(np.arccos(np.clip(tool.gravity_direction @ stated, -1.0, 1.0)))
    if angle > 90.0 + SURE_SIDE * np.rad2deg(std):
        found = ",".join(f"{part:.3f}" for part in tool.gravity_direction)
        raise AmbiguityError(
            f"gravity comes out {angle:.0f} deg from the stated direction: either the sensor reports the reaction "
            f"(--sign reaction), or the base is mounted that way (--gravity {found}); free air cannot tell, one push "
            "by hand can"
        )


def require_positive_weight(weight: float, gravity_direction: Array, hint: str = "") -> None:
    """Raise `AmbiguityError` for a weight (N) that is not above zero; `hint` is one of the model's own."""
    if weight <= 0.0:
        raise AmbiguityError(
            f"the weight comes out as {weight:.3g} N, expected above 0: {hint}either the sensor reports the reaction "
            f"(--sign reaction), or gravity points the other way (--gravity {negated(gravity_direction)}), or the "
            "poses cannot tell; one push by hand decides"
        )


def negated(direction: Array) -> str:
    """The opposite direction as the flag --gravity takes it."""
    return ",".join(f"{-part + 0.0:g}" for part in direction)


def _fits_worse(residuals: Array, other: Fit, dof: int) -> bool:
    """Whether `residuals` (n, 6) exceed those of `other`, in units of its noise, by more than chance (F test)."""
    from scipy.special import fdtri

    noise = np.maximum(other.noise, 1e-9 * float(np.abs(residuals).max()) + 1e-300)
    own, least = float(np.sum((residuals / noise) ** 2)), float(np.sum((other.residuals / noise) ** 2))
    return own > float(fdtri(dof, dof, 1.0 - SIGNIFICANCE)) * least
