"""MCAP files, with an index or without, closed or cut off. Format: https://mcap.dev/spec."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from io import BytesIO
from pathlib import Path
from struct import Struct
from typing import Any
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from .chunked_file import Chunk, ChunkedFile, UnreadableError
from .chunks import LOG, Connection, Damage, Logged, Topic
from .message_layout import Raw

MAGIC = b"\x89MCAP0\r\n"
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, MESSAGE_INDEX, CHUNK_INDEX, ATTACHMENT = range(1, 10)
ATTACHMENT_INDEX, STATISTICS, METADATA, METADATA_INDEX, SUMMARY_OFFSET, DATA_END, PRIVATE = *range(10, 16), 128
"""Codes of records; those from `PRIVATE` on are anybody's own."""
RECORD = Struct("<BQ")
"""Before a record's content: its code and its length."""
FOOT = Struct("<BQQQI8s")
"""A footer and the magic: code, length, where summary and its offsets start, checksum."""
CHUNK_HEAD, INDEX_HEAD, MESSAGE_HEAD = Struct("<QQQII"), Struct("<HI"), Struct("<HIQQ")
HEAD = np.dtype([("connection", "<u2"), ("sequence", "<u4"), ("stamp", "<u8"), ("published", "<u8")])
"""What stands before a message's payload."""
ENTRY = np.dtype([("stamp", "<u8"), ("place", "<i8")])
LIVE = b"contactwrench live"
"""The library that a recording of a live session names in its header: it closes a chunk each half second."""
RUN = 2**20
"""Bytes of messages outside of chunks that are taken together as if they were one."""


