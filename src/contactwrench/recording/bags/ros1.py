"""ROS 1 bags, closed or cut off. Format: http://wiki.ros.org/Bags/Format/2.0."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from .chunked_file import Chunk, ChunkedFile, UnreadableError
from .chunks import LOG, Connection, Damage, Logged, Topic
from .message_layout import Raw

MAGIC = b"#ROSBAG V2.0\n"
MESSAGE, _, INDEX_DATA, CHUNK, CHUNK_INFO, CONNECTION = (bytes([code]) for code in range(2, 8))
MESSAGE_MARK = b"\x04\0\0\0op=" + MESSAGE
"""In the head of a message's record."""
TIME = np.dtype([("sec", "<u4"), ("ns", "<u4")])
ENTRY = np.dtype([*TIME.descr, ("place", "<u4")])
"""What an index says of a message."""
LONGEST_HEAD = 2**16
"""Bytes: heads have some fields of some bytes."""

Fields: TypeAlias = "dict[str, bytes]"


class Ros1Bag(ChunkedFile):
    """A bag of ROS 1."""

    def __init__(self, path: Path, files: ExitStack, damage: Damage) -> None:
        super().__init__(path, files, damage)
        magic = self._bytes(0, len(MAGIC))
        if not magic.startswith(b"#ROSBAG V"):
            raise ValueError("File magic is invalid")
        if magic != MAGIC:
            raise ValueError(f"Bag version {magic[9:].decode().strip()} is not supported")
        head: Fields = {}
        start, end = len(MAGIC), 0
        try:
            head, _, start = self._record(start, self.size)
            end = _uint(head["index_pos"], 8)
        except (UnreadableError, KeyError):
            self.damage.found("no head", "one that says where its index is")
        if head.get("encryptor"):
            raise ValueError(f"Bag encryption {head['encryptor'].decode()!r} is not supported")
        if not start <= end <= self.size:
            self.damage.found("no index at its end", "a recording that was closed")
            end = self.size
        self._read(end, self.size)
        self._read(start, end)
        self._hold_index(head)

    def _record(self, place: int, end: int) -> tuple[Fields, int, int]:
        """The head of a record, and where its data lies."""
        begin, length = place + 4, _uint(self._bytes(place, 4), 4)
        if length > min(LONGEST_HEAD, end - begin):
            raise UnreadableError("its head reaches beyond the end")
        data = begin + length + 4
        following = data + _uint(self._bytes(data - 4, 4), 4)
        if following > end:
            raise UnreadableError("it reaches beyond the end")
        return _fields(self._bytes(begin, length)), data, following

    def _take(self, place: int, end: int) -> int:
        fields, begin, following = self._record(place, end)
        op = fields.get("op")
        try:
            if op == CONNECTION:
                self._define(fields, self._bytes(begin, following - begin))
            elif op == CHUNK:
                compression = fields["compression"].decode(errors="replace").removeprefix("none")
                self._add(Chunk(place, begin, following, compression, _uint(fields["size"], 4)))
            elif op == INDEX_DATA and self.chunks:
                self._take_index(self.chunks[-1], fields, begin, following)
            elif op == CHUNK_INFO:
                self._take_info(fields, self._bytes(begin, following - begin))
            else:
                raise UnreadableError("of no kind that can be there")
        except KeyError as error:
            raise UnreadableError(f"without {error}") from None
        return following

    def _take_info(self, fields: Fields, data: bytes) -> None:
        start, stop = (_nanoseconds(fields[name]) for name in ("start_time", "end_time"))
        place, count = _uint(fields["chunk_pos"], 8), _uint(fields["count"], 4)
        if len(data) != 8 * count or place in self.said:
            raise UnreadableError("of another size, or a chunk that comes twice")
        counts = dict(np.frombuffer(data, "<u4").reshape(-1, 2).tolist())
        self.said[place] = (start, stop, counts) if counts else None

    def _take_index(self, chunk: Chunk, fields: Fields, begin: int, end: int) -> None:
        number, count = _uint(fields["conn"], 4), _uint(fields["count"], 4)
        if end - begin != count * ENTRY.itemsize or _uint(fields["ver"], 4) != 1:
            raise UnreadableError("an index of another size or version")
        stamps = _stamps(np.frombuffer(self._bytes(begin, end - begin), ENTRY))
        if count:
            chunk.start, chunk.stop = min(chunk.start, int(stamps.min())), max(chunk.stop, int(stamps.max()))
        chunk.counts = (chunk.counts or {}) | {number: count}
        chunk.index.append((number, begin, end - begin))

    def _as_said(self, chunk: Chunk) -> Any:
        return (chunk.start, chunk.stop, chunk.counts) if chunk.counts else None

    def _hold_index(self, head: Fields) -> None:
        """What was found is held against what the head and the index at the end say of it."""
        counts: Counter[int] = Counter()
        for info in self.said.values():
            counts.update(info[2] if info else {})
        for name, found in (("conn_count", self.connections), ("chunk_count", self.said), ("chunk_count", self.chunks)):
            stated = int.from_bytes(head.get(name, b""), "little")
            self._require(len(found) == stated, f"{len(found)} for its {name}", f"the {stated} that it states")
        self._hold_chunks()
        if not counts or not counts.keys() <= self.connections.keys():
            self._scan()
        self.counts = dict(counts) or self.counts
        self._require_bounded()

    def _define(self, fields: Fields, data: bytes) -> None:
        """Note a connection, which may come again and again."""
        try:
            about = {name: value.decode() for name, value in _fields(data).items()}
            package, _, name = about["type"].rpartition("/")
            latching = about.get("latching")
            topic = "/".join(part for part in fields["topic"].decode().split("/") if part)
            topic = "/" * fields["topic"].startswith(b"/") + topic
            details = {"callerid": about.get("callerid"), "latching": int(latching) if latching else None}
            msgtype = f"{package.removesuffix('/msg')}/msg/{name}"
            known = Connection(Topic(topic, msgtype), about["message_definition"], False, about["md5sum"], details)
            number = _uint(fields["conn"], 4)
        except UnicodeDecodeError:
            raise UnreadableError("a connection that is no UTF-8") from None
        except (KeyError, ValueError) as error:
            raise UnreadableError(f"a connection without {error}") from None
        alike = self.connections.setdefault(number, known) == known
        self._require(alike, f"two definitions of connection {number}", "one")

    def _entries(self, index: bytes, content: bytes) -> tuple[NDArray[Any], NDArray[Any]]:
        entries = np.frombuffer(index, ENTRY)
        places = entries["place"].astype(np.int64)
        places[:1] = [_behind_connections(content, place) for place in places[:1].tolist()]
        return _stamps(entries), places

    def _walk(self, content: bytes, place: int, end: int) -> Iterator[int]:
        while place < end:
            head, data, following = _record_in(content, place, end)
            if MESSAGE_MARK in head:
                yield place
            elif (fields := _fields(head)).get("op") == CONNECTION:
                self._define(fields, content[data:following])
            else:
                raise UnreadableError(f"no record at its byte {place}")
            place = following

    def _ends(self, flat: NDArray[np.uint8], places: NDArray[np.int64]) -> NDArray[np.int64]:
        ends = places
        for _ in range(2):  # the head, and the data
            ends = np.where((ends >= 0) & (ends <= len(flat) - 4), ends, -1)
            inside = ends >= 0
            ends[inside] += 4 + _uint32_at(flat, ends[inside])
        return np.where(ends <= len(flat), ends, -1)

    def _logged(self, flat: NDArray[np.uint8], places: NDArray[np.int64]) -> Logged:
        """The heads of a chunk's messages differ in connection and time, and in nothing else."""
        length = _uint32_at(flat, places)
        alike = length == length[0]
        heads = Raw(flat, places[alike], length).bytes_at(4, int(length[0]))
        spots = {name: slice(begin, end) for name, begin, end in _spots(heads[0].tobytes())}
        log = np.zeros(len(places), LOG)
        log["connection"] = -1
        fixed = np.ones(heads.shape[1], dtype=bool)
        for name, size in (("conn", 4), ("time", 8)):
            spot = spots.get(name, slice(0, 0))
            if spot.stop - spot.start != size:
                return Logged(log, Raw(flat, places, 0 * places))
            fixed[spot] = False
        same = ((heads == heads[0]) | ~fixed).all(axis=1)
        alike[alike] = same
        log["connection"][alike] = heads[same, spots["conn"]].copy().view("<u4")[:, 0]
        stamps = _stamps(heads[same, spots["time"]].copy().view(TIME)[:, 0])
        log["stamp"][alike] = log["published"][alike] = stamps.astype(np.int64)
        behind_head = places + 4 + length
        return Logged(log, Raw(flat, behind_head + 4, _uint32_at(flat, behind_head)))


