"""Clients of the fake devices, a few lines each on plain sockets, written from the wire formats."""

from __future__ import annotations

import socket
import struct
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from tests.support.world import Array

WAIT = 5.0


@contextmanager
def nothing_left() -> Iterator[None]:
    """No thread is left behind."""
    before = set(threading.enumerate())
    yield
    assert set(threading.enumerate()) <= before


def connected(port: int) -> socket.socket:
    """To a server on this machine."""
    return socket.create_connection(("127.0.0.1", port), timeout=WAIT)


def exactly(connection: socket.socket, n: int) -> bytes:
    """So many bytes."""
    data = b""
    while len(data) < n:
        part = connection.recv(n - len(data))
        if not part:
            raise ConnectionError("closed")
        data += part
    return data


def line(connection: socket.socket) -> str:
    """Up to CR LF, or LF."""
    data = b""
    while not data.endswith(b"\n"):
        data += exactly(connection, 1)
    return data.decode().rstrip()


def sri_packet(connection: socket.socket) -> tuple[int, Array, bool]:
    """Running number, samples (k, 6), and whether the sum is right, of what must be a packet."""
    head, length = struct.unpack(">HH", exactly(connection, 4))
    assert head == 0xAA55
    rest = exactly(connection, length)
    (number,) = struct.unpack(">H", rest[:2])
    data = rest[2:-1]
    return number, np.frombuffer(data, "<f4").reshape(-1, 6).astype(float), sum(data) % 256 == rest[-1]


def rtde(connection: socket.socket, kind: str, payload: bytes = b"") -> bytes:
    """The payload of the answer to a package."""
    connection.sendall(struct.pack(">HB", 3 + len(payload), ord(kind)) + payload)
    while True:
        answered, data = rtde_package(connection)
        if answered == kind:
            return data


def rtde_package(connection: socket.socket) -> tuple[str, bytes]:
    """The next package: its type and its payload."""
    size, kind = struct.unpack(">HB", exactly(connection, 3))
    return chr(kind), exactly(connection, size - 3)


def ask(connection: socket.socket, order: Any) -> Any:
    """The lab's answer to an order."""
    import json

    connection.sendall(json.dumps(order).encode() + b"\n")
    return json.loads(line(connection))
