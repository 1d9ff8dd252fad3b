"""A program that hears the signals that its terminal would send, also where the tests themselves do not."""

from __future__ import annotations

import signal


def heard() -> None:
    """To be run in a child: under nohup, or in the background of a script, it inherits that they are ignored."""
    for number in (signal.SIGHUP, signal.SIGINT):
        signal.signal(number, signal.SIG_DFL)
