"""ROS bags opened, with no ROS: `.bag`, `.mcap`, `.db3`, and the folder that ROS 2 writes. All errors are one line."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ...errors import ContactWrenchError, FileAccessError, FileFormatError, of_extra
from ...files import entries, open_bytes
from ...geometry.arrays import Array
from .chunks import Connection, Damage, Logged, Source, Topic
from .folder import METADATA, PackedMessages, bags_in, files_of, hold, left_in, metadata, unpacked
from .mcap import Mcap
from .message_layout import Fields, types_defined, typestore, written
from .ros1 import Ros1Bag
from .sqlite import Sqlite

SUFFIXES_OF_BAGS = (".bag", ".mcap", ".db3")
KINDS = {".bag": "ROS 1 bag", ".mcap": "MCAP file", ".db3": "ROS 2 sqlite3 bag", "": "ROS 2 bag folder"}
LONGEST_DEFINITION = 2**18
"""Characters: those of ROS' largest types, with all that is in them, are a fifth of it; each costs 5 us to parse."""

READERS: dict[str, Callable[[Path, ExitStack, Damage], Source]] = {
    ".bag": Ros1Bag,
    ".mcap": Mcap,
    "mcap": Mcap,
    ".db3": Sqlite,
    "sqlite3": Sqlite,
}
"""By the suffix of a file, or by what a folder says of its files."""

Messages: TypeAlias = dict[Topic, Logged]


@dataclass(frozen=True, eq=False)
class Bag:
    """An open bag: the files of its messages, and whether they are MCAP; when the first was recorded, and how long all
    of them took, s; how it is compressed, in the words of `new_bag`; its damage so far; and of what each topic's
    messages were found to be so far, where all should be of one (`two_of`).
    """

    path: Path
    ros1: bool
    sources: tuple[Source, ...]
    mcap: bool
    start: float
    duration: float
    compression: str
    damage: Damage
    seen: dict[tuple[Topic, str], dict[str, None]] = field(default_factory=dict)

    @property
    def connections(self) -> list[Connection]:
        """Those of all files, one a publisher or a topic."""
        return [connection for source in self.sources for connection in source.connections.values()]

    @property
    def counts(self) -> dict[Topic, int]:
        """How many messages each topic has, by name."""
        counts: Counter[Topic] = Counter()
        for source in self.sources:
            for number, connection in source.connections.items():
                counts[connection.topic] += source.counts.get(number, 0)
        return dict(sorted(counts.items(), key=lambda item: item[0].name))


def seconds(ns: NDArray[np.int64] | np.int64) -> Array:
    """Stamps in ns as s, rounded as a header's seconds and nanoseconds are."""
    whole, rest = np.divmod(ns, 10**9)
    return whole + 1e-9 * rest


def is_bag(path: str | Path) -> bool:
    """Whether the name, or what is in the folder, is that of a bag."""
    path = Path(path)
    if os.path.isdir(path):
        return any(file.name == METADATA or file.suffix.lower() in SUFFIXES_OF_BAGS for file in entries(path))
    return path.suffix.lower() in SUFFIXES_OF_BAGS


def kind_of(path: str | Path) -> str:
    """`.bag`, `.mcap`, `.db3`, or nothing for a folder. Raises `FileAccessError` and `FileFormatError` for others."""
    path = Path(path)
    if os.path.isdir(path):
        if not os.path.isfile(path / METADATA) and not bags_in(path):
            raise FileFormatError(
                f"{path}: found a folder without {METADATA}, expected a ROS 2 bag: name the .mcap or .db3 file in it"
            )
        return ""
    if os.path.exists(path) and not os.path.isfile(path):
        raise FileFormatError(f"{path}: found a pipe or a device, expected a bag: copy it into a file")
    with open_bytes(path):
        suffix = path.suffix
    if suffix.lower() not in SUFFIXES_OF_BAGS:
        raise FileFormatError(
            f"{path}: found the suffix {suffix or '(none)'}, expected .bag, .mcap, .db3 or a folder with {METADATA}"
        )
    return suffix.lower()


@contextmanager
def opened_bag(path: str | Path, *, accept_damaged: bool = False) -> Iterator[Bag]:
    """An open bag, closed at the end; damage is noted in `Bag.damage`. Raises `FileAccessError`, `MissingExtraError`,
    and `FileFormatError` for what is no bag, or one that is cut off or damaged and not accepted.
    """
    path = Path(path)
    kind = kind_of(path)
    require_rosbags()
    damage = Damage(str(path), accept_damaged)
    with ExitStack() as files:
        with one_line_errors(path):
            bag = _opened(path, kind, files, damage)
        try:
            yield bag
        except FileFormatError as error:
            raise FileFormatError(f"{error} (damaged: {damage.first})") if damage.first else error from None


def require_rosbags() -> None:
    """Raise `MissingExtraError` without rosbags and mcap."""
    for module in ("mcap", "rosbags.rosbag2"):
        of_extra(module, "a ROS bag", "bags")


def messages(bag: Bag, topics: Iterable[Topic]) -> Iterator[Messages]:
    """The messages of topics, some at a time, none earlier by the bag's stamps than those before. Raises for damage."""
    wanted = set(topics)
    for source in bag.sources:
        chosen = {number: each.topic for number, each in source.connections.items() if each.topic in wanted}
        for logged in logged_in(bag, source, chosen):
            by_topic: dict[Topic, list[int]] = {}
            for number in np.unique(logged.connection).tolist():
                by_topic.setdefault(chosen[number], []).append(number)
            yield {
                topic: logged[np.flatnonzero(np.isin(logged.connection, numbers))]
                for topic, numbers in by_topic.items()
            }


