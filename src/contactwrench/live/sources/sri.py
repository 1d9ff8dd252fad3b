"""SRI M8125 and M8128 interface boxes: text commands over TCP, then packets of six floats with number and sum."""

from __future__ import annotations

import re
from math import isfinite
from struct import Struct
from time import monotonic

from ...errors import visible
from ..counter import Counter
from ..source import About, Batch, DeviceError, Note, NoteKind, Sample, Six
from ..uri import Uri
from .reader import Reader, note_garbage
from .transport import Deadline, Tcp

USUAL_RATE = 1_000.0
"""Hz; for the device's time where a box does not say its rate."""
MODULUS = 1 << 16
HEADER = b"\xaa\x55\x00\x1b"
"""What a packet begins with, and the length of what follows: a number, six floats, a sum."""
SIZE = 31
SEEN = 4_096
"""Bytes from before the first packet that are kept, to say what they are."""
_number, _floats = Struct(">4xH").unpack_from, Struct("<6f").unpack_from
CHANNELS = "SGDM=(A01,A02,A03,A04,A05,A06);E;1;(WMA:1)"
"""Engineering units, one sample a packet, no moving average."""
SUMS = "DCKMD=SUM"
COUNTS = re.compile(r"\(.*\);C;").match
"""Of the answer about channels: AD counts, which are no N and N m."""
UNIT = re.compile(r"(?!ERROR)[A-Z/]+").fullmatch
ERROR, SHOWN = "ERROR", 60
"""What a box answers that refuses; and characters of an answer that are shown."""
NOT_CONFIRMED = "not confirmed by the box"
EXPECTED = "ACK+ and a value, as an SRI box answers"
OBEYS = 0.3
"""s for a command that an older box may not know, and twice as long as the first two took, which all boxes know: on a
slow network too its rate is to be heard. What `open` may take is the end of it.
"""


class SriDecoder:
    """Bytes to samples. A packet is taken by its sum; a wrong sum with a packet behind it is a spoiled packet, one with
    none behind it was no packet. `rate` Hz is that of the device's clock.
    """

    def __init__(self, rate: float) -> None:
        self._buffer = b""
        self._counter = Counter(1.0 / rate, MODULUS)
        self._streaming, self._seen = False, b""

    def feed(self, data: bytes, arrival: float, batch: Batch) -> None:
        """Put what is whole into the batch, and keep the rest."""
        if not self._streaming:
            self._seen = (self._seen + data)[-SEEN:]
        buffer = self._buffer + data
        at, skipped = 0, 0
        while (start := buffer.find(HEADER, at)) >= 0 and len(buffer) - start >= SIZE:
            skipped += start - at
            payload = buffer[start + 6 : start + 30]
            if sum(payload) & 255 == buffer[start + 30]:
                skipped = self._skipped(skipped, batch)
                self._sample(buffer, start, arrival, batch)
                at = start + SIZE
            elif len(buffer) - start < SIZE + 2:
                at = start
                break
            elif buffer.startswith(HEADER[:2], start + SIZE):
                skipped = self._skipped(skipped, batch)
                batch.notes.append(Note(NoteKind.WRONG_SUM, "a packet with a wrong sum"))
                at = start + SIZE
            else:
                at, skipped = start + 1, skipped + 1
        keep = start if start >= 0 else max(len(buffer) - len(HEADER) + 1, at)
        self._skipped(skipped + keep - at, batch)
        self._buffer = buffer[keep:]

    def instead(self) -> str:
        """What came in place of two samples; empty: nothing that looks like packets."""
        if self._streaming:
            return "no two packets with numbers of their own"
        for head in re.finditer(rb"\xaa\x55(..)", self._seen, re.DOTALL):
            size = len(head[0]) + int.from_bytes(head[1])
            if self._seen.startswith(head[0], head.start() + size):
                return "packets whose sums are all wrong" if size == SIZE else f"packets of {size} bytes"
        return ""

    def _sample(self, buffer: bytes, start: int, arrival: float, batch: Batch) -> None:
        self._streaming = True
        device = self._counter.take(_number(buffer, start)[0], arrival, batch)
        if device is not None:
            wrench: Six = _floats(buffer, start + 6)
            flaw = "" if isfinite(sum(wrench)) else "broken: no number"
            batch.samples.append(Sample(arrival, device, wrench, flaw=flaw))

    def _skipped(self, number: int, batch: Batch) -> int:
        """Note bytes that are no packet; before the first one they are answers to commands."""
        if self._streaming:
            note_garbage(number, "packet", batch)
        return 0


