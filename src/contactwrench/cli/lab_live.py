"""The live session that `lab --live` starts: a program of its own on the same terminal, which ends with the lab."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from subprocess import Popen, TimeoutExpired
from time import monotonic

LOOK = 0.1
"""s from one look at the session to the next."""
ENDS_IN = 15.0
"""s that it is given to end: longer than all of its threads together."""


@contextmanager
def beside(*arguments: str) -> Iterator[Callable[[float], int | None]]:
    """Run `contactwrench live` with these arguments; a signal that comes is handed on to it, and ends both.

    Yields:
        What waits some s at most for the session's end: its exit status, or None where it goes on.
    """
    came: list[int] = []
    ends = {number: signal.signal(number, lambda number, _: came.append(number)) for number in _signals()}
    session = Popen([sys.executable, "-m", "contactwrench", "live", *arguments])

    def ended(seconds: float) -> int | None:
        until = monotonic() + seconds
        while not came and session.poll() is None and (left := until - monotonic()) > 0.0:
            with suppress(TimeoutExpired):
                session.wait(min(left, LOOK))
        return 128 + came[0] if came else session.poll()

    try:
        yield ended
    finally:
        _end(session, came[0] if came else signal.SIGTERM)
        for number, handler in ends.items():
            signal.signal(number, handler)
        if came:
            os.kill(os.getpid(), came[0])


def _signals() -> list[int]:
    names = ("SIGINT", "SIGTERM", "SIGHUP")
    return [getattr(signal, name) for name in names if hasattr(signal, name)]


def _end(session: Popen[bytes], number: int) -> None:
    """End the session as the lab was ended; a terminal's Ctrl-C has reached it already, and twice does no harm."""
    if session.poll() is not None:
        return
    if os.name == "posix":
        session.send_signal(number)
    else:
        session.terminate()
    try:
        session.wait(ENDS_IN)
    except TimeoutExpired:
        session.kill()
        session.wait()
