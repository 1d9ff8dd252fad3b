"""The messages of a ROS 2 sqlite3 recording, by Python's sqlite3 alone.

Only stored columns of tables are read: a view, a virtual table and a generated column run what the file's author wrote.
The messages and their index of stamps are held against one another, so that a damaged page loses no row in silence.
Work and sizes are bounded by the size of the file. Tables: ros2/rosbag2, rosbag2_storage_sqlite3.
"""

from __future__ import annotations

import os
import sqlite3
from collections import Counter
from collections.abc import Iterator, Set
from contextlib import ExitStack
from dataclasses import MISSING, dataclass, fields
from itertools import count
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from ...errors import FileFormatError
from .chunks import AT_ONCE, LOG, Connection, Damage, Logged, Topic
from .message_layout import joined

SAFE = ("trusted_schema = OFF", "query_only = ON", "cell_size_check = ON")
LONGEST_PATH = 500
"""Bytes: sqlite opens no longer one."""
BYTES_AT_ONCE = 2**23
STEPS, STEPS_FREE, STEPS_PER_BYTE = 100_000, 10_000_000, 16
"""Of sqlite's machine: how often they are counted, and the most that a query may take, several times what any file of
messages needs."""

ALL = """
    SELECT count(*), min(timestamp) FILTER (WHERE typeof(timestamp) = 'integer'),
        max(timestamp) FILTER (WHERE typeof(timestamp) = 'integer'), max(length(data)), total(length(data))
    FROM messages NOT INDEXED"""
BY_TOPIC = """
    SELECT topic_id, count(*) FROM messages NOT INDEXED
    WHERE typeof(timestamp) = 'integer' AND typeof(data) = 'blob' GROUP BY topic_id"""
LONGEST = "SELECT max(length(data)) FROM messages NOT INDEXED WHERE topic_id IN ({})"
IN_ORDER = """
    SELECT m.topic_id, m.timestamp, m.data FROM messages AS i
    LEFT JOIN messages AS m NOT INDEXED ON m.rowid = i.rowid AND m.timestamp IS i.timestamp
    WHERE m.topic_id IN ({}) OR m.rowid IS NULL ORDER BY i.timestamp"""
"""The rows of the table in the order of its index, which is all that `i` reads; NULL for an entry without its row."""


@dataclass
class _TopicRow:
    id: int
    name: str
    type: str
    serialization_format: str
    offered_qos_profiles: str = ""
    type_description_hash: str = ""


@dataclass
class _DefinitionRow:
    topic_type: str
    encoding: str
    encoded_message_definition: str


_Row = TypeVar("_Row", _TopicRow, _DefinitionRow)


