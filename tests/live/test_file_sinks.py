"""What a session wrote is read back as it was, by this package's own readers."""

from __future__ import annotations

import csv
import itertools
import os
import resource
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import contactwrench as cw
from contactwrench.errors import FileAccessError, FileFormatError
from contactwrench.live.sink import NO_TURN, Sink, Turn
from contactwrench.live.sinks import file as file_sinks
from contactwrench.live.sinks.file import Recorder
from contactwrench.live.uri import sink_of
from contactwrench.recording.bags.open import messages, opened_bag
from contactwrench.recording.contents import contents
from contactwrench.recording.read import batches, read_streams
from contactwrench.samples.samples import Streams
from tests.support.bags import bag_streams
from tests.support.turns import FLAW, ROBOT_RATE, START, orientations, turn, turns, without_orientation
from tests.support.world import Array

KINDS = (".csv", ".parquet", ".mcap")


def _given(sink: Sink, what: list[Turn]) -> Sink:
    sink.open()
    for one in what:
        sink.write(one)
    sink.close()
    return sink


def _texts(path: Path, topic: str) -> list[str]:
    with opened_bag(path) as bag:
        chosen = [known for known in bag.counts if known.name == topic]
        logged = [each for part in messages(bag, chosen) for each in part.values()]
        return [each.raw.message(row)[8:-1].decode() for each in logged for row in range(len(each))]


sizes = st.lists(st.sampled_from([0, 0, 1, 3, 40]), min_size=1, max_size=8).filter(lambda sizes: sum(sizes) > 3)


@settings(max_examples=12, deadline=None)
@given(sizes=sizes, seed=st.integers(0, 99), flawed=st.sampled_from([0.0, 0.3]), kept=st.booleans(), data=st.data())
@pytest.mark.parametrize("kind", KINDS)
def test_a_recording_is_what_came(
    tmp_path_factory: pytest.TempPathFactory,
    kind: str,
    sizes: list[int],
    seed: int,
    flawed: float,
    kept: bool,
    data: st.DataObject,
) -> None:
    """Whether it was written at once or turn by turn; readings that are none are there as text."""
    path = tmp_path_factory.mktemp("live") / f"run{kind}"
    what = turns(sizes, seed, flawed)
    whole = Turn.joined(what)
    usable = np.array([not flaw for flaw in whole.flaw])
    if (odd := data.draw(st.sampled_from([None, np.nan, np.inf, 1e30]))) is not None:
        what[-1].wrench[-1:, 2] = odd
        whole = Turn.joined(what)
        usable &= ~(np.abs(np.nan_to_num(whole.wrench[:, 2], nan=np.inf)) > 1e9)
    with pytest.MonkeyPatch.context() as patch:
        if not kept:
            patch.setattr(file_sinks, "PORTION", -1.0)
            patch.setattr(file_sinks, "EVERY", -1.0)
        sink = _given(Recorder(path), what)
    assert (sink.written, sink.dropped) == (len(whole.t), 0)
    if not usable.any():
        return
    streams = read_streams(path)
    here = np.isfinite(streams.wrench.wrench).all(axis=1)
    np.testing.assert_array_equal(streams.wrench.t[here], whole.t[usable])
    np.testing.assert_array_equal(streams.wrench.wrench[here], whole.wrench[usable])
    t = whole.pose_t if kind == ".mcap" else whole.t
    np.testing.assert_array_equal(streams.orientation.t, t)
    np.testing.assert_allclose(streams.orientation.R_base_flange, _R(orientations(t)), atol=1e-8)
    assert streams.orientation.position is not None
    within = 1e-6 if kept or kind == ".mcap" else 1.0 / ROBOT_RATE  # the pose behind a reading may come a turn later
    expected = np.minimum(t, whole.pose_t[-1]) - START
    np.testing.assert_allclose(streams.orientation.position[:, 0], expected, atol=within)
    said = _texts(path, "/flaw") if kind == ".mcap" else _column(path, "flaw")
    assert len([text for text in said if text]) == int((~usable).sum())
    if flawed and (~usable).any() and odd is None:
        first = int(np.argmin(usable))
        assert next(filter(None, said)) == f"{FLAW} {whole.wrench[first].tolist()}"