class Mcap(ChunkedFile):
    """An MCAP of ROS 2: also its header, and its schemas and channels by number."""

    def __init__(self, path: Path, files: ExitStack, damage: Damage) -> None:
        super().__init__(path, files, damage)
        self.header: Any = None
        self.statistics: Any = None
        self.definitions: dict[int, dict[int, Any]] = {SCHEMA: {}, CHANNEL: {}}
        self.schemas, self.channels = self.definitions.values()
        self.others: dict[int, list[tuple[int, int]]] = {ATTACHMENT: [], METADATA: [], DATA_END: []}
        self._seen: set[tuple[int, bytes]] = set()
        if self._bytes(0, len(MAGIC)) != MAGIC:
            raise ValueError("File magic is invalid")
        self._read(len(MAGIC), self._read_summary())
        self._hold_summary()

    def beside(self, kind: Any) -> Iterator[Any]:
        """The attachments or the metadata: records of that kind of mcap's."""
        for place, length in self.others[ATTACHMENT if kind.__name__ == "Attachment" else METADATA]:
            content = self._bytes(place, length)
            if kind.__name__ == "Attachment" and content.endswith(bytes(4)):  # no checksum
                content = content[:-4] + crc32(content[:-4]).to_bytes(4, "little")
            try:
                yield _parsed(kind, content)
            except UnreadableError as error:
                self.damage.found(f"a record at byte {place} unreadable ({error})", "a whole one")

    def _read_summary(self) -> int:
        """Where the data ends, by the footer; the summary behind it is noted."""
        foot = max(self.size - FOOT.size, len(MAGIC))
        code, length, start, _, checksum, magic = self._head(FOOT, foot)
        start = start or foot
        if (code, length, magic) != (FOOTER, 20, MAGIC) or not len(MAGIC) <= start <= foot:
            written = self._written()
            if not written:
                self.damage.found("no index at its end", "a recording that was closed")
                return self.size
            how = "was not closed, as when its program is killed: what it had written was read"
            self.damage.left_open = f"{self.damage.source} {how}"
            return written
        whole = not checksum or checksum == self._checksum(start, self.size - len(MAGIC) - 4)
        self._require(whole, "another checksum of its index", "the one that it states")
        self._read(start, foot)
        return start

    def _written(self) -> int:
        """Where that ends which a live session had written when it was killed: at the end, or where a 0 stands in place
        of the code of a chunk that was not whole. 0 for any other file: nobody knows what it lacks.
        """
        place, code, last = len(MAGIC), HEADER, 0
        if LIVE not in self._bytes(place, RECORD.size + 2 * len(LIVE)):
            return 0
        while place < self.size and code in (HEADER, CHUNK, MESSAGE_INDEX):
            code, length = self._head(RECORD, place)
            if code:
                last, place = code, place + RECORD.size + length
        return place if last in (CHUNK, MESSAGE_INDEX) and (code == 0 or place == self.size) else 0

    def _checksum(self, start: int, end: int) -> int:
        checksum = 0
        for place in range(start, end, RUN):
            checksum = crc32(self._bytes(place, min(RUN, end - place)), checksum)
        return checksum

    def _head(self, form: Struct, place: int) -> tuple[Any, ...]:
        """What stands at a place of the file; the largest numbers where that ends."""
        return form.unpack(self._bytes(place, form.size).ljust(form.size, b"\xff"))

    def _take(self, place: int, end: int) -> int:
        from mcap.records import ChunkIndex, Header, Statistics

        code, length = self._head(RECORD, place)
        begin, following = place + RECORD.size, place + RECORD.size + int(length)
        if following > end:
            raise UnreadableError("it reaches beyond the end")
        if code == MESSAGE:
            self._take_message(place, following)
        elif code == CHUNK:
            self._take_chunk(place, following)
        elif code == MESSAGE_INDEX and self.chunks:
            self._take_index(self.chunks[-1], begin, length)
        elif code in self.definitions:
            self._define(code, self._bytes(begin, length))
        elif code in self.others:
            self.others[code].append((begin, length))
        elif code == HEADER and self.header is None:
            self.header = _parsed(Header, self._bytes(begin, length))
        elif code == STATISTICS and self.statistics is None:
            self.statistics = _parsed(Statistics, self._bytes(begin, length))
        elif code == CHUNK_INDEX:
            index = _parsed(ChunkIndex, self._bytes(begin, length))
            if self.said.setdefault(index.chunk_start_offset, index) is not index:
                raise UnreadableError("a chunk comes twice")
        elif code not in (ATTACHMENT_INDEX, METADATA_INDEX, SUMMARY_OFFSET) and (
            code < PRIVATE or self.statistics is None
        ):
            raise UnreadableError(f"of kind {code}")
        return following

    def _take_chunk(self, place: int, following: int) -> None:
        at = place + RECORD.size
        start, stop, size, crc, named = self._head(CHUNK_HEAD, at)
        begin = at + CHUNK_HEAD.size + named + 8
        if following - begin != int.from_bytes(self._bytes(begin - 8, 8), "little"):
            raise UnreadableError("its head is another")
        compression = self._bytes(at + CHUNK_HEAD.size, named).decode(errors="replace")
        self._add(Chunk(place, begin, following, compression, size, crc, start, stop))

    def _take_message(self, place: int, following: int) -> None:
        """Of messages outside of chunks, those one behind the other are taken as a chunk."""
        run = self.chunks[-1] if self.chunks else None
        if run is None or run.place != run.begin or run.end != place or run.size > RUN:
            run = Chunk(place, place, place, "", 0)
            self.chunks.append(run)
        stamp = self._head(MESSAGE_HEAD, place + RECORD.size)[2]
        run.end, run.size = following, following - run.begin
        run.start, run.stop = min(run.start, stamp), max(run.stop, stamp)

    def _take_index(self, chunk: Chunk, place: int, length: int) -> None:
        number, size = self._head(INDEX_HEAD, place)
        if size != length - INDEX_HEAD.size or size % ENTRY.itemsize:
            raise UnreadableError("it is of another size")
        chunk.counts = (chunk.counts or {}) | {number: size // ENTRY.itemsize}
        chunk.index.append((number, place + INDEX_HEAD.size, size))

    def _as_said(self, chunk: Chunk) -> Any:
        from mcap.records import ChunkIndex

        before = RECORD.size + INDEX_HEAD.size
        parts = {number: place - before for number, place, _ in chunk.index}
        behind = sum(size + before for _, _, size in chunk.index)
        length, packed, start, stop = chunk.end - chunk.place, chunk.end - chunk.begin, chunk.start, chunk.stop
        return ChunkIndex(length, chunk.place, chunk.compression, packed, stop, behind, parts, start, chunk.size)

    def _hold_summary(self) -> None:
        """What was found is held against what the summary says of it."""
        ends = self.others[DATA_END]
        self._require(
            self.header is not None and len(ends) == (not self.damage.left_open),
            "no start or no end of its data",
            "one of each",
        )
        if self.header is not None and self.header.profile != "ros2":
            raise ValueError("Profile is not ros2")
        for place, length in ends:
            stated = int.from_bytes(self._bytes(place, length), "little")
            whole = not stated or stated == self._checksum(0, place - RECORD.size)
            self._require(whole, "another checksum of its data", "the one that it states")
        said, chunks = self.statistics, [chunk for chunk in self.chunks if chunk.place != chunk.begin]
        self._hold_chunks()
        if said is None or not said.channel_message_counts or len(self.channels) != said.channel_count:
            self._scan()
        if said is not None:
            self.counts = said.channel_message_counts or self.counts
            for name, found, stated in (
                ("schemas", len(self.schemas), said.schema_count),
                ("channels", len(self.channels), said.channel_count),
                ("messages, by channel", sum(self.counts.values()), said.message_count),
                ("chunks", len(chunks), said.chunk_count),
                ("attachments", len(self.others[ATTACHMENT]), said.attachment_count),
                ("metadata", len(self.others[METADATA]), said.metadata_count),
            ):
                self._require(found == stated, f"{found} {name}", f"the {stated} that it counts")
        for channel in self.channels.values():
            known = channel.schema_id in self.schemas or channel.schema_id == 0
            self._require(known, f"no schema {channel.schema_id} of {channel.topic}", "one")
        self.connections = {number: self._connection(channel) for number, channel in sorted(self.channels.items())}
        self._require_bounded()

    def _connection(self, channel: Any) -> Connection:
        """What is known of a channel so far: its schema may come later."""
        schema = self.schemas.get(channel.schema_id)
        name, encoding, text = ("", "", b"") if schema is None else (schema.name, schema.encoding, schema.data)
        details = {
            "serialization_format": channel.message_encoding,
            "offered_qos_profiles": channel.metadata.get("offered_qos_profiles", ""),
        }
        topic, is_idl = Topic(channel.topic, name), encoding != "ros2msg"
        return Connection(topic, text.decode(errors="replace") if encoding else "", is_idl, "", details)

    def _define(self, code: int, content: bytes) -> None:
        """Note a schema or a channel, which may come again and again."""
        from mcap.records import Channel, Schema

        if (code, content) in self._seen:
            return
        kind: Any = Schema if code == SCHEMA else Channel
        record = _parsed(kind, content)
        alike = self.definitions[code].setdefault(record.id, record) == record
        self._require(alike, f"two definitions of {kind.__name__.lower()} {record.id}", "one")
        self._seen.add((code, content))
        if code == CHANNEL:
            self.connections.setdefault(record.id, self._connection(record))

    def _entries(self, index: bytes, content: bytes) -> tuple[NDArray[Any], NDArray[Any]]:
        entries = np.frombuffer(index, ENTRY)
        return entries["stamp"], entries["place"]

    def _walk(self, content: bytes, place: int, end: int) -> Iterator[int]:
        while place < end:
            code, length = RECORD.unpack(content[place : place + RECORD.size].ljust(RECORD.size, b"\xff"))
            begin, following = place + RECORD.size, place + RECORD.size + length
            if following > end or not SCHEMA <= code <= MESSAGE or (code == MESSAGE and length < MESSAGE_HEAD.size):
                raise UnreadableError(f"no record at its byte {place}")
            if code == MESSAGE:
                yield place
            else:
                self._define(code, content[begin:following])
            place = following

    def _ends(self, flat: NDArray[np.uint8], places: NDArray[np.int64]) -> NDArray[np.int64]:
        inside = (places >= 0) & (places <= len(flat) - RECORD.size)
        ends, at = np.full(len(places), -1), places[inside]
        if len(at):
            length = Raw(flat, at, at).bytes_at(1, 8).view("<u8")[:, 0]
            whole = (flat[at] == MESSAGE) & (length >= MESSAGE_HEAD.size) & (length <= len(flat))
            ends[inside] = np.where(whole, at + RECORD.size + length.astype(np.int64), -1)
        return ends

    def _logged(self, flat: NDArray[np.uint8], places: NDArray[np.int64]) -> Logged:
        payload = places + RECORD.size + HEAD.itemsize
        log = Raw(flat, places, places).bytes_at(RECORD.size, HEAD.itemsize).view(HEAD)[:, 0].astype(LOG)
        return Logged(log, Raw(flat, payload, self._ends(flat, places) - payload))


def _parsed(kind: Any, content: bytes) -> Any:
    """A record. Raises `UnreadableError` where the content is not, to its last byte, how that would be written."""
    from mcap.data_stream import ReadDataStream, RecordBuilder

    builder: Any = RecordBuilder()
    try:
        record = kind.read(ReadDataStream(BytesIO(content)))
        record.write(builder)
    except Exception as error:  # of struct, of the text, of mcap
        raise UnreadableError(str(error) or type(error).__name__) from None
    if builder.end()[RECORD.size :] != content:
        raise UnreadableError("it is not as it would be written")
    return record
