"""`contactwrench lab` as it is started: what it prints works, and Ctrl-C ends it."""

from __future__ import annotations

import os
import signal
import struct
import subprocess
import sys
from contextlib import ExitStack, suppress
from pathlib import Path
from subprocess import PIPE
from time import sleep
from typing import Any
from unittest.mock import Mock

import pytest

from contactwrench.cli.lab import lab
from tests.lab.clients import ask, connected, exactly, line, nothing_left, rtde, sri_packet
from tests.support.recordings import run
from tests.support.signals import heard

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals as POSIX has them")


def _started(command: list[str], ending: ExitStack) -> subprocess.Popen[str]:
    """A program that hears signals, also where the tests ignore them, and is killed in the end."""
    program = subprocess.Popen(
        command,
        stdout=PIPE,
        stderr=PIPE,
        text=True,
        preexec_fn=heard,  # noqa: PLW1509 - it locks nothing
    )
    ending.enter_context(program)
    ending.callback(program.kill)
    return program


def test_it_runs_until_it_is_interrupted() -> None:
    command = [sys.executable, "-m", "contactwrench", "lab", "--auto", "--set", "tool.mass=0.5"]
    with ExitStack() as ending:
        program = _started(command, ending)
        assert program.stdout is not None
        said = [program.stdout.readline().split() for _ in range(4)]
        sensor, robot, control = (int(words[1].rsplit(":", 1)[1]) for words in said[:3])
        assert said[3] == [
            *(["contactwrench", "live", "--robot"]), said[1][1], "--sensor", said[0][1], "--lab", said[2][1]
        ]  # fmt: skip
        with connected(sensor) as sri, connected(robot) as ur, connected(control) as orders:
            sri.sendall(b"AT+SMPF=1000\r\nAT+GSD\r\n")
            assert line(sri) == "ACK+SMPF=1000$OK"
            assert [sri_packet(sri)[0] for _ in range(20)] == list(range(20))
            rtde(ur, "O", struct.pack(">d", 500.0) + b"timestamp")
            assert rtde(ur, "S") == b"\x01"
            assert exactly(ur, 12)
            while not (state := ask(orders, {"state": True}))["moving"]:
                sleep(0.01)
            assert state["truth"]["mass"] == 0.5
            program.send_signal(signal.SIGINT)
            assert program.wait(timeout=10) == 130
        assert program.stderr is not None
        assert program.stderr.read() == "contactwrench: interrupted\n"


class _StartedError(Exception):
    """Raised where the program would wait for Ctrl-C."""


@pytest.mark.parametrize("pair", [("netft", "rsi"), ("ft300", "lines"), ("robotiq", "ur"), ("lines", "ur")])
def test_every_pair_starts_at_the_ports_that_are_asked_for(
    pair: tuple[Any, Any], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("contactwrench.cli.lab.sleep", Mock(side_effect=_StartedError))
    first = 20_000 + 8 * os.getpid() % 12_000  # below the ports that the system gives
    with nothing_left(), pytest.raises(_StartedError):
        lab(*pair, live=False, auto=False, port_base=first, seed=0, settings=None)
    out = capsys.readouterr().out
    assert all(f":{port}" in out for port in (first, first + 2, first + 3))


def _is_closed(port: int) -> bool:
    with suppress(OSError), connected(port):
        return False
    return True


def test_a_live_session_beside_it_ends_with_it() -> None:
    """By the same signal, whichever it is: this one is not the one by which it would be ended otherwise."""
    pytest.importorskip("uvicorn")
    command = [sys.executable, "-m", "contactwrench", "lab", "--live"]
    with ExitStack() as ending:
        program = _started(command, ending)
        assert program.stdout is not None
        assert program.stderr is not None
        words = [program.stdout.readline().split() for _ in range(4)]
        assert [each[0] for each in words] == ["Sensor", "Robot", "Control", "Open"]
        ports = [int(each[1].rstrip("/").rsplit(":", 1)[1]) for each in words]
        assert not any(map(_is_closed, ports))
        program.send_signal(signal.SIGHUP)  # to the lab alone: it hands it on
        assert program.stdout.read() == ""  # ends when nobody holds the other end, the session included
        assert program.stderr.read().splitlines()[-2:] == ["contactwrench: its terminal is gone"] * 2
        assert program.wait(timeout=20) == 129
        assert all(map(_is_closed, ports))


def test_a_live_session_that_cannot_begin_ends_the_lab(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """The session is a program of its own; the lab need not be one."""
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}{os.pathsep}{os.environ.get('PYTHONPATH', '')}")
    (tmp_path / "uvicorn.py").write_text("raise ImportError('not here')\n")
    with nothing_left():
        done = run(capfd, "lab", "--live")
    assert done.status == 2
    assert done.err.splitlines()[-1].startswith("contactwrench: ")
