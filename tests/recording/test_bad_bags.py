"""What is no bag, or not the right one: one line that says what to do, word for word, and never a traceback."""

from __future__ import annotations

import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from contactwrench.errors import ContactWrenchError, FileAccessError, InputError
from contactwrench.recording.bags.copy import write_bag_with
from contactwrench.recording.bags.open import is_bag
from contactwrench.recording.bags.read import bag_batches
from contactwrench.recording.contents import bag_contents
from tests.support.bags import (
    JOINT_STATE,
    KINDS,
    POSE_STAMPED,
    STRING,
    WRENCH,
    WRENCH_STAMPED,
    Message,
    bag_streams,
    header,
    joint_state,
    ns,
    pose_stamped,
    recording,
    serialized,
    tf,
    transform,
    wrench_stamped,
    write_bag,
)

WHAT_TO_DO = "the file is damaged; record or copy it again, or read what is left of it with --accept-damaged"
HALF = {"orientation": {"w": 0.5}}
I3, ZERO = np.eye(3), np.zeros(3)
READING, POSE = wrench_stamped(0.0, np.ones(6)), pose_stamped(0.0, I3, ZERO)
TEXT = Message("/rosout", STRING, ns(0.0), {"data": "hello"})


def _refused(path: Path, **arguments: Any) -> str:
    with pytest.raises(ContactWrenchError) as caught:
        bag_streams(path, **arguments)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def _other(topic: str) -> Message:
    return wrench_stamped(0.0, np.ones(6), topic=topic)


NONE_OF_ROS = "geometry_msgs/WrenchStamped or geometry_msgs/Wrench"
POSE_TYPES = "geometry_msgs/PoseStamped, geometry_msgs/TransformStamped or nav_msgs/Odometry"


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    ("messages", "topics", "arguments", "message"),
    [
        (
            [TEXT, POSE],
            {},
            {},
            f"found no topic of type {NONE_OF_ROS} with messages, expected one with the sensor's readings (found /pose "
            "(geometry_msgs/PoseStamped), /rosout (std_msgs/String))",
        ),
        (
            [POSE],
            {"/wrench": WRENCH_STAMPED},
            {},
            f"found no topic of type {NONE_OF_ROS} with messages, expected one with the sensor's readings (found /pose "
            "(geometry_msgs/PoseStamped), /wrench (geometry_msgs/WrenchStamped))",
        ),
        (
            [POSE],
            {"/wrench": WRENCH_STAMPED},
            {"wrench_topic": "/wrench"},
            "topic /wrench has no messages, expected some: name another with --wrench-topic",
        ),
        (
            [READING, Message("/left", WRENCH, ns(0.0), {}), POSE],
            {},
            {},
            "found 2 topics with a wrench: /left (geometry_msgs/Wrench, 1 messages), /wrench "
            "(geometry_msgs/WrenchStamped, 1 messages), expected one: choose with --wrench-topic /left",
        ),
        (
            [READING, Message("/ft_compensated", WRENCH, ns(0.0), {}), POSE],
            {},
            {},
            "found 2 topics with a wrench: /ft_compensated (geometry_msgs/Wrench, 1 messages), /wrench "
            "(geometry_msgs/WrenchStamped, 1 messages), expected one: choose with --wrench-topic /wrench",
        ),
        (
            [READING, POSE],
            {},
            {"wrench_topic": "/ft"},
            "found no topic /ft, expected one of /pose (geometry_msgs/PoseStamped), /wrench "
            "(geometry_msgs/WrenchStamped): --wrench-topic",
        ),
        (
            [READING, POSE],
            {},
            {"wrench_topic": "/pose"},
            f"topic /pose is geometry_msgs/PoseStamped, expected {NONE_OF_ROS}: name another with --wrench-topic",
        ),
        (
            [READING],
            {},
            {},
            f"found no topic of type {POSE_TYPES} with messages, expected one with the arm's pose (found /wrench "
            "(geometry_msgs/WrenchStamped))",
        ),
        (
            [READING, POSE, pose_stamped(0.0, I3, ZERO, topic="/goal")],
            {},
            {},
            "found 2 topics with poses: /goal (geometry_msgs/PoseStamped, 1 messages), /pose "
            "(geometry_msgs/PoseStamped, 1 messages), expected one: choose with --pose-topic /goal",
        ),
        (
            [READING, POSE],
            {},
            {"pose_topic": "/wrench"},
            "topic /wrench is geometry_msgs/WrenchStamped, expected geometry_msgs/PoseStamped, "
            "geometry_msgs/TransformStamped, nav_msgs/Odometry, sensor_msgs/JointState or tf2_msgs/TFMessage: name "
            "another with --pose-topic",
        ),
        (
            [READING, joint_state(0.0, ["a"], np.zeros(1))],
            {},
            {},
            "found /joint_states (sensor_msgs/JointState), expected to be told how the pose follows: name the arm of "
            "the joint states with --robot NAME or ARM.urdf",
        ),
        (
            [READING, tf(0.0, [transform(0.0, "base", "tool0", I3, ZERO)])],
            {},
            {"pose_topic": "/tf"},
            "found /tf (tf2_msgs/TFMessage), expected to be told how the pose follows: name two frames of the "
            "transforms with --frames BASE,FLANGE (found base, tool0)",
        ),
        (
            [READING, tf(0.0, [transform(0.0, "base", "tool0", I3, ZERO)]), joint_state(0.0, ["a"], np.zeros(1))],
            {},
            {},
            "found /joint_states (sensor_msgs/JointState) and /tf (tf2_msgs/TFMessage), expected to be told how the "
            "pose follows: name the arm of the joint states with --robot NAME or ARM.urdf, or name two frames of the "
            "transforms with --frames BASE,FLANGE (found base, tool0)",
        ),
        (
            [READING, POSE],
            {},
            {"frames": ("base", "tool0")},
            "found no topic of type tf2_msgs/TFMessage with messages, expected one for --frames (found /pose "
            "(geometry_msgs/PoseStamped), /wrench (geometry_msgs/WrenchStamped))",
        ),
        (
            [READING, POSE, pose_stamped(0.1, I3, ZERO, frame="world")],
            {},
            {},
            "topic /pose: found poses of a frame in base and of a frame in world, expected one: name another topic "
            "with --pose-topic",
        ),
        (
            [
                READING,
                POSE,
                Message("/pose", POSE_STAMPED, ns(2.5), {"header": header(2.5, "base"), "pose": HALF}),
            ],
            {},
            {},
            "topic /pose, at 2.500 s: found a quaternion of length 0.5, expected 1 within 1 %: check the order of its "
            "parts and that none is cut off",
        ),
        (
            [],
            {},
            {},
            f"found no topic of type {NONE_OF_ROS} with messages, expected one with the sensor's readings (found no "
            "topic)",
        ),
    ],
)
def test_the_topics_that_are_missing_or_more_than_one_are_named(
    tmp_path: Path, kind: str, messages: list[Message], topics: dict[str, str], arguments: dict[str, Any], message: str
) -> None:
    path = write_bag(tmp_path / f"run{kind}", messages, topics)
    assert _refused(path, **arguments) == f"{path}: {message}"


