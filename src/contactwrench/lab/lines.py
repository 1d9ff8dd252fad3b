"""Anything that speaks in lines: a JSON object or a CSV row a sample, as datagrams or from a TCP server.

Names are those of the recordings: t (s, of the device's clock), fx fy fz tx ty tz (N, N m), qx qy qz qw of
R_base_flange, x y z (m). A header goes before the first CSV row of a connection, and among datagrams once a second.
"""

from __future__ import annotations

import json
from typing import Any, Literal, TypeAlias

import numpy as np

from ..geometry.arrays import Array
from .device import Fake, Packets
from .sockets import Client, TcpFake, UdpFake
from .truth import Truth

Form: TypeAlias = Literal["json", "csv"]
Shows: TypeAlias = Literal["wrench", "pose", "both"]
WRENCH, POSE = ("fx", "fy", "fz", "tx", "ty", "tz"), ("qx", "qy", "qz", "qw", "x", "y", "z")
NAMES: dict[str, tuple[str, ...]] = {"wrench": WRENCH, "pose": POSE, "both": WRENCH + POSE}


def _line(device: Fake, names: tuple[str, ...], form: Form, at: float, row: Array) -> bytes:
    pose, t = device.truth.pose_at(at) if POSE[0] in names else None, device.uptime(at)
    shown = [] if pose is None else [pose.quat_xyzw, pose.position]
    values = np.concatenate([row if WRENCH[0] in names else [], *shown]).tolist()
    if form == "json":
        return json.dumps({"t": t, **dict(zip(names, values, strict=True))}).encode() + b"\n"
    return ",".join(f"{value:.9g}" for value in [t, *values]).encode() + b"\n"


def _header(names: tuple[str, ...]) -> bytes:
    return ",".join(["t", *names]).encode() + b"\n"


class UdpLines(UdpFake):
    """Sends datagrams to `target`; a datagram has no connection: `cut` ends it."""

    scheme = "udp"

    def __init__(
        self,
        truth: Truth,
        target: tuple[str, int],
        rate: float = 250.0,
        *,
        form: Form = "json",
        shows: Shows = "both",
        **more: Any,
    ) -> None:
        super().__init__(truth, rate, **more)
        self.target, self._form, self._names = target, form, NAMES[shows]

    def _packets(self, t0: float, rows: Array) -> Packets:
        packets = []
        for k, row in enumerate(rows, self.counter):
            if self._form == "csv" and k % max(round(self.rate), 1) == 0:
                packets.append(_header(self._names))
            at = t0 + (k - self.counter) / self.clock.rate
            packets.append(_line(self, self._names, self._form, at, row))
        return packets


class TcpLines(TcpFake):
    """Sends to whoever connects."""

    scheme = "tcp"
    SENDS_UNASKED = True

    def __init__(
        self, truth: Truth, rate: float = 250.0, *, form: Form = "json", shows: Shows = "both", **more: Any
    ) -> None:
        super().__init__(truth, rate, **more)
        self._form, self._names = form, NAMES[shows]

    def _accepted(self, client: Client) -> None:
        if self._form == "csv":
            self._to(client, [_header(self._names)])

    def _packets(self, client: Client, t0: float, rows: Array) -> Packets:
        rate = self.clock.rate
        return [_line(self, self._names, self._form, t0 + k / rate, row) for k, row in enumerate(rows)]
