"""What comes while a source is opened, and its rate is looked at, is delivered too; and what comes has an end."""

from __future__ import annotations

import csv
import io
import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from threading import Thread

import pytest

from contactwrench.lab.sri import Sri
from contactwrench.live.devices import probed
from contactwrench.live.source import DeviceError, EndOfStreamError
from contactwrench.live.uri import source_of
from tests.support.chain import calibration
from tests.support.devices import consecutive, numbered, read
from tests.support.recordings import run

RATE, LINES = 250, 300
POSE = b', "qx": 0, "qy": 0, "qz": 0, "qw": 1'
WHOLE = b"".join(
    b'{"t": %f, "fx": %d, "fy": 0, "fz": 0, "tx": 0, "ty": 0, "tz": 0, "qx": 0, "qy": 0, "qz": 0, "qw": 1}\n'
    % (k / RATE, k)
    for k in range(LINES)
)


@contextmanager
def piped(data: bytes, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Standard input that gives these bytes, and then ends."""
    to_read, to_write = os.pipe()
    with io.FileIO(to_read) as stdin:
        os.write(to_write, data)
        os.close(to_write)
        monkeypatch.setattr("sys.stdin", stdin)
        yield


def test_the_samples_by_which_a_rate_was_found_are_handed_on() -> None:
    with Sri(numbered()) as box:
        source = source_of(f"{box.uri}?rate=1000")
        about, early = probed(source, wrench=True, orientation=False)
        later = read(source, 0.1)
        source.close()
    assert about.rate == 1000.0
    assert len(early.samples) > 600
    arrivals = [sample.arrival for sample in early.samples]
    assert arrivals == sorted(arrivals)
    assert 0.6 < arrivals[-1] - arrivals[0] < 1.5
    early.add(later)
    assert early.notes == []
    assert consecutive(early.samples)


@pytest.mark.parametrize("rate", ["", f"?rate={RATE}"], ids=["no rate", "a rate"])
def test_of_a_pipe_no_line_is_lost_and_the_session_ends_with_it(
    rate: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    calibration().save(tmp_path / "cal.json")
    record, out = tmp_path / "run.csv", tmp_path / "contact.csv"
    with piped(WHOLE, monkeypatch):
        done = run(
            capsys, "live", "--sensor", f"stdin:{rate}", "-c", tmp_path / "cal.json", "--no-page", "--record", record,
            "--out", out
        )  # fmt: skip
    assert done.status == 0
    with record.open() as file:
        rows = list(csv.DictReader(file))
    assert [float(row["fx"]) for row in rows] == list(range(LINES))
    times = [float(row["t"]) for row in rows]
    steps = [b - a for a, b in pairwise(times)]
    assert steps == pytest.approx([1 / RATE] * (LINES - 1), abs=1e-5)
    assert out.read_text().count("\n") == LINES + 1
    last = done.err.splitlines()[-1].partition("  ")[2]
    assert last == f"error: stdin:{rate}: found its end, expected more lines: keep the program that writes them running"


def test_lines_that_end_while_it_is_opened_are_read(monkeypatch: pytest.MonkeyPatch) -> None:
    with piped(WHOLE.replace(POSE, b""), monkeypatch):
        source = source_of("stdin:")
        about = source.open()
        assert (about.wrench, about.orientation) == (True, False)
        assert len(source.read(0.1).samples) == LINES
        with pytest.raises(EndOfStreamError):
            source.read(0.1)
        source.close()


def test_lines_of_a_server_that_closes_while_it_is_opened_are_read() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        thread = Thread(target=_served, args=(server,))
        thread.start()
        source = source_of(f"tcp://127.0.0.1:{server.getsockname()[1]}")
        source.open()
        assert len(source.read(0.1).samples) == LINES
        with pytest.raises(DeviceError, match="found the connection closed, expected samples"):
            source.read(0.1)
        source.close()
        thread.join()


def _served(server: socket.socket) -> None:
    connection, _ = server.accept()
    with connection:
        connection.sendall(WHOLE.replace(POSE, b""))
