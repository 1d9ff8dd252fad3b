"""Links to devices, TCP and standard input: connect, wait, take all that came; closed from any thread; errors that say
what to do.
"""

from __future__ import annotations

import errno
import os
import socket
import sys
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from select import select
from selectors import EVENT_WRITE, DefaultSelector
from threading import Lock
from time import monotonic
from typing import Any

from ...errors import visible
from ..source import DeviceError, EndOfStreamError, NobodyYetError, Note

PATIENCE, TO_CONNECT, ATTEMPTS = 10.0, 1.0, 3
"""s that a device may take to connect and to answer, all of it together: a gateway to a serial line, or a controller
that has just begun, takes 4 s. And s to connect, and how often that is tried: a question that was lost is asked again
sooner so than by the system.
"""
LISTENS = 2.5
"""s after which a source that listens says that nobody has sent yet."""
BUFFER = 1 << 22
"""Bytes asked of the kernel for datagrams; it gives what it allows, at least 40 ms of a Net F/T at 7 kHz."""
MOST_BYTES = 1 << 16
LOOK = 0.1
"""s that a wait for what comes, or for a connection, lasts at most: so long `close` waits for it."""
NO_ANSWER = "no answer"
IN_PROGRESS = errno.EINPROGRESS, errno.EWOULDBLOCK
REASONS = {errno.ECONNREFUSED: "nobody listening", **dict.fromkeys((errno.ETIMEDOUT, *IN_PROGRESS), NO_ANSWER)}


class Deadline:
    """A moment that is `seconds` from now, `PATIENCE` where it is not said; it has passed where `ended` says so."""

    def __init__(self, seconds: float | None = None, ended: Callable[[], bool] = lambda: False) -> None:
        self._end, self._ended = monotonic() + (PATIENCE if seconds is None else seconds), ended

    @property
    def left(self) -> float:
        """How many s until then, 0 once it has passed."""
        return 0.0 if self._ended() else max(self._end - monotonic(), 0.0)


class Link(ABC):
    """A socket that one thread at a time reads and any may close, which ends a wait of the reader. Messages name the
    device by its `uri`, and by what is expected there, a `device`.

    The reader holds the lock while it waits, so that no socket is closed, and its number given to another, under it.
    """

    def __init__(self, uri: str, device: str) -> None:
        self._uri, self._device = uri, device
        self._lock, self._closings, self._is_closing = Lock(), 0, False
        self._socket: Any = None

    def receive(self, timeout: float) -> list[Any]:
        """What has come; nothing in silence, `LOOK` s at most, and after `close`. Raises `DeviceError`: it is cut."""
        if self._is_closing:  # whose turn it is with the lock
            return []
        with self._lock:
            return [] if self._socket is None else self._received(min(timeout, LOOK))

    @abstractmethod
    def _received(self, timeout: float) -> list[Any]:
        """What can be read within the time. The lock is held."""

    def send(self, data: bytes) -> None:
        """To the device that it is connected to; what is lost is lost. Raises `DeviceError` where that can be known."""
        if self._socket is not None:
            with suppress(OSError):
                self._socket.send(data)

    def notes(self, used: bool) -> list[Note]:
        """What was noticed, beside what came, since it was last asked; `used`: samples came of what came last."""
        return []

    def close(self) -> None:
        """Close; nothing is left. Also twice, and before it was open."""
        self._closings, self._is_closing = self._closings + 1, True
        with self._lock:
            self._drop()

    def deadline(self, seconds: float | None = None) -> Deadline:
        """`PATIENCE` s from now, or `seconds`; it passes with `close`, so that whoever waits for answers ends too."""
        closings = self._closings
        return Deadline(seconds, lambda: self._closings != closings)

    def error(self, found: str, expected: str, do: str) -> DeviceError:
        """One line that names the device."""
        return DeviceError(f"{self._uri}: found {found}, expected {expected}: {do}")

    def another(self, answer: bytes, expected: str) -> DeviceError:
        """What is raised where something else answers."""
        seen = visible(answer[:24].decode("latin-1"))
        return self.error(f"an answer that begins '{seen}'", expected, f"check that this is the {self._device}")

    def silent(self, expected: str) -> DeviceError:
        """What is raised where nothing answers."""
        return self.error("no answer", expected, f"check that this is the {self._device}, and that no one else uses it")

    def nobody(self, place: str, expected: str, do: str) -> NobodyYetError:
        """What is raised where a source listens and nobody has sent yet."""
        return NobodyYetError(str(self.error(f"{place} open and nobody who sends yet", expected, do)))

    def _use(self, made: Any) -> None:
        """Take a socket, or a file. The lock is held."""
        self._drop()
        self._socket, self._is_closing = made, False

    def _use_socket(self, family: int, kind: int) -> socket.socket:
        made = socket.socket(family, kind)
        made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER)
        self._use(made)
        return made

    def addresses(self, host: str, port: int, kind: int = 0) -> list[Any]:
        """Where a host may be reached. Raises `DeviceError`: none was stated, or nobody knows it."""
        if not host:
            raise self.error("no host", "its name or address", f"write {self._uri.partition(':')[0]}://192.168.0.10")
        try:
            return socket.getaddrinfo(host, port, type=kind)
        except (OSError, UnicodeError):
            raise self.error(f"no host {host}", f"the {self._device}", "check the name, or write its address") from None

    def _drop(self) -> None:
        if self._socket is not None:
            self._socket.close()
        self._socket = None


