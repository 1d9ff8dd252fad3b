"""A KUKA controller with RSI over Ethernet: each cycle it sends XML and wants an answer with the same IPOC within it.

The robot is the client. Millimetres and degrees; A, B, C turn about z, y', x''. Of the iiwa's joints six show.
"""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from ..geometry.arrays import Array
from .device import Packets
from .sockets import UdpFake
from .truth import Truth

IPOC = re.compile(rb"<IPOC>\s*(\d+)\s*</IPOC>")
CORRECTION = re.compile(rb'<RKorr\s+X="([^"]+)"\s+Y="([^"]+)"\s+Z="([^"]+)"\s+A="([^"]+)"\s+B="([^"]+)"\s+C="([^"]+)"')
FIRST = 123_645_634_000
POSE = ("X", "Y", "Z", "A", "B", "C")


class Rsi(UdpFake):
    """The controller, with a `cycle` of 0.004 or 0.012 s; `target`, host and port, answers. A datagram has no
    connection: `cut` ends its program.

    `delays` are cycles without an answer in time; after `most_late` of them, once there was an answer, the robot has
    `stopped`: a session may be started after the lab. `correction` (6,), mm and degrees: the last that came in time.
    """

    scheme = "rsi"

    def __init__(
        self, truth: Truth, target: tuple[str, int], *, cycle: float = 0.004, most_late: int = 100, **more: Any
    ) -> None:
        super().__init__(truth, 1.0 / cycle, **more)
        self.target, self._most_late = target, most_late
        self._milliseconds = round(1000.0 * cycle)
        self.delays, self.stopped, self.correction = 0, False, np.zeros(6)
        self._unanswered, self._was_answered = b"", False

    def _received(self, data: bytes, address: tuple[str, int]) -> None:
        self._was_answered = True
        found, correction = IPOC.search(data), CORRECTION.search(data)
        if found and found[1] == self._unanswered and correction:
            self._unanswered, self.correction = b"", np.array(correction.groups(), dtype=np.float64)

    def _packets(self, t0: float, rows: Array) -> Packets:
        return [self.cycle_at(t0 + k / self.clock.rate, self.counter + k) for k in range(len(rows))]

    def cycle_at(self, t: float, number: int) -> bytes:
        """The datagram of a cycle, whose answer is waited for from then on."""
        from scipy.spatial.transform import Rotation

        self.delays += bool(self._unanswered) and self._was_answered and not self.stopped
        if self.delays > self._most_late:
            self.stopped, self._listener = True, None
        pose = self.truth.pose_at(t)
        abc = Rotation.from_quat(pose.quat_xyzw).as_euler("ZYX", degrees=True)
        at = [f'{name}="{value:.6f}"' for name, value in zip(POSE, [*(1000.0 * pose.position), *abc], strict=True)]
        joints = [f'A{k}="{value:.6f}"' for k, value in enumerate(np.rad2deg(pose.joints[:6]), 1)]
        self._unanswered = str(FIRST + self._milliseconds * number).encode()
        return (
            f'<Rob Type="KUKA"><RIst {" ".join(at)}/><AIPos {" ".join(joints)}/><Delay D="{self.delays}"/>'
            f"<IPOC>{self._unanswered.decode()}</IPOC></Rob>"
        ).encode()
