"""The messages of a recording's file as they were logged, many at once: what every kind of bag is read into."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator, Sequence, Set
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ...errors import FileFormatError
from ..options import ACCEPT_FLAG
from .message_layout import Raw, joined, written

AT_ONCE = 8192
"""Messages that are taken together from what has no chunks."""

ZSTD = "compression.zstd" if sys.version_info >= (3, 14) else "backports.zstd"
"""The module: where Python has none, that which rosbags brings."""

LOG = np.dtype([("connection", "i8"), ("sequence", "i8"), ("stamp", "i8"), ("published", "u8")])
"""Of a message: the number of its connection, its own number there, when it was recorded and published, ns."""
LATEST = 2**63 - 1
"""ns: no message is from then or later."""


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
        return self.log["stamp"]

    @property
    def connection(self) -> NDArray[np.int64]:
        """The number of the connection of each (n,)."""
        return self.log["connection"]

    def __len__(self) -> int:
        return len(self.log)

    def __getitem__(self, rows: Any) -> Logged:
        return Logged(self.log[rows], self.raw[rows])


NOTHING = Logged(np.empty(0, LOG), joined([]))


@dataclass(frozen=True)
class Connection:
    """What one publisher of a topic, or all of them, recorded: the definition of its type, in IDL or in ROS' own
    language, and its hash, each empty where there is none; and what else rosbags is to be told to write the like.
    """

    topic: Topic
    definition: str
    is_idl: bool
    digest: str
    details: dict[str, Any]


class Damage:
    """What was found damaged in a bag while it is read. `accepted`: what is left of it is wanted."""

    def __init__(self, source: str, accepted: bool = False) -> None:
        self.source, self.accepted = source, accepted
        self._found: dict[str, None] = {}
        self._doubts: dict[str, None] = {}
        self.left_open = ""
        """One sentence where the recording was not closed and lacks nothing but its end; empty: it was closed."""

    def found(self, what: str, expected: str) -> None:
        """Note what was found, as "164 of 950 messages of /wrench". Raises `FileFormatError` unless it is accepted."""
        if not self.accepted:
            raise FileFormatError(
                f"{self.source}: found {what}, expected {expected}: the file is damaged; record or copy it again, or "
                f"read what is left of it with {ACCEPT_FLAG}"
            )
        self._found[f"found {what}, expected {expected}"] = None

    def doubt(self, sentence: str) -> None:
        """Note what was read though it may be meant otherwise."""
        self._doubts[f"{self.source}: {sentence}"] = None

    @property
    def first(self) -> str:
        """What was found first, without its reason and what was expected; empty: nothing."""
        return next(iter(self._found), "").partition(", expected")[0].partition(" (")[0]

    @property
    def said(self) -> str:
        """All that was found, of much the first and the last, which count; else that it was left open; and doubts."""
        found = list(self._found)
        found[4:-4] = [f"{len(found) - 8} more"] if len(found) > 9 else found[4:-4]
        damaged = f"{self.source} is damaged: {'; '.join(found)}; what was left of it was read" if found else ""
        return "; ".join(filter(None, [damaged or self.left_open, *self._doubts]))


class Source(Protocol):
    """A file of messages: its connections, and how many messages each has, by their numbers."""

    connections: dict[int, Connection]
    counts: dict[int, int]

    def span(self) -> tuple[int, int]:
        """When the first message was recorded, and when the last was done, ns."""

    def logged(self, numbers: Set[int]) -> Iterator[Logged]:
        """What the connections of some numbers recorded, in order, some at a time."""


def in_order(starts: Sequence[int], chunks: Iterable[Logged]) -> Iterator[Logged]:
    """What chunks hold, each in order, in the order of all: what reaches beyond the start of the next chunk waits."""
    waiting: list[Logged] = []
    for until, chunk in zip((*starts[1:], LATEST), chunks, strict=False):
        waiting.append(chunk)
        ends = [int(np.searchsorted(part.stamp, until, side="left")) for part in waiting]
        if ready := [part[:end] for part, end in zip(waiting, ends, strict=True) if end]:
            yield _merged(ready)
        waiting = [part[end:] for part, end in zip(waiting, ends, strict=True) if end < len(part)]


def _merged(parts: Sequence[Logged]) -> Logged:
    """Parts that each are in order, in order."""
    *few, last = parts
    if not few:
        return last
    rest = joined([part.raw.message(row) for part in few for row in range(len(part))])
    start = np.concatenate([rest.start, last.raw.start + len(rest.flat)])
    raw = Raw(np.concatenate([rest.flat, last.raw.flat]), start, np.concatenate([rest.length, last.raw.length]))
    merged = Logged(np.concatenate([part.log for part in parts]), raw)
    return merged[np.argsort(merged.stamp, kind="stable")]
