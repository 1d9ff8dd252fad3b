"""Bags of less than a MB that would cost gigabytes or hours, or never end, if they were believed."""

from __future__ import annotations

import bz2
import struct
from collections.abc import Callable, Iterable
from importlib import import_module
from typing import Any

import numpy as np
import pytest

pytest.importorskip("mcap", reason="mcap is not installed")

import zstandard
from mcap.data_stream import RecordBuilder
from mcap.records import Channel, Chunk, ChunkIndex, DataEnd, Footer, Header, Schema, Statistics

MAGIC = b"\x89MCAP0\r\n"
MIB = 2**20
WRENCH = "geometry_msgs/msg/Wrench"
SIX = f"Vector3 force\nVector3 torque\n{'=' * 80}\nMSG: geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z\n"
NAMED = SIX.replace("torque\n", "torque\nstring name\n", 1)
DOUBLING = "\n".join(
    (
        "my/T40 wrench",
        *(f"{'=' * 80}\nMSG: my/T{k}\nT{k - 1} a\nT{k - 1} b" for k in range(40, 0, -1)),
        f"{'=' * 80}\nMSG: my/T0\n",
    )
)
RECURSIVE = f"my/T1 a\n{'=' * 80}\nMSG: my/T1\nmy/T1 a\nmy/T1 b"
LONG = "".join(f"float64 x{k}\n" for k in range(100_000))


def _written(*records: Any) -> bytes:
    builder: Any = RecordBuilder()
    for record in records:
        record.write(builder)
    content: bytes = builder.end()
    return content


def _message(stamp: int, payload: bytes, channel: int = 1) -> bytes:
    return struct.pack("<BQHIQQ", 5, 22 + len(payload), channel, 0, stamp, stamp) + payload


READING = b"\0\1\0\0" + bytes(48)


def _mcap(
    content: bytes = b"",
    *,
    chunks: Iterable[Any] = (),
    definition: str = SIX,
    index: tuple[Any, ...] = (),
    channels: int = 1,
    **said: Any,
) -> bytes:
    """An MCAP of one topic `/wrench`: a chunk of `content`, or `chunks`, and what the summary and statistics say."""
    schema = Schema(1, definition.encode(), "ros2msg", WRENCH)
    topics = [Channel(k + 1, f"/wrench{k or ''}", "cdr", {}, 1) for k in range(channels)]
    some = list(chunks) or [Chunk("", content, 1, 1, 0, len(content))]
    data = MAGIC + _written(Header("ros2", ""), schema, *topics, *some, DataEnd(0))
    counts: dict[str, Any] = {"channel_message_counts": {1: 1}, "message_count": 1, "chunk_count": len(some)} | said
    zeros: dict[str, Any] = dict.fromkeys(
        ("attachment_count", "metadata_count", "message_end_time", "message_start_time"), 0
    )
    statistics = Statistics(channel_count=channels, schema_count=1, **zeros, **counts)
    summary = _written(schema, *topics, statistics, *index, Footer(len(data), 0, 0))
    return data + summary + MAGIC


def _packed(content: bytes, compression: str, size: int | None = None) -> Any:
    pack = {"zstd": zstandard.compress, "lz4": import_module("lz4.frame").compress, "": bytes}[compression]
    return Chunk(compression, pack(content), 1, 1, 0, len(content) if size is None else size)


def _indexed_often() -> bytes:
    place = len(MAGIC) + len(_written(Header("ros2", ""), Schema(1, b"", "ros2msg", WRENCH)))
    place += len(_written(Channel(1, "/wrench", "cdr", {}, 1)))
    chunk = _packed(_message(1, READING), "")
    length = len(_written(chunk))
    index = ChunkIndex(length, place, "", len(chunk.data), 1, 0, {}, 1, chunk.uncompressed_size)
    return _mcap(chunks=[chunk], index=(index,) * 2000)


def _many(count: int, payload: bytes) -> bytes:
    """Messages of one channel, each with three letters of its own at the end of its payload."""
    many = np.tile(np.frombuffer(_message(1, payload), np.uint8), (count, 1))
    for place in (1, 2, 3):
        many[:, -place] = 33 + np.arange(count) // 90 ** (place - 1) % 90
    return many.tobytes()


def _record(data: bytes, stated: int | None = None, **fields: bytes) -> bytes:
    head = b"".join(struct.pack("<I", len(name) + 1 + len(v)) + name.encode() + b"=" + v for name, v in fields.items())
    return struct.pack("<I", len(head)) + head + struct.pack("<I", len(data) if stated is None else stated) + data


def _u4(*numbers: int) -> bytes:
    return struct.pack(f"<{len(numbers)}I", *numbers)


def _ros1(
    content: bytes = b"", *, packed: bytes | None = None, size: int | None = None, compression: bytes = b"none",
    definition: str = SIX, conn_count: int = 1, chunk_count: int = 1, index_pos: int | None = None, counted: int = 1,
    often: int = 1, stamp: tuple[int, int] = (1, 0),
) -> bytes:  # fmt: skip
    """A bag of one topic `/wrench` with one chunk, and what its index says of it."""
    content = content or _record(bytes(48), op=b"\2", conn=_u4(0), time=_u4(*stamp))
    about = _record(b"", type=b"geometry_msgs/Wrench", md5sum=b"*", message_definition=definition.encode())[4:-4]
    connection = _record(about, op=b"\7", conn=_u4(0), topic=b"/wrench")
    place = 4109
    data = _record(
        packed or content, op=b"\5", compression=compression, size=_u4(len(content) if size is None else size)
    )
    entries = _record(_u4(*stamp, 0), op=b"\4", ver=_u4(1), conn=_u4(0), count=_u4(counted))
    info = _record(
        _u4(0, counted), op=b"\6", ver=_u4(1), chunk_pos=struct.pack("<Q", place), start_time=_u4(*stamp),
        end_time=_u4(*stamp), count=_u4(1),
    )  # fmt: skip
    end = place + len(data) + len(entries)
    where = struct.pack("<Q", end if index_pos is None else index_pos)
    head = _record(b"", op=b"\3", index_pos=where, conn_count=_u4(conn_count), chunk_count=_u4(chunk_count))[:-4]
    bag = b"#ROSBAG V2.0\n" + head + _u4(4092 - len(head))
    return bag.ljust(place) + data + entries + connection + info * often


