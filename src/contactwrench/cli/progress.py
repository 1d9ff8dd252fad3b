"""A progress bar on stderr for what takes longer than a moment; nothing where stderr is no terminal."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from math import isnan
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.progress import Progress

MOMENT = 1.0
"""s"""


@contextmanager
def progress(what: str) -> Iterator[Callable[[float], None]]:
    """A function that is told the part, 0 to 1, that is done (NaN: nobody knows how much there is), and shows it."""
    if not sys.stderr.isatty():
        yield lambda done: None
        return
    start, bar = time.monotonic(), None

    def show(done: float) -> None:
        nonlocal bar
        if bar is None and time.monotonic() - start > MOMENT:
            bar = _bar()
            bar.add_task(what, total=None if isnan(done) else 1.0)
            bar.start()
        if bar is not None:
            bar.update(bar.task_ids[0], completed=0.0 if isnan(done) else done)

    try:
        yield show
    finally:
        if bar is not None:
            bar.stop()


def _bar() -> Progress:
    """What is done, how much of it, and the time that is left; it goes when it is done."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
    return Progress(*columns, console=Console(stderr=True), transient=True)
