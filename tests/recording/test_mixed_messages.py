"""Messages of one topic that are of two sensors, arms, types or clocks, and what a bag holds beside what it says of it:
refused or said, never mixed without a word.
"""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag1 import Writer as Writer1

from contactwrench.errors import FileFormatError
from tests.recording.test_bag_joints import UR_JOINTS
from tests.support.bags import (
    KINDS,
    ROS1,
    ROS2,
    TF,
    WRENCH,
    WRENCH_STAMPED,
    Message,
    any_rotations,
    bag_streams,
    header,
    joint_state,
    ns,
    pose_stamped,
    serialized,
    tf,
    transform,
    vector,
    wrench_fields,
    wrench_stamped,
    write_bag,
)

I3, ZERO = np.eye(3), np.zeros(3)
READING, POSE = wrench_stamped(0.0, np.ones(6)), pose_stamped(0.0, I3, ZERO)
DAMAGED = "the file is damaged; record or copy it again, or read what is left of it with --accept-damaged"


def _refused(path: Path, **arguments: object) -> str:
    with pytest.raises(FileFormatError) as caught:
        bag_streams(path, **arguments)
    return str(caught.value)


@pytest.mark.parametrize("kind", KINDS)
def test_readings_of_two_frames_are_refused_in_turn_and_said_one_after_the_other(tmp_path: Path, kind: str) -> None:
    """Every second one is another sensor's: 12 N were 6 N, and the fit was good."""
    messages = [wrench_stamped(1e-3 * k, np.ones(6), frame=("left", "/right")[k % 2]) for k in range(20)]
    path = write_bag(tmp_path / f"run{kind}", [POSE, *messages])
    assert _refused(path) == (
        f"{path}: topic /wrench: found readings of left and of right in turn, expected one sensor's: record each on a "
        "topic of its own"
    )
    messages = [wrench_stamped(1e-3 * k, np.ones(6), frame=("left", "/right")[k > 4]) for k in range(10)]
    path = write_bag(tmp_path / f"again{kind}", [POSE, *messages])
    said = f"{path}: /wrench has readings of left and of right: are these two sensors? all count as one's"
    assert bag_streams(path).damage == said


def test_readings_of_one_frame_however_it_is_written_are_one_sensors(tmp_path: Path) -> None:
    messages = [wrench_stamped(1e-3 * k, np.ones(6), frame=("ft", "/ft")[k % 2]) for k in range(10)]
    assert bag_streams(write_bag(tmp_path / "run.bag", [POSE, *messages])).damage == ""


@pytest.mark.parametrize("kind", KINDS)
def test_stamps_of_zero_among_others_are_said(tmp_path: Path, kind: str) -> None:
    messages = [wrench_stamped(1e-3 * k, np.ones(6)) for k in range(10)]
    at_zero = [replace(m, fields={**m.fields, "header": header(None, "ft_sensor")}) for m in messages[1::2]]
    path = write_bag(tmp_path / f"run{kind}", [POSE, *messages[::2], *at_zero])
    said = "/wrench has stamps of zero and others: where they are zero, the time of recording counts"
    assert bag_streams(path).damage == f"{path}: {said}"
    path = write_bag(tmp_path / f"begins{kind}", [POSE, at_zero[0], *messages[2:]])
    assert bag_streams(path).damage == ""


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("at_zero", [1, 4])
def test_a_simulated_clock_that_begins_at_zero_does(tmp_path: Path, kind: str, at_zero: int) -> None:
    """Recorded by a wall clock: the first stamps, of before /clock is heard, are its zero."""
    stamps = [0] * at_zero + [1_000_000 * k for k in range(at_zero, 10)]
    messages = [
        replace(m, fields={**m.fields, "header": {"stamp": {"sec": 0, "nanosec": at}, "frame_id": "ft_sensor"}})
        for m, at in zip((wrench_stamped(1e-3 * k, np.ones(6)) for k in range(10)), stamps, strict=True)
    ]
    found = bag_streams(write_bag(tmp_path / f"run{kind}", [POSE, *messages]))
    assert found.wrench.t.tolist() == [1e-9 * at for at in stamps]
    assert found.damage == ""


