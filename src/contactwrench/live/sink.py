"""What a sink is: where contact wrenches go, or a recording, while the arm runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import chain
from typing import NamedTuple, Protocol

import numpy as np

from ..compensate.contact_wrenches import NOT_JUDGED, Contact, ContactWrench, ContactWrenches
from ..geometry.arrays import Array
from .source import Four, Six, Three


class Reading(NamedTuple):
    """A reading as it is handed on: units and axes as of `Turn.wrench` and its neighbours."""

    t: float
    arrival: float
    wrench: Six
    orientation: Four
    flaw: str


class Pose(NamedTuple):
    """An orientation that came, likewise."""

    t: float
    orientation: Four
    position: Three


def _column(of: str, name: str, *row: int) -> cached_property[Array]:
    """An array, made where it is asked for, of what the `readings` or `poses` of a turn have under a name."""
    return cached_property(lambda turn: np.array([getattr(each, name) for each in getattr(turn, of)]).reshape(-1, *row))


@dataclass(frozen=True, eq=False)
class Turn:
    """What one turn of the session took and made: plain numbers, as there may be a thousand in a second; arrays of them
    are made where they are asked for.

    Attributes:
        readings: n of them.
        poses: m orientations.
        judged: the contact wrenches of the readings; empty while no calibration runs.
        ended: contacts that ended in this turn.
    """

    readings: list[Reading]
    poses: list[Pose]
    judged: list[ContactWrench] = field(default_factory=list)
    ended: tuple[Contact, ...] = ()

    @property
    def rows(self) -> int:
        """How many readings and orientations came."""
        return len(self.readings) + len(self.poses)

    t = _column("readings", "t")
    """Of the readings (n,), s since 1970."""
    arrival = _column("readings", "arrival")
    """When they came (n,), s since 1970."""
    wrench = _column("readings", "wrench", 6)
    """The readings (n, 6), N and N m, sign and axes as the device gives them."""
    orientation = _column("readings", "orientation", 4)
    """Quaternions x, y, z, w of `R_base_flange` at those times (n, 4); NaN where it is not known."""
    pose_t = _column("poses", "t")
    """Of the orientations that came (m,), s since 1970."""
    pose = _column("poses", "orientation", 4)
    """Quaternions x, y, z, w of `R_base_flange` (m, 4)."""
    position = _column("poses", "position", 3)
    """Of the flange (m, 3), m, base axes; NaN where it is not known."""

    @cached_property
    def flaw(self) -> list[str]:
        """Why each reading (n) is not to be used, or an empty text."""
        return [each.flaw for each in self.readings]

    @cached_property
    def contact(self) -> ContactWrenches | None:
        """`judged` and `ended`, without statistics and covariances; None: there are none."""
        if not self.judged:
            return None
        of = self.judged
        return ContactWrenches(
            wrench=np.array([each.wrench for each in of]),
            std=np.array([each.std for each in of]),
            t=np.array([each.t for each in of]),
            judged=True,
            valid=np.array([each.valid for each in of]),
            reason=tuple(each.reason for each in of),
            contact=np.array([NOT_JUDGED if each.contact is None else each.contact for each in of], np.int8),
            contacts=self.ended,
        )

    @classmethod
    def joined(cls, turns: Sequence[Turn]) -> Turn:
        """Turns one after the other as one; `contact` is of the readings that have one."""
        every = chain.from_iterable
        return cls(
            [*every(turn.readings for turn in turns)],
            [*every(turn.poses for turn in turns)],
            [*every(turn.judged for turn in turns)],
            tuple(every(turn.ended for turn in turns)),
        )


NO_TURN = Turn([], [])
"""In which nothing came."""


class Sink(Protocol):
    """Where turns go. `waits`: whether a write may wait (a disk); then it is given a thread and a bounded queue of its
    own, and what does not fit is dropped and counted; in silence it gets a turn without rows each half second. One that
    does not wait is written to by the worker itself.
    """

    uri: str
    waits: bool
    written: int
    """Rows so far: readings, or contact wrenches."""
    dropped: int
    """Rows that were not written, those of a write that raised among them."""

    def open(self) -> None:
        """Raises `FileAccessError`, `DeviceError` or `InputError`, one line."""

    def write(self, turn: Turn) -> None:
        """Write a turn, or keep it to be written within a second. Raises as `open`."""

    def close(self) -> None:
        """Write what is left, and close."""
