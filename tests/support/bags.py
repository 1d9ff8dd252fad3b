"""Bags that rosbags or the mcap package write, for tests: messages as nested dictionaries of what differs from zero."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from contactwrench.recording.bags.read import bag_batches
from contactwrench.recording.options import Options
from contactwrench.samples.samples import Streams
from tests.support.world import Array

pytest.importorskip("rosbags", reason="rosbags is not installed")

from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

ROS1, ROS2 = get_typestore(Stores.ROS1_NOETIC), get_typestore(Stores.ROS2_JAZZY)
ROS1.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", "tf2_msgs/msg/TFMessage"))

WRENCH_STAMPED, WRENCH = "geometry_msgs/msg/WrenchStamped", "geometry_msgs/msg/Wrench"
POSE_STAMPED, TRANSFORM_STAMPED = "geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/TransformStamped"
ODOMETRY, JOINT_STATE, TF = "nav_msgs/msg/Odometry", "sensor_msgs/msg/JointState", "tf2_msgs/msg/TFMessage"
STRING = "std_msgs/msg/String"

KINDS = (".bag", ".mcap", ".db3", "")
"""By suffix; nothing: a ROS 2 folder."""

START = 1_700_000_000_000_000_000
"""ns: recordings have Unix times."""


@dataclass(frozen=True)
class Message:
    """A message with the bag's own stamp, ns."""

    topic: str
    type: str
    stamp: int
    fields: dict[str, Any]


def bag_streams(path: str | Path, **arguments: Any) -> Streams:
    """The whole of a bag; arguments as of `Options`."""
    (streams,) = bag_batches(path, Options(**arguments), sys.maxsize)
    return streams


def ns(t: float) -> int:
    return START + round(1e9 * t)