def _R(quat_xyzw: Array) -> Array:
    matrices: Array = Rotation.from_quat(quat_xyzw).as_matrix()
    return matrices


def _column(path: Path, name: str) -> list[str]:
    if path.suffix == ".csv":
        with path.open(newline="", encoding="utf-8") as file:
            return [row[name] for row in csv.DictReader(file)]
    import pyarrow.parquet as pq

    return [text for part in sorted(path.glob("*.parquet")) for text in pq.read_table(part)[name].to_pylist()]


@pytest.mark.parametrize("kind", KINDS)
def test_samples_and_a_calibration_are_read_from_a_recording(tmp_path: Path, kind: str) -> None:
    path = tmp_path / f"run{kind}"
    _given(Recorder(path), turns([500] * 4, flawed=0.05))
    samples = cw.read(path)
    assert 1800 < len(samples) < 2000
    assert samples.damage == ""
    assert sum(len(part.wrench) for part in batches(path, rows=300)) == (2000 if kind == ".mcap" else len(samples))


@pytest.mark.parametrize("kind", [".csv", ".parquet"])
def test_a_robot_that_falls_silent_takes_no_row_and_refuses_none(tmp_path: Path, kind: str) -> None:
    """`compensate` refuses a table in which a later wrench has no orientation: such a reading stands as text."""
    path = tmp_path / f"run{kind}"
    what = turns([500] * 4)
    what[2] = without_orientation(what[2])
    _given(Recorder(path), what)
    assert len(cw.read(path)) == 1500
    assert [text.startswith("no orientation [") for text in _column(path, "flaw")] == 1000 * [False] + 500 * [
        True
    ] + 500 * [False]


@pytest.mark.parametrize("kind", [".csv", ".parquet"])
def test_a_position_is_kept_from_a_portion_of_poses_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    monkeypatch.setattr(file_sinks, "PORTION", -1.0)
    path = tmp_path / f"run{kind}"
    both = turn(0, 40)
    _given(Recorder(path), [Turn([], both.poses), Turn(both.readings, [])])
    position = read_streams(path).orientation.position
    assert position is not None
    assert np.isfinite(position).all()


@pytest.mark.parametrize("kind", [".csv", ".parquet"])
def test_a_sensor_alone_is_recorded_as_readings(tmp_path: Path, kind: str) -> None:
    path = tmp_path / f"run{kind}"
    _given(Recorder(path), [without_orientation(one) for one in turns([500] * 4)])
    streams: Streams = read_streams(path)
    assert (len(streams.wrench), len(streams.orientation)) == (2000, 0)


