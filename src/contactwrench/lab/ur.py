"""A UR robot's RTDE server: TCP, packages of a size (uint16), a type (one letter) and a payload, all big-endian.

Version 2 of the protocol: a client asks for the version, names the fields that it wants and how often, and starts; a
field that the robot has not is answered NOT_FOUND (Universal Robots, RTDE guide). It is an e-series by default; the
iiwa has a joint more than a UR, which does not show.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..geometry.arrays import Array
from ..geometry.rotations import rotation_exp, rotation_log
from .device import Packets
from .sockets import Client, TcpFake
from .truth import NOTHING, FlangePose, Truth

HEADER = struct.Struct(">HB")
FORMS = {"DOUBLE": "d", "VECTOR6D": "6d", "INT32": "i", "UINT32": "I"}
E_SERIES, CB3 = 500.0, 125.0
NORMAL, RUNNING, POWERED = 1, 7, 3
"""Safety mode, robot mode, and robot status bits: power is on, a program runs."""


@dataclass(frozen=True, eq=False)
class _Moment:
    t: float
    wrench: Array
    pose: FlangePose


class Ur(TcpFake):
    """The controller; `cb3`: an older one, 125 Hz, and no force sensor of its own; `tcp_offset` (6,): m and rotation
    vector, of the TCP on the flange.
    """

    scheme = "ur"

    def __init__(self, truth: Truth, *, cb3: bool = False, tcp_offset: Sequence[float] = NOTHING, **more: Any) -> None:
        super().__init__(truth, CB3 if cb3 else E_SERIES, **more)
        self.state = NORMAL
        self._version = (3, 15, 8, 0) if cb3 else (5, 15, 0, 0)
        self._offset = np.array(tcp_offset, dtype=np.float64)
        self._fields: dict[str, tuple[str, Callable[[_Moment], Any]]] = {
            "timestamp": ("DOUBLE", lambda at: [self.uptime(at.t)]),
            "actual_q": ("VECTOR6D", lambda at: at.pose.joints[:6]),
            "actual_TCP_pose": ("VECTOR6D", self._tcp_pose),
            "actual_TCP_force": ("VECTOR6D", self._tcp_force),
            "tcp_offset": ("VECTOR6D", lambda at: self._offset),
            "safety_mode": ("INT32", lambda at: [self.state]),
            "safety_status": ("INT32", lambda at: [self.state]),
            "safety_status_bits": ("UINT32", lambda at: [1 << (self.state - 1)]),
            "robot_mode": ("INT32", lambda at: [RUNNING]),
            "robot_status_bits": ("UINT32", lambda at: [POWERED]),
        }
        if not cb3:
            self._fields["ft_raw_wrench"] = ("VECTOR6D", lambda at: at.wrench)

    def _tcp_pose(self, at: _Moment) -> Array:
        pose, offset = at.pose, self._offset
        if not offset.any():
            return np.concatenate([pose.position, pose.rotation_vector])
        R = pose.R_base_flange
        return np.concatenate([pose.position + R @ offset[:3], rotation_log(R @ rotation_exp(offset[3:]))])

    def _tcp_force(self, at: _Moment) -> Array:
        """What the robot makes of it: the contact wrench in base axes, without payload; of a CB3 about the TCP."""
        force, torque = self.truth.true_contact(at.t).reshape(2, 3)
        if self._version[0] < 5:
            torque = torque - np.cross(self._offset[:3], force)
        return (np.array([force, torque]) @ at.pose.R_base_flange.T).reshape(6)

    def _received(self, client: Client) -> None:
        while len(client.inbox) >= HEADER.size:
            size, kind = HEADER.unpack_from(client.inbox)
            if size < HEADER.size:
                self._drop(client)
                return
            if len(client.inbox) < size:
                return
            payload = bytes(client.inbox[HEADER.size : size])
            del client.inbox[:size]
            self._obey(client, chr(kind), payload)

    def _obey(self, client: Client, kind: str, payload: bytes) -> None:
        if kind == "V":
            answer = struct.pack(">B", payload == b"\x00\x02")
        elif kind == "v":
            answer = struct.pack(">4I", *self._version)
        elif kind == "O":
            answer = self._set_up(client, payload)
        elif kind == "I":
            answer = b"\x01" + ",".join(["NOT_FOUND"] * len(payload.split(b","))).encode()
        elif kind in "SP":
            client.wants_rows = bool(client.asked) and kind == "S"
            answer = struct.pack(">B", bool(client.asked))
        else:
            return
        self._answer(client, _package(kind, answer))

    def _set_up(self, client: Client, payload: bytes) -> bytes:
        (frequency,) = struct.unpack_from(">d", payload)
        names = payload[8:].decode("ascii", "replace").rstrip(",").split(",")  # ur-rtde ends with a comma
        kinds = [self._fields[name][0] if name in self._fields else "NOT_FOUND" for name in names]
        if "NOT_FOUND" in kinds:
            return b"\x00" + ",".join(kinds).encode()
        client.asked, client.every = names, max(round(self.rate / max(frequency, 1.0)), 1)
        return b"\x01" + ",".join(kinds).encode()

    def _packets(self, client: Client, t0: float, rows: Array) -> Packets:
        fields = [self._fields[name] for name in client.asked]
        form = struct.Struct(">B" + "".join(FORMS[kind] for kind, _ in fields))
        packets = []
        for k in range(-self.counter % client.every, len(rows), client.every):
            t = t0 + k / self.clock.rate
            at = _Moment(t, rows[k], self.truth.pose_at(t))
            values = [value for _, values_at in fields for value in values_at(at)]
            packets.append(_package("U", form.pack(1, *values)))
        return packets


def _package(kind: str, payload: bytes) -> bytes:
    return HEADER.pack(HEADER.size + len(payload), ord(kind)) + payload
