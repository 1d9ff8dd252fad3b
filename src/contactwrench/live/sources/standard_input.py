"""Standard input as a link: what another program writes, read until it ends."""

from __future__ import annotations

import os
import selectors
import sys

from ..source import DeviceError, EndOfStreamError
from .transport import MOST_BYTES, Link


class StandardInput(Link):
    """What another program writes."""

    def start(self) -> None:
        """Begin. Raises `EndOfStreamError`: it is closed."""
        if sys.stdin is None:
            raise self._ended()
        with self._lock:
            self._use(os.fdopen(os.dup(sys.stdin.fileno()), "rb", buffering=0), selectors.SelectSelector())

    def receive(self, timeout: float) -> list[bytes]:
        """What has come; nothing in silence, and after `close`. Raises `DeviceError` at the end."""
        with self._lock:
            if not self._ready(selectors.EVENT_READ, timeout):
                return []
            try:
                data = self._socket.read(MOST_BYTES)
            except OSError:  # of a line that was pulled out
                data = b""
        if data == b"":
            raise self._ended()
        return [data] if data else []

    def _ended(self) -> DeviceError:
        return EndOfStreamError(str(self.error("its end", "more lines", "keep the program that writes them running")))
