"""The messages of a bag, a chunk at a time and many at once.

rosbags opens the file and its index; taking the messages out one by one costs it 2 us each from MCAP and 8 us from a
ROS 1 bag, whose index it holds in memory whole. Both formats keep messages in chunks of about a MiB; here a chunk is
read and decompressed, the places of its messages are noted, and the rest is left to numpy. Formats:
https://mcap.dev/spec and http://wiki.ros.org/Bags/Format/2.0.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Iterator
from dataclasses import dataclass
from io import BytesIO
from itertools import islice
from struct import Struct
from typing import Any, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from .message_layout import MessageLayout, Raw, alike
from .open import Bag, Topic, one_line_errors

AT_ONCE = 8192
"""Messages that are taken together from what has no chunks."""

MCAP_MESSAGE, MCAP_DATA = 5, 31
"""A record's code, and where behind its start a message's payload begins."""
ROS1_MESSAGE = 2

Key = TypeVar("Key", bound=Hashable)
Messages: TypeAlias = "dict[Topic, Logged]"


@dataclass(frozen=True, eq=False)
class Logged:
    """Messages of one topic with the bag's own stamps (n,), ns, in their order."""

    stamp: NDArray[np.int64]
    raw: Raw

    def __len__(self) -> int:
        return len(self.stamp)

    def __getitem__(self, rows: Any) -> Logged:
        return Logged(self.stamp[rows], self.raw[rows])


def messages(bag: Bag, topics: Iterable[Topic]) -> Iterator[Messages]:
    """The messages of the topics, some at a time: none is earlier, by the bag's own stamps, than those yielded before.

    Raises `FileFormatError` for a file that is cut off or damaged.
    """
    wanted = set(topics)

    def topic_of(connection: Any) -> Topic | None:
        topic = Topic(connection.topic, connection.msgtype)
        return topic if topic in wanted else None

    return messages_by(bag, topic_of)


def messages_by(bag: Bag, key_of: Callable[[Any], Key | None]) -> Iterator[dict[Key, Logged]]:
    """The same by what `key_of` makes of each of rosbags' connections; None: left out."""
    with one_line_errors(bag.path):
        if bag.ros1:
            yield from _in_order(_ros1_chunks(bag.reader, _keys(bag.reader, key_of)))
            return
        storage = bag.reader.storage
        parts = getattr(storage, "storages", [storage])
        if getattr(storage.metadata, "compression_mode", None) or not all(
            getattr(part, "chunks", ()) for part in parts
        ):
            yield from _one_by_one(bag.reader, _keys(bag.reader, key_of))
            return
        for part in parts:
            yield from _in_order(_mcap_chunks(part, _keys(part, key_of)))


def _keys(holder: Any, key_of: Callable[[Any], Key | None]) -> dict[int, Key]:
    """The key of each connection that has one, by the connection's number."""
    keys = {connection.id: key_of(connection) for connection in holder.connections}
    return {number: key for number, key in keys.items() if key is not None}


def _one_by_one(reader: Any, keys: dict[int, Key]) -> Iterator[dict[Key, Logged]]:
    """As rosbags gives them: from sqlite3, where a message is a row, and from an MCAP without chunks."""
    connections = [connection for connection in reader.connections if connection.id in keys]
    taken = iter(reader.messages(connections=connections)) if connections else iter(())
    while some := list(islice(taken, AT_ONCE)):
        by_number: dict[int, tuple[list[int], list[bytes]]] = {}
        for connection, stamp, data in some:
            stamps, payloads = by_number.setdefault(connection.id, ([], []))
            stamps.append(stamp)
            payloads.append(data)
        found: dict[Key, list[Logged]] = {}
        for number, (stamps, payloads) in by_number.items():
            found.setdefault(keys[number], []).append(Logged(np.array(stamps, np.int64), joined(payloads)))
        yield {key: _sorted(parts) for key, parts in found.items()}


