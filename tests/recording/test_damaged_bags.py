"""MCAP files and ROS 1 bags that are damaged, cut off or hostile: nothing is lost in silence, nothing costs much."""

from __future__ import annotations

import re
import struct
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import contactwrench as cw
from contactwrench.errors import ContactWrenchError, FileFormatError, InputError
from contactwrench.recording.bags.copy import write_bag_with
from contactwrench.recording.bags.messages import wrenches
from contactwrench.recording.bags.open import messages, opened_bag
from contactwrench.recording.bags.read import bag_batches
from contactwrench.recording.bags.topics import wrench_topic
from contactwrench.recording.contents import bag_contents
from contactwrench.recording.options import Options
from tests.support.bags import START, Message, bag_streams, header, recording, wrench_fields, write_bag, write_mcap
from tests.support.hostile_bags import HOSTILE_BAGS, HOSTILE_MCAPS, whole_bags
from tests.support.recordings import run
from tests.support.world import Array

WHAT_TO_DO = "the file is damaged; record or copy it again, or read what is left of it with --accept-damaged"
COUNT = 120
MESSAGES, WRENCH, *_ = recording(COUNT)

MCAPS: dict[str, dict[str, Any]] = {
    "chunks": {"chunk_size": 3000, "enable_crcs": False},
    "checksums": {"chunk_size": 3000, "enable_data_crcs": True},
    "no chunks": {"use_chunking": False},
    "no index": {"chunk_size": 3000, "index_types": "NONE"},
}


def _mcap(path: Path, **options: Any) -> Path:
    from mcap.writer import CompressionType, IndexType

    options = {"compression": CompressionType.NONE} | options
    if "index_types" in options:
        options["index_types"] = IndexType[options["index_types"]]
    return write_mcap(path, MESSAGES, **options)


@pytest.fixture(scope="module")
def originals(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[str, bytes]]:
    """Suffix and content of whole files, all with the same messages."""
    folder = tmp_path_factory.mktemp("whole")
    files = {name: _mcap(folder / f"{k}.mcap", **options) for k, (name, options) in enumerate(MCAPS.items())}
    files |= {"lz4": write_bag(folder / "lz4.bag", MESSAGES, compression="lz4")}
    files |= {name: write_bag(folder / f"run{name}", MESSAGES) for name in (".bag", ".mcap")}
    return {name: (file.suffix, file.read_bytes()) for name, file in files.items()}


def _said(path: Path, **arguments: Any) -> str:
    with pytest.raises(ContactWrenchError) as caught:
        bag_streams(path, **arguments)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def _changed(content: bytes, place: int, new: bytes) -> bytes:
    return content[:place] + new + content[place + len(new) :]


def _nth(content: bytes, part: bytes, n: int) -> int:
    """Where the n-th of some bytes starts."""
    return [match.start() for match in re.finditer(re.escape(part), content, re.DOTALL)][n]


def _jumping(content: bytes) -> bytes:
    """The fifth message of the second chunk states more bytes than are left."""
    chunk = [match.start() for match in re.finditer(rb"\x06.{6}\0\0", content, re.DOTALL)][1]
    return _changed(content, content.index(b"\x05\x62\0\0\0\0\0\0\0", chunk) + 1, struct.pack("<Q", 2**20))


def test_a_record_that_jumps_past_the_end_of_its_chunk(tmp_path: Path) -> None:
    """So 786 of 950 readings were once lost without a word."""
    path = _mcap(tmp_path / "run.mcap", chunk_size=3000, enable_crcs=False)
    path.write_bytes(_jumping(path.read_bytes()))
    refused = _said(path)
    assert re.fullmatch(
        rf"{re.escape(str(path))}: found the chunk at byte \d+ broken \(no record at its byte \d+\), expected records "
        rf"one behind the other: {re.escape(WHAT_TO_DO)}",
        refused,
    )
    streams = bag_streams(path, accept_damaged=True)
    assert 0 < len(streams.wrench) < COUNT
    assert streams.damage.endswith("; what was left of it was read")
    assert f"found {len(streams.wrench)} messages of /wrench, expected the {COUNT} it counts" in streams.damage
    assert bag_contents(path).damage.startswith(f"{path} is damaged: found the chunk at byte ")


def _rows_of(read: Array) -> list[int]:
    """Which of the readings written these are; -1: none."""
    places = {row.tobytes(): k for k, row in enumerate(WRENCH)}
    return [places.get(row.tobytes(), -1) for row in np.ascontiguousarray(read)]


