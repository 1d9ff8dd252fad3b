"""Contact wrenches to any program: one JSON line a sample, one UDP datagram a line."""

from __future__ import annotations

import socket

import msgspec

from ...errors import InputError
from ...recording.tables.columns import WRENCH_COLUMNS
from ..sink import Turn
from ..source import DeviceError
from ..uri import Uri

Line = msgspec.defstruct("Line", ("t", *WRENCH_COLUMNS, "std", "valid", "contact", "reason"), gc=False)


class UdpLines:
    """`udp://HOST:PORT`: `t` s since 1970, `fx`..`tz` N and N m, `std` (6,), `valid`, `contact` and, where it is not
    valid, `reason`; null is not known. It never waits: what the socket does not take at once is dropped.
    """

    FORM = "udp://HOST:PORT"
    ABOUT = "one JSON line a sample: t, fx..tz, std, valid, contact, reason"
    RATE = "the sensor's"
    TESTED = "a socket"
    waits = False

    def __init__(self, uri: Uri) -> None:
        uri.only()
        if not uri.host or uri.port is None or uri.path:
            raise InputError(f"{uri}: found no host and port to send to, expected a URI like udp://127.0.0.1:9000")
        self.uri, self._host, self._port = uri.text, uri.host, uri.port
        self.written = self.dropped = 0
        self._encode = msgspec.json.Encoder(enc_hook=str).encode  # a Reason is a text with a kind
        self._socket: socket.socket | None = None

    def open(self) -> None:
        """Raises `DeviceError` for a host that nobody knows."""
        try:
            family, kind, _, _, address = socket.getaddrinfo(self._host, self._port, type=socket.SOCK_DGRAM)[0]
            self._socket = socket.socket(family, kind)
            self._socket.setblocking(False)
            self._socket.connect(address)
        except (OSError, UnicodeError) as error:
            self.close()
            why = getattr(error, "strerror", "") or error
            raise DeviceError(f"{self.uri}: cannot be sent to ({why}): check host and network") from None

    def write(self, turn: Turn) -> None:
        """Send the contact wrenches, none where there is no calibration yet."""
        if self._socket is None:
            return
        send, encode = self._socket.send, self._encode
        for each in turn.judged:
            wrench, std = each.wrench.tolist(), each.std.tolist()
            try:
                send(encode(Line(each.t, *wrench, std, each.valid, each.contact, each.reason)) + b"\n")
                self.written += 1
            except OSError:
                self.dropped += 1

    def close(self) -> None:
        """Close the socket."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None
