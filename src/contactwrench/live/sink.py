"""What a sink is: where contact wrenches go, or a recording, while the arm runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import Protocol

import numpy as np

from ..compensate.contact_wrenches import ContactWrenches
from ..geometry.arrays import Array


@dataclass(frozen=True, eq=False)
class Turn:
    """What one turn of the session took and made: light, as there may be a thousand in a second.

    Attributes:
        t: (n,) s since 1970, of the readings.
        arrival: (n,) s since 1970, when they came.
        wrench: (n, 6) the readings, N and N m, sign and axes as the device gives them.
        orientation: (n, 4) quaternions x, y, z, w of `R_base_flange` at those times; NaN where it is not known.
        flaw: (n) why a reading is not to be used, or an empty text.
        pose_t: (m,) s since 1970, of the orientations that came.
        pose: (m, 4) quaternions x, y, z, w of `R_base_flange`.
        position: (m, 3) m of the flange, base axes; NaN where it is not known.
        contact: of the n readings, while a calibration runs; None: there is none yet.
    """

    t: Array
    arrival: Array
    wrench: Array
    orientation: Array
    flaw: list[str]
    pose_t: Array
    pose: Array
    position: Array
    contact: ContactWrenches | None

    @property
    def rows(self) -> int:
        """How many readings and orientations came."""
        return len(self.t) + len(self.pose_t)

    def in_contact(self) -> ContactWrenches | None:
        """The contact wrenches with their times; None: there are none."""
        if self.contact is None or self.contact.t is not None:
            return self.contact
        return replace(self.contact, t=self.t)

    @classmethod
    def joined(cls, turns: Sequence[Turn]) -> Turn:
        """Turns one after the other as one; `contact` is of the readings that have one."""
        parts = [contact for turn in turns if (contact := turn.in_contact()) is not None]
        return cls(
            **{name: np.concatenate([getattr(turn, name) for turn in turns]) for name in ARRAYS},
            flaw=list(chain.from_iterable(turn.flaw for turn in turns)),
            contact=ContactWrenches.concatenate(parts) if parts else None,
        )


ARRAYS = ("t", "arrival", "wrench", "orientation", "pose_t", "pose", "position")
NO_TURN = Turn(
    np.empty(0),
    np.empty(0),
    np.empty((0, 6)),
    np.empty((0, 4)),
    [],
    np.empty(0),
    np.empty((0, 4)),
    np.empty((0, 3)),
    None,
)
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
