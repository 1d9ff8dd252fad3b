"""What messages of a bag say: stamps, wrenches, poses, transforms and joint angles, many at once.

A message's time is the stamp in its header; without one, or where that is zero, or cannot be and is accepted, the time
at which it was put into the bag. A driver may order an arm's joints as it likes, and report a gripper's with them, so
names decide: those of the URDF; of a known arm, those that its drivers use.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ...assess.robot_arms import Arm
from ...errors import FileFormatError, InputError
from ...geometry.arrays import Array, Rows, column
from ...geometry.orientation import from_quat_xyzw
from .chunks import Logged, Topic
from .message_layout import MessageLayout, Raw, layout_of_message, written
from .open import Bag, definitions, hold_digests, seconds, two_of

WRENCHES = {"geometry_msgs/msg/WrenchStamped": "wrench.", "geometry_msgs/msg/Wrench": ""}
"""Types that hold a wrench, and where in them it is."""

ACCELERATIONS = {
    "sensor_msgs/msg/Imu": "linear_acceleration.",
    "geometry_msgs/msg/AccelStamped": "accel.linear.",
    "geometry_msgs/msg/Vector3Stamped": "vector.",
}
"""Types that hold an acceleration, and where in them it is."""

POSES = {
    "geometry_msgs/msg/PoseStamped": ("pose.orientation", "pose.position"),
    "geometry_msgs/msg/TransformStamped": ("transform.rotation", "transform.translation"),
    "nav_msgs/msg/Odometry": ("pose.pose.orientation", "pose.pose.position"),
}
"""Types that hold the pose of one frame in another, and where in them its orientation and position are."""

TRANSFORMS = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
ANOTHER_CLOCK = 1e6
"""s: stamps so far from when their messages were put into the bag are those of a clock that began at 0."""
JOINT_STATE = "sensor_msgs/msg/JointState"

STAMP = ("stamp.sec", "stamp.nanosec")
"""Where in a header its stamp is."""
CDR = "cdr"
"""How messages of ROS 2 are written."""
COMPARED = 10**7
"""Messages times layouts of what is taken at once: 3,000 messages may be all different."""
MOST_CHANGES = 10
"""Of a sensor's frame in so many messages as are read at once: a driver that is started anew may change it."""
STAMP_ENDS = 12
"""Bytes of a message up to the end of its header's stamp."""

Link: TypeAlias = tuple[str, str]
"""Parent and child."""

FORCE_TORQUE = tuple(f"{part}.{axis}" for part in ("force", "torque") for axis in "xyz")
XYZW, XYZ = tuple("xyzw"), tuple("xyz")


@dataclass(frozen=True, eq=False)
class Placements(Rows):
    """Placements of one frame in another at times `t` (n,) s: `quat_xyzw` (n, 4) as written, `position` (n, 3) m."""

    t: Array = field(metadata=column())
    quat_xyzw: Array = field(metadata=column(4))
    position: Array = field(metadata=column(3))


def by_layout(bag: Bag, topic: Topic, logged: Logged) -> Iterator[tuple[NDArray[np.intp], MessageLayout, Raw]]:
    """The messages by layout: rows, the layout and the messages; without those that are none, where damage is accepted.
    Raises `FileFormatError` naming topic and time.
    """
    forms = {str(c.details.get("serialization_format") or CDR) for c in bag.connections if c.topic == topic}
    if forms - {CDR}:
        raise FileFormatError(f"{bag.path}: topic {topic.name}: found messages in {min(forms - {CDR})}, expected {CDR}")
    types = definitions(bag, topic)
    if bag.ros1:
        hold_digests(bag, topic, types)
    compared = 0
    for length in dict.fromkeys(logged.raw.length.tolist()):
        rows = np.flatnonzero(logged.raw.length == length)
        while len(rows):
            t = float(seconds(logged.stamp[rows[0]]))
            compared += len(logged)
            if compared > COMPARED:
                raise FileFormatError(
                    f"{place(bag, topic, t)}: found no messages alike in texts and lengths, expected most to be"
                )
            try:
                layout = layout_of_message(logged.raw.message(int(rows[0])), topic.type, types, not bag.ros1)
            except InputError as error:
                found, _, expected = str(error).removeprefix("found ").partition(", expected ")
                bag.damage.found(f"{found} in topic {topic.name}, at {t - bag.start:.3f} s", expected)
                rows = rows[1:]
                continue
            fitting = layout.fits(logged.raw[rows])
            yield rows[fitting], layout, logged.raw[rows[fitting]]
            rows = rows[~fitting]


def place(bag: Bag, topic: Topic, t: float) -> str:
    """File, topic and time, for a message."""
    return f"{bag.path}: topic {topic.name}, at {t - bag.start:.3f} s"


