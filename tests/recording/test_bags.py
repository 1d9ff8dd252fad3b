"""Streams from bags: what rosbags and the mcap package wrote comes out again, whatever the format."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import contactwrench as cw
from contactwrench.recording.bags.read import bag_batches
from contactwrench.samples.samples import Streams
from tests.support.bags import (
    KINDS,
    ODOMETRY,
    START,
    TRANSFORM_STAMPED,
    WRENCH,
    WRENCH_STAMPED,
    Message,
    any_rotations,
    bag_streams,
    header,
    ns,
    pose_stamped,
    quaternion,
    recording,
    tf,
    transform,
    vector,
    wrench_fields,
    wrench_stamped,
    write_bag,
    write_mcap,
)
from tests.support.world import Array

TIME = 5e-7
"""s: a Unix time as float64 is known to 2e-7 s."""


def _same(streams: Streams, wrench: Array, R: Array, position: Array | None, every: int = 10) -> None:
    start = 1e-9 * START
    np.testing.assert_array_equal(streams.wrench.wrench, wrench)
    np.testing.assert_allclose(streams.wrench.t - start, 1e-3 * np.arange(len(wrench)), atol=TIME)
    np.testing.assert_allclose(streams.orientation.t - start, 1e-3 * every * np.arange(len(R)), atol=TIME)
    np.testing.assert_allclose(streams.orientation.R_base_flange, R, atol=1e-14)
    if position is None:
        assert streams.orientation.position is None
    else:
        np.testing.assert_array_equal(streams.orientation.position, position)


@pytest.mark.parametrize("kind", KINDS)
def test_what_rosbags_wrote_comes_out_again(tmp_path: Path, kind: str) -> None:
    messages, wrench, R, position = recording(3000)
    path = write_bag(tmp_path / f"run{kind}", messages)
    streams = bag_streams(path)
    _same(streams, wrench, R, position)
    assert streams.wrench.source == f"{path} /wrench"
    assert streams.orientation.source == f"{path} /pose"


@pytest.mark.parametrize(
    ("kind", "compression"), [(".bag", "bz2"), (".bag", "lz4"), ("", "storage"), ("", "message"), ("", "file")]
)
def test_compressed_bags_come_out_again(tmp_path: Path, kind: str, compression: str) -> None:
    messages, wrench, R, position = recording(300)
    _same(bag_streams(write_bag(tmp_path / f"run{kind}", messages, compression=compression)), wrench, R, position)


MCAP_OPTIONS: dict[str, dict[str, Any]] = {
    "as it comes": {},
    "lz4": {"compression": "LZ4"},
    "zstd": {"compression": "ZSTD"},
    "small chunks": {"chunk_size": 1000},
    "no chunks": {"use_chunking": False},
    "no index": {"index_types": "NONE"},
    "no index of messages": {"index_types": "CHUNK"},
    "big endian": {"big_endian": True},
    "no statistics": {"use_statistics": False},
    "sums": {"enable_crcs": True, "enable_data_crcs": True},
}


@pytest.mark.parametrize("options", MCAP_OPTIONS.values(), ids=MCAP_OPTIONS)
def test_what_the_mcap_package_wrote_comes_out_again(tmp_path: Path, options: dict[str, Any]) -> None:
    mcap = pytest.importorskip("mcap.writer", reason="mcap is not installed")
    options = {"compression": "NONE"} | options
    if options["compression"] == "ZSTD":
        pytest.importorskip("zstandard", reason="zstandard is not installed")
    options["compression"] = mcap.CompressionType[options["compression"]]
    if "index_types" in options:
        options["index_types"] = mcap.IndexType[options["index_types"]]
    messages, wrench, R, position = recording(300)
    _same(bag_streams(write_mcap(tmp_path / "run.mcap", messages, **options)), wrench, R, position)


@pytest.fixture(scope="module", params=KINDS)
def long_bag(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Array, Array]:
    """A bag of more than one chunk."""
    messages, wrench, R, _ = recording(9000)
    return write_bag(tmp_path_factory.mktemp("long") / f"run{request.param}", messages), wrench, R


@pytest.mark.slow
@pytest.mark.parametrize("batch", [1, 10**6])
def test_batches_are_the_whole(long_bag: tuple[Path, Array, Array], batch: int) -> None:
    path, wrench, R = long_bag
    batches = list(bag_batches(path, batch=batch))
    assert (len(batches) > 1) == (batch < 10**6)
    assert all(one.wrench.t[-1] < other.wrench.t[0] for one, other in pairwise(batches))
    np.testing.assert_array_equal(np.concatenate([one.wrench.wrench for one in batches]), wrench)
    np.testing.assert_allclose(np.concatenate([one.orientation.R_base_flange for one in batches]), R, atol=1e-14)


def test_chunks_that_overlap_come_in_order(tmp_path: Path) -> None:
    """Poses are put into the bag 40 ms late, in chunks of 15 messages: each chunk begins before the one before ends."""
    messages, wrench, R, _ = recording(400)
    late = [replace(m, stamp=m.stamp + 40_000_000 * (m.topic == "/wrench" and m.stamp % 7 == 0)) for m in messages]
    streams = bag_streams(write_mcap(tmp_path / "run.mcap", late, chunk_size=1500))
    order = np.argsort([m.stamp for m in late if m.topic == "/wrench"], kind="stable")
    np.testing.assert_array_equal(streams.wrench.wrench, wrench[order])
    np.testing.assert_allclose(streams.orientation.R_base_flange, R, atol=1e-14)


@pytest.mark.parametrize("kind", KINDS)
def test_a_wrench_without_header_has_the_time_of_the_bag(tmp_path: Path, kind: str) -> None:
    wrench = np.arange(18.0).reshape(3, 6)
    messages = [Message("/w", WRENCH, ns(0.25 * k), wrench_fields(one)) for k, one in enumerate(wrench)]
    streams = bag_streams(write_bag(tmp_path / f"run{kind}", [*messages, pose_stamped(0.5, np.eye(3), np.zeros(3))]))
    np.testing.assert_array_equal(streams.wrench.wrench, wrench)
    np.testing.assert_allclose(streams.wrench.t - 1e-9 * START, [0.0, 0.25, 0.5], atol=TIME)


@pytest.mark.parametrize("kind", KINDS)
def test_stamps_of_headers_count_unless_they_are_zero(tmp_path: Path, kind: str) -> None:
    """Stamped 3 s before it was put into the bag; the second reading's stamp was never set."""
    R = any_rotations(1, 3)[0]
    fields = [{"header": header(t, "ft"), "wrench": wrench_fields(np.ones(6))} for t in (-3.0, None, -2.5)]
    messages = [Message("/w", WRENCH_STAMPED, ns(0.25 * k), one) for k, one in enumerate(fields)]
    messages.append(replace(pose_stamped(-2.0, R, np.zeros(3)), stamp=ns(1.0)))
    streams = bag_streams(write_bag(tmp_path / f"run{kind}", messages))
    np.testing.assert_allclose(streams.wrench.t - 1e-9 * START, [-3.0, 0.25, -2.5], atol=TIME)
    np.testing.assert_allclose(streams.orientation.t - 1e-9 * START, [-2.0], atol=TIME)


