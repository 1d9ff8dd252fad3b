"""Robotiq FT 300 on a Universal Robots controller: its URCap sends readings, as text, to whoever connects."""

from __future__ import annotations

import re

from ..source import About, Batch, Note, NoteKind, Sample
from ..uri import Uri
from .ft300 import RANGES
from .reader import Reader
from .transport import Tcp

PORT = 63_351
LONGEST = 200
"""Bytes of a reading, which are some 60."""
_reading = re.compile(rb"\(([^()]*)\)").finditer


class RobotiqDecoder:
    """Text to samples: six numbers in parentheses with commas between, N and N m. A line's end may follow or not."""

    def __init__(self) -> None:
        self._buffer = b""

    def feed(self, data: bytes, arrival: float, batch: Batch) -> None:
        """Put what is whole into the batch, and keep the rest."""
        buffer, at = self._buffer + data, 0
        for found in _reading(buffer):
            self._note_garbage(buffer[at : found.start()], batch)
            at = found.end()
            try:
                fx, fy, fz, tx, ty, tz = map(float, found[1].split(b","))
            except ValueError:
                self._note_garbage(found[0], batch)
                continue
            batch.samples.append(Sample(arrival, wrench=(fx, fy, fz, tx, ty, tz)))
        begin = buffer.rfind(b"(", at)
        keep = begin if begin >= 0 and len(buffer) - begin <= LONGEST else len(buffer)
        self._note_garbage(buffer[at:keep], batch)
        self._buffer = buffer[keep:]

    def _note_garbage(self, data: bytes, batch: Batch) -> None:
        if number := len(data.strip()):
            batch.notes.append(Note(NoteKind.GARBAGE, f"{number} bytes that are no reading", number))


class Robotiq(Reader[Tcp]):
    """The controller. What it sends has neither time nor counter: a reading that is lost or repeated is not seen."""

    FORM = "robotiq://HOST[:63351]"
    ABOUT = "Robotiq FT 300 whose cable goes into a Universal Robots controller, by its URCap's port: wrench"
    RATE = "as it sends, about 100 Hz"
    TESTED = "its fake in the lab, written from public clients; no sensor"

    def __init__(self, uri: Uri) -> None:
        uri.only()
        super().__init__(uri, Tcp(uri.text, "controller with Robotiq's URCap"))
        self._at = uri.host, uri.port or PORT

    def open(self) -> About:
        """As `Source`."""
        deadline = self._link.deadline()
        self._link.connect(*self._at, deadline)
        self._begin(RobotiqDecoder())
        self._first(deadline, lambda: self._link.silent("readings such as ( 2.25 , -0.1 , 29.3 , 0.01 , 0.02 , 0.0 )"))
        settings = {"by": "the URCap's port"}
        return About("Robotiq FT 300 by its URCap", wrench=True, orientation=False, ranges=RANGES, settings=settings)