@pytest.mark.parametrize("other", [[f"right_{name}" for name in UR_JOINTS], [], list("abcdef")])
def test_joints_of_two_arms_in_turn_are_refused(tmp_path: Path, other: list[str]) -> None:
    names = [f"left_{name}" for name in UR_JOINTS]
    states = [joint_state(0.01 * k, (names, other)[k % 2], np.full(6, 0.1 * k)) for k in range(6)]
    path = write_bag(tmp_path / "run.mcap", [READING, *states])
    second = f"{other[0]} to {other[-1]}" if other else "joints without names"
    assert _refused(path, robot="ur5e") == (
        f"{path}: topic /joint_states: found left_shoulder_pan_joint to left_wrist_3_joint and {second}, expected one "
        "arm's: name its URDF with --robot"
    )


def test_joints_that_come_in_another_order_are_one_arms(tmp_path: Path) -> None:
    angles = np.random.default_rng(1).uniform(-1.0, 1.0, (6, 6))
    states = [joint_state(0.01 * k, UR_JOINTS[:: 1 - 2 * (k % 2)], q[:: 1 - 2 * (k % 2)]) for k, q in enumerate(angles)]
    usual = [joint_state(0.01 * k, UR_JOINTS, q) for k, q in enumerate(angles)]
    mixed, same = (
        bag_streams(write_bag(tmp_path / name, [READING, *each]), robot="ur5e").orientation.R_base_flange
        for name, each in (("mixed.mcap", states), ("usual.mcap", usual))
    )
    np.testing.assert_array_equal(mixed, same)


def test_a_topic_of_two_types_is_refused_by_its_name(tmp_path: Path) -> None:
    """Half of the readings were lost."""
    other = Message("/wrench", WRENCH, ns(0.1), wrench_fields(np.ones(6)))
    pytest.importorskip("mcap", reason="mcap is not installed")
    path = _mcap_of_publishers(tmp_path, [(WRENCH_STAMPED, _text(WRENCH_STAMPED)), (WRENCH, _text(WRENCH))], [other])
    assert _refused(path, wrench_topic="/wrench") == (
        f"{path}: topic /wrench is geometry_msgs/WrenchStamped and geometry_msgs/Wrench, expected one type: name "
        "another with --wrench-topic"
    )


def test_two_definitions_of_a_topics_type_are_refused(tmp_path: Path) -> None:
    """One publisher has the torque before the force: its readings were read as the other's."""
    text = _text(WRENCH_STAMPED)
    turned = text.replace("Vector3 force\n", "Vector3 x\n").replace("Vector3 torque\n", "Vector3 force\n")
    turned = turned.replace("Vector3 x\n", "Vector3 torque\n")
    path = _mcap_of_publishers(tmp_path, [(WRENCH_STAMPED, text), (WRENCH_STAMPED, turned)], [READING])
    assert _refused(path) == (
        f"{path}: topic /wrench: found two definitions of geometry_msgs/WrenchStamped, expected one: record each "
        "publisher on a topic of its own"
    )


@pytest.mark.parametrize("comment", ["# the same", "\n"])
def test_definitions_that_differ_in_words_alone_are_one(tmp_path: Path, comment: str) -> None:
    text = _text(WRENCH_STAMPED)
    path = _mcap_of_publishers(tmp_path, [(WRENCH_STAMPED, text), (WRENCH_STAMPED, f"{comment}\n{text}")], [READING])
    assert len(bag_streams(path).wrench.t) == 2


def test_a_topics_own_definition_counts(tmp_path: Path) -> None:
    """Another topic of that type, which comes first, has the torque before the force."""
    text = _text(WRENCH_STAMPED)
    turned = text.replace("Vector3 force\n", "Vector3 x\n").replace("Vector3 torque\n", "Vector3 force\n")
    turned = turned.replace("Vector3 x\n", "Vector3 torque\n")
    reading = wrench_stamped(0.0, np.arange(6.0))
    kinds = [(WRENCH_STAMPED, turned), (WRENCH_STAMPED, text)]
    path = _mcap_of_publishers(tmp_path, kinds, [reading], topics=("/a", "/wrench"))
    np.testing.assert_array_equal(bag_streams(path, wrench_topic="/wrench").wrench.wrench, [np.arange(6.0)])


def _text(msgtype: str) -> str:
    text: str = ROS2.generate_msgdef(msgtype, ros_version=2)[0]
    return text


