"""What was written a second ago is there after kill -9, and the package's own readers take it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import contactwrench as cw
from contactwrench.live.sinks.file import Recorder
from tests.support.recordings import run
from tests.support.turns import RATE, turn

CUT = "Note: {}: the last line has no line end and too few cells: it was left out\n"
"""A kill may come in the middle of a write."""

CHILD = """
import sys
from pathlib import Path
from time import monotonic, sleep
from contactwrench.live.sink import open_sink
from contactwrench.live.sinks.file import Recorder
from contactwrench.live.uri import sink_of
from tests.support.turns import RATE, turn
folder = Path(sys.argv[1])
turn(0, 1)
kinds = (".csv", ".parquet", ".mcap")
sinks = [open_sink(Recorder(folder / f"run{kind}")) for kind in kinds]
sinks += [open_sink(sink_of(str(folder / f"out{kind}"))) for kind in kinds]
begun, given = monotonic(), 0
while True:
    due = int((monotonic() - begun) * RATE)
    if due > given:
        one = turn(given, due - given)
        for sink in sinks:
            sink.write(one)
        given = due
        print(given, *(sink.error for sink in sinks), flush=True)
    sleep(0.004)
"""


@pytest.fixture(scope="module")
def killed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, int]:
    """The files of a program that was killed after 2.5 s at 1 kHz, and how many readings it had been given."""
    folder = tmp_path_factory.mktemp("killed")
    repository = Path(__file__).resolve().parents[2]
    environment = os.environ | {"PYTHONPATH": f"{repository / 'src'}:{repository}"}
    command = [sys.executable, "-c", CHILD, str(folder)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as child:
        assert child.stdout is not None
        given = next(int(line) for line in child.stdout if int(line) > 2.5 * RATE)
        child.send_signal(signal.SIGKILL)
    assert child.returncode == -signal.SIGKILL
    return folder, given


@pytest.mark.parametrize("kind", [".csv", ".parquet", ".mcap"])
def test_all_but_the_last_second_is_there(
    killed: tuple[Path, int], kind: str, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, given = killed
    path = folder / f"run{kind}"
    samples = cw.read(path)
    assert samples.t is not None
    first = round((samples.t[0] - turn(0, 1).t[0]) * RATE)
    assert first <= 10
    assert given - RATE <= first + len(samples) <= given + RATE
    np.testing.assert_array_equal(np.diff(np.rint((samples.t - samples.t[0]) * RATE)), 1)
    said = run(capsys, "info", path)
    assert (said.status, said.err) in ((0, ""), (0, CUT.format(path)))
    assert ("was not closed" in said.out) == (kind == ".mcap")


@pytest.mark.parametrize("kind", [".csv", ".parquet", ".mcap"])
def test_contact_wrenches_are_there_too(
    killed: tuple[Path, int], kind: str, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, given = killed
    path = folder / f"out{kind}"
    said = run(capsys, "info", path)
    assert said.status == 0
    assert said.err == "" or said.err.startswith(f"Note: {path}: the last line has no line end")
    words = said.out.split()
    counts = [int(word.replace(",", "")) for word in words if word.replace(",", "").isdecimal()]
    assert any(given - RATE <= count <= given + RATE for count in counts)


def test_a_row_that_was_being_written_is_left_out_and_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "run.csv"
    sink = Recorder(path)
    sink.open()
    sink.write(turn(0, 50))
    sink.close()
    content = path.read_bytes()
    for count in (len(content) - 1, len(content) - 40, len(content) - 130):
        path.write_bytes(content[:count])
        assert len(cw.read(path)) == (50 if count == len(content) - 1 else 49)
        said = run(capsys, "info", path).err
        assert (said == CUT.format(path)) == (count < len(content) - 1)
        assert "last line has no line end" in said
