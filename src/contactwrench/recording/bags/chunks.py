"""The messages of a recording's file as they were logged, a chunk at a time and many at once.

MCAP and ROS 1 keep messages in chunks of about a MiB. A chunk is read whole, where its messages lie is noted, and the
rest is left to numpy. sqlite3 has no chunks: rosbags gives its rows. A ROS 1 bag's index is read here: rosbags holds it
in memory whole. Formats: https://mcap.dev/spec and http://wiki.ros.org/Bags/Format/2.0.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence, Set
from dataclasses import dataclass
from importlib import import_module
from io import BytesIO
from itertools import islice
from pathlib import Path
from struct import Struct
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .message_layout import Raw, joined, written

AT_ONCE = 8192
"""Messages that are taken together from what has no chunks."""

MCAP_RECORD, MCAP_MESSAGE = 9, 5
"""Bytes before a record's content, its code and its length; the code of a message."""
MCAP_HEAD = np.dtype([("connection", "<u2"), ("sequence", "<u4"), ("stamp", "<i8"), ("published", "<u8")])
"""What stands before a message's payload."""
LOG = np.dtype([("connection", "i8"), ("sequence", "i8"), ("stamp", "i8"), ("published", "u8")])
"""Of a message: the number of its connection, its own number there, when it was recorded and published, ns."""
ROS1_CONNECTION = b"\x07"
ROS1_COMPRESSIONS = {"bz2": "bz2", "lz4": "lz4.frame"}
"""How chunks are compressed, and the module that does so."""
_LENGTH = Struct("<Q")


@dataclass(frozen=True)
class Topic:
    """A topic and its type, as rosbags writes it (`geometry_msgs/msg/Wrench`)."""

    name: str
    type: str

    def __str__(self) -> str:
        return f"{self.name} ({written(self.type)})"


@dataclass(frozen=True, eq=False)
class Logged:
    """Messages in the order in which they were recorded: their log (n,), of the type `LOG`, and what was written."""

    log: NDArray[Any]
    raw: Raw

    @property
    def stamp(self) -> NDArray[np.int64]:
        """When each was recorded (n,) ns."""
        stamp: NDArray[np.int64] = self.log["stamp"]
        return stamp

    def __len__(self) -> int:
        return len(self.log)

    def __getitem__(self, rows: Any) -> Logged:
        return Logged(self.log[rows], self.raw[rows])


@dataclass(frozen=True, eq=False)
class Source:
    """A file of messages: its topics by the number of each connection, and `logged`, what the connections of some
    numbers recorded, in order, some at a time. `mcap`: the mcap package's reader, where the file is one with an index.
    """

    topics: dict[int, Topic]
    logged: Callable[[Set[int]], Iterator[Logged]]
    mcap: Any = None


def rosbags_source(reader: Any) -> Source:
    """What rosbags' reader of ROS 2 gives one by one: from sqlite3, and from an MCAP without an index of chunks."""
    connections = list(reader.connections)

    def logged(numbers: Set[int]) -> Iterator[Logged]:
        wanted = [c for c in connections if c.id in numbers]
        rows = iter(reader.messages(connections=wanted)) if wanted else iter(())
        while some := list(islice(rows, AT_ONCE)):
            log = np.zeros(len(some), LOG)
            log["connection"] = [connection.id for connection, _, _ in some]
            log["stamp"] = log["published"] = [stamp for _, stamp, _ in some]
            yield Logged(log, joined([payload for _, _, payload in some]))

    return Source({c.id: Topic(c.topic, c.msgtype) for c in connections}, logged)


def mcap_source(file: BinaryIO) -> Source | None:
    """An MCAP by its index of chunks; None where it has none, or one that does not name the topics."""
    from mcap.reader import make_reader

    reader = make_reader(file)
    summary = reader.get_summary()
    if summary is None or not summary.chunk_indexes or not summary.channels:
        return None
    types = {0: ""} | {number: schema.name for number, schema in summary.schemas.items()}
    if any(channel.schema_id not in types for channel in summary.channels.values()):
        return None

    def logged(numbers: Set[int]) -> Iterator[Logged]:
        # Without an index of messages, a chunk does not say which channels it holds.
        known = ((chunk, chunk.message_index_offsets.keys()) for chunk in summary.chunk_indexes)
        chunks = [chunk for chunk, channels in known if not channels or numbers & channels]
        chunks.sort(key=lambda chunk: chunk.message_start_time)
        contents = (_mcap_chunk(file, chunk.chunk_start_offset, numbers) for chunk in chunks)
        return _in_order([chunk.message_start_time for chunk in chunks], contents)

    return Source({c.id: Topic(c.topic, types[c.schema_id]) for c in summary.channels.values()}, logged, reader)


def _mcap_chunk(file: BinaryIO, offset: int, numbers: Set[int]) -> Logged:
    from mcap.data_stream import ReadDataStream
    from mcap.records import Chunk
    from mcap.stream_reader import get_chunk_data_stream

    file.seek(offset + MCAP_RECORD)
    stream, size = get_chunk_data_stream(Chunk.read(ReadDataStream(file)), validate_crc=True)
    content = stream.read(size)
    start, length = np.array(list(_mcap_messages(content)), dtype=np.int64).reshape(-1, 2).T
    every = Raw(np.frombuffer(content, np.uint8), start, length)
    log = every.bytes_at(0, MCAP_HEAD.itemsize).view(MCAP_HEAD)[:, 0].astype(LOG)
    payloads = Raw(every.flat, start + MCAP_HEAD.itemsize, length - MCAP_HEAD.itemsize)
    return Logged(log, payloads)[np.isin(log["connection"], list(numbers))]


def _mcap_messages(chunk: bytes) -> Iterator[tuple[int, int]]:
    """Where the content of each message's record starts, and its length."""
    pos, end, length_at = 0, len(chunk), _LENGTH.unpack_from
    while pos < end:
        (length,) = length_at(chunk, pos + 1)
        if chunk[pos] == MCAP_MESSAGE:
            yield pos + MCAP_RECORD, length
        pos += MCAP_RECORD + length


def _in_order(starts: Sequence[int], chunks: Iterable[Logged]) -> Iterator[Logged]:
    """What chunks hold, in order: of a chunk that reaches beyond the start of the next, the rest waits."""
    waiting = Logged(np.empty(0, LOG), joined([]))
    for until, chunk in zip((*starts[1:], np.iinfo(np.int64).max), chunks, strict=False):
        end = chunk.raw.start + chunk.raw.length
        if ((end > len(chunk.raw.flat)) | (chunk.raw.length < 0) | (chunk.stamp < 0)).any():
            raise ValueError("a message reaches beyond its chunk, or its stamp beyond all times")
        rest = joined([waiting.raw.message(row) for row in range(len(waiting))])  # the chunk they are of is let go
        flat = np.concatenate([rest.flat, chunk.raw.flat]) if len(rest) else chunk.raw.flat
        start = np.concatenate([rest.start, chunk.raw.start + len(rest.flat)])
        raw = Raw(flat, start, np.concatenate([rest.length, chunk.raw.length]))
        ordered = Logged(np.concatenate([waiting.log, chunk.log]), raw)
        if (np.diff(ordered.stamp) < 0).any():
            ordered = ordered[np.argsort(ordered.stamp, kind="stable")]
        ready = int(np.searchsorted(ordered.stamp, until, side="left"))
        if ready:
            yield ordered[:ready]
        waiting = ordered[ready:]


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
        return _in_order([chunk.start for chunk in chunks], (self._messages(chunk, numbers) for chunk in chunks))

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