def test_frames_of_any_length_change_in_the_middle(tmp_path: Path) -> None:
    """A driver that is started again under another name: texts move the numbers to other places."""
    rng = np.random.default_rng(0)
    wrench = rng.normal(size=(40, 6))
    frames = ["", "a", "ab", "abc", "sensor", "sensor2", "x" * 300]
    messages = [wrench_stamped(0.01 * k, one, frame=frames[k // 6]) for k, one in enumerate(wrench)]
    for kind in (".bag", ".mcap"):
        path = write_bag(tmp_path / f"run{kind}", [*messages, pose_stamped(1.0, np.eye(3), np.zeros(3))])
        np.testing.assert_array_equal(bag_streams(path).wrench.wrench, wrench)


def test_a_reading_may_be_nan(tmp_path: Path) -> None:
    wrench = np.array([[1.0, 2.0, 3.0, 4.0, 5.0, 6.0], [np.nan] * 6])
    messages = [wrench_stamped(0.1 * k, one) for k, one in enumerate(wrench)]
    path = write_bag(tmp_path / "run.mcap", [*messages, pose_stamped(1.0, np.eye(3), np.zeros(3))])
    np.testing.assert_array_equal(bag_streams(path).wrench.wrench, wrench)


@pytest.mark.parametrize("kind", KINDS)
def test_poses_of_other_types(tmp_path: Path, kind: str) -> None:
    R, position = any_rotations(1, 5)[0], np.array([0.1, -0.2, 0.3])
    pose = {"position": vector(position), "orientation": quaternion(R)}
    odometry = {"header": header(0.5, "odom"), "child_frame_id": "flange", "pose": {"pose": pose}}
    for name, one in {
        "odometry": Message("/o", ODOMETRY, ns(0.5), odometry),
        "transform": Message("/t", TRANSFORM_STAMPED, ns(0.5), transform(0.5, "base", "flange", R, position)),
    }.items():
        streams = bag_streams(write_bag(tmp_path / f"{name}{kind}", [wrench_stamped(0.0, np.ones(6)), one]))
        np.testing.assert_allclose(streams.orientation.R_base_flange, [R], atol=1e-14)
        np.testing.assert_array_equal(streams.orientation.position, [position])
        np.testing.assert_allclose(streams.orientation.t - 1e-9 * START, [0.5], atol=TIME)


def test_a_bag_of_ros2_without_definitions_is_read_by_those_of_ros(tmp_path: Path) -> None:
    """So ROS 2 Humble writes sqlite3: the table of definitions came later."""
    messages, wrench, R, position = recording(50)
    path = write_bag(tmp_path / "run.db3", messages)
    with closing(sqlite3.connect(path)) as base:
        base.executescript("DROP TABLE message_definitions; UPDATE schema SET schema_version = 3;")
    _same(bag_streams(path), wrench, R, position)


def test_an_index_of_ros1_may_point_before_the_connections_of_its_first_message(tmp_path: Path) -> None:
    """So some recorders write it; readers pass over what is no message."""
    messages, wrench, R, position = recording(50)
    path = write_bag(tmp_path / "run.bag", messages)
    _same(bag_streams(path), wrench, R, position)
    content = path.read_bytes()
    stamp = b"".join(part.to_bytes(4, "little") for part in divmod(messages[0].stamp, 10**9))
    first = content.index(stamp, content.index(b"count=\x05\x00\x00\x00")) + len(stamp)
    assert content[first : first + 4] != bytes(4)
    path.write_bytes(content[:first] + bytes(4) + content[first + 4 :])
    _same(bag_streams(path), wrench, R, position)


def test_a_topic_whose_definition_is_no_text_is_passed_over(tmp_path: Path) -> None:
    """Programs beside ROS write theirs in binary (protobuf) into the same file."""
    from mcap.reader import make_reader
    from mcap.writer import Writer

    messages, wrench, R, position = recording(50)
    with write_bag(tmp_path / "run.mcap", messages).open("rb") as stream, (tmp_path / "more.mcap").open("wb") as file:
        writer: Any = Writer(file)
        writer.start("ros2")
        schema = writer.register_schema("a.B", "protobuf", b"\xff\xfe\n")
        writer.add_message(writer.register_channel("/other", "protobuf", schema), ns(0.0), b"..", ns(0.0))
        channels: dict[int, int] = {}
        for schema_of, channel, message in make_reader(stream).iter_messages():
            assert schema_of is not None
            if channel.id not in channels:
                defined = writer.register_schema(schema_of.name, schema_of.encoding, schema_of.data)
                channels[channel.id] = writer.register_channel(channel.topic, channel.message_encoding, defined)
            writer.add_message(channels[channel.id], message.log_time, message.data, message.publish_time)
        writer.finish()
    _same(bag_streams(tmp_path / "more.mcap"), wrench, R, position)


def test_a_pose_that_nobody_chose_is_named_where_transforms_may_tell_the_arms(
    tmp_path: Path,
) -> None:
    """A marker, or a platform's odometry, was taken for the arm's pose without a word."""
    turns = Rotation.from_rotvec(np.outer(np.arange(20), [0.05, 0.02, 0.0])).as_matrix()
    messages = [pose_stamped(1e-2 * k, R, np.ones(3)) for k, R in enumerate(turns)]
    messages += [wrench_stamped(1e-3 * k, np.arange(6.0)) for k in range(190)]
    arm = [tf(1e-3 * k, [transform(1e-3 * k, "base_link", "tool0", np.eye(3), np.zeros(3))]) for k in range(0, 200, 10)]
    alone, both = write_mcap(tmp_path / "alone.mcap", messages), write_mcap(tmp_path / "both.mcap", messages + arm)
    said = (
        "the pose is that of /pose in base, and the bag has /tf, too: if it is not the arm's, say "
        "--frames BASE,FLANGE, or --robot"
    )
    assert said in cw.read(both).notes
    for notes in (cw.read(alone).notes, cw.read(both, pose_topic="/pose").notes):
        assert not any("the pose is that of" in note for note in notes)
