"""One device of a session: when its samples were taken, how many and how fast they come, and what is wrong."""

from __future__ import annotations

from math import hypot, inf, isfinite, isnan

import numpy as np

from ..errors import InputError
from ..samples.samples import LARGEST_READING
from .arrivals import Bursts, Rate, Waited
from .clock import LATE, Clock
from .counter import STANDS
from .snapshot import Device, Event
from .source import About, Batch, NoteKind, Sample

SILENT, PERIODS = 0.25, 6.0
"""s, and periods at the rate that was seen or asked for, without a sample: the longer of both is silence."""
SEEN = 0.1
"""s of silence that a look adds at most: a computer that stalls does not know yet what came; of a recording it does."""
BACKLOG = 0.5
"""s after a device is there in which it may send what it had kept."""
LOOK_EVERY = 0.02
"""s from one look at the device to the next: of the 130 us of a turn with one sample two looks were 22."""
NOTES_EVERY = 0.25
"""s: what a device notes in between is said together."""
AGAIN = 5.0
"""s after which samples that go on to be late are said again, and what part of all they are; and stamps alike."""
LEAST_STEP, BEHIND = 1e-6, 1e-4
"""s from one sample to the next: time goes on; and s by which one may lie before the last one, all the same: behind
more the last one came so late that the time of neither is known.
"""
REASONS = 4
"""For which a device is not there, that are said until it is: refused first, it may then be another one."""

SEQUENCE = (tuple, list)
NOTHING = (0.0,)
"""Read by a device that has no wrench, or no orientation."""

