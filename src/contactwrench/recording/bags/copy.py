"""A copy of a ROS bag with the contact wrench added to it as a topic."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...errors import FileFormatError, InputError
from ...files import require_distinct
from ...geometry.arrays import Array
from .chunks import Logged, messages, messages_by
from .mcap_copy import NewTopic, Until, copy_mcap
from .messages import by_layout
from .open import METADATA, Bag, Topic, definitions, kind_of, opened_bag, typestore
from .topics import wrench_topic as chosen_topic
from .write import STAMP, WRENCH_STAMPED, new_bag, new_place, stamped

CONTACT = "contact"
"""Under the wrench's own topic: the contact wrench."""


class _Publisher(NamedTuple):
    """What tells one connection of a bag from another: `details` are its quality of service, or who it is of."""

    topic: str
    type: str
    details: str


def write_bag_with(
    path_in: str | Path,
    path_out: str | Path,
    wrenches: Iterable[Array],
    *,
    wrench_topic: str | None = None,
    topic: str | None = None,
    frame: str | None = None,
) -> str:
    """Copy a bag and add the contact wrench: a topic of `geometry_msgs/WrenchStamped`, `topic` or the wrench's own with
    `/contact` behind it; its name.

    `wrenches`: arrays (m, 6), N and N m, as they come, a row for each message of the wrench's topic in the order of
    `bag_batches`; a row of NaN is written as such. Each is written behind its message, with that message's stamps and
    frame, or `frame` where the wrench is given in other axes. Every other message keeps its payload, type, definition
    and the time at which it was recorded, every topic its quality of service or its latching; a compressed bag stays
    compressed. Records of an MCAP with chunks are copied as they are, down to their times of publication.

    Raises `FileAccessError` where output is input, or is a folder that is there; `FileFormatError` as `bag_batches`,
    and for an output of another kind; `InputError` for a topic that is there and for too few or too many rows.
    """
    path_in, path_out = Path(path_in), Path(path_out)
    require_distinct(path_out, {"recording that is read": path_in})
    kind = kind_of(path_in)
    if path_out.suffix != kind:
        raise FileFormatError(
            f"{path_out}: found the suffix {path_out.suffix or '(none)'}, expected {kind or 'none, a folder,'} as of "
            f"{path_in}: a bag is copied to one of its kind"
        )
    with opened_bag(path_in) as bag:
        source = chosen_topic(bag, wrench_topic)
        name = f"{source.name}/{CONTACT}" if topic is None else topic
        if any(known.name == name for known in bag.counts):
            raise InputError(f"{path_in}: found a topic {name} already, expected another name for the contact wrench")
        take = _taking(wrenches, path_in)
        until = _until(_contact_messages(bag, source, take, frame))
        if kind != ".bag" and (parts := _whole_mcaps(bag)):
            _copy_mcaps(bag, parts, path_out, not kind, source, name, until)
        else:
            _copy_by_rosbags(bag, path_out, kind, source, name, until)
    return name


def _copy_by_rosbags(bag: Bag, path_out: Path, kind: str, source: Topic, name: str, until: Until) -> None:
    """Read every message and write it again."""
    with new_bag(path_out, kind, mcap=_is_mcap(bag), compression=_compression(bag)) as writer:
        copies: dict[_Publisher, Any] = {}
        for connection in bag.reader.connections:
            publisher = _publisher(connection)
            copies[publisher] = copies.get(publisher) or _copied(bag, writer, connection)
        quality = {} if bag.ros1 else {"offered_qos_profiles": bag.connections((source,))[0].ext.offered_qos_profiles}
        added = writer.add_connection(name, WRENCH_STAMPED, typestore=typestore(bag.ros1), **quality)

        for found in messages_by(bag, _publisher):
            publishers, old = list(found), _in_turn(found)
            stamps, payloads = until(old[-1][0])
            place = np.searchsorted([t for t, _, _ in old], stamps, side="right")
            for index in np.argsort(np.r_[np.arange(len(old)) + 0.5, place], kind="stable").tolist():
                if index < len(old):
                    t, k, row = old[index]
                    writer.write(copies[publishers[k]], t, found[publishers[k]].raw.message(row))
                else:
                    writer.write(added, int(stamps[index - len(old)]), payloads[index - len(old)])
        until(np.iinfo(np.int64).max)  # no row may be left


