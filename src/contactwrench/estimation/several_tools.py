"""Several tools on one sensor: each recording has its tool, and the mounting, the base, or both, are common to all.

What the readings of one recording say of the common rotations is a message: the posterior of a fit that knows no more
of them than a vague guess, less that guess. It joins the readings of each of the others; so poses that do not fix a
mounting still say what they do fix, and a prior on the common tilts is counted once, as messages carry none. The
rotations that the recording that knows most then has are everybody's, with the very same covariance; the rest follows.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..calibration.calibration import Calibration
from ..calibration.findings import Finding, Kind
from ..errors import naming, refuse
from ..geometry.arrays import Array
from ..geometry.wrench import STANDARD_GRAVITY
from ..model import (
    GRAVITY,
    MOUNT,
    RigidTool,
    free_wrench,
    gravity_in_flange,
    matrix_jacobian,
    small_change_about,
    stepped,
    wrench_matrix,
)
from ..samples.samples import Samples
from ..statistics import SIGNIFICANCE, MisfitTest, percent
from .calibrate import FittedRecording, assembled, from_recording, question_asked
from .estimate import RigidEstimate
from .initial_guess import linear_fit
from .noise import NoiseLike, PoseReadings
from .plausibility import on_one_sensor
from .priors import (
    BASE_TILT_SD,
    MOUNT_TILT_SD,
    Knowledge,
    PriorRows,
    Question,
    TiltPriors,
    known_as,
    known_rotations,
    nominal_mounting,
    stated_knowledge,
)
from .rigid import estimated, model_fitted

ROTATIONS = (*MOUNT, *GRAVITY)
SHAREABLE = {"mount": MOUNT, "gravity": GRAVITY}
"""What recordings may have in common, with its parameters."""

OF_TOOL = {"mount": "R_flange_sensor", "gravity": "gravity_direction"}
OF_BELIEFS = {"mount": ("mounting_exact", "any_mounting"), "gravity": ("base_exact", "any_base")}
DIFFER = {"mount": "the mounting by {:.2g} +- {:.2g} deg", "gravity": "gravity by {:.2g} +- {:.2g} deg"}
SHARING_MODELS = ("auto", "mount", "mount+base")

LOOKS = 2
"""Times that messages are read: about each recording's own estimate, then that of the one that knows most, without
which half the recordings that turn about a single axis fail."""

SAYS_NOTHING = 1.0
"""rad: the std of the vague guess; of a turn with a larger one, which may point anywhere, nothing is said."""


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
        noise, gravity: as of `calibrate`: std (6,) of one pose's reading, N and N m; direction (3,), base axes.
        g, mount_tilt_sd, base_tilt_sd: m/s^2; rad an axis, of the priors on mounting and base.
        known: may state `mount` and `gravity`.

    Returns:
        A calibration for each recording, in their order.

    Raises:
        InputError: what cannot be shared, and as `calibrate`, naming the recording.
        UnobservableError, AmbiguityError: as `calibrate`, naming the recording.
    """
    require_shareable(len(recordings), shared, model, known or {})
    question = question_asked(model, noise, gravity, TiltPriors(mount_tilt_sd, base_tilt_sd), known)
    sharing = _Sharing(question, tuple(name for name in SHAREABLE if name in shared), known or {})
    recorded = [from_recording(samples, question, g) for samples in recordings]
    named = [samples.source for samples in recordings]
    sources = [f"{name} {k}" if named.count(name) > 1 else name for k, name in enumerate(named, 1)]
    messages, leader = _messages(recorded, sharing)
    asked = [
        replace(question, knowledge=(*question.knowledge, *(m.knowledge for m in messages if m is not own)))
        for own in messages
    ]
    begins = [None if model == "auto" else message.tool for message in messages]
    estimates = [
        estimated(recording.readings.with_lag(recording.found.lag), own, begin=begin)
        for recording, own, begin in zip(recorded, asked, begins, strict=True)
    ]
    contradictions = _contradictions(messages, leader, estimates[leader], sources, sharing)
    results = []
    for k, (recording, joint) in enumerate(zip(recorded, estimates, strict=True)):
        estimate = joint if recording.found.lag is None else joint.with_noise_of(recording.estimate)
        agreeing = _agreeing(estimate, recording.readings, estimates[leader], sharing)
        agreed = replace(recording, estimate=agreeing, findings=(*recording.findings, *contradictions))
        origin = {"shared": ", ".join(sharing.names), "shared_with": ", ".join(sources[:k] + sources[k + 1 :])}
        with naming(sources[k]):
            results.append(assembled(agreed, asked[k], origin))
    return on_one_sensor(results)


