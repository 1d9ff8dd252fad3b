"""What is in a recording, before anything is made of it: topics or columns, how many, how often, the longest gap."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..errors import FileFormatError
from ..files import name_of
from ..geometry.arrays import Array
from .bags.chunks import Logged, Topic
from .bags.message_layout import written
from .bags.messages import JOINT_STATE, POSES, TRANSFORMS, WRENCHES, Link, header_stamps, transforms
from .bags.open import KINDS, Bag, definitions, kind_of, messages, opened_bag, part_read, seconds
from .bags.topics import FRAMES_FLAG, ROBOT_FLAG, pose_topics, wrench_topic
from .bags.transforms import Edge, note
from .read import read_as_bag
from .tables.columns import AS_NAMED, Advance, Column, OpenTable, taken_for, unheard
from .tables.episodes import episode_column, episodes_of
from .tables.orientations import orientation_columns
from .tables.roles import time_columns, wrench_columns
from .tables.table import in_seconds, in_si, open_set

HEADER = "std_msgs/msg/Header"
NO_TIMES = "found none: add a column t, name one with --time-column, or state --rate HZ"


@dataclass(frozen=True)
class Rhythm:
    """When something was recorded: `count` times from `first` to `last`, s from the start of the recording; `rate` Hz,
    of the median time between two; the `longest_gap` s and where it starts, `gap_at` s. None: too few to say.
    """

    count: int
    first: float | None = None
    last: float | None = None
    rate: float | None = None
    longest_gap: float | None = None
    gap_at: float | None = None


@dataclass(frozen=True)
class TopicContent:
    """A topic: its name and type, what it `gives` (wrench, pose, and with which option; nothing), and its rhythm by the
    stamps in its headers, where it has them. `clock` s: by how much those run behind the bag's own, as a rule.
    """

    name: str
    type: str
    gives: str
    rhythm: Rhythm
    clock: float | None


@dataclass(frozen=True)
class FrameContent:
    """A frame of tf under its parent; `moves`: whether its transform ever changes."""

    name: str
    parent: str
    moves: bool
    count: int


@dataclass(frozen=True)
class BagContents:
    """A bag: `start` s (Unix time, as a rule), `duration` s by its own stamps, its topics by name, the frames of its
    transforms, in sentences what its `reading` needs, and what is
    damaged in it; empty: nothing. `left_open`: in a sentence that it was not closed, or empty.
    """

    path: str
    kind: str
    start: float
    duration: float
    topics: tuple[TopicContent, ...]
    frames: tuple[FrameContent, ...]
    reading: tuple[str, ...]
    damage: str = ""
    left_open: str = ""


@dataclass(frozen=True)
class TableContents:
    """A table: its columns, its number of rows, its rhythm where it has times, and in sentences what its `reading`
    takes for what, or lacks. Of a set also its `episodes`; start and rhythm are those of the first.
    """

    path: str
    columns: tuple[str, ...]
    rows: int
    start: float | None
    rhythm: Rhythm | None
    reading: tuple[str, ...]
    episodes: tuple[int, ...] = ()


def contents(path: str | Path, advance: Advance = unheard) -> BagContents | TableContents:
    """What is in a recording; `advance` is told how far it is. Raises as `read_streams`."""
    return bag_contents(path, advance) if read_as_bag(path) else table_contents(path, advance)


def bag_contents(path: str | Path, advance: Advance = unheard) -> BagContents:
    """What is in a bag; `advance` as for `bag_batches`. Raises as that where nothing can be read."""
    with opened_bag(path, accept_damaged=True) as bag:
        stamps: dict[Topic, list[tuple[Array, Array]]] = {topic: [] for topic in bag.counts}
        edges: dict[Link, Edge] = {}
        for found in messages(bag, bag.counts):
            for topic, logged in found.items():
                stamps[topic].append(_stamps(bag, topic, logged))
                if topic.type in TRANSFORMS:
                    note(edges, topic, transforms(bag, topic, logged))
            advance(part_read(bag, found))
        topics = tuple(_topic_content(topic, parts, bag.start) for topic, parts in stamps.items())
        frames = tuple(
            FrameContent(child, parent, edge.moves, edge.count) for (parent, child), edge in sorted(edges.items())
        )
        kind, left_open = KINDS[kind_of(path)], bag.damage.left_open
        said = bag.damage.said if bag.damage.first else ""
        return BagContents(name_of(path), kind, bag.start, bag.duration, topics, frames, _reading(bag), said, left_open)


def table_contents(path: str | Path, advance: Advance = unheard) -> TableContents:
    """What is in a table. Raises as `read` for a file that is none."""
    table = open_set(path)
    t_columns: tuple[Column, ...] = ()
    with suppress(FileFormatError):
        t_columns = time_columns(table, AS_NAMED)
    reading = {
        "wrench": _or_why_not(lambda: taken_for(wrench_columns(table, AS_NAMED)), table.source),
        "orientation": _or_why_not(lambda: taken_for(orientation_columns(table, AS_NAMED)[1]), table.source),
        "times": _or_why_not(lambda: taken_for(time_columns(table, AS_NAMED)) or NO_TIMES, table.source),
    }
    try:
        count, t, episodes = _counted(table, t_columns, advance)
    except FileFormatError as error:  # a column that is named like times and holds none
        reading["times"] = str(error).removeprefix(f"{table.source}: ")
        count, t, episodes = _counted(open_set(path), (), advance)
    start = float(t[0]) if t is not None and len(t) else None
    times = None if t is None or start is None else rhythm(t, start)
    sentences = tuple(f"{what}: {said}" for what, said in reading.items())
    return TableContents(table.source, tuple(table.places), count, start, times, sentences, episodes)


def _counted(
    table: OpenTable, t_columns: tuple[Column, ...], advance: Advance
) -> tuple[int, Array | None, tuple[int, ...]]:
    """The number of rows, their times where there are any, of a set those of its first episode, and its episodes."""
    of_episode = episode_column(table)
    columns = t_columns if of_episode is None else (*t_columns, of_episode)
    count, parts = 0, [np.empty((0, len(columns)))]
    for body in table.told(columns, advance):
        count += len(body)
        parts += in_si(body, (columns,)) if columns else []
        if of_episode is not None:
            episodes_of(body, of_episode)
    values = np.concatenate(parts)
    episodes = () if of_episode is None else tuple(np.unique(values[:, -1]).astype(int).tolist())
    first = values if len(episodes) < 2 else values[values[:, -1] == episodes[0]]
    return count, in_seconds(first[:, : len(t_columns)], t_columns), episodes


def _or_why_not(said: Callable[[], str], source: str) -> str:
    try:
        return said()
    except FileFormatError as error:
        return str(error).removeprefix(f"{source}: ")


def rhythm(t: Array, start: float, shown_at: Array | None = None) -> Rhythm:
    """The rhythm of times (n,), s, as recorded; `shown_at` (n,): times to name places by, where they are others."""
    if not len(t):
        return Rhythm(0)
    at = t if shown_at is None else shown_at
    first, last = float(at[0]) - start, float(at[-1]) - start
    if len(t) == 1:
        return Rhythm(1, first, last)
    gaps = np.diff(t)
    middle, widest = float(np.median(gaps)), int(np.argmax(gaps))
    rate = 1.0 / middle if middle > 0.0 else None
    return Rhythm(len(t), first, last, rate, float(gaps[widest]), float(at[widest]) - start)


def _stamps(bag: Bag, topic: Topic, logged: Logged) -> tuple[Array, Array]:
    """The times of messages: of the header where there is one, and of the bag."""
    of_bag = seconds(logged.stamp)
    try:
        fields = definitions(bag, topic)[topic.type][1]
    except FileFormatError:
        return of_bag, of_bag
    if not fields or fields[0][1][1] != HEADER:
        return of_bag, of_bag
    return header_stamps(bag, topic, logged), of_bag


def _topic_content(topic: Topic, parts: list[tuple[Array, Array]], start: float) -> TopicContent:
    t, of_bag = (np.concatenate([np.empty(0), *(part[k] for part in parts)]) for k in (0, 1))
    behind = float(np.median(of_bag - t)) if len(t) and (t != of_bag).any() else None
    return TopicContent(topic.name, written(topic.type), _gives(topic.type), rhythm(t, start, of_bag), behind)


def _gives(msgtype: str) -> str:
    if msgtype in WRENCHES:
        return "wrench"
    if msgtype in POSES:
        return "pose"
    if msgtype in TRANSFORMS:
        return f"pose with {FRAMES_FLAG} BASE,FLANGE"
    return f"pose with {ROBOT_FLAG} NAME" if msgtype == JOINT_STATE else ""


def _reading(bag: Bag) -> tuple[str, ...]:
    """Which topics are read when nothing is asked for, or why that cannot be said."""
    wrench = _or_why_not(lambda: wrench_topic(bag, None).name, str(bag.path))
    pose = _or_why_not(lambda: ", ".join(topic.name for topic in pose_topics(bag, None, None, None)), str(bag.path))
    return f"wrench: {wrench}", f"pose: {pose}"
