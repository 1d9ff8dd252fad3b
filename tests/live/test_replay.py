"""A recording as if it were live: every row once, in order, at any speed, in bounded memory."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from threading import Timer
from time import monotonic
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from contactwrench.errors import InputError
from contactwrench.live import replay as replays
from contactwrench.live.replay import ROWS, Replay
from contactwrench.live.sink import Turn
from contactwrench.live.sinks.file import Recorder
from contactwrench.live.source import EndOfStreamError, Note, Sample, now
from contactwrench.recording.bags.write import write_streams_bag
from contactwrench.recording.options import Options
from contactwrench.recording.read import batches, read_streams
from contactwrench.samples.samples import OrientationStream, Streams, WrenchStream
from tests.support.turns import START, turns


def _recorded(path: Path, count: int, flawed: float = 0.0) -> Turn:
    sink, what = Recorder(path), turns([count // 4] * 4, flawed=flawed)
    sink.open()
    for one in what:
        sink.write(one)
    sink.close()
    return Turn.joined(what)


def _replayed(replay: Replay, each: Callable[[int], None] = lambda _: None) -> tuple[list[Sample], list[Note]]:
    samples: list[Sample] = []
    notes: list[Note] = []
    with suppress(EndOfStreamError):
        while True:
            batch = replay.read(0.1)
            samples += batch.samples
            notes += batch.notes
            each(len(batch.samples))
    with pytest.raises(EndOfStreamError, match=r": the recording has ended$"):
        replay.read(0.0)
    replay.close()
    return samples, notes


@pytest.mark.parametrize("kind", [".csv", ".parquet", ".mcap"])
def test_every_row_comes_once_and_in_order(tmp_path: Path, kind: str) -> None:
    path = tmp_path / f"run{kind}"
    _recorded(path, 6000, flawed=0.02)
    streams = read_streams(path)
    replay = Replay(path, speed=0.0)
    about = replay.open()
    begun = now()
    samples, notes = _replayed(replay)
    assert (about.wrench, about.orientation, about.replay) == (True, True, True)
    assert about.rate == pytest.approx(1000.0, rel=1e-3)
    assert notes == []
    readings = [each for each in samples if each.wrench is not None]
    poses = [each for each in samples if each.orientation is not None]
    assert len(readings) + len(poses) == len(samples)
    np.testing.assert_array_equal([each.device for each in readings], streams.wrench.t)
    np.testing.assert_array_equal([each.wrench for each in readings], streams.wrench.wrench)
    np.testing.assert_array_equal([each.device for each in poses], streams.orientation.t)
    assert streams.orientation.position is not None
    np.testing.assert_allclose(np.array([each.position for each in poses]), streams.orientation.position)
    arrival = np.array([each.arrival for each in samples])
    assert (np.diff(arrival) >= 0.0).all()
    assert abs(arrival[0] - begun) < 0.5
    np.testing.assert_allclose(np.diff(arrival), np.diff([each.device for each in samples]), atol=1e-6)
    assert [each.flaw != "" for each in readings] == np.isnan(streams.wrench.wrench[:, 0]).tolist()


@settings(max_examples=10, deadline=None)
@given(n=st.integers(1, 5000), every=st.integers(1, 50), ahead=st.floats(-0.3, 0.3))
def test_two_streams_at_their_own_times(
    tmp_path_factory: pytest.TempPathFactory, n: int, every: int, ahead: float
) -> None:
    path = tmp_path_factory.mktemp("replay") / "run.mcap"
    rng = np.random.default_rng(n)
    t, t_pose = START + np.arange(n) / 1000.0, START + ahead + np.arange(0, n, every) / 1000.0
    R = np.tile(np.eye(3), (len(t_pose), 1, 1))
    write_streams_bag(
        path,
        Streams(WrenchStream(t, rng.normal(size=(n, 6))), OrientationStream(t_pose, R, rng.normal(size=(len(R), 3)))),
    )
    replay = Replay(path, speed=0.0)
    replay.open()
    samples, _ = _replayed(replay)
    np.testing.assert_array_equal([each.device for each in samples if each.wrench is not None], t)
    np.testing.assert_array_equal([each.device for each in samples if each.orientation is not None], t_pose)


def test_twenty_times_real_time(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    _recorded(path, 12_000)
    replay = Replay(path, speed=20.0)
    replay.open()
    begun, sizes = monotonic(), list[int]()
    samples, _ = _replayed(replay, sizes.append)
    assert len(samples) == 24_000
    assert 0.55 < monotonic() - begun < 2.0
    assert samples[-1].arrival - samples[0].arrival == pytest.approx(12.0, abs=0.01)
    assert max(sizes) <= ROWS


def test_what_is_not_due_is_waited_for_no_longer_than_asked(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    _recorded(path, 400)
    replay = Replay(path, speed=0.001)
    replay.open()
    replay.read(0.0)
    begun = monotonic()
    assert replay.read(0.05).samples == []
    assert 0.04 < monotonic() - begun < 0.3
    Timer(0.05, replay.close).start()
    assert replay.read(5.0).samples == []
    assert monotonic() - begun < 1.0


def test_memory_does_not_grow_with_the_recording(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """No more is read ahead than two blocks."""
    path = tmp_path / "run.csv"
    _recorded(path, 20_000)
    ahead, most = 0, 0

    def counting(*arguments: Any) -> Iterator[Streams]:
        nonlocal ahead, most
        for block in batches(*arguments):
            ahead += len(block.wrench) + len(block.orientation)
            most = max(most, ahead)
            yield block

    def given_away(count: int) -> None:
        nonlocal ahead
        ahead -= count

    monkeypatch.setattr(replays, "batches", counting)
    replay = Replay(path, speed=0.0)
    replay.open()
    _replayed(replay, given_away)
    assert ahead == 0
    assert most <= 4 * ROWS


def test_the_options_of_reading_hold(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    whole = _recorded(path, 400)
    replay = Replay(path, Options(sign="reaction"), speed=0.0)
    replay.open()
    samples, _ = _replayed(replay)
    np.testing.assert_array_equal([each.wrench for each in samples if each.wrench is not None], -whole.wrench)


def test_damage_is_noted(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    _recorded(path, 4000)
    path.write_bytes(path.read_bytes()[:-5000])
    replay = Replay(path, Options(accept_damaged=True), speed=0.0)
    replay.open()
    _, notes = _replayed(replay)
    assert "is damaged" in notes[-1].text


@pytest.mark.parametrize("speed", [-1.0, np.nan, np.inf])
def test_a_speed_that_is_none(speed: float) -> None:
    with pytest.raises(InputError, match=r"^speed is .*, expected times real time, or 0 for as fast as it goes$"):
        Replay("run.csv", speed=speed)
