"""What a program gets from where it runs: standard output and standard error that are closed, full, or with nobody at
the other end; and signals that ask it to end.
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from io import BufferedWriter, TextIOWrapper
from typing import TYPE_CHECKING

from ..errors import FileAccessError

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer

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