def test_a_pose_that_is_no_orientation_is_set_aside(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    one = turn(0, 80)
    none = one.poses[3]._replace(orientation=(0.0,) * 4)
    _given(Recorder(path), [replace(one, poses=[*one.poses[:3], none, *one.poses[4:]])])
    assert len(bag_streams(path).orientation) == len(one.pose_t) - 1
    assert _texts(path, "/flaw")[0].startswith("pose: no orientation [")


@pytest.mark.parametrize("kind", KINDS)
def test_contact_wrenches_are_what_was_made(tmp_path: Path, kind: str) -> None:
    path = tmp_path / f"out{kind}"
    what = [*turns([30], judged=False), NO_TURN, *turns([200, 0, 1, 300], seed=4)]
    sink = _given(sink_of(str(path)), what)
    contact = Turn.joined(what).contact
    assert contact is not None
    assert (sink.written, sink.dropped) == (501, 0)
    if kind == ".mcap":
        with opened_bag(path) as bag:
            counts = {topic.name: count for topic, count in bag.counts.items()}
        said = _texts(path, "/wrench/contact/judgement")
        assert counts["/wrench/contact"] == counts["/wrench/contact/std"] == 501
        assert 100 < len(said) == len([key for key, _ in itertools.groupby(said)])
        assert any(text.startswith('not valid (stale: no "pose", 0.2 s), ') for text in said)
        return
    names = ["t", "fx", "tz", "fx_std"]
    read = np.array([_column(path, name) for name in names], dtype=np.float64)
    expected = np.array([contact.t, contact.wrench[:, 0], contact.wrench[:, 5], contact.std[:, 0]])
    np.testing.assert_allclose(read, expected, rtol=1e-8)
    np.testing.assert_array_equal(read[0], expected[0])
    valid = [str(each) in ("1", "True") for each in _column(path, "valid")]
    assert valid == contact.valid.tolist()
    assert [each or None for each in _column(path, "reason")] == list(contact.reason)
    assert [_code(each) for each in _column(path, "contact")] == contact.contact.tolist()


def _code(cell: object) -> int:
    return {"": -1, "None": -1, "0": 0, "False": 0, "1": 1, "True": 1}[str(cell)]


def test_what_cannot_be_written_is_said_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match=r"run\.txt: found the suffix \.txt, expected \.csv, \.parquet, \.mcap$"):
        Recorder(tmp_path / "run.txt")
    with pytest.raises(FileAccessError, match=r"found no folder .*, expected one: make it first$"):
        Recorder(tmp_path / "no" / "run.csv").open()
    (tmp_path / "run.parquet").mkdir()
    with pytest.raises(FileAccessError, match=r"found a folder, expected a new name: name another, or a file in it$"):
        Recorder(tmp_path / "run.parquet").open()


@pytest.mark.parametrize("kind", KINDS)
def test_a_pipe_is_neither_waited_for_nor_replaced(tmp_path: Path, kind: str) -> None:
    pipe = tmp_path / f"run{kind}"
    os.mkfifo(pipe)
    with pytest.raises(FileAccessError, match=r"found a device or a pipe, expected a file to write: name another$"):
        Recorder(pipe).open()
    assert pipe.is_fifo()


def test_a_file_that_was_checked_is_replaced(tmp_path: Path) -> None:
    for kind in KINDS:
        path = tmp_path / f"run{kind}"
        path.write_text("old")
        _given(Recorder(path), [turn(0, 20)])
        assert len(read_streams(path).wrench) == 20


def test_a_name_is_not_decoded(tmp_path: Path) -> None:
    """Of a URI the whole is the name."""
    sink = sink_of(f"file:{tmp_path}/a%20b?c#d.csv")
    _given(sink, [turn(0, 3)])
    assert (tmp_path / "a%20b?c#d.csv").is_file()


def test_a_recording_that_was_not_closed_is_read_with_a_note(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "run.mcap"
    sink = Recorder(path)
    sink.open()
    with monkeypatch.context() as patch:
        patch.setattr(file_sinks, "PORTION", -1.0)
        patch.setattr(file_sinks, "EVERY", -1.0)
        sink.write(turn(0, 700))
    sink.write(turn(700, 300))
    samples = cw.read(path)
    assert len(samples) > 680
    assert samples.damage == f"{path} was not closed, as when its program is killed: what it had written was read"
    found = contents(path)
    assert (getattr(found, "damage", None), getattr(found, "left_open", None)) == ("", samples.damage)
    sink.close()
    assert cw.read(path).damage == ""
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])
    with pytest.raises(FileFormatError, match="found no index at its end, expected a recording that was closed"):
        cw.read(path)


