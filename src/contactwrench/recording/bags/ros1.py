"""ROS 1 bags: their chunks by the index at the end, which rosbags would hold in memory whole.

Format: http://wiki.ros.org/Bags/Format/2.0.
"""

from __future__ import annotations

from collections.abc import Iterator, Set
from importlib import import_module
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .chunks import LOG, Logged, Source, Topic, in_order
from .message_layout import Raw

ROS1_CONNECTION = b"\x07"
ROS1_COMPRESSIONS = {"bz2": "bz2", "lz4": "lz4.frame"}
"""How chunks are compressed, and the module that does so."""


class Ros1Chunk(NamedTuple):
    """Where a chunk is, when its first and last message were recorded, ns, and how many each connection has in it."""

    offset: int
    start: int
    end: int
    counts: dict[int, int]


class Ros1Index:
    """The index of a ROS 1 bag: its connections, as rosbags calls their parts, and its chunks by when they start."""

    def __init__(self, path: Path, file: BinaryIO) -> None:
        magic = file.readline()
        if not magic:
            raise ValueError(f"File {str(path)!r} seems to be empty")
        if not magic.startswith(b"#ROSBAG V"):
            raise ValueError("File magic is invalid")
        if magic != b"#ROSBAG V2.0\n":
            raise ValueError(f"Bag version {magic[9:].decode().strip()} is not supported")
        self.file = file
        try:
            head = _fields(_sized(file))
            if head.get("encryptor"):
                raise ValueError(f"Bag encryption {head['encryptor'].decode()!r} is not supported")
            if not any(head["index_pos"]):
                raise ValueError("Bag is not indexed, reindex before reading")
            file.seek(_uint(head["index_pos"]))
            connections = [self._connection() for _ in range(_uint(head["conn_count"]))]
            chunks = [self._chunk() for _ in range(_uint(head["chunk_count"]))]
        except (KeyError, EOFError) as error:
            raise ValueError(f"Bag index looks damaged: {error}") from None
        self.chunks = sorted((chunk for chunk in chunks if chunk.counts), key=lambda chunk: chunk.start)
        self.connections = [c._replace(msgcount=sum(k.counts.get(c.id, 0) for k in self.chunks)) for c in connections]

    def source(self) -> Source:
        """The messages of the bag."""
        return Source({c.id: Topic(c.topic, c.msgtype) for c in self.connections}, self._logged)

    def compression(self) -> str:
        """How the chunks are compressed, by the first: bz2, lz4, or not at all."""
        for chunk in self.chunks[:1]:
            self.file.seek(chunk.offset)
            return _fields(_sized(self.file))["compression"].decode().removeprefix("none")
        return ""

    def _connection(self) -> Any:
        from rosbags.interfaces import Connection, ConnectionExtRosbag1, MessageDefinition, MessageDefinitionFormat

        head, about = _fields(_sized(self.file)), {k: v.decode() for k, v in _fields(_sized(self.file)).items()}
        topic = "/".join(part for part in head["topic"].decode().split("/") if part)
        package, _, name = about["type"].rpartition("/")
        latching = about.get("latching")
        topic = "/" * head["topic"].startswith(b"/") + topic
        definition = MessageDefinition(MessageDefinitionFormat.MSG, about["message_definition"])
        details = ConnectionExtRosbag1(about.get("callerid"), int(latching) if latching else None)
        msgtype = f"{package.removesuffix('/msg')}/msg/{name}"
        return Connection(_uint(head["conn"]), topic, msgtype, definition, about["md5sum"], 0, details, self)

    def _chunk(self) -> Ros1Chunk:
        head, counts = _fields(_sized(self.file)), np.frombuffer(_sized(self.file), "<u4").reshape(-1, 2)
        start, end = (_nanoseconds(head[name]) for name in ("start_time", "end_time"))
        return Ros1Chunk(_uint(head["chunk_pos"]), start, end, dict(counts.tolist()))

    def _logged(self, numbers: Set[int]) -> Iterator[Logged]:
        chunks = [chunk for chunk in self.chunks if numbers & chunk.counts.keys()]
        return in_order([chunk.start for chunk in chunks], (self._messages(chunk, numbers) for chunk in chunks))

    def _messages(self, chunk: Ros1Chunk, numbers: Set[int]) -> Logged:
        """Messages of a chunk, by the index behind it of when and where each connection recorded what."""
        self.file.seek(chunk.offset)
        compression = _fields(_sized(self.file))["compression"].decode()
        content = _decompressed(_sized(self.file), compression)
        parts = []
        for _ in chunk.counts:
            number = _uint(_fields(_sized(self.file))["conn"])
            entries = np.frombuffer(_sized(self.file), "<u4").reshape(-1, 3).astype(np.int64)
            if number in numbers and len(entries):
                entries[0, 2] = _behind_connections(content, int(entries[0, 2]))
                parts.append(np.insert(entries, 0, number, axis=1))
        connection, seconds, ns, place = np.concatenate([np.empty((0, 4), np.int64), *parts]).T
        log = np.zeros(len(place), LOG)
        log["connection"] = connection
        log["stamp"] = log["published"] = seconds * 10**9 + ns
        flat = np.frombuffer(content, np.uint8)
        behind_head = place + 4 + _uint32_at(flat, place)
        return Logged(log, Raw(flat, behind_head + 4, _uint32_at(flat, behind_head)))[np.argsort(place)]


def _sized(file: BinaryIO) -> bytes:
    """What stands here behind its length. Raises `EOFError` where that is less."""
    size = _uint(file.read(4))
    content = file.read(size)
    if len(content) < size:
        raise EOFError(f"Got only {len(content)} of {size} bytes")
    return content


def _fields(head: bytes) -> dict[str, bytes]:
    """The fields of a record's head, `name=value`, each behind its length."""
    fields, stream = {}, BytesIO(head)
    while stream.tell() < len(head):
        name, _, value = _sized(stream).partition(b"=")
        fields[name.decode()] = value
    return fields


def _behind_connections(chunk: bytes, place: int) -> int:
    """Where the first record from `place` is that is none of a connection, which a recorder may have put before."""
    stream = BytesIO(chunk)
    stream.seek(place)
    while _fields(_sized(stream))["op"] == ROS1_CONNECTION:
        _sized(stream)
        place = stream.tell()
    return place


def _decompressed(packed: bytes, compression: str) -> bytes:
    if compression == "none":
        return packed
    if compression not in ROS1_COMPRESSIONS:
        raise ValueError(f"Compression {compression!r} is not supported")
    content: bytes = import_module(ROS1_COMPRESSIONS[compression]).decompress(packed)
    return content


def _uint(value: bytes) -> int:
    return int.from_bytes(value, "little")


def _uint32_at(flat: NDArray[np.uint8], places: NDArray[np.int64]) -> NDArray[np.int64]:
    return Raw(flat, places, places).bytes_at(0, 4).view("<u4")[:, 0].astype(np.int64)


def _nanoseconds(time: bytes) -> int:
    return _uint(time[:4]) * 10**9 + _uint(time[4:])
