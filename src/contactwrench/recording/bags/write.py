"""ROS bags written by rosbags, with no ROS.

A bag is written into a folder beside its place and then moved there, so that it is whole or not there.
"""

from __future__ import annotations

import os
import sqlite3
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ...errors import FileAccessError, FileFormatError
from ...geometry.arrays import Array
from ...samples.samples import Streams
from .message_layout import MessageLayout, layout_of_message
from .messages import FORCE_TORQUE, POSES, XYZ, XYZW
from .open import SUFFIXES_OF_BAGS, require_rosbags, typestore

WRENCH_STAMPED, POSE_STAMPED = "geometry_msgs/msg/WrenchStamped", "geometry_msgs/msg/PoseStamped"
NUMBERS = {
    WRENCH_STAMPED: tuple(f"wrench.{path}" for path in FORCE_TORQUE),
    POSE_STAMPED: tuple(
        f"{place}.{part}" for place, parts in zip(POSES[POSE_STAMPED], (XYZW, XYZ), strict=True) for part in parts
    ),
}
STAMP = ("header.stamp.sec", "header.stamp.nanosec")
METADATA_VERSION: Final = 8
"""Of a ROS 2 folder: 9 writes the quality of service in another way, which older ROS 2 does not read."""


def write_streams_bag(path: str | Path, streams: Streams) -> None:
    """Write streams as a new bag of the kind that the suffix says, `.bag`, `.mcap` or `.db3`; none: a ROS 2 folder.

    `/wrench` is `geometry_msgs/WrenchStamped` in the frame `sensor`, `/pose` `geometry_msgs/PoseStamped` of the flange
    in the frame `base`, at 0 0 0 where its position is not known; stamps are those of the streams, to the ns. Raises
    `FileAccessError`, `FileFormatError` for another suffix, and `MissingExtraError` without rosbags.
    """
    path = Path(path)
    if path.suffix not in (*SUFFIXES_OF_BAGS, ""):
        raise FileFormatError(f"{path}: found the suffix {path.suffix}, expected .bag, .mcap, .db3, or none: a folder")
    require_rosbags()
    from scipy.spatial.transform import Rotation

    ros1 = path.suffix == ".bag"
    wrench, orientation = streams.wrench, streams.orientation
    position = np.zeros((len(orientation), 3)) if orientation.position is None else orientation.position
    quaternions = Rotation.from_matrix(orientation.R_base_flange).as_quat() if len(orientation) else np.empty((0, 4))
    stamps = [_nanoseconds(wrench.t), _nanoseconds(orientation.t)]
    payloads = [
        stamped(WRENCH_STAMPED, ros1, "sensor", stamps[0], wrench.wrench),
        stamped(POSE_STAMPED, ros1, "base", stamps[1], np.hstack([quaternions, position])),
    ]
    with new_bag(path, path.suffix, mcap=path.suffix == ".mcap") as writer:
        connections = [
            writer.add_connection(topic, msgtype, typestore=typestore(ros1))
            for topic, msgtype in (("/wrench", WRENCH_STAMPED), ("/pose", POSE_STAMPED))
        ]
        every = np.concatenate(stamps)
        for k in np.argsort(every, kind="stable").tolist():
            which, row = (0, k) if k < len(wrench) else (1, k - len(wrench))
            writer.write(connections[which], int(every[k]), payloads[which][row])


@contextmanager
def new_bag(path: Path, kind: str, *, mcap: bool, compression: str = "") -> Iterator[Any]:
    """A writer by rosbags; at the end the bag is moved to `path`, after an error nothing is left.

    `kind`: `.bag`, `.mcap` or `.db3`, a file, or nothing, a folder; `mcap`: what a folder holds, else sqlite3;
    `compression`: bz2 or lz4 of a `.bag`, storage, message or file of ROS 2. Raises `FileAccessError`.
    """
    with new_place(path) as made:
        if kind in (".bag", ""):
            with _writer(made, kind, mcap, compression) as writer:
                yield writer
            return
        folder = made.with_name("folder")  # in which rosbags puts the one file
        with _writer(folder, kind, mcap, compression) as writer:
            yield writer
        (folder / f"{folder.name}{kind}").replace(made)