class Sri(Reader[Tcp]):
    """The box. Without `rate` it keeps the rate that it has."""

    FORM = "sri://HOST[:4008][?rate=HZ][&zero=1]"
    ABOUT = "SRI M8125, M8128: wrench; rate: asked of the box; zero=1: the box zeroes itself first"
    RATE = "as asked for, else as the box is set; usually 1000 Hz"
    TESTED = "its fake in the lab, written from public drivers; no box"
    PORT, OPTIONS = 4008, ("rate", "zero")

    def __init__(self, uri: Uri) -> None:
        super().__init__(uri, Tcp(uri.text, "SRI interface box"), b"AT+GSD=STOP\r\n")
        self._asked = uri.rate()

    def open(self) -> About:
        """As `Source`."""
        deadline = self._link.deadline()
        self._link.connect(*self._at, deadline)
        self._answers, begun = b"", monotonic()
        self._link.send(b"AT+GSD=STOP\r\n")
        address = self._ask("EIP=?", deadline, needed=True).replace(ERROR, "") or "not told"
        self._obeys = OBEYS + 2.0 * (monotonic() - begun)
        rate = self._set_rate(deadline)
        told = {"address of the box": address, **self._channels(deadline)}
        unit = self._ask("DCPCU=?", deadline).upper()  # all known programs set MVPV, mV/V
        told["unit of its decoupling matrix"] = unit if UNIT(unit) else "not told"
        for command in (SUMS, *(["ADJZF=1;1;1;1;1;1"] if self._is_to_zero else [])):
            told[command] = _outcome(command, self._ask(command, deadline))
        told |= self._zeroed_now()
        self._begin(decoder := SriDecoder(rate or self._asked or USUAL_RATE))
        self._link.send(b"AT+GSD\r\n")
        self._first(deadline, lambda: self._no_samples(decoder.instead()), 2)
        return About("SRI M8128", wrench=True, orientation=False, rate=self._asked or rate, settings=told)

    def _channels(self, deadline: Deadline) -> dict[str, str]:
        """Have it send N and N m, and what it says to that. Raises `DeviceError`: it sends counts."""
        said = self._ask(CHANNELS, deadline)
        if said in ("", ERROR):  # it stays as it is, and may say how that is
            said = self._ask("SGDM=?", deadline) or said
        if COUNTS(said):
            do = f"set AT+{CHANNELS} in its maker's program, with the sensor's decoupling matrix"
            raise self._link.error(f"AD counts ({said})", "N and N m", do)
        doubt = ", so whether it sends N and N m is not known" * (said in ("", ERROR))
        return {CHANNELS: _outcome(CHANNELS, said) + doubt}

    def _no_samples(self, instead: str) -> DeviceError:
        """What is raised where it sends no stream that can be read."""
        if not instead:
            return self._link.silent("packets after AT+GSD")
        do = f"set AT+{SUMS} and AT+{CHANNELS} in its maker's program"
        return self._link.error(instead, f"packets of {SIZE}, one sample of six channels, a number and a sum", do)

    def _set_rate(self, deadline: Deadline) -> float | None:
        """What the box says its rate is; older boxes call it by another name."""
        wanted = f"{self._asked:g}" if self._asked else "?"
        for name in ("SMPF", "SMPR"):
            found = re.match(r"\d+(\.\d+)?", self._ask(f"{name}={wanted}", deadline))
            if found:
                return float(found[0]) or None
        return None

    def _ask(self, command: str, deadline: Deadline, needed: bool = False) -> str:
        """The value that the box answers to a command, `ERROR`; empty: nothing. One that is not `needed` an older box
        may not know. Raises `DeviceError`.
        """
        until = deadline if needed else self._link.deadline(min(self._obeys, deadline.left))
        self._link.send(f"AT+{command}\r\n".encode())
        name = command.partition("=")[0].encode()
        answer = re.compile(rb"ACK\+" + name + rb"=([^\r\n]*)\r?\n")
        while (found := answer.search(self._answers)) is None:
            if not until.left:
                if needed:
                    raise self._link.silent(EXPECTED)
                return ""
            self._answers += b"".join(self._link.receive(until.left))
            if len(self._answers) > 15 and b"ACK+" not in self._answers and HEADER[:2] not in self._answers:
                raise self._link.another(self._answers, EXPECTED)
        self._answers = self._answers[found.end() :]
        said = visible(found[1].decode("latin-1")).replace("$OK", "").replace(" ", "")
        return ERROR if ERROR in said else said[:SHOWN]


def _outcome(command: str, said: str) -> str:
    """Of a command, by what the box said to it; a box that zeroes itself says anything."""
    if not said or said == ERROR:
        return "refused by the box" if said else NOT_CONFIRMED
    name, _, value = command.partition("=")
    return "done" if said == value or name == "ADJZF" else f"the box has {said}"
