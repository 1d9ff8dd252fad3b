"""ROS bags to streams: the wrench and the arm's pose, as they were recorded, in batches of bounded memory."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeAlias

import numpy as np

from ...assess.robot_arms import Arm, flange_pose
from ...errors import FileFormatError, InputError, some_of
from ...files import name_of
from ...geometry.arrays import Array
from ...samples.samples import OrientationStream, Streams, WrenchStream
from ..options import AS_USUAL, IN_BASE_AXES, Options
from ..tables.columns import Advance, unheard
from .chunks import Topic
from .messages import joint_places, joint_states, place, poses, rotations, wrenches
from .open import Bag, Messages, messages, opened_bag, part_read, two_of
from .topics import FRAMES_FLAG, POSE_FLAG, ROBOT_FLAG, other_poses, pose_topics, wrench_topic
from .transforms import ChainPoses

BATCH = 2**16
"""Readings of a batch, and up to a chunk of the bag more."""
TWO_TURNS = 4.0 * np.pi
"""rad: one joint that counts its turns gets further, and two do only in degrees."""
NO_READINGS = np.empty(0), np.empty((0, 6))
NO_POSES = OrientationStream(np.empty(0), np.empty((0, 3, 3)), np.empty((0, 3)))

ReadPoses: TypeAlias = Callable[[Messages], OrientationStream]
"""Of messages that have some of the pose's topics."""


def bag_batches(
    path: str | Path, options: Options = AS_USUAL, batch: int = BATCH, advance: Advance = unheard
) -> Iterator[Streams]:
    """The streams of a bag piece by piece, each reading and pose once, in the order in which they were recorded;
    `batch` of them, and up to a chunk of the file more. Times are as in messages.py.

    The pose is from the only topic of poses or that named, `PoseStamped`, `TransformStamped` or `nav_msgs/Odometry`
    (child in header frame), from the chain of tf between `frames` (transforms.py), or from the `sensor_msgs/JointState`
    of a `robot`. Raises as `opened_bag`, `pose_topics`, `chain` and `rotations`; `InputError` for a wrench in base
    axes, and a `batch` below 1.
    """
    from ..urdf import arm_of

    if options.wrench_frame == "base":
        raise InputError(f"{path}: {IN_BASE_AXES}")
    if batch < 1:
        raise InputError(f"batch is {batch}, expected 1 or more")
    arm, frames = None if options.robot is None else arm_of(options.robot), options.frames
    with opened_bag(path, accept_damaged=options.accept_damaged) as bag:
        wrench = wrench_topic(bag, options.wrench_topic)
        pose = pose_topics(bag, options.pose_topic, frames, arm)
        source, read_poses = _source_of_poses(bag, pose, frames, arm)
        named = {
            "wrench_topic": wrench.name,
            "pose_topic": None if frames else pose[0].name,  # transforms may come in several, all of which are read
            "base_frame": base_frame(bag, pose, frames, arm),
        }
        read_as = options.told({name: value for name, value in named.items() if value is not None})
        readings: list[tuple[Array, Array]] = []
        placed: list[OrientationStream] = []
        poses_count, said = 0, None

        def streams() -> Streams:
            t, values = (np.concatenate(parts) for parts in zip(NO_READINGS, *readings, strict=True))
            poses = OrientationStream.concatenate(placed or [NO_POSES])
            R, position = options.R_base_flange(poses.R_base_flange), np.asarray(poses.position)
            position = np.where(position.any(axis=1, keepdims=True), position, np.nan)  # none is at 0, 0, 0
            sensed = WrenchStream(t, options.pull(values), f"{name_of(bag.path)} {wrench.name}")
            poses = OrientationStream(poses.t, R, position, f"{name_of(bag.path)} {source}")
            return Streams(sensed, poses, read_as, bag.damage.said)

        for part in messages(bag, (wrench, *pose)):
            if wrench in part:
                readings.append(wrenches(bag, wrench, part[wrench]))
            if any(topic in part for topic in pose):
                placed.append(read_poses(part))
                poses_count += len(placed[-1])
            advance(part_read(bag, part))
            if max(sum(len(t) for t, _ in readings), sum(map(len, placed))) >= batch:
                yield streams()
                readings, placed, said = [], [], bag.damage.said
        if not poses_count:
            raise _no_poses(bag, pose[0], source, arm)
        if readings or placed or said != bag.damage.said:
            yield streams()


