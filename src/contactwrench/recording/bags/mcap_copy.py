"""A copy of an MCAP with one more topic in it: every record stays as it was written, down to its sequence number.

rosbags would write each message anew, 20 us each, without its time of publication. Here chunks are opened, the new
messages put between the old records, and chunk and index written again. Format: https://mcap.dev/spec.
"""

from __future__ import annotations

from binascii import crc32
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from struct import Struct, pack, unpack_from
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from .open import one_line_errors

MAGIC = b"\x89MCAP0\r\n"
HEAD = 9
"""Bytes of a record before its content: its code, and the content's length."""

FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, MESSAGE_INDEX = 2, 3, 4, 5, 6, 7
CHUNK_INDEX, ATTACHMENT, ATTACHMENT_INDEX, STATISTICS, METADATA, METADATA_INDEX = 8, 9, 10, 11, 12, 13
SUMMARY_OFFSET, DATA_END = 14, 15

_LENGTH = Struct("<Q")
_MESSAGE_HEAD = Struct("<BQHIQQ")
_STATISTICS = Struct("<QHIIIIQQ")

Until = Callable[[int], tuple[NDArray[np.int64], list[bytes]]]
"""The new messages up to a stamp, ns, that were not given before: stamps, in order, and payloads."""


@dataclass(frozen=True)
class NewTopic:
    """A topic for an MCAP: its name, the name and definition of its type (`ros2msg`), and its channel's metadata."""

    name: str
    type: str
    definition: str
    metadata: bytes


def copy_mcap(storage: Any, path_out: Path, topic: NewTopic, until: Until, last: bool) -> int:
    """Copy the file that rosbags' `storage` holds open, and put in the messages of `topic` by their stamps; of the
    `last` file of a recording, all that are left. How many were put in. Raises `FileFormatError` for a damaged file.
    """
    with Path(storage.path).open("rb") as source, path_out.open("wb") as target:
        return _Copy(storage, source, target, topic, until).run(last)


