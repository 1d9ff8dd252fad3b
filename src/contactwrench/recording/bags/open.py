"""ROS bags opened through rosbags, with no ROS: `.bag`, `.mcap`, `.db3`, and the folder that ROS 2 writes.

rosbags raises whatever a damaged file makes it stumble over; here each becomes one line that names the file.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ...errors import ContactWrenchError, FileAccessError, FileFormatError, MissingExtraError
from ...geometry.arrays import Array

SUFFIXES_OF_BAGS = (".bag", ".mcap", ".db3")
METADATA = "metadata.yaml"
"""Makes a folder a ROS 2 bag."""

KINDS = {".bag": "ROS 1 bag", ".mcap": "MCAP file", ".db3": "ROS 2 sqlite3 bag", "": "ROS 2 bag folder"}

Fields: TypeAlias = "dict[str, tuple[list[Any], list[tuple[str, Any]]]]"
"""rosbags' message definitions: constants and fields by the type's name."""


@dataclass(frozen=True)
class Topic:
    """A topic and its type, as rosbags writes it (`geometry_msgs/msg/Wrench`)."""

    name: str
    type: str

    def __str__(self) -> str:
        return f"{self.name} ({written(self.type)})"


@dataclass(frozen=True, eq=False)
class Bag:
    """An open bag: rosbags' `reader`, whether it is of ROS 1, and how many messages each topic has."""

    path: Path
    reader: Any
    ros1: bool
    counts: dict[Topic, int]

    @property
    def start(self) -> float:
        """The bag's own first stamp, s; 0 for a bag without messages."""
        return float(seconds(np.int64(self.reader.start_time))) if sum(self.counts.values()) else 0.0

    def connections(self, topics: tuple[Topic, ...]) -> list[Any]:
        """The connections of the topics, one a publisher."""
        return [c for c in self.reader.connections if Topic(c.topic, c.msgtype) in topics]


def seconds(ns: NDArray[np.int64] | np.int64) -> Array:
    """Stamps in ns as s, rounded as a header's seconds and nanoseconds are."""
    whole, rest = np.divmod(ns, 10**9)
    s: Array = whole + 1e-9 * rest
    return s


def is_bag(path: str | Path) -> bool:
    """Whether the name, or what is in the folder, is that of a bag."""
    path = Path(path)
    if path.is_dir():
        return any(file.name == METADATA or file.suffix in SUFFIXES_OF_BAGS for file in path.iterdir())
    return path.suffix.lower() in SUFFIXES_OF_BAGS


def written(msgtype: str) -> str:
    """A type as people write it: `geometry_msgs/Wrench`."""
    return msgtype.replace("/msg/", "/")


def kind_of(path: str | Path) -> str:
    """`.bag`, `.mcap`, `.db3`, or nothing for a folder. Raises `FileAccessError` and `FileFormatError` for others."""
    path = Path(path)
    if path.is_dir():
        if not (path / METADATA).exists():
            raise FileFormatError(
                f"{path}: found a folder without {METADATA}, expected a ROS 2 bag: name the .mcap or .db3 file in it"
            )
        return ""
    if not path.exists():
        raise FileAccessError(f"{path}: there is no such file, expected a readable file: check the path")
    suffix = path.suffix
    if suffix not in SUFFIXES_OF_BAGS:
        raise FileFormatError(
            f"{path}: found the suffix {suffix or '(none)'}, expected .bag, .mcap, .db3 or a folder with {METADATA}"
        )
    return suffix


@contextmanager
def opened_bag(path: str | Path) -> Iterator[Bag]:
    """An open bag, closed at the end. Raises `FileAccessError`, `MissingExtraError` without rosbags, and
    `FileFormatError` for what is no bag, or is one that is cut off or damaged, also while it is read.
    """
    path = Path(path)
    kind = kind_of(path)
    require_rosbags()
    _require_closed(path)
    from rosbags.rosbag2 import Reader

    with one_line_errors(path):
        reader = _reader_of_ros1(path) if kind == ".bag" else Reader(path)
        reader.open()
    try:
        with one_line_errors(path):
            bag = Bag(path, reader, kind == ".bag", _counts(reader, kind == ".bag"))
        if not bag.counts and reader.message_count:
            raise FileFormatError(
                f"{path}: found messages and no topics in its index, expected both: mend it with `mcap recover`"
            )
        yield bag
    finally:
        reader.close()


