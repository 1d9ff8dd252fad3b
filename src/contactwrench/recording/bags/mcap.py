"""MCAP files: their chunks by the index at the end. Format: https://mcap.dev/spec."""

from __future__ import annotations

from collections.abc import Iterator, Set
from struct import Struct
from typing import BinaryIO

import numpy as np

from .chunks import LOG, Logged, Source, Topic, in_order
from .message_layout import Raw

MCAP_RECORD, MCAP_MESSAGE = 9, 5
"""Bytes before a record's content, its code and its length; the code of a message."""
MCAP_HEAD = np.dtype([("connection", "<u2"), ("sequence", "<u4"), ("stamp", "<i8"), ("published", "<u8")])
"""What stands before a message's payload."""
_LENGTH = Struct("<Q")


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
        return in_order([chunk.message_start_time for chunk in chunks], contents)

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
