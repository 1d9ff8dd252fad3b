"""What a source is: a device that sends readings of a wrench, orientations of a flange, or both."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from enum import StrEnum
from math import nan
from typing import NamedTuple, Protocol

from ..errors import ContactWrenchError

TAKEN_FOR_THE_FLANGE = "taken for the flange's in base axes"
"""What a source says that cannot tell whose pose it is."""
HALF_OPEN = 1.0
"""s of silence after which a connection is taken for lost, but of what listens, or is played."""
_SINCE_1970 = time.time() - time.monotonic()

Six = tuple[float, float, float, float, float, float]
Four = tuple[float, float, float, float]
Three = tuple[float, float, float]
NO_WRENCH: Six = (nan,) * 6
UNKNOWN: Four = (nan,) * 4
NO_PLACE: Three = (nan,) * 3


def now() -> float:
    """Seconds since 1970, by a clock that is set once, when the program starts, and never jumps."""
    return _SINCE_1970 + time.monotonic()


class DeviceError(ContactWrenchError, OSError):
    """A device that does not answer, answers something else, or went away; the message names it."""


class NobodyYetError(DeviceError):
    """Nobody has sent anything yet to a source that listens: nothing is wrong, and whoever opens it may wait."""


class EndOfStreamError(DeviceError):
    """There is nothing more to come, and nothing is wrong: a recording, or standard input, has ended."""


class Sample(NamedTuple):
    """One sample as a device gave it; what it does not give is None.

    Attributes:
        arrival: s, by `now()`, when it came.
        device: s, by the device's own clock, wraps undone (counter.py); NaN where it has none.
        wrench: (6,) N and N m, as the device reads it: a push tells the sign, the fit the axes.
        orientation: of the flange in base axes, quaternion x, y, z, w.
        position: of the flange in base axes, m.
        joints: rad.
        temperature: K or degrees C; NaN where there is none.
        flaw: why the sample is not to be used, a short word first (`saturated: fx`); empty: nothing is wrong.
    """

    arrival: float
    device: float = nan
    wrench: Six | None = None
    orientation: Four | None = None
    position: Three | None = None
    joints: tuple[float, ...] | None = None
    temperature: float = nan
    flaw: str = ""


class NoteKind(StrEnum):
    """What a source noticed beside its samples."""

    LOST = "lost"
    REPEATED = "repeated"
    DISORDERED = "disordered"
    GARBAGE = "garbage"
    WRONG_SUM = "wrong_sum"
    RESTARTED = "restarted"
    STATUS = "status"
    LATE = "late"


class Note(NamedTuple):
    """`number` of samples, packets or bytes; `before`: the place in the batch at which a counter showed it."""

    kind: NoteKind
    text: str
    number: int = 1
    before: int = 0


@dataclass
class Batch:
    """What came since the last read."""

    samples: list[Sample] = field(default_factory=list)
    notes: list[Note] = field(default_factory=list)

    def add(self, later: Batch) -> None:
        """Append what came later."""
        self.notes += [note._replace(before=len(self.samples) + note.before) for note in later.notes]
        self.samples += later.samples


@dataclass(frozen=True)
class About:
    """What an open source says of itself.

    Attributes:
        name: of the device, for people: maker, model, firmware where it says so.
        wrench: whether samples have one.
        orientation: whether samples have one, from which position and joints may come along.
        rate: Hz at which samples are to come, asked for or stated; None: not known.
        ranges: (6,) of the sensor, N and N m, where it states them.
        settings: what else is to be said of it, by name.
        replay: it is a recording: `Sample.arrival` goes on by the recording's own clock, whatever the speed, and says
            nothing about `now()`; silence is a read that gave nothing, never an age by `now()`.
        listens: whoever wants may send, so that in silence there is nothing to connect to again.
    """

    name: str
    wrench: bool
    orientation: bool
    rate: float | None = None
    ranges: Six | None = None
    settings: dict[str, str] = field(default_factory=dict)
    replay: bool = False
    listens: bool = False


class Source(Protocol):
    """A device. One thread opens and reads it; `close` may come from any thread, and ends a read that waits. One that
    has `any_thread` set may be read by one after another, which saves waking one for each sample.
    """

    uri: str

    def open(self) -> About:
        """Connect, and ask for the stream; at most 12 s. Raises `DeviceError`, one line that says what to do; and
        `NobodyYetError` after 3 s of one that listens.
        """

    def read(self, timeout: float) -> Batch:
        """What has come; waits for it at most `timeout` s, after which the batch is empty: silence is no error.

        Raises:
            EndOfStreamError: there will be no more, and nothing is wrong.
            DeviceError: the connection is cut, or what comes is no stream of this device.
        """

    def close(self) -> None:
        """Ask the stream to end where the device wants that, and close; nothing is left, also after an error."""
