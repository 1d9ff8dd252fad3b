"""The program run on one input after another, each in a process of its own that is held to time and memory."""

from __future__ import annotations

import os
import resource
import signal
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import NoReturn, TypeVar

from contactwrench.__main__ import main

MOST_SECONDS, MOST_BYTES = 20.0, 1_500_000_000
LIMIT_OF_THE_MACHINE = 6 * 2**30
"""Bytes at which a run ends by itself."""
POLL = 2e-3
NOTES = ("Note: ", "The fit is bad: ")
"""How what else is said on stderr begins."""

Case = TypeVar("Case")


@dataclass(frozen=True)
class Run:
    """What one run of the program did: its status (None: it was stopped after `MOST_SECONDS`), what it said, how long
    it took, s, and how much memory it had, bytes.
    """

    arguments: tuple[str, ...]
    status: int | None
    out: str
    err: str
    seconds: float
    peak: int

    @property
    def faults(self) -> list[str]:
        """What no input may do to the program."""
        lines = [text for text in self.err.splitlines() if text.startswith("contactwrench: ")]
        notes = [text for text in self.err.splitlines() if text.startswith(NOTES)]
        said = len(self.err.splitlines())
        return [
            what
            for what, is_so in {
                "traceback": "Traceback" in self.err,
                "status": self.status not in (0, 1, 2, None),
                "hang": self.status is None,
                "memory": self.peak > MOST_BYTES,
                "library": "Warning" in self.err or "[Errno" in self.err,
                "more than a line": len(lines) != (self.status == 2) or len(lines) + len(notes) < said,
                "long line": any(len(text) > 330 for text in lines),
                "control characters": any(ord(mark) < 32 and mark not in "\n\t" for mark in self.err + self.out),
            }.items()
            if is_so
        ]


@dataclass
class _Running:
    arguments: tuple[str, ...]
    place: Path
    start: float
    finished: Callable[[Run], None] = field(repr=False)


def run_all(
    work: Iterator[tuple[Sequence[str], Path, Callable[[Run], None]]], at_once: int, until: float = float("inf")
) -> None:
    """Run the program with the arguments of each piece of work, with an empty folder for what it says, and tell what it
    did; nothing new is begun after `until`, by time.monotonic.
    """
    running: dict[int, _Running] = {}
    is_more = True
    while is_more or running:
        while is_more and len(running) < at_once:
            piece = next(work, None) if time.monotonic() < until else None
            if piece is None:
                is_more = False
                break
            arguments, place, finished = piece
            place.mkdir(parents=True, exist_ok=True)
            pid = os.fork() or _child(arguments, place)
            running[pid] = _Running(tuple(arguments), place, time.monotonic(), finished)
        for pid, one in list(running.items()):
            _collect(pid, one, running)
        time.sleep(POLL)


def _collect(pid: int, one: _Running, running: dict[int, _Running]) -> None:
    seconds = time.monotonic() - one.start
    hangs = seconds > MOST_SECONDS
    if hangs:
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)
    done, status, used = os.wait4(pid, 0 if hangs else os.WNOHANG)
    if not done:
        return
    del running[pid]
    out, err = ((one.place / name).read_bytes().decode(errors="replace") for name in ("out", "err"))
    ended = None if hangs else os.waitstatus_to_exitcode(status)
    one.finished(Run(one.arguments, ended, out, err, seconds, 1024 * used.ru_maxrss))


def _child(arguments: Sequence[str], place: Path) -> NoReturn:
    """The program, as its users run it."""
    status = 70
    try:
        resource.setrlimit(resource.RLIMIT_AS, (LIMIT_OF_THE_MACHINE, LIMIT_OF_THE_MACHINE))
        for name, number in (("out", 1), ("err", 2)):
            os.dup2(os.open(place / name, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600), number)
        sys.argv = ["contactwrench", *arguments]
        main()
        status = 0
    except SystemExit as end:
        status = end.code if isinstance(end.code, int) else 1
    except BaseException:
        import traceback

        traceback.print_exc()
    finally:
        for stream in (sys.stdout, sys.stderr):
            with suppress(Exception):
                stream.flush()
        os._exit(status)