def _in_turn(found: dict[_Publisher, Logged]) -> list[tuple[int, int, int]]:
    """Stamp, publisher's number, and row there, of messages in the order in which they were recorded."""
    which = np.repeat(np.arange(len(found)), [len(logged) for logged in found.values()])
    row = np.concatenate([np.arange(len(logged)) for logged in found.values()])
    stamp = np.concatenate([logged.stamp for logged in found.values()])
    place = np.concatenate([logged.raw.start for logged in found.values()])
    order = np.lexsort((place, stamp))
    return list(zip(stamp[order].tolist(), which[order].tolist(), row[order].tolist(), strict=True))


def _contact_messages(
    bag: Bag, source: Topic, take: Callable[[int | None], Array], frame: str | None
) -> Iterator[tuple[NDArray[np.int64], list[bytes]]]:
    """The contact wrench for each message of the source: the bag's stamps, in order, and payloads, some at a time."""
    for found in messages(bag, (source,)):
        logged = found[source]
        values, payloads = take(len(logged)), [b""] * len(logged)
        for rows, layout, raw in by_layout(bag, source, logged):
            stamp = logged.stamp[rows]
            if STAMP[0] in layout.numbers:
                sec, ns = (raw.values(layout, path)[:, 0].astype(np.int64) for path in STAMP)
                stamp = sec * 10**9 + ns
            name = layout.texts.get("header.frame_id", "") if frame is None else frame
            made = stamped(WRENCH_STAMPED, bag.ros1, name, stamp, values[rows])
            for row, payload in zip(rows.tolist(), made, strict=True):
                payloads[row] = payload
        yield logged.stamp, payloads
    take(None)


def _until(coming: Iterator[tuple[NDArray[np.int64], list[bytes]]]) -> Until:
    """A function that gives what is coming up to a stamp."""
    stamps: NDArray[np.int64] = np.empty(0, np.int64)
    payloads: list[bytes] = []

    def until(stamp: int) -> tuple[NDArray[np.int64], list[bytes]]:
        nonlocal stamps, payloads
        while not len(stamps) or stamps[-1] <= stamp:
            part = next(coming, None)
            if part is None:
                break
            stamps, payloads = np.concatenate([stamps, part[0]]), payloads + part[1]
        count = int(np.searchsorted(stamps, stamp, side="right"))
        given = stamps[:count], payloads[:count]
        stamps, payloads = stamps[count:], payloads[count:]
        return given

    return until


def _taking(arrays: Iterable[Array], path: Path) -> Callable[[int | None], Array]:
    """A function that takes the next so many rows (count, 6) of arrays, as they come, and None: there must be no more.

    It raises `InputError` where there are too few or too many.
    """
    coming = iter(arrays)
    left, taken = np.empty((0, 6)), 0

    def take(count: int | None) -> Array:
        nonlocal left, taken
        parts, have = [left], len(left)
        while have < (1 if count is None else count):
            part = next(coming, None)
            if part is None:
                break
            parts.append(np.asarray(part, dtype=np.float64).reshape(-1, 6))
            have += len(parts[-1])
        if have < (count or 0) or (count is None and have):
            found = f"more than {taken}" if count is None else str(taken + have)
            raise InputError(f"{path}: found {found} contact wrenches, expected one for each reading")
        rows = np.concatenate(parts)
        count = count or 0
        left, taken = rows[count:], taken + count
        return rows[:count]

    return take


def _whole_mcaps(bag: Bag) -> list[Any]:
    """The MCAP files of a bag, where records can be copied as they are: with chunks, an index and no compression of the
    folder's own.
    """
    storage = bag.reader.storage
    parts = getattr(storage, "storages", [storage])
    plain = not getattr(storage.metadata, "compression_mode", None)
    return list(parts) if plain and all(getattr(part, "chunks", ()) for part in parts) else []