def require_shareable(recordings: int, shared: Sequence[str], model: str, known: Mapping[str, Any]) -> None:
    """Raise `InputError` for what recordings cannot have in common."""
    expected = f"expected {' or '.join(SHAREABLE)}, or both"
    one_of = f"expected one of {', '.join(SHARING_MODELS)}"
    held = "model mount holds gravity, and gravity is to be shared: share mount alone, or choose auto or mount+base"
    apart = "each recording has its own: leave it out, or calibrate them apart"
    refuse(
        *((name not in SHAREABLE, f"found {name!r} to share, {expected}") for name in shared),
        (not shared, f"found nothing to share, {expected}"),
        (recordings < 2, f"found {recordings} recording to share {' and '.join(shared)}, expected two or more"),
        (model not in SHARING_MODELS, f"model {model!r} shares nothing, {one_of}"),
        (model == "mount" and "gravity" in shared, held),
        *((name not in SHAREABLE, f"known {name} is of one tool, and {apart}") for name in known),
    )


@dataclass(frozen=True, eq=False)
class Message:
    """What one recording says of the common rotations: `knowledge`, with `dof` behind its variance, as found at `tool`;
    `uncertainty` the summed variances (rad^2) of the turns.
    """

    knowledge: Knowledge
    dof: float
    tool: RigidTool
    uncertainty: float


@dataclass(frozen=True, eq=False)
class _Sharing:
    """The question, the `names` of what is common, and what is stated as `known`."""

    question: Question
    names: tuple[str, ...]
    known: Mapping[str, tuple[Any, Any]]

    def index(self, parameters: tuple[str, ...]) -> list[int]:
        """Where those that are common stand among `parameters`."""
        return [parameters.index(parameter) for name in self.names for parameter in SHAREABLE[name]]

    def common(self, tool: RigidTool) -> dict[str, Any]:
        """The rotations of a tool that are common, by their fields."""
        return {OF_TOOL[name]: getattr(tool, OF_TOOL[name]) for name in self.names}

    def apart(self, estimate: RigidEstimate) -> tuple[Knowledge, ...]:
        """What is known of a recording's rotations that are its own: stated, or a prior that the readings keep."""
        pieces = list(stated_knowledge({name: pair for name, pair in self.known.items() if name not in self.names}))
        beliefs, priors = estimate.beliefs, self.question.priors
        if self.question.model == "auto" and beliefs is not None:
            if "mount" not in self.names and priors.mount is not None and beliefs.any_mounting < 0.5:
                pieces.append(nominal_mounting(priors.mount))
            if "gravity" not in self.names and priors.base is not None and beliefs.any_base < 0.5:
                pieces.append(known_as("gravity", self.question.gravity_direction, priors.base))
        return tuple(pieces)


def _messages(recorded: list[FittedRecording], sharing: _Sharing) -> tuple[list[Message], int]:
    """What each recording says, and which of them knows most."""
    alone = [recording.estimate for recording in recorded if isinstance(recording.estimate, RigidEstimate)]
    told = [recording.readings.with_lag(recording.found.lag) for recording in recorded]
    points, messages, leader = [estimate.tool for estimate in alone], [], 0
    for _ in range(LOOKS):
        messages = [
            _message(readings, estimate, replace(estimate.tool, **sharing.common(point)), sharing)
            for readings, estimate, point in zip(told, alone, points, strict=True)
        ]
        leader = int(np.argmin([message.uncertainty for message in messages]))
        points = [messages[leader].tool] * len(messages)
    return messages, leader


def _message(readings: PoseReadings, alone: RigidEstimate, near: RigidTool, sharing: _Sharing) -> Message:
    """What a recording says, looked at with a vague guess of the rotations near those of a tool."""
    R, d = near.R_flange_sensor, near.gravity_direction
    vague = known_rotations(R, d, np.eye(5) / SAYS_NOTHING, np.zeros(5))
    model = model_fitted(sharing.question.model)
    question = replace(sharing.question, model=model, knowledge=(*sharing.apart(alone), vague))
    found = estimated(readings, question, begin=linear_fit(readings.R_base_flange, readings.wrench, R, d))
    index, turns = sharing.index(found.names), sharing.index(ROTATIONS)
    guess = vague(found.tool, found.names)
    put_in = guess.jacobian[:, index]
    of_all = np.linalg.inv(found.covariance[np.ix_(index, index)])
    values, vectors = np.linalg.eigh(of_all - put_in.T @ put_in)
    heard = values > SAYS_NOTHING**-2
    root, axes = np.sqrt(values[heard]), vectors[:, heard].T
    information = np.zeros((len(root), 5))
    information[:, turns] = root[:, None] * axes
    turn = -axes @ (put_in.T @ guess.residuals) / root
    R, d, dof = found.tool.R_flange_sensor, found.tool.gravity_direction, float(found.dof.min())
    knowledge = replace(known_rotations(R, d, information, turn), dof=dof)
    return Message(knowledge, dof, found.tool, float(np.trace(np.linalg.inv(of_all))))


