"""Who may talk to the page: this computer's own browser, or one that was given the token."""

from __future__ import annotations

import hmac
from collections.abc import Mapping
from dataclasses import dataclass
from ipaddress import ip_address
from typing import Any
from urllib.parse import parse_qs

ANY_ADDRESS = ("0.0.0.0", "::")


@dataclass(frozen=True)
class Guard:
    """Judges requests by their headers. `listen` and `port` are what the server listens on; `token` None: not needed.

    The name in Host must be an own one, or a page elsewhere could reach us by a name that it points at this computer.
    """

    listen: str
    port: int
    token: str | None

    def refusal(self, scope: Mapping[str, Any]) -> tuple[int, str] | None:
        """Why a request (ASGI scope, of HTTP or a WebSocket) is refused, as a status and a line; None: it is not."""
        headers = {name.decode("latin-1"): value.decode("latin-1") for name, value in scope["headers"]}
        host, origin = headers.get("host", ""), headers.get("origin")
        socket = scope["type"] == "websocket"
        if not self._is_own(host):
            return 400, "found another name in Host, expected this page's own: open the address as printed"
        if (socket or origin is not None) and origin != f"http://{host}":
            return 403, "found a request from another page, expected one from this page: open the address as printed"
        if not socket and scope["method"] != "GET":
            return 405, "found another method, expected GET"
        cookies = [each.strip() for each in headers.get("cookie", "").split(";")]
        shown = self.has_token(scope) or any(_same(each, self.cookie) for each in cookies)
        if not (self.token is None or shown):
            return 403, "found no valid token, expected the address with its token, as the program printed it"
        return None

    def has_token(self, scope: Mapping[str, Any]) -> bool:
        """Whether the address has the token, so that the cookie is to be set."""
        given = parse_qs(scope["query_string"].decode("latin-1")).get("token", [""])
        return self.token is not None and _same(given[0], self.token)

    @property
    def cookie(self) -> str:
        """The cookie; cookies know no ports, so its name does."""
        return f"contactwrench_{self.port}={self.token}"

    def _is_own(self, host: str) -> bool:
        names = {"127.0.0.1", "localhost", f"[{self.listen}]" if ":" in self.listen else self.listen}
        own = {f"{name}:{self.port}" for name in names} | (names if self.port == 80 else set())
        name = host.removesuffix(f":{self.port}")
        any_address = self.listen in ANY_ADDRESS and name != host and _is_address(name.strip("[]"))
        return host.lower() in own or any_address


def _same(given: str, secret: str) -> bool:
    return hmac.compare_digest(given.encode(), secret.encode())


def _is_address(name: str) -> bool:
    try:
        return bool(ip_address(name))
    except ValueError:
        return False
