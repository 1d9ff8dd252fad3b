"""What a sink is: where contact wrenches go, or a recording, while the arm runs. And sinks at work: one that waits has
a thread and a bounded queue of its own, and one that fails ends alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from itertools import chain
from queue import Empty, SimpleQueue
from threading import Thread
from time import sleep
from typing import NamedTuple, Protocol

import numpy as np

from ..compensate.contact_wrenches import NOT_JUDGED, Contact, ContactWrench, ContactWrenches
from ..errors import ContactWrenchError
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
    does not wait is written to by the worker itself. A sink that waits and has `gathers` set is given turns seldom.
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


MOST_WAITING = 20_000
"""Readings and orientations: a disk that stalls for ten seconds at 1 kHz loses nothing; some 15 MB."""
IDLE = 0.5
"""s of silence, after which a sink may write what it has kept."""
GATHERED = 0.05
"""s over which turns for a file are left in the queue: a thread that woke for each would take as much as the worker."""
DRAIN = 2.0
"""s for what waits when the session ends."""


class OpenSink:
    """A sink that is open. A write never raises and never waits: `error`, one line, says why the sink has ended, empty
    while it has not; `written` and `dropped` count rows.
    """

    def __init__(self, sink: Sink) -> None:
        self._sink, self._lost, self._unwritten = sink, 0, 0
        self.uri, self.error = sink.uri, ""
        sink.open()

    @property
    def written(self) -> int:
        """Rows that the sink has written."""
        return self._sink.written

    @property
    def dropped(self) -> int:
        """Rows that were not written: no room, too slow, or after the end of the sink."""
        return self._sink.dropped + self._lost + self._unwritten

    def write(self, turn: Turn) -> None:
        """Give a turn to the sink."""
        if self.error:
            self._unwritten += len(turn.readings)
            return
        try:
            self._sink.write(turn)
        except Exception as error:  # a sink may be anybody's
            self._end(error)

    def close(self) -> None:
        """Write what is left, and close."""
        try:
            self._sink.close()
        except Exception as error:
            self._end(error)

    def _end(self, error: Exception) -> None:
        said = " ".join(str(error).split())
        known = isinstance(error, ContactWrenchError)
        self.error = self.error or (said if known else f"{self.uri}: the sink failed ({type(error).__name__}: {said})")


class _Queued(OpenSink):
    """With a thread and a queue. `patient`: a write waits for room; nothing is dropped."""

    def __init__(self, sink: Sink, patient: bool) -> None:
        super().__init__(sink)
        self._patient, self._given, self._taken = patient, 0, 0
        self._gathers = getattr(sink, "gathers", False) and not patient
        self._queue: SimpleQueue[Turn | None] = SimpleQueue()
        self._thread = Thread(target=self._drain, name=f"sink {self.uri}", daemon=True)
        self._thread.start()

    def write(self, turn: Turn) -> None:
        rows = turn.rows
        while (full := self._is_full(rows)) and self._patient:
            sleep(0.001)
        if full:
            self._lost += len(turn.readings)
            return
        self._given += rows
        self._queue.put(turn)

    def close(self) -> None:
        self._queue.put(None)
        self._thread.join(DRAIN)
        if self._thread.is_alive():
            self.error = self.error or f"{self.uri}: was not done {DRAIN:g} s after the end: too slow"
            with suppress(Empty):
                while True:
                    turn = self._queue.get_nowait()
                    self._lost += 0 if turn is None else len(turn.readings)
            self._queue.put(None)

    def _is_full(self, rows: int) -> bool:
        waiting = self._given - self._taken
        return waiting > 0 and waiting + rows > MOST_WAITING

    def _drain(self) -> None:
        while (turn := self._next()) is not None:
            super().write(turn)
            self._taken += turn.rows
            if self._queue.empty() and self._gathers:
                sleep(GATHERED)
        super().close()

    def _next(self) -> Turn | None:
        try:
            return self._queue.get(timeout=IDLE)
        except Empty:
            return NO_TURN


def open_sink(sink: Sink, *, patient: bool = False) -> OpenSink:
    """Open a sink and put it to work; it is to be closed, which takes at most `DRAIN` s. `patient`: the caller can
    wait, as a replay as fast as it goes, and is held back where the sink is slower. Raises as the sink's own `open`.
    """
    return _Queued(sink, patient) if sink.waits else OpenSink(sink)