class _Copy:
    """One copy on its way: what was written so far, as the index at the end needs it."""

    def __init__(self, storage: Any, source: BinaryIO, target: BinaryIO, topic: NewTopic, until: Until) -> None:
        self.storage, self.source, self.target, self.topic, self.until = storage, source, target, topic, until
        self.channel = max(storage.channels, default=0) + 1
        known = [number for number, schema in storage.schemas.items() if schema.name == topic.type]
        self.schema = known[0] if known else max(storage.schemas, default=0) + 1
        self.new_schema = None if known else _record(SCHEMA, _schema(self.schema, topic))
        self.new_channel = _record(CHANNEL, _channel(self.channel, self.schema, topic))
        self.moved: dict[int, int] = {}
        self.chunk_indexes: list[bytes] = []
        self.stamps: list[int] = []
        self.count = 0

    def run(self, last: bool) -> int:
        """Copy everything."""
        self.target.write(self.source.read(len(MAGIC)))
        compression = ""
        while (at := self.source.tell()) < self.storage.data_end:
            head = self.source.read(HEAD)
            with one_line_errors(Path(self.storage.path)):
                content = self.source.read(_LENGTH.unpack_from(head, 1)[0])
            if head[0] == CHUNK:
                compression = self._chunk(content)
            elif head[0] not in (MESSAGE_INDEX, DATA_END):
                self.moved[at] = self.target.tell()
                self.target.write(head + content)
        if last:
            stamps, payloads = self.until(np.iinfo(np.int64).max)
            if len(stamps):
                self._write_chunk([], np.empty((2, 0), np.int64), stamps, payloads, compression)
        self._end()
        return self.count

    def _chunk(self, content: bytes) -> str:
        """Write a chunk with what belongs into it; how it is compressed."""
        from rosbags.rosbag2.storage_mcap import decompress

        records, of_message = [], []
        with one_line_errors(Path(self.storage.path)):
            end, size, crc, name_length = unpack_from("<QQII", content, 8)
            compression = content[32 : 32 + name_length].decode()
            flat = bytes(decompress(content[40 + name_length :], compression, size, crc))
            pos = 0
            while pos < len(flat):
                (length,) = _LENGTH.unpack_from(flat, pos + 1)
                records.append(flat[pos : pos + HEAD + length])
                is_message = flat[pos] == MESSAGE
                of_message.append(_CHANNEL_AND_STAMP.unpack_from(flat, pos + HEAD)[::2] if is_message else (-1, -1))
                pos += HEAD + length
        stamps, payloads = self.until(end)
        known = np.array(of_message, dtype=np.int64).reshape(-1, 2).T
        self._write_chunk(records, known, stamps, payloads, compression)
        return compression

    def _write_chunk(
        self,
        records: list[bytes],
        known: NDArray[np.int64],
        stamps: NDArray[np.int64],
        payloads: list[bytes],
        compression: str,
    ) -> None:
        """`known` (2, n): channel and stamp of each record that is a message, else -1."""
        if not self.count and len(stamps):
            self.target.write((self.new_schema or b"") + self.new_channel)
        place = np.searchsorted(np.maximum.accumulate(known[1]), stamps, side="right")
        order = np.argsort(np.r_[np.arange(len(records)) + 0.5, place], kind="stable")
        parts = [*records, *self._messages(stamps, payloads)]
        parts = [parts[k] for k in order.tolist()]
        channel, stamp = np.hstack([known, np.stack([np.full(len(stamps), self.channel), stamps])])[:, order]
        sizes = np.array([len(part) for part in parts], dtype=np.int64)
        offset = np.cumsum(sizes) - sizes
        content = b"".join(parts)
        packed = _compressed(content, compression)
        is_message = channel >= 0
        times = stamp[is_message]
        first, final = (int(times.min()), int(times.max())) if len(times) else (0, 0)
        head = pack("<QQQII", first, final, len(content), crc32(content), len(compression)) + compression.encode()
        at = self.target.tell()
        self.target.write(_record(CHUNK, head + _LENGTH.pack(len(packed)) + packed))
        behind = self.target.tell()
        index_offsets = b""
        for number in np.unique(channel[is_message]).tolist():
            index_offsets += pack("<HQ", number, self.target.tell())
            entries = np.stack([stamp, offset], axis=1)[channel == number].astype("<u8").tobytes()
            self.target.write(_record(MESSAGE_INDEX, pack("<HI", number, len(entries)) + entries))
        self.chunk_indexes.append(
            pack("<QQQQI", first, final, at, behind - at, len(index_offsets))
            + index_offsets
            + pack("<QI", self.target.tell() - behind, len(compression))
            + compression.encode()
            + pack("<QQ", len(packed), len(content))
        )
        self.count += len(stamps)
        self.stamps += [int(stamps[0]), int(stamps[-1])] if len(stamps) else []

    def _messages(self, stamps: NDArray[np.int64], payloads: list[bytes]) -> list[bytes]:
        return [
            _MESSAGE_HEAD.pack(MESSAGE, 22 + len(payload), self.channel, self.count + k, stamp, stamp) + payload
            for k, (stamp, payload) in enumerate(zip(stamps.tolist(), payloads, strict=True))
        ]

    def _end(self) -> None:
        """Write the end of the data, and the summary with all offsets as they are now."""
        self.target.write(_record(DATA_END, pack("<I", 0)))
        with one_line_errors(Path(self.storage.path)):
            summary = self._summary()
        start, offsets = self.target.tell(), b""
        for code, contents in summary.items():
            at = self.target.tell()
            for content in contents:
                self.target.write(_record(code, content))
            if contents:
                offsets += _record(SUMMARY_OFFSET, pack("<BQQ", code, at, self.target.tell() - at))
        at = self.target.tell()
        self.target.write(offsets + _record(FOOTER, pack("<QQI", start, at, 0)) + MAGIC)

    def _summary(self) -> dict[int, list[bytes]]:
        """The contents of the summary's records by their code."""
        found: dict[int, list[bytes]] = {SCHEMA: [], CHANNEL: [], STATISTICS: []}
        self.source.seek(self.storage.data_end)
        while (head := self.source.read(HEAD))[0] != FOOTER:
            found.setdefault(head[0], []).append(self.source.read(_LENGTH.unpack_from(head, 1)[0]))
        found.pop(SUMMARY_OFFSET, None)
        for code in (ATTACHMENT_INDEX, METADATA_INDEX):
            for k, content in enumerate(found.get(code, ())):
                found[code][k] = _LENGTH.pack(self.moved[_LENGTH.unpack_from(content)[0]]) + content[8:]
        found[CHUNK_INDEX] = self.chunk_indexes
        if self.count:
            found[SCHEMA] += [] if self.new_schema is None else [self.new_schema[HEAD:]]
            found[CHANNEL].append(self.new_channel[HEAD:])
            found[STATISTICS] = [self._statistics(content) for content in found[STATISTICS]]
        return found

    def _statistics(self, content: bytes) -> bytes:
        messages, schemas, channels, attachments, metadata, _, start, end = _STATISTICS.unpack_from(content)
        counts = content[_STATISTICS.size + 4 :] + pack("<HQ", self.channel, self.count)
        schemas += self.new_schema is not None
        return (
            _STATISTICS.pack(
                *(messages + self.count, schemas, channels + 1, attachments, metadata, len(self.chunk_indexes)),
                *(min(start, *self.stamps), max(end, *self.stamps)),
            )
            + pack("<I", len(counts))
            + counts
        )


_CHANNEL_AND_STAMP = Struct("<HIQ")


def _record(code: int, content: bytes) -> bytes:
    return pack("<BQ", code, len(content)) + content


def _text(text: str) -> bytes:
    encoded = text.encode()
    return pack("<I", len(encoded)) + encoded


def _schema(number: int, topic: NewTopic) -> bytes:
    return pack("<H", number) + _text(topic.type) + _text("ros2msg") + _text(topic.definition)


def _channel(number: int, schema: int, topic: NewTopic) -> bytes:
    head = pack("<HH", number, schema) + _text(topic.name) + _text("cdr")
    return head + pack("<I", len(topic.metadata)) + topic.metadata


def _compressed(content: bytes, compression: str) -> bytes:
    """By what rosbags reads it with."""
    if compression == "lz4":
        return bytes(import_module("lz4.frame").compress(content))
    if compression == "zstd":
        return bytes(import_module("rosbags.rosbag2.storage_mcap").zstd.compress(content))
    return content
