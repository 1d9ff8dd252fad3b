"""What a model holds, mounting or base, held against the readings.

`paper`, `yaw` and `mount` answer as if what they hold were so. Where it is not, their misfit passes for errors of the
robot, of a cable, of the sensor, or for noise. So what is held is let go beside the other hypotheses of `auto`.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..calibration.calibration import Calibration
from ..calibration.findings import Kind
from ..geometry.arrays import Array
from ..model import PARAMETERS, all_but_the_bias, response, response_jacobian
from ..statistics import MisfitTest, percent, two_digits
from .alternatives import alternatives_beside
from .estimate import EXCLUDED, IN_DOUBT, Beliefs, Estimate, RigidEstimate
from .findings import DOUBTFUL
from .noise import PoseReadings
from .priors import Question, rows_of
from .rigid import MODEL_OF_AUTO, estimated

AT_A_GLANCE = 0.01
"""Probability, by chance, of what the rotations held would explain as well, up to which they are looked at closely."""

LIKELIER = 0.5
"""Probability."""

HELD = {"paper": (4, 5, 7, 8), "yaw": (4, 5, 7, 8), "mount": (7, 8)}
"""Of weight, centre of mass, the turns of mounting and gravity: those that a model holds."""

OF_MISFIT = (Kind.ROBOT, Kind.GAIN, Kind.CABLE, Kind.TWO_LEVELS, Kind.CREEP, Kind.CROSS_TALK)
"""What a wrong model makes of a rotation that it holds."""


def with_rotations_judged(
    calibration: Calibration, estimate: Estimate, readings: PoseReadings, question: Question
) -> Calibration:
    """The calibration, made doubtful where mounting or base is not as the model holds it; then with what the other
    models make of the poses, and without what only this one takes the misfit for.
    """
    if question.model not in HELD or not isinstance(estimate, RigidEstimate):
        return calibration
    free = _let_go(estimate, readings, question)
    if free is None or free.beliefs is None or not _is_otherwise(free.beliefs, question):
        return calibration
    finding = DOUBTFUL(Kind.CONTRADICTS_MODEL, _in_words(estimate, free, free.beliefs, question))
    found = {kind for kind, probability in free.beliefs.with_orientation.items() if probability > LIKELIER}
    found |= {Kind.CROSS_TALK} if Kind.GAIN in found or Kind.CABLE in found else set()
    others = tuple(each for each in calibration.findings if each.kind in found or each.kind not in OF_MISFIT)
    alternatives = alternatives_beside(estimate, readings, question)
    return replace(calibration, findings=(finding, *others), alternatives=alternatives)


def _let_go(estimate: RigidEstimate, readings: PoseReadings, question: Question) -> RigidEstimate | None:
    """The estimate with what the model holds near nominal or exactly so, from its tool on, everything else that may be
    wrong beside it; None where there is nothing that this would explain, as it takes as long as the estimate. Noise
    that is stated leaves the robot's errors no room: the readings tell it here.
    """
    beliefs, everything = estimate.beliefs, bool(estimate.kept.all())
    other_causes = 0.0 if beliefs is None else sum((*beliefs.moved.values(), *beliefs.with_orientation.values()))
    nothing_found = everything and other_causes < LIKELIER
    if nothing_found and _chance_at_a_glance(estimate, readings, question) > AT_A_GLANCE:
        return None
    priors = replace(question.priors, mount=None) if question.model == "mount" else question.priors
    return estimated(readings, replace(question, model="auto", priors=priors, noise=None), begin=estimate.tool)


def _is_otherwise(beliefs: Beliefs, question: Question) -> bool:
    """Whether mounting or base is not as the model holds it: where that does not take the place of the robot's errors,
    it is excluded only at longer odds, as of a few such errors some make a base lean by chance.
    """
    beside_robot = beliefs.with_orientation.get(Kind.ROBOT, 0.0) > LIKELIER
    return _as_held(beliefs, question) < (EXCLUDED if beside_robot else IN_DOUBT)


def _as_held(beliefs: Beliefs, question: Question) -> float:
    """The probability that mounting and base are as the model holds them."""
    return beliefs.base_exact if question.model == "mount" else beliefs.both_exact


def _in_words(held: RigidEstimate, free: RigidEstimate, beliefs: Beliefs, question: Question) -> str:
    """What seems to be otherwise than the model holds it, and what that one leaves in a pose, and `auto`."""
    model, gravity = question.model, free.gravity_direction
    cosines = abs(free.tool.R_flange_sensor[2, 2]), gravity @ question.gravity_direction
    of_sensor, of_base = map(two_digits, np.rad2deg(np.arccos(np.clip(cosines, -1.0, 1.0))))
    each = [(beliefs.base_exact, f"the base seems to lean by {of_base} deg")]
    if model != "mount":
        each.append((beliefs.mounting_exact, f"the sensor seems to be tilted by {of_sensor} deg"))
    sure = [text for exact, text in each if exact < LIKELIER]
    direction = ",".join(f"{part:.3g}" for part in gravity.round(4) + 0.0)
    stated = f", or state gravity as {direction}" if sure == [each[0][1]] else ""
    return (
        f"{' and '.join(sure) or ' or '.join(text for _, text in each)}, which model {model} rules out (probability "
        f"{percent(_as_held(beliefs, question))}): its misfit passes for other errors; --model auto leaves "
        f"{two_digits(free.force_left)} N in a pose, {model} {two_digits(held.force_left)} N: take auto{stated}"
    )


def _chance_at_a_glance(estimate: RigidEstimate, readings: PoseReadings, question: Question) -> float:
    """The probability by which the rotations held would explain as much of mere noise (F test)."""
    tool, names, held = estimate.tool, PARAMETERS[MODEL_OF_AUTO], list(HELD[question.model])
    both = np.column_stack([readings.R_base_flange.reshape(-1, 9), readings.wrench])
    rows: Array = np.linalg.qr(both - both.mean(axis=0)).R  # few, with the moments of all
    known = rows_of(question.knowledge, tool, names)
    J = (response_jacobian(tool, names) / estimate.noise[:, None]).transpose(1, 0, 2)
    D = np.vstack(
        [(rows[:, :9] @ J.reshape(-1, 9).T).reshape(-1, J.shape[1]), known.jacobian[:, all_but_the_bias(names)]]
    )
    errors = np.append((rows[:, 9:] - rows[:, :9] @ response(tool).T) / estimate.noise, known.residuals)
    left = [_left(columns, errors) for columns in (np.delete(D, held, axis=1), D)]
    dof = 6.0 * len(readings) + len(known.residuals) - len(names)
    explained = max(left[0] - left[1], 0.0) / max(left[1] / max(dof, 1.0), 1e-300)
    return MisfitTest(explained, len(held), max(dof, 0.0)).probability


def _left(D: Array, errors: Array) -> float:
    return float(np.sum((errors - D @ np.linalg.lstsq(D, errors)[0]) ** 2))
