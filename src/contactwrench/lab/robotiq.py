"""A Robotiq FT 300 whose cable goes into a Universal Robots controller: the URCap's port, 63351, gives readings as
text, `( 2.25 , -0.10 , 29.30 , 0.010 , 0.020 , 0.000 )`, in N and N m, about 100 times a second (public clients).
"""

from __future__ import annotations

from typing import Any

from ..geometry.arrays import Array
from .device import Packets
from .sockets import Client, TcpFake
from .truth import Truth


class Robotiq(TcpFake):
    """Sends to whoever connects; `end` is what follows each reading: clients do not say whether a line's end does."""

    scheme = "robotiq"

    def __init__(self, truth: Truth, rate: float = 100.0, *, end: str = "", **more: Any) -> None:
        super().__init__(truth, rate, **more)
        self._end = end

    def _accepted(self, client: Client) -> None:
        client.wants_rows = True

    def _received(self, client: Client) -> None:
        client.inbox.clear()

    def _packets(self, client: Client, t0: float, rows: Array) -> Packets:
        return [self._reading(row) for row in rows]

    def _reading(self, row: Array) -> bytes:
        values = [f"{value:.2f}" for value in row[:3]] + [f"{value:.3f}" for value in row[3:]]
        return f"( {' , '.join(values)} ){self._end}".encode()