HOSTILE_MCAPS: dict[str, Callable[[], bytes]] = {
    "8 GiB in 0.3 MB": lambda: _mcap(chunks=[_packed(bytes(64 * MIB), "zstd")] * 128),
    "a chunk of 2^63 bytes": lambda: _mcap(chunks=[_packed(bytes(MIB), "zstd", 2**63)]),
    "more than it states, zstd": lambda: _mcap(chunks=[_packed(bytes(256 * MIB), "zstd", 100)]),
    "more than it states, lz4": lambda: _mcap(chunks=[_packed(bytes(100 * MIB), "lz4", 100)]),
    "64 MiB of zeros": lambda: _mcap(chunks=[_packed(bytes(64 * MIB), "zstd")]),
    "100,000 empty messages": lambda: _mcap(chunks=[_packed(_many(100_000, b"...."), "zstd")]),
    "messages that all differ": lambda: _mcap(
        chunks=[_packed(_many(4_000, READING + struct.pack("<I", 4) + bytes(4)), "zstd")], definition=NAMED
    ),
    "empty types, 40 deep, doubling": lambda: _mcap(_message(1, READING), definition=DOUBLING),
    "types in themselves": lambda: _mcap(_message(1, READING), definition=RECURSIVE),
    "a definition of 1.5 MB": lambda: _mcap(
        chunks=[_packed(_written(Schema(1, LONG.encode(), "ros2msg", WRENCH)) + _message(1, READING), "zstd")]
    ),
    "a sequence of 2^32-1 numbers": lambda: _mcap(
        _message(1, b"\0\1\0\0\xff\xff\xff\xff" + bytes(48)), definition="float64[] a"
    ),
    "an array of 10^12 numbers": lambda: _mcap(_message(1, READING), definition="float64[1000000000000] a"),
    "a chunk indexed 2,000 times": _indexed_often,
    "an index of 2^32-1 bytes": lambda: _mcap(
        chunks=[_packed(_message(1, READING), ""), _Bytes(struct.pack("<BQHI", 7, 6, 1, 2**32 - 1))]
    ),
    "a record of 2^64-1 bytes": lambda: _mcap(struct.pack("<BQ", 5, 2**64 - 1) + bytes(50)),
    "a record of 2^63 bytes outside": lambda: _mcap(chunks=[_Bytes(struct.pack("<BQ", 6, 2**63) + bytes(60))]),
    "a name of 4 GiB": lambda: _mcap(chunks=[_Bytes(struct.pack("<BQHHI", 4, 8, 7, 1, 2**32 - 1))]),
    "10,000 channels": lambda: _mcap(_message(1, READING), channels=10_000),
    "a stamp of 2^64-1": lambda: _mcap(_message(2**64 - 1, READING)),
    "a stamp of 2^63-1": lambda: _mcap(_message(2**63 - 1, READING)),
    "2^64-1 messages": lambda: _mcap(
        _message(1, READING), channel_message_counts={1: 2**64 - 1}, message_count=2**64 - 1
    ),
}

HOSTILE_BAGS: dict[str, Callable[[], bytes]] = {
    "a chunk of 4 GiB": lambda: _ros1(size=2**32 - 1),
    "more than it states": lambda: _ros1(packed=bz2.compress(bytes(64 * MIB)), size=100, compression=b"bz2"),
    "no end": lambda: _ros1(packed=bz2.compress(bytes(MIB))[:-20], size=MIB, compression=b"bz2"),
    "2^32-1 connections and chunks": lambda: _ros1(conn_count=2**32 - 1, chunk_count=2**32 - 1),
    "counts of 2^32-1": lambda: _ros1(counted=2**32 - 1),
    "an index beyond the end": lambda: _ros1(index_pos=2**63),
    "a chunk indexed 2,000 times": lambda: _ros1(often=2000),
    "a head of 4 GiB": lambda: _ros1(_u4(2**32 - 1) + bytes(60)),
    "data of 4 GiB": lambda: _ros1(_record(bytes(48), 2**32 - 1, op=b"\2", conn=_u4(0), time=_u4(1, 0))),
    "empty types, 40 deep, doubling": lambda: _ros1(definition=DOUBLING),
    "types in themselves": lambda: _ros1(definition=RECURSIVE),
    "a stamp of 2^32-1 ns": lambda: _ros1(stamp=(1, 2**32 - 1)),
}


class _Bytes:
    """What stands in a file in place of a record."""

    def __init__(self, content: bytes) -> None:
        self.content = content

    def write(self, stream: Any) -> None:
        stream.write(self.content)


def whole_bags() -> tuple[bytes, bytes]:
    """The same bags with nothing hostile in them."""
    return _mcap(_message(1, READING)), _ros1()