def _agreeing(found: RigidEstimate, readings: PoseReadings, common: RigidEstimate, sharing: _Sharing) -> RigidEstimate:
    """The estimate with the rotations, and their covariance, that all have in common; the rest follows them as its
    covariance says (Jeffrey's rule: what the rest is, given the rotations, stays).
    """
    names, tool, index = found.names, found.tool, sharing.index(found.names)
    follow = np.linalg.solve(found.covariance[np.ix_(index, index)], found.covariance[index]).T
    about = known_rotations(tool.R_flange_sensor, tool.gravity_direction, np.eye(5), np.zeros(5))
    turn = -about(common.tool, names).residuals[sharing.index(ROTATIONS)]
    moved = replace(stepped(tool, follow @ turn, names), **sharing.common(common.tool))
    axes = small_change_about(tool, moved, names)
    before, follow = axes @ found.covariance @ axes.T, axes @ follow @ axes[np.ix_(index, index)].T
    covariance = before + follow @ (common.covariance - before)[np.ix_(index, index)] @ follow.T
    dof = found.dof.copy()
    dof[index] = common.dof[index]
    now, was = (gravity_in_flange(readings.R_base_flange, of.gravity_direction) for of in (moved, tool))
    B, to_B = wrench_matrix(moved), matrix_jacobian(moved, names)
    beliefs = found.beliefs
    if beliefs is not None:
        of_common = {field: getattr(common.beliefs, field) for name in sharing.names for field in OF_BELIEFS[name]}
        beliefs = replace(beliefs, **of_common)
    return replace(
        found,
        tool=moved,
        gravity_direction=moved.gravity_direction,
        B=B,
        covariance=0.5 * (covariance + covariance.T),
        B_covariance=to_B @ covariance @ to_B.T,
        errors=found.errors + free_wrench(found.B, was) - free_wrench(B, now),
        dof=dof,
        beliefs=beliefs,
    )


def _contradictions(
    messages: list[Message], leader: int, common: RigidEstimate, sources: list[str], sharing: _Sharing
) -> tuple[Finding, ...]:
    """A finding that names the recording whose rotations differ from those of the others by more than chance."""
    index = sharing.index(common.names)
    of_each = [message.knowledge(common.tool, common.names) for message in messages]
    rows = [replace(each, jacobian=each.jacobian[:, index]) for each in of_each]
    dof = min(message.dof for message in messages)
    judged = [_disagreement(each, [other for other in rows if other is not each], dof) for each in rows]
    two = len(messages) == 2
    suspect = 1 - leader if two else int(np.argmin([test.probability for _, _, test in judged]))
    turn, covariance, test = judged[suspect]
    chance = min(1.0, test.probability * (1 if two else len(messages)))  # of two, either differs as much: one test
    if chance >= SIGNIFICANCE:
        return ()
    parts = []
    for name in sharing.names:
        part = [index.index(common.names.index(parameter)) for parameter in SHAREABLE[name]]
        angle = float(np.linalg.norm(turn[part]))
        along = turn[part] / max(angle, 1e-300)
        std = float(np.sqrt(along @ covariance[np.ix_(part, part)] @ along))
        parts.append(DIFFER[name].format(np.rad2deg(angle), np.rad2deg(std)))
    text = (
        f"{sources[suspect]} contradicts the other recording{'' if two else 's'}, {' and '.join(parts)} (chance "
        f"{percent(chance)}): the sensor or the base moved in between, or the tool touched something: calibrate it "
        "apart"
    )
    return (Finding.weak(Kind.CONTRADICTS_OTHERS, text),)


def _disagreement(own: PriorRows, others: list[PriorRows], dof: float) -> tuple[Array, Array, MisfitTest]:
    """The turns by which what one says differs from what the others say, their covariance, and the test of it."""
    of_others = _covariance(others)
    expected = of_others @ np.sum([other.jacobian.T @ other.residuals for other in others], axis=0)
    surprise = own.residuals - own.jacobian @ expected
    spread = np.eye(len(surprise)) + own.jacobian @ of_others @ own.jacobian.T
    misfit = float(surprise @ np.linalg.solve(spread, surprise))
    of_own = _covariance([own])
    return of_own @ own.jacobian.T @ surprise, of_own + of_others, MisfitTest(misfit, max(len(surprise), 1), dof)


def _covariance(said: list[PriorRows]) -> Array:
    rows: Array = np.vstack([each.jacobian for each in said])
    return np.asarray(np.linalg.inv(np.eye(rows.shape[1]) / SAYS_NOTHING**2 + rows.T @ rows))