def _copy_mcaps(
    bag: Bag, parts: list[Any], path_out: Path, folder: bool, source: Topic, name: str, until: Until
) -> None:
    """Copy the records of one file, or of a folder's, and what the folder says of them."""
    text, _ = typestore(False).generate_msgdef(WRENCH_STAMPED, ros_version=2)
    same = [
        c.metadata
        for part in parts
        for c in part.channels.values()
        if (c.topic, c.schema) == (source.name, WRENCH_STAMPED)
    ]
    topic = NewTopic(name, WRENCH_STAMPED, text, same[0] if same else b"")
    with new_place(path_out) as made:
        if not folder:
            copy_mcap(parts[0], made, topic, until, True)
            return
        made.mkdir()
        counts = {}
        for part in parts:
            counts[part.path.name] = copy_mcap(part, made / part.path.name, topic, until, part is parts[-1])
        _write_metadata(bag.path, made, source, topic, counts)


def _write_metadata(path_in: Path, path_out: Path, source: Topic, topic: NewTopic, counts: dict[str, int]) -> None:
    """What the folder says of its files, and of one more topic."""
    from ruamel.yaml import YAML

    yaml = YAML(typ="safe")
    yaml.default_flow_style = False
    content = yaml.load((path_in / METADATA).read_text(encoding="utf-8"))
    said = content["rosbag2_bagfile_information"]
    count = sum(counts.values())
    said["message_count"] += count
    like = [
        one["topic_metadata"]
        for one in said["topics_with_message_count"]
        if one["topic_metadata"]["name"] == source.name
    ]
    mine = {**like[0], "name": topic.name, "type": topic.type}
    if "type_description_hash" in mine:
        mine["type_description_hash"] = typestore(False).hash_rihs01(topic.type)
    said["topics_with_message_count"].append({"topic_metadata": mine, "message_count": count})
    for file in said.get("files", []):
        file["message_count"] += counts.get(Path(file["path"]).name, 0)
    with (path_out / METADATA).open("w", encoding="utf-8") as written:
        yaml.dump(content, written)


def _publisher(connection: Any) -> _Publisher:
    return _Publisher(connection.topic, connection.msgtype, repr(connection.ext))


def _copied(bag: Bag, writer: Any, connection: Any) -> Any:
    """The connection in the new bag. A type whose definition no one knows stays without."""
    if bag.ros1:
        return writer.add_connection(
            connection.topic,
            connection.msgtype,
            msgdef=connection.msgdef.data,
            md5sum=connection.digest,
            callerid=connection.ext.callerid,
            latching=connection.ext.latching,
        )
    return writer.add_connection(
        connection.topic,
        connection.msgtype,
        **_definition(bag, connection),
        serialization_format=connection.ext.serialization_format,
        offered_qos_profiles=connection.ext.offered_qos_profiles,
    )


def _definition(bag: Bag, connection: Any) -> dict[str, Any]:
    """The definition and its hash: as they are, computed where the hash is not written, those of ROS where there is no
    definition, and else those of a type without fields.
    """
    from rosbags.typesys import Stores, get_typestore

    text = connection.msgdef.data
    if text and connection.digest:
        return {"msgdef": text, "rihs01": connection.digest}
    store = get_typestore(Stores.EMPTY)
    try:
        store.register(definitions(bag, connection.msgtype))
    except FileFormatError:
        store.register({connection.msgtype: ([], [])})
    made, _ = store.generate_msgdef(connection.msgtype, ros_version=2)
    return {"msgdef": text or made, "rihs01": connection.digest or store.hash_rihs01(connection.msgtype)}


def _is_mcap(bag: Bag) -> bool:
    storage = None if bag.ros1 else bag.reader.storage
    parts = getattr(storage, "storages", [storage])
    return any(hasattr(part, "chunks") for part in parts)


def _compression(bag: Bag) -> str:
    """How the bag is compressed, in the words of `new_bag`; an MCAP whose chunks are has them compressed with zstd."""
    from rosbags.rosbag1.reader import decompressors

    if bag.ros1:
        used = {
            name
            for chunk in bag.reader.chunks.values()
            for name, way in decompressors.items()
            if way is chunk.decompressor
        }
        return next((name for name in ("lz4", "bz2") if name in used), "")
    storage = bag.reader.storage
    if mode := getattr(storage.metadata, "compression_mode", None):
        return str(mode)
    parts = getattr(storage, "storages", [storage])
    return "storage" if any(chunk.compression for part in parts for chunk in getattr(part, "chunks", ())) else ""
