"""Files that grow while the arm runs: what was written can be read from then on, whatever happens to the program.

When `write` returns, all that was added is on the disk, as far as that tells the truth.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from struct import pack
from typing import IO, Any, TypeAlias, cast

from ...recording.bags.mcap import LIVE
from ...recording.bags.open import require_rosbags
from ...recording.bags.write import CDR, POSE_STAMPED, WRENCH_STAMPED
from ...recording.tables.parquet import import_parquet

ROWS_OF_PART = 2**15
"""Of a part of a Parquet recording, which is written anew, with all of them, whenever rows come: at 1 kHz half a minute
and 3 % of a core. More write more, fewer make more parts to open.
"""
STRING = "std_msgs/msg/String"
AT_ONCE = 2**22
"""Bytes of text that go to the system in one call."""
TYPES = {
    "/wrench": WRENCH_STAMPED,
    "/pose": POSE_STAMPED,
    "/flaw": STRING,
    "/wrench/contact": WRENCH_STAMPED,
    "/wrench/contact/std": WRENCH_STAMPED,
    "/wrench/contact/judgement": STRING,
}
"""Of the topics of an MCAP."""
Message: TypeAlias = tuple[str, int, int, bytes]
"""A topic; when it was logged and published, ns; the payload."""


def text_message(text: str) -> bytes:
    """A `std_msgs/String` in CDR."""
    content = text.encode() + b"\0"
    return CDR + pack("<I", len(content)) + content


def _on_disk(file: IO[bytes]) -> None:
    file.flush()
    os.fsync(file.fileno())


class _WholeOrNot:
    """A file that has all up to a flush, or nothing of it, if killed: its first byte, 0 until then, comes last."""

    def __init__(self, path: Path) -> None:
        self._file = path.open("wb", buffering=0)
        self._size, self._held = 0, bytearray()

    def write(self, content: bytes) -> int:
        self._held += content
        return len(content)

    def tell(self) -> int:
        return self._size + len(self._held)

    def flush(self) -> None:
        self._put(1, len(self._held))
        self._put(0, min(1, len(self._held)))
        self._size += len(self._held)
        self._held.clear()
        _on_disk(self._file)

    def _put(self, begin: int, end: int) -> None:
        self._file.seek(self._size + begin)
        while begin < end:
            begin += self._file.write(self._held[begin:end])

    def close(self) -> None:
        with self._file:
            self.flush()


class GrowingText:
    """Lines of CSV. Of all three kinds the methods raise `OSError`, and each `write` leaves a file that is whole."""

    def __init__(self, path: Path) -> None:
        self._file = path.open("wb", buffering=AT_ONCE)

    def add(self, lines: Iterable[str]) -> None:
        """Whole lines."""
        self._file.write("".join(lines).encode())  # all of them, or none

    def write(self) -> None:
        """Write what was added."""
        _on_disk(self._file)

    def close(self) -> None:
        """Close the file."""
        self._file.close()


class GrowingParquet:
    """A folder of Parquet files, which reads as one recording: a file by itself has no content before its end."""

    def __init__(self, path: Path) -> None:
        import_parquet()
        path.unlink(missing_ok=True)
        path.mkdir()
        self._folder, self._part, self._tables = path, 1, list[Any]()

    def add(self, columns: Mapping[str, Any]) -> None:
        """Rows."""
        import pyarrow as pa

        if (table := pa.table(columns)).num_rows:
            self._tables.append(table)

    def write(self) -> None:
        """Write the part that the rows belong to, beside its place, and rename it."""
        import pyarrow as pa

        if not self._tables:
            return
        table = pa.concat_tables(self._tables)
        name = f"part-{self._part:05d}.parquet"
        beside = self._folder / f".{name}.new"
        with beside.open("wb") as file:
            import_parquet().write_table(table, file)
            _on_disk(file)
        beside.replace(self._folder / name)
        if len(table) >= ROWS_OF_PART:
            self._part, self._tables = self._part + 1, []

    def close(self) -> None:
        """Nothing is left to be written."""


class GrowingMcap:
    """An MCAP of ROS 2, a chunk each time that it is written."""

    def __init__(self, path: Path) -> None:
        require_rosbags()
        from mcap.writer import CompressionType, Writer

        self._file = _WholeOrNot(path)
        self._writer: Any = Writer(cast(IO[bytes], self._file), compression=CompressionType.NONE)
        self._writer.start("ros2", LIVE.decode())
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}

    def add(self, messages: Iterable[Message]) -> None:
        """Messages, in the order of their logging."""
        for topic, logged, published, payload in sorted(messages, key=lambda message: message[1]):
            channel = self._channels.get(topic) or self._channel(topic)
            self._writer.add_message(channel, logged, payload, published)

    def write(self) -> None:
        """Write what was added, as a chunk."""
        self._writer.flush()

    def close(self) -> None:
        """Write the index."""
        try:
            self._writer.finish()
        finally:
            self._file.close()

    def _channel(self, topic: str) -> int:
        """A new one."""
        from ...recording.bags.message_layout import typestore

        kind = TYPES[topic]
        if kind not in self._schemas:
            text, _ = typestore(False).generate_msgdef(kind, ros_version=2)
            self._schemas[kind] = self._writer.register_schema(kind, "ros2msg", text.encode())
        channel: int = self._writer.register_channel(topic, "cdr", self._schemas[kind])
        self._channels[topic] = channel
        return channel


Growing: TypeAlias = GrowingText | GrowingParquet | GrowingMcap