AMONG = "late: those before it came so late that its time lies among theirs"
UNKNOWN = "late: its clock is not known yet, what waited may still come"
NEVER_KNOWN = "late: its count or clock begins anew on and on, no time of it is known: let it go on, or leave it out"

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
        self._forget()
        self._reasons = set[str]()
        needed = {"sensor": ("wrench",), "robot": ("orientation",)}.get(role, ("wrench", "orientation"))
        self._last = dict.fromkeys(needed, -inf)
        self._notes: dict[str, tuple[int, str]] = {}
        self._quiet = 0.0
        self._looked = self._noted = self._late = self._said_late = self._said_stands = self._settled = -inf
        self._told, self._pace, self._later = (0, 0), 1.0, 0.0
        self._has_time = False

    def _forget(self) -> None:
        """How its samples came: it may be another now."""
        self._bursts, self._in_bursts, self._usual, self._waited = Bursts(), False, inf, Waited()

    def opened(self, about: About, t: float) -> Event:
        """The device is there."""
        again = self.state == DOWN
        self.about, self.state, self.text = about, STREAMING, ""
        self._last = dict.fromkeys(self._last, t)
        self._rate = Rate(None if about.replay else about.rate, t + BACKLOG)  # a recording is played at any
        self.clock.reset()
        self._forget()
        self._settled = t + BACKLOG
        settings = "".join(f"; {name}: {value}" for name, value in about.settings.items())
        return self._event(t, "back" if again else "connected", "note", f"{about.name}: connected{settings}")

    def down(self, text: str, t: float) -> Event | None:
        """The device is gone, or was never there; each reason is said once, and the first few."""
        self._reasons = self._reasons if self.state == DOWN else set()
        said_before = text in self._reasons or len(self._reasons) >= REASONS
        self._reasons.add(text)
        self.state, self.text, self._rate = DOWN, text, Rate(None, t)
        ended = self.about is not None and self.about.replay
        return None if said_before else self._event(t, "down", "note" if ended else "error", text)

    def require(self, batch: Batch) -> None:
        """Raise `InputError` for what is no batch of samples: programs of others err in all of them alike."""
        if not isinstance(batch, Batch):
            found = f"{self.uri}: found {type(batch).__name__}"
            raise InputError(f"{found}, expected a Batch: Batch([Sample(arrival, wrench=...)])")
        for sample in batch.samples:
            if not isfinite(at := sample.arrival):
                raise InputError(f"found a sample with arrival={at}, expected s, by the clock of t: say when it came")
        for sample in batch.samples[:1]:
            for name, size in (("wrench", 6), ("orientation", 4), ("position", 3)):
                value = getattr(sample, name)
                if value is not None and not (isinstance(value, SEQUENCE) and len(value) == size):
                    found = f"{self.uri}: found {name} as {type(value).__name__} of {np.size(value)}"
                    raise InputError(f"{found}, expected a tuple of {size}, as tuple({name}.tolist())")

    def take(self, batch: Batch) -> list[tuple[float, Sample]]:
        """Samples with the times at which they were taken."""
        for note in batch.notes:
            self.lost += note.number if note.kind is NoteKind.LOST else 0
            self.repeated += note.number if note.kind in (NoteKind.REPEATED, NoteKind.DISORDERED) else 0
            self.wrong += note.number if note.kind in (NoteKind.GARBAGE, NoteKind.WRONG_SUM) else 0
            self._note(note.kind, note.number, note.text)
        anew = [note.before for note in batch.notes if note.kind is NoteKind.RESTARTED] if batch.notes else ()
        if anew and batch.samples and batch.samples[-1].arrival > self._settled:  # not on and on
            self._settled = batch.samples[-1].arrival + BACKLOG
        times = self.clock.times([(sample.arrival, sample.device) for sample in batch.samples], anew)
        self.samples += len(times)
        taken = []
        for (by_its_clock, is_known), sample in zip(times, batch.samples, strict=True):
            t, doubt = self._timed(by_its_clock, is_known, sample)
            self._newest = max(t, self._newest + LEAST_STEP)
            flaw = sample.flaw or _broken(sample) or doubt
            if flaw:
                self._flawed(flawed := sample._replace(flaw=flaw))
            taken.append((self._newest, flawed if flaw else sample))
            for what in self._last:
                if flaw or getattr(sample, what) is not None:
                    self._last[what] = sample.arrival
        return taken

    def _timed(self, t: float, is_known: bool, sample: Sample) -> tuple[float, str]:
        """When a sample was taken, s, which is `t` by its own clock, where that is known; and why that is not to be
        believed, or nothing.
        """
        waited, self._arrived = self._waited.took(sample.arrival, self._usual), sample.arrival
        plays = self.about is not None and self.about.replay
        within_burst = None if plays else self._bursts.taken(sample.arrival)
        self._has_time = not isnan(sample.device)
        if self._has_time:
            late = sample.arrival - t
            is_whole = sample.wrench is not None and sample.orientation is not None  # of one moment, whichever it is
            if late > LATE + self._bursts.period and not is_whole:
                return t, f"late: came {late:.2f} s after it was taken"
            if not (is_known or plays or is_whole):
                return t, NEVER_KNOWN if self.clock.begins_on_and_on else UNKNOWN
            return t, "" if plays or self._newest - t < BEHIND else AMONG
        if within_burst is not None:
            return within_burst, ""
        return t, f"late: nothing for {waited:.2f} s before it, and no time of its own" if waited else ""

    def _flawed(self, sample: Sample) -> None:
        """Note a sample with a flaw; of those that are late the first, and what comes with it."""
        if sample.flaw in (AMONG, UNKNOWN) and sample.arrival < self._settled:  # so begins whatever is in order
            return
        self.wrong += 1
        kind, is_again = sample.flaw.partition(":")[0], False
        if kind == NoteKind.LATE:
            is_again = sample.arrival - self._late < SILENT and sample.arrival - self._said_late < AGAIN
            self._late = sample.arrival
        if not is_again or kind in self._notes:
            self._note(kind, 1, sample.flaw)

    def look(self, t: float) -> list[Event]:
        """What there is to say at `t` s: silence and its end, a rate that was not asked for, what was noted."""
        if abs(t - self._looked) < LOOK_EVERY:
            return []
        self._looked, events = t, []
        rate = self._rate.hz or (self.about and self.about.rate)
        self._usual = 1.0 / rate if rate else self._usual
        usual = max(SILENT, PERIODS / rate if rate else 0.0, 2.0 * self._bursts.period)
        what, last = min(self._last.items(), key=lambda item: item[1])
        plays = self.about is not None and self.about.replay
        self._quiet = t - last if plays else min(t - last, self._quiet + SEEN)
        if self.state == STREAMING and self._quiet > usual:
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
        if self.clock.pace > self._pace:
            slow = (
                f"its time goes {100.0 * (1.0 - 1.0 / self.clock.pace):.2g} % slow, or what it sends waits ever longer"
            )
            events.append(self._event(t, "rate", "warning", f"{slow}: check its rate, or let it stamp by a clock"))
        elif self.clock.pace < self._pace:
            events.append(self._event(t, "rate", "note", "its time is told as it says it: what was slow had waited"))
        if self.clock.later > self._later:
            later = f"{1e3 * (self.clock.later - self._later):.0f} ms later than before, and stays so: its clock stood"
            why = "or the network is slower and its times are told so much too late: check both"
            events.append(self._event(t, "late", "warning", f"what it sends comes {later}, {why}"))
        self._pace, self._later = self.clock.pace, self.clock.later
        if bool(self._bursts.period) is not self._in_bursts:
            self._in_bursts = not self._in_bursts
            events.append(self._of_bursts(t))
        if self._notes and t - self._noted >= NOTES_EVERY:
            self._noted = t
            for kind, (number, text) in [*self._notes.items()]:
                if text == STANDS and t - self._said_stands < AGAIN:
                    continue
                self._said_stands = t if text == STANDS else self._said_stands
                del self._notes[kind]
                many = f"{text} (and more: {number} in all)" if number > 1 and "missing" not in text else text
                if kind == NoteKind.LATE:
                    unused, of = self.wrong - self._told[0], self.samples - self._told[1]
                    many += f"; {unused} of the last {of} samples were not used" if unused > number else ""
                    self._said_late, self._told = t, (self.wrong, self.samples)
                events.append(self._event(t, kind, "warning", many))
        return events

    def _of_bursts(self, t: float) -> Event:
        if not self._in_bursts:
            return self._event(t, "bursts", "note", "samples come evenly again")
        spread = "" if self._has_time else "they have no time of their own and are spread evenly, "
        come = f"samples come in bursts, {1e3 * self._bursts.period:.0f} ms from one to the next: {spread}"
        told = "each contact wrench is told up to so much later: let the device send each sample at once"
        return self._event(t, "bursts", "warning", come + told)

    def _note(self, kind: str, number: int, text: str) -> None:
        before, said = self._notes.get(kind, (0, ""))
        self._notes[kind] = before + number, STANDS if said == STANDS else text

    def _event(self, t: float, kind: str, severity: str, text: str) -> Event:
        return Event(t, str(kind), severity, text, self.uri)

    def shown(self, t: float) -> Device:
        """For a person, at `t` s."""
        about, last = self.about, max(self._last.values())
        name, asked = ("", None) if about is None else (about.name, None if about.replay else about.rate)
        counts = self.samples, self.lost, self.repeated, self.wrong
        age, jitter = None if last == -inf else t - last, max(self.clock.lateness, 0.0) if self.samples else None
        return Device(self.uri, self.role, name, self.state, self.text, self._rate.hz, asked, *counts, age, jitter)


def _broken(sample: Sample) -> str:
    """The flaw of numbers that are none."""
    fine = hypot(*(sample.wrench or NOTHING)) <= LARGEST_READING and hypot(*(sample.orientation or NOTHING)) < inf
    return "" if fine else "broken: no number"
