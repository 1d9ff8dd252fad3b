"""What all sources of bytes do: read, decode, and close."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Any, Generic, Protocol, TypeVar

from ..source import Batch, DeviceError, Note, NoteKind, now
from ..uri import Uri
from .transport import Deadline, Link

NOT_A_STREAM = 100_000
"""Bytes without a sample after which what comes is no stream of the device."""
ZEROED = "the box was told to zero itself: its bias is not the sensor's"
NOT_AGAIN = (
    "the box was not told again: where it lost power it has lost its zero too, so take a new one with a free tool"
)
"""What a box says that zeroed itself when it was first connected to; and when it is connected to again, with a tool
that may touch something, and with a calibration that knows the first zero.
"""


class Decoder(Protocol):
    """Bytes to samples."""

    def feed(self, data: Any, arrival: float, batch: Batch) -> None:
        """Put what is whole into the batch, and keep the rest."""


def note_garbage(number: int, what: str, batch: Batch) -> None:
    """Note bytes, if there are any, that are none of `what` is decoded."""
    if number:
        batch.notes.append(Note(NoteKind.GARBAGE, f"{number} bytes that are no {what}", number))


AnyLink = TypeVar("AnyLink", bound=Link)


class Reader(Generic[AnyLink]):
    """A source's second half; `open` is the first. `farewell` is what the device is sent before the link is closed."""

    PORT = 0
    """That is meant where the URI has none."""
    any_thread = True
    OPTIONS: tuple[str, ...] = ()
    """That the URI may have."""

    def __init__(self, uri: Uri, link: AnyLink, farewell: bytes = b"") -> None:
        uri.only(*self.OPTIONS)
        self.uri, self._at = uri.text, (uri.host, uri.port or self.PORT)
        self._link, self._farewell = link, farewell
        self._early, self._unread = Batch(), 0
        self._is_to_zero, self._was_zeroed = uri.switch("zero"), False

    def _zeroed_now(self) -> dict[str, str]:
        """What is to be said of its zero, once it has been told to take one, if it was to."""
        told = ZEROED if self._is_to_zero else NOT_AGAIN if self._was_zeroed else ""
        self._is_to_zero, self._was_zeroed = False, bool(told)
        return {"zero": told} if told else {}

    def read(self, timeout: float) -> Batch:
        """As `Source`."""
        batch, self._early = self._early, Batch()
        if batch.samples:
            return batch
        data = self._link.receive(timeout)
        arrival = now()
        for each in data:
            self._decoder.feed(each, arrival, batch)
            self._unread += len(each) if isinstance(each, bytes) else 0
        if batch.samples:
            self._unread = 0
        elif self._unread > NOT_A_STREAM:
            alike = bool(batch.notes) and batch.notes[-1].kind is NoteKind.REPEATED
            found = f"{self._unread} bytes{', all stamped alike' if alike else ' without a sample'}"
            do = "let their time or number go on, or leave it out" if alike else "check what sends them"
            raise self._link.error(found, "samples", do)
        batch.notes += self._link.notes(bool(batch.samples))
        return batch

    def close(self) -> None:
        """As `Source`."""
        if self._farewell:
            with suppress(DeviceError):
                self._link.send(self._farewell)
        self._link.close()

    def _begin(self, decoder: Decoder) -> None:
        self._decoder, self._early, self._unread = decoder, Batch(), 0

    def _first(self, deadline: Deadline, missing: Callable[[], DeviceError], number: int = 1) -> Batch:
        """What came up to the first samples, so many; `read` gives it again. Raises `missing` where none come."""
        early = Batch()
        while len(early.samples) < number:
            if not deadline.left:
                raise missing()
            early.add(self.read(deadline.left))
            self._unread = 0  # the deadline says it better
        self._early = early
        return early
