"""A copy of a ROS bag with the contact wrench added to it as a topic.

Every message is read once and written again, and behind each reading its contact wrench. The mcap package writes MCAP,
with the time of publication and the number of each message; rosbags writes the others, which know neither.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from itertools import islice
from pathlib import Path
from typing import Any, TypeAlias, cast

import numpy as np

from ...errors import FileAccessError, FileFormatError, InputError
from ...files import identity, new_place
from ...geometry.arrays import Array
from ..tables.columns import Tell, unheard
from .chunks import Connection, Logged, Source, Topic
from .folder import METADATA, plain_yaml
from .mcap import Mcap
from .message_layout import typestore
from .messages import STAMP, by_layout
from .open import Bag, definitions, kind_of, logged_in, one_line_errors, opened_bag
from .topics import wrench_topic as chosen_topic
from .write import WRENCH_STAMPED, new_bag, stamped

CONTACT = "contact"
"""Under the wrench's own topic: the contact wrench."""

CONTACT_WRENCH = -1
"""In place of the number of a connection: that of the contact wrench."""

Record: TypeAlias = tuple[int, int, int, int, bytes]
"""A message to write: the number of its connection, its own there, when it was recorded and published, ns, payload."""


Copied: TypeAlias = "Iterator[tuple[Source, Iterator[Record]]]"
"""The files of a bag and what goes into the copy of each, to be taken before the next."""


def write_bag_with(
    path_in: str | Path,
    path_out: str | Path,
    wrenches: Iterable[Array],
    *,
    wrench_topic: str | None = None,
    topic: str | None = None,
    frame: str | None = None,
    accept_damaged: bool = False,
    note: Tell = unheard,
) -> str:
    """Copy a bag and add the contact wrench as a topic of `geometry_msgs/WrenchStamped`; its name is given back.

    Every other message keeps its payload, type, definition and time, in an MCAP with an index also its number and its
    time of publication; every topic its quality of service or latching; a compressed bag stays compressed. A contact
    wrench stands behind its reading, with its stamps, and its frame unless another `frame` is stated.

    The `wrenches` (m, 6), N and N m, come as a row, NaN too, for each message of the `wrench_topic` (None: the only
    one) in the order of `bag_batches`. Their `topic` is the wrench's own with `/contact` behind it where none is named.
    `note` is told, at the end, what of a damaged bag was left out.

    Raises as `bag_batches`; `FileAccessError` for an output that is the input, is there as a folder, or cannot be
    written; `FileFormatError` for one of another kind; `InputError` for a topic that is there, and too few or too many
    rows.
    """
    path_in, path_out = Path(path_in), Path(path_out)
    if identity(path_in) == identity(path_out):
        raise FileAccessError(f"{path_out}: found what is read as {path_in}, expected another file to write: name one")
    kind = kind_of(path_in)
    if path_out.suffix.lower() != kind:
        raise FileFormatError(
            f"{path_out}: found the suffix {path_out.suffix or '(none)'}, expected {kind or 'none, a folder,'} as of "
            f"{path_in}: a bag is copied to one of its kind"
        )
    with opened_bag(path_in, accept_damaged=accept_damaged) as bag:
        source = chosen_topic(bag, wrench_topic)
        name = f"{source.name}/{CONTACT}" if topic is None else topic
        if any(known.name == name for known in bag.counts):
            raise InputError(f"{path_in}: found a topic {name} already, expected another name for the contact wrench")
        copied = _copied(bag, source, wrenches, frame)
        if bag.mcap and not bag.compression:
            _copy_mcaps(bag, path_out, source, name, copied)
        else:
            _copy_by_rosbags(bag, path_out, kind, source, name, copied)
        if bag.damage.said:
            note("the copy lacks what is damaged; " * bool(bag.damage.first) + bag.damage.said)
    return name


