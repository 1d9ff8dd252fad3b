"""Which topics of a bag give the wrench and the pose: those of the right type, if there is one of each."""

from __future__ import annotations

import re

from ...assess.robot_arms import Arm
from ...errors import FileFormatError, InputError, some_of
from ..tables.names import NOT_MEASURED
from .chunks import Topic
from .message_layout import written
from .messages import JOINT_STATE, POSES, TRANSFORMS, WRENCHES
from .open import Bag
from .transforms import STATIC, tree

WRENCH_FLAG, POSE_FLAG, FRAMES_FLAG, ROBOT_FLAG = "--wrench-topic", "--pose-topic", "--frames", "--robot"
IMU_FLAG = "--imu"


def wrench_topic(bag: Bag, name: str | None) -> Topic:
    """The topic of that name, or the only one with a wrench. Raises `FileFormatError` naming those there are."""
    return _chosen(bag, name, "a wrench", tuple(WRENCHES), WRENCH_FLAG, "the sensor's readings")


def pose_topics(bag: Bag, name: str | None, frames: tuple[str, str] | None, arm: Arm | None) -> tuple[Topic, ...]:
    """The topic of that name, or the only one with poses: with `frames` all that hold transforms, with `arm` the joint
    states. Raises `InputError` where these do not go together, and `FileFormatError` naming the topics there are.
    """
    if frames is not None and arm is not None:
        raise InputError(f"found {FRAMES_FLAG} and {ROBOT_FLAG}, expected one of them: the pose has one source")
    if frames is not None:
        return _transform_topics(bag, name)
    if arm is not None:
        return (_chosen(bag, name, "joint states", (JOINT_STATE,), POSE_FLAG, "the arm's joints"),)
    if name is not None:
        topic = named_topic(bag, name, (*POSES, JOINT_STATE, *TRANSFORMS), POSE_FLAG)
        if topic.type not in POSES:
            raise _flag_is_missing(bag, (topic,))
        return (topic,)
    if not _with_messages(bag, tuple(POSES)) and (others := _with_messages(bag, (JOINT_STATE, *TRANSFORMS))):
        raise _flag_is_missing(bag, others)
    return (_chosen(bag, None, "poses", tuple(POSES), POSE_FLAG, "the arm's pose"),)


def other_poses(bag: Bag) -> tuple[str, ...]:
    """The topics that tell an arm's pose to who knows its frames, or its joints."""
    topics = _with_messages(bag, (JOINT_STATE, *TRANSFORMS))
    return tuple(topic.name for topic in topics if not topic.name.endswith(STATIC))


def _transform_topics(bag: Bag, name: str | None) -> tuple[Topic, ...]:
    if name is None:
        return _recorded(bag, TRANSFORMS, f"for {FRAMES_FLAG}")
    asked = named_topic(bag, name, (*TRANSFORMS, "geometry_msgs/msg/TransformStamped"), POSE_FLAG)
    others = (topic for topic in _with_messages(bag, TRANSFORMS) if topic.name.endswith(STATIC) and topic != asked)
    return asked, *others


def named_topic(bag: Bag, name: str, types: tuple[str, ...], option: str) -> Topic:
    """The topic of that name, of one of those types. Raises `FileFormatError` naming those there are, and `option`."""
    same_name = [topic for topic in bag.counts if topic.name in (name, f"/{name}")]
    if not same_name:
        raise FileFormatError(f"{bag.path}: found no topic {name}, expected one of {_listed(bag)}: {option}")
    right = [topic for topic in same_name if topic.type in types]
    if not right:
        raise FileFormatError(
            f"{bag.path}: topic {name} is {written(same_name[0].type)}, expected {_types(types)}: name another with "
            f"{option}"
        )
    recorded = [topic for topic in right if bag.counts[topic]]
    if len(recorded) != 1:
        found = f"is {' and '.join(written(each.type) for each in recorded)}" if recorded else "has no messages"
        expected = "one type" if recorded else "some"
        raise FileFormatError(f"{bag.path}: topic {name} {found}, expected {expected}: name another with {option}")
    return recorded[0]


def _chosen(bag: Bag, name: str | None, what: str, types: tuple[str, ...], option: str, content: str) -> Topic:
    """The topic of that name, or the only one with messages of these types."""
    if name is not None:
        return named_topic(bag, name, types, option)
    recorded = _recorded(bag, types, f"with {content}")
    if len(recorded) > 1:
        listed = ", ".join(f"{topic.name} ({written(topic.type)}, {bag.counts[topic]} messages)" for topic in recorded)
        measured = [t for t in recorded if NOT_MEASURED.isdisjoint(re.findall("[a-z]+", t.name.lower()))]
        raise FileFormatError(
            f"{bag.path}: found {len(recorded)} topics with {what}: {listed}, expected one: choose with {option} "
            f"{(measured or recorded)[0].name}"
        )
    return recorded[0]


def _flag_is_missing(bag: Bag, topics: tuple[Topic, ...]) -> FileFormatError:
    """The error for a pose that can be had from `topics`, with an option that was not given."""
    advice = []
    if any(topic.type == JOINT_STATE for topic in topics):
        advice.append(f"name the arm of the joint states with {ROBOT_FLAG} NAME or ARM.urdf")
    if any(topic.type in TRANSFORMS for topic in topics):
        links = tree(bag, _with_messages(bag, TRANSFORMS))
        frames = some_of(sorted({frame for link in links for frame in link}))
        advice.append(f"name two frames of the transforms with {FRAMES_FLAG} BASE,FLANGE (found {frames})")
    return FileFormatError(
        f"{bag.path}: found {' and '.join(str(topic) for topic in topics)}, expected to be told how the pose follows: "
        f"{', or '.join(advice)}"
    )


def _recorded(bag: Bag, types: tuple[str, ...], which: str) -> tuple[Topic, ...]:
    """All topics of these types with messages. Raises `FileFormatError` where there is none."""
    recorded = _with_messages(bag, types)
    if not recorded:
        raise FileFormatError(
            f"{bag.path}: found no topic of type {_types(types)} with messages, expected one {which} (found "
            f"{_listed(bag)})"
        )
    return recorded


def _with_messages(bag: Bag, types: tuple[str, ...]) -> tuple[Topic, ...]:
    return tuple(topic for topic, count in bag.counts.items() if topic.type in types and count)


def _types(types: tuple[str, ...]) -> str:
    names = [written(name) for name in types if name != TRANSFORMS[1]]
    return " or ".join([", ".join(names[:-1]), names[-1]]) if len(names) > 1 else names[0]


def _listed(bag: Bag) -> str:
    return some_of(str(topic) for topic in bag.counts) or "no topic"
