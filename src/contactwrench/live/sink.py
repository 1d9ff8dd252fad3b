"""What a sink is: where contact wrenches go, or a recording, while the arm runs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from ..compensate.contact_wrenches import ContactWrenches
from ..geometry.arrays import Array


@dataclass(frozen=True, eq=False)
class Turn:
    """What one turn of the session took and made: light, as there may be a thousand in a second.

    Attributes:
        t: (n,) s since 1970, of the readings.
        arrival: (n,) s since 1970, when they came.
        wrench: (n, 6) the readings, N and N m, pull sign, sensor axes.
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


class Sink(Protocol):
    """Where turns go. `waits`: whether a write may wait (a disk); then it is given a thread and a bounded queue of its
    own, and what does not fit is dropped and counted. One that does not wait is written to by the worker itself.
    """

    uri: str
    waits: bool
    dropped: int
    """Rows that were not written."""

    def open(self) -> None:
        """Raises `FileAccessError`, `DeviceError` or `InputError`, one line."""

    def write(self, turn: Turn) -> None:
        """Write a turn, or keep it to be written within a second. Raises as `open`."""

    def close(self) -> None:
        """Write what is left, and close."""