def pose_in_doubt(path: str | Path, options: Options) -> str:
    """What to say of a bag's only topic of poses, where nobody chose it and the arm's may be told by others, too."""
    if options.pose_topic or options.frames or options.robot:
        return ""
    with opened_bag(path, accept_damaged=options.accept_damaged) as bag:
        (topic,) = pose_topics(bag, None, None, None)
        frame = base_frame(bag, (topic,), None, None)
        others = other_poses(bag)
    which = f"the pose is that of {topic.name}{f' in {frame}' if frame else ''}, and the bag has {some_of(others)}, too"
    return f"{which}: if it is not the arm's, say --frames BASE,FLANGE, or --robot" if others else ""


def _source_of_poses(
    bag: Bag, topics: tuple[Topic, ...], frames: tuple[str, str] | None, arm: Arm | None
) -> tuple[str, ReadPoses]:
    """Where the pose is from, in words, and how it is read."""
    if frames is not None:
        return f"{frames[0]} -> {frames[1]}", ChainPoses(bag, topics, *frames).read
    if arm is not None:
        return f"{topics[0].name} of {arm.name}", _poses_of_arm(bag, topics[0], arm)
    return topics[0].name, _poses_of_topic(bag, topics[0])


def base_frame(bag: Bag, topics: tuple[Topic, ...], frames: tuple[str, str] | None, arm: Arm | None) -> str | None:
    """The frame in which the orientations are: of `frames`, `arm`, or the first message; None: not said."""
    if frames is not None:
        return frames[0].removeprefix("/")
    if arm is not None:
        return arm.base_frame or None
    for part in messages(bag, topics):
        if topics[0] in part:
            for parent, _ in poses(bag, topics[0], part[topics[0]][:1])[1]:
                return parent or None
    return None


def _poses_of_topic(bag: Bag, topic: Topic) -> ReadPoses:
    def read(part: Messages) -> OrientationStream:
        placements, frames = poses(bag, topic, part[topic])
        named = [f"{child or 'a frame'} in {parent or 'no frame'}" for parent, child in frames]
        if two := two_of(bag, topic, "poses", named):
            raise FileFormatError(
                f"{bag.path}: topic {topic.name}: found poses of {' and of '.join(two)}, expected one: name another "
                f"topic with {POSE_FLAG}"
            )
        return OrientationStream(placements.t, rotations(bag, f"topic {topic.name}", placements), placements.position)

    return read


def _poses_of_arm(bag: Bag, topic: Topic, arm: Arm) -> ReadPoses:
    def read(part: Messages) -> OrientationStream:
        count = len(part[topic])
        t, joints, known = np.empty(count), np.full((count, len(arm)), np.nan), np.zeros(count, dtype=bool)
        for rows, times, names, position in joint_states(bag, topic, part[topic]):
            places = joint_places(names, arm)
            if places is not None and max(places) < position.shape[1]:
                t[rows], joints[rows], known[rows] = times, position[:, places], True
                ends = f"{names[places[0]]} to {names[places[-1]]}" if names else "joints without names"
                if two := two_of(bag, topic, "joints", [ends]):
                    raise FileFormatError(
                        f"{bag.path}: topic {topic.name}: found {' and '.join(two)}, expected one arm's: name its URDF "
                        f"with {ROBOT_FLAG}"
                    )
        far = np.abs(joints) > TWO_TURNS
        off = known & (~np.isfinite(joints).all(axis=1) | (far.sum(axis=1) > 1))
        if off.any():
            row = int(np.argmax(off))
            angles = " and ".join(f"{angle:.4g}" for angle in joints[row, far[row]][:2])
            found = f"joints at {angles}" if np.isfinite(joints[row]).all() else "a joint that is no number"
            raise FileFormatError(f"{place(bag, topic, t[row])}: found {found}, expected angles, rad")
        return OrientationStream(t[known], *flange_pose(arm, joints[known]))

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
        f"{bag.path}: topic {topic.name}: found the joints {some_of(names) or 'without names'}, expected those of "
        f"{arm.name} ({expected}): name the arm's URDF with {ROBOT_FLAG}"
    )
