"""Streams from bags: what rosbags and the mcap package wrote comes out again, whatever the format."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.world import Array
from contactwrench.recording.bags import bag_batches, bag_streams
from contactwrench.streams import Streams

from tests import ros_bags
from tests.ros_bags import KINDS, recording, write_bag, write_mcap

TIME = 5e-7
"""s: a Unix time as float64 is known to 2e-7 s."""


def _same(streams: Streams, wrench: Array, R: Array, position: Array | None, every: int = 10) -> None:
    start = 1e-9 * ros_bags.START
    np.testing.assert_array_equal(streams.wrench.wrench, wrench)
    np.testing.assert_allclose(streams.wrench.t - start, 1e-3 * np.arange(len(wrench)), atol=TIME)
    np.testing.assert_allclose(streams.orientation.t - start, 1e-3 * every * np.arange(len(R)), atol=TIME)
    np.testing.assert_allclose(streams.orientation.R_base_flange, R, atol=1e-14)
    if position is None:
        assert streams.orientation.position is None
    else:
        np.testing.assert_array_equal(streams.orientation.position, position)


@pytest.mark.parametrize("kind", KINDS)
def test_what_rosbags_wrote_comes_out_again(tmp_path: Path, kind: str) -> None:
    messages, wrench, R, position = recording(3000)
    path = write_bag(tmp_path / f"run{kind}", messages)
    streams = bag_streams(path)
    _same(streams, wrench, R, position)
    assert streams.wrench.source == f"{path} /wrench"
    assert streams.orientation.source == f"{path} /pose"


@pytest.mark.parametrize(
    ("kind", "compression"), [(".bag", "bz2"), (".bag", "lz4"), ("", "storage"), ("", "message"), ("", "file")]
)
def test_compressed_bags_come_out_again(tmp_path: Path, kind: str, compression: str) -> None:
    messages, wrench, R, position = recording(300)
    _same(bag_streams(write_bag(tmp_path / f"run{kind}", messages, compression=compression)), wrench, R, position)


MCAP_OPTIONS: dict[str, dict[str, Any]] = {
    "as it comes": {},
    "lz4": {"compression": "LZ4"},
    "zstd": {"compression": "ZSTD"},
    "small chunks": {"chunk_size": 1000},
    "no chunks": {"use_chunking": False},
    "no index": {"index_types": "NONE"},
    "no index of messages": {"index_types": "CHUNK"},
    "big endian": {"big_endian": True},
    "no statistics": {"use_statistics": False},
    "nothing repeated": {"repeat_channels": False, "repeat_schemas": False, "use_statistics": False},
    "sums": {"enable_crcs": True, "enable_data_crcs": True},
}


@pytest.mark.parametrize("options", MCAP_OPTIONS.values(), ids=MCAP_OPTIONS)
def test_what_the_mcap_package_wrote_comes_out_again(tmp_path: Path, options: dict[str, Any]) -> None:
    mcap = pytest.importorskip("mcap.writer", reason="mcap is not installed")
    options = {"compression": "NONE"} | options
    if options["compression"] == "ZSTD":
        pytest.importorskip("zstandard", reason="zstandard is not installed")
    options["compression"] = mcap.CompressionType[options["compression"]]
    if "index_types" in options:
        options["index_types"] = mcap.IndexType[options["index_types"]]
    messages, wrench, R, position = recording(300)
    _same(bag_streams(write_mcap(tmp_path / "run.mcap", messages, **options)), wrench, R, position)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("batch", [1, 700, 10**6])
def test_batches_are_the_whole(tmp_path: Path, kind: str, batch: int) -> None:
    messages, wrench, R, position = recording(20_000 if kind == ".bag" else 12_000)
    path = write_bag(tmp_path / f"run{kind}", messages)
    batches = list(bag_batches(path, batch=batch))
    assert (len(batches) > 1) == (batch < 10**6)
    assert all(one.wrench.t[-1] < other.wrench.t[0] for one, other in pairwise(batches))
    np.testing.assert_array_equal(np.concatenate([one.wrench.wrench for one in batches]), wrench)
    _same(bag_streams(path), wrench, R, position)
    np.testing.assert_allclose(np.concatenate([one.orientation.R_base_flange for one in batches]), R, atol=1e-14)
