"""One device of a session: when its samples were taken, how many and how fast they come, and what is wrong."""

from __future__ import annotations

from math import inf, isfinite

from ..samples.samples import LARGEST_READING
from .clock import LATE, Clock
from .rate import Rate
from .snapshot import Device, Event
from .source import About, Batch, NoteKind, Sample

SILENT, PERIODS = 0.25, 6.0
"""s, and periods at the rate that was seen or asked for, without a sample: the longer of both is silence."""
BACKLOG = 0.5
"""s after a device is there in which it may send what it had kept."""
NOTES_EVERY = 0.25
"""s: what a device notes in between is said together."""
LEAST_STEP = 1e-6
"""s from one sample to the next: time goes on."""
CONNECTING, STREAMING, QUIET, DOWN = "connecting", "streaming", "silent", "down"


class Intake:
    """What is known of one device from what it sent."""

    def __init__(self, uri: str, role: str) -> None:
        self.uri, self.role = uri, role
        self.about: About | None = None
        self.state, self.text = CONNECTING, ""
        self.clock = Clock()
        self._rate = Rate(None, -inf)
        self.samples = self.lost = self.repeated = self.wrong = 0
        self._newest = self._arrived = -inf
        needed = {"sensor": ("wrench",), "robot": ("orientation",)}.get(role, ("wrench", "orientation"))
        self._last = dict.fromkeys(needed, -inf)
        self._notes: dict[str, tuple[int, str]] = {}
        self._noted = -inf

    def opened(self, about: About, t: float) -> Event:
        """The device is there."""
        again = self.state == DOWN
        self.about, self.state, self.text = about, STREAMING, ""
        self._last = dict.fromkeys(self._last, t)
        self._rate = Rate(None if about.replay else about.rate, t + BACKLOG)  # a recording is played at any
        self.clock.reset()
        settings = "".join(f"; {name}: {value}" for name, value in about.settings.items())
        return self._event(t, "back" if again else "connected", "note", f"{about.name}: connected{settings}")

    def down(self, text: str, t: float) -> Event | None:
        """The device is gone, or was never there; said once."""
        said_before = self.state == DOWN
        self.state, self.text, self._rate = DOWN, text, Rate(None, t)
        ended = self.about is not None and self.about.replay
        return None if said_before else self._event(t, "down", "note" if ended else "error", text)

    def take(self, batch: Batch) -> list[tuple[float, Sample]]:
        """Samples with the times at which they were taken."""
        for note in batch.notes:
            self.lost += note.number if note.kind is NoteKind.LOST else 0
            self.repeated += note.number if note.kind in (NoteKind.REPEATED, NoteKind.DISORDERED) else 0
            self.wrong += note.number if note.kind in (NoteKind.GARBAGE, NoteKind.WRONG_SUM) else 0
            self._note(note.kind, note.number, note.text)
        anew = [note.before for note in batch.notes if note.kind is NoteKind.RESTARTED]
        times = self.clock.times([(sample.arrival, sample.device) for sample in batch.samples], anew)
        taken = []
        for t, sample in zip(times, batch.samples, strict=True):
            self._newest = max(t, self._newest + LEAST_STEP)
            taken.append((self._newest, _judged(t, sample)))
        for _, sample in taken:
            if sample.flaw:
                self.wrong += 1
                self._note(sample.flaw.partition(":")[0], 1, sample.flaw)
            for what in self._last:
                if sample.flaw or getattr(sample, what) is not None:
                    self._last[what] = sample.arrival
            self._arrived = sample.arrival
        self.samples += len(taken)
        return taken

    def look(self, t: float) -> list[Event]:
        """What there is to say at `t` s: silence and its end, a rate that was not asked for, what was noted."""
        events = []
        rate = self._rate.hz or (self.about and self.about.rate)
        usual = max(SILENT, PERIODS / rate) if rate else SILENT
        what, last = min(self._last.items(), key=lambda item: item[1])
        if self.state == STREAMING and t - last > usual:
            missing = "nothing" if last == max(self._last.values()) else f"no {what}"
            self.state, self.text = QUIET, f"{missing} comes"
            events.append(self._event(t, "silent", "error", f"{missing} for {t - last:.2f} s"))
        elif self.state == QUIET and t - last < usual:
            self.state, self.text = STREAMING, ""
            self._rate.begin(t)
            events.append(self._event(t, "back", "note", "samples come again"))
        if self.state == STREAMING and (found := self._rate.look(self.samples, self._arrived)) is not None:
            come = f"{found:.4g} samples a second come, {self._rate.asked:.4g} were asked for"
            events.append(self._event(t, "rate", "warning", f"{come}: check its settings and the network"))
        if self._notes and t - self._noted >= NOTES_EVERY:
            self._noted = t
            for kind, (number, text) in self._notes.items():
                many = f"{text} (and more: {number} in all)" if number > 1 and "missing" not in text else text
                events.append(self._event(t, kind, "warning", many))
            self._notes.clear()
        return events

    def _note(self, kind: str, number: int, text: str) -> None:
        before, _ = self._notes.get(kind, (0, ""))
        self._notes[kind] = before + number, text

    def _event(self, t: float, kind: str, severity: str, text: str) -> Event:
        return Event(t, str(kind), severity, text, self.uri)

    def shown(self, t: float) -> Device:
        """For a person, at `t` s."""
        about = self.about
        last = max(self._last.values())
        age = None if last == -inf else t - last
        return Device(
            self.uri,
            self.role,
            "" if about is None else about.name,
            self.state,
            self.text,
            self._rate.hz,
            None if about is None or about.replay else about.rate,
            self.samples,
            self.lost,
            self.repeated,
            self.wrong,
            age,
            max(self.clock.lateness, 0.0) if self.samples else None,
        )


def _judged(t: float, sample: Sample) -> Sample:
    """A sample, taken at `t` s, with its flaw: numbers that are none, or too late to believe its time."""
    late = sample.arrival - t
    if sample.flaw:
        return sample
    if sample.wrench is not None and not all(abs(each) <= LARGEST_READING for each in sample.wrench):
        return sample._replace(flaw="broken: no number")
    if sample.orientation is not None and not isfinite(sum(sample.orientation)):
        return sample._replace(flaw="broken: no number")
    return sample._replace(flaw=f"late: came {late:.2f} s after it was taken") if late > LATE else sample
