"""The messages of a recording's file as they were logged, a chunk at a time and many at once.

MCAP and ROS 1 keep messages in chunks of about a MiB. A chunk is read whole, where its messages lie is noted, and the
rest is left to numpy (mcap.py, ros1.py). sqlite3 has no chunks: rosbags gives its rows.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence, Set
from dataclasses import dataclass
from itertools import islice
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .message_layout import Raw, joined, written

AT_ONCE = 8192
"""Messages that are taken together from what has no chunks."""

LOG = np.dtype([("connection", "i8"), ("sequence", "i8"), ("stamp", "i8"), ("published", "u8")])
"""Of a message: the number of its connection, its own number there, when it was recorded and published, ns."""


@dataclass(frozen=True)
class Topic:
    """A topic and its type, as rosbags writes it (`geometry_msgs/msg/Wrench`)."""

    name: str
    type: str

    def __str__(self) -> str:
        return f"{self.name} ({written(self.type)})"


@dataclass(frozen=True, eq=False)
class Logged:
    """Messages in the order in which they were recorded: their log (n,), of the type `LOG`, and what was written."""

    log: NDArray[Any]
    raw: Raw

    @property
    def stamp(self) -> NDArray[np.int64]:
        """When each was recorded (n,) ns."""
        stamp: NDArray[np.int64] = self.log["stamp"]
        return stamp

    def __len__(self) -> int:
        return len(self.log)

    def __getitem__(self, rows: Any) -> Logged:
        return Logged(self.log[rows], self.raw[rows])


@dataclass(frozen=True, eq=False)
class Source:
    """A file of messages: its topics by the number of each connection, and `logged`, what the connections of some
    numbers recorded, in order, some at a time. `mcap`: the mcap package's reader, where the file is one with an index.
    """

    topics: dict[int, Topic]
    logged: Callable[[Set[int]], Iterator[Logged]]
    mcap: Any = None


def rosbags_source(reader: Any) -> Source:
    """What rosbags' reader of ROS 2 gives one by one: from sqlite3, and from an MCAP without an index of chunks."""
    connections = list(reader.connections)

    def logged(numbers: Set[int]) -> Iterator[Logged]:
        wanted = [c for c in connections if c.id in numbers]
        rows = iter(reader.messages(connections=wanted)) if wanted else iter(())
        while some := list(islice(rows, AT_ONCE)):
            log = np.zeros(len(some), LOG)
            log["connection"] = [connection.id for connection, _, _ in some]
            log["stamp"] = log["published"] = [stamp for _, stamp, _ in some]
            yield Logged(log, joined([payload for _, _, payload in some]))

    return Source({c.id: Topic(c.topic, c.msgtype) for c in connections}, logged)


def in_order(starts: Sequence[int], chunks: Iterable[Logged]) -> Iterator[Logged]:
    """What chunks hold, in order: of a chunk that reaches beyond the start of the next, the rest waits."""
    waiting = Logged(np.empty(0, LOG), joined([]))
    for until, chunk in zip((*starts[1:], np.iinfo(np.int64).max), chunks, strict=False):
        end = chunk.raw.start + chunk.raw.length
        if ((end > len(chunk.raw.flat)) | (chunk.raw.length < 0) | (chunk.stamp < 0)).any():
            raise ValueError("a message reaches beyond its chunk, or its stamp beyond all times")
        rest = joined([waiting.raw.message(row) for row in range(len(waiting))])  # the chunk they are of is let go
        flat = np.concatenate([rest.flat, chunk.raw.flat]) if len(rest) else chunk.raw.flat
        start = np.concatenate([rest.start, chunk.raw.start + len(rest.flat)])
        raw = Raw(flat, start, np.concatenate([rest.length, chunk.raw.length]))
        ordered = Logged(np.concatenate([waiting.log, chunk.log]), raw)
        if (np.diff(ordered.stamp) < 0).any():
            ordered = ordered[np.argsort(ordered.stamp, kind="stable")]
        ready = int(np.searchsorted(ordered.stamp, until, side="left"))
        if ready:
            yield ordered[:ready]
        waiting = ordered[ready:]