def logged_in(bag: Bag, source: Source, numbers: Collection[int]) -> Iterator[Logged]:
    """What some connections of one of the bag's files recorded. Raises as `messages`."""
    with one_line_errors(bag.path):
        yield from source.logged(set(numbers))


def two_of(bag: Bag, topic: Topic, what: str, found: Iterable[str]) -> tuple[str, ...]:
    """The first two sensors, frames, arms or clocks that a topic's messages were found to be of so far; empty: one."""
    seen = bag.seen.setdefault((topic, what), {})
    seen.update(dict.fromkeys(found))
    return tuple(seen)[:2] if len(seen) > 1 else ()


def definitions(bag: Bag, topic: Topic) -> Fields:
    """The definition of a topic's type and of all types in it: its own, else another topic's, else that of ROS. Raises
    `FileFormatError` where there is none, it cannot be understood, or those of its publishers differ.
    """
    name = written(topic.type)
    of_type = [each for each in bag.connections if each.topic.type == topic.type and each.definition.strip()]
    own = [each for each in of_type if each.topic == topic]
    stated = dict.fromkeys((each.definition, each.is_idl) for each in own or of_type)
    if not stated:
        of_ros: Fields = typestore(bag.ros1).fielddefs
        if topic.type not in of_ros:
            raise FileFormatError(f"{bag.path}: found no definition of {name}, expected one in the bag")
        return of_ros
    try:
        if max(len(text) for text, _ in stated) > LONGEST_DEFINITION:
            raise ValueError(f"more than {LONGEST_DEFINITION} characters")
        first, *others = (types_defined(topic.type, text, is_idl, bag.ros1) for text, is_idl in stated)
    except Exception as error:  # whatever rosbags' parser stumbles over
        reason = " ".join(str(error).split())[:100]
        raise FileFormatError(
            f"{bag.path}: the definition of {name} cannot be understood ({reason}), expected that of ROS"
        ) from None
    if any(each[known][1] != first[known][1] for each in others for known in each.keys() & first.keys()):
        raise FileFormatError(
            f"{bag.path}: topic {topic.name}: found two definitions of {name}, expected one: record each publisher on "
            "a topic of its own"
        )
    return first


def hold_digests(bag: Bag, topic: Topic, types: Fields) -> None:
    """Hold the hashes that a bag of ROS 1 states of a topic's type, each its own or `*`, against its definition; of one
    with constants rosbags keeps the values, and not the text that is hashed.
    """
    from rosbags.typesys import Stores, TypesysError, get_typestore

    store = get_typestore(Stores.EMPTY)
    store.fielddefs.update(types)
    with suppress(TypesysError, RecursionError):  # then none of its messages is understood
        text, expected = store.generate_msgdef(topic.type)
        for each in bag.connections if "=" not in text.replace("=" * 80, "") else ():
            if each.topic == topic and each.digest.lower() not in ("", "*", expected):
                found = f"the md5sum {each.digest} of {written(topic.type)} in topic {topic.name}"
                bag.damage.found(found, f"{expected} as of its definition")


def part_read(bag: Bag, parts: Messages) -> float:
    """The part of the bag's duration, 0 to 1, at the last of these messages."""
    last = max((int(logged.stamp[-1]) for logged in parts.values()), default=0)
    return float(np.clip((1e-9 * last - bag.start) / max(bag.duration, 1e-9), 0.0, 1.0))


@contextmanager
def one_line_errors(path: Path) -> Iterator[None]:
    """Whatever the readers, and the libraries under them, raise for a file becomes `FileFormatError`."""
    try:
        yield
    except (ContactWrenchError, MemoryError):
        raise
    except PermissionError as error:
        raise FileAccessError(
            f"{path}: cannot be read ({(error.strerror or str(error)).lower()}): check the path and its permissions"
        ) from None
    except Exception as error:
        reason = " ".join(str(error).split()).rstrip(".") or type(error).__name__
        kind = KINDS["" if os.path.isdir(path) else path.suffix.lower()]
        raise FileFormatError(
            f"{path}: cannot be read as a {kind} ({reason}), expected a whole one: record or copy it again"
        ) from None


def _opened(path: Path, kind: str, files: ExitStack, damage: Damage) -> Bag:
    """A file, or those of a folder, held against what that says of them."""
    said = None if kind or not os.path.isfile(path / METADATA) else metadata(path)
    if said is None:
        named, packed = [path] if kind else left_in(path, damage), ""
        reader = READERS[named[0].suffix.lower()]
    else:
        named, packed = files_of(path, said), said.packed
        reader = READERS[said.storage_identifier]
    whole = named
    if packed == "file":
        folder = Path(files.enter_context(TemporaryDirectory()))
        whole = [unpacked(file, folder) for file in named]
    sources: list[Source] = [reader(file, files, damage) for file in whole]
    if said is not None:
        hold(said, named, sources, damage)
    if packed == "message":
        sources = [PackedMessages(source, file) for source, file in zip(sources, named, strict=True)]
    spans = [source.span() for source in sources if any(source.counts.values())] or [(0, 0)]
    start, end = min(first for first, _ in spans), max(last for _, last in spans)
    how = next((source.compression for source in sources if isinstance(source, Ros1Bag)), packed)
    began, duration = float(seconds(np.int64(start))), 1e-9 * (end - start)
    return Bag(path, kind == ".bag", tuple(sources), reader is Mcap, began, duration, how, damage)
