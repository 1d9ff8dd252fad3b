"""Several tools on one sensor: each recording has its tool, and the mounting, the base, or both, are common to all.

Each recording is fitted robustly on its own. What it then says of the common rotations, its own tool eliminated, goes
as a message (shared_rotations.py) to each of the others, where it joins the readings; a prior on the common tilts is
counted once, as messages carry none. Messages are linearised at the estimate of the recording that knows most, again
and again until that stays. Its estimate of the common rotations is then everybody's: with the tool given the
rotations as that tool's readings have it, and the rotations as all readings together have them, each result is the
marginal of the joint posterior, and the very same matrix stands in each.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..calibration.calibration import Calibration
from ..calibration.fields import Finding, Kind
from ..errors import AmbiguityError, UnobservableError
from ..geometry.arrays import Array
from ..geometry.rotations import rotation_log
from ..geometry.wrench import STANDARD_GRAVITY
from ..model import (
    RigidTool,
    free_wrench,
    gravity_in_flange,
    horizontal_axes,
    matrix_jacobian,
    small_change_about,
    stepped,
    wrench_matrix,
)
from ..samples.samples import Samples
from ..statistics import SIGNIFICANCE, percent
from .calibrate import Recorded, assembled, from_recording, question_asked
from .estimate import Beliefs, RigidEstimate
from .initial_guess import linear_fit
from .noise import NoiseLike, PoseReadings
from .priors import (
    BASE_TILT_SD,
    MOUNT_TILT_SD,
    Knowledge,
    Question,
    TiltPriors,
    known_gravity,
    nominal_mounting,
    stated_knowledge,
)
from .rigid import estimated
from .shared_rotations import SHAREABLE, Message, disagreement, message_of, require_shareable

ROUNDS = 10
SETTLED = 1e-3
"""Standard deviations: messages are not linearised anew for less."""


def calibrate_shared(
    recordings: Sequence[Samples],
    shared: Sequence[str] = tuple(SHAREABLE),
    model: str = "auto",
    noise: NoiseLike = None,
    gravity: ArrayLike | None = None,
    *,
    g: float = STANDARD_GRAVITY,
    mount_tilt_sd: float = MOUNT_TILT_SD,
    base_tilt_sd: float = BASE_TILT_SD,
    known: Mapping[str, tuple[Any, Any]] | None = None,
) -> tuple[Calibration, ...]:
    """Calibrate several tools on one sensor together; the other arguments as of `calibrate`, for every recording.

    A warning in each result names the recording whose rotations contradict those of the others (chi-square, 1 %).

    Args:
        recordings: one of each tool.
        shared: `mount` (R_flange_sensor) and `gravity` (base axes): the same in all results, from all recordings.
        model: `auto`, `mount` or `mount+base`.
        noise: as of `calibrate`.
        gravity: as of `calibrate`.
        g: as of `calibrate`.
        mount_tilt_sd: as of `calibrate`.
        base_tilt_sd: as of `calibrate`.
        known: may state `mount` and `gravity`.

    Returns:
        A calibration for each recording, in their order.

    Raises:
        InputError: what cannot be shared, and as `calibrate`, naming the recording.
        UnobservableError: as `calibrate`, naming the recording.
        AmbiguityError: as `calibrate`, naming the recording.
    """
    require_shareable(len(recordings), shared, model, known or {})
    question = question_asked(model, noise, gravity, TiltPriors(mount_tilt_sd, base_tilt_sd), known)
    recorded = [from_recording(samples, question, g) for samples in recordings]
    apart = stated_knowledge({name: pair for name, pair in (known or {}).items() if name not in shared})
    sharing = _Sharing(question, tuple(name for name in SHAREABLE if name in shared), apart)
    agreement = _agreement(recorded, sharing)
    common = agreement.estimates[agreement.leader]
    sources = [recording.samples.source for recording in recorded]
    contradictions = _contradictions(agreement, sources, sharing)
    results = []
    for recording, estimate, asked in zip(recorded, agreement.estimates, agreement.questions, strict=True):
        agreed = replace(
            recording,
            estimate=_agreeing(estimate, recording.readings, common, sharing),
            findings=(*recording.findings, *contradictions),
        )
        others = ", ".join(other.samples.source for other in recorded if other is not recording)
        origin = {"shared": ", ".join(sharing.names), "shared_with": others}
        with _naming(recording.samples.source):
            results.append(assembled(agreed, asked, origin))
    return tuple(results)


@dataclass(frozen=True, eq=False)
class _Sharing:
    """The question, the `names` of what is common, and what is known of that which each has `apart`."""

    question: Question
    names: tuple[str, ...]
    apart: tuple[Knowledge, ...]

    @property
    def parameters(self) -> tuple[str, ...]:
        return tuple(parameter for name in self.names for parameter in SHAREABLE[name])

    def known_apart(self, estimate: RigidEstimate) -> tuple[Knowledge, ...]:
        """What is known of a recording's rotations that are its own: stated, or a prior that the readings keep."""
        beliefs, priors = estimate.beliefs, self.question.priors
        pieces = list(self.apart)
        if self.question.model != "auto" or beliefs is None:
            return self.apart
        if "mount" not in self.names and priors.mount is not None and beliefs.any_mounting < 0.5:
            pieces.append(nominal_mounting(priors.mount))
        if "gravity" not in self.names and priors.base is not None and beliefs.any_base < 0.5:
            pieces.append(known_gravity(self.question.gravity_direction, priors.base))
        return tuple(pieces)


