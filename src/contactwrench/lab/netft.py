"""An ATI Net F/T box: records of counts over UDP (RDT), and what a count is worth over HTTP.

A request is 8 bytes, big-endian: 0x1234, a command (0 stop, 2 stream, 0x42 zero), and how many records (0: for ever). A
record is 36 bytes: its own number, the sensor's, a status, and six counts.
"""

from __future__ import annotations

import socket
import struct
from contextlib import suppress
from select import select
from typing import Any

import numpy as np

from ..geometry.arrays import Array
from .device import Packets
from .sockets import PATIENCE, RECEIVED, UdpFake
from .truth import Truth

REQUEST = struct.Struct(">HHI")
STREAM, ZERO = 2, 0x42
WRAPS = 1 << 32
INTERNAL_RATE = 7000.0
"""Hz: what the sensor's own number counts."""
SATURATED = 0xC000_0000
"""A status word, with the bit that says that there is an error (ATI, Ethernet Axia manual, bit patterns)."""


class NetFt(UdpFake):
    """The box. `http_port` is that of its page, 0: any that is free; `counts` are those of a unit of force, and of
    torque, `units` as the page spells them, in which the truth is taken to be. `asked`: every command that has come, to
    see that nobody zeroes the sensor.
    """

    scheme = "netft"

    def __init__(
        self,
        truth: Truth,
        rate: float = 1000.0,
        *,
        http_port: int = 0,
        counts: tuple[float, float] = (1e6, 1e6),
        units: tuple[str, str] = ("N", "Nm"),
        **more: Any,
    ) -> None:
        super().__init__(truth, rate, **more)
        self.http_port, self._counts, self._units, self.asked = http_port, counts, units, list[int]()
        self._scale = np.repeat(counts, 3)
        self._count = 0

    @property
    def uri(self) -> str:
        """What a listener is given; the page's port where it is not the usual one."""
        return f"{super().uri}?http={self.http_port}"

    def set_counts(self, counts: tuple[float, float]) -> None:
        """Change on its page what a count is worth."""
        self._counts, self._scale = counts, np.repeat(counts, 3)

    def _open(self) -> None:
        super()._open()
        self._http = socket.create_server((self.host, self.http_port))
        self.http_port = self._http.getsockname()[1]

    def _close(self) -> None:
        super()._close()
        self._http.close()

    def _turn(self, timeout: float) -> None:
        for ready in select([self._socket, self._http], [], [], timeout)[0]:
            if ready is self._http:
                self._serve(self._http.accept()[0])
            else:
                self._receive()

    def _serve(self, connection: socket.socket) -> None:
        """The page, to a client that asks within `PATIENCE`."""
        connection.settimeout(PATIENCE)
        with connection, suppress(OSError):
            path = connection.recv(RECEIVED).split(b" ")[1:2]
            body = self._page().encode() if path == [b"/netftapi2.xml"] else b""
            head = f"HTTP/1.0 {'200 OK' if body else '404 Not Found'}\r\nContent-Type: text/xml\r\n"
            connection.sendall(f"{head}Content-Length: {len(body)}\r\n\r\n".encode() + body)

    def _page(self) -> str:
        (force, torque), (of_force, of_torque) = self._units, self._counts
        return (
            '<?xml version="1.0" encoding="UTF-8"?><netft><prodname>Virtual Net F/T</prodname>'
            f"<runstat>0x{self.state:08x}</runstat><cfgcpf>{of_force:g}</cfgcpf><cfgcpt>{of_torque:g}</cfgcpt>"
            f"<scfgfu>{force}</scfgfu><scfgtu>{torque}</scfgtu><comrdtrate>{self.rate:g}</comrdtrate>"
            f"<cfgcomrdtrate>{self.rate:g}</cfgcomrdtrate></netft>"
        )

    def _received(self, data: bytes, address: tuple[str, int]) -> None:
        if len(data) != REQUEST.size:
            return
        head, command, count = REQUEST.unpack(data)
        if head == 0x1234:
            self.asked.append(command)
            if command != ZERO:
                self._listener, self._count = address if command == STREAM else None, count
                self.counter = 0

    def _send(self, t0: float, rows: Array) -> None:
        super()._send(t0, rows[: self._count - self.counter] if self._count else rows)
        if self._count and self.counter + len(rows) >= self._count:
            self._listener = None

    def _packets(self, t0: float, rows: Array) -> Packets:
        counts = np.rint(rows * self._scale).clip(-(2**31), 2**31 - 1).astype(">i4")
        number = [(self.counter + k + 1) % WRAPS for k in range(len(rows))]
        sensor = ((t0 + np.arange(len(rows)) / self.clock.rate) * INTERNAL_RATE % WRAPS).astype(int).tolist()
        heads = [struct.pack(">III", *numbers, self.state) for numbers in zip(number, sensor, strict=True)]
        return [head + row.tobytes() for head, row in zip(heads, counts, strict=True)]
