"""KUKA RSI over Ethernet: each cycle the robot sends its pose to us, and is to have an answer within the cycle."""

from __future__ import annotations

import re
from collections.abc import Callable
from itertools import pairwise
from math import isfinite, radians

from ...errors import visible
from ...geometry.quaternions import from_kuka_abc
from ..counter import Counter
from ..source import About, Batch, DeviceError, Note, NoteKind, Sample, Six
from ..uri import Uri
from .datagrams import Udp
from .reader import Reader
from .transport import LISTENS

SHORTEST = 4
"""ms, of the robot's cycles; the other is 12."""
FIRST, SHOWN = 6, 40
"""Datagrams by which the cycle is told; and letters of one that are shown."""
_ipoc = re.compile(rb"<IPOC>\s*(\d+)\s*</IPOC>").search
_pose = re.compile(rb"<RIst\s([^>]*)/>").search
_joints = re.compile(rb"<AIPos\s([^>]*)/>").search
_delay = re.compile(rb'<Delay\s+D="(\d+)"').search
_attributes = re.compile(rb'(\w+)\s*=\s*"([^"]*)"').findall
NO_CORRECTION: Six = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
Corrections = Callable[[Sample], Six]
"""Of a sample: X, Y, Z mm and A, B, C degrees by which the robot is to move in this cycle, as its RSI is set up."""


class RsiDecoder:
    """Datagrams to samples."""

    def __init__(self) -> None:
        self._counter, self._late = Counter(1e-3, step=SHORTEST, learns=True), 0
        self.ipoc = 0
        """Of the last datagram that had one, else 0."""
        self.amiss: tuple[str, str, str] | None = None
        """What was found, what expected, and what to do, by the last datagram that was no sample."""

    def feed(self, data: bytes, arrival: float, batch: Batch) -> None:
        """Put the sample into the batch."""
        found, pose = _ipoc(data), _pose(data)
        self.ipoc = int(found[1]) if found else 0
        try:
            x, y, z, a, b, c = numbers = _numbers(pose[1] if pose else b"", b"XYZABC")
            if not found or not isfinite(sum(numbers)):
                raise ValueError
            axes = _joints(data)
            joints = tuple(radians(float(value)) for _, value in _attributes(axes[1])) if axes else None
        except ValueError:
            self.amiss = _amiss(data)
            what, _, do = self.amiss
            batch.notes.append(Note(NoteKind.GARBAGE, f"{what}: {do}", len(data)))
            return
        device = self._counter.take(self.ipoc, arrival, batch)
        if (counted := _delay(data)) is not None:
            if (late := int(counted[1])) > self._late:
                text = f"the robot has counted {late} late answers, too many of which stop it"
                batch.notes.append(Note(NoteKind.LATE, text, late - self._late))
            self._late = late
        if device is not None:
            position = 1e-3 * x, 1e-3 * y, 1e-3 * z
            batch.samples.append(Sample(arrival, device, None, from_kuka_abc(a, b, c), position, joints))


class Rsi(Reader[Udp]):
    """The robot. `corrections` may be set before `open`; without them it is never moved."""

    FORM = "rsi://[HOST][:49152]"
    ABOUT = (
        "KUKA KR C4, C5 with RSI Ethernet: orientation, position, joints; the robot sends to this computer, HOST is "
        "this computer's address, and it is answered in each cycle with corrections of zero"
    )
    RATE = "250 or 83.3 Hz, as the robot is set"
    TESTED = "its fake in the lab, written from KUKA's manual; no robot"
    PORT = 49_152

    def __init__(self, uri: Uri) -> None:
        super().__init__(uri, Udp(uri.text, "KUKA robot"))
        self._at = uri.host, self.PORT if uri.port is None else uri.port
        self.corrections: Corrections | None = None
        self.port = 0

    def open(self) -> About:
        """As `Source`."""
        deadline = self._link.deadline(LISTENS)
        self.port = self._link.bind(*self._at)
        self._rsi = RsiDecoder()
        self._begin(self)
        first = self._first(deadline, self._missing, FIRST)
        step = min(b.device - a.device for a, b in pairwise(first.samples))
        settings = {"pose": "of $TOOL in $BASE: with a $TOOL that is turned or shifted it is not the flange's"}
        rate = round(1.0 / step, 3)
        return About("KUKA RSI", wrench=False, orientation=True, rate=rate, settings=settings, listens=True)

    def _missing(self) -> DeviceError:
        if self._rsi.amiss is not None:
            return self._link.error(*self._rsi.amiss)
        do = "start the program with RSI_MOVECORR on the robot"
        return self._link.nobody(f"port {self.port}", "the robot's RSI datagrams", do)

    def read(self, timeout: float) -> Batch:
        """As `Source`; each datagram is answered before this returns, also those of a robot that says no pose."""
        self._unread = 0
        return super().read(timeout)

    def feed(self, data: bytes, arrival: float, batch: Batch) -> None:
        """Put the sample of a datagram into the batch, and answer it."""
        known = len(batch.samples)
        self._rsi.feed(data, arrival, batch)
        if ipoc := self._rsi.ipoc:
            is_new = len(batch.samples) > known
            correction = self.corrections(batch.samples[-1]) if self.corrections and is_new else NO_CORRECTION
            self._link.answer(answer(ipoc, correction))


def answer(ipoc: int, correction: Six = NO_CORRECTION) -> bytes:
    """What the robot is to have within the cycle."""
    values = " ".join(f'{name}="{value:.4f}"' for name, value in zip("XYZABC", correction, strict=True))
    return f'<Sen Type="ImFree"><RKorr {values}/><IPOC>{ipoc}</IPOC></Sen>'.encode()


def _amiss(data: bytes) -> tuple[str, str, str]:
    """What a datagram that is no sample is found to be, what is expected, and what to do."""
    pose, joints = _pose(data), _joints(data)
    if not pose:
        return "datagrams without RIst", "RIst and IPOC in each", "set DEF_RIst in the RSI configuration"
    if not _ipoc(data):
        return "datagrams without IPOC", "RIst and IPOC in each", "let RSI's own Ethernet object send them"
    for name, value in _attributes(pose[1] + (joints[1] if joints else b"")):
        try:
            float(value)
        except ValueError:
            shown = visible(f'{name.decode("latin-1")}="{value.decode("latin-1")}"'[:SHOWN])
            return shown, "numbers", "send them with a decimal point"
    return "RIst that is not whole", 'X="..", Y, Z, A, B, C in it', "send all six, in double quotes"


def _numbers(attributes: bytes, names: bytes) -> list[float]:
    found = dict(_attributes(attributes))
    return [float(found.get(bytes([name]), b"")) for name in names]
