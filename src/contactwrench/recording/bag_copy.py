"""A copy of a ROS bag with the contact wrench added to it as a topic."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..errors import FileFormatError, InputError
from ..files import require_distinct
from ..orientation import Array
from .bag_chunks import Logged, messages_by
from .bag_files import Bag, Topic, definitions, kind_of, opened_bag, typestore
from .bag_messages import by_layout
from .bag_topics import wrench_topic as chosen_topic
from .bag_writing import STAMP, WRENCH_STAMPED, new_bag, stamped

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
) -> None:
    """Copy a bag and add the contact wrench: a topic of `geometry_msgs/WrenchStamped`, `topic` or the wrench's own with
    `/contact` behind it.

    `wrenches`: arrays (m, 6), N and N m, as they come, a row for each message of the wrench's topic in the order of
    `bag_batches`; a row of NaN is written as such. Each is written behind its message, with that message's stamps and
    frame, or `frame` where the wrench is given in other axes. Every other message keeps its payload, type, definition
    and the time at which it was recorded, every topic its quality of service or its latching; a compressed bag stays
    compressed. In an MCAP, rosbags gives a message the time of recording as its time of publication too.

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
        with new_bag(path_out, kind, mcap=_is_mcap(bag), compression=_compression(bag)) as writer:
            copies: dict[_Publisher, Any] = {}
            for connection in bag.reader.connections:
                publisher = _publisher(connection)
                copies[publisher] = copies.get(publisher) or _copied(bag, writer, connection)
            added = writer.add_connection(name, WRENCH_STAMPED, typestore=typestore(bag.ros1))
            for found in messages_by(bag, _publisher):
                stamp, which, row = _in_turn(found)
                publishers = list(found)
                contact = _contacts(bag, source, found, which, take, frame)
                for t, k, i in zip(stamp.tolist(), which.tolist(), row.tolist(), strict=True):
                    writer.write(copies[publishers[k]], t, found[publishers[k]].raw.message(i))
                    if k in contact:
                        writer.write(added, t, contact[k][i])
            take(None)


def _in_turn(found: dict[_Publisher, Logged]) -> tuple[Any, Any, Any]:
    """Of messages in the order in which they were recorded, the stamp, the publisher's number, and the row there."""
    which = np.repeat(np.arange(len(found)), [len(logged) for logged in found.values()])
    row = np.concatenate([np.arange(len(logged)) for logged in found.values()])
    stamp = np.concatenate([logged.stamp for logged in found.values()])
    place = np.concatenate([logged.raw.start for logged in found.values()])
    order = np.lexsort((place, stamp))
    return stamp[order], which[order], row[order]


def _contacts(
    bag: Bag,
    source: Topic,
    found: dict[_Publisher, Logged],
    which: Any,
    take: Callable[[int | None], Array],
    frame: str | None,
) -> dict[int, list[bytes]]:
    """The contact wrench's messages for each publisher of the wrench, by the publisher's number, in its order."""
    of_source = [k for k, publisher in enumerate(found) if publisher[:2] == (source.name, source.type)]
    in_turn = which[np.isin(which, of_source)]
    values = take(len(in_turn))
    contacts = {}
    for k in of_source:
        logged = list(found.values())[k]
        messages = [b""] * len(logged)
        for rows, layout, raw in by_layout(bag, source, logged):
            stamp = logged.stamp[rows]
            if STAMP[0] in layout.numbers:
                sec, ns = (raw.values(layout, path)[:, 0].astype(np.int64) for path in STAMP)
                stamp = sec * 10**9 + ns
            name = layout.texts.get("header.frame_id", "") if frame is None else frame
            made = stamped(WRENCH_STAMPED, bag.ros1, name, stamp, values[in_turn == k][rows])
            for i, message in zip(rows.tolist(), made, strict=True):
                messages[i] = message
        contacts[k] = messages
    return contacts


def _taking(arrays: Iterable[Array], path: Path) -> Callable[[int | None], Array]:
    """A function that takes the next so many rows (count, 6) of arrays, as they come, and None: there must be no more.

    It raises `InputError` where there are too few or too many.
    """
    coming = iter(arrays)
    left, taken = np.empty((0, 6)), 0

    def take(count: int | None) -> Array:
        nonlocal left, taken
        parts, have = [left], len(left)
        while count is None or have < count:
            part = next(coming, None)
            if part is None:
                break
            parts.append(np.asarray(part, dtype=np.float64).reshape(-1, 6))
            have += len(parts[-1])
            if count is None and have:
                break
        if have < (count or 0) or (count is None and have):
            found = f"more than {taken}" if count is None else str(taken + have)
            raise InputError(f"{path}: found {found} contact wrenches, expected one for each reading")
        rows = np.concatenate(parts)
        count = count or 0
        left, taken = rows[count:], taken + count
        return rows[:count]

    return take


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