def require_rosbags() -> None:
    """Raise `MissingExtraError` without rosbags."""
    try:
        import rosbags.rosbag2  # noqa: F401
    except ImportError:
        raise MissingExtraError(
            "a ROS bag needs rosbags, which is not installed: pip install 'contactwrench[bags]'"
        ) from None


def definitions(bag: Bag, msgtype: str) -> Fields:
    """The definition of a type and of all types in it: the bag's own, else that of ROS. Raises `FileFormatError`."""
    from rosbags.interfaces import MessageDefinitionFormat
    from rosbags.typesys import TypesysError

    defined = [c.msgdef for c in bag.reader.connections if c.msgtype == msgtype and c.msgdef.data.strip()]
    if not defined:
        known = types_of_ros(bag.ros1)
        if msgtype not in known:
            raise FileFormatError(f"{bag.path}: found no definition of {written(msgtype)}, expected one in the bag")
        return known
    try:
        return _defined(msgtype, defined[0].data, defined[0].format == MessageDefinitionFormat.IDL, bag.ros1)
    except TypesysError as error:
        reason = " ".join(str(error).split())
        raise FileFormatError(
            f"{bag.path}: the definition of {written(msgtype)} cannot be understood ({reason}), expected that of ROS"
        ) from None


@lru_cache(64)
def _defined(msgtype: str, text: str, idl: bool, ros1: bool) -> Fields:
    from rosbags.typesys import get_types_from_idl, get_types_from_msg

    types = dict(types_of_ros(ros1))
    if not idl:
        types.update(get_types_from_msg(text, msgtype))
        return types
    for part in text.split("=" * 80 + "\n"):
        types.update(get_types_from_idl(part.partition("\n")[2] if part.startswith("IDL: ") else part))
    return types


@cache
def types_of_ros(ros1: bool) -> Fields:
    """The message types that come with ROS."""
    return dict(typestore(ros1).fielddefs)


@cache
def typestore(ros1: bool) -> Any:
    """A store by rosbags of the message types that come with ROS; to those of ROS 1, the transforms are added."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    if ros1:
        store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", "tf2_msgs/msg/TFMessage"))
    return store


@contextmanager
def one_line_errors(path: Path) -> Iterator[None]:
    """Whatever rosbags, and the libraries under it, raise for a file becomes `FileFormatError`."""
    try:
        yield
    except ContactWrenchError:
        raise
    except PermissionError as error:
        raise FileAccessError(
            f"{path}: cannot be read ({(error.strerror or str(error)).lower()}): check the path and its permissions"
        ) from None
    except Exception as error:
        reason = " ".join(str(error).split()).rstrip(".") or type(error).__name__
        kind = KINDS[path.suffix if path.is_file() else ""]
        raise FileFormatError(
            f"{path}: cannot be read as a {kind} ({reason}), expected a whole one: record or copy it again"
        ) from None


def _require_closed(path: Path) -> None:
    """Raise `FileFormatError` for sqlite3 of which the last part is in a file of its own: rosbags reads without it."""
    for file in sorted(path.glob("*.db3")) if path.is_dir() else [path]:
        rest = file.with_name(f"{file.name}-wal")
        if file.suffix == ".db3" and rest.exists() and rest.stat().st_size:
            raise FileFormatError(
                f"{file}: found {rest.name} with messages beside it, expected a recording that was closed: join them "
                f"with sqlite3 {file.name} 'PRAGMA wal_checkpoint(TRUNCATE)'"
            )


def _reader_of_ros1(path: Path) -> Any:
    """A reader by rosbags of ROS 1 bags without the index of each message."""
    from rosbags.rosbag1 import Reader

    class WithoutIndex(Reader):
        def read_index_data(self, pos: int, indexes: Any) -> None:
            """A chunk's messages are found in the chunk."""

    return WithoutIndex(path)


def _counts(reader: Any, ros1: bool) -> dict[Topic, int]:
    counts: dict[Topic, int] = {}
    for connection in reader.connections:
        topic = Topic(connection.topic, connection.msgtype)
        count = connection.msgcount
        if ros1:
            count = sum(info.connection_counts.get(connection.id, 0) for info in reader.chunk_infos)
        counts[topic] = counts.get(topic, 0) + count
    return dict(sorted(counts.items(), key=lambda item: item[0].name))
