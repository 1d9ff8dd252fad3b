"""Contact wrenches to any program: one JSON line a sample, one UDP datagram a line."""

from __future__ import annotations

import socket

import msgspec

from ...errors import InputError
from ..sink import Turn
from ..source import DeviceError
from ..uri import Uri

CONTACT = (False, True, None)
"""By the code of `ContactWrenches.contact`, of which -1 is the last place."""


class Line(msgspec.Struct):
    """A sample: `t` s since 1970, the contact wrench N and N m and its `std` (6,), null where it is not known;
    `reason`: why it is not valid.
    """

    t: float
    fx: float
    fy: float
    fz: float
    tx: float
    ty: float
    tz: float
    std: list[float]
    valid: bool
    contact: bool | None
    reason: str | None


class UdpLines:
    """`udp://HOST:PORT`. It never waits: what the socket does not take at once, or nobody listens to, is dropped."""

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
        self._encode = msgspec.json.Encoder().encode
        self._socket: socket.socket | None = None

    def open(self) -> None:
        """Raises `DeviceError` for a host that nobody knows."""
        try:
            family, kind, _, _, address = socket.getaddrinfo(self._host, self._port, type=socket.SOCK_DGRAM)[0]
            self._socket = socket.socket(family, kind)
            self._socket.setblocking(False)
            self._socket.connect(address)
        except OSError as error:
            self.close()
            raise DeviceError(f"{self.uri}: cannot be sent to ({error.strerror}): check host and network") from None

    def write(self, turn: Turn) -> None:
        """Send the contact wrenches, none where there is no calibration yet."""
        contact = turn.in_contact()
        if contact is None or contact.t is None or self._socket is None:
            return
        send, encode = self._socket.send, self._encode
        columns = (contact.t, contact.wrench, contact.std, contact.valid, contact.contact)
        for t, (fx, fy, fz, tx, ty, tz), std, valid, touches, reason in zip(
            *(column.tolist() for column in columns), contact.reason, strict=True
        ):
            text = None if reason is None else str(reason)
            try:
                send(encode(Line(t, fx, fy, fz, tx, ty, tz, std, valid, CONTACT[touches], text)) + b"\n")
                self.written += 1
            except OSError:
                self.dropped += 1

    def close(self) -> None:
        """Close the socket."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None
