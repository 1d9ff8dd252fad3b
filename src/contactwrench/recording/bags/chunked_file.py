"""A file that keeps messages in chunks: walked record by record, and held against every index and count in it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from array import array
from bisect import bisect
from collections import Counter
from collections.abc import Iterator, Set
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from ...errors import FileFormatError
from .chunks import LATEST, NOTHING, ZSTD, Connection, Damage, Logged, in_order

INDEX = np.dtype([("connection", "i8"), ("stamp", "u8"), ("place", "i8")])
"""What the index of a chunk says of a message: also where in the chunk its record is."""
LARGEST = 2**30
"""Bytes: recorders close a chunk at one to some MiB, or behind the one message that is larger."""
DENSEST, FREE = 100, 2**26
"""Times its own size, and bytes, that a file may state as the content of its chunks: readings pack 2 to 20 times."""
MOST_TOPICS = 4096
"""The busiest robots record some hundreds."""
DECOMPRESSORS = {
    "bz2": ("bz2", "BZ2Decompressor"),
    "lz4": ("lz4.frame", "LZ4FrameDecompressor"),
    "zstd": (ZSTD, "ZstdDecompressor"),
}


class UnreadableError(Exception):
    """Bytes that are not what should be there: noted as damage, so that it never leaves this folder."""


@dataclass(eq=False)
class Chunk:
    """A chunk: the place of its record in the file, where its content lies, how that is packed, its size unpacked and
    its checksum (0: none); its first and last stamp, ns; how many messages its index says each connection has (None: no
    index, or one in doubt); and the parts of that index: connection, place in the file, bytes.
    """

    place: int
    begin: int
    end: int
    compression: str
    size: int
    crc: int = 0
    start: int = LATEST
    stop: int = 0
    counts: dict[int, int] | None = None
    index: list[tuple[int, int, int]] = field(default_factory=list)


class ChunkedFile(ABC):
    """A `Source`, open as long as `files`; `said`: what its index says of the chunk at each place. Raises `ValueError`
    for what is no such file, `FileFormatError` for damage that is not accepted, and for what would cost too much.
    """

    def __init__(self, path: Path, files: ExitStack, damage: Damage) -> None:
        self.path, self.file, self.damage = path, files.enter_context(path.open("rb")), damage
        self.size = self.file.seek(0, 2)
        self.most = FREE + DENSEST * self.size
        self.chunks: list[Chunk] = []
        self.said: dict[int, Any] = {}
        self.connections: dict[int, Connection] = {}
        self.counts: dict[int, int] = {}
        if not self.size:
            raise ValueError(f"File {str(path)!r} seems to be empty")

    @abstractmethod
    def _take(self, place: int, end: int) -> int:
        """Note the record at a place; where it ends. Raises `UnreadableError`, as all below, if behind `end`."""

    @abstractmethod
    def _as_said(self, chunk: Chunk) -> Any:
        """What an index would say of a chunk as it was found."""

    @abstractmethod
    def _entries(self, index: bytes, content: bytes) -> tuple[NDArray[Any], NDArray[Any]]:
        """Stamps, ns, and places (n,) of messages, as a part of the index behind a chunk says."""

    @abstractmethod
    def _ends(self, flat: NDArray[np.uint8], places: NDArray[np.int64]) -> NDArray[np.int64]:
        """Where records of messages in a chunk end that start at places (n,); -1 where there is none."""

    @abstractmethod
    def _walk(self, content: bytes, place: int, end: int) -> Iterator[int]:
        """The places of messages between two places of a chunk; definitions are noted."""

    @abstractmethod
    def _logged(self, flat: NDArray[np.uint8], places: NDArray[np.int64]) -> Logged:
        """The messages whose records are there, one or more; a stamp that cannot be is below 0."""

    @property
    def compression(self) -> str:
        """How the chunks are packed, by the first; empty: not at all."""
        return self.chunks[0].compression if self.chunks else ""

    def span(self) -> tuple[int, int]:
        """As of `Source`."""
        known = [chunk for chunk in self.chunks if chunk.start <= chunk.stop < LATEST]
        return min((chunk.start for chunk in known), default=0), max((chunk.stop + 1 for chunk in known), default=0)

    def logged(self, numbers: Set[int]) -> Iterator[Logged]:
        """What some connections recorded; at the end it is held against the counts."""
        chunks = [chunk for chunk in self.chunks if chunk.counts is None or numbers & chunk.counts.keys()]
        chunks.sort(key=lambda chunk: chunk.start)
        read: Counter[int] = Counter()
        for some in in_order([chunk.start for chunk in chunks], (self._messages(chunk, numbers) for chunk in chunks)):
            read.update(_counted(some))
            yield some
        for number in sorted(numbers):
            name, found, count = self.connections[number].topic.name, read[number], self.counts.get(number, 0)
            self._require(found == count, f"{found} messages of {name}", f"the {count} it counts")

    def _bytes(self, place: int, length: int) -> bytes:
        self.file.seek(place)
        return self.file.read(length)

    def _require(self, holds: bool, found: str, expected: str) -> None:
        if not holds:
            self.damage.found(found, expected)

    def _add(self, chunk: Chunk) -> None:
        if chunk.size > min(LARGEST, self.most):
            raise UnreadableError(f"a chunk that states {chunk.size} bytes")
        self.chunks.append(chunk)

    def _require_bounded(self) -> None:
        stated, topics = sum(chunk.size for chunk in self.chunks), len(self.connections)
        for found, limit, what in ((stated, self.most, "bytes in chunks"), (topics, MOST_TOPICS, "topics")):
            if found > limit:
                raise FileFormatError(
                    f"{self.damage.source}: found {found} {what}, expected at most {limit} in a file of {self.size} "
                    "bytes: record it again"
                )

    def _read(self, place: int, end: int) -> None:
        """Take each record between two places; behind what is none, go on at the next chunk of the index."""
        chunks = [*sorted(self.said), end]
        while place < end:
            try:
                place = self._take(place, end)
            except UnreadableError as error:
                self.damage.found(f"a record at byte {place} unreadable ({error})", "a whole one")
                place = chunks[bisect(chunks, place, hi=len(chunks) - 1)]

    def _hold_chunks(self) -> None:
        """The chunks that were found are held against the index of all, where there is one."""
        self._require_bounded()
        for chunk in self.chunks if self.said else ():
            alike = self.said.pop(chunk.place, None) == self._as_said(chunk)
            self._require(alike, f"the chunk at byte {chunk.place}", "it to be as the index says")
            chunk.counts = chunk.counts if alike else None
        self._require(not self.said, f"no chunk at byte {min(self.said, default=0)}", "that of the index")

    def _scan(self) -> None:
        """Note all connections and count their messages, where the file has no account of them."""
        counts: Counter[int] = Counter()
        for chunk in self.chunks:
            counts.update(_counted(self._messages(chunk)))
        self.counts = dict(counts)

    def _content(self, chunk: Chunk) -> bytes:
        """What is in a chunk; a size that lies costs no more than it states. Raises `UnreadableError`."""
        content = self._bytes(chunk.begin, chunk.end - chunk.begin)
        if chunk.compression:
            try:
                module, name = DECOMPRESSORS[chunk.compression]
                content = bytes(getattr(import_module(module), name)().decompress(content, chunk.size + 1))
            except Exception as error:  # each library has its own
                raise UnreadableError(" ".join(str(error).split()) or type(error).__name__) from None
        if len(content) != chunk.size:
            raise UnreadableError(f"it is not of the {chunk.size} bytes that it states")
        if chunk.crc and crc32(content) != chunk.crc:
            raise UnreadableError("its checksum is another")
        return content

    def _index(self, chunk: Chunk, content: bytes) -> NDArray[Any]:
        """What the index behind a chunk says of each message (n,), in the order of their places."""
        parts = [np.empty(0, INDEX)]
        for number, place, size in chunk.index:
            stamps, places = self._entries(self._bytes(place, size), content)
            part = np.empty(len(places), INDEX)
            part["connection"], part["stamp"], part["place"] = number, stamps, places
            parts.append(part)
        index = np.concatenate(parts)
        return index[np.argsort(index["place"], kind="stable")]

    def _messages(self, chunk: Chunk, numbers: Set[int] | None = None) -> Logged:
        """What connections, or all, recorded in a chunk, in order: what of it is whole."""
        where = f"the chunk at byte {chunk.place}"
        try:
            content = self._content(chunk)
        except UnreadableError as error:
            self.damage.found(f"{where} unreadable ({error})", "a whole one")
            return NOTHING
        flat = np.frombuffer(content, np.uint8)
        index = self._index(chunk, content)
        places = self._places(content, flat, index["place"], where)
        every = self._logged(flat, places) if len(places) else NOTHING
        if chunk.index:
            same = np.array_equal(index["place"], places) and np.array_equal(index["connection"], every.connection)
            same = same and np.array_equal(index["stamp"].astype(np.int64), every.stamp)
            held = f"the {len(index)} of its index, where and when it says"
            self._require(same, f"{len(places)} messages in {where}", held)
        possible, known = (every.stamp >= 0) & (every.stamp < LATEST), np.isin(every.connection, list(self.connections))
        late = np.sum(~possible)
        self._require(not late, f"{late} messages in {where} at impossible times", "times from 1970 to 2262")
        self._require(bool(known.all()), f"messages of undefined topics in {where}", "a definition of each")
        rows = possible & known
        if rows.all() and len(rows):
            span = int(every.stamp.min()), int(every.stamp.max())
            if chunk.start > chunk.stop:  # no index says
                chunk.start, chunk.stop = span
            self._require(span == (chunk.start, chunk.stop), f"{where} with other times", "its first and its last")
        chosen = np.flatnonzero(rows if numbers is None else rows & np.isin(every.connection, list(numbers)))
        return every[chosen[np.argsort(every.stamp[chosen], kind="stable")]]

    def _places(
        self, content: bytes, flat: NDArray[np.uint8], places: NDArray[np.int64], where: str
    ) -> NDArray[np.int64]:
        """Where messages are: by the index if nothing but definitions is between them, else from record to record."""
        starts, ends = np.append(places, len(flat)), np.insert(self._ends(flat, places), 0, 0)
        gaps = np.stack([ends, starts], axis=1)[starts != ends].tolist()
        found = array("q")
        with suppress(UnreadableError):
            if all(begin >= 0 and not any(True for _ in self._walk(content, begin, end)) for begin, end in gaps):
                return places
        try:
            for place in self._walk(content, 0, len(content)):
                found.append(place)
        except UnreadableError as error:
            self.damage.found(f"{where} broken ({error})", "records one behind the other")
        return np.array(found, dtype=np.int64)


def _counted(logged: Logged) -> dict[int, int]:
    """How many messages of each connection."""
    numbers, counts = np.unique(logged.connection, return_counts=True)
    return dict(zip(numbers.tolist(), counts.tolist(), strict=True))