WITH_CHECKSUM = ("checksums",)


@settings(max_examples=35, deadline=None)
@given(data=st.data())
def test_damage_anywhere_is_refused_or_said(
    originals: dict[str, tuple[str, bytes]], tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    """The truth is known: unless refused, every reading is there. What is no checksum's may be another number."""
    name = data.draw(st.sampled_from(sorted(originals)))
    suffix, content = originals[name]
    changed = bytearray(content)
    for _ in range(data.draw(st.integers(1, 3))):
        changed[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.sampled_from([0, 1, 7, 64, 128, 255]))
    path = tmp_path_factory.mktemp("damaged") / f"run{suffix}"
    path.write_bytes(changed)
    try:
        streams = bag_streams(path)
        assert len(streams.wrench) == COUNT
        assert streams.damage == ""
        if name in WITH_CHECKSUM:
            np.testing.assert_array_equal(streams.wrench.wrench, WRENCH)
    except ContactWrenchError as error:
        assert str(error).startswith(f"{path}: ")  # noqa: PT017
    try:
        left = bag_streams(path, accept_damaged=True)
    except ContactWrenchError:
        return
    assert len(left.wrench) <= COUNT
    assert len(left.wrench) == COUNT or left.damage != ""
    lost = re.search(r"found (\d+) messages of /wrench, expected the (\d+) it counts", left.damage)
    if lost is not None:
        assert int(lost[1]) == len(left.wrench)


@settings(max_examples=25, deadline=None)
@given(data=st.data())
def test_a_recording_that_was_cut_off(
    originals: dict[str, tuple[str, bytes]], tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    """It is refused; accepted, its readings are the first of those written, as far as whole chunks go."""
    suffix, content = originals[data.draw(st.sampled_from(["chunks", "checksums", "no chunks", "no index", ".bag"]))]
    path = tmp_path_factory.mktemp("cut") / f"run{suffix}"
    path.write_bytes(content[: data.draw(st.integers(5000, len(content) - 1))])
    assert _said(path).endswith((WHAT_TO_DO, "--accept-damaged"))
    try:
        left = bag_streams(path, accept_damaged=True)
    except ContactWrenchError as error:
        assert "found no topic" in str(error)  # noqa: PT017
        return
    assert _rows_of(left.wrench.wrench) == list(range(len(left.wrench)))
    assert "expected a recording that was closed" in left.damage or suffix == ".bag"


def _unclosed(path: Path) -> str:
    return f"{path}: found no index at its end, expected a recording that was closed: {WHAT_TO_DO}"


def test_a_recording_that_was_never_closed(tmp_path: Path) -> None:
    """Killed before the index was written; a ROS 1 bag says in its head that it has none."""
    path = _mcap(tmp_path / "run.mcap", chunk_size=3000)
    content = path.read_bytes()
    path.write_bytes(content[: content.rindex(b"\x0f\x04" + bytes(7))])
    assert _said(path) == _unclosed(path)
    np.testing.assert_array_equal(bag_streams(path, accept_damaged=True).wrench.wrench, WRENCH)
    path = write_bag(tmp_path / "run.bag", MESSAGES)
    content = path.read_bytes()
    where = content.index(b"index_pos=") + 10
    end = int.from_bytes(content[where : where + 8], "little")
    path.write_bytes(_changed(content, where, bytes(8))[:end])
    assert _said(path) == _unclosed(path)
    np.testing.assert_array_equal(bag_streams(path, accept_damaged=True).wrench.wrench, WRENCH)


def test_an_mcap_whose_summary_names_no_topics_is_read(tmp_path: Path) -> None:
    """They are in the chunks too."""
    bare = {"repeat_channels": False, "repeat_schemas": False, "use_statistics": False}
    np.testing.assert_array_equal(bag_streams(_mcap(tmp_path / "a.mcap", **bare)).wrench.wrench, WRENCH)


def _statistics(content: bytes) -> int:
    """Where the counts by channel are: the record of the statistics, behind its ten numbers."""
    return content.rindex(b"\x0b" + struct.pack("<Q", 66)) + 9 + 46


CHANGES: dict[str, tuple[str, Callable[[bytes], bytes], str]] = {
    "a count of the statistics": (
        "chunks",
        lambda c: _changed(c, _statistics(c) + 12, struct.pack("<Q", 121)),
        "133 messages, by channel, expected the 132 that it counts",
    ),
    "the checksum of a chunk": (
        "checksums",
        lambda c: _changed(c, c.index(b"ft_sensor"), b"xt"),
        "another checksum of its data, expected the one that it states",
    ),
    "a chunk that is private now": (
        "chunks",
        lambda c: _changed(c, c.index(b"\x06", 33), b"\x86"),
        "a record at byte 3101 unreadable (of kind 7), expected a whole one",
    ),
    "a count of an index in a bag": (
        ".bag",
        lambda c: _changed(c, _nth(c, b"count=", 3) + 6, b"\x79"),
        "a record at byte 21563 unreadable (an index of another size or version), expected a whole one",
    ),
    "more connections than there are": (
        ".bag",
        lambda c: _changed(c, c.index(b"conn_count=") + 11, b"\xff\xff\xff\xff"),
        "2 for its conn_count, expected the 4294967295 that it states",
    ),
    "a time in a bag": (
        ".bag",
        lambda c: _changed(c, c.index(b"time=", 4700) + 5, b"\0\0"),
        "132 messages in the chunk at byte 4109, expected the 132 of its index, where and when it says",
    ),
}


@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES)
def test_what_the_file_says_of_itself_is_held_against_it(
    originals: dict[str, tuple[str, bytes]], tmp_path: Path, change: tuple[str, Callable[[bytes], bytes], str]
) -> None:
    name, changing, said = change
    suffix, content = originals[name]
    path = tmp_path / f"run{suffix}"
    path.write_bytes(changing(content))
    assert _said(path) == f"{path}: found {said}: {WHAT_TO_DO}"


def test_damage_behind_the_last_batch_is_told(tmp_path: Path) -> None:
    """The count is known to be wrong when all has been read, and the last batch has been given away."""
    path = _mcap(tmp_path / "run.mcap", chunk_size=3000, enable_crcs=False)
    content = path.read_bytes()
    place = _statistics(content)
    total = content.rindex(b"\x0b" + struct.pack("<Q", 66)) + 9
    content = _changed(_changed(content, place + 12, struct.pack("<Q", 125)), total, struct.pack("<Q", 137))
    path.write_bytes(content)
    *_, last = bag_batches(path, Options(accept_damaged=True), 1)
    assert last.damage == (
        f"{path} is damaged: found 120 messages of /wrench, expected the 125 it counts; what was left of it was read"
    )
    assert len(last.wrench) == 0


@pytest.mark.parametrize("kind", [".bag", ".mcap"])
def test_stamps_of_headers_that_cannot_be(tmp_path: Path, kind: str) -> None:
    fields = {"header": header(0.5) | {"stamp": {"sec": 5, "nanosec": 2**32 - 1}}, "wrench": wrench_fields(np.ones(6))}
    at = START + 10**9
    late = Message("/wrench", "geometry_msgs/msg/WrenchStamped", at, fields)
    path = write_bag(tmp_path / f"run{kind}", [*MESSAGES, late])
    found = "found 1 stamps in headers of /wrench as that of 5 s and 4294967295 ns, expected 0 s or more and less than "
    assert _said(path) == f"{path}: {found}10^9 ns: {WHAT_TO_DO}"
    streams = bag_streams(path, accept_damaged=True)
    assert streams.wrench.t[-1] == pytest.approx(1e-9 * at, abs=1e-6)
    assert found in streams.damage
    assert found in bag_contents(path).damage
    out = tmp_path / f"out{kind}"
    notes: list[str] = []
    write_bag_with(path, out, [np.zeros((COUNT + 1, 6))], accept_damaged=True, note=notes.append)
    read = bag_streams(out, wrench_topic="/wrench/contact")
    assert read.wrench.t[-1] == pytest.approx(1e-9 * at, abs=1e-6)


def test_a_copy_of_a_damaged_bag_has_what_is_left_and_says_so(tmp_path: Path) -> None:
    path, out = _mcap(tmp_path / "run.mcap", chunk_size=3000, enable_crcs=False), tmp_path / "out.mcap"
    path.write_bytes(_jumping(path.read_bytes()))
    left = bag_streams(path, accept_damaged=True)
    with pytest.raises(ContactWrenchError):
        write_bag_with(path, out, [left.wrench.wrench])
    notes: list[str] = []
    write_bag_with(path, out, [left.wrench.wrench], accept_damaged=True, note=notes.append)
    copied = bag_streams(out, wrench_topic="/wrench/contact")
    np.testing.assert_array_equal(copied.wrench.wrench, left.wrench.wrench)
    assert len(notes) == 1
    assert notes[0].startswith(f"the copy lacks what is damaged; {path} is damaged: found the chunk at byte ")


def _read_all(path: Path, accept_damaged: bool) -> int:
    with opened_bag(path, accept_damaged=accept_damaged) as bag:
        topic = wrench_topic(bag, "/wrench")
        return sum(len(wrenches(bag, topic, part[topic])[0]) for part in messages(bag, [topic]))


def test_the_bags_that_hostile_ones_are_made_of_are_read(tmp_path: Path) -> None:
    for suffix, content in zip((".mcap", ".bag"), whole_bags(), strict=True):
        path = tmp_path / f"run{suffix}"
        path.write_bytes(content)
        assert _read_all(path, False) == 1


@pytest.mark.parametrize(
    ("suffix", "made"),
    [*((".mcap", made) for made in HOSTILE_MCAPS.values()), *((".bag", made) for made in HOSTILE_BAGS.values())],
    ids=[*HOSTILE_MCAPS, *HOSTILE_BAGS],
)
def test_hostile_bags_cost_little_and_are_refused_in_one_line(
    tmp_path: Path, suffix: str, made: Callable[[], bytes]
) -> None:
    path = tmp_path / f"run{suffix}"
    path.write_bytes(made())
    assert path.stat().st_size < 10**6
    for accept_damaged in (False, True):
        start = time.process_time()
        try:
            _read_all(path, accept_damaged)
            assert accept_damaged
        except ContactWrenchError as error:
            assert "\n" not in str(error)  # noqa: PT017
            assert len(str(error)) < 300 + len(str(path))  # noqa: PT017
        assert time.process_time() - start < 10.0


def test_damage_that_leaves_nothing_to_read_is_named(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    path.write_bytes(HOSTILE_MCAPS["a chunk indexed 2,000 times"]())
    with pytest.raises(FileFormatError) as caught:
        cw.read(path, accept_damaged=True)
    assert str(caught.value).startswith(f"{path}: found no topic of type ")
    assert str(caught.value).endswith(" (damaged: found a record at byte 824 unreadable)")
    assert len(str(caught.value)) < 300 + len(str(path))


def test_a_definition_that_is_no_utf8_is_said_in_few_words(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "run.bag"
    path.write_bytes(whole_bags()[1].replace(b"Vector3 force", b"V\xe9ctor3 force"))
    damaged = "found a record at byte 4319 unreadable"
    said = run(capsys, "calibrate", path).err, run(capsys, "calibrate", path, "--accept-damaged").err
    assert f"{damaged} (a connection that is no UTF-8), expected a whole one" in said[0]
    assert said[1].endswith(f" (damaged: {damaged})\n")
    assert max(map(len, said)) <= 300


@pytest.mark.parametrize("suffix", [".mcap", ".db3"])
def test_a_folder_that_nothing_describes_is_read_whole_where_that_is_accepted(tmp_path: Path, suffix: str) -> None:
    """A recorder that is killed writes no metadata.yaml; of a split bag one file alone was read."""
    sent, wrench, *_ = recording(600, every=1)
    folder = tmp_path / "run"
    folder.mkdir()
    for k in range(12):
        write_bag(tmp_path / f"part{suffix}", sent[100 * k : 100 * (k + 1)]).rename(folder / f"run_{k}{suffix}")
    with pytest.raises(FileFormatError) as error:
        bag_streams(folder)
    found = "found 12 files and no metadata.yaml, expected it, written as a recording ends"
    assert str(error.value) == f"{folder}: {found}: {WHAT_TO_DO}"
    streams = bag_streams(folder, accept_damaged=True)
    assert streams.wrench.wrench == pytest.approx(wrench)
    assert (np.diff(streams.wrench.t) > 0.0).all()
    assert streams.damage == f"{folder} is damaged: {found}; what was left of it was read"
    if suffix == ".mcap":  # its records are copied as they are
        with pytest.raises(InputError) as of_copy:
            write_bag_with(folder, tmp_path / "copy", [wrench], accept_damaged=True)
        said = f"{folder}: found no metadata.yaml, expected it for a copy: write a table, .csv or .parquet"
        assert str(of_copy.value) == said
        assert not (tmp_path / "copy").exists()
    (folder / f"other{'.db3' if suffix == '.mcap' else '.mcap'}").touch()
    with pytest.raises(FileFormatError) as two:
        bag_streams(folder, accept_damaged=True)
    assert str(two.value) == f"{folder}: found .mcap and .db3 files and no metadata.yaml, expected one bag: name a file"