def _mcap_of_publishers(
    folder: Path, kinds: list[tuple[str, str]], last: list[Message], topics: tuple[str, str] = ("/wrench", "/wrench")
) -> Path:
    """A reading, a pose, and `last`, by a channel of its own; each channel of a type with a definition in `kinds`."""
    writer = pytest.importorskip("mcap.writer", reason="mcap is not installed")
    path = folder / "run.mcap"
    with path.open("wb") as file:
        mcap = writer.Writer(file)
        mcap.start(profile="ros2", library="mcap")
        schemas = [mcap.register_schema(name, "ros2msg", text.encode()) for name, text in kinds]
        first, second = (mcap.register_channel(topics[k], "cdr", schemas[k]) for k in (0, 1))
        pose = mcap.register_schema(POSE.type, "ros2msg", _text(POSE.type).encode())
        poses = mcap.register_channel("/pose", "cdr", pose)
        for channel, message in ((first, READING), (poses, POSE), *((second, each) for each in last)):
            mcap.add_message(channel, message.stamp, serialized(message), message.stamp)
        mcap.finish()
    return path


def _ros1_bag(path: Path, of_wrench: dict[str, str], of_other: dict[str, str] | None = None) -> Path:
    """A reading, a pose and a message of another topic, with the definitions and hashes that are stated."""
    with Writer1(path) as writer:
        for message, stated in ((READING, of_wrench), (POSE, {}), (replace(READING, topic="/other"), of_other or {})):
            msgdef, md5sum = ROS1.generate_msgdef(message.type)
            how: dict[str, Any] = {"msgdef": msgdef, "md5sum": md5sum} | stated
            connection = writer.add_connection(message.topic, message.type, **how)
            writer.write(connection, message.stamp, serialized(message, ros1=True))
    return path


OF_WRENCH, MD5 = ROS1.generate_msgdef(WRENCH_STAMPED)
TURNED = OF_WRENCH.replace("force\n", "f\n").replace("torque\n", "force\n").replace(" f\n", " torque\n")
NARROW = OF_WRENCH.replace("float64 z", "float32 z")


@pytest.mark.parametrize(
    ("stated", "found", "expected"),
    [
        ({"md5sum": "0" * 32}, "0" * 32, MD5),
        ({"msgdef": TURNED}, MD5, "3a9487c36a7b061ac9a74c3ddc0b1ec6"),
        ({"msgdef": NARROW}, MD5, "0247181d6d6c41deb63a83732b314222"),
        ({"msgdef": "", "md5sum": "1" * 32}, "1" * 32, MD5),
    ],
    ids=["another hash", "torque before force", "other numbers", "no definition"],
)
def test_a_hash_of_another_definition_is_said(
    tmp_path: Path, stated: dict[str, str], found: str, expected: str
) -> None:
    """What was recorded is of another type than the bag says: its numbers lie elsewhere."""
    path = _ros1_bag(tmp_path / "run.bag", stated)
    said = (
        f"found the md5sum {found} of geometry_msgs/WrenchStamped in topic /wrench, expected {expected} as of its "
        "definition"
    )
    assert _refused(path, wrench_topic="/wrench") == f"{path}: {said}: {DAMAGED}"
    if stated.get("msgdef") != NARROW:  # else none of the messages is one
        read = bag_streams(path, wrench_topic="/wrench", accept_damaged=True)
        assert (len(read.wrench.t), read.damage) == (1, f"{path} is damaged: {said}; what was left of it was read")


@pytest.mark.parametrize(
    "stated",
    [
        {"md5sum": "*"},
        {"md5sum": MD5.upper()},
        {"msgdef": OF_WRENCH + "float64 ZERO=0.00\n", "md5sum": "of a text with 0.00"},
        {"msgdef": ""},
        {"msgdef": "# a wrench\n\n" + OF_WRENCH.replace("wrench\n", "  wrench   # of the sensor\n\n")},
        {"msgdef": OF_WRENCH.replace("std_msgs/Header", "Header").replace("geometry_msgs/Vector3 ", "Vector3 ")},
    ],
    ids=["any", "in capitals", "a constant", "no definition", "comments", "short names"],
)
def test_a_hash_counts_neither_comments_nor_blanks(tmp_path: Path, stated: dict[str, str]) -> None:
    path = _ros1_bag(tmp_path / "run.bag", stated, {"md5sum": "of a topic that is not read"})
    read = bag_streams(path, wrench_topic="/wrench")
    assert (len(read.wrench.t), read.damage) == (1, "")


