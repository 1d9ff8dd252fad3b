"""Fake devices as TCP servers, and on a UDP socket."""

from __future__ import annotations

import socket
import struct
from abc import abstractmethod
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from select import select
from time import sleep

from ..geometry.arrays import Array
from .device import LOCALHOST, Fake, Packets

CUT_APART = 0.001
"""s between two parts of a packet that is cut."""
PATIENCE = 0.2
"""s: a client that takes nothing for so long is dropped."""
RECEIVED = 65_536


def free_port() -> int:
    """A port of this machine at which nobody listens just now, for UDP."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind((LOCALHOST, 0))
        return int(probe.getsockname()[1])


@dataclass(eq=False)
class Client:
    """Who has connected; what has come from there and is not yet understood; whether rows are wanted, which fields of
    them where that is `asked`, and of how many rows one.
    """

    socket: socket.socket
    inbox: bytearray = field(default_factory=bytearray)
    wants_rows: bool = False
    asked: Sequence[str] = ()
    every: int = 1


class TcpFake(Fake):
    """A device that is a TCP server, for any number of clients."""

    SENDS_UNASKED = False
    """Whether all clients want rows from the beginning on."""
    _listener: socket.socket

    def _open(self) -> None:
        self._listener = socket.create_server((self.host, self.port))
        self.port = self._listener.getsockname()[1]
        self._clients: list[Client] = []

    def _close(self) -> None:
        self._cut()
        self._listener.close()

    def _cut(self) -> None:
        for client in list(self._clients):
            self._drop(client)

    def _drop(self, client: Client) -> None:
        client.socket.close()
        if client in self._clients:
            self._clients.remove(client)

    def _wanted(self) -> bool:
        return any(client.wants_rows for client in self._clients)

    def _turn(self, timeout: float) -> None:
        sockets = {client.socket: client for client in self._clients}
        for ready in select([self._listener, *sockets], [], [], timeout)[0]:
            if ready is self._listener:
                self._accept(ready.accept()[0])
            else:
                self._read(sockets[ready])

    def _accept(self, connection: socket.socket) -> None:
        connection.settimeout(PATIENCE)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        client = Client(connection, wants_rows=self.SENDS_UNASKED)
        self._clients.append(client)
        self._accepted(client)

    def _accepted(self, client: Client) -> None:
        """Greet a new client: most devices wait to be asked."""

    def _read(self, client: Client) -> None:
        try:
            data = client.socket.recv(RECEIVED)
        except OSError:
            data = b""
        if not data:
            self._drop(client)
            return
        client.inbox += data
        try:
            self._received(client)
        except (ValueError, struct.error):  # it speaks another protocol
            self._drop(client)

    def _received(self, client: Client) -> None:
        """Understand what is in the client's inbox, and take it out: a device that only sends leaves it."""
        client.inbox.clear()

    def _packets(self, client: Client, t0: float, rows: Array) -> Packets:
        """A packet a row, for a client: a device that answers and no more has none."""
        return []

    def _send(self, t0: float, rows: Array) -> None:
        for client in [each for each in self._clients if each.wants_rows]:
            self._to(client, self._faulty(self._packets(client, t0, rows)))

    def _answer(self, client: Client, data: bytes) -> None:
        sleep(self._late)
        self._to(client, [data])

    def _to(self, client: Client, packets: Packets) -> None:
        data = b"".join(packets)
        first = len(packets[0]) // 2 if self._split and packets else 0
        try:
            if first:
                client.socket.sendall(data[:first])
                sleep(CUT_APART)
            client.socket.sendall(data[first:])
        except OSError:  # it is gone, or does not read
            self._drop(client)


class UdpFake(Fake):
    """A device on one UDP socket, with one listener at a time: who has asked, or `target`, who is sent to unasked."""

    target: tuple[str, int] | None = None
    _socket: socket.socket
    _listener: tuple[str, int] | None

    @property
    def uri(self) -> str:
        """What a listener is given: of one that sends unasked the port at which it listens itself."""
        return super().uri if self.target is None else f"{self.scheme}://:{self.target[1]}"

    def _open(self) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind((self.host, self.port))
        self.port, self._listener = self._socket.getsockname()[1], self.target

    def _close(self) -> None:
        self._cut()
        self._socket.close()

    def _cut(self) -> None:
        self._listener = None

    def _wanted(self) -> bool:
        return self._listener is not None

    def _turn(self, timeout: float) -> None:
        if select([self._socket], [], [], timeout)[0]:
            self._receive()

    def _receive(self) -> None:
        with suppress(OSError, ValueError):  # what was sent has not arrived, or what comes means nothing
            self._received(*self._socket.recvfrom(RECEIVED))

    def _received(self, data: bytes, address: tuple[str, int]) -> None:
        """Understand a datagram: a device that only sends takes none."""

    @abstractmethod
    def _packets(self, t0: float, rows: Array) -> Packets:
        """A datagram a row."""

    def _send(self, t0: float, rows: Array) -> None:
        packets = self._faulty(self._packets(t0, rows))
        if self._listener is None:
            return
        for packet in packets:
            with suppress(OSError):
                self._socket.sendto(packet[: len(packet) // 2] if self._split else packet, self._listener)
