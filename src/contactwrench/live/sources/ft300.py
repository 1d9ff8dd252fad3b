"""Robotiq FT 300: six Modbus registers, asked for 100 times a second, by TCP or a serial line (Linux, macOS); or
readings that a Universal Robots controller, to which its cable goes, sends as text to whoever connects.
"""

from __future__ import annotations

import os
import re
from struct import Struct
from time import monotonic

from ..source import About, Batch, DeviceError, Note, NoteKind, Sample
from ..uri import Uri
from .reader import Reader, note_garbage
from .transport import Deadline, StandardInput, Tcp

UNIT, NUMBERS = 9, 0x1_0000
RATE = 100.0
RANGES = (300.0, 300.0, 300.0, 30.0, 30.0, 30.0)
"""N and N m (Robotiq's data sheet): what reads more, up to the 327 N of a register and no further, is no reading."""
QUESTION = Struct(">BBHH").pack(UNIT, 3, 180, 6)
"""Registers 180 to 185 hold forces in 0.01 N and torques in 0.001 N m (Robotiq's manual)."""
_registers = Struct(">6h")
ANSWER = bytes([UNIT, 3, _registers.size])
REFUSAL = bytes([UNIT, 0x83])
REFUSALS = {
    1: "it does not know the question",
    2: "it has no such registers",
    3: "it takes no such number of them",
    4: "it has failed",
    6: "it is busy",
    10: "the gateway has no way to it",
    11: "the gateway gets no answer from it",
}
"""What a Modbus exception begins with, and what its code says of the device."""
LONGEST_READING = 200
"""Bytes of a reading as text, which are some 60."""
_reading = re.compile(rb"\(([^()]*)\)").finditer
COUNTED, SLOW = 0.4, 25.0
"""s for which samples are counted at opening, and Hz, a half of what a serial line can, below which that is said."""
AGAIN, WITHIN = 0.5, 0.02
"""s without an answer after which the question is asked again; and, by a serial line, without the rest of one, which an
adapter to USB may hold for 16 ms: what comes 60 ms after the last sample would be taken for late.
"""
OLD = f"late: it answers a question of {AGAIN:g} s ago or more: let one program alone ask, or take a faster gateway"
STREAM, END_OF_STREAM, SEEN = b"\x20\x4e", b"\xff" * 50, 0.05
"""What a frame begins with of the stream that a sensor may send unasked, which takes no questions; what ends it
(Robotiq's manual); and s in which it is seen: frames come 100 times a second.
"""


class Ft300Decoder:
    """Answers to samples: those of TCP have a head with a number, those of a serial line a sum."""

    def __init__(self, serial: bool) -> None:
        self._serial, self._buffer = serial, b""
        self._number, self._unanswered = 0, set[bytes]()
        self._before, self._after = (0, 2) if serial else (6, 0)
        self.refused = ""
        """What the last exception said."""

    def number(self, unanswered: bool) -> bytes:
        """Of the next question, by TCP. Where the last is `unanswered`, its answer may come yet, told by its number."""
        if unanswered:
            self._unanswered.add(self._number.to_bytes(2))
        self._number = (self._number + 1) % NUMBERS
        self._unanswered.discard(number := self._number.to_bytes(2))  # its last one was lost, minutes ago
        return number

    def feed(self, data: bytes, arrival: float, batch: Batch) -> None:
        """Put what is whole into the batch, and keep the rest."""
        buffer = self._buffer + data
        size = len(ANSWER) + _registers.size
        while (start := buffer.find(ANSWER)) >= 0 and len(buffer) >= start + size + self._after:
            end = start + size
            if self._serial and crc(buffer[start:end]) != buffer[end : end + 2]:
                batch.notes.append(Note(NoteKind.WRONG_SUM, "an answer with a wrong sum"))
            else:
                fx, fy, fz, tx, ty, tz = _registers.unpack_from(buffer, start + len(ANSWER))
                wrench = 0.01 * fx, 0.01 * fy, 0.01 * fz, 0.001 * tx, 0.001 * ty, 0.001 * tz
                number = buffer[max(start - 6, 0) : max(start - 4, 0)]
                batch.samples.append(Sample(arrival, wrench=wrench, flaw=OLD if number in self._unanswered else ""))
                self._unanswered.discard(number)
            note_garbage(max(start - self._before, 0), "answer", batch)
            buffer = buffer[end + self._after :]
        buffer = self._without_refusal(buffer, batch) if start < 0 else buffer
        keep = size + self._before + self._after
        note_garbage(max(len(buffer) - keep, 0), "answer", batch)
        self._buffer = buffer[-keep:]

    def _without_refusal(self, buffer: bytes, batch: Batch) -> bytes:
        """What stands behind a Modbus exception, which is noted: no registers, but the reason why there are none."""
        start = buffer.find(REFUSAL if self._before == 0 else b"\0\3" + REFUSAL)
        at = start + len(REFUSAL) + (2 if self._before else 0)
        if start < 0 or len(buffer) <= at + self._after:
            return buffer
        code = buffer[at]
        self.refused = f"Modbus exception {code} ({REFUSALS.get(code, 'of no known meaning')})"
        batch.notes.append(Note(NoteKind.STATUS, self.refused))
        return buffer[at + 1 + self._after :]

    def give_up(self, batch: Batch) -> None:
        """Leave what has come of an answer that does not come whole."""
        note_garbage(len(self._buffer), "answer", batch)
        self._buffer = b""


