"""sqlite3 recordings that are not what they seem: by rosbags' writer, then changed in SQL or in their pages."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path

from tests.support.bags import Message, write_bag

ENDLESS = "WITH RECURSIVE n(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM n)"

CHANGED = {
    "a view that never ends": (
        f"DROP TABLE messages; CREATE VIEW messages AS {ENDLESS}"
        " SELECT 1 AS topic_id, x AS timestamp, x'00' AS data FROM n"
    ),
    "a virtual table": "DROP TABLE messages; CREATE VIRTUAL TABLE messages USING fts4(topic_id, timestamp, data)",
    "a column that is computed": (
        "ALTER TABLE messages RENAME TO old;"
        "CREATE TABLE messages(topic_id INTEGER, timestamp INTEGER, data AS (zeroblob(1000000000)));"
        "INSERT INTO messages(topic_id, timestamp) SELECT topic_id, timestamp FROM old"
    ),
    "no topics": "DROP TABLE topics",
    "a number as a type": "UPDATE topics SET type = x'00'",
}
"""In SQL."""

ROWS = {
    "text for bytes": "UPDATE messages SET data = 'hello' WHERE id IN (3, 5)",
    "half a stamp": "UPDATE messages SET timestamp = 1.5 WHERE id IN (3, 5)",
    "text for a stamp": "UPDATE messages SET timestamp = 'soon' WHERE id IN (3, 5)",
    "no such topic": "UPDATE messages SET topic_id = 77 WHERE id IN (3, 5)",
    "text for a topic": "UPDATE messages SET topic_id = 'one' WHERE id IN (3, 5)",
}
"""Two rows that are no messages, in SQL."""


def changed(path: Path, messages: list[Message], sql: str) -> Path:
    """A `.db3`, changed in SQL."""
    write_bag(path, messages)
    with closing(sqlite3.connect(path)) as base:
        base.executescript(sql)
        base.commit()
    return path


def endless(path: Path, messages: list[Message]) -> Path:
    """A `.db3` of some kB whose table of messages has 400 to the power of eight leaves, all the same one."""
    write_bag(path, messages)
    with closing(sqlite3.connect(path)) as base:
        ((root, size),) = base.execute(
            "SELECT rootpage, (SELECT * FROM pragma_page_size) FROM sqlite_master WHERE name = 'messages'"
        )
        base.execute("CREATE TABLE room(x)")
        base.executemany("INSERT INTO room VALUES (zeroblob(?))", [(size - 100,)] * 20)
        base.commit()
    content = bytearray(path.read_bytes())
    leaf = int.from_bytes(content[size * (root - 1) + 8 :][:4], "big")
    last = len(content) // size
    pages = [root, *range(last - 8, last - 1)]
    for page, child in zip(pages, [*pages[1:], leaf], strict=True):
        content[size * (page - 1) : size * page] = _interior(child, size)
    path.write_bytes(bytes(content))
    return path


def _interior(child: int, size: int) -> bytes:
    """A page of a table's tree whose 400 children are all the same page."""
    cells = [child.to_bytes(4, "big") + bytes([0x81 + k // 128, k % 128]) for k in range(400)]
    places = [size - 6 * (k + 1) for k in range(400)]
    head = (
        bytes([5, 0, 0]) + (400).to_bytes(2, "big") + places[-1].to_bytes(2, "big") + b"\0" + child.to_bytes(4, "big")
    )
    body = b"".join(place.to_bytes(2, "big") for place in places)
    return (head + body).ljust(size - 2400, b"\0") + b"".join(reversed(cells))
