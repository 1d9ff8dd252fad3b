"""Bags written: streams come back as they were, and a copy keeps every other message byte for byte."""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import Reader, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2

from contactwrench.errors import ContactWrenchError, FileAccessError
from contactwrench.recording.bags.copy import write_bag_with
from contactwrench.recording.bags.read import bag_batches
from contactwrench.recording.bags.write import write_streams_bag
from contactwrench.samples.samples import OrientationStream, Streams, WrenchStream
from tests.support.bags import (
    KINDS,
    ROS1,
    ROS2,
    START,
    STRING,
    TF,
    WRENCH,
    WRENCH_STAMPED,
    Message,
    any_rotations,
    bag_streams,
    ns,
    pose_stamped,
    recording,
    serialized,
    tf,
    transform,
    wrench_fields,
    wrench_stamped,
    write_bag,
    write_mcap,
)
from tests.support.world import Array


def _content(path: Path) -> dict[str, list[tuple[int, str, bytes]]]:
    """Stamp, type and payload of every message by its topic, as rosbags reads them."""
    found: dict[str, list[tuple[int, str, bytes]]] = {}
    with AnyReader([path]) as reader:
        for connection in reader.connections:
            found.setdefault(connection.topic, [])
        for connection, stamp, data in reader.messages():
            found[connection.topic].append((stamp, connection.msgtype, bytes(data)))
    return found


def _decoded(path: Path, topic: str) -> list[Any]:
    with AnyReader([path]) as reader:
        some = [c for c in reader.connections if c.topic == topic]
        return [reader.deserialize(data, c.msgtype) for c, _, data in reader.messages(connections=some)]


def _rich() -> tuple[list[Message], Array]:
    """Readings in two frames among transforms and texts, no two put into the bag at the same ns."""
    messages, wrench, _, _ = recording(120)
    every: list[Message] = [tf(0.0, [transform(0.0, "a", "b", np.eye(3), np.ones(3))], topic="/tf_static")]
    for k, one in enumerate(messages):
        renamed = {"header": one.fields["header"] | {"frame_id": "another_sensor"}}
        every.append(replace(one, fields=one.fields | renamed) if one.type == WRENCH_STAMPED and k > 60 else one)
        if k % 7 == 0:
            every.append(Message("/rosout", STRING, one.stamp, {"data": "x" * k}))
    return [replace(one, stamp=one.stamp + k) for k, one in enumerate(every)], wrench


def _read_twice(path: Path, size: int) -> Iterator[Array]:
    """What a compensation gives: batches of another size than the copy's."""
    for part in bag_batches(path):
        for start in range(0, len(part.wrench), size):
            yield 2.0 * part.wrench.wrench[start : start + size] + 1.0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "compression"),
    [
        *((kind, "") for kind in KINDS),
        (".bag", "bz2"),
        (".bag", "lz4"),
        *(("", c) for c in ("storage", "message", "file")),
    ],
)
def test_a_copy_has_the_contact_wrench_and_all_else_as_it_was(tmp_path: Path, kind: str, compression: str) -> None:
    messages, wrench = _rich()
    path = write_bag(tmp_path / f"run{kind}", messages, {"/never": TF}, compression=compression)
    out = tmp_path / f"out{kind}"
    write_bag_with(path, out, _read_twice(path, 17))
    before, after = _content(path), _content(out)
    added = after.pop("/wrench/contact")
    assert after == before
    assert [stamp for stamp, _, _ in added] == [stamp for stamp, _, _ in before["/wrench"]]
    read, given = _decoded(out, "/wrench/contact"), _decoded(path, "/wrench")
    assert len(read) == 120
    for one, of, expected in zip(read, given, 2.0 * wrench + 1.0, strict=True):
        assert (one.header.stamp, one.header.frame_id) == (of.header.stamp, of.header.frame_id)
        force, torque = one.wrench.force, one.wrench.torque
        assert [force.x, force.y, force.z, torque.x, torque.y, torque.z] == expected.tolist()
    np.testing.assert_array_equal(bag_streams(out, wrench_topic="/wrench/contact").wrench.wrench, 2.0 * wrench + 1.0)
    assert sorted(item.name for item in tmp_path.iterdir()) == sorted([path.name, out.name])


