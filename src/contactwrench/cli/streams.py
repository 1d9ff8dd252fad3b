"""What a program gets from where it runs: standard output and standard error that are closed, full, or with nobody at
the other end; a progress bar on the latter where it is a terminal; and signals that ask the program to end.
"""

from __future__ import annotations

import os
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from io import BufferedWriter, TextIOWrapper
from math import isnan, nan
from typing import TYPE_CHECKING

from ..errors import FileAccessError, visible

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer
    from rich.progress import Progress

ASK_TO_END = ("SIGINT", "SIGTERM", "SIGHUP")


def open_streams() -> None:
    """Replace them: an error of theirs is told from any other file's, and said once."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:  # closed by whoever started the program
            setattr(sys, name, os.fdopen(os.open(os.devnull, os.O_WRONLY), "w", encoding="utf-8"))
        elif isinstance(stream, TextIOWrapper):
            raw = os.fdopen(stream.fileno(), "wb", buffering=0, closefd=False)
            lines = stream.line_buffering or stream.write_through
            setattr(sys, name, TextIOWrapper(_Stream(raw), stream.encoding, "backslashreplace", line_buffering=lines))


class _Stream(BufferedWriter):
    """After the first failure what is left goes nowhere. Of standard output the failure is raised."""

    def write(self, data: ReadableBuffer, /) -> int:
        try:
            return super().write(data)
        except OSError as error:
            self._fail(error)
        return memoryview(data).nbytes

    def flush(self) -> None:
        try:
            super().flush()
        except OSError as error:
            self._fail(error)

    def _fail(self, error: OSError) -> None:
        os.dup2(os.open(os.devnull, os.O_WRONLY), self.fileno())
        if self.fileno() == 2:
            return
        if isinstance(error, BrokenPipeError):
            raise error
        reason = (error.strerror or str(error)).lower()
        raise FileAccessError(f"standard output cannot be written ({reason}): check where it goes") from None


@contextmanager
def caught() -> Iterator[list[int]]:
    """The signals that have come so far, to be looked at again and again while devices and files are open; one that was
    ignored before, as under nohup, is none. Behind what ends in order the program ends by the first of them.
    """
    came: list[int] = []
    numbers = [getattr(signal, name) for name in ASK_TO_END if hasattr(signal, name)]
    before = {number: signal.getsignal(number) for number in numbers}
    heard = {number: handler for number, handler in before.items() if handler != signal.SIG_IGN}
    for number in heard:
        signal.signal(number, lambda number, _: came.append(number))
    try:
        yield came
    finally:
        for number, handler in heard.items():
            signal.signal(number, handler)
    if came:
        os.kill(os.getpid(), came[0])


MOMENT = 1.0
"""s"""


class Bar:
    """What is done now and how much of it is."""

    def __init__(self, what: str) -> None:
        self._what, self._start = what, time.monotonic()
        self._bar: Progress | None = None

    def __call__(self, done: float) -> None:
        """The part that is done, 0 to 1 (NaN: nobody knows how much there is)."""
        if self._bar is None and time.monotonic() - self._start > MOMENT and sys.stderr.isatty():
            self._bar = _bar()
            self._bar.add_task(visible(self._what), total=None if isnan(done) else 1.0)
            self._bar.start()
        if self._bar is not None:
            self._bar.update(self._bar.task_ids[0], completed=0.0 if isnan(done) else done)

    def begin(self, what: str) -> None:
        """Something else is done from now on."""
        self.stop()
        self._what = what
        self(nan)

    def stop(self) -> None:
        """It goes."""
        if self._bar is not None:
            self._bar.stop()
            self._bar = None


@contextmanager
def progress(what: str) -> Iterator[Bar]:
    """A bar as long as it takes."""
    bar = Bar(what)
    try:
        yield bar
    finally:
        bar.stop()


def _bar() -> Progress:
    """What is done, how much of it, and the time that is left; it goes when it is done."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}", markup=False), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
    return Progress(*columns, console=Console(stderr=True), transient=True)
