"""SRI M8125 and M8128 interface boxes: text commands over TCP, then packets of six floats with number and sum."""

from __future__ import annotations

import re
from math import isfinite
from struct import Struct
from time import monotonic

from ..counter import Counter
from ..source import About, Batch, Note, NoteKind, Sample, Six
from ..uri import Uri
from .reader import NOT_AGAIN, ZEROED, Reader
from .transport import Deadline, Tcp

PORT = 4008
USUAL_RATE = 1_000.0
"""Hz; for the device's time where a box does not say its rate."""
MODULUS = 1 << 16
HEADER = b"\xaa\x55\x00\x1b"
"""What a packet begins with, and the length of what follows: a number, six floats, a sum."""
SIZE = 31
_number, _floats = Struct(">4xH").unpack_from, Struct("<6f").unpack_from
CHANNELS = "SGDM=(A01,A02,A03,A04,A05,A06);E;1;(WMA:1)"
"""Engineering units, one sample a packet, no moving average."""
EXPECTED = "ACK+ and a value, as an SRI box answers"
OBEYS = 0.3
"""s for a command that an older box may not know, and twice as long as the first two took, which all boxes know: on a
slow network too its rate is to be heard. What `open` may take is the end of it.
"""


class SriDecoder:
    """Bytes to samples. A packet is taken by its sum; a wrong sum with a packet behind it is a spoiled packet, one with
    none behind it was no packet.

    Args:
        rate: Hz, of the device's clock.
    """

    def __init__(self, rate: float) -> None:
        self._buffer = b""
        self._counter = Counter(1.0 / rate, MODULUS)
        self._streaming = False

    def feed(self, data: bytes, arrival: float, batch: Batch) -> None:
        """Put what is whole into the batch, and keep the rest."""
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

    def _sample(self, buffer: bytes, start: int, arrival: float, batch: Batch) -> None:
        self._streaming = True
        device = self._counter.take(_number(buffer, start)[0], arrival, batch)
        if device is not None:
            wrench: Six = _floats(buffer, start + 6)
            flaw = "" if isfinite(sum(wrench)) else "broken: no number"
            batch.samples.append(Sample(arrival, device, wrench, flaw=flaw))

    def _skipped(self, number: int, batch: Batch) -> int:
        """Note bytes that are no packet; before the first one they are answers to commands."""
        if number and self._streaming:
            batch.notes.append(Note(NoteKind.GARBAGE, f"{number} bytes that are no packet", number))
        return 0


class Sri(Reader[Tcp]):
    """The box. Without `rate` it keeps the rate that it has."""

    FORM = "sri://HOST[:4008][?rate=HZ][&zero=1]"
    ABOUT = "SRI M8125, M8128: wrench; rate: asked of the box; zero=1: the box zeroes itself first"
    RATE = "as asked for, else as the box is set; usually 1000 Hz"
    TESTED = "its fake in the lab, written from public drivers; no box"

    def __init__(self, uri: Uri) -> None:
        uri.only("rate", "zero")
        super().__init__(uri, Tcp(uri.text, "SRI interface box"), b"AT+GSD=STOP\r\n")
        self._at = uri.host, uri.port or PORT
        self._asked = uri.rate()
        self._zero, self._zeroed = uri.switch("zero"), False

    def open(self) -> About:
        """As `Source`."""
        deadline = self._link.deadline()
        self._link.connect(*self._at, deadline)
        self._answers, begun = b"", monotonic()
        self._link.send(b"AT+GSD=STOP\r\n")
        address = self._ask("EIP=?", deadline, needed=True)
        self._obeys = OBEYS + 2.0 * (monotonic() - begun)
        rate = self._set_rate(deadline)
        settings = {"address of the box": address or "not told"}
        zero = self._zero and not self._zeroed
        for command in (CHANNELS, "DCKMD=SUM", *(["ADJZF=1;1;1;1;1;1"] if zero else [])):
            settings[command] = "done" if self._ask(command, self._soon(deadline)) else "not confirmed by the box"
        settings |= {"zero": (ZEROED, NOT_AGAIN)[self._zeroed]} if self._zero else {}
        self._zeroed = self._zero
        self._begin(SriDecoder(rate or self._asked or USUAL_RATE))
        self._link.send(b"AT+GSD\r\n")
        return About("SRI M8128", wrench=True, orientation=False, rate=self._asked or rate, settings=settings)

    def _soon(self, deadline: Deadline) -> Deadline:
        """For a command that an older box may not know."""
        return self._link.deadline(min(self._obeys, deadline.left))

    def _set_rate(self, deadline: Deadline) -> float | None:
        """What the box says its rate is; older boxes call it by another name."""
        wanted = f"{self._asked:g}" if self._asked else "?"
        for name in ("SMPF", "SMPR"):
            found = re.match(r"\d+(\.\d+)?", self._ask(f"{name}={wanted}", self._soon(deadline)))
            if found:
                return float(found[0]) or None
        return None

    def _ask(self, command: str, deadline: Deadline, needed: bool = False) -> str:
        """The value that the box answers to a command, empty where it does not know it. Raises `DeviceError`."""
        self._link.send(f"AT+{command}\r\n".encode())
        name = command.partition("=")[0].encode()
        answer = re.compile(rb"ACK\+" + name + rb"=([^\r\n]*)\r?\n")
        while (found := answer.search(self._answers)) is None:
            if not deadline.left:
                if needed:
                    raise self._link.silent(EXPECTED)
                return ""
            self._answers += b"".join(self._link.receive(deadline.left))
            self._refuse_another()
        self._answers = self._answers[found.end() :]
        return found[1].decode("latin-1").replace("$OK", "") if b"ERROR" not in found[1] else ""

    def _refuse_another(self) -> None:
        if len(self._answers) > 15 and b"ACK+" not in self._answers and HEADER[:2] not in self._answers:
            raise self._link.another(self._answers, EXPECTED)