class Serial(StandardInput):
    """A serial line at 19,200 baud, 8 bits, no parity, which is read as any file is."""

    def plug(self, path: str) -> None:
        """Open it. Raises `DeviceError`."""
        try:
            import termios
        except ImportError:
            raise self.error("no serial lines of this kind", "Linux or macOS", "use Modbus TCP") from None
        try:
            line = os.fdopen(os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK), "r+b", buffering=0)
            raw = [0, 0, termios.CS8 | termios.CREAD | termios.CLOCAL, 0, termios.B19200, termios.B19200]
            termios.tcsetattr(line, termios.TCSANOW, [*raw, termios.tcgetattr(line)[6]])
        except (OSError, termios.error) as error:
            found = f"no serial line ({str(error.args[-1]).lower()})"
            raise self.error(found, self._device, "check its path, and that you may use it (group dialout)") from None
        with self._lock:
            self._use(line)

    def send(self, data: bytes) -> None:
        """Send a few bytes."""
        if self._socket is not None:
            self._socket.write(data)

    def _ended(self) -> DeviceError:
        return self.error("the line gone", "samples", "check its plug")


class Ft300(Reader[Tcp | Serial]):
    """The sensor. It has no counter and no status: a sample that it repeats is not seen."""

    FORM = "ft300://HOST[:502] or ft300:///dev/ttyUSB0"
    ABOUT = "Robotiq FT 300: wrench; by a serial line, or by Modbus TCP through a gateway to one"
    RATE = "as the line can, about 50 Hz; at most 100 Hz"
    TESTED = "its fake in the lab; no sensor, and no serial line"
    PORT = 502

    def __init__(self, uri: Uri) -> None:
        self._path = uri.path if not uri.host else ""
        kind = Serial if self._path else Tcp
        super().__init__(uri, kind(uri.text, "Robotiq FT 300"))

    def open(self) -> About:
        """As `Source`."""
        deadline = self._link.deadline()
        settings = {"by": self._path or "Modbus TCP"}
        if isinstance(self._link, Tcp):
            self._link.connect(*self._at, deadline)
        else:
            self._link.plug(self._path)
            settings |= self._stream_ended(deadline)
        self._asked, self._due, self._heard = False, monotonic(), 0.0
        self._answers = Ft300Decoder(bool(self._path))
        self._begin(self._answers)
        early = self._first(deadline, self._no_registers)
        if not self._path:
            settings["rate"] = self._counted(early)
        # no rate: what a serial line can, behind Modbus TCP too, is its own
        return About("Robotiq FT 300", wrench=True, orientation=False, ranges=RANGES, settings=settings)

    def _no_registers(self) -> DeviceError:
        """What is raised where no answer is a reading."""
        expected = "six Modbus registers from 180 on"
        if not self._answers.refused:
            return self._link.silent(expected)
        do = f"check that the Robotiq FT 300 is behind it, as unit {UNIT}, with power"
        return self._link.error(self._answers.refused, expected, do)

    def _counted(self, early: Batch) -> str:
        """At which rate samples come: it is nowhere stated."""
        counting, self._early = self._link.deadline(COUNTED), Batch()
        while counting.left:
            early.add(self.read(counting.left))
        samples = early.samples
        self._early = Batch(samples[-1:], early.notes)  # what is older is of no use to anybody
        passed = max(samples[-1].arrival - samples[0].arrival, COUNTED if len(samples) < 2 else 1e-3)
        rate = max(len(samples) - 1, 1) / passed
        slow = f" of the {RATE:.0f} that it can: let one program alone ask, or take a faster gateway"
        return f"{rate:.0f} Hz{slow if rate < SLOW else ''}"

    def _stream_ended(self, deadline: Deadline) -> dict[str, str]:
        """End the stream in which another program has left the sensor; what is to be said of that."""
        seen, came = self._link.deadline(SEEN), b""
        while seen.left and STREAM not in came:
            came += b"".join(self._link.receive(seen.left))
        if STREAM not in came:
            return {}
        self._link.send(END_OF_STREAM)
        while deadline.left and self._link.receive(SEEN):
            pass
        return {"stream": "another program had left one running, it was ended"}

    def read(self, timeout: float) -> Batch:
        """As `Source`: it asks for a sample when that is due, and at once where the answer is spoiled."""
        if not self._early.samples and not self._asked:
            if (wait := self._due - monotonic()) > 0.0:
                self._link.receive(min(wait, timeout))
                if wait >= timeout:
                    return Batch()
            self._ask()
        unread = self._unread
        batch = super().read(min(timeout, WITHIN) if self._path else timeout)
        self._heard = monotonic() if self._unread > unread else self._heard
        if any(sample.flaw != OLD for sample in batch.samples):
            self._asked, self._due = False, max(self._due + 1.0 / RATE, monotonic() - 1.0 / RATE)
        elif self._path and (batch.notes or self._sent < self._heard < monotonic() - WITHIN):
            while self._link.receive(0.0):
                pass
            self._answers.give_up(batch)
            self._ask()
        elif monotonic() - self._sent > AGAIN:
            self._ask()
        return batch

    def _ask(self) -> None:
        head = b"" if self._path else self._answers.number(self._asked) + Struct(">HH").pack(0, len(QUESTION))
        self._link.send(head + QUESTION + (crc(QUESTION) if self._path else b""))
        self._asked, self._sent = True, monotonic()