def _copied(bag: Bag, topic: Topic, wrenches: Iterable[Array], frame: str | None) -> Copied:
    """The files of a bag with a contact wrench behind each reading of the topic."""
    rows = (row for part in wrenches for row in np.asarray(part, dtype=np.float64).reshape(-1, 6))
    count = 0

    def records(source: Source) -> Iterator[Record]:
        nonlocal count
        numbers = [number for number, connection in source.connections.items() if connection.topic == topic]
        for recorded in logged_in(bag, source, source.connections):
            logged, readings = recorded, np.flatnonzero(np.isin(recorded.log["connection"], numbers))
            if bag.damage.accepted and len(readings):
                whole = [rows for rows, *_ in by_layout(bag, topic, logged[readings])]
                damaged = np.delete(readings, np.concatenate([np.empty(0, np.intp), *whole]))
                logged = logged[np.delete(np.arange(len(logged)), damaged)]
                readings = np.flatnonzero(np.isin(logged.log["connection"], numbers))
            values = np.array(list(islice(rows, len(readings)))).reshape(-1, 6)
            if len(values) < len(readings):
                raise InputError(
                    f"{bag.path}: found {count + len(values)} contact wrenches, expected one for each reading"
                )
            payloads = _contact_messages(bag, topic, logged[readings], values, frame)
            payload_behind = dict(zip(readings.tolist(), payloads, strict=True))
            for row, (connection, sequence, stamp, published) in enumerate(logged.log.tolist()):
                yield connection, sequence, stamp, published, logged.raw.message(row)
                if row in payload_behind:
                    yield CONTACT_WRENCH, count, stamp, stamp, payload_behind[row]
                    count += 1

    for source in bag.sources:
        yield source, records(source)
    if next(rows, None) is not None:
        raise InputError(f"{bag.path}: found more than {count} contact wrenches, expected one for each reading")


def _contact_messages(bag: Bag, topic: Topic, logged: Logged, values: Array, frame: str | None) -> list[bytes]:
    """The contact wrenches (n, 6) of readings as messages with their stamps."""
    payloads = [b""] * len(logged)
    for rows, layout, raw in by_layout(bag, topic, logged):
        stamp = logged.stamp[rows]
        if f"header.{STAMP[0]}" in layout.numbers:
            sec, ns = raw.columns(layout, [f"header.{part}" for part in STAMP]).astype(np.int64).T
            stamp = np.where((sec >= 0) & (ns < 10**9), sec * 10**9 + ns, stamp)
        name = layout.texts.get("header.frame_id", "") if frame is None else frame
        made = stamped(bag.ros1, name, stamp, values[rows])
        for row, payload in zip(rows.tolist(), made, strict=True):
            payloads[row] = payload
    return payloads


def _copy_mcaps(bag: Bag, path_out: Path, topic: Topic, name: str, copied: Copied) -> None:
    """Copy one file, or those of a folder and what the folder says of them."""
    folder = bag.path.is_dir()
    with new_place(path_out) as made:
        if folder:
            made.mkdir()
        counts = {}
        for source, records in copied:
            mcap = cast(Mcap, source)
            target = made / mcap.path.name if folder else made
            counts[mcap.path.name] = _copy_mcap(mcap, target, records, topic, name)
        if folder:
            _write_metadata(bag, made, topic, name, counts)


def _copy_mcap(mcap: Mcap, path_out: Path, records: Iterator[Record], topic: Topic, name: str) -> Counter[str]:
    """Write a file's records into a new one, as they are; how many messages each topic has."""
    from mcap.records import Attachment, Metadata
    from mcap.writer import CompressionType, Writer

    with path_out.open("wb") as file:
        writer: Any = Writer(file, compression=CompressionType[mcap.compression.upper() or "NONE"])
        writer.start("ros2", mcap.header.library if mcap.header is not None else "")
        schemas = {0: 0}
        for number, schema in sorted(mcap.schemas.items()):
            schemas[number] = writer.register_schema(schema.name, schema.encoding, schema.data)
            if schema.name == WRENCH_STAMPED:
                schemas[CONTACT_WRENCH] = schemas[number]
        if CONTACT_WRENCH not in schemas:
            text, _ = typestore(False).generate_msgdef(WRENCH_STAMPED, ros_version=2)
            schemas[CONTACT_WRENCH] = writer.register_schema(WRENCH_STAMPED, "ros2msg", text.encode())
        channels, quality = {}, {}
        for number, channel in sorted(mcap.channels.items()):
            channels[number] = writer.register_channel(
                channel.topic, channel.message_encoding, schemas.get(channel.schema_id, 0), channel.metadata
            )
            if channel.topic == topic.name and topic.type == WRENCH_STAMPED:
                quality = channel.metadata
        channels[CONTACT_WRENCH] = writer.register_channel(name, "cdr", schemas[CONTACT_WRENCH], quality)
        for record in mcap.beside(Attachment):
            writer.add_attachment(record.create_time, record.log_time, record.name, record.media_type, record.data)
        for record in mcap.beside(Metadata):
            writer.add_metadata(record.name, record.metadata)
        topics, counts = {number: channel.topic for number, channel in mcap.channels.items()}, Counter[str]()
        topics[CONTACT_WRENCH] = name
        for connection, sequence, stamp, published, payload in records:
            writer.add_message(channels[connection], stamp, payload, published, sequence)
            counts[topics[connection]] += 1
        writer.finish()
    return counts


