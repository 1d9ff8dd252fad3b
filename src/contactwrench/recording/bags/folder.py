"""A ROS 2 folder: what `metadata.yaml` says of its files, and these unpacked where they, or their messages, are."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator, Sequence, Set
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path, PurePath
from typing import Any

from ...errors import FileFormatError
from ...files import by_numbers, entries
from ...statistics import counted
from .chunks import ZSTD, Damage, Logged, Source
from .message_layout import joined, written

METADATA = "metadata.yaml"
"""Makes a folder a ROS 2 bag."""
VERSION, VERSION_OF_NAMES = 9, 4
"""The last that is known, and the first in which files are named without the folder before."""
LONGEST_YAML = 2**22
MOST_UNPACKED = 200
"""Bytes for one that is packed: measurements pack to a half or a tenth."""
AT_ONCE = 2**20


@dataclass
class _Topic:
    name: str
    type: str = ""


@dataclass
class _TopicCount:
    topic_metadata: _Topic
    message_count: int


@dataclass
class _File:
    message_count: int


@dataclass
class Metadata:
    """What is read of the description, as rosbag2 names it."""

    version: int
    storage_identifier: str
    relative_file_paths: list[str]
    message_count: int
    topics_with_message_count: list[_TopicCount]
    compression_format: str | None = None
    compression_mode: str | None = None
    files: list[_File] = field(default_factory=list)

    @property
    def packed(self) -> str:
        """What is compressed: `file`, `message`, or nothing."""
        return (self.compression_mode or "").lower().removeprefix("none")


@dataclass
class _Content:
    rosbag2_bagfile_information: Metadata


def metadata(folder: Path) -> Metadata:
    """The description of a folder. Raises `ValueError` and what msgspec and the parser raise for what is none."""
    from msgspec import convert

    with (folder / METADATA).open("rb") as file:
        said = convert(plain_yaml(file.read(LONGEST_YAML + 1)), _Content).rosbag2_bagfile_information
    if said.version > VERSION:
        raise ValueError(f"{METADATA} of version {said.version}, known is {VERSION}")
    if said.storage_identifier not in ("sqlite3", "mcap"):
        raise ValueError(f"storage {said.storage_identifier!r}, known are sqlite3 and mcap")
    if said.packed and (said.packed not in ("file", "message") or said.compression_format != "zstd"):
        raise ValueError(f"compression {said.packed} {said.compression_format}, known is zstd of files or messages")
    return said


def plain_yaml(content: bytes | str) -> Any:
    """YAML without aliases, which let a short text stand for any length. Raises `ValueError`, or as the parser."""
    from ruamel.yaml import YAML, AliasEvent
    from ruamel.yaml.error import MarkedYAMLError

    if len(content) > LONGEST_YAML:
        raise ValueError(f"more than {LONGEST_YAML} bytes of YAML")
    text = content if isinstance(content, str) else content.decode()
    try:
        if "*" in text and any(isinstance(event, AliasEvent) for event in YAML(typ="safe").parse(text)):
            raise ValueError("YAML with an alias, *")
        return YAML(typ="safe").load(text)
    except MarkedYAMLError as error:
        raise ValueError(f"line {error.problem_mark.line + 1}: {error.problem}") from None


def files_of(folder: Path, said: Metadata) -> list[Path]:
    """The files of a folder in their order. Raises `FileFormatError` for one that is elsewhere, twice or not there."""
    files: list[Path] = []
    for named in said.relative_file_paths:
        *above, name = PurePath(named).parts or ("",)
        file = folder / name
        is_old = said.version < VERSION_OF_NAMES and len(above) == 1 and above[0] not in ("..", os.sep)
        if above and not is_old:
            raise FileFormatError(f"{folder}: found {named} in {METADATA}, expected files in it: name that file")
        if file in files:
            raise FileFormatError(f"{folder}: found {named} twice in {METADATA}, expected it once: take the second out")
        if not os.path.isfile(file):
            raise FileFormatError(f"{folder}: found no {named}, expected it, as {METADATA} says: copy the folder whole")
        files.append(file)
    return files


def bags_in(folder: Path) -> list[Path]:
    """The files of messages in a folder, split ones in the order of their numbers."""
    files = [file for file in entries(folder) if file.suffix in (".mcap", ".db3") and not file.name.startswith(".")]
    return sorted(files, key=lambda file: by_numbers(file.stem))


def left_in(folder: Path, damage: Damage) -> list[Path]:
    """The files of a folder that nothing describes, as its recorder was killed: damage. They must be of one kind."""
    files = bags_in(folder)
    if len({file.suffix for file in files}) > 1:
        raise FileFormatError(f"{folder}: found .mcap and .db3 files and no {METADATA}, expected one bag: name a file")
    damage.found(f"{counted(len(files), 'file')} and no {METADATA}", "it, written as a recording ends")
    return files


def hold(said: Metadata, files: Sequence[Path], sources: Sequence[Source], damage: Damage) -> None:
    """Hold what a folder says of its messages against its files."""
    stated, found = Counter({"messages": said.message_count}), Counter({"messages": 0})
    types: dict[str, list[str]] = {}
    for one in said.topics_with_message_count:
        stated[f"messages of {one.topic_metadata.name}"] += one.message_count
        types.setdefault(one.topic_metadata.name, []).append(written(one.topic_metadata.type))
    for source in sources:
        for number, connection in source.connections.items():
            topic, count = connection.topic, source.counts.get(number, 0)
            found["messages"] += count
            found[f"messages of {topic.name}"] += count
            if any(others := types.get(topic.name, [])) and written(topic.type) not in others:
                damage.found(f"topic {topic}", f"{others[0]} as in {METADATA}")
    if said.files:
        stated["files"], found["files"] = len(said.files), len(files)
        for file, source, of_file in zip(files, sources, said.files, strict=False):
            stated[f"messages in {file.name}"] = of_file.message_count
            found[f"messages in {file.name}"] = sum(source.counts.get(number, 0) for number in source.connections)
    for other in sorted(entries(files[0].parent)) if files else ():
        if other.suffix == files[0].suffix and other not in files and not other.name.startswith("."):
            damage.found(f"{other.name}, which {METADATA} does not name", "the files that it names and no other")
    for what in stated | found:
        if stated[what] != found[what]:
            damage.found(f"{found[what]} {what}", f"{stated[what]} as in {METADATA}")


def unpacked(file: Path, into: Path) -> Path:
    """A packed file, unpacked into a folder. Raises `ValueError` for one that is much larger than measurements are."""
    target, left = into / file.stem, MOST_UNPACKED * file.stat().st_size
    with import_module(ZSTD).open(file, "rb") as packed, target.open("wb") as written:
        while some := packed.read(AT_ONCE):
            left -= written.write(some)
            if left < 0:
                raise ValueError(f"{file.name} unpacks to more than {MOST_UNPACKED} times its size")
    return target


class PackedMessages:
    """The messages of a file in which each is packed by itself."""

    def __init__(self, source: Source, file: Path) -> None:
        self.connections, self.counts, self.span = source.connections, source.counts, source.span
        self._source, self._most = source, MOST_UNPACKED * file.stat().st_size

    def logged(self, numbers: Set[int]) -> Iterator[Logged]:
        """As of `Source`. Raises `ValueError` as `unpacked`."""
        left, zstd = self._most, import_module(ZSTD)
        for some in self._source.logged(numbers):
            payloads = []
            for row in range(len(some)):
                one = zstd.ZstdDecompressor()
                payloads.append(one.decompress(some.raw.message(row), max_length=left + 1))
                left -= len(payloads[-1])
                if left < 0:
                    raise ValueError(f"its messages unpack to more than {MOST_UNPACKED} times its size")
                if not one.eof or one.unused_data:
                    raise ValueError("a packed message that is cut off")
            yield Logged(some.log, joined(payloads))
