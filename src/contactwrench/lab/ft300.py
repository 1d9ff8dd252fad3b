"""A Robotiq FT 300 behind Modbus TCP: six registers of 16 bits with a sign, 100 times a second.

Registers 180 to 185 hold Fx, Fy, Fz in 0.01 N and Mx, My, Mz in 0.001 N m, 190 to 192 the acceleration in 0.001 g, 514
the year of production; the unit is 9 (Robotiq, FT 150/300 instruction manual, Modbus RTU). Holding registers (function
3) and input registers (4) show the same.

And one whose cable goes into a Universal Robots controller: the URCap's port, 63351, gives readings as text,
`( 2.25 , -0.10 , 29.30 , 0.010 , 0.020 , 0.000 )`, in N and N m, about 100 times a second (public clients).
"""

from __future__ import annotations

import struct
from time import sleep
from typing import Any

import numpy as np

from ..geometry.arrays import Array
from .device import Packets
from .sockets import Client, TcpFake
from .truth import Truth

HEADER = struct.Struct(">HHHBB")
READ = (3, 4)
ILLEGAL_FUNCTION, ILLEGAL_ADDRESS, ILLEGAL_VALUE = 1, 2, 3
FIRST, LAST, YEAR = 180, 514, 2020
SCALE = np.array([100.0] * 3 + [1000.0] * 3)
MOST = 125
"""Registers in one answer."""


class Ft300(TcpFake):
    """The sensor; faults of packets befall its answers."""

    scheme = "ft300"
    SENDS_UNASKED = True

    def __init__(self, truth: Truth, rate: float = 100.0, **more: Any) -> None:
        super().__init__(truth, rate, **more)
        self._registers = np.zeros(LAST + 1, dtype=">i2")
        self._registers[LAST] = YEAR

    def _send(self, t0: float, rows: Array) -> None:
        counts = np.rint(rows[-1] * SCALE).clip(-(2**15), 2**15 - 1)
        self._registers[FIRST : FIRST + 6] = counts

    def _received(self, client: Client) -> None:
        while len(client.inbox) >= HEADER.size:
            transaction, _, length, unit, function = HEADER.unpack_from(client.inbox)
            if len(client.inbox) < 6 + length:
                return
            body = bytes(client.inbox[HEADER.size : 6 + length])
            del client.inbox[: 6 + length]
            answer = self._read_registers(function, body)
            answer = HEADER.pack(transaction, 0, len(answer) + 1, unit, answer[0]) + answer[1:]
            sleep(self._late)
            self._to(client, self._faulty([answer]))

    def _read_registers(self, function: int, body: bytes) -> bytes:
        if function not in READ or len(body) != 4:
            return bytes([0x80 | function, ILLEGAL_FUNCTION])
        first, n = struct.unpack(">HH", body)
        if not 0 < n <= MOST:
            return bytes([0x80 | function, ILLEGAL_VALUE])
        if first + n > len(self._registers):
            return bytes([0x80 | function, ILLEGAL_ADDRESS])
        return bytes([function, 2 * n]) + self._registers[first : first + n].tobytes()


class Robotiq(TcpFake):
    """Sends to whoever connects; `end` is what follows each reading: clients do not say whether a line's end does."""

    scheme = "robotiq"
    SENDS_UNASKED = True

    def __init__(self, truth: Truth, rate: float = 100.0, *, end: str = "", **more: Any) -> None:
        super().__init__(truth, rate, **more)
        self._end = end

    def _packets(self, client: Client, t0: float, rows: Array) -> Packets:
        form = f"( {' , '.join(['%.2f'] * 3 + ['%.3f'] * 3)} ){self._end}"
        return [(form % tuple(row)).encode() for row in rows]
