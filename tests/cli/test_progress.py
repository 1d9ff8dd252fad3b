"""The progress bar: on a terminal, after a second, and nowhere else."""

from __future__ import annotations

import io
import sys

import pytest

from contactwrench.cli import streams as module
from contactwrench.cli.streams import progress


class Terminal(io.StringIO):
    """Text that says it is a terminal."""

    def isatty(self) -> bool:
        return True


def shown(monkeypatch: pytest.MonkeyPatch, stream: io.StringIO, moment: float, parts: list[float]) -> str:
    monkeypatch.setattr(module, "MOMENT", moment)
    monkeypatch.setattr(sys, "stderr", stream)
    monkeypatch.setenv("TERM", "xterm")
    with progress("reading run.csv") as advance:
        for part in parts:
            advance(part)
    return stream.getvalue()


def test_a_long_action_on_a_terminal_shows_how_far_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    text = shown(monkeypatch, Terminal(), -1.0, [0.25, 0.5])
    assert "reading run.csv" in text
    assert "50%" in text


def test_nobody_knows_how_long_a_pipe_is(monkeypatch: pytest.MonkeyPatch) -> None:
    text = shown(monkeypatch, Terminal(), -1.0, [float("nan")] * 3)
    assert "reading run.csv" in text
    assert "nan" not in text


def test_it_names_what_is_done_now(monkeypatch: pytest.MonkeyPatch) -> None:
    stream = Terminal()
    monkeypatch.setattr(module, "MOMENT", -1.0)
    monkeypatch.setattr(sys, "stderr", stream)
    monkeypatch.setenv("TERM", "xterm")
    with progress("reading run.mcap") as bar:
        bar(0.5)
        read = len(stream.getvalue())
        bar.begin("finding the delay in run.mcap")
    assert "reading run.mcap" in stream.getvalue()[:read]
    assert stream.getvalue()[read:].count("finding the delay in run.mcap") > 0


def test_a_short_action_shows_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    assert shown(monkeypatch, Terminal(), 1000.0, [0.25, 0.5, 1.0]) == ""


def test_what_is_no_terminal_sees_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    assert shown(monkeypatch, io.StringIO(), -1.0, [0.25, 0.5, 1.0]) == ""


def test_a_name_is_shown_as_it_is_and_does_not_control_the_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    stream = Terminal()
    monkeypatch.setattr(module, "MOMENT", -1.0)
    monkeypatch.setattr(sys, "stderr", stream)
    monkeypatch.setenv("TERM", "xterm")
    with progress("reading [/red]\x07.csv") as advance:
        advance(0.5)
    assert "reading [/red]\\u0007.csv" in stream.getvalue()