def crc(data: bytes) -> bytes:
    """The sum of Modbus on a serial line: CRC-16 with the polynomial 0xA001, low byte first."""
    value = 0xFFFF
    for byte in data:
        value ^= byte
        for _ in range(8):
            value = value >> 1 ^ (0xA001 if value & 1 else 0)
    return value.to_bytes(2, "little")


class RobotiqDecoder:
    """Text to samples: six numbers in parentheses with commas between, N and N m. A line's end may follow or not."""

    def __init__(self) -> None:
        self._buffer = b""

    def feed(self, data: bytes, arrival: float, batch: Batch) -> None:
        """Put what is whole into the batch, and keep the rest."""
        buffer, at = self._buffer + data, 0
        for found in _reading(buffer):
            note_garbage(len(buffer[at : found.start()].strip()), "reading", batch)
            at = found.end()
            try:
                fx, fy, fz, tx, ty, tz = map(float, found[1].split(b","))
            except ValueError:
                note_garbage(len(found[0].strip()), "reading", batch)
                continue
            batch.samples.append(Sample(arrival, wrench=(fx, fy, fz, tx, ty, tz)))
        begin = buffer.rfind(b"(", at)
        keep = begin if begin >= 0 and len(buffer) - begin <= LONGEST_READING else len(buffer)
        note_garbage(len(buffer[at:keep].strip()), "reading", batch)
        self._buffer = buffer[keep:]


class Robotiq(Reader[Tcp]):
    """The controller. What it sends has neither time nor counter: a reading that is lost or repeated is not seen."""

    FORM = "robotiq://HOST[:63351]"
    ABOUT = "Robotiq FT 300 whose cable goes into a Universal Robots controller, by its URCap's port: wrench"
    RATE = "as it sends, about 100 Hz"
    TESTED = "its fake in the lab, written from public clients; no sensor"
    PORT = 63_351

    def __init__(self, uri: Uri) -> None:
        super().__init__(uri, Tcp(uri.text, "controller with Robotiq's URCap"))

    def open(self) -> About:
        """As `Source`."""
        deadline = self._link.deadline()
        self._link.connect(*self._at, deadline)
        self._begin(RobotiqDecoder())
        self._first(deadline, lambda: self._link.silent("readings such as ( 2.25 , -0.1 , 29.3 , 0.01 , 0.02 , 0.0 )"))
        settings = {"by": "the URCap's port"}
        return About("Robotiq FT 300 by its URCap", wrench=True, orientation=False, ranges=RANGES, settings=settings)
