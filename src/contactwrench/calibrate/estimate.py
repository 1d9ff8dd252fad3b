"""One estimate from clean poses, by the model that is asked for, with the checks that make it worth returning.

A fit is handed on only if the poses separate every parameter, something is left to estimate the noise from, and the
readings do not contradict the sign or the side of the base that they were given with.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import UnobservableError
from ..model import PARAMETERS, RigidTool, gravity_in_flange
from ..observability import require_full_rank, require_separable
from ..orientation import Array
from .affine import fit_affine
from .auto import AutoFit, TiltPriors, fit_auto
from .joint import fit_rigid
from .knowledge import Knowledge, rows_of
from .least_squares import LEAST_LEFT, Fit, GivenNoise, PoseReadings
from .paper import fit_paper
from .sign import check_sign, require_positive_weight, require_stated_side

FEWEST_POSES_WITH_BASE = 4
DEFAULT_PRIORS = TiltPriors()
PAPER_HINT = "the paper's model takes the sensor's z along the flange's (--model mount finds any mounting); or "


@dataclass(frozen=True, eq=False)
class Question:
    """What is asked of the readings: a model, and all that is known beside them.

    `gravity_direction` (3,) in base axes, stated or nominal; `noise` given or None; `priors` of the tilts, for `auto`;
    `knowledge` of the parameters.
    """

    model: str
    gravity_direction: Array
    noise: GivenNoise | None = None
    priors: TiltPriors = DEFAULT_PRIORS
    knowledge: tuple[Knowledge, ...] = ()


@dataclass(frozen=True, eq=False)
class Estimate:
    """A fit and what there is to say of it; `auto` where that made it, `weight_xy` and `weight_z` by the paper."""

    fit: Fit
    warnings: tuple[str, ...] = ()
    auto: AutoFit | None = None
    weight_xy: float | None = None
    weight_z: float | None = None


def estimate(readings: PoseReadings, question: Question) -> Estimate:
    """Fit and check. Raises `UnobservableError` and `AmbiguityError`."""
    if question.model == "paper":
        return _paper(readings, question)
    if question.model == "affine":
        return _affine(readings, question)
    if question.model == "auto":
        return _auto(readings, question)
    fit = fit_rigid(readings, question.model, question.gravity_direction, question.noise, question.knowledge)
    return Estimate(fit, _checked(fit, readings, question.model, question))


def _paper(readings: PoseReadings, question: Question) -> Estimate:
    stated = question.gravity_direction
    paper = fit_paper(readings, stated)
    rigid = fit_rigid(readings, "yaw", stated, None)
    warnings = check_sign(rigid, readings, "yaw", stated, None)
    require_positive_weight(paper.weight_z, stated, PAPER_HINT)
    return Estimate(paper.fit, warnings, weight_xy=paper.weight_xy, weight_z=paper.weight_z)


def _affine(readings: PoseReadings, question: Question) -> Estimate:
    r = gravity_in_flange(readings.R_base_flange, question.gravity_direction)
    columns = np.column_stack([r, np.ones(len(r))])
    names = ("B_*_rx", "B_*_ry", "B_*_rz", "B_*_1")
    require_separable(columns, names, readings.R_base_flange, question.gravity_direction)
    _require_noise(readings, 24, 6.0 * len(readings) - 24.0, question)
    fit = fit_affine(readings, question.gravity_direction, question.noise)
    mirrors = np.linalg.det(fit.B[:3, :3]) < 0.0
    warning = "weak: the force matrix A mirrors: an axis has the wrong sign, or the sensor reports the reaction"
    return Estimate(fit, (warning,) if mirrors else ())


def _auto(readings: PoseReadings, question: Question) -> Estimate:
    auto = fit_auto(readings, question.gravity_direction, question.noise, question.priors, question.knowledge)
    kept = auto.assumption
    if not kept.nominal_base:
        model = "mount+base"
    elif not kept.nominal_mounting:
        model = "mount"
    else:
        model = "yaw"
    return Estimate(auto.fit, _checked(auto.fit, readings, model, question), auto=auto)


def _checked(fit: Fit, readings: PoseReadings, model: str, question: Question) -> tuple[str, ...]:
    """Warnings of a rigid fit whose free rotations are those of `model`. Raises where it may not be returned."""
    tool, names, stated = _tool(fit), PARAMETERS[model], question.gravity_direction
    known = rows_of(question.knowledge, tool, names)
    require_full_rank(tool, readings.R_base_flange, names, None if known is None else known.jacobian)
    if model == "mount+base" and known is None and len(readings) < FEWEST_POSES_WITH_BASE:
        raise UnobservableError(
            f"found {len(readings)} distinct orientations, expected {FEWEST_POSES_WITH_BASE} or more for mount+base: "
            "with fewer, several tools and bases fit alike; record 6 or more that turn about two axes"
        )
    _require_noise(readings, len(names), fit.readings_left, question)
    require_stated_side(tool, stated)
    warnings = check_sign(fit, readings, model, stated, question.noise)
    require_positive_weight(tool.weight, stated)
    return warnings


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