def joined(payloads: list[bytes]) -> Raw:
    """Messages one behind the other."""
    length = np.fromiter(map(len, payloads), np.int64, len(payloads))
    return Raw(np.frombuffer(b"".join(payloads), np.uint8), np.cumsum(length) - length, length)


def _in_order(chunks: Iterator[tuple[int, dict[Key, Logged]]]) -> Iterator[dict[Key, Logged]]:
    """What chunks hold, by the bag's own stamps: of a chunk that reaches beyond the start of the next, the rest waits.

    Each comes with the stamp before which no later one holds anything.
    """
    waiting: dict[Key, list[Logged]] = {}
    for until, found in chunks:
        for key, logged in found.items():
            waiting.setdefault(key, []).append(logged)
        now = {}
        for key, parts in waiting.items():
            logged = _sorted(parts)
            ready = int(np.searchsorted(logged.stamp, until, side="left"))
            waiting[key] = [logged[ready:]] if ready < len(logged) else []
            if ready:
                now[key] = logged[:ready]
        if now:
            yield now


def _sorted(parts: list[Logged]) -> Logged:
    """Messages in the order of the bag's stamps, those of one stamp as they were."""
    if len(parts) == 1:
        logged = parts[0]
    elif not parts:
        return Logged(np.empty(0, np.int64), joined([]))
    else:
        before = np.cumsum([0, *(len(part.raw.flat) for part in parts[:-1])])
        starts = [part.raw.start + shift for part, shift in zip(parts, before, strict=True)]
        flat = np.concatenate([part.raw.flat for part in parts])
        raw = Raw(flat, np.concatenate(starts), np.concatenate([part.raw.length for part in parts]))
        logged = Logged(np.concatenate([part.stamp for part in parts]), raw)
    if (np.diff(logged.stamp) >= 0).all():
        return logged
    return logged[np.argsort(logged.stamp, kind="stable")]


def _by_key(flat: NDArray[np.uint8], keys: dict[int, Key], columns: NDArray[np.int64]) -> dict[Key, Logged]:
    """Messages (4, n) of connection, stamp, first byte and length, by the key of their connection."""
    connection, stamp, start, length = columns
    if len(connection) and (int((start + length).max()) > len(flat) or int(length.min()) < 0):
        raise ValueError("a message reaches beyond its chunk")
    found = {}
    for key in dict.fromkeys(keys.values()):
        rows = np.flatnonzero(np.isin(connection, [number for number, other in keys.items() if other == key]))
        if len(rows):
            found[key] = Logged(stamp[rows], Raw(flat, start[rows], length[rows]))
    return found


_UINT32, _UINT64 = Struct("<I"), Struct("<Q")


def _mcap_chunks(storage: Any, keys: dict[int, Key]) -> Iterator[tuple[int, dict[Key, Logged]]]:
    from rosbags.rosbag2.storage_mcap import decompress

    chunks = sorted(storage.chunks, key=lambda chunk: chunk.message_start_time)
    # Without an index of messages, a chunk does not say which channels it holds.
    chunks = [c for c in chunks if not c.message_index_offsets or keys.keys() & c.message_index_offsets.keys()]
    following = [*(chunk.message_start_time for chunk in chunks[1:]), np.iinfo(np.int64).max]
    for chunk, until in zip(chunks, following, strict=False):
        storage.bio.seek(chunk.chunk_start_offset + 9 + 24)
        (crc,) = _UINT32.unpack(storage.bio.read(4))
        storage.bio.seek(chunk.chunk_start_offset + 9 + 40 + len(chunk.compression))
        packed = storage.bio.read(chunk.compressed_size)
        flat = np.frombuffer(decompress(packed, chunk.compression, chunk.uncompressed_size, crc), np.uint8)
        records = np.array(_mcap_records(flat.tobytes()), dtype=np.int64).reshape(-1, 2)
        every = Raw(flat, records[:, 0], records[:, 1])
        channel = every.bytes_at(9, 2).view("<u2")[:, 0].astype(np.int64)
        stamp = every.bytes_at(15, 8).view("<i8")[:, 0]
        yield (
            until,
            _by_key(flat, keys, np.stack([channel, stamp, every.start + MCAP_DATA, every.length - (MCAP_DATA - 9)])),
        )


