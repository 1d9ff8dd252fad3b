"""Where the numbers of a ROS message lie, found once for many messages: a block of them is then read by numpy.

A layout says where each number of a message is, and which bytes (texts and lengths) another must share for its numbers
to be at the same places. Decoding message by message costs twenty times as much (benchmarks/bags.py).

ROS 2 writes plain CDR (OMG, Common Object Request Broker Architecture, part 2, 9.3: every number at a multiple of its
own size, counted from behind the four bytes that state the byte order); ROS 1 the same without gaps, little endian.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from struct import unpack_from
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from ...geometry.arrays import Array

Fields: TypeAlias = "dict[str, tuple[list[Any], list[tuple[str, Any]]]]"
"""rosbags' message definitions: constants and fields by the type's name."""

NUMPY = {
    **{"bool": "u1", "byte": "u1", "char": "u1", "uint8": "u1", "int8": "i1", "uint16": "u2", "int16": "i2"},
    **{"uint32": "u4", "int32": "i4", "uint64": "u8", "int64": "i8", "float32": "f4", "float64": "f8"},
}
ENCAPSULATION = 4
"""Bytes before a CDR message: the second says the order of bytes."""
PARTS = 10_000
"""Parts that a message may have beside one a byte: empty types nested in each other have as many as one likes."""
TRAILING = 3
"""Bytes that may follow a CDR message, so that its length is a multiple of four."""


@dataclass(frozen=True, eq=False)
class MessageLayout:
    """Where the numbers of a message are, by path (`wrench.force.x`): first byte, numpy's type, how many; the `texts`
    by path; and the bytes, by where each run of them starts, that all messages of the layout share.
    """

    numbers: dict[str, tuple[int, str, int]]
    texts: dict[str, str]
    shared: tuple[tuple[int, bytes], ...]

    def fits(self, raw: Raw) -> NDArray[np.bool_]:
        """Which messages (n,), all as long as the one it was found for, are of the layout."""
        fitting = np.ones(len(raw), dtype=bool)
        for offset, shared in self.shared:
            fitting &= (raw.bytes_at(offset, len(shared)) == np.frombuffer(shared, np.uint8)).all(axis=1)
        return fitting


@dataclass(frozen=True, eq=False)
class Raw:
    """Messages as they are written: each is `length` bytes of `flat` from `start`; the arrays are (n,)."""

    flat: NDArray[np.uint8]
    start: NDArray[np.int64]
    length: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.start)

    def __getitem__(self, rows: Any) -> Raw:
        return Raw(self.flat, self.start[rows], self.length[rows])

    def message(self, row: int) -> bytes:
        """One message."""
        return self.flat[self.start[row] : self.start[row] + self.length[row]].tobytes()

    def bytes_at(self, offset: int, size: int) -> NDArray[np.uint8]:
        """Of each message `size` bytes from its byte `offset`, (n, size)."""
        if not size:
            return np.empty((len(self), 0), np.uint8)
        pieces = np.ndarray(len(self.flat) - size + 1, f"V{size}", self.flat, strides=1)
        return pieces[self.start + offset].view(np.uint8).reshape(-1, size)

    def values(self, layout: MessageLayout, path: str) -> Array:
        """The numbers (n, k) at `path`; all messages must be of the layout. Raises `KeyError` where there is none."""
        offset, kind, count = layout.numbers[path]
        if count == 0:
            return np.empty((len(self), 0))
        return self.bytes_at(offset, count * int(kind[-1])).view(kind).astype(np.float64)

    def columns(self, layout: MessageLayout, paths: Sequence[str]) -> Array:
        """The numbers (n, k) at `paths`, one of each; those that lie side by side are fetched together."""
        first, kind, _ = layout.numbers[paths[0]]
        size = int(kind[-1])
        side_by_side = [(first + k * size, kind, 1) for k in range(len(paths))]
        if [layout.numbers[path] for path in paths] == side_by_side:
            return self.bytes_at(first, size * len(paths)).view(kind).astype(np.float64)
        return np.hstack([self.values(layout, path) for path in paths])


def joined(payloads: list[bytes]) -> Raw:
    """Messages one behind the other."""
    length = np.fromiter(map(len, payloads), np.int64, len(payloads))
    return Raw(np.frombuffer(b"".join(payloads), np.uint8), np.cumsum(length) - length, length)


def layout_of_message(message: bytes, msgtype: str, types: Fields, cdr: bool) -> MessageLayout:
    """The layout of one message. Raises `InputError` where it is no such message."""
    walk = _Walk(message, types, cdr)
    try:
        end = walk.fields(msgtype, "", ENCAPSULATION if cdr else 0)
    except (IndexError, KeyError, UnicodeDecodeError, RecursionError, ValueError):
        end = -1
    if not 0 <= len(message) - end <= (TRAILING if cdr else 0):
        raise InputError(f"found {len(message)} bytes that are no such message, expected one as its type defines")
    return MessageLayout(walk.numbers, walk.texts, tuple(walk.shared))


class _Walk:
    """A walk along one message, which notes what it passes."""

    def __init__(self, message: bytes, types: Fields, cdr: bool) -> None:
        if cdr and message[:2] not in (b"\x00\x00", b"\x00\x01"):
            raise InputError(f"found a message that starts with {message[:2].hex() or 'nothing'}, expected plain CDR")
        self.message, self.types, self.cdr = message, types, cdr
        self.order = ">" if cdr and message[1] == 0 else "<"
        self.numbers: dict[str, tuple[int, str, int]] = {}
        self.texts: dict[str, str] = {}
        self.shared: list[tuple[int, bytes]] = [(0, message[:2])] if cdr else []
        self.left = PARTS + len(message)

    def fields(self, msgtype: str, path: str, pos: int) -> int:
        """Pass a message of that type; where it ends. So do the methods below."""
        for name, what in self.types[msgtype][1]:
            pos = self.part(what, f"{path}.{name}" if path else name, pos)
        return pos

    def part(self, what: Any, path: str, pos: int) -> int:
        node, of = what[0].name, what[1]
        self.left -= 1
        if self.left < 0:
            raise IndexError
        if node == "NAME":
            return self.fields(of, path, pos)
        if node == "BASE":
            return self.text(path, pos) if of[0] == "string" else self.primitives(of[0], path, pos, 1)
        inner, count = of
        if node == "SEQUENCE":
            pos, count = self.length(pos)
        if inner[0].name == "BASE" and inner[1][0] != "string":
            return self.primitives(inner[1][0], path, pos, count)
        if count > len(self.message):
            raise IndexError
        for index in range(count):
            pos = self.part(inner, f"{path}.{index}", pos)
        return pos

    def primitives(self, kind: str, path: str, pos: int, count: int) -> int:
        numpy_kind = NUMPY[kind]
        size = int(numpy_kind[-1])
        pos = self.aligned(pos, size) if count else pos
        self.numbers[path] = (pos, self.order + numpy_kind, count)
        return self.within(pos + count * size)

    def text(self, path: str, pos: int) -> int:
        pos, size = self.length(pos)
        end = self.within(pos + size)
        self.texts[path] = self.message[pos : end - 1 if self.cdr else end].decode()
        self.shared.append((pos, self.message[pos:end]))
        return end

    def length(self, pos: int) -> tuple[int, int]:
        pos = self.aligned(pos, 4)
        end = self.within(pos + 4)
        self.shared.append((pos, self.message[pos:end]))
        return end, int(unpack_from(self.order + "I", self.message, pos)[0])

    def aligned(self, pos: int, size: int) -> int:
        return pos + (ENCAPSULATION - pos) % size if self.cdr else pos

    def within(self, pos: int) -> int:
        if pos > len(self.message):
            raise IndexError
        return pos


def written(msgtype: str) -> str:
    """A type as people write it: `geometry_msgs/Wrench`."""
    return msgtype.replace("/msg/", "/")


@lru_cache(64)
def types_defined(msgtype: str, text: str, idl: bool, ros1: bool) -> Fields:
    """The message types of ROS and those that `text` defines, in ROS' own language or in IDL."""
    from rosbags.typesys import get_types_from_idl, get_types_from_msg

    types = dict(typestore(ros1).fielddefs)
    if not idl:
        types.update(get_types_from_msg(text, msgtype))
        return types
    for part in text.split("=" * 80 + "\n"):
        types.update(get_types_from_idl(part.partition("\n")[2] if part.startswith("IDL: ") else part))
    return types


@cache
def typestore(ros1: bool) -> Any:
    """A store by rosbags of the message types that come with ROS; to those of ROS 1, the transforms are added."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    if ros1:
        store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", "tf2_msgs/msg/TFMessage"))
    return store
