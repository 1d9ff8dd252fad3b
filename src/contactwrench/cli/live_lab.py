"""The hands of a person at the virtual arm: buttons of the page that become orders to the lab's control port."""

from __future__ import annotations

import socket
from typing import TYPE_CHECKING, Any

import msgspec

from ..errors import ContactWrenchError
from ..geometry.orientation import from_quat_xyzw

if TYPE_CHECKING:
    from ..live.page import Hub

WAITS = 3.0
"""s for an answer."""
DOWN, ALONG_X, ASIDE = (0.0, 0.0, -10.0), (10.0, 0.0, 0.0), (0.0, 8.0, 0.0)
PUSHES: dict[str, dict[str, Any]] = {
    "press_down": {"push": DOWN, "frame": "base", "at": "axis"},
    "press_x": {"push": ALONG_X, "frame": "flange", "at": "axis"},
    "push_tool": {"push": ASIDE, "frame": "base", "at": "hook"},
    "release": {"release": True},
}


class Hands:
    """Does what a button says; `control` is the URI of the control port, `hub` knows which pose is next."""

    def __init__(self, control: str, hub: Hub) -> None:
        from ..live.uri import parsed

        uri = parsed(control)
        if uri.scheme != "tcp" or uri.port is None:
            raise ContactWrenchError(f"--lab is {control}, expected tcp://127.0.0.1:PORT, as `contactwrench lab` says")
        self._place, self._hub = (uri.host, uri.port), hub

    def __call__(self, action: dict[str, str]) -> None:
        """Do it, or nothing where the lab is gone."""
        what = action["do"]
        if what in PUSHES:
            self._order(PUSHES[what])
            return
        for target in self._targets():
            if "error" not in self._order({"move": target}):
                return

    def _targets(self) -> list[list[list[float]]]:
        """`R_base_flange` of the planned poses, the next one first."""
        newest = self._hub.after(0)
        snapshot = {} if newest is None else msgspec.json.decode(newest[1])["snapshot"]
        targets: Any = (snapshot.get("poses") or {}).get("targets")
        return from_quat_xyzw(targets).tolist() if targets else []

    def _order(self, order: dict[str, Any]) -> dict[str, Any]:
        try:
            with socket.create_connection(self._place, WAITS) as control:
                control.sendall(msgspec.json.encode(order) + b"\n")
                return msgspec.json.decode(control.makefile("rb").readline(), type=dict[str, Any])
        except (OSError, UnicodeError, msgspec.DecodeError):
            return {"error": "the lab is gone"}
