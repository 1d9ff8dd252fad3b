"""Signals that ask a program to end while devices and files are open: it ends in order, and then by that signal."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager

ASK_TO_END = ("SIGINT", "SIGTERM", "SIGHUP")


@contextmanager
def caught() -> Iterator[list[int]]:
    """The signals that have come so far, to be looked at again and again; one that was ignored before, as under nohup,
    is none. Behind what ends in order the program ends by the first of them.
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