def stamps(
    bag: Bag, topic: Topic, logged: Logged, rows: NDArray[np.intp], layout: MessageLayout, raw: Raw, at: str = ""
) -> Array:
    """The times (k,) s of messages of one layout: of the header behind `at`, else of the bag."""
    of_bag = seconds(logged.stamp[rows])
    if f"{at}header.{STAMP[0]}" not in layout.numbers:
        return of_bag
    sec, ns = (raw.values(layout, f"{at}header.{part}")[:, 0] for part in STAMP)
    return _of_header(bag, topic, sec, ns, of_bag)


def _of_header(bag: Bag, topic: Topic, sec: Array, ns: Array, of_bag: Array) -> Array:
    """The times (k,) s that headers state; those of the bag where they are zero, unless others' clock began at 0."""
    impossible = (sec < 0.0) | (ns < 0.0) | (ns >= 1e9)
    if impossible.any():
        row = int(np.argmax(impossible))
        bag.damage.found(
            f"{np.sum(impossible)} stamps in headers of {topic.name} as that of {sec[row]:.0f} s and {ns[row]:.0f} ns",
            "0 s or more and less than 10^9 ns",
        )
    stated = sec + 1e-9 * ns
    off = np.abs(stated - of_bag)[~impossible & (stated > 0.0)]
    zero = (stated == 0.0) & (float(np.median(off)) < ANOTHER_CLOCK if len(off) else True)
    kinds = [] if zero.sum() == 1 else map(str, np.unique(zero))
    if topic.type not in TRANSFORMS and two_of(bag, topic, "stamps", kinds):
        bag.damage.doubt(
            f"{topic.name} has stamps of zero and others: where they are zero, the time of recording counts"
        )
    return np.where(impossible | zero, of_bag, stated)


def header_stamps(bag: Bag, topic: Topic, logged: Logged) -> Array:
    """The times (n,) s of messages that begin with a header, whatever follows: its stamp is at bytes 4 to 12."""
    t, cdr = seconds(logged.stamp), not bag.ros1
    whole = np.flatnonzero(logged.raw.length >= STAMP_ENDS)
    sec_kind = "i4" if cdr else "u4"  # ROS 2 counts seconds with a sign
    is_big_endian = logged.raw[whole].bytes_at(0, 2)[:, 1] == 0 if cdr else np.zeros(len(whole), dtype=bool)
    for rows, order in ((whole[~is_big_endian], "<"), (whole[is_big_endian], ">")):
        sec, ns = (logged.raw[rows].bytes_at(at, 4).view(order + kind)[:, 0] for at, kind in ((4, sec_kind), (8, "u4")))
        t[rows] = _of_header(bag, topic, sec.astype(np.float64), ns.astype(np.float64), t[rows])
    return t


def numbers(
    bag: Bag, topic: Topic, logged: Logged, paths: tuple[str, ...]
) -> tuple[Array, Array, list[tuple[NDArray[np.intp], dict[str, str]]]]:
    """Times (n,) s, the numbers at `paths` (n, k), and by rows their texts. Raises `FileFormatError` as `by_layout`."""
    t, values, texts = np.full(len(logged), np.nan), np.empty((len(logged), len(paths))), []
    for rows, layout, raw in by_layout(bag, topic, logged):
        missing = [path for path in paths if path not in layout.numbers]
        if missing:
            raise FileFormatError(
                f"{bag.path}: topic {topic.name}: found {written(topic.type)} without {missing[0]}, expected the type "
                "of that name in ROS"
            )
        t[rows] = stamps(bag, topic, logged, rows, layout, raw)
        values[rows] = raw.columns(layout, paths)
        texts.append((rows, layout.texts))
    whole = ~np.isnan(t)
    return t[whole], values[whole], texts


def wrenches(bag: Bag, topic: Topic, logged: Logged) -> tuple[Array, Array]:
    """Times (n,) s and wrenches (n, 6) N and N m, as written. Raises `FileFormatError` for two sensors in turn."""
    t, values, texts = numbers(bag, topic, logged, tuple(WRENCHES[topic.type] + path for path in FORCE_TORQUE))
    frames = [_frame(text.get("header.frame_id", "")) or "no frame" for _, text in texts]
    if frames and (two := two_of(bag, topic, "readings", frames)):
        in_order = np.argsort(np.concatenate([rows for rows, _ in texts]))
        of = np.repeat(frames, [len(rows) for rows, _ in texts])[in_order]
        both = f"readings of {' and of '.join(two)}"
        if np.sum(of[1:] != of[:-1]) > MOST_CHANGES:
            raise FileFormatError(
                f"{bag.path}: topic {topic.name}: found {both} in turn, expected one sensor's: record each on a topic "
                "of its own"
            )
        bag.damage.doubt(f"{topic.name} has {both}: are these two sensors? all count as one's")
    return t, values