class Tcp(Link):
    """A connection."""

    def connect(self, host: str, port: int, deadline: Deadline) -> None:
        """Connect. Raises `DeviceError`: no such name, refused, or no answer."""
        reason, found = NO_ANSWER, self.addresses(host, port, socket.SOCK_STREAM)
        for family, kind, _, _, address in found * ATTEMPTS:
            if deadline.left:
                reason = self._connected(family, kind, address, deadline)
            if not reason:
                return
            if reason != NO_ANSWER and len(found) == 1:
                break
        do = "check its power, its cable and the address; it must be in this computer's network"
        raise self.error(f"{reason} at {host} port {port}", f"the {self._device}", do)

    def send(self, data: bytes) -> None:
        """Send; a few bytes, which always fit. Raises `DeviceError`."""
        try:
            if self._socket is not None:
                self._socket.send(data)
        except OSError as error:
            raise self._cut(error) from None

    def _received(self, timeout: float) -> list[bytes]:
        if self._socket.gettimeout() != timeout:  # to set it asks the system each time
            self._socket.settimeout(timeout)
        try:
            data = self._socket.recv(MOST_BYTES)
        except (TimeoutError, BlockingIOError):
            return []
        except OSError as error:
            raise self._cut(error) from None
        if not data:
            raise self._cut(None)
        return [data]

    def _connected(self, family: int, kind: int, address: Any, deadline: Deadline) -> str:
        """An empty text, or why not."""
        with self._lock:
            made = self._use_socket(family, kind)
            made.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            made.setblocking(False)
            status, until = made.connect_ex(address), monotonic() + TO_CONNECT
            with DefaultSelector() as selector:
                selector.register(made, EVENT_WRITE)
                while status in IN_PROGRESS and deadline.left and monotonic() < until:
                    if selector.select(LOOK):
                        status = made.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)
            if status:
                self._drop()
            return (REASONS.get(status) or os.strerror(status).lower()) if status else ""

    def _cut(self, error: OSError | None) -> DeviceError:
        why = f" ({(error.strerror or str(error)).lower()})" if error is not None else ""
        return self.error(f"the connection closed{why}", "samples", f"check the {self._device} and its cable")


class Driver(Link):
    """A library's own object, which gives what has come by `take(timeout)`, and has a `close`."""

    @contextmanager
    def start(self, made: Any) -> Iterator[None]:
        """Begin with it; `close` waits until whatever is done with it first has ended."""
        with self._lock:
            self._use(made)
            yield

    def _received(self, timeout: float) -> list[Any]:
        return list(self._socket.take(timeout))


class StandardInput(Link):
    """What another program writes."""

    def start(self) -> None:
        """Begin. Raises `EndOfStreamError`: it is closed."""
        if sys.stdin is None:
            raise self._ended()
        with self._lock:
            self._use(os.fdopen(os.dup(sys.stdin.fileno()), "rb", buffering=0))

    def _received(self, timeout: float) -> list[bytes]:
        if not select([self._socket], [], [], timeout)[0]:
            return []
        try:
            data = self._socket.read(MOST_BYTES)
        except OSError:  # of a line that was pulled out
            data = b""
        if data == b"":
            raise self._ended()
        return [data] if data else []

    def _ended(self) -> DeviceError:
        return EndOfStreamError(str(self.error("its end", "more lines", "keep the program that writes them running")))
