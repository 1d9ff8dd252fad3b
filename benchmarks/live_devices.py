"""Every driver at its whole rate for a minute against the lab's fake in a process of its own: what was lost.

What a network loses is not in it: loopback loses nothing unless the reader is too slow for the kernel's buffer.
"""

from __future__ import annotations

import multiprocessing
import socket
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from multiprocessing.synchronize import Event
from typing import Any

from contactwrench.live.source import NoteKind
from contactwrench.live.uri import source_of

from .table import Row

SECONDS, QUICK = 60.0, 3.0
MOST_CPU = 0.25
"""Of one core, that the fastest of them may take: two devices, the worker and the page share the machine."""


def _target() -> tuple[str, int]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as any_port:
        any_port.bind(("127.0.0.1", 0))
        return "127.0.0.1", any_port.getsockname()[1]


def _sri(signal: Any) -> Any:
    from contactwrench.lab.sri import Sri

    return Sri(signal)


def _ur(signal: Any) -> Any:
    from contactwrench.lab.ur import Ur

    return Ur(signal, tcp_offset=(0.0, 0.0, 0.2, 0.0, 0.3, 0.0))


def _netft(signal: Any) -> Any:
    from contactwrench.lab.netft import NetFt

    return NetFt(signal, 7_000.0)


def _rsi(signal: Any) -> Any:
    from contactwrench.lab.rsi import Rsi

    return Rsi(signal, _target(), most_late=1_000_000)


def _ft300(signal: Any) -> Any:
    from contactwrench.lab.ft300 import Ft300

    return Ft300(signal)


def _udp(signal: Any) -> Any:
    from contactwrench.lab.lines import UdpLines

    return UdpLines(signal, _target(), 1_000.0)


DEVICES: dict[str, tuple[Callable[[Any], Any], float]] = {
    "sri": (_sri, 1_000.0),
    "ur": (_ur, 500.0),
    "netft": (_netft, 7_000.0),
    "rsi": (_rsi, 250.0),
    "ft300": (_ft300, 100.0),
    "udp lines": (_udp, 1_000.0),
}


def _serve(name: str, told: Any, stop: Event) -> None:
    from contactwrench.lab.truth import Plain

    with DEVICES[name][0](Plain()) as fake:
        told.send(fake.uri)
        stop.wait()


def run(name: str, seconds: float) -> dict[str, float]:
    """Samples, their rate in Hz, what was lost, late answers, CPU of the reader as a part of a core."""
    context = multiprocessing.get_context("spawn")
    stop = context.Event()
    ours, theirs = context.Pipe()
    process = context.Process(target=_serve, args=(name, theirs, stop))
    process.start()
    source = source_of(ours.recv())
    try:
        source.open()
        counted: Counter[str] = Counter()
        begun, cpu, samples = time.monotonic(), time.thread_time(), 0
        while (passed := time.monotonic() - begun) < seconds:
            batch = source.read(0.1)
            samples += len(batch.samples)
            for note in batch.notes:
                counted[note.kind] += note.number
        cpu = time.thread_time() - cpu
    finally:
        source.close()
        stop.set()
        process.join()
    return {"samples": samples, "rate": samples / passed, "cpu": cpu / passed} | counted


def tables(quick: bool) -> Iterator[tuple[str, Iterable[Row]]]:
    """What each driver lost, and what it costs."""
    rows = []
    for name, (_, rate) in DEVICES.items():
        found = run(name, QUICK if quick else SECONDS)
        what = f"{name}, {rate:g} Hz"
        rows.append(Row(f"{what}: samples lost", found.get(NoteKind.LOST, 0), most=0.0))
        rows.append(Row(f"{what}: rate", found["rate"], "Hz", least=0.99 * rate))
        rows.append(Row(f"{what}: CPU of the reader", found["cpu"], "of a core", most=MOST_CPU))
    yield "Live devices", rows