class Sqlite:
    """A `.db3`, a `Source`, open as long as `files`: messages by the index of stamps, and by the table; what differs is
    damage. Raises `FileFormatError` for that, and for a part in another file; else as sqlite3 for what is no such file.
    """

    def __init__(self, path: Path, files: ExitStack, damage: Damage) -> None:
        _require_closed(path)
        self._base, self._damage = _Base(path, files), damage
        topics = self._base.table("topics", _TopicRow)
        self._base.stored("messages", ("topic_id", "timestamp", "data"))
        ((every, self._first, self._last, longest, length),) = self._base.all(ALL)
        if length > self._base.size:
            raise ValueError(f"more bytes in its messages than the {self._base.size} that it has")
        self._longest = longest or 1
        counted = dict(self._base.all(BY_TOPIC))
        self.counts = {row.id: counted.get(row.id, 0) for row in topics}
        if lost := every - sum(self.counts[row.id] for row in topics):
            damage.found(f"{lost} rows of other types or of no topic in it", "messages: a topic, a stamp and bytes")
        has_definitions = self._base.stored("message_definitions")
        defined: dict[str, _DefinitionRow] = {}
        for row in self._base.table("message_definitions", _DefinitionRow) if has_definitions else ():
            if row.encoding in ("ros2msg", "ros2idl"):
                defined.setdefault(row.topic_type, row)
        self.connections = {row.id: _connection(row, defined.get(row.type)) for row in topics}

    def span(self) -> tuple[int, int]:
        """As of `Source`."""
        return (0, 0) if self._first is None else (self._first, self._last + 1)

    def logged(self, numbers: Set[int]) -> Iterator[Logged]:
        """As of `Source`."""
        among, most = ", ".join(map(str, numbers)), self._longest
        if most * AT_ONCE > BYTES_AT_ONCE:
            most = self._base.all(LONGEST.format(among))[0][0] or 1
        at_once = max(1, min(AT_ONCE, BYTES_AT_ONCE // most))
        read, lost, last = Counter[int](), 0, -(2**63)
        for entries in self._base.blocks(IN_ORDER.format(among), at_once) if numbers else ():
            rows = [row for row in entries if type(row[1]) is int and type(row[2]) is bytes]
            lost += sum(topic is None for topic, _, _ in entries) if len(rows) < len(entries) else 0
            if rows:
                log = np.zeros(len(rows), LOG)
                log["connection"] = topics = [topic for topic, _, _ in rows]
                log["stamp"] = [stamp for _, stamp, _ in rows]
                log["published"] = log["stamp"]
                if last > rows[0][1] or (log["stamp"][1:] < log["stamp"][:-1]).any():
                    raise ValueError("its index of stamps is not in order")
                last = rows[-1][1]
                read.update(topics)
                yield Logged(log, joined([payload for _, _, payload in rows]))
        if lost:
            self._damage.found(f"{lost} entries in its index of stamps without their message", "none")
        for number in numbers:
            if read[number] != self.counts[number]:
                found = f"{read[number]} messages of {self.connections[number].topic.name} by its index of stamps"
                self._damage.found(found, f"{self.counts[number]} as in its table")


def _connection(row: _TopicRow, defined: _DefinitionRow | None) -> Connection:
    details = {"serialization_format": row.serialization_format, "offered_qos_profiles": row.offered_qos_profiles}
    if defined is None:
        return Connection(Topic(row.name, row.type), "", False, "", details)
    text, is_idl = defined.encoded_message_definition, defined.encoding == "ros2idl"
    return Connection(Topic(row.name, row.type), text, is_idl, row.type_description_hash, details)


def _require_closed(file: Path) -> None:
    """Raise `FileFormatError` for sqlite3 of which the last part is in a file of its own: it is read without."""
    for rest in (file.with_name(f"{file.name}{end}") for end in ("-wal", "-journal")):
        if os.path.isfile(rest) and np.fromfile(rest, np.uint8, 1).any():  # one that is done with begins with zeros
            raise FileFormatError(
                f"{file}: found {rest.name} with messages beside it, expected a recording that was closed: join them "
                f"with sqlite3 {file.name} 'PRAGMA wal_checkpoint(TRUNCATE)'"
            )


class _Base:
    """A file that is open to be read and nothing else, by exactly its name."""

    def __init__(self, path: Path, files: ExitStack) -> None:
        absolute = path.absolute()
        if len(bytes(absolute)) > LONGEST_PATH:
            raise ValueError(f"a path of {len(bytes(absolute))} bytes, of which sqlite takes {LONGEST_PATH}")
        with path.open("rb") as file:
            self.size = file.seek(0, 2)
        self._base = sqlite3.connect(f"{absolute.as_uri()}?mode=ro&immutable=1", uri=True)
        files.callback(self._base.close)
        self._base.text_factory = lambda text: text.decode(errors="replace")
        for pragma in SAFE:
            self.all(f"PRAGMA {pragma}")

    def blocks(self, query: str, at_once: int) -> Iterator[list[tuple[Any, ...]]]:
        """What a query gives, so many rows at a time. Raises `ValueError` for work that no file of its size needs."""
        steps, most = count(0, STEPS), STEPS_FREE + STEPS_PER_BYTE * self.size
        self._base.set_progress_handler(lambda: next(steps) > most, STEPS)
        try:
            cursor = self._base.execute(query)
            while rows := cursor.fetchmany(at_once):
                yield rows
        except sqlite3.OperationalError:
            if next(steps) > most:
                raise ValueError("more rows than a file of its size can hold") from None
            raise

    def all(self, query: str) -> list[tuple[Any, ...]]:
        """All that a query gives."""
        return [row for rows in self.blocks(query, AT_ONCE) for row in rows]

    def stored(self, table: str, needed: tuple[str, ...] = ()) -> set[str]:
        """The columns stored in a table; none of what is no table. Raises `ValueError` without those needed."""
        is_table = self.all(f"SELECT 1 FROM sqlite_master WHERE name = '{table}' AND sql LIKE 'CREATE TABLE%'")
        columns = self.all(f"PRAGMA table_xinfo({table})") if is_table else []
        names = {name for _, name, *_, hidden in columns if not hidden}
        if missing := [name for name in needed if name not in names]:
            raise ValueError(f"no table {table} with {', '.join(missing)} stored in it")
        return names

    def table(self, name: str, of: type[_Row]) -> list[_Row]:
        """All rows. Raises `ValueError` where they are of other types, lack a column, or are longer than the file."""
        from msgspec import convert

        stored = self.stored(name, tuple(field.name for field in fields(of) if field.default is MISSING))
        columns, rows, length = [field.name for field in fields(of) if field.name in stored], [], 0
        for (row,) in self.blocks(f"SELECT {', '.join(columns)} FROM {name} ORDER BY rowid", 1):
            rows.append(convert(dict(zip(columns, row, strict=True)), of))
            length += sum(len(value) for value in row if isinstance(value, str))
            if length > self.size:
                raise ValueError(f"more bytes in its {name} than the {self.size} that it has")
        return rows