@contextmanager
def new_place(path: Path) -> Iterator[Path]:
    """Where a file, or a folder of files, is to be made: at the end it is moved to `path`, after an error nothing is
    left. Raises `FileAccessError`.
    """
    target = Path(os.path.realpath(path))
    if target.is_dir():
        raise FileAccessError(f"{path}: found a folder, expected a new name: remove it or name another")
    try:
        with tempfile.TemporaryDirectory(prefix=".contactwrench-", dir=target.parent) as beside:
            made = Path(beside) / target.name
            yield made
            for file in [made] if made.is_file() else sorted(made.iterdir()):
                with file.open("rb+") as written:
                    os.fsync(written.fileno())
            made.replace(target)
    except FileNotFoundError:
        raise FileAccessError(f"{path}: there is no folder {target.parent}: make it first") from None
    except (OSError, sqlite3.Error) as error:
        if isinstance(error, FileAccessError):
            raise
        reason = (getattr(error, "strerror", None) or str(error)).lower()
        raise FileAccessError(
            f"{path}: cannot be written ({reason}): check the space on the disk and the permissions"
        ) from None


def _writer(path: Path, kind: str, mcap: bool, compression: str) -> Any:
    from rosbags import rosbag1, rosbag2

    if kind == ".bag":
        writer1 = rosbag1.Writer(path)
        if compression:
            writer1.set_compression(rosbag1.Writer.CompressionFormat[compression.upper()])
        return writer1
    plugin = rosbag2.StoragePlugin.MCAP if mcap else rosbag2.StoragePlugin.SQLITE3
    writer2 = rosbag2.Writer(path, version=METADATA_VERSION, storage_plugin=plugin)
    if compression:
        writer2.set_compression(rosbag2.CompressionMode[compression.upper()], rosbag2.CompressionFormat.ZSTD)
    return writer2


def stamped(msgtype: str, ros1: bool, frame: str, stamp: NDArray[np.int64], values: Array) -> list[bytes]:
    """Messages of a type of `NUMBERS` with a header: `stamp` (n,) ns, and its numbers (n, k)."""
    template, layout = _template(msgtype, ros1, frame)
    size = len(template)
    block = np.tile(np.frombuffer(template, np.uint8), (len(stamp), 1))
    columns = dict(zip((*STAMP, *NUMBERS[msgtype]), (*np.divmod(stamp, 10**9), *values.T), strict=True))
    for path, column in columns.items():
        offset, kind, _ = layout.numbers[path]
        width = int(kind[-1])
        block[:, offset : offset + width] = column.astype(kind)[:, None].view(np.uint8)
    flat = block.tobytes()
    return [flat[k : k + size] for k in range(0, len(flat), size)]


@cache
def _template(msgtype: str, ros1: bool, frame: str) -> tuple[bytes, MessageLayout]:
    """A message of zeros, and where its numbers are."""
    store = typestore(ros1)

    def zero(name: str) -> Any:
        values = {}
        for field, (node, of) in store.fielddefs[name][1]:
            text = node.name == "BASE" and of[0] == "string"
            values[field] = zero(of) if node.name == "NAME" else frame if text else 0
        return store.types[name](**values)

    serialize = store.serialize_ros1 if ros1 else store.serialize_cdr
    options = {} if ros1 else {"little_endian": True}
    template = bytes(serialize(zero(msgtype), msgtype, **options))
    return template, layout_of_message(template, msgtype, store.fielddefs, not ros1)


def _nanoseconds(t: Array) -> NDArray[np.int64]:
    """Times, s, in whole ns: the nearest of those that a float64 can mean."""
    whole = np.floor(t)
    ns: NDArray[np.int64] = whole.astype(np.int64) * 10**9 + np.rint((t - whole) * 1e9).astype(np.int64)
    return ns