def test_one_of_each_is_enough(tmp_path: Path) -> None:
    """Empty topics and topics that need a flag do not stand in the way, and names choose."""
    more = [joint_state(0.0, ["a"], np.zeros(1)), tf(0.0, [transform(0.0, "base", "tool0", I3, ZERO)]), TEXT]
    empty = {"/other": WRENCH_STAMPED, "/goal": POSE_STAMPED}
    path = write_bag(tmp_path / "run.mcap", [READING, POSE, *more], empty)
    assert bag_streams(path).orientation.source == f"{path} /pose"
    path = write_bag(
        tmp_path / "two.mcap", [READING, POSE, _other("/w2"), pose_stamped(0.0, I3, ZERO, topic="/p2"), *more]
    )
    streams = bag_streams(path, wrench_topic="w2", pose_topic="/p2")
    assert (streams.wrench.source, streams.orientation.source) == (f"{path} /w2", f"{path} /p2")


def test_what_is_taken_for_a_bag(tmp_path: Path) -> None:
    folder = write_bag(tmp_path / "run", [READING])
    (tmp_path / "tables").mkdir()
    (tmp_path / "tables" / "a.parquet").touch()
    paths: list[str | Path] = [folder, tmp_path / "tables", "a.MCAP", "a.csv"]
    assert [is_bag(path) for path in paths] == [True, False, True, False]
    (folder / "metadata.yaml").unlink()
    assert is_bag(folder)


