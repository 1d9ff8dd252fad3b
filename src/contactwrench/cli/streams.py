"""Standard output and standard error as they are: closed, full, or with nobody at the other end."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from io import BufferedWriter, TextIOWrapper
from typing import TYPE_CHECKING

from ..errors import FileAccessError

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer


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
        with self._failing_once():
            return super().write(data)
        return memoryview(data).nbytes

    def flush(self) -> None:
        with self._failing_once():
            super().flush()

    @contextmanager
    def _failing_once(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            os.dup2(os.open(os.devnull, os.O_WRONLY), self.fileno())
            if self.fileno() == 2:
                return
            if isinstance(error, BrokenPipeError):
                raise
            reason = (error.strerror or str(error)).lower()
            raise FileAccessError(f"standard output cannot be written ({reason}): check where it goes") from None
