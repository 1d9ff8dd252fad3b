"""A device's own counter: its wraps undone, and what was lost, repeated, out of order, or began anew."""

from __future__ import annotations

from .source import Note, NoteKind

RESTART = 0.25
"""Of a counter's range: a jump back by more is a wrap that was lost samples ago; further than `BEHIND` and less, the
device began anew."""
BEHIND = 1_000
"""Counts: a late packet of a network comes no further behind."""


class Counter:
    """Counts that wrap at `modulus` (None: never), one a sample, each `step` apart, of `period` s a count.

    Args:
        period: s of one count.
        modulus: of the counter.
        step: counts from one sample to the next.
    """

    def __init__(self, period: float, modulus: int | None = None, step: int = 1) -> None:
        self._period, self._modulus, self._step = period, modulus, step
        self._last: int | None = None
        self._total = 0

    def take(self, count: int) -> tuple[float | None, Note | None]:
        """The device's time (s) of a sample with this count, and what is to be noted; None: not a new sample."""
        if self._last is None:
            self._last = count
            return 0.0, None
        ahead = count - self._last
        if self._modulus is not None:
            ahead = (ahead + self._modulus // 2) % self._modulus - self._modulus // 2
        if ahead == 0:
            return None, Note(NoteKind.REPEATED, f"number {count} came again")
        if -BEHIND * self._step <= ahead < 0 and count > self._step:
            return None, Note(NoteKind.DISORDERED, f"number {count} came after {self._last}")
        note = None
        if ahead < 0 or (self._modulus is not None and ahead > RESTART * self._modulus):
            note = Note(NoteKind.RESTARTED, f"the counter began anew at {count} after {self._last}")
            ahead = self._step
        elif (missing := round(ahead / self._step) - 1) > 0:
            note = Note(NoteKind.LOST, f"{missing} missing before number {count}", missing)
        self._last, self._total = count, self._total + ahead
        return self._total * self._period, note