def test_paths_that_are_no_bag(tmp_path: Path) -> None:
    for name in ("run.bag", "folder"):
        path = tmp_path / name
        assert _refused(path) == f"{path}: there is no such file, expected a readable file: check the path"
    text = tmp_path / "run.rosbag"
    text.write_text("hello")
    assert _refused(text) == (
        f"{text}: found the suffix .rosbag, expected .bag, .mcap, .db3 or a folder with metadata.yaml"
    )
    folder = tmp_path / "folder"
    folder.mkdir()
    assert _refused(folder) == (
        f"{folder}: found a folder without metadata.yaml, expected a ROS 2 bag: name the .mcap or .db3 file in it"
    )
    path = write_bag(tmp_path / "run.mcap", [READING, POSE])
    with pytest.raises(InputError) as caught:
        next(bag_batches(path, batch=0))
    assert str(caught.value) == "batch is 0, expected 1 or more"


@pytest.mark.parametrize(
    ("kind", "content", "reason"),
    [
        (".bag", b"", "ROS 1 bag (File '{path}' seems to be empty)"),
        (".mcap", b"", "MCAP file (File '{path}' seems to be empty)"),
        (".db3", b"", "ROS 2 sqlite3 bag (no table topics with id, name, type, serialization_format stored in it)"),
        (".bag", b"hello\n", "ROS 1 bag (File magic is invalid)"),
        (".mcap", b"hello\n", "MCAP file (File magic is invalid)"),
        (".db3", b"hello\n" * 100, "ROS 2 sqlite3 bag (file is not a database)"),
    ],
)
def test_files_that_only_bear_the_name(tmp_path: Path, kind: str, content: bytes, reason: str) -> None:
    path = tmp_path / f"run{kind}"
    path.write_bytes(content)
    expected = f"{path}: cannot be read as a {reason.format(path=path)}, expected a whole one: record or copy it again"
    assert _refused(path) == expected


@pytest.mark.parametrize(
    ("yaml", "reason"),
    [
        ("a: [", "line 1: expected the node content, but found '<stream end>')"),
        ("a: 1", "Object missing required field `rosbag2_bagfile_information`)"),
        ("", "Expected `object`, got `null`)"),
    ],
)
def test_a_folder_with_other_metadata(tmp_path: Path, yaml: str, reason: str) -> None:
    path = write_bag(tmp_path / "run", [READING, POSE])
    (path / "metadata.yaml").write_text(yaml)
    assert _refused(path).startswith(f"{path}: cannot be read as a ROS 2 bag folder ({reason}")


def test_a_folder_whose_file_is_gone(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "run", [READING, POSE])
    (path / "run.db3").unlink()
    assert _refused(path) == (f"{path}: found no run.db3, expected it, as metadata.yaml says: copy the folder whole")


def test_types_that_are_not_defined_and_messages_that_are_none(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "run.db3", [READING, wrench_stamped(1.5, np.ones(6)), POSE])
    with closing(sqlite3.connect(path)) as base:
        base.execute("UPDATE messages SET data = x'0001000000000000' WHERE timestamp > 1700000000000000000")
        base.commit()
    assert _refused(path) == (
        f"{path}: found 8 bytes that are no such message in topic /wrench, at 1.500 s, expected one as its type "
        f"defines: {WHAT_TO_DO}"
    )
    with closing(sqlite3.connect(path)) as base:
        base.execute("UPDATE messages SET data = x'0007000000000000' WHERE timestamp > 1700000000000000000")
        base.commit()
    assert _refused(path) == (
        f"{path}: found a message that starts with 0007 in topic /wrench, at 1.500 s, expected plain CDR: {WHAT_TO_DO}"
    )
    with closing(sqlite3.connect(path)) as base:
        base.execute("UPDATE message_definitions SET encoded_message_definition = 'float64 x'")
        base.commit()
    assert " bytes that are no such message in topic /pose, at 0.000 s, expected one " in _refused(path)


@pytest.mark.parametrize("kind", [".mcap", ".db3"])
@pytest.mark.parametrize("topic", ["/wrench", "/pose"])
def test_messages_of_another_length_are_left_out_and_said_where_that_is_accepted(
    tmp_path: Path, kind: str, topic: str
) -> None:
    stated = {"/wrench": WRENCH_STAMPED, "/pose": POSE_STAMPED}[topic]
    recorded, wrench, *_ = recording(100)
    path = write_bag(tmp_path / f"run{kind}", recorded)
    hold = bag_streams(path)
    content = serialized(next(each for each in recorded if each.topic == topic))
    other = Message(topic, stated, ns(0.05), {})
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            "tests.support.bags.serialized", lambda each, **_: content[:-9] if each is other else serialized(each)
        )
        path = write_bag(tmp_path / f"damaged{kind}", [other, *recorded, other])
    said = f"found {len(content) - 9} bytes that are no such message in topic {topic}, at 0.050 s, expected one as "
    assert _refused(path) == f"{path}: {said}its type defines: {WHAT_TO_DO}"
    left = bag_streams(path, accept_damaged=True)
    assert np.array_equal(left.wrench.wrench, hold.wrench.wrench)
    assert np.array_equal(left.orientation.R_base_flange, hold.orientation.R_base_flange)
    assert left.damage.count(said) == 1
    assert hold.damage == ""
    out = tmp_path / f"out{kind}"
    write_bag_with(path, out, [wrench], accept_damaged=True)
    assert np.array_equal(bag_streams(out, wrench_topic="/wrench/contact", accept_damaged=True).wrench.wrench, wrench)