def poses(bag: Bag, topic: Topic, logged: Logged) -> tuple[Placements, list[Link]]:
    """The poses of a topic of `POSES`, and of which frames: parent and child, empty where the messages name none."""
    orientation, position = POSES[topic.type]
    paths = (*(f"{position}.{part}" for part in XYZ), *(f"{orientation}.{part}" for part in XYZW))
    t, values, texts = numbers(bag, topic, logged, paths)
    frames = [(_frame(text.get("header.frame_id", "")), text.get("child_frame_id", "")) for _, text in texts]
    return Placements(t, values[:, 3:], values[:, :3]), frames


def transforms(bag: Bag, topic: Topic, logged: Logged) -> dict[Link, Placements]:
    """The transforms of a topic: the placement of each child in its parent, by (parent, child), in their order."""
    parts: dict[Link, list[tuple[NDArray[np.intp], Placements]]] = {}
    for rows, layout, raw in by_layout(bag, topic, logged):
        for at in _transforms_in(layout):
            link = (_frame(layout.texts[f"{at}header.frame_id"]), _frame(layout.texts[f"{at}child_frame_id"]))
            t = stamps(bag, topic, logged, rows, layout, raw, at)
            quat = raw.columns(layout, [f"{at}transform.rotation.{part}" for part in XYZW])
            position = raw.columns(layout, [f"{at}transform.translation.{part}" for part in XYZ])
            parts.setdefault(link, []).append((rows, Placements(t, quat, position)))
    in_order = {}
    for link, some in parts.items():
        order = np.argsort(np.concatenate([rows for rows, _ in some]), kind="stable")
        in_order[link] = Placements.concatenate([placements for _, placements in some]).select(order)
    return in_order


def _transforms_in(layout: MessageLayout) -> list[str]:
    """What comes before the names of each transform's fields."""
    ends = [path.removesuffix("child_frame_id") for path in layout.texts if path.endswith("child_frame_id")]
    return [at for at in ends if f"{at}header.frame_id" in layout.texts]


def _frame(name: str) -> str:
    """A frame without the slash that ROS 1's first tf put before it."""
    return name.removeprefix("/")


def joint_states(bag: Bag, topic: Topic, logged: Logged) -> Iterator[tuple[NDArray[np.intp], Array, list[str], Array]]:
    """Rows, times (k,) s, joint names and positions (k, j), for messages that name the same joints."""
    for rows, layout, raw in by_layout(bag, topic, logged):
        names = [text for path, text in layout.texts.items() if path.startswith("name.")]
        yield rows, stamps(bag, topic, logged, rows, layout, raw), names, raw.values(layout, "position")


def rotations(bag: Bag, what: str, placements: Placements) -> Array:
    """Rotations (n, 3, 3). Raises `FileFormatError` naming `what` and the time of the first quaternion that is none."""
    try:
        return from_quat_xyzw(placements.quat_xyzw)
    except InputError as error:
        row = error.row or 0
        fault = str(error).removeprefix(f"orientation {row} is ")
        raise FileFormatError(f"{bag.path}: {what}, at {placements.t[row] - bag.start:.3f} s: found {fault}") from None


NO_PLACEMENTS = Placements(np.empty(0), np.empty((0, 4)), np.empty((0, 3)))

UNIVERSAL_ROBOTS = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
"""In the order of the arm; a driver adds `_joint` behind and may put a robot's name before."""


def joint_places(names: Sequence[str], arm: Arm) -> list[int] | None:
    """Where in `names` the arm's joints are; None where they are not all there, or could be more than one arm's. Joints
    without recognised names are the arm's, in their order, if there are as many.
    """
    if arm.joint_names:
        return _all_of([names.index(name) if name in names else None for name in arm.joint_names])
    sets = [places for places in (*_numbered(names, len(arm)), *_named(names, len(arm))) if places is not None]
    if sets:
        return sets[0] if len(sets) == 1 else None
    return list(range(len(arm))) if len(names) in (0, len(arm)) else None


def _numbered(names: Sequence[str], count: int) -> list[list[int] | None]:
    """Sets of joints whose names are the same but for a number at the end, from 1 to `count` or from 0."""
    by_stem: dict[str, dict[int, int]] = {}
    for place, name in enumerate(names):
        if match := re.fullmatch(r"(.*?)(\d+)", name):
            by_stem.setdefault(match[1], {})[int(match[2])] = place
    runs = list(range(1, count + 1)), list(range(count))
    return [[numbers[k] for k in sorted(numbers)] for numbers in by_stem.values() if sorted(numbers) in runs]


def _named(names: Sequence[str], count: int) -> list[list[int] | None]:
    """Sets of joints named as those of Universal Robots' arms, whatever is put before."""
    if count != len(UNIVERSAL_ROBOTS):
        return []
    ends = [re.compile(f"(.*){part}(_joint)?") for part in UNIVERSAL_ROBOTS]
    places = [{m[1]: k for k, name in enumerate(names) if (m := end.fullmatch(name))} for end in ends]
    return [_all_of([place.get(prefix) for place in places]) for prefix in places[0]]


def _all_of(places: Sequence[int | None]) -> list[int] | None:
    known = [place for place in places if place is not None]
    return known if len(known) == len(places) else None