@dataclass(frozen=True, eq=False)
class _Agreement:
    """The `estimates` once all recordings know what the others say, the `questions` put to each, the `messages`, and
    the `leader`, the recording that knows most of what is common.
    """

    estimates: list[RigidEstimate]
    questions: list[Question]
    messages: list[Message]
    leader: int


def _agreement(recorded: list[Recorded], sharing: _Sharing) -> _Agreement:
    alone = [recording.estimate for recording in recorded if isinstance(recording.estimate, RigidEstimate)]
    readings = [recording.readings for recording in recorded]

    def say(estimates: list[RigidEstimate], point: RigidTool | None) -> list[Message]:
        return [
            _message(*of_recording, point, sharing) for of_recording in zip(readings, alone, estimates, strict=True)
        ]

    leader = int(np.argmin([message.uncertainty for message in say(alone, None)]))
    estimates, questions, messages = alone, [sharing.question] * len(alone), []
    for _ in range(ROUNDS):
        before = estimates[leader].tool
        messages = say(estimates, before)
        questions = [
            replace(
                sharing.question,
                knowledge=(
                    *sharing.question.knowledge,
                    *(message.as_knowledge() for j, message in enumerate(messages) if j != k),
                ),
            )
            for k in range(len(estimates))
        ]
        estimates = [estimated(of_tool, question) for of_tool, question in zip(readings, questions, strict=True)]
        now, index = estimates[leader], _index(estimates[leader].names, sharing)
        moved = _turns(before, now.tool, sharing)
        if float(moved @ np.linalg.solve(now.covariance[np.ix_(index, index)], moved)) <= SETTLED**2:
            break
    return _Agreement(estimates, questions, messages, leader)


def _message(
    readings: PoseReadings, alone: RigidEstimate, now: RigidEstimate, point: RigidTool | None, sharing: _Sharing
) -> Message:
    """What a recording says at the common `point` (None: at its own), with the noise that it has `alone`."""
    tool, kept = now.tool, readings.select(now.kept)
    common = tool if point is None else point
    R = common.R_flange_sensor if "mount" in sharing.names else tool.R_flange_sensor
    d = common.gravity_direction if "gravity" in sharing.names else tool.gravity_direction
    return message_of(
        kept,
        alone.noise,
        linear_fit(kept.R_base_flange, kept.wrench, R, d),
        now.names,
        sharing.parameters,
        sharing.known_apart(now),
        float(alone.dof.min()),
    )