def header(t: float | None, frame: str = "") -> dict[str, Any]:
    """A header with the stamp `t` s after the start; None: a stamp of zero."""
    stamp = 0 if t is None else ns(t)
    return {"stamp": {"sec": stamp // 10**9, "nanosec": stamp % 10**9}, "frame_id": frame}


def vector(values: Iterable[float]) -> dict[str, float]:
    return dict(zip("xyzw", map(float, values), strict=False))


def wrench_fields(wrench: Array) -> dict[str, Any]:
    return {"force": vector(wrench[:3]), "torque": vector(wrench[3:])}


def quaternion(R: Array) -> dict[str, float]:
    return vector(_quaternion(R.tobytes()))


@lru_cache(maxsize=10_000)
def _quaternion(R: bytes) -> list[float]:
    """Of a matrix by its bytes: tests write the same poses again and again, and scipy is slow with a single one."""
    xyzw: list[float] = Rotation.from_matrix(np.frombuffer(R).reshape(3, 3)).as_quat().tolist()
    return xyzw


def wrench_stamped(t: float, wrench: Array, topic: str = "/wrench", frame: str = "ft_sensor") -> Message:
    return Message(topic, WRENCH_STAMPED, ns(t), {"header": header(t, frame), "wrench": wrench_fields(wrench)})


def pose_stamped(t: float, R: Array, position: Array, topic: str = "/pose", frame: str = "base") -> Message:
    fields = {"header": header(t, frame), "pose": {"position": vector(position), "orientation": quaternion(R)}}
    return Message(topic, POSE_STAMPED, ns(t), fields)


def transform(t: float, parent: str, child: str, R: Array, position: Array) -> dict[str, Any]:
    placed = {"translation": vector(position), "rotation": quaternion(R)}
    return {"header": header(t, parent), "child_frame_id": child, "transform": placed}


def tf(t: float, transforms: list[dict[str, Any]], topic: str = "/tf") -> Message:
    return Message(topic, TF, ns(t), {"transforms": transforms})


def joint_state(t: float, names: Sequence[str], position: Iterable[float], topic: str = "/joint_states") -> Message:
    return Message(topic, JOINT_STATE, ns(t), {"header": header(t), "name": list(names), "position": list(position)})


def built(store: Any, msgtype: str, fields: dict[str, Any]) -> Any:
    """A message by rosbags; what `fields` do not name is zero, and what the type does not have is left out."""
    values = {}
    for name, (node, of) in store.fielddefs[msgtype][1]:
        given = fields.get(name)
        if node.name == "NAME":
            values[name] = built(store, of, given or {})
        elif node.name == "BASE":
            values[name] = given if given is not None else ("" if of[0] == "string" else 0)
        else:
            inner, count = of
            if inner[0].name == "NAME":
                values[name] = [built(store, inner[1], one) for one in given or []]
            elif inner[1][0] == "string":
                values[name] = list(given or [])
            else:
                zeros = np.zeros(count if node.name == "ARRAY" else 0, dtype=inner[1][0])
                values[name] = zeros if given is None else np.asarray(given, dtype=inner[1][0])
    return store.types[msgtype](**values)


def serialized(message: Message, *, ros1: bool = False, big_endian: bool = False) -> bytes:
    store = ROS1 if ros1 else ROS2
    one = built(store, message.type, message.fields)
    if ros1:
        return bytes(store.serialize_ros1(one, message.type))
    return bytes(store.serialize_cdr(one, message.type, little_endian=not big_endian))


def write_bag(
    path: Path, messages: Iterable[Message], topics: dict[str, str] | None = None, *, compression: str = ""
) -> Path:
    """Written by rosbags, of the kind that the suffix says; `topics` also without messages; `compression` bz2 or lz4 in
    ROS 1, and in ROS 2 storage, message or file.
    """
    if path.suffix == ".bag":
        writer = Writer1(path)
        if compression:
            writer.set_compression(Writer1.CompressionFormat[compression.upper()])
        _write(writer, ROS1, messages, topics)
        return path
    storage = StoragePlugin.MCAP if path.suffix == ".mcap" or compression == "storage" else StoragePlugin.SQLITE3
    folder = path.with_name(f"{path.stem}_folder") if path.suffix else path
    writer2 = Writer2(folder, version=9, storage_plugin=storage)
    if compression:
        writer2.set_compression(CompressionMode[compression.upper()], CompressionFormat.ZSTD)
    _write(writer2, ROS2, messages, topics)
    if path.suffix:
        (folder / f"{folder.name}{path.suffix}").rename(path)
        shutil.rmtree(folder)
    return path


def _write(writer: Any, store: Any, messages: Iterable[Message], topics: dict[str, str] | None) -> None:
    connections: dict[str, Any] = {}
    with writer:
        for topic, msgtype in (topics or {}).items():
            connections[topic] = writer.add_connection(topic, msgtype, typestore=store)
        for one in messages:
            if one.topic not in connections:
                connections[one.topic] = writer.add_connection(one.topic, one.type, typestore=store)
            writer.write(connections[one.topic], one.stamp, serialized(one, ros1=store is ROS1))


def write_mcap(path: Path, messages: Iterable[Message], *, big_endian: bool = False, **options: Any) -> Path:
    """Written by the mcap package, with ROS 2 definitions and CDR; `options` are of its writer."""
    mcap = pytest.importorskip("mcap.writer", reason="mcap is not installed")
    schemas: dict[str, int] = {}
    channels: dict[str, int] = {}
    with path.open("wb") as file:
        writer = mcap.Writer(file, **options)
        writer.start(profile="ros2", library="mcap")
        for count, one in enumerate(messages):
            if one.type not in schemas:
                text, _ = ROS2.generate_msgdef(one.type, ros_version=2)
                schemas[one.type] = writer.register_schema(one.type, "ros2msg", text.encode())
            if one.topic not in channels:
                channels[one.topic] = writer.register_channel(one.topic, "cdr", schemas[one.type])
            data = serialized(one, big_endian=big_endian)
            writer.add_message(channels[one.topic], one.stamp, data, one.stamp - 5, count)
        writer.finish()
    return path


def any_rotations(n: int, seed: int) -> Array:
    R: Array = Rotation.random(n, random_state=seed).as_matrix()
    return R


def recording(n: int, seed: int = 0, every: int = 10) -> tuple[list[Message], Array, Array, Array]:
    """Readings at 1 kHz and, `every` so many, a pose: the messages, wrenches (n, 6), rotations and positions."""
    rng = np.random.default_rng(seed)
    wrench = rng.normal(size=(n, 6))
    R, position = any_rotations(len(range(0, n, every)), seed), rng.normal(size=(len(range(0, n, every)), 3))
    return list(_in_turn(wrench, R, position, every)), wrench, R, position


def _in_turn(wrench: Array, R: Array, position: Array, every: int) -> Iterator[Message]:
    for k, one in enumerate(wrench):
        if k % every == 0:
            yield pose_stamped(1e-3 * k, R[k // every], position[k // every])
        yield wrench_stamped(1e-3 * k, one)