def _copy_by_rosbags(bag: Bag, path_out: Path, kind: str, topic: Topic, name: str, copied: Copied) -> None:
    """Write every message of a `.bag`, of sqlite3, or of MCAP files that are packed."""
    with new_bag(path_out, kind, mcap=bag.mcap, compression=bag.compression) as writer:
        made: dict[tuple[Topic, str], Any] = {}
        for connection in bag.connections:
            if _publisher(bag, connection) not in made:
                known = connection.topic
                details = _definition(bag, connection) | connection.details | _quality(bag, connection)
                made[_publisher(bag, connection)] = writer.add_connection(known.name, known.type, **details)
        like = next(connection for connection in bag.connections if connection.topic == topic)
        contact = writer.add_connection(name, WRENCH_STAMPED, typestore=typestore(bag.ros1), **_quality(bag, like))
        for source, records in copied:
            into = {number: made[_publisher(bag, each)] for number, each in source.connections.items()}
            into[CONTACT_WRENCH] = contact
            for number, _, stamp, _, payload in records:
                writer.write(into[number], stamp, payload)


def _publisher(bag: Bag, connection: Connection) -> tuple[Topic, str]:
    """In ROS 1 each of a topic is on its own; in ROS 2 they are one."""
    return connection.topic, repr(connection.details) if bag.ros1 else ""


def _quality(bag: Bag, connection: Connection) -> dict[str, Any]:
    """The quality of service of a topic in ROS 2, which its files have as text."""
    if bag.ros1:
        return {}
    from rosbags.rosbag2.metadata import parse_qos

    with one_line_errors(bag.path):
        return {"offered_qos_profiles": parse_qos(plain_yaml(connection.details["offered_qos_profiles"]))}


def _write_metadata(bag: Bag, path_out: Path, source: Topic, name: str, counts: dict[str, Counter[str]]) -> None:
    """What the folder says of its files, with one more topic, and how many messages were written."""
    from ruamel.yaml import YAML

    if not (bag.path / METADATA).is_file():
        raise InputError(f"{bag.path}: found no {METADATA}, expected it for a copy: write a table, .csv or .parquet")
    yaml = YAML(typ="safe")
    yaml.default_flow_style = False
    yaml.representer.ignore_aliases = lambda _: True
    content = plain_yaml((bag.path / METADATA).read_bytes())
    recording = content["rosbag2_bagfile_information"]
    topics = {each["topic_metadata"]["name"]: each["topic_metadata"] for each in recording["topics_with_message_count"]}
    for connection in bag.connections:  # of a damaged folder, all that was found
        topic = connection.topic
        topics.setdefault(topic.name, {"name": topic.name, "type": topic.type, **connection.details})
    topics[name] = {**topics[source.name], "name": name, "type": WRENCH_STAMPED}
    if "type_description_hash" in topics[name]:
        topics[name]["type_description_hash"] = typestore(False).hash_rihs01(WRENCH_STAMPED)
    every = sum(counts.values(), Counter[str]())
    recording["message_count"] = every.total()
    recording["topics_with_message_count"] = [
        {"topic_metadata": about, "message_count": every[each]} for each, about in topics.items()
    ]
    for file in recording.get("files", []):
        file["message_count"] = counts.get(Path(file.get("path", "")).name, Counter()).total()
    with (path_out / METADATA).open("w", encoding="utf-8") as written:
        yaml.dump(content, written)


def _definition(bag: Bag, connection: Connection) -> dict[str, Any]:
    """The definition and its hash: as they are, or computed; else those of ROS, or of a type without fields."""
    from rosbags.typesys import Stores, get_typestore

    text, digest, msgtype = connection.definition, connection.digest, connection.topic.type
    if bag.ros1:
        return {"msgdef": text, "md5sum": digest}
    if not (text and digest):
        store = get_typestore(Stores.EMPTY)
        try:
            store.register(definitions(bag, connection.topic))
        except FileFormatError:
            store.register({msgtype: ([], [])})
        text = text or store.generate_msgdef(msgtype, ros_version=2)[0]
        digest = digest or store.hash_rihs01(msgtype)
    return {"msgdef": text, "rihs01": digest}
