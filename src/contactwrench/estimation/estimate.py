"""One estimate from clean poses, by the model that is asked for, with the checks that make it worth returning.

A fit is handed on only if the poses separate every parameter, something is left to estimate the noise from, and the
readings do not contradict the sign or the side of the base that they were given with.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..calibration.observability import require_full_rank, require_separable
from ..errors import UnobservableError
from ..geometry.arrays import Array
from ..model import PARAMETERS, RigidTool, gravity_in_flange
from .affine import fit_affine
from .auto import AutoFit, TiltPriors, fit_auto, tilt_priors
from .least_squares import LEAST_LEFT, Fit, GivenNoise, PoseReadings
from .noise import GROUPS
from .paper import fit_paper
from .priors import Knowledge, rows_of
from .rigid import RigidProblem, finished_rigid, fit_rigid, solved_from
from .sign_ambiguity import check_sign, require_positive_weight, require_stated_side

FEWEST_POSES_WITH_BASE = 4
MODEL_OF_AUTO = "mount+base"
DEFAULT_PRIORS = TiltPriors()
HELD_GRAVITY = ("yaw", "mount")
PAPER_HINT = "the paper's model takes the sensor's z along the flange's (--model mount finds any mounting); or "


@dataclass(frozen=True, eq=False)
class Question:
    """What is asked of the readings: a model, and all that is known beside them.

    `gravity_direction` (3,) in base axes, stated or nominal; `noise` given or None; `priors` of the tilts, for `auto`;
    `knowledge` of the parameters; the `earlier` tool, where an earlier calibration of it is among that knowledge.
    """

    model: str
    gravity_direction: Array
    noise: GivenNoise | None = None
    priors: TiltPriors = DEFAULT_PRIORS
    knowledge: tuple[Knowledge, ...] = ()
    earlier: RigidTool | None = None


@dataclass(frozen=True, eq=False)
class Estimate:
    """A fit of the parameters `names`, the `knowledge` that joined the readings, and what there is to say of it; `auto`
    where that made it, `weight_xy` and `weight_z` by the paper.
    """

    fit: Fit
    names: tuple[str, ...]
    knowledge: tuple[Knowledge, ...] = ()
    warnings: tuple[str, ...] = ()
    auto: AutoFit | None = None
    weight_xy: float | None = None
    weight_z: float | None = None


def fitted(readings: PoseReadings, question: Question) -> Estimate:
    """The fit alone, as it comes."""
    stated, noise = question.gravity_direction, question.noise
    names = PARAMETERS[rung_fitted(question.model)]
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
        auto = fit_auto(readings, stated, noise, question.priors, question.knowledge)
        tilts = tilt_priors(auto.assumption, stated, question.priors)
        return Estimate(auto.fit, names, (*question.knowledge, *(tilt for tilt, _ in tilts)), auto=auto)
    fit = fit_rigid(readings, question.model, stated, noise, question.knowledge)
    return Estimate(fit, names, question.knowledge)


def rung_fitted(model: str) -> str:
    """The rung of the ladder whose parameters a model estimates."""
    return MODEL_OF_AUTO if model == "auto" else model


def checked(found: Estimate, readings: PoseReadings, as_recorded: PoseReadings, question: Question) -> Estimate:
    """The estimate from `readings` with its warnings. Raises `UnobservableError` and `AmbiguityError` where it may not
    be returned. The sign is judged on the readings `as_recorded`: whoever leaves out enough explains any sign.
    """
    stated = question.gravity_direction
    if found.weight_z is not None:
        warnings = check_sign(fit_rigid(readings, "yaw", stated, None), readings, "yaw", stated, None)
        require_positive_weight(found.weight_z, stated, PAPER_HINT)
    elif found.fit.tool is None:
        _require_noise(readings, 24, found.fit.readings_left, question)
        mirrors = np.linalg.det(found.fit.B[:3, :3]) < 0.0
        warning = "weak: the force matrix A mirrors: an axis has the wrong sign, or the sensor reports the reaction"
        warnings = (warning,) if mirrors else ()
    elif question.earlier is not None:
        require_positive_weight(found.fit.tool.weight, stated)
        warnings = ()
    else:
        model = question.model if found.auto is None else _rung_of(found.auto)
        warnings = _checked(found.fit, readings, as_recorded, model, question)
    return replace(found, warnings=warnings)


def _rung_of(auto: AutoFit) -> str:
    """The rung whose rotations are free under the assumptions that `auto` kept."""
    if not auto.assumption.nominal_base:
        return "mount+base"
    return "yaw" if auto.assumption.nominal_mounting else "mount"


def _checked(
    fit: Fit, readings: PoseReadings, as_recorded: PoseReadings, model: str, question: Question
) -> tuple[str, ...]:
    """Warnings of a rigid fit whose free rotations are those of `model`. Raises where it may not be returned."""
    require_answerable(fit, readings, model, question)
    tool, stated = _tool(fit), question.gravity_direction
    if model not in HELD_GRAVITY:
        require_stated_side(tool, stated, float(np.sqrt(np.linalg.eigvalsh(fit.covariance[-2:, -2:])[-1])))
    if as_recorded is not readings:
        check_sign(fit, as_recorded, model, stated, question.noise)
    warnings = check_sign(fit, readings, model, stated, question.noise)
    require_positive_weight(tool.weight, stated)
    return warnings


def require_answerable(fit: Fit, readings: PoseReadings, model: str, question: Question) -> None:
    """Raise `UnobservableError` unless the poses separate the parameters of a rigid `model`, and leave its noise some
    readings.
    """
    tool, names, stated = _tool(fit), PARAMETERS[model], question.gravity_direction
    known = rows_of(question.knowledge, tool, names)
    if model in HELD_GRAVITY:
        tool = replace(tool, gravity_direction=stated)  # a tilt that the prior lets in is not what separates
    require_full_rank(tool, readings.R_base_flange, names, None if known is None else known.jacobian)
    if model == "mount+base" and known is None and len(readings) < FEWEST_POSES_WITH_BASE:
        raise UnobservableError(
            f"found {len(readings)} distinct orientations, expected {FEWEST_POSES_WITH_BASE} or more for mount+base: "
            "with fewer, several tools and bases fit alike; record 6 or more that turn about two axes"
        )
    _require_noise(readings, len(names), _least_left_of_a_group(fit), question)
    if not fit.singular_values[-1] > 0.0:
        raise UnobservableError(
            "the readings do not tell the parameters apart: they hardly change from pose to pose; check that the "
            "columns hold what the sensor read"
        )


def _least_left_of_a_group(fit: Fit) -> float:
    """Degrees of freedom that are left to the forces, or to the torques, whichever has fewer: their noises differ."""
    if fit.linear is None:
        return fit.readings_left
    return min(3.0 * len(fit.residuals) - float(np.sum(fit.linear.U[:, group] ** 2)) for group in GROUPS)


def _tool(fit: Fit) -> RigidTool:
    if fit.tool is None:
        raise TypeError("a rigid fit has a tool")
    return fit.tool


def _require_noise(readings: PoseReadings, parameters: int, left: float, question: Question) -> None:
    n = len(readings)
    if question.noise is None and left < LEAST_LEFT:
        raise UnobservableError(
            f"{n} poses give {6 * n} readings for {parameters} parameters: nothing is left to estimate the noise "
            "from; record more poses, or give noise"
        )