def _mcap_records(chunk: bytes) -> list[tuple[int, int]]:
    """Where each message's record starts, and the length behind its head of nine bytes."""
    found, pos, end, length_at = [], 0, len(chunk), _UINT64.unpack_from
    while pos < end:
        (length,) = length_at(chunk, pos + 1)
        if chunk[pos] == MCAP_MESSAGE:
            found.append((pos, length))
        pos += 9 + length
    return found


def _ros1_chunks(reader: Any, keys: dict[int, Key]) -> Iterator[tuple[int, dict[Key, Logged]]]:
    infos = [info for info in reader.chunk_infos if keys.keys() & info.connection_counts.keys()]
    infos.sort(key=lambda info: info.start_time)
    following = [*(info.start_time for info in infos[1:]), np.iinfo(np.int64).max]
    for info, until in zip(infos, following, strict=False):
        chunk = reader.chunks[info.pos]
        reader.bio.seek(chunk.datapos)
        packed = reader.bio.read(chunk.datasize)
        if len(packed) != chunk.datasize:
            raise ValueError("a chunk is cut off")
        content = chunk.decompressor(packed)
        flat = np.frombuffer(content, np.uint8)
        records = np.array(_ros1_records(content), dtype=np.int64).reshape(-1, 4)
        heads = Raw(flat, records[:, 0], records[:, 1])
        columns = np.stack([np.full(len(heads), -1), np.zeros(len(heads)), records[:, 2], records[:, 3]]).astype(
            np.int64
        )
        for rows, layout in alike(heads, _ros1_head):
            if layout.texts["op"] == "message":
                head = heads[rows]
                seconds, ns = (head.values(layout, path)[:, 0].astype(np.int64) for path in ("seconds", "ns"))
                columns[0, rows] = head.values(layout, "connection")[:, 0]
                columns[1, rows] = seconds * 10**9 + ns
        yield until, _by_key(flat, keys, columns)


def _ros1_records(chunk: bytes) -> list[tuple[int, int, int, int]]:
    """Of each record, where its head starts and how long it is, and the same of its data."""
    found, pos, end, length_at = [], 0, len(chunk), _UINT32.unpack_from
    while pos < end:
        (head,) = length_at(chunk, pos)
        (data,) = length_at(chunk, pos + 4 + head)
        found.append((pos + 4, head, pos + 8 + head, data))
        pos += 8 + head + data
    return found


def _ros1_head(head: bytes) -> MessageLayout:
    """The layout of a record's head: fields `name=value`, each behind its length; a message's are op, conn and time."""
    numbers, shared, pos, op = {}, [], 0, "other"
    stream = BytesIO(head)
    while length := stream.read(4):
        (size,) = _UINT32.unpack(length)
        name, _, value = stream.read(size).partition(b"=")
        at = pos + 4 + len(name) + 1
        shared.append((pos, head[pos:at]))
        if name == b"op":
            op = "message" if value == bytes([ROS1_MESSAGE]) else "other"
            shared.append((at, value))
        elif name == b"conn":
            numbers["connection"] = (at, "<u4", 1)
        elif name == b"time":
            numbers["seconds"], numbers["ns"] = (at, "<u4", 1), (at + 4, "<u4", 1)
        pos += 4 + size
    return MessageLayout(numbers, {"op": op}, tuple(shared))


def part_read(bag: Bag, found: Messages) -> float:
    """The part of the bag's duration, 0 to 1, at the last of these messages."""
    last = max((int(logged.stamp[-1]) for logged in found.values() if len(logged)), default=0)
    return float(np.clip((1e-9 * last - bag.start) / max(1e-9 * float(bag.reader.duration), 1e-9), 0.0, 1.0))