@pytest.mark.parametrize("kind", [".bag", ".mcap"])
def test_the_contact_wrench_is_recorded_behind_its_reading(tmp_path: Path, kind: str) -> None:
    messages, _ = _rich()
    path, out = write_bag(tmp_path / f"run{kind}", messages), tmp_path / f"out{kind}"
    write_bag_with(path, out, _read_twice(path, 1000))
    with AnyReader([out]) as reader:
        order = [connection.topic for connection, _, _ in reader.messages()]
    assert [topic for topic in order if topic != "/wrench/contact"] == [one.topic for one in messages]
    places = [k for k, topic in enumerate(order) if topic == "/wrench/contact"]
    assert [order[k - 1] for k in places] == ["/wrench"] * 120


def test_readings_without_header_get_one(tmp_path: Path) -> None:
    messages = [Message("/ft/raw", WRENCH, ns(0.1 * k), wrench_fields(np.full(6, k))) for k in range(3)]
    path = write_bag(tmp_path / "run.bag", [*messages, pose_stamped(0.0, np.eye(3), np.zeros(3))])
    out = tmp_path / "out.bag"
    write_bag_with(path, out, [np.ones((2, 6)), np.full((1, 6), np.nan)], topic="/contact", frame="flange")
    read = _decoded(out, "/contact")
    assert [one.header.frame_id for one in read] == ["flange"] * 3
    assert [one.header.stamp.sec * 10**9 + one.header.stamp.nanosec for one in read] == [one.stamp for one in messages]
    assert [one.wrench.force.x for one in read[:2]] == [1.0, 1.0]
    assert np.isnan(read[2].wrench.torque.z)


def test_who_latches_and_who_publishes_stays(tmp_path: Path) -> None:
    path, out = tmp_path / "run.bag", tmp_path / "out.bag"
    reading, text = wrench_stamped(0.0, np.ones(6)), Message("/t", STRING, ns(0.0), {"data": "a"})
    with Writer1(path) as writer:
        first = writer.add_connection("/wrench", WRENCH_STAMPED, typestore=ROS1, callerid="/driver", latching=0)
        texts = [
            writer.add_connection("/t", STRING, typestore=ROS1, callerid=f"/node{k}", latching=k) for k in range(2)
        ]
        writer.write(first, ns(0.0), serialized(reading, ros1=True))
        for k, one in enumerate(texts):
            writer.write(one, ns(0.1 * k), serialized(text, ros1=True))
    write_bag_with(path, out, [np.zeros((1, 6))])
    with AnyReader([path]) as old, AnyReader([out]) as new:
        before = {(c.topic, c.ext, c.msgdef, c.digest, c.msgcount) for c in old.connections}
        after = {(c.topic, c.ext, c.msgdef, c.digest, c.msgcount) for c in new.connections}
    assert before < after
    assert len(after) == 4


@pytest.mark.parametrize("storage", [StoragePlugin.SQLITE3, StoragePlugin.MCAP])
def test_the_quality_of_service_stays(tmp_path: Path, storage: StoragePlugin) -> None:
    qos = Qos(
        QosHistory.KEEP_LAST, 7, QosReliability.BEST_EFFORT, QosDurability.TRANSIENT_LOCAL, QosTime(1, 2),
        QosTime(3, 4), QosLiveliness.AUTOMATIC, QosTime(5, 6), False,
    )  # fmt: skip
    path, out = tmp_path / "run", tmp_path / "out"
    with Writer2(path, version=9, storage_plugin=storage) as writer:
        for message in (wrench_stamped(0.0, np.ones(6)), pose_stamped(0.0, np.eye(3), np.zeros(3))):
            connection = writer.add_connection(message.topic, message.type, typestore=ROS2, offered_qos_profiles=[qos])
            writer.write(connection, message.stamp, serialized(message))
    write_bag_with(path, out, [np.zeros((1, 6))])
    with Reader(out) as reader:
        kept = {c.topic: c.ext[1] for c in reader.connections}
    assert kept == {"/wrench": [qos], "/pose": [qos], "/wrench/contact": [qos]}


