"""Sinks at work: one that waits has a thread and a bounded queue of its own, and one that fails ends alone."""

from __future__ import annotations

from contextlib import suppress
from queue import Empty, SimpleQueue
from threading import Thread
from time import sleep

from ..errors import ContactWrenchError
from .sink import NO_TURN, Sink, Turn
from .sinks.file import GrowingFile

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
        self._gathers = isinstance(sink, GrowingFile) and not patient
        self._queue: SimpleQueue[Turn | None] = SimpleQueue()
        self._thread = Thread(target=self._drain, name=f"sink {self.uri}", daemon=True)
        self._thread.start()

    def write(self, turn: Turn) -> None:
        while (full := self._is_full(turn.rows)) and self._patient:
            sleep(0.001)
        if full:
            self._lost += len(turn.readings)
            return
        self._given += turn.rows
        self._queue.put(turn)

    def close(self) -> None:
        self._queue.put(None)
        self._thread.join(DRAIN)
        if self._thread.is_alive():
            self.error = self.error or f"{self.uri}: was not done {DRAIN:g} s after the end: too slow"
            self._drop_waiting()

    def _drop_waiting(self) -> None:
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
    """Open a sink and put it to work.

    Args:
        sink: as `sink_of` or a `Recorder` gives it.
        patient: the caller can wait, as a replay as fast as it goes: it is held back where the sink is slower.

    Returns:
        The sink at work; it is to be closed, which takes at most `DRAIN` s.

    Raises:
        FileAccessError: a file cannot be written.
        DeviceError: nothing can be sent there.
        InputError: its URI, or its file's suffix, is none.
        MissingExtraError: a package that it needs is not installed.
    """
    return _Queued(sink, patient) if sink.waits else OpenSink(sink)
