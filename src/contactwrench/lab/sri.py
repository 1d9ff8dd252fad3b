"""An SRI M8128 interface box with an M8125 sensor: TCP, text commands with an acknowledgement, a stream of packets.

A packet is AA 55, the length of what follows (2 bytes, big-endian), a running number (2 bytes, big-endian, wraps), six
little-endian float32 a sample (N, N m), and the sum of their bytes modulo 256.
"""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Mapping
from time import monotonic
from typing import Any

from ..geometry.arrays import Array
from .device import Packets
from .sockets import Client, TcpFake
from .truth import Truth

CHANNELS = "A01,A02,A03,A04,A05,A06"
WRAPS = 1 << 16
RATE = r"[1-9]\d{0,3}"
FORMS = {
    "EIP": r"[\d.]+",
    "SGDM": rf"\({CHANNELS}\);E;[1-9]\d?;\(WMA:\d+\)",
    "DCPCU": "MVPV",
    "DCKMD": "SUM",
    "ADJZF": "[01](;[01]){5}",
}
"""What a value looks like; another is answered `$ERROR`: units other than N and N m, sums other than the byte."""


class Sri(TcpFake):
    """The box, at rest until it is asked for its stream, at `rate` Hz unless a client asks for another. `old`: firmware
    that ends its answers without `$OK` and calls the rate SMPR. `asked`: every command that has come, to see that
    nobody zeroes the sensor. `keeps`: settings by name that it has and keeps, whatever it is told; `$ERROR`: it
    does not know the command; an empty text: it says nothing to it. A `DCKMD` of CRC32 ends packets with that.
    """

    scheme = "sri"

    def __init__(
        self,
        truth: Truth,
        rate: float = 1000.0,
        *,
        old: bool = False,
        keeps: Mapping[str, str] | None = None,
        **more: Any,
    ) -> None:
        super().__init__(truth, rate, **more)
        self.asked: list[str] = []
        self._ok, self._rate_name = ("", "SMPR") if old else ("$OK", "SMPF")
        self._values = {
            "EIP": self.host,
            "SGDM": f"({CHANNELS});E;1;(WMA:1)",
            "DCPCU": "MVPV",
            "DCKMD": "SUM",
            "ADJZF": "",
        }
        self._keeps = keeps or {}

    def wrong_sum(self) -> None:
        """Spoil the sum of a packet."""
        self._faults.append(lambda packets: [packets[0][:-1] + bytes([packets[0][-1] ^ 1]), *packets[1:]])

    def _received(self, client: Client) -> None:
        while (end := client.inbox.find(b"\r\n")) >= 0:
            line = client.inbox[:end].decode("ascii", "replace")
            del client.inbox[: end + 2]
            self.asked.append(line)
            self._obey(client, line)

    def _obey(self, client: Client, line: str) -> None:
        parts = re.fullmatch(r"AT\+(\w+)(?:=(.*))?", line)
        name, value = parts.groups() if parts else ("", None)
        if name == "GSD":
            client.wants_rows = value != "STOP"
            if value == "STOP":
                self._answer(client, f"ACK+GSD=STOP{self._ok}\r\n".encode())
        elif name == "GOD":
            row = self.truth.wrench_rows(monotonic(), 1, self.clock.rate)
            self._answer(client, self._packet(self.counter, row))
            self.counter += 1
        elif said := self._keeps.get(name, self._setting(name, value)):
            self._answer(client, f"ACK+{name}={said}\r\n".encode())

    def _setting(self, name: str, value: str | None) -> str:
        """Answer a question, or take a value."""
        form = RATE if name == self._rate_name else FORMS.get(name)
        if form is None or not re.fullmatch(rf"\?|{form}", value or ""):
            return "$ERROR"
        if name == self._rate_name:
            if value != "?":
                self.ask_rate(float(value or 0))
            return f"{self.rate:g}{self._ok}"
        if value != "?":
            self._values[name] = str(value)
        return f"{self._values[name]}{self._ok}"

    def _packets(self, client: Client, t0: float, rows: Array) -> Packets:
        kept = self._keeps.get("SGDM", "")
        samples = int((kept if kept.startswith("(") else self._values["SGDM"]).split(";")[2])
        count = range(0, len(rows), samples)
        return [self._packet(self.counter + k // samples, rows[k : k + samples]) for k in count]

    def _packet(self, number: int, rows: Array) -> bytes:
        data = rows.astype("<f4").tobytes()
        crc = self._keeps.get("DCKMD") == "CRC32"
        ends = struct.pack(">I", zlib.crc32(data)) if crc else bytes([sum(data) % 256])
        return struct.pack(">HHH", 0xAA55, 2 + len(data) + len(ends), number % WRAPS) + data + ends