def test_a_file_that_the_description_does_not_name_is_said(tmp_path: Path) -> None:
    """A recording that was split, and a description of its first file: half of it was lost."""
    folder = write_bag(tmp_path / "run", [READING, POSE])
    shutil.copy(folder / "run.db3", folder / "run_1.db3")
    assert _refused(folder) == (
        f"{folder}: found run_1.db3, which metadata.yaml does not name, expected the files that it names and no other: "
        f"{DAMAGED}"
    )
    assert len(bag_streams(folder, accept_damaged=True).wrench.t) == 1


@pytest.mark.parametrize("kind", [".db3", ".mcap"])
@pytest.mark.parametrize(("topic", "other"), [("/wrench", WRENCH), ("/pose", "nav_msgs/msg/Odometry")])
def test_a_type_that_the_description_says_otherwise_is_said(tmp_path: Path, kind: str, topic: str, other: str) -> None:
    folder = write_bag(tmp_path / "run", [READING, POSE], compression="storage" if kind == ".mcap" else "")
    assert list(folder.glob(f"*{kind}"))
    metadata, own = folder / "metadata.yaml", {"/wrench": WRENCH_STAMPED, "/pose": POSE.type}[topic]
    metadata.write_text(metadata.read_text().replace(f"type: {own}", f"type: {other}"))
    short = other.replace("/msg/", "/")
    found = f"found topic {topic} ({own.replace('/msg/', '/')}), expected {short} as in metadata.yaml"
    assert _refused(folder) == f"{folder}: {found}: {DAMAGED}"
    read = bag_streams(folder, accept_damaged=True)
    assert (len(read.wrench.t), read.damage) == (1, f"{folder} is damaged: {found}; what was left of it was read")


@pytest.mark.parametrize("said", ["type: geometry_msgs/WrenchStamped", "kind: of no use"])
def test_a_type_may_be_written_shortly_or_not_at_all(tmp_path: Path, said: str) -> None:
    folder = write_bag(tmp_path / "run", [READING, POSE])
    metadata = folder / "metadata.yaml"
    metadata.write_text(metadata.read_text().replace(f"type: {WRENCH_STAMPED}", said))
    assert bag_streams(folder).damage == ""


def _chain(turns: list[dict[str, float]]) -> list[Message]:
    """An arm that moves, and the static transform to its flange, again and again, each time by another quaternion."""
    R = any_rotations(20, 0)
    moving = [tf(0.1 * k, [transform(0.1 * k, "base", "link", R[k], ZERO)]) for k in range(20)]
    placed = [{**transform(0.5 * k, "link", "tool0", I3, ZERO)} for k in range(len(turns))]
    static = [
        Message("/tf_static", TF, ns(0.5 * k), {"transforms": [one | {"transform": {"rotation": turn}}]})
        for k, (one, turn) in enumerate(zip(placed, turns, strict=True))
    ]
    return sorted([READING, *moving, *static], key=lambda message: message.stamp)


@pytest.mark.parametrize("again", [[0.0, 0.0, 0.0, -1.0], [0.0, 0.0, 1e-9, 1.0]])
def test_a_static_transform_that_is_said_again_in_other_words_stays(tmp_path: Path, again: list[float]) -> None:
    """Its sign, or its last digits, differ: the recording was refused for gaps that it has not."""
    path = write_bag(tmp_path / "run.mcap", _chain([vector([0.0, 0.0, 0.0, 1.0]), vector(again)]))
    assert len(bag_streams(path, frames=("base", "tool0")).orientation.t) == 20


def test_static_transforms_that_contradict_each_other_are_named(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "run.mcap", _chain([vector([0.0, 0.0, 0.0, 1.0]), vector([0.0, 0.0, 1.0, 0.0])]))
    assert _refused(path, frames=("base", "tool0")) == (
        f"{path}: found link -> tool0 in tf_static and another time at another place, expected it to stay: record one "
        "robot's transforms"
    )