def test_types_without_definition_are_copied(tmp_path: Path) -> None:
    """ROS 2 Humble writes sqlite3 without definitions: of a type of one's own nothing is known but its bytes."""
    import sqlite3
    from contextlib import closing

    messages, _ = _rich()
    path, out = write_bag(tmp_path / "run.db3", messages), tmp_path / "out.db3"
    with closing(sqlite3.connect(path)) as base:
        base.executescript(
            "DROP TABLE message_definitions; UPDATE schema SET schema_version = 3;"
            "UPDATE topics SET type = 'my_msgs/msg/Mine' WHERE name = '/rosout';"
        )
    write_bag_with(path, out, _read_twice(path, 50))
    after = _content(out)
    assert {kind for _, kind, _ in after["/rosout"]} == {"my_msgs/msg/Mine"}
    assert [data for _, _, data in after["/rosout"]] == [serialized(m) for m in messages if m.topic == "/rosout"]
    assert len(bag_streams(out, wrench_topic="/wrench/contact").wrench) == 120


@pytest.mark.parametrize("compression", ["NONE", "LZ4", "ZSTD"])
def test_an_mcap_of_the_mcap_package_is_copied_record_by_record(tmp_path: Path, compression: str) -> None:
    """Times of publication and sequence numbers too; the file is in order for those who read it from front to back."""
    from mcap.reader import NonSeekingReader, make_reader
    from mcap.writer import CompressionType

    messages, _ = _rich()
    path, out = (
        write_mcap(tmp_path / "run.mcap", messages, chunk_size=3000, compression=CompressionType[compression]),
        tmp_path / "out.mcap",
    )
    write_bag_with(path, out, _read_twice(path, 13))

    def read(file: Path, **how: Any) -> list[Any]:
        with file.open("rb") as stream:
            return [
                (schema, channel, message) for schema, channel, message in make_reader(stream, **how).iter_messages()
            ]

    for how in ({"validate_crcs": True}, {}):  # type: dict[str, bool]
        copied = read(out, **how)
        assert [one for one in copied if one[1].topic != "/wrench/contact"] == read(path, **how)
        assert len(copied) == len(messages) + 120
    with out.open("rb") as stream:
        as_written = [
            message.log_time for _, _, message in NonSeekingReader(stream).iter_messages(log_time_order=False)
        ]
    assert as_written == sorted(as_written)
    with out.open("rb") as stream, path.open("rb") as before:
        summaries: list[Any] = [make_reader(one).get_summary() for one in (stream, before)]
    statistics, old = (summary.statistics for summary in summaries)
    assert statistics.message_count == old.message_count + 120
    assert statistics.channel_count == old.channel_count + 1
    assert (statistics.message_start_time, statistics.message_end_time) == (
        old.message_start_time,
        old.message_end_time,
    )


def test_attachments_metadata_and_channels_without_messages_of_an_mcap_stay(tmp_path: Path) -> None:
    from mcap.reader import make_reader
    from mcap.writer import Writer

    path, out = tmp_path / "run.mcap", tmp_path / "out.mcap"
    text, _ = ROS2.generate_msgdef(WRENCH_STAMPED, ros_version=2)
    with path.open("wb") as file:
        writer: Any = Writer(file)
        writer.start(profile="ros2", library="a recorder")
        schema = writer.register_schema(WRENCH_STAMPED, "ros2msg", text.encode())
        quality = {"offered_qos_profiles": "", "mine": "yes"}
        channels = [writer.register_channel(name, "cdr", schema, quality) for name in ("/wrench", "/never")]
        writer.add_attachment(3, 4, "photo.jpg", "image/jpeg", b"a photo")
        writer.add_metadata("robot", {"name": "left", "cell": "7"})
        for k in range(3):
            writer.add_message(channels[0], ns(k), serialized(wrench_stamped(k, np.ones(6))), ns(k) - 9, 40 + k)
        writer.finish()
    write_bag_with(path, out, [np.zeros((3, 6))])

    def around(file: Path) -> list[Any]:
        with file.open("rb") as stream:
            reader = make_reader(stream)
            summary = reader.get_summary()
            assert summary is not None
            known = [summary.channels[number] for number in channels]
            return [known, *reader.iter_attachments(), *reader.iter_metadata(), reader.get_header(), summary.schemas]

    assert around(out) == around(path)
    with out.open("rb") as stream:
        added = [(c.metadata, m.sequence) for _, c, m in make_reader(stream).iter_messages(["/wrench/contact"])]
    assert added == [(quality, k) for k in range(3)]


