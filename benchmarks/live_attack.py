"""What a hostile network does to the page of a live session, without end: `python -m benchmarks.live_attack PORT`.

A thousand connections are held open; beside them, five times a second, a request with a foreign Host, a WebSocket of
another Origin, a request without an end, a body of 10 MB, and a message of 10 MB.
"""

from __future__ import annotations

import socket
import sys
import time
from contextlib import suppress

HELD = 1_000
EVERY = 0.2
LARGE = 10_000_000
UPGRADE = (
    "GET /live HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nOrigin: {origin}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\r\n"
)


def asked(port: int, request: bytes, more: int = 0) -> bytes:
    """What is answered to a request, and to as many bytes more as are taken."""
    with socket.create_connection(("127.0.0.1", port), timeout=1.0) as at:
        at.sendall(request)
        with suppress(OSError):
            answer = at.recv(4096) if more and b"Upgrade" in request else b""
            while more > 0:
                more -= at.send(b"x" * min(more, 65_536))
            return answer or at.recv(4096)
        return b""


def main() -> None:
    """Attack until it is ended."""
    port = int(sys.argv[1])
    held = []
    for _ in range(HELD):
        with suppress(OSError):
            held.append(socket.create_connection(("127.0.0.1", port), timeout=1.0))
    own, frame = f"http://127.0.0.1:{port}", b"\x82\xff" + LARGE.to_bytes(8, "big") + b"mask"
    while True:
        for request, more in (
            (b"GET / HTTP/1.1\r\nHost: elsewhere.example\r\n\r\n", 0),
            (UPGRADE.format(port=port, origin="http://elsewhere.example").encode(), 0),
            (b"GET / HTTP/1.1\r\nX: ", 0),
            (f"POST / HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nContent-Length: {LARGE}\r\n\r\n".encode(), LARGE),
            (UPGRADE.format(port=port, origin=own).encode() + frame, LARGE),
        ):
            with suppress(OSError):
                asked(port, request, more)
            time.sleep(EVERY / 5.0)


if __name__ == "__main__":
    main()
