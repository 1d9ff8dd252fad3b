"""What one recording says of the rotations that it shares with others: a message, as in belief propagation.

The tool's own parameters are eliminated from the whitened readings, linearised at rotations common to all recordings;
what is left are rows that the small turns away from those rotations obey, with unit variance (square-root information,
Bierman, 1977). So a recording whose poses do not fix a mounting still says what they do fix, and the messages of
several simply join the readings of another: nothing is counted twice, and for Gaussian errors the result is the
marginal of the joint estimate.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import InputError
from ..geometry.arrays import Array
from ..model import GRAVITY, MOUNT, RigidTool, free_wrench, gravity_in_flange, wrench_jacobian, wrench_matrix
from ..statistics import MisfitTest
from .noise import PoseReadings
from .priors import Knowledge, known_rotations, rows_of

ROTATIONS = (*MOUNT, *GRAVITY)
SHAREABLE = {"mount": MOUNT, "gravity": GRAVITY}
"""What recordings may have in common, with its parameters."""

SHARING_MODELS = ("auto", "mount", "mount+base")
SAYS_NOTHING = 1.0
"""1/rad: a turn with a std of more than 1 rad may point anywhere, and nothing is said of it."""

NEGLIGIBLE = 1e-10
"""Of the largest singular value: below, a combination of the tool's own parameters leaves no trace in the readings."""


def require_shareable(recordings: int, shared: Sequence[str], model: str, known: Mapping[str, Any]) -> None:
    """Raise `InputError` for what recordings cannot have in common."""
    for name in shared:
        if name not in SHAREABLE:
            raise InputError(f"found {name!r} to share, expected {' or '.join(SHAREABLE)}, or both")
    if not shared:
        raise InputError(f"found nothing to share, expected {' or '.join(SHAREABLE)}, or both")
    if recordings < 2:
        raise InputError(f"found {recordings} recording to share {' and '.join(shared)}, expected two or more")
    if model not in SHARING_MODELS:
        raise InputError(f"model {model!r} shares nothing, expected one of {', '.join(SHARING_MODELS)}")
    if model == "mount" and "gravity" in shared:
        raise InputError(
            "model mount holds gravity, and gravity is to be shared: share mount alone, or choose auto or mount+base"
        )
    of_tool = [name for name in known if name not in SHAREABLE]
    if of_tool:
        raise InputError(
            f"known {of_tool[0]} is of one tool, and each recording has its own: leave it out, or calibrate them apart"
        )


@dataclass(frozen=True, eq=False)
class Message:
    """`information @ turns = turn`, rows (q, 5) and (q,) of unit variance, on the small turns `ROTATIONS` that lead
    from the point (`R_flange_sensor`, `gravity_direction`) to the truth; `dof` behind that variance.
    """

    R_flange_sensor: Array
    gravity_direction: Array
    information: Array
    turn: Array
    dof: float

    def as_knowledge(self) -> Knowledge:
        """Rows that join another recording's readings."""
        return known_rotations(self.R_flange_sensor, self.gravity_direction, self.information, self.turn)

    @property
    def uncertainty(self) -> float:
        """The summed variances (rad^2) of the turns, each 1 rad^2 before the message."""
        return float(np.trace(_covariance([self])))


def message_of(
    readings: PoseReadings,
    noise: Array,
    tool: RigidTool,
    names: tuple[str, ...],
    shared: tuple[str, ...],
    knowledge: tuple[Knowledge, ...],
    dof: float,
) -> Message:
    """What readings with `noise` (6,) say of the parameters `shared` among `names`, linearised at `tool`; `knowledge`
    of the others helps to eliminate them.
    """
    r = gravity_in_flange(readings.R_base_flange, tool.gravity_direction)
    errors = (readings.wrench - free_wrench(wrench_matrix(tool), r)) / noise
    J = wrench_jacobian(tool, readings.R_base_flange, names) / noise[:, None]
    J, said = J.reshape(-1, len(names)), errors.ravel()
    known = rows_of(knowledge, tool, names)
    if known is not None:
        J, said = np.vstack([J, known.jacobian]), np.concatenate([said, known.residuals])
    of_tool = _span(J[:, [k for k, name in enumerate(names) if name not in shared]])
    of_turns = J[:, [names.index(name) for name in shared]]
    left = of_turns - of_tool @ (of_tool.T @ of_turns)
    U, s, Vt = np.linalg.svd(left, full_matrices=False)
    heard = s > SAYS_NOTHING
    information = np.zeros((int(heard.sum()), len(ROTATIONS)))
    information[:, [ROTATIONS.index(name) for name in shared]] = s[heard, None] * Vt[heard]
    return Message(tool.R_flange_sensor, tool.gravity_direction, information, U[:, heard].T @ said, dof)


@dataclass(frozen=True, eq=False)
class Disagreement:
    """How one message differs from the others: the `turn` (5,) between them, its covariance, and the test of it."""

    turn: Array
    covariance: Array
    test: MisfitTest

    def angle(self, which: tuple[str, ...]) -> tuple[float, float]:
        """The turn of the mounting (`MOUNT`) or of gravity (`GRAVITY`) and its std, deg."""
        part = [ROTATIONS.index(name) for name in which]
        turn = self.turn[part]
        angle = float(np.linalg.norm(turn))
        along = turn / angle if angle > 0.0 else np.zeros(len(part))
        std = float(np.sqrt(along @ self.covariance[np.ix_(part, part)] @ along))
        return float(np.rad2deg(angle)), float(np.rad2deg(std))


def disagreement(message: Message, others: list[Message]) -> Disagreement:
    """What `message` says against what the `others` say, all at one point; no prior but that of a turn under 1 rad."""
    of_others = _covariance(others)
    expected = of_others @ np.sum([other.information.T @ other.turn for other in others], axis=0)
    surprise = message.turn - message.information @ expected
    spread = np.eye(len(surprise)) + message.information @ of_others @ message.information.T
    misfit = float(surprise @ np.linalg.solve(spread, surprise))
    own = _covariance([message])
    dof = min(one.dof for one in (message, *others))
    turn = own @ message.information.T @ surprise
    return Disagreement(turn, own + of_others, MisfitTest(misfit, max(len(surprise), 1), dof))


def _covariance(messages: list[Message]) -> Array:
    rows = np.vstack([SAYS_NOTHING * np.eye(len(ROTATIONS)), *(message.information for message in messages)])
    covariance: Array = np.linalg.inv(rows.T @ rows)
    return covariance


def _span(columns: Array) -> Array:
    """Orthonormal columns that span the given ones."""
    length = np.linalg.norm(columns, axis=0)
    U, s, _ = np.linalg.svd(columns / np.where(length > 0.0, length, 1.0), full_matrices=False)
    span: Array = U[:, s > NEGLIGIBLE * s[0]]
    return span
