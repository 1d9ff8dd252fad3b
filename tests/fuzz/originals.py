"""Whole recordings of every kind, whose writer knows how many readings are in them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from tests.support.bags import Message, joint_state, pose_stamped, wrench_stamped, write_bag, write_mcap
from tests.support.brands import GRIPPER, Recorded, stop_and_go
from tests.support.recordings import WRENCH
from tests.support.world import Array

RATE = 10.0
POSE = ("x", "y", "z", "qx", "qy", "qz", "qw")
JOINTS = ("a", "b", "c")
URDF = """<?xml version="1.0"?>
<robot name="wrist">
  <link name="base"/><link name="one"/><link name="two"/><link name="flange"/>
  <joint name="a" type="revolute">
    <parent link="base"/><child link="one"/><origin xyz="0 0 0.3" rpy="0 0 0"/><axis xyz="0 0 1"/>
    <limit lower="-6.3" upper="6.3" velocity="2" effort="100"/>
  </joint>
  <joint name="b" type="revolute">
    <parent link="one"/><child link="two"/><origin xyz="0 0 0.2" rpy="0 0 0"/><axis xyz="0 1 0"/>
    <limit lower="-6.3" upper="6.3" velocity="2" effort="100"/>
  </joint>
  <joint name="c" type="continuous">
    <parent link="two"/><child link="flange"/><origin xyz="0 0 0.1" rpy="0 0 0"/><axis xyz="0 0 1"/>
  </joint>
</robot>
"""


@dataclass(frozen=True)
class Original:
    """A whole input: the file or folder that is given to the program, the file of it that is changed, how many
    readings its writer wrote, and whether what is changed is text.
    """

    name: str
    path: Path
    changed: Path
    readings: int
    text: bool = False

    @property
    def kind(self) -> str:
        """Its name less the variant: ROS 1, MCAP, folder, Parquet."""
        return next((kind for kind in ("ROS 1", "MCAP", "folder", "Parquet") if self.name.startswith(kind)), self.name)


def recorded() -> Recorded:
    """An arm that stops at twelve poses."""
    return stop_and_go(GRIPPER, np.random.default_rng(7), RATE)


def numbers(run: Recorded) -> Array:
    """The rows of a table: t, the wrench, the pose."""
    return np.column_stack([run.t, run.wrench, run.position, run.rotation.as_quat()])


def originals(folder: Path) -> list[Original]:
    """One of every kind, made in `folder`, each in a folder of its own."""
    run = recorded()
    messages = list(messages_of(run))
    made: list[Original] = []

    def place(kind: str) -> Path:
        (folder / kind).mkdir()
        return folder / kind

    def add(kind: str, path: Path, changed: str = "", *, text: bool = False) -> None:
        made.append(Original(kind, path, next(path.glob(changed)) if changed else path, len(run.t), text))

    for kind, compression in {"ROS 1": "", "ROS 1 bz2": "bz2", "ROS 1 lz4": "lz4"}.items():
        add(kind, write_bag(place(kind) / "run.bag", messages, compression=compression))
    for kind, compression in {"MCAP": "NONE", "MCAP lz4": "LZ4", "MCAP zstd": "ZSTD"}.items():
        add(kind, _mcap(place(kind), messages, compression))
    add("sqlite3", write_bag(place("sqlite3") / "run.db3", messages))
    for kind, changed in {"folder sqlite3": "*.db3", "folder metadata": "metadata.yaml"}.items():
        add(kind, write_bag(place(kind) / "run", messages), changed, text=changed.endswith("yaml"))
    add("folder MCAP", write_bag(place("folder MCAP") / "run", messages, compression="storage"), "*.mcap")
    add("folder message", write_bag(place("folder message") / "run", messages, compression="message"), "*.db3")
    add("CSV", _csv(place("CSV"), run), text=True)
    for compression in ("none", "snappy", "zstd"):
        add(f"Parquet {compression}", _parquet(place(f"Parquet {compression}"), run, compression))
    add("HDF5", _hdf5(place("HDF5"), run))
    return made


def joints_bag(folder: Path) -> Path:
    """A bag with joint angles of the arm that `URDF` describes."""
    run = recorded()
    angles = run.rotation.as_euler("ZYZ")
    messages: list[Message] = []
    for k, t in enumerate(run.t):
        messages += [joint_state(t, JOINTS, angles[k]), wrench_stamped(t, run.wrench[k])]
    return write_mcap(folder / "joints.mcap", messages)


def messages_of(run: Recorded) -> list[Message]:
    """A pose and a reading at each moment."""
    messages = []
    for k, t in enumerate(run.t):
        messages += [pose_stamped(t, run.R_base_flange[k], run.position[k]), wrench_stamped(t, run.wrench[k])]
    return messages


def _mcap(place: Path, messages: list[Message], compression: str) -> Path:
    from mcap.writer import CompressionType

    return write_mcap(place / "run.mcap", messages, compression=CompressionType[compression], chunk_size=32_000)


def _csv(place: Path, run: Recorded) -> Path:
    path = place / "run.csv"
    rows = "\n".join(",".join(f"{value:.6f}" for value in row) for row in numbers(run))
    path.write_text(",".join(("t", *WRENCH, *POSE)) + "\n" + rows + "\n")
    return path


def _parquet(place: Path, run: Recorded, compression: str) -> Path:
    path = place / "run.parquet"
    columns = dict(zip(("t", *WRENCH, *POSE), numbers(run).T, strict=True))
    pq.write_table(pa.table(columns), path, compression=compression, row_group_size=300)
    return path


def _hdf5(place: Path, run: Recorded) -> Path:
    path = place / "run.h5"
    with h5py.File(path, "w") as file:
        for name, values in zip(("t", *WRENCH, *POSE), numbers(run).T, strict=True):
            file.create_dataset(name, data=values, chunks=(300,), compression="gzip", fletcher32=name == "t")
    return path


def rows_of_text(content: bytes) -> int:
    """How many rows of numbers a text file has under its header, whatever was done to it: lines with something in them
    that is no comment.
    """
    lines = content.replace(b"\r\n", b"\n").replace(b"\r", b"\n").split(b"\n")
    return sum(bool(line.strip()) and not line.lstrip().startswith(b"#") for line in lines) - 1
