"""ROS bags to streams: the wrench and the arm's pose, as they were recorded, in batches of bounded memory."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeAlias

import numpy as np

from ...assess.robot_arms import Arm, flange_orientation
from ...errors import FileFormatError, InputError
from ...geometry.arrays import Array
from ...samples.samples import OrientationStream, Streams, WrenchStream
from .chunks import Messages, messages, part_read
from .joint_states import joint_places
from .messages import joint_states, place, poses, rotations, transforms, wrenches
from .open import Bag, Topic, opened_bag
from .topics import FRAMES_FLAG, POSE_FLAG, ROBOT_FLAG, pose_topics, wrench_topic
from .transforms import Heard, Poses, chain, composed, hear, shortened, tree

BATCH = 2**16
"""Readings of a batch, and up to a chunk of the bag more."""

ReadPoses: TypeAlias = Callable[[Messages], Poses]


def bag_streams(
    path: str | Path,
    *,
    wrench_topic: str | None = None,
    pose_topic: str | None = None,
    frames: tuple[str, str] | None = None,
    arm: Arm | None = None,
    advance: Callable[[float], None] | None = None,
) -> Streams:
    """The whole of a bag; arguments and errors as of `bag_batches`."""
    parts = list(
        bag_batches(path, wrench_topic=wrench_topic, pose_topic=pose_topic, frames=frames, arm=arm, advance=advance)
    )
    positions = [p.orientation.position for p in parts if len(p.orientation)]
    known = [position for position in positions if position is not None]
    return Streams(
        WrenchStream(
            np.concatenate([p.wrench.t for p in parts]),
            np.concatenate([p.wrench.wrench for p in parts]),
            parts[0].wrench.source,
        ),
        OrientationStream(
            np.concatenate([p.orientation.t for p in parts]),
            np.concatenate([p.orientation.R_base_flange for p in parts]),
            np.concatenate(known) if known else None,
            parts[0].orientation.source,
        ),
    )


def bag_batches(
    path: str | Path,
    *,
    wrench_topic: str | None = None,
    pose_topic: str | None = None,
    frames: tuple[str, str] | None = None,
    arm: Arm | None = None,
    batch: int = BATCH,
    advance: Callable[[float], None] | None = None,
) -> Iterator[Streams]:
    """The streams of a bag (`.bag`, `.mcap`, `.db3` or a ROS 2 folder) piece by piece, each reading and pose once, in
    the order in which they were recorded. A piece has `batch` readings or poses, and up to a chunk of the file more.

    The wrench is `geometry_msgs/WrenchStamped` or `Wrench`. The pose is a `PoseStamped`, a `TransformStamped` (child in
    header frame) or a `nav_msgs/Odometry` (child in header frame); with `frames` (base, flange) the chain of tf
    between them (transforms.py says at which times); with `arm` its `sensor_msgs/JointState`, which gives no position.
    One topic of each is found by itself; where there are more, `wrench_topic` and `pose_topic` name them. Times are
    those of the headers; of a message without one, or with a stamp of zero, the time at which it was recorded.
    `advance` is told the part, 0 to 1, of the bag's duration that has been read.

    Raises `FileAccessError`, `MissingExtraError` without rosbags, `InputError` where frames and arm are both given,
    and `FileFormatError` for a damaged file, topics that are not there or not one, frames that nothing connects, joints
    that are not the arm's, and quaternions that are none.
    """
    if batch < 1:
        raise InputError(f"batch is {batch}, expected 1 or more")
    with opened_bag(path) as bag:
        wrench, pose, source, read_poses = _sources(bag, wrench_topic, pose_topic, frames, arm)
        readings: list[tuple[Array, Array]] = []
        placed: list[Poses] = []
        count = poses_count = 0
        for found in messages(bag, (wrench, *pose)):
            if wrench in found:
                readings.append(wrenches(bag, wrench, found[wrench]))
            placed.append(read_poses(found))
            if advance is not None:
                advance(part_read(bag, found))
            poses_count += len(placed[-1].t)
            if max(sum(len(t) for t, _ in readings), sum(len(p.t) for p in placed)) >= batch:
                count += 1
                yield _streams(bag, wrench, source, readings, placed)
                readings, placed = [], []
        if not poses_count:
            raise _no_poses(bag, pose[0], source, arm)
        if readings or placed or not count:
            yield _streams(bag, wrench, source, readings, placed)


def _sources(
    bag: Bag, wrench_name: str | None, pose_name: str | None, frames: tuple[str, str] | None, arm: Arm | None
) -> tuple[Topic, tuple[Topic, ...], str, ReadPoses]:
    """The topic of the wrench, those of the pose, where the pose is from in words, and how it is read."""
    wrench, topics = wrench_topic(bag, wrench_name), pose_topics(bag, pose_name, frames, arm)
    if frames is not None:
        return wrench, topics, f"{frames[0]} -> {frames[1]}", _poses_of_frames(bag, topics, frames)
    if arm is not None:
        return wrench, topics, f"{topics[0].name} of {arm.name}", _poses_of_arm(bag, topics[0], arm)
    return wrench, topics, topics[0].name, _poses_of_topic(bag, topics[0])


def _poses_of_topic(bag: Bag, topic: Topic) -> ReadPoses:
    seen: dict[str, None] = {}

    def read(found: Messages) -> Poses:
        if topic not in found:
            return _NO_POSES
        placements, frames = poses(bag, topic, found[topic])
        seen.update(dict.fromkeys(frames))
        if len(seen) > 1:
            one, other, *_ = seen
            raise FileFormatError(
                f"{bag.path}: topic {topic.name}: found poses of {one} and of {other}, expected one: name another "
                f"topic with {POSE_FLAG}"
            )
        return Poses(placements.t, rotations(bag, f"topic {topic.name}", placements), placements.position)

    return read


def _poses_of_frames(bag: Bag, topics: tuple[Topic, ...], frames: tuple[str, str]) -> ReadPoses:
    way = chain(bag, tree(bag, topics), *frames)
    heard = Heard({})

    def read(found: Messages) -> Poses:
        nonlocal heard
        for topic in topics:
            if topic in found:
                heard = hear(heard, transforms(bag, topic, found[topic]), way.moving)
        stated, heard = composed(bag, way, hear(heard, {}, way.moving))
        return stated

    return read


def _poses_of_arm(bag: Bag, topic: Topic, arm: Arm) -> ReadPoses:
    def read(found: Messages) -> Poses:
        if topic not in found:
            return _NO_POSES
        states = list(joint_states(bag, topic, found[topic]))
        t, joints = np.empty(len(found[topic])), np.full((len(found[topic]), len(arm)), np.nan)
        known = np.zeros(len(found[topic]), dtype=bool)
        for rows, times, names, position in states:
            places = joint_places(names, arm)
            if places is not None and max(places) < position.shape[1]:
                t[rows], joints[rows], known[rows] = times, position[:, places], True
        if not np.isfinite(joints[known]).all():
            row = int(np.argmax(known & ~np.isfinite(joints).all(axis=1)))
            raise FileFormatError(f"{place(bag, topic, t[row])}: found a joint that is no number, expected angles, rad")
        return Poses(t[known], flange_orientation(arm, joints[known]), None)

    return read


def _no_poses(bag: Bag, topic: Topic, source: str, arm: Arm | None) -> FileFormatError:
    """The error for topics with messages in which there is no pose."""
    if arm is None:
        return FileFormatError(
            f"{bag.path}: found no time at which all transforms of {source} are known, expected some: name other "
            f"frames with {FRAMES_FLAG}"
        )
    first = next(messages(bag, (topic,)))[topic]
    names = dict.fromkeys(name for _, _, names, _ in joint_states(bag, topic, first) for name in names)
    expected = ", ".join(arm.joint_names) or f"{len(arm)} numbered joints"
    return FileFormatError(
        f"{bag.path}: topic {topic.name}: found the joints {shortened(names) or 'without names'}, expected those of "
        f"{arm.name} ({expected}): name the arm's URDF with {ROBOT_FLAG}"
    )


_NO_POSES = Poses(np.empty(0), np.empty((0, 3, 3)), None)


def _streams(bag: Bag, wrench: Topic, source: str, readings: list[tuple[Array, Array]], placed: list[Poses]) -> Streams:
    some = [p for p in placed if len(p.t)] or [_NO_POSES]
    positions = [p.position for p in some if p.position is not None]
    return Streams(
        WrenchStream(
            np.concatenate([np.empty(0), *(t for t, _ in readings)]),
            np.concatenate([np.empty((0, 6)), *(values for _, values in readings)]),
            f"{bag.path} {wrench.name}",
        ),
        OrientationStream(
            np.concatenate([p.t for p in some]),
            np.concatenate([p.R_base_flange for p in some]),
            np.concatenate(positions) if positions else None,
            f"{bag.path} {source}",
        ),
    )
