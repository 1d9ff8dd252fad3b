"""Fake devices of the lab, what each can do wrong, and a source that reads them."""

from __future__ import annotations

import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from threading import Thread
from time import monotonic, sleep
from typing import Any

from contactwrench.lab.ft300 import Ft300, Robotiq
from contactwrench.lab.lines import TcpLines, UdpLines
from contactwrench.lab.netft import SATURATED, NetFt
from contactwrench.lab.rsi import Rsi
from contactwrench.lab.sri import Sri
from contactwrench.lab.truth import Plain
from contactwrench.lab.ur import Ur
from contactwrench.live.source import Batch, DeviceError, Note, NoteKind, Sample, Source
from contactwrench.live.uri import source_of

LOCALHOST = "127.0.0.1"


def numbered() -> Plain:
    """A signal whose row k reads fx = k."""
    return Plain(step=(1.0, 0.0, 0.0, 0.0, 0.0, 0.0))


def free_port() -> int:
    """A UDP port that nobody uses."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as any_port:
        any_port.bind((LOCALHOST, 0))
        port: int = any_port.getsockname()[1]
        return port


@dataclass(frozen=True)
class Kind:
    """A device: its fake, what is to stand in the URI beside what the fake says, its rate, and what it can show."""

    fake: Callable[..., Any]
    options: str = ""
    rate: float = 250.0
    counts: bool = True
    connects: bool = True
    datagrams: bool = False
    numbered: bool = True
    bad_status: int | None = None


def _target() -> tuple[str, int]:
    return LOCALHOST, free_port()


KINDS = {
    "sri": Kind(lambda **more: Sri(numbered(), **more), "?rate=1000", 1_000.0),
    "ur": Kind(lambda **more: Ur(numbered(), tcp_offset=(0, 0, 0.2, 0, 0.5, 0), **more), rate=500.0, bad_status=9),
    "netft": Kind(lambda **more: NetFt(numbered(), **more), "", 1_000.0, datagrams=True, bad_status=SATURATED),
    "rsi": Kind(lambda **more: Rsi(numbered(), _target(), **more), connects=False, datagrams=True, numbered=False),
    "ft300": Kind(lambda **more: Ft300(numbered(), **more), rate=100.0, counts=False, numbered=False),
    "robotiq": Kind(lambda **more: Robotiq(numbered(), **more), rate=100.0, counts=False),
    "udp": Kind(lambda **more: UdpLines(numbered(), _target(), **more), "?rate=250", connects=False, datagrams=True),
    "tcp": Kind(lambda **more: TcpLines(numbered(), form="csv", **more), "?rate=250"),
}


@contextmanager
def reading(kind: Kind, **more: Any) -> Iterator[tuple[Any, Source]]:
    """A fake, and a source that is open on it."""
    with kind.fake(**more) as fake:
        source = source_of(fake.uri + kind.options)
        try:
            source.open()
            yield fake, source
        finally:
            source.close()


def read(source: Source, seconds: float, until: NoteKind | None = None) -> Batch:
    """What comes in that time, or until a note of that kind has come and ten samples after it."""
    found, end, more = Batch(), monotonic() + seconds, 10
    while monotonic() < end and more > 0:
        batch = source.read(0.05)
        found.samples += batch.samples
        found.notes += batch.notes
        if until in kinds(found.notes):
            more -= len(batch.samples)
    return found


def kinds(notes: list[Note]) -> list[NoteKind]:
    """Of the notes, those of late answers left out: the machine may be slow."""
    return [note.kind for note in notes if note.kind != NoteKind.LATE]


def consecutive(samples: list[Sample]) -> bool:
    """Whether none is missing, by the numbers in fx."""
    numbers = [sample.wrench[0] for sample in samples if sample.wrench]
    return numbers == [numbers[0] + k for k in range(len(samples))]


@contextmanager
def answering(*answers: bytes) -> Iterator[int]:
    """The port of a server that gives these to whatever comes, one to each question, and then closes; empty: it never
    does.
    """
    with socket.create_server((LOCALHOST, 0)) as server:
        server.settimeout(0.02)
        stop: list[bool] = []

        def serve() -> None:
            held = []
            while not stop:
                with suppress(OSError):
                    connection, _ = server.accept()
                    held.append(connection)
                    connection.settimeout(1.0)
                    for answer in filter(None, answers):
                        connection.recv(1 << 16)
                        connection.sendall(answer)
                    if any(answers):
                        sleep(0.01)
                        connection.close()
            for each in held:
                each.close()

        thread = Thread(target=serve)
        thread.start()
        try:
            yield server.getsockname()[1]
        finally:
            stop.append(True)
            thread.join()


def refusal(source: Source) -> str:
    """The one line with which a source is not opened."""
    try:
        source.open()
    except DeviceError as error:
        return str(error)
    finally:
        source.close()
    raise AssertionError(f"{source.uri} was opened")