def test_a_recording_split_into_files_is_copied_file_by_file(tmp_path: Path) -> None:
    from ruamel.yaml import YAML

    messages, wrench = _rich()
    halves = [
        write_bag(tmp_path / f"half{k}", part, compression="storage")
        for k, part in enumerate((messages[:90], messages[90:]))
    ]
    said = [YAML(typ="safe").load((half / "metadata.yaml").read_text()) for half in halves]
    one, other = (part["rosbag2_bagfile_information"] for part in said)
    for key in ("relative_file_paths", "files"):
        one[key] += other[key]
    counts = {topic["topic_metadata"]["name"]: topic["message_count"] for topic in other["topics_with_message_count"]}
    for topic in one["topics_with_message_count"]:
        topic["message_count"] += counts.get(topic["topic_metadata"]["name"], 0)
    one["message_count"] += other["message_count"]
    path, out = tmp_path / "run", tmp_path / "out"
    path.mkdir()
    for half in halves:
        (half / f"{half.name}.mcap").rename(path / f"{half.name}.mcap")
    with (path / "metadata.yaml").open("w") as file:
        YAML(typ="safe").dump(said[0], file)
    np.testing.assert_array_equal(bag_streams(path).wrench.wrench, wrench)
    write_bag_with(path, out, _read_twice(path, 11))
    before, after = _content(path), _content(out)
    assert [t for t, _, _ in after.pop("/wrench/contact")] == [t for t, _, _ in before["/wrench"]]
    assert after == before
    assert sorted(file.name for file in out.iterdir()) == ["half0.mcap", "half1.mcap", "metadata.yaml"]
    with Reader(out) as reader:
        assert {c.topic: c.msgcount for c in reader.connections}["/wrench/contact"] == 120
        assert reader.message_count == len(messages) + 120
        storage: Any = reader.storage
        assert [file["message_count"] for file in storage.files] == _counted(out)


def _counted(folder: Path) -> list[int]:
    """How many messages each file of a folder has, by the mcap package."""
    from mcap.reader import make_reader

    counts = []
    for file in sorted(folder.glob("*.mcap")):
        with file.open("rb") as stream:
            counts.append(sum(1 for _ in make_reader(stream).iter_messages()))
    return counts


