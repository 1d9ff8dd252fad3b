"""A progress bar on stderr for what takes longer than a moment; nothing where stderr is no terminal."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from math import isnan, nan
from typing import TYPE_CHECKING

from ..errors import visible

if TYPE_CHECKING:
    from rich.progress import Progress

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
