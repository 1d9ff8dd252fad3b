"""A device's own counter: its wraps undone, and what was lost, repeated, out of order, or began anew."""

from __future__ import annotations

from .source import Batch, Note, NoteKind

BEHIND = 1_000
"""Samples: a late packet of a network comes no further behind; what does is of a device that began anew."""
IN_A_ROW = 3
"""Samples behind, each ahead of the one before, with none in its place between: the device began anew. Two packets that
a network delayed together are still two late ones; a device that restarts loses two samples by it."""
STANDS = "several in a row stamped alike: let their time or number go on, or leave it out"
"""What is said of a count that came `IN_A_ROW` times and more."""
SLACK = 0.5
"""s by which samples may come sooner than their numbers say: a jump further ahead was no loss but another start."""
LEARNT = 5
"""Steps by whose shortest one is corrected that was asked for: a controller of 125 Hz asked for 500 loses nothing."""
LATEST = 10.0
"""s of samples at most that wait somewhere before they come."""


class Counter:
    """A device's counts, one a sample: how long it was since the last one tells a loss, also over wraps, from a device
    that began anew.

    Args:
        period: s of a count.
        modulus: at which they wrap; None: never.
        step: from one sample to the next; None: not known, so that no loss is seen.
        learns: that the step may be longer than it says, as of time stamps where the device has a rate of its own.
    """

    def __init__(self, period: float, modulus: int | None = None, step: int | None = 1, learns: bool = False) -> None:
        self._period, self._modulus, self._step = period, modulus, step
        self._behind_most = BEHIND * step if step else 1.0 / period
        self._latest = LATEST if modulus is None else min(LATEST, modulus * period / 4)
        self._last: int | None = None
        self._total, self._arrival, self._late = 0, 0.0, 0.0
        self._behind, self._in_a_row, self._alike = 0, 0, 0
        self._learning: list[int] | None = [] if learns and step else None

    def take(self, count: int, arrival: float, batch: Batch) -> float | None:
        """A sample's time by the device.

        Args:
            count: its counter.
            arrival: s, when it came.
            batch: where it is to go, and what its counter shows is noted.

        Returns:
            s since the first sample; None where it is no new one. With `NoteKind.RESTARTED` it goes on by the time that
            passed, a step at least.
        """
        if self._last is None:
            self._last, self._arrival = count, arrival
            return 0.0
        ahead = self._ahead(count, arrival)
        if ahead == self._step and not self._in_a_row and self._learning is None:
            return self._forward(count, ahead, arrival)
        if ahead == 0:
            self._alike += 1
            _note(batch, NoteKind.REPEATED, f"number {count} came again" if self._alike < IN_A_ROW else STANDS)
            return None
        if self._began_anew(count, ahead, arrival):
            _note(batch, NoteKind.RESTARTED, f"the counter began anew at {count} after {self._last}")
            passed = round((arrival - self._arrival) / self._period)
            return self._forward(count, max(passed, self._step or 1), arrival)
        if ahead < 0:
            _note(batch, NoteKind.DISORDERED, f"number {count} came after {self._last}")
            return None
        if (missing := self._missing(ahead)) > 0:
            _note(batch, NoteKind.LOST, f"{missing} missing before number {count}", missing)
        return self._forward(count, ahead, arrival)

    def _missing(self, ahead: int) -> int:
        """Samples that are lost within an advance, or within those by which the step was learnt."""
        if self._step is None:
            return 0
        if self._learning is None:
            return round(ahead / self._step) - 1
        self._learning.append(ahead)
        if len(self._learning) < LEARNT:
            return 0
        learnt, self._learning = self._learning, None
        self._step = max(self._step, min(learnt))
        return round(sum(learnt) / self._step) - len(learnt)

    def _ahead(self, count: int, arrival: float) -> int:
        """Counts since the last sample, by as many wraps as fit best the time that passed."""
        ahead = count - (self._last or 0)
        if self._modulus is None:
            return ahead
        ahead = (ahead + self._modulus // 2) % self._modulus - self._modulus // 2
        passed = (arrival - self._arrival + self._late) / self._period
        return ahead + self._modulus * max(round((passed - ahead) / self._modulus), 0)

    def _began_anew(self, count: int, ahead: int, arrival: float) -> bool:
        if ahead > 0:
            waited = arrival - self._arrival + self._late
            return ahead * self._period > 1.5 * waited + SLACK
        self._in_a_row = self._in_a_row + 1 if self._in_a_row and count > self._behind else 1
        self._behind = count
        return ahead < -self._behind_most or self._in_a_row >= IN_A_ROW

    def _forward(self, count: int, ahead: int, arrival: float) -> float:
        late = self._late + arrival - self._arrival - ahead * self._period
        self._late = min(late, self._latest) if late > 0.0 else 0.0
        self._last, self._arrival, self._total = count, arrival, self._total + ahead
        self._in_a_row = self._alike = 0
        return self._total * self._period


def _note(batch: Batch, kind: NoteKind, text: str, number: int = 1) -> None:
    batch.notes.append(Note(kind, text, number, len(batch.samples)))
