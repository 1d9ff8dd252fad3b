"""Orders to the lab from a page or a test: one JSON object a line over TCP, each answered with one.

{"move": joints (7) or R_base_flange (3, 3), "position": [x, y, z]}; {"push": [fx, fy, fz], "frame": "sensor",
"seconds": s, "at": "hook"}; {"release": true}; {"state": true}. What cannot be done is answered {"error": "..."}.
"""

from __future__ import annotations

from time import monotonic
from typing import Any

import msgspec

from ..errors import InputError
from .rig import Lab
from .sockets import Client, TcpFake


class Control(TcpFake):
    """The control port of a lab."""

    scheme = "tcp"

    def __init__(self, lab: Lab, port: int = 0) -> None:
        super().__init__(lab, 1.0, port=port)
        self._lab = lab

    def _received(self, client: Client) -> None:
        while (end := client.inbox.find(b"\n")) >= 0:
            line = bytes(client.inbox[:end])
            del client.inbox[: end + 1]
            try:
                answer = self._obeyed(msgspec.json.decode(line, type=dict[str, Any]))
            except (InputError, msgspec.DecodeError, TypeError, ValueError) as error:
                answer = {"error": str(error)}
            self._answer(client, msgspec.json.encode(answer, enc_hook=lambda array: array.tolist()) + b"\n")

    def _obeyed(self, order: dict[str, Any]) -> dict[str, Any]:
        lab = self._lab
        if "move" in order:
            return {"seconds": lab.move_to(order["move"], order.get("position"))}
        if "push" in order:
            lab.push(order["push"], order.get("frame", "sensor"), order.get("seconds"), order.get("at", "hook"))
        elif "release" in order:
            lab.release()
        elif "state" in order:
            contact = lab.true_contact(monotonic())
            return {"truth": vars(lab.truth), "joints": lab.joints_now(), "moving": lab.moving, "contact": contact}
        else:
            raise InputError(f"found {', '.join(order) or 'nothing'}, expected move, push, release or state")
        return {"done": True}