@pytest.mark.parametrize("kind", [".db3", ""])
def test_a_recording_whose_last_part_is_in_a_log(tmp_path: Path, kind: str) -> None:
    path = write_bag(tmp_path / f"run{kind}", [READING, POSE])
    file = path if kind else path / "run.db3"
    with closing(sqlite3.connect(file)) as base:
        base.execute("PRAGMA journal_mode = WAL")
        base.execute("DELETE FROM messages")
        base.commit()
        assert _refused(path) == (
            f"{file}: found run.db3-wal with messages beside it, expected a recording that was closed: join them with "
            "sqlite3 run.db3 'PRAGMA wal_checkpoint(TRUNCATE)'"
        )


def test_a_file_that_may_not_be_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_bag(tmp_path / "run.bag", [READING, POSE])

    def refuse(*_: Any, **__: Any) -> Any:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "open", refuse)
    with pytest.raises(FileAccessError) as caught:
        bag_streams(path)
    assert str(caught.value) == f"{path}: cannot be read (permission denied): check the path and its permissions"


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    folder = tmp_path_factory.mktemp("whole")
    messages, *_ = recording(60)
    return {kind: write_bag(folder / f"run{kind}", messages).read_bytes() for kind in (".bag", ".mcap", ".db3")}


@pytest.mark.slow
@pytest.mark.parametrize("kind", [".bag", ".mcap", ".db3"])
@settings(max_examples=30, deadline=None)
@given(data=st.data())
def test_a_bag_that_is_damaged_anywhere_is_read_or_refused_in_one_line(
    tmp_path_factory: pytest.TempPathFactory, whole: dict[str, bytes], kind: str, data: st.DataObject
) -> None:
    content = bytearray(whole[kind])
    for _ in range(data.draw(st.integers(0, 4))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    cut = data.draw(st.one_of(st.just(len(content)), st.integers(0, len(content))))
    path = tmp_path_factory.mktemp("damaged") / f"run{kind}"
    path.write_bytes(bytes(content[:cut]))
    for read in (bag_streams, bag_contents):
        try:
            read(path)
        except ContactWrenchError as error:
            assert str(error).startswith(f"{path}: ")  # noqa: PT017
            assert "\n" not in str(error)  # noqa: PT017


@pytest.mark.parametrize("missing", ["rosbags", "mcap"])
def test_without_a_library_the_command_that_installs_it_is_named(tmp_path: Path, missing: str) -> None:
    path = write_bag(tmp_path / "run.mcap", [READING, POSE])
    script = (
        f"import sys; sys.modules[{missing!r}] = None\n"
        "from contactwrench.errors import MissingExtraError\n"
        "from contactwrench.recording.bags.read import bag_batches\n"
        f"try: next(bag_batches({str(path)!r}))\n"
        "except MissingExtraError as error: print(error)\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout == f"a ROS bag needs {missing}, which is not installed: pip install 'contactwrench[bags]'\n"


def test_a_library_that_is_broken_is_named(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "run.mcap", [READING, POSE])
    (tmp_path / "mcap.py").write_text("raise ImportError('libzstd.so.1: cannot open shared object file')")
    script = (
        "from contactwrench.errors import MissingExtraError\n"
        "from contactwrench.recording.bags.read import bag_batches\n"
        f"try: next(bag_batches({str(path)!r}))\n"
        "except MissingExtraError as error: print(error)\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True, cwd=tmp_path)
    assert done.stdout == (
        "a ROS bag needs mcap, which cannot be loaded (libzstd.so.1: cannot open shared object file): "
        "pip install 'contactwrench[bags]'\n"
    )


def test_joint_states_are_not_poses(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "run.mcap", [READING, POSE, Message("/j", JOINT_STATE, ns(0.0), {})])
    assert _refused(path, pose_topic="/j") == (
        f"{path}: found /j (sensor_msgs/JointState), expected to be told how the pose follows: name the arm of the "
        "joint states with --robot NAME or ARM.urdf"
    )
