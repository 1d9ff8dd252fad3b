"""Bags of ten minutes, 1 kHz of wrench and 100 Hz of pose: seconds to read, to compensate and to copy, and memory."""

from __future__ import annotations

import resource
import sys
import tempfile
import time
import tracemalloc
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

import contactwrench as cw
from contactwrench.recording.bags.copy import write_bag_with
from contactwrench.recording.bags.read import bag_batches
from contactwrench.recording.bags.write import write_streams_bag
from contactwrench.recording.compensate import Treatment, compensated
from contactwrench.recording.options import Options
from contactwrench.samples.samples import OrientationStream, Streams, WrenchStream
from tests.support.world import Array, noisy_readings, random_rotations

from .accuracy import NOISE, TABLE_V
from .table import Row

SECONDS = 600.0
MIB = 2**20


def _recording(seconds: float) -> Streams:
    rng = np.random.default_rng(1)
    t, t_pose = 1.7e9 + np.arange(0.0, seconds, 1e-3), 1.7e9 + np.arange(0.0, seconds, 1e-2)
    R = Rotation.from_euler("xyz", np.outer(t_pose - t_pose[0], [0.3, 0.5, 0.7])).as_matrix()
    nearest = np.minimum(np.arange(len(t)) // 10, len(R) - 1)
    wrench = noisy_readings(TABLE_V, R[nearest], NOISE, rng)
    return Streams(WrenchStream(t, wrench), OrientationStream(t_pose, R, rng.normal(size=(len(R), 3))))


def _calibration() -> cw.Calibration:
    rng = np.random.default_rng(2)
    R = random_rotations(24, rng)
    return cw.calibrate(cw.Samples(noisy_readings(TABLE_V, R, NOISE, rng), R), "mount")


def _compensated(path: Path, calibration: cw.Calibration) -> Iterator[Array]:
    """Each reading with the orientation of its moment, and its std; a reading without one is NaN."""
    return (rows.wrench for rows in compensated(path, Options(), calibration, Treatment()))


def _seconds(action: Iterable[object]) -> float:
    start = time.perf_counter()
    for _ in action:
        pass
    return time.perf_counter() - start


def _by_rosbags(path: Path) -> Iterator[object]:
    """The messages one by one, not decoded."""
    from rosbags import rosbag1, rosbag2

    reader = rosbag1.Reader(path) if path.suffix == ".bag" else rosbag2.Reader(path)
    with reader:
        yield from reader.messages(connections=reader.connections)


def _by_mcap(path: Path) -> Iterator[object]:
    """The messages of an MCAP one by one, not decoded."""
    from mcap.reader import make_reader

    with path.open("rb") as file:
        yield from make_reader(file).iter_messages()


def _memory(path: Path, calibration: cw.Calibration) -> float:
    """Bytes: what Python and numpy allocate for it in batches, or what the process' peak grows by, if more."""
    peak_before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    tracemalloc.start()
    _seconds(_compensated(path, calibration))
    traced = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    unit = 1 if sys.platform == "darwin" else 1024
    return float(max(traced, unit * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - peak_before)))


def _figures(seconds: float) -> Iterator[Row]:
    streams, calibration = _recording(seconds), _calibration()
    share = seconds / SECONDS
    with tempfile.TemporaryDirectory() as folder:
        for kind in (".mcap", ".db3", ".bag"):
            path = Path(folder) / f"run{kind}"
            write_streams_bag(path, streams)
            size = f"{path.stat().st_size / MIB:.0f} MiB"
            read = min(_seconds(bag_batches(path)) for _ in range(3))
            both = min(_seconds(_compensated(path, calibration)) for _ in range(3))
            yield Row(f"{kind}: read", read, "s", most=3.0 * share, remark=size)
            yield Row(f"{kind}: read, on one clock, compensated, with std", both, "s", most=5.0 * share)
            yield Row(f"{kind}: messages by rosbags, not decoded", _seconds(_by_rosbags(path)), "s")
            if kind == ".mcap":
                yield Row(f"{kind}: messages by mcap, not decoded", _seconds(_by_mcap(path)), "s")
            extra = _memory(path, calibration) / MIB
            yield Row(f"{kind}: extra memory of all that", extra, "MiB", most=64.0, remark=f"of {size}")
            start = time.perf_counter()
            write_bag_with(path, path.with_name(f"out{kind}"), _compensated(path, calibration))
            yield Row(f"{kind}: compensated into a copy", time.perf_counter() - start, "s")


def tables(quick: bool) -> Iterator[tuple[str, Iterable[Row]]]:
    """One table; quick: one minute."""
    seconds = SECONDS / 10.0 if quick else SECONDS
    yield f"Bags of {seconds / 60.0:g} min, 1 kHz and 100 Hz", _figures(seconds)