@pytest.mark.parametrize("upto", [1, 2, 9, 5000, -1])
def test_a_recording_that_was_killed_within_a_write_is_read_up_to_that(tmp_path: Path, upto: int) -> None:
    """Until a chunk is whole its first byte is 0; one that was whole and is cut is damage."""
    path = tmp_path / "run.mcap"
    sink = Recorder(path)
    sink.open()
    sizes = []
    for begin in (0, 500):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(file_sinks, "PORTION", -1.0)
            patch.setattr(file_sinks, "EVERY", -1.0)
            sink.write(turn(begin, 500))
        sizes.append(path.stat().st_size)
    read = cw.read(path)
    content = path.read_bytes()[: sizes[0] + upto if upto > 0 else sizes[1]]
    path.write_bytes(content[: sizes[0]] + b"\0" + content[sizes[0] + 1 :])
    assert 480 < len(cw.read(path)) < 510 < 980 < len(read)
    assert cw.read(path).damage == f"{path} was not closed, as when its program is killed: what it had written was read"
    path.write_bytes(content[:-1] if upto < 0 else content)
    with pytest.raises(FileFormatError, match="found no index at its end, expected a recording that was closed"):
        cw.read(path)
    sink.close()


def test_a_recording_that_ends_within_a_write_has_what_was_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As the system takes part of what is to be written, and no more."""
    path = tmp_path / "run.mcap"
    monkeypatch.setattr(file_sinks, "PORTION", -1.0)
    monkeypatch.setattr(file_sinks, "EVERY", -1.0)
    sink = Recorder(path)
    sink.open()
    sink.write(turn(0, 500))
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (path.stat().st_size + 5000, limits[1]))
    try:
        with pytest.raises(FileAccessError, match=r"cannot be written \(file too large\)"):
            sink.write(turn(500, 500))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert 480 < len(cw.read(path)) < 510
    sink.close()
    assert len(cw.read(path)) > 980
    assert cw.read(path).damage == ""


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("fails", ["add", "write"])
def test_every_row_is_counted_once_when_a_disk_fails_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str, fails: str
) -> None:
    """As written if the file has it in the end, else as dropped."""
    path = tmp_path / f"run{kind}"
    monkeypatch.setattr(file_sinks, "PORTION", -1.0)
    monkeypatch.setattr(file_sinks, "EVERY", -1.0)
    sink = Recorder(path)
    sink.open()
    sink.write(turn(0, 100))
    monkeypatch.setattr(file_sinks, "EVERY", 1e6)

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(file_sinks.FORMATS[kind], fails, full)
        patch.setattr(file_sinks, "EVERY", -1.0)
        with pytest.raises(FileAccessError):
            sink.write(turn(100, 50))
    sink.close()
    there = len(read_streams(path).wrench)
    assert (sink.written, sink.dropped) == (there, 150 - there)


@pytest.mark.parametrize("kind", KINDS)
def test_in_silence_nothing_is_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str) -> None:
    monkeypatch.setattr(file_sinks, "PORTION", -1.0)
    monkeypatch.setattr(file_sinks, "EVERY", -1.0)
    sink = Recorder(tmp_path / f"run{kind}")
    sink.open()
    sink.write(turn(0, 100))
    with monkeypatch.context() as patch:
        patch.setattr(file_sinks.FORMATS[kind], "write", None)
        sink.write(turn(100, 0))
    sink.close()
    assert sink.written == 100


@pytest.mark.parametrize("made", [Recorder, lambda path: sink_of(str(path))], ids=["record", "out"])
@pytest.mark.parametrize("kind", [".csv", ".parquet"])
def test_an_output_without_a_row_says_that_it_has_none(tmp_path: Path, made: Callable[[Path], Sink], kind: str) -> None:
    """It was a CSV of no bytes, and a folder of which `info` said to name the file in it."""
    path = tmp_path / f"none{kind}"
    sink = made(path)
    sink.open()
    sink.close()
    if kind == ".csv":
        assert path.read_text(encoding="utf-8").startswith("t,fx,fy,fz,tx,ty,tz,")
        assert getattr(contents(path), "rows", None) == 0
        return
    with pytest.raises(FileAccessError) as refused:
        contents(path)
    assert str(refused.value) == (f"{path}: found an empty folder, expected rows in it: nothing was recorded")