def _agreeing(found: RigidEstimate, readings: PoseReadings, common: RigidEstimate, sharing: _Sharing) -> RigidEstimate:
    """The estimate with the rotations, and their covariance, that all have in common; the rest follows them as its
    covariance says (Jeffrey's rule: what the rest is, given the rotations, stays).
    """
    names, index, tool, agreed = found.names, _index(found.names, sharing), found.tool, common.tool
    follow = np.linalg.solve(found.covariance[np.ix_(index, index)], found.covariance[index]).T
    moved = stepped(tool, follow @ _turns(tool, agreed, sharing), names)
    if "mount" in sharing.names:
        moved = replace(moved, R_flange_sensor=agreed.R_flange_sensor)
    if "gravity" in sharing.names:
        moved = replace(moved, gravity_direction=agreed.gravity_direction)
    axes = small_change_about(tool, moved, names)
    before, follow = axes @ found.covariance @ axes.T, axes @ follow @ axes[np.ix_(index, index)].T
    of_all = common.covariance[np.ix_(index, index)]
    covariance = before + follow @ (of_all - before[np.ix_(index, index)]) @ follow.T
    dof = found.dof.copy()
    dof[index] = common.dof[index]
    r = gravity_in_flange(readings.R_base_flange, moved.gravity_direction)
    was = gravity_in_flange(readings.R_base_flange, tool.gravity_direction)
    from_parameters = matrix_jacobian(moved, names)
    B = wrench_matrix(moved)
    return replace(
        found,
        tool=moved,
        gravity_direction=moved.gravity_direction,
        B=B,
        covariance=0.5 * (covariance + covariance.T),
        B_covariance=from_parameters @ covariance @ from_parameters.T,
        errors=found.errors + free_wrench(found.B, was) - free_wrench(B, r),
        dof=dof,
        beliefs=_beliefs_agreeing(found.beliefs, common.beliefs, sharing),
    )


def _beliefs_agreeing(own: Beliefs | None, common: Beliefs | None, sharing: _Sharing) -> Beliefs | None:
    """What is believed, with the probabilities that all have in common."""
    if own is None or common is None:
        return None
    if "mount" in sharing.names:
        own = replace(own, mounting_exact=common.mounting_exact, any_mounting=common.any_mounting)
    if "gravity" in sharing.names:
        own = replace(own, base_exact=common.base_exact, any_base=common.any_base)
    return own


def _contradictions(agreement: _Agreement, sources: list[str], sharing: _Sharing) -> tuple[Finding, ...]:
    """A finding that names the recording whose rotations differ from those of the others by more than chance."""
    messages = agreement.messages
    judged = [disagreement(message, [other for other in messages if other is not message]) for message in messages]
    two = len(messages) == 2
    suspect = 1 - agreement.leader if two else int(np.argmin([rotations.test.probability for rotations in judged]))
    odd = judged[suspect]
    # of two, either differs as much from the other: one test; of more, one test each
    chance = min(1.0, odd.test.probability * (1 if two else len(messages)))
    if chance >= SIGNIFICANCE:
        return ()
    differ = {
        "mount": "the mounting by {:.2g} +- {:.2g} deg",
        "gravity": "gravity by {:.2g} +- {:.2g} deg",
    }
    parts = [differ[name].format(*odd.angle(SHAREABLE[name])) for name in sharing.names]
    text = (
        f"{sources[suspect]} contradicts the other recording{'' if two else 's'}, {' and '.join(parts)} (chance "
        f"{percent(chance)}): the sensor or the base moved in between, or the tool touched something: calibrate it "
        "apart"
    )
    return (Finding.weak(Kind.CONTRADICTS_OTHERS, text),)


def _turns(before: RigidTool, after: RigidTool, sharing: _Sharing) -> Array:
    """The small turns of what is shared that lead from one tool to another, in the axes of the first."""
    turns = []
    if "mount" in sharing.names:
        turns.append(rotation_log(before.R_flange_sensor.T @ after.R_flange_sensor))
    if "gravity" in sharing.names:
        axis = np.cross(before.gravity_direction, after.gravity_direction)
        turns.append(np.stack(horizontal_axes(before.gravity_direction)) @ axis)
    return np.concatenate(turns)


def _index(names: tuple[str, ...], sharing: _Sharing) -> list[int]:
    return [names.index(parameter) for parameter in sharing.parameters]


@contextmanager
def _naming(source: str) -> Iterator[None]:
    """Errors that say of which recording they are."""
    try:
        yield
    except (UnobservableError, AmbiguityError) as error:
        raise type(error)(f"{source}: {error}") from None
