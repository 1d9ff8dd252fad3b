"""ROS bags written by rosbags, with no ROS."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from struct import pack
from typing import Any, Final
from urllib.parse import quote

import numpy as np
from numpy.typing import NDArray

from ...errors import FileFormatError
from ...files import new_place
from ...geometry.arrays import Array
from ...geometry.orientation import to_quat_xyzw
from ...samples.samples import Streams
from .message_layout import typestore
from .open import SUFFIXES_OF_BAGS, require_rosbags

WRENCH_STAMPED, POSE_STAMPED = "geometry_msgs/msg/WrenchStamped", "geometry_msgs/msg/PoseStamped"
CDR = b"\0\1\0\0"
"""Before a message in CDR: its numbers are little endian."""
METADATA_VERSION: Final = 8
"""Of a ROS 2 folder: 9 writes the quality of service in another way, which older ROS 2 does not read."""


def write_streams_bag(path: str | Path, streams: Streams) -> None:
    """Write streams as a new bag of the kind that the suffix says, `.bag`, `.mcap` or `.db3`; none: a ROS 2 folder.

    `/wrench` is `geometry_msgs/WrenchStamped` in the frame `sensor`, `/pose` `geometry_msgs/PoseStamped` of the flange
    in the frame `base`, at 0 0 0 where its position is not known; stamps are those of the streams, to the ns. A file
    that is there is replaced. Raises `FileAccessError`, `FileFormatError` for another suffix, and `MissingExtraError`.
    """
    path = Path(path)
    kind = path.suffix.lower()
    if kind not in (*SUFFIXES_OF_BAGS, ""):
        raise FileFormatError(f"{path}: found the suffix {path.suffix}, expected .bag, .mcap, .db3, or none: a folder")
    require_rosbags()
    ros1 = kind == ".bag"
    wrench, orientation = streams.wrench, streams.orientation
    position = np.zeros((len(orientation), 3)) if orientation.position is None else orientation.position
    stamps = [nanoseconds(wrench.t), nanoseconds(orientation.t)]
    payloads = [
        stamped(ros1, "sensor", stamps[0], wrench.wrench),
        stamped(ros1, "base", stamps[1], np.hstack([position, to_quat_xyzw(orientation.R_base_flange)])),
    ]
    with new_bag(path, kind, mcap=kind == ".mcap") as writer:
        connections = [
            writer.add_connection(topic, msgtype, typestore=typestore(ros1))
            for topic, msgtype in (("/wrench", WRENCH_STAMPED), ("/pose", POSE_STAMPED))
        ]
        every, first = np.concatenate(stamps), len(wrench)
        for k in np.argsort(every, kind="stable").tolist():
            which, row = (0, k) if k < first else (1, k - first)
            writer.write(connections[which], int(every[k]), payloads[which][row])


@contextmanager
def new_bag(path: Path, kind: str, *, mcap: bool, compression: str = "") -> Iterator[Any]:
    """A writer by rosbags; at the end the bag is moved to `path`, after an error nothing is left. `kind`: a suffix, or
    nothing, a folder, of `mcap` or sqlite3; `compression`: bz2 or lz4 of a `.bag`, storage, message or file of ROS 2.
    """
    from rosbags import rosbag1, rosbag2

    with new_place(path) as made:
        target = made.with_name("folder") if kind in (".mcap", ".db3") else made  # in which rosbags puts the one file
        if kind == ".bag":
            writer: Any = rosbag1.Writer(target)
            if compression:
                writer.set_compression(rosbag1.Writer.CompressionFormat[compression.upper()])
        else:
            plugin = rosbag2.StoragePlugin.MCAP if mcap else rosbag2.StoragePlugin.SQLITE3
            writer = rosbag2.Writer(target, version=METADATA_VERSION, storage_plugin=plugin)
            writer.path = _InUri(target)
            if compression:
                writer.set_compression(rosbag2.CompressionMode[compression.upper()], rosbag2.CompressionFormat.ZSTD)
        try:
            with writer:
                yield writer
        except sqlite3.Error as error:
            raise OSError(str(error)) from None
        if target != made:
            (target / f"{target.name}{kind}").replace(made)


class _InUri(type(Path())):  # type: ignore[misc]
    """A path that is quoted where rosbags puts it into sqlite's URI."""

    def __format__(self, _: str) -> str:
        return quote(bytes(self))


def stamped(ros1: bool, frame: str, stamp: NDArray[np.int64], values: Array) -> list[bytes]:
    """Messages of a header, with `stamp` (n,) ns, and float64 `values` (n, k) behind it: of a `WrenchStamped` force and
    torque, of a `PoseStamped` position and quaternion xyzw. In ROS 1's way of writing, or in CDR (message_layout.py).
    """
    text = frame.encode() + b"\0" * (not ros1)
    head = (bytes(4) if ros1 else CDR) + bytes(8) + pack("<I", len(text)) + text
    head += bytes(0 if ros1 else (len(CDR) - len(head)) % 8)
    size = len(head) + 8 * values.shape[1]
    block = np.tile(np.frombuffer(head.ljust(size, b"\0"), np.uint8), (len(stamp), 1))
    block[:, 4:12] = np.stack(np.divmod(stamp, 10**9), axis=1).astype("<u4").view(np.uint8)
    block[:, len(head) :] = np.ascontiguousarray(values, "<f8").view(np.uint8)
    flat = block.tobytes()
    return [flat[k : k + size] for k in range(0, len(flat), size)]


def nanoseconds(t: Array) -> NDArray[np.int64]:
    """Times, s, in whole ns: the nearest of those that a float64 can mean."""
    whole = np.floor(t)
    return whole.astype(np.int64) * 10**9 + np.rint((t - whole) * 1e9).astype(np.int64)