def _record_in(content: bytes, place: int, end: int) -> tuple[bytes, int, int]:
    """The head of a record of a chunk, where its data starts and ends."""
    data = place + 4 + _uint(content[place : place + 4], 4)
    following = data + 4 + _uint(content[data : data + 4], 4)
    if following > end:
        raise UnreadableError(f"no record at its byte {place}")
    return content[place + 4 : data], data + 4, following


def _spots(head: bytes) -> Iterator[tuple[str, int, int]]:
    """Of each field of a head, `name=value` behind its length: the name, and where the value is."""
    place = 0
    while place < len(head):
        begin, end = place + 4, place + 4 + _uint(head[place : place + 4], 4)
        name, equals, _ = head[begin:end].partition(b"=")
        if end > len(head) or not equals:
            raise UnreadableError("a field is cut off")
        yield name.decode(errors="replace"), begin + len(name) + 1, end
        place = end


def _fields(head: bytes) -> Fields:
    return {name: head[begin:end] for name, begin, end in _spots(head)}


def _behind_connections(content: bytes, place: int) -> int:
    """Where the first record from `place` is that is none of a connection: some recorders' indexes point before it."""
    at = place
    try:
        while True:
            head, _, following = _record_in(content, at, len(content))
            if _fields(head).get("op") != CONNECTION:
                return at
            at = following
    except UnreadableError:
        return place


def _stamps(entries: NDArray[Any]) -> NDArray[np.uint64]:
    """ns; of such as cannot be the largest number."""
    ns = entries["sec"].astype(np.uint64) * np.uint64(10**9) + entries["ns"]
    return np.where(entries["ns"] < 10**9, ns, np.uint64(2**64 - 1))


def _nanoseconds(time: bytes) -> int:
    _uint(time, 8)
    return int(_stamps(np.frombuffer(time, TIME))[0])


def _uint(value: bytes, size: int) -> int:
    if len(value) != size:
        raise UnreadableError("a number is cut off")
    return int.from_bytes(value, "little")


def _uint32_at(flat: NDArray[np.uint8], places: NDArray[np.int64]) -> NDArray[np.int64]:
    numbers: NDArray[Any] = np.ndarray(max(len(flat) - 3, 0), "<u4", flat, strides=1)
    return numbers[places].astype(np.int64)
