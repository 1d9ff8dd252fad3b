"""Whether samples come at the rate that was asked for."""

from __future__ import annotations

from math import inf, nan

from ...errors import InputError
from ..source import Batch, Note, NoteKind
from ..uri import Uri

WINDOW = 1.0
"""s over which samples are counted."""
PAUSE = 0.25
"""s without any sample: what is counted begins anew, so that silence is no low rate."""
TOLERANCE = 0.2
"""Of the rate: above what bursts of a network do to a count over a second, below a rate that is another."""


class RateWatch:
    """Counts samples. `asked` Hz; None: nothing is ever noted."""

    def __init__(self, asked: float | None) -> None:
        self._asked = asked
        self._start = self._last = 0.0
        self._count = 0
        self._noted: float | None = asked

    def take(self, batch: Batch, arrival: float) -> None:
        """Count what came, and what was lost on the way; note in the batch where the rate is, or becomes, another."""
        number = len(batch.samples) + sum(note.number for note in batch.notes if note.kind == NoteKind.LOST)
        if self._noted is None or not number:
            return
        if arrival - self._last > PAUSE:
            self._start, self._count = arrival, -number
        self._last, self._count = arrival, self._count + number
        if (passed := arrival - self._start) < WINDOW:
            return
        rate, self._start, self._count = self._count / passed, arrival, 0
        if abs(rate / self._noted - 1.0) > TOLERANCE:
            self._noted = rate
            batch.notes.append(Note(NoteKind.RATE, f"{rate:.4g} Hz come, {self._asked:g} Hz were asked for"))


def asked_rate(uri: Uri) -> float | None:
    """The option `rate`, Hz; None where there is none. Raises `InputError`."""
    if (text := uri.options.get("rate")) is None:
        return None
    try:
        rate = float(text)
    except ValueError:
        rate = nan
    if not 0.0 < rate < inf:
        raise InputError(f"{uri}: found the rate {text}, expected Hz, as in rate=500: correct it")
    return rate
