"""Closed, full and broken standard streams; errors that nobody foresaw; what a terminal is sent."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import contactwrench as cw
from contactwrench import errors
from contactwrench.cli import main as cli
from contactwrench.errors import shortened, visible
from tests.support.recordings import PANDA, run, written

Capture = pytest.CaptureFixture[str]
COMMAND = f"{sys.executable} -m contactwrench"
posix = pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no /dev/full")


@pytest.fixture(scope="module")
def tool(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("streams") / "tool.json"
    cw.calibrate(cw.read(PANDA), "mount").save(path)
    return path


CLOSED = "standard output is closed, expected one that can be written: name a file"
REDIRECTED = {
    "stderr closed": ("show nothing.json 2>&-", 2, ""),
    "stderr full": ("show nothing.json 2>/dev/full", 2, ""),
    "all closed": ("show {tool} <&- >&- 2>&-", 0, ""),
    "stdout closed, and asked for": (f"compensate {PANDA} -c {{tool}} -o - >&-", 2, f"contactwrench: {CLOSED}\n"),
}


@posix
@pytest.mark.parametrize(("command", "status", "said"), REDIRECTED.values(), ids=REDIRECTED)
def test_a_stream_that_is_closed_or_full_keeps_the_status(tool: Path, command: str, status: int, said: str) -> None:
    shell = f"{COMMAND} {command.format(tool=tool)}"
    done = subprocess.run(["sh", "-c", shell], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (status, "", said)


@posix
def test_the_number_of_a_closed_stderr_is_no_files(tool: Path, tmp_path: Path) -> None:
    """What a library prints to stderr would be in the middle of it."""
    script = (
        "import os, sys, contactwrench.__main__ as start, contactwrench.cli.main as program\n"
        "def verb(*_):\n"
        "    with open(sys.argv[1], 'wb', buffering=0) as file:\n"
        "        os.write(2, b'printed by a library')\n"
        "        file.write(b'written')\n"
        "program.exit_status = verb\n"
        "start.main()\n"
    )
    (tmp_path / "verb.py").write_text(script)
    shell = f"{sys.executable} {tmp_path / 'verb.py'} {tmp_path / 'out'} 2>&-"
    assert subprocess.run(["sh", "-c", shell], check=False).returncode == 0
    assert (tmp_path / "out").read_bytes() == b"written"


def _failing(monkeypatch: pytest.MonkeyPatch, error: BaseException) -> None:
    def fail(*_: object) -> None:
        raise error

    monkeypatch.setattr("contactwrench.recording.contents.contents", fail)


@pytest.mark.parametrize("named", [True, False])
def test_an_error_of_a_file_is_not_blamed_on_stdout(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture, named: bool
) -> None:
    path = written(tmp_path, "fx\n1\n")
    _failing(monkeypatch, OSError(5, "Input/output error", *(["part.db3"] if named else [])))
    said = "cannot be read or written (input/output error): check the path and its disk"
    assert run(capsys, "info", path).complaint == f"{'part.db3' if named else path}: {said}"


def test_a_name_of_any_length_is_refused_in_one_short_line(capsys: Capture) -> None:
    complaint = run(capsys, "info", f"{'x' * 5000}.csv").complaint
    assert "x.csv: " in complaint
    assert len(complaint) < 300


def test_too_little_memory_is_one_line_that_names_the_recording(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    path = written(tmp_path, "fx\n1\n")
    _failing(monkeypatch, MemoryError())
    expected = (
        "needs more memory than there is, or than a whole file of its size, expected a recording that fits: split it, "
        "or is it damaged"
    )
    assert run(capsys, "info", path).complaint == f"{path}: {expected}"


@pytest.mark.parametrize("asked", [False, True])
@pytest.mark.parametrize("error", [ZeroDivisionError("division\nby zero"), RecursionError("too deep"), EOFError("end")])
def test_an_error_of_the_program_is_one_line_and_a_traceback_if_asked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture, error: Exception, asked: bool
) -> None:
    path = written(tmp_path, "fx\n1\n")
    _failing(monkeypatch, error)
    monkeypatch.setattr(cli, "open_streams", lambda: None)
    monkeypatch.setattr(sys, "argv", ["contactwrench", "info", str(path)])
    if asked:
        monkeypatch.setenv(cli.TRACEBACK, "1")
    with pytest.raises(SystemExit, match=r"^2$"):
        cli.main()
    said = capsys.readouterr().err.strip("\n").splitlines()
    reason = str(error).replace("\n", " ")
    assert said[-1] == (
        f"contactwrench: {path}: found {type(error).__name__} ({reason}), expected no such error, which is the "
        "program's: report it with what CONTACTWRENCH_TRACEBACK=1 shows"
    )
    assert (len(said) > 1, "Traceback (most recent call last):" in said) == (asked, asked)


CONTROLS = [chr(code) for code in (*range(32), *range(0x7F, 0xA0), 0x202E, 0x2028, 0x2066)]


def test_names_from_files_do_not_control_the_terminal(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    monkeypatch.chdir(tmp_path)
    name = "a\x1b[2J\u202eb\nc.csv"
    Path(name).write_text('"fx\x1b]0;title\x07","\u202efy","x\ny"\n1,2,3\n')
    for arguments in (("info", name), ("info", name, "--json"), ("calibrate", name), ("info", "no\x1b\n" + name)):
        done = run(capsys, *arguments)
        assert not {*CONTROLS} & {*(done.out + done.err).replace("\n", "")}
        assert done.err.count("\n") <= 1
    assert "a\\u001b[2J\\u202eb\\u000ac.csv" in done.err


@settings(max_examples=30)
@given(st.text(st.sampled_from([*CONTROLS, *"aä€\\\U0001f600 "])))
def test_visible_text_is_one_line_of_what_is_seen(text: str) -> None:
    assert not {*CONTROLS} & {*visible(text)}
    assert visible("".join(c for c in text if visible(c) == c)) == "".join(c for c in text if visible(c) == c)


@settings(max_examples=50)
@given(st.lists(st.sampled_from(["x" * 90, "a b, c", "/dir" * 300, "/my dir" * 90, "name, " * 200]), max_size=30))
def test_a_message_is_as_short_as_its_own_words_allow(names: list[str]) -> None:
    message = "; ".join(["found", *names, "do"])
    short = shortened(message)
    assert len(short) <= errors.LONGEST
    assert short.startswith("found; ")
    assert short.endswith("do")
    assert short == message or ("…" in short and len(message) > errors.LONGEST)


def test_a_long_path_keeps_its_ends_and_the_rest_of_the_message() -> None:
    rest = ": found no column t, expected the time of each row: add it"
    for path in ("/data" * 1000 + "/run.csv", "/my data" * 1000 + "/run.csv"):
        short = shortened(path + rest)
        assert re.fullmatch(re.escape(path[:9]) + ".*….*" + re.escape("/run.csv" + rest), short)
        assert len(short) == errors.LONGEST


STILL = " (still stretches: 4, left out: 12; stop for a second or two at each)"


def test_what_to_do_is_never_cut() -> None:
    names = ", ".join(f"parameter_{k}" for k in range(30))
    for advice in (": move the arm, or take model auto", f": move the arm{STILL}"):
        message = f"run.csv: found 0 s of motion (the longest of 39: {names}), expected 4 s, to tell {names}{advice}"
        short = shortened(message)
        assert len(short) == errors.LONGEST
        assert short.startswith("run.csv: found 0 s of motion (")
        assert short.endswith(advice)


def test_a_further_part_is_said_whole_or_not_at_all() -> None:
    message = "run.csv: found no motion: move the arm"
    assert errors.with_room_for(message, STILL) == message + STILL
    message = f"run.csv: found no motion to tell {'a number, ' * 18}expected one: move the arm"
    assert errors.with_room_for(message, STILL) == message


@posix
def test_bytes_that_are_no_text_are_printed(tmp_path: Path) -> None:
    path = os.fsencode(tmp_path) + b"/K\xf6ln.csv"
    environment = {**os.environ, "PYTHONIOENCODING": "ascii", "PYTHONUTF8": "0"}
    done = subprocess.run([*COMMAND.split(), "info", path], capture_output=True, env=environment, check=False)
    assert (done.returncode, done.stdout) == (2, b"")
    assert b"/K\\xf6ln.csv: " in done.stderr
