"""UDP for devices: of all who send to a port one program is listened to."""

from __future__ import annotations

import socket
from collections import OrderedDict
from collections.abc import Callable
from contextlib import suppress
from math import exp
from time import monotonic
from typing import Any

from ..source import Note, NoteKind
from .transport import MOST_BYTES, Link

MOST = 4_096
"""Datagrams of one read."""
ANOTHER = 1.0
"""s without a sample of a port's sender, after which it may be another one; before, two would be mixed."""
STEADY, REMEMBERED = 3, 4
"""Datagrams of one port of a sender's, after which others of the same computer are other programs; and how many ports
are remembered: a program that opens a socket for each datagram sends hardly twice from one of the last ones.
"""
GONE, PAUSES, FORGETS = 0.05, 3.0, 1.0
"""s, and so many of its longest pauses, which are forgotten within some s, without a datagram of a port, after which
another one of the same computer is the same program, begun anew: a robot that waits longer for its answers stops.
"""


class Udp(Link):
    """Datagrams of one program: of the one it is connected to, or of the first that sends samples to a port."""

    _one: tuple[str, int] | None = None
    _sender: Any = None
    _used = 0.0
    _others: tuple[int, str] = 0, ""

    def connect(self, host: str, port: int) -> None:
        """Send to and take from one address only. Raises `DeviceError`."""
        family, kind, _, _, address = self.addresses(host, port, socket.SOCK_DGRAM)[0]
        with self._lock:
            made = self._use_socket(family, kind)
            self._try(lambda: made.connect(address), f"no way to {host}", "check the network")
            self._listen_anew()

    def bind(self, host: str, port: int) -> int:
        """Take from whoever sends first, until no sample of it has come for `ANOTHER` s, at an address of this
        computer's (empty: all, of IPv6 too); the port. Raises `DeviceError`.
        """
        address: str | int
        family, address = (socket.AF_INET6, "::") if socket.has_dualstack_ipv6() else (socket.AF_INET, "")
        if host:
            try:
                family, _, _, _, (address, *_) = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
            except (OSError, UnicodeError):
                expected = "a name or an address of this computer's"
                raise self.error(f"no host {host}", expected, "correct it, or leave it out") from None
        with self._lock:
            made = self._use_socket(family, socket.SOCK_DGRAM)
            if not host and family == socket.AF_INET6:
                made.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 0)
            do = "end the other program, or choose another"
            self._try(lambda: made.bind((address, port)), f"port {port} taken", do)
            self._listen_anew()
            bound: int = made.getsockname()[1]
            return bound

    def _listen_anew(self) -> None:
        self._one, self._others = None, (0, "")
        self._heard = self._longest = 0.0
        self._sent = OrderedDict[tuple[str, int], int]()

    def answer(self, data: bytes) -> None:
        """To where the last datagram that was taken came from."""
        if self._socket is not None:
            with suppress(OSError):
                self._socket.sendto(data, self._sender)

    def _received(self, timeout: float) -> list[bytes]:
        came: list[tuple[bytes, Any]] = []
        try:
            while len(came) < MOST:
                self._socket.settimeout(0.0 if came else timeout)
                came.append(self._socket.recvfrom(MOST_BYTES))
        except (TimeoutError, BlockingIOError, ConnectionResetError):
            pass
        except ConnectionRefusedError:
            if not came:
                do = f"check the address and that it is the {self._device}"
                raise self.error("nobody listening", f"the {self._device}", do) from None
        kept, t = [], monotonic()
        for data, sender in came:
            if self._takes(sender[:2], t):
                self._sender = sender
                kept.append(data)
            else:
                place = f"{sender[0].removeprefix('::ffff:')} port {sender[1]}"
                self._others = self._others[0] + 1, place
        return kept

    def _takes(self, sender: tuple[str, int], t: float) -> bool:
        """Whether it is the one that is listened to at `t` s, or becomes it."""
        one = self._one
        if sender != one:
            silent = one is None or t - self._used > ANOTHER
            begun_anew = one is not None and one[0] == sender[0] and self._is_gone(one, t)
            if not silent and not begun_anew:
                return False
            self._used = t if silent else self._used
            self._one, self._heard, self._longest = sender, t, 0.0
        passed, self._heard = t - self._heard, t
        self._longest = max(passed, self._longest * exp(-passed / FORGETS))
        if (sent := self._sent.get(sender, 0)) < STEADY:
            self._sent[sender] = sent + 1
            self._sent.move_to_end(sender)
            if len(self._sent) > REMEMBERED:
                self._sent.popitem(last=False)
        return True

    def _is_gone(self, one: tuple[str, int], t: float) -> bool:
        """Whether another port of the same computer may be the same program, begun anew."""
        return self._sent.get(one, 0) < STEADY or t - self._heard > max(GONE, PAUSES * self._longest)

    def notes(self, used: bool) -> list[Note]:
        """As `Link`: others that sent. What is no sample, as of who sends by mistake, keeps nobody else away."""
        self._used = monotonic() if used else self._used
        (number, other), self._others = self._others, (0, "")
        text = f"another sender, {other}, which is not used: let only one program send to this port"
        return [Note(NoteKind.GARBAGE, text, number)] if number else []

    def _try(self, what: Callable[[], Any], found: str, do: str) -> None:
        try:
            what()
        except (OSError, UnicodeError) as error:
            self._drop()
            why = (getattr(error, "strerror", "") or str(error)).lower()
            raise self.error(f"{found} ({why})", f"the {self._device}", do) from None