def _streams(n: int = 500, seed: int = 0) -> Streams:
    rng = np.random.default_rng(seed)
    t = 1e-9 * START + np.sort(rng.uniform(0.0, 10.0, n))
    R, position = any_rotations(n // 5, seed), rng.normal(size=(n // 5, 3))
    return Streams(WrenchStream(t, rng.normal(size=(n, 6))), OrientationStream(t[::5] + 1e-3, R, position))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("t0", [0.0, -1e-9 * START])
def test_streams_come_back_as_they_were(tmp_path: Path, kind: str, t0: float) -> None:
    """With Unix times, and with times from 0."""
    given = _streams()
    given = Streams(
        WrenchStream(given.wrench.t + t0, given.wrench.wrench),
        OrientationStream(given.orientation.t + t0, given.orientation.R_base_flange, given.orientation.position),
    )
    path = tmp_path / f"run{kind}"
    write_streams_bag(path, given)
    read = bag_streams(path)
    np.testing.assert_array_equal(read.wrench.wrench, given.wrench.wrench)
    np.testing.assert_allclose(read.wrench.t, given.wrench.t, rtol=0, atol=5.1e-10)
    np.testing.assert_allclose(read.orientation.t, given.orientation.t, rtol=0, atol=5.1e-10)
    np.testing.assert_allclose(read.orientation.R_base_flange, given.orientation.R_base_flange, atol=1e-14)
    assert given.orientation.position is not None
    np.testing.assert_array_equal(read.orientation.position, given.orientation.position)
    wrench, pose = _decoded(path, "/wrench")[0], _decoded(path, "/pose")[0]
    assert (wrench.header.frame_id, pose.header.frame_id) == ("sensor", "base")
    assert sorted(item.name for item in tmp_path.iterdir()) == [path.name]


def test_streams_without_positions_or_messages(tmp_path: Path) -> None:
    given = _streams()
    write_streams_bag(tmp_path / "a.mcap", replace(given, orientation=replace(given.orientation, position=None)))
    assert np.isnan(np.asarray(bag_streams(tmp_path / "a.mcap").orientation.position)).all()
    empty = Streams(WrenchStream(np.empty(0), np.empty((0, 6))), OrientationStream(np.empty(0), np.empty((0, 3, 3))))
    write_streams_bag(tmp_path / "b.bag", empty)
    with AnyReader([tmp_path / "b.bag"]) as reader:
        assert reader.message_count == 0


def _refused(path_in: Path, path_out: Path, rows: list[Array], **arguments: Any) -> str:
    with pytest.raises(ContactWrenchError) as caught:
        write_bag_with(path_in, path_out, rows, **arguments)
    return str(caught.value)


def test_what_cannot_be_written_is_said_and_leaves_nothing(tmp_path: Path) -> None:
    messages, _ = _rich()
    path, rows = write_bag(tmp_path / "run.mcap", messages), [np.ones((120, 6))]
    out = tmp_path / "out.mcap"
    assert _refused(path, path, rows) == (
        f"{path}: found what is read as {path}, expected another file to write: name one"
    )
    assert _refused(path, tmp_path / "out.bag", rows) == (
        f"{tmp_path / 'out.bag'}: found the suffix .bag, expected .mcap as of {path}: a bag is copied to one of its "
        "kind"
    )
    assert _refused(path, tmp_path / "no" / "out.mcap", rows) == (
        f"{tmp_path / 'no' / 'out.mcap'}: found no folder {tmp_path / 'no'}, expected one: make it first"
    )
    assert _refused(path, out, rows, topic="/rosout") == (
        f"{path}: found a topic /rosout already, expected another name for the contact wrench"
    )
    assert _refused(path, out, [np.ones((119, 6))]) == (
        f"{path}: found 119 contact wrenches, expected one for each reading"
    )
    assert _refused(path, out, [*rows, np.ones((1, 6))]) == (
        f"{path}: found more than 120 contact wrenches, expected one for each reading"
    )
    folder = write_bag(tmp_path / "folder", messages)
    (tmp_path / "there").mkdir()
    assert _refused(folder, tmp_path / "there", rows) == (
        f"{tmp_path / 'there'}: found a folder, expected a new name: name another, or a file in it"
    )
    assert _refused(folder, tmp_path / "out.db3", rows) == (
        f"{tmp_path / 'out.db3'}: found the suffix .db3, expected none, a folder, as of {folder}: a bag is copied to "
        "one of its kind"
    )
    with pytest.raises(ContactWrenchError) as caught:
        write_streams_bag(tmp_path / "run.rosbag", _streams())
    assert str(caught.value) == (
        f"{tmp_path / 'run.rosbag'}: found the suffix .rosbag, expected .bag, .mcap, .db3, or none: a folder"
    )
    assert sorted(item.name for item in tmp_path.iterdir()) == ["folder", "run.mcap", "there"]


def test_an_error_on_the_way_leaves_the_file_that_was_there(tmp_path: Path) -> None:
    messages, _ = _rich()
    path, out = write_bag(tmp_path / "run.bag", messages), tmp_path / "out.bag"
    out.write_bytes(b"precious")

    def breaking() -> Iterator[Array]:
        yield np.ones((3, 6))
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_bag_with(path, out, breaking())
    assert out.read_bytes() == b"precious"
    write_bag_with(path, out, _read_twice(path, 9))
    assert len(_content(out)["/wrench/contact"]) == 120
    assert sorted(item.name for item in tmp_path.iterdir()) == ["out.bag", "run.bag"]


@pytest.mark.skipif(os.name != "posix", reason="a full device is only there on POSIX")
def test_a_full_disk_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    messages, _ = _rich()
    path = write_bag(tmp_path / "run.bag", messages)

    def full(*_: Any) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    out = tmp_path / "out.bag"
    assert _refused(path, out, [np.ones((120, 6))]) == (
        f"{out}: cannot be written (no space left on device): check the space on the disk and the permissions"
    )
    assert not out.exists()


KINDS_OF_FILES = (".bag", ".mcap", ".db3")


@pytest.mark.skipif(os.name != "posix", reason="limits of the size of files are those of POSIX")
@pytest.mark.parametrize("kind", [*KINDS_OF_FILES, ""])
def test_a_file_that_the_system_does_not_let_grow_leaves_the_old_one(tmp_path: Path, kind: str) -> None:
    import resource

    out = tmp_path / f"out{kind}"
    if kind:
        out.write_bytes(b"precious")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (2048, before[1]))
    try:
        with pytest.raises(FileAccessError) as caught:
            write_streams_bag(out, _streams())
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    reason = "disk i/o error" if kind in (".db3", "") else "file too large"
    assert str(caught.value) == (
        f"{out}: cannot be written ({reason}): check the space on the disk and the permissions"
    )
    assert [item.name for item in tmp_path.iterdir()] == ([out.name] if kind else [])
    assert not kind or out.read_bytes() == b"precious"


