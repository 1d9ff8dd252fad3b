"""`-` is standard input, for every verb that reads a table; what has a name and is no file is not opened."""

from __future__ import annotations

import io
import os
import socket
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

import contactwrench as cw
from contactwrench import files
from contactwrench.errors import FileAccessError
from contactwrench.files import open_bytes
from tests.support.hostile_tables import TABLE
from tests.support.recordings import PANDA, run, written

Capture = pytest.CaptureFixture[str]
CUT = "the last line has no line end: its last number may be cut off"


@contextmanager
def typed(monkeypatch: pytest.MonkeyPatch, content: bytes) -> Iterator[None]:
    """Standard input is a pipe with that content."""
    reader, writer = os.pipe()
    os.write(writer, content)
    os.close(writer)
    with io.TextIOWrapper(open(reader, "rb")) as pipe, monkeypatch.context() as patch:
        patch.setattr(sys, "stdin", pipe)
        yield


@pytest.fixture(scope="module")
def tool(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("calibration") / "tool.json"
    cw.calibrate(cw.read(PANDA)).save(path)
    return path


@pytest.mark.parametrize("verb", ["calibrate", "compensate", "verify", "weigh", "diagnose", "info"])
def test_a_dash_is_read_as_the_file_is(tool: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch, verb: str) -> None:
    flags = ["-c", tool] if verb in ("compensate", "verify", "weigh") else ["--json"] * (verb == "diagnose")
    of_file = run(capsys, verb, PANDA, *flags)
    with typed(monkeypatch, PANDA.read_bytes()):
        of_dash = run(capsys, verb, "-", *flags)
    assert of_dash.status == of_file.status
    assert of_dash.out.replace("standard input", str(PANDA)).split() == of_file.out.split()
    assert of_dash.err.replace("standard input", str(PANDA)) == of_file.err


def test_a_dash_is_read_as_often_as_it_is_opened(monkeypatch: pytest.MonkeyPatch) -> None:
    content = os.urandom(50_000)
    with typed(monkeypatch, content), open_bytes("-") as first:
        begin = first.read(10)
        with open_bytes("-") as second:
            assert second.read() == content
        with open_bytes("-") as third:
            assert third.read(20) == content[:20]
        assert begin + first.read() == content


def test_complaints_name_standard_input(capsys: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    with typed(monkeypatch, TABLE.encode()[:-3]):
        done = run(capsys, "calibrate", "-")
    assert done.complaint == (
        "standard input: row 3: found 9 values, expected 10 as in the header: complete the row, and write decimals "
        "with a point"
    )
    monkeypatch.setattr(sys, "stdin", None)
    done = run(capsys, "info", "-")
    assert done.complaint == "standard input: found it closed, expected a table: name a file, or write one to it"


@pytest.mark.parametrize("kind", ["pipe", "socket", "device"])
@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".h5", ""])
def test_what_is_no_file_is_not_opened(tmp_path: Path, capsys: Capture, kind: str, suffix: str) -> None:
    path = tmp_path / f"run{suffix}"
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "socket":
        with socket.socket(socket.AF_UNIX) as made:
            made.bind(str(path))
    else:
        path.symlink_to("/dev/zero")
    message = f"{path}: found a pipe or a device, expected a file: give it as - on standard input"
    with pytest.raises(FileAccessError) as caught:
        cw.read(path)
    assert str(caught.value) == message
    assert run(capsys, "compensate", PANDA, "-c", path).complaint == message


@pytest.mark.parametrize(
    ("verb", "end"),
    [(verb, "") for verb in ("calibrate", "compensate", "verify", "weigh", "diagnose", "info", "plan")]
    + [("info", "\n"), ("info", "\n# end"), ("info", "\n  "), ("calibrate", "\r\n")],
)
def test_a_last_number_that_may_be_cut_off_is_noted(
    tool: Path, tmp_path: Path, capsys: Capture, verb: str, end: str
) -> None:
    flags: list[str | Path] = ["-c", tool] if verb in ("compensate", "verify", "weigh") else []
    path = written(tmp_path, PANDA.read_text().rstrip("\n") + end)
    done = run(capsys, verb, *["--from"] * (verb == "plan"), path, *flags)
    assert done.status == 0
    assert done.err.count(f"Note: {path}: {CUT}\n") == (0 if end else 1)


def test_of_two_files_each_is_noted(tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    rows = [f"{0.1 * k:.1f}" for k in range(20)]
    wrench = "\n".join(["t,fx,fy,fz,tx,ty,tz", *(f"{t},1,2,3,4,5,6" for t in rows)])
    pose = "\n".join(["t,qx,qy,qz,qw", *(f"{t},0,0,0,1" for t in rows)])
    path = written(tmp_path, pose, "pose.csv")
    with typed(monkeypatch, wrench.encode("utf-16")):
        done = run(capsys, "diagnose", "--wrench", "-", "--pose", path)
    if done.status == 0:
        assert done.err == f"Note: standard input: {CUT}\nNote: {path}: {CUT}\n"


def test_standard_input_without_an_end_is_refused(capsys: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(files, "MOST_KEPT", 200)
    with typed(monkeypatch, PANDA.read_bytes()):
        said = run(capsys, "info", "-").complaint
    assert said == "standard input: found over 4 GiB, expected a table that ends: write it to a file"
