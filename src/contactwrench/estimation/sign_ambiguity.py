"""What must hold before an estimate is handed on: parameters that the poses separate, a noise, a possible sign.

Readings that free air cannot tell from another sign are refused, both ways to understand them named; where they fit
both ways alike, what was stated is taken, and a finding says so (method, "What free-air data cannot tell").
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..calibration.findings import Finding, Kind
from ..calibration.observability import require_full_rank
from ..errors import AmbiguityError, UnobservableError, with_room_for
from ..geometry.arrays import Array
from ..model import PARAMETERS, RigidTool
from ..statistics import counted
from .estimate import RigidEstimate
from .findings import POOR_SHARE
from .initial_guess import SEARCH_OF_MODEL, explained_by_guess
from .noise import PoseReadings
from .plausibility import LIGHTEST_TOOL, LIKELIEST_CAUSE
from .priors import Question, rows_of
from .rigid import estimated

FEWEST_POSES_WITH_BASE = 4
HELD_GRAVITY = ("yaw", "mount")
PAPER_HINT = "--model mount (paper takes the sensor's z along the flange's), "
MEND = "mend mirrored or exchanged axes"
LEAST_LEFT = 0.5
"""Degrees of freedom: with fewer left, residuals say nothing about the noise."""

LEAST_WEIGHT = 1e-9
"""N: what the digits of readings without a weight leave."""

SIGNIFICANCE = 0.001
NEAR_TIE = 0.9
SURE_SIDE = 4.0
SURE_LEAN = 3.0
SURE_WEIGHT = 3.0
"""Standard deviations: a fit whose weight is less sure explains nothing, so that a tie with it says nothing either."""

ANYWHERE = 0.5
"""Probability of a mounting, or a base, that points anywhere, from which on it is held to be free."""

NOT_CONFIRMED = Finding.doubtful(
    Kind.SIGN_NOT_CONFIRMED,
    "the sign of the readings is taken as given: the negated readings fit as well, mostly because gravity's directions "
    "lie close to one plane of the sensor; confirm it by a push, or tilt the tool about another axis",
)


def checked(estimate: RigidEstimate, readings: PoseReadings, question: Question) -> tuple[Finding, ...]:
    """What there is to say of the sign. Raises `UnobservableError` and `AmbiguityError` where the estimate may not be
    returned. The sign is judged with and without the poses left out, with them under any mounting: whoever leaves out
    enough explains any sign.
    """
    stated, tool = question.gravity_direction, estimate.tool
    if estimate.weight_z is not None:
        as_yaw = replace(question, model="yaw", noise=None)
        findings = check_sign(estimated(readings, as_yaw, plain=True), readings, "yaw", as_yaw)
        require_positive_weight(estimate.weight_z, stated, estimate.force_left, PAPER_HINT)
        return findings
    if question.earlier is not None:
        require_positive_weight(tool.weight, stated, estimate.force_left)
        return ()
    model = question.model if question.model != "auto" else _model_freed(estimate)
    kept = readings.select(estimate.kept)
    require_answerable(estimate, kept, model, question)
    if model not in HELD_GRAVITY:
        std = float(np.sqrt(np.linalg.eigvalsh(estimate.covariance[-2:, -2:])[-1]))
        require_stated_side(tool, stated, std, estimate.force_left)
    if not estimate.kept.all():
        any_mounting = question.model == "auto" and model == "yaw"
        check_sign(estimate, readings, "mount" if any_mounting else model, question)
    findings = check_sign(estimate, kept, model, question)
    require_positive_weight(tool.weight, stated, estimate.force_left)
    return findings


def _model_freed(estimate: RigidEstimate) -> str:
    """The model whose rotations are free under the likeliest hypotheses of `auto`."""
    beliefs = estimate.beliefs
    if beliefs is None or beliefs.any_base > ANYWHERE:
        return "mount+base"
    return "mount" if beliefs.any_mounting > ANYWHERE else "yaw"


def require_answerable(estimate: RigidEstimate, readings: PoseReadings, model: str, question: Question) -> None:
    """Raise `UnobservableError` unless the poses kept separate the parameters of a rigid `model`, leave its noise some
    readings, and show a weight beyond the digits of the readings.
    """
    tool, names, n = estimate.tool, PARAMETERS[model], len(readings)
    known = rows_of(question.knowledge, tool, names).jacobian
    lean = float(np.linalg.norm(tool.gravity_direction - question.gravity_direction))
    places = [] if model in HELD_GRAVITY else [tool]
    if model in HELD_GRAVITY or lean < SURE_LEAN * float(np.sqrt(np.trace(estimate.covariance[-2:, -2:]))):
        # a tilt that the prior lets in, or noise, is not what separates
        places.append(replace(tool, gravity_direction=question.gravity_direction))
    for each in places:
        require_full_rank(each, readings.R_base_flange, names, known)
    if model == "mount+base" and not len(known) and n < FEWEST_POSES_WITH_BASE:
        raise UnobservableError(
            f"found {counted(n, 'distinct orientation')}, expected {FEWEST_POSES_WITH_BASE} or more for mount+base: "
            "with fewer, several tools and bases fit alike; record 6 or more that turn about two axes"
        )
    require_noise(n, len(names), float(estimate.readings_left.min()), question)
    there_is_a_weight = np.isfinite(estimate.covariance).all() and abs(tool.weight) > LEAST_WEIGHT
    if not (estimate.singular_values[-1] > 0.0 and there_is_a_weight):
        raise UnobservableError(
            "the readings do not tell the parameters apart, they hardly change from pose to pose: check the columns; "
            f"{LIKELIEST_CAUSE}"
        )


def require_noise(n: int, parameters: int, left: float, question: Question) -> None:
    """Raise `UnobservableError` where nothing is left to estimate the noise from."""
    if question.noise is None and left < LEAST_LEFT:
        raise UnobservableError(
            f"{n} poses give {6 * n} readings for {parameters} parameters: nothing is left to estimate the noise "
            "from; record more poses, or give noise"
        )


def check_sign(estimate: RigidEstimate, readings: PoseReadings, model: str, question: Question) -> tuple[Finding, ...]:
    """Refuse readings that a tool explains much better once they are negated (or, the same, gravity is).

    `model` yaw, mount or mount+base is fitted to the negated readings. Returns a finding where both fit alike, else
    nothing. Raises `AmbiguityError` naming both interpretations.
    """
    R, wrench, stated = readings.R_base_flange, readings.wrench, question.gravity_direction
    as_given = explained_by_guess(R, wrench, SEARCH_OF_MODEL[model], stated)
    if explained_by_guess(R, -wrench, SEARCH_OF_MODEL[model], stated) < NEAR_TIE * as_given:
        return ()
    negated_readings = replace(readings, wrench=-wrench)
    rival = estimated(negated_readings, replace(question, model=model, knowledge=()), plain=True)
    if rival.tool.weight <= 0.0:
        return ()
    dof = max(6 * len(readings) - len(PARAMETERS[model]), 1)
    residuals = estimate.residuals if len(estimate.residuals) == len(readings) else estimate.errors
    left, left_negated = (float(np.sqrt(np.mean(np.sum(e[:, :3] ** 2, axis=1)))) for e in (residuals, rival.errors))
    if left_negated < 0.5 * left and _fits_worse(residuals, rival.noise, rival.errors, dof):
        left_so = f"{left:.3g} N left as given, {left_negated:.3g} N negated"
        found = f"only a negative weight explains these readings ({left_so})"
        either = f"say --sign reaction or --gravity {negated(stated)}, {MEND}, or subtract no payload"
        raise _contradiction(found, either, rival.tool.weight, left_negated)
    explained = estimate.tool.weight > SURE_WEIGHT * float(np.sqrt(estimate.covariance[0, 0]))
    on_stated_side = rival.gravity_direction @ stated >= 0.0
    tie = explained and on_stated_side and not _fits_worse(rival.errors, estimate.noise, residuals, dof)
    return (NOT_CONFIRMED,) if tie else ()


def require_stated_side(tool: RigidTool, stated: Array, std: float, left: float) -> None:
    """Raise `AmbiguityError` if gravity was found surely more than 90 deg from the stated direction (3,): a robot on a
    wall is right there, give or take `std` rad. `left` N in the poses.
    """
    angle = np.rad2deg(np.arccos(np.clip(tool.gravity_direction @ stated, -1.0, 1.0)))
    if angle > 90.0 + SURE_SIDE * np.rad2deg(std):
        direction = ",".join(f"{part:.3f}" for part in tool.gravity_direction)
        found = f"gravity comes out {angle:.0f} deg from the stated direction, expected up to 90"
        either = f"say --sign reaction, or --gravity {direction} of a base mounted that way"
        raise _contradiction(found, either, tool.weight, left)


def require_positive_weight(weight: float, gravity_direction: Array, left: float, hint: str = "") -> None:
    """Raise `AmbiguityError` for a weight (N) that is not above zero, with `left` N in the poses; `hint` is one of the
    model's own.
    """
    if weight <= 0.0:
        found = f"the weight comes out as {weight:.3g} N, expected above 0"
        either = f"say {hint}--sign reaction or --gravity {negated(gravity_direction)}, or {MEND}"
        raise _contradiction(found, either, weight, left)


def _contradiction(found: str, either: str, weight: float, left: float) -> AmbiguityError:
    """The error for what was found, `either` of which may mend it; or what is likelier, where there is next to no
    weight (N), or much is `left` (N).
    """
    if max(abs(weight), left) < LIGHTEST_TOOL:
        return AmbiguityError(with_room_for(f"{found}; of so little weight {LIKELIEST_CAUSE}", f"; else {either}"))
    why = "free air cannot tell, one push by hand can"
    if left > POOR_SHARE * abs(weight):
        likelier = "likelier the file is read wrongly: contactwrench diagnose tells how"
        why = f"but {left:.2g} N are left so too, and {likelier}"
    return AmbiguityError(f"{found}: {either}; {why}")


def negated(direction: Array) -> str:
    """The opposite direction as the option --gravity takes it."""
    return ",".join(f"{-part + 0.0:g}" for part in direction)


def _fits_worse(residuals: Array, noise: Array, other: Array, dof: int) -> bool:
    """Whether `residuals` (n, 6) exceed those of another fit, in units of its noise, by more than chance (F test)."""
    from scipy.special import fdtri

    unit = np.maximum(noise, 1e-9 * float(np.abs(residuals).max()) + 1e-300)
    own, least = float(np.sum((residuals / unit) ** 2)), float(np.sum((other / unit) ** 2))
    return own > float(fdtri(dof, dof, 1.0 - SIGNIFICANCE)) * least