@pytest.mark.parametrize("kind", KINDS_OF_FILES)
def test_a_bag_keeps_links_permissions_and_devices(tmp_path: Path, kind: str) -> None:
    out, link, device, pipe = (tmp_path / f"{name}{kind}" for name in ("out", "link", "device", "pipe"))
    out.write_bytes(b"old")
    out.chmod(0o640)
    link.symlink_to(out)
    write_streams_bag(link, _streams())
    assert link.is_symlink()
    assert stat.S_IMODE(out.stat().st_mode) == 0o640
    assert len(bag_streams(out).wrench.t)
    device.symlink_to("/dev/null")
    os.mkfifo(pipe)
    for path in (device, pipe):
        with pytest.raises(FileAccessError) as caught:
            write_streams_bag(path, _streams())
        assert str(caught.value) == f"{path}: found a device or a pipe, expected a file to write: name another"
        assert not path.is_file()


def test_a_folder_replaces_nothing(tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.write_text("precious")
    with pytest.raises(FileAccessError) as caught:
        write_streams_bag(out, _streams())
    assert str(caught.value) == f"{out}: found a file or a folder, expected a new name for a folder: name another"
    assert out.read_text() == "precious"


def test_a_bag_is_not_copied_to_another_name_of_itself(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "run.mcap", _rich()[0])
    hard, link = tmp_path / "hard.mcap", tmp_path / "link.mcap"
    hard.hardlink_to(path)
    link.symlink_to(path)
    for out in (hard, link):
        assert _refused(path, out, [np.ones((120, 6))]) == (
            f"{out}: found what is read as {path}, expected another file to write: name one"
        )


def test_a_copy_of_what_is_left_of_a_damaged_folder_is_whole(tmp_path: Path) -> None:
    messages, _ = _rich()
    path, out = write_bag(tmp_path / "run", messages, compression="storage"), tmp_path / "out"
    said = (path / "metadata.yaml").read_text()
    lost = said.replace(f"message_count: {len(messages)}", f"message_count: {len(messages) + 7}").replace(
        "/wrench\n", "/w\n"
    )
    assert lost.count("/w\n") == 1
    (path / "metadata.yaml").write_text(lost)
    write_bag_with(path, out, [np.zeros((120, 6))], accept_damaged=True)
    assert len(bag_streams(out, wrench_topic="/wrench/contact").wrench) == 120
