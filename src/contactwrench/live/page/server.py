"""The page's server: uvicorn in a thread of its own, with a loop of its own."""

from __future__ import annotations

import asyncio
import secrets
import socket
import time
from threading import Thread
from typing import TYPE_CHECKING

from ...errors import MissingExtraError
from ..source import DeviceError
from .app import Application, Hub, Lab
from .guard import Guard

if TYPE_CHECKING:
    import uvicorn

MOST_CONNECTIONS = 64
"""TCP connections at one time: 20 pages, and their requests for files."""
LONGEST_CONNECTION = 30.0
"""s that a connection which is no WebSocket lives: what sends half a request takes no place for long."""
LOOPBACK = ("127.0.0.1", "localhost", "::1")


class Server:
    """A page that is served. `url` is its address, with the token where one is needed."""

    def __init__(self, url: str, server: uvicorn.Server, thread: Thread) -> None:
        self.url = url
        self._server, self._thread = server, thread

    def close(self) -> None:
        """End it: browsers are told, the port is free, no thread is left."""
        self._server.should_exit = True
        self._thread.join()


def serve(hub: Hub, host: str = "127.0.0.1", port: int = 0, token: str | None = None, lab: Lab | None = None) -> Server:
    """Serve the page of a session at a host, 0.0.0.0 or :: for all, and a port, 0 for any that is free.

    Every request must show the `token`; None: one is made where others than this computer can reach us. `lab` is
    called, in a thread, with what is done to the virtual arm (`InLab`), and to return within a second; None: the page
    has no such buttons. Raises `DeviceError`: the address cannot be listened on; `MissingExtraError`.
    """
    try:
        found = {int(each[0]): str(each[4][0]) for each in socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)}
        family = socket.AF_INET if socket.AF_INET in found else socket.AF_INET6
        listening = socket.create_server((found[family], port), family=family)
    except (OSError, OverflowError, UnicodeError) as error:
        message = f"{host}:{port}: found that it cannot be listened on ({error}), expected a free port: choose another"
        raise DeviceError(message) from None
    port = listening.getsockname()[1]
    token = token or (None if host in LOOPBACK else secrets.token_urlsafe(24))
    try:
        server = _uvicorn(Application(hub, Guard(host, port, token), lab))
    except BaseException:
        listening.close()
        raise
    thread = Thread(target=server.run, kwargs={"sockets": [listening]}, name="contactwrench page", daemon=True)
    thread.start()
    while not server.started and thread.is_alive():
        time.sleep(0.002)
    shown = {"0.0.0.0": "127.0.0.1", "::": "[::1]"}.get(host, f"[{host}]" if ":" in host else host)
    return Server(f"http://{shown}:{port}/{f'?token={token}' if token else ''}", server, thread)


def _uvicorn(application: Application) -> uvicorn.Server:
    try:
        import uvicorn
        from uvicorn.protocols.http.h11_impl import H11Protocol
        from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol
    except ImportError as error:
        message = f"the page needs uvicorn and websockets ({error}): pip install 'contactwrench[live]', or --no-page"
        raise MissingExtraError(message) from None

    class Bounded(H11Protocol):
        def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
            super().connection_made(transport)
            if len(self.connections) > MOST_CONNECTIONS:
                transport.write(b"HTTP/1.1 503 Service Unavailable\r\nconnection: close\r\ncontent-length: 0\r\n\r\n")
                transport.close()
            self.loop.call_later(LONGEST_CONNECTION, self._end)

        def _end(self) -> None:
            if self in self.connections:  # a WebSocket has left them
                self.transport.abort()

    config = uvicorn.Config(
        application,
        loop="asyncio",
        http=Bounded,
        ws=WebSocketsSansIOProtocol,
        ws_max_size=4096,
        ws_per_message_deflate=False,
        h11_max_incomplete_event_size=16384,
        lifespan="off",
        log_config=None,
        log_level="critical",
        proxy_headers=False,
        server_header=False,
        timeout_graceful_shutdown=1,
    )
    return uvicorn.Server(config)
