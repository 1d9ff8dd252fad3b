"""What all fake devices have in common: a thread, a clock, packets that go wrong when told, a clean end."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from threading import Event, Thread
from time import monotonic, sleep
from typing import Self, TypeAlias

import numpy as np

from ..errors import FileAccessError
from ..geometry.arrays import Array
from .truth import Truth

LOCALHOST = "127.0.0.1"
IDLE = 0.02
"""s: a device with nothing to send looks this often for orders."""

BLOCK = 0.001
"""s between two wake-ups of a device that is faster: the rows since then leave together."""

Packets: TypeAlias = list[bytes]
Fault: TypeAlias = Callable[[Packets], "Packets | None"]
"""Changes the packets of a wake-up; None: it holds them until there are more."""


class Clock:
    """A device's own: row k is at `start + k / rate`, `rate` being what its quartz makes of the one it means."""

    def __init__(self, rate: float, drift: float, jitter: float) -> None:
        self._drift, self._jitter, self._rng = drift, jitter, np.random.default_rng(0)
        self.running, self.start, self.row, self.nominal = False, 0.0, 0, rate
        self.set(rate)

    def set(self, rate: float) -> None:
        """Mean this rate, Hz; another one from a new start on."""
        self.running = self.running and rate == self.nominal
        self.nominal, self.rate = rate, rate * (1.0 + 1e-6 * self._drift)
        self._block = max(round(BLOCK * rate), 1)

    def begin(self) -> None:
        """Row 0 is now."""
        self.running, self.start, self.row = True, monotonic(), 0
        self._schedule()

    def time(self, row: int) -> float:
        """When a row is, by the lab's clock."""
        return self.start + row / self.rate

    def due(self) -> int:
        """How many rows have become due: none before the next deadline."""
        if (now := monotonic()) < self._deadline:
            return 0
        rows = int((now - self.start) * self.rate) + 1 - self.row
        self.row += rows
        self._schedule()
        return rows

    def remaining(self) -> float:
        """Until the next deadline, s."""
        return max(self._deadline - monotonic(), 0.0)

    def _schedule(self) -> None:
        self._deadline = self.time(self.row + self._block - 1) + self._jitter * self._rng.random()


class Fake(ABC):
    """A fake device in a `with` block, of `rate` rows a second, on a `port` of 127.0.0.1, 0: any that is free.

    `clock_drift` ppm: above 0 its clock is fast; `jitter` s: by which its packets are late at most; `true_rate` Hz:
    what it sends at whatever it is asked for. Raises `FileAccessError`: the port is taken.
    """

    scheme: str

    def __init__(
        self,
        truth: Truth,
        rate: float,
        *,
        port: int = 0,
        clock_drift: float = 0.0,
        jitter: float = 0.0,
        true_rate: float | None = None,
        host: str = LOCALHOST,
    ) -> None:
        self.truth, self.host, self.port, self._true_rate = truth, host, port, true_rate
        self.rate = rate  # what it was asked for, Hz
        self.counter, self.state = 0, 0  # of its next packet; and the status that it shows
        self.clock = Clock(true_rate or rate, clock_drift, jitter)
        self._powered = monotonic()
        self._orders: deque[tuple[Callable[[], None], Event]] = deque()
        self._faults: deque[Fault] = deque()
        self._held: Packets = []
        self._silent_until, self._closed_until, self._late = 0.0, 0.0, 0.0
        self._split, self._stopping = False, False
        self._thread = Thread(target=self._run, name=f"{type(self).__name__} of the lab", daemon=True)

    def __enter__(self) -> Self:
        try:
            self._open()
        except OSError as error:
            raise FileAccessError(
                f"port {self.port} of {self.host} cannot be listened on ({(error.strerror or str(error)).lower()}), "
                "expected a free one: choose another"
            ) from None
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stopping = True
        self._thread.join()
        self._close()

    @property
    def uri(self) -> str:
        """What a listener is given."""
        return f"{self.scheme}://{self.host}:{self.port}"

    def cut(self) -> None:
        """Close every connection; a new one is accepted."""
        self._order(self._cut)

    def silence(self, seconds: float) -> None:
        """Half-open for so long: neither send nor answer, with every connection open."""
        self._silent_until = monotonic() + seconds

    def refuse(self, seconds: float) -> None:
        """For so long nobody listens at the port, and no connection is left."""
        self._closed_until = monotonic() + seconds
        self._order(self._close)

    def late(self, seconds: float) -> None:
        """Answer every command so much later."""
        self._late = seconds

    def split(self, on: bool = True) -> None:
        """Cut every packet in two (a datagram: send its first half alone); otherwise a wake-up's packets are one."""
        self._split = on

    def garbage(self, data: bytes) -> None:
        """Send bytes that mean nothing between two packets."""
        self._faults.append(lambda packets: [packets[0], data, *packets[1:]])

    def skip(self, n: int) -> None:
        """Lose the next n packets."""

        def lose(packets: Packets) -> Packets:
            nonlocal n
            n, first = max(n - len(packets), 0), n
            if n > 0:
                self._faults.appendleft(lose)
            return packets[first:]

        self._faults.append(lose)

    def repeat(self) -> None:
        """Send a packet twice."""
        self._faults.append(lambda packets: [packets[0], *packets])

    def backwards(self) -> None:
        """Send two packets in the wrong order."""
        self._faults.append(lambda packets: [packets[1], packets[0], *packets[2:]] if len(packets) > 1 else None)

    def restart(self, number: int = 0) -> None:
        """As after power was off: count from there again, and time from 0."""

        def begin() -> None:
            self.counter, self._powered = number, monotonic()

        self._order(begin)

    def uptime(self, t: float) -> float:
        """What the device's own clock shows at a moment of the lab's, s since it was powered."""
        return (t - self._powered) * self.clock.rate / self.clock.nominal

    def status(self, word: int) -> None:
        """Show a status from now on; 0: all is well."""
        self.state = word

    def ask_rate(self, rate: float) -> None:
        """Take the rate that a client asks for, Hz, or hold on to its own."""
        self.rate = rate
        self.clock.set(self._true_rate or rate)

    def _order(self, what: Callable[[], None]) -> None:
        """Have the device's own thread do something, and wait until it is done."""
        done = Event()
        self._orders.append((what, done))
        while self._thread.is_alive() and not done.wait(IDLE):
            pass

    def _run(self) -> None:
        while not self._stopping:
            while self._orders:
                what, done = self._orders.popleft()
                what()
                done.set()
            if not self._closed_until:
                self._turn_and_show()
            elif monotonic() < self._closed_until:
                sleep(IDLE)
            else:
                with suppress(OSError):  # somebody has the port: try again
                    self._open()
                    self._closed_until, self.clock.running = 0.0, False

    def _turn_and_show(self) -> None:
        if not self._wanted():
            self.clock.running = False
        elif not self.clock.running:
            self.clock.begin()
        timeout = min(self.clock.remaining(), IDLE) if self.clock.running else IDLE
        if self._silent():
            sleep(timeout)
        else:
            self._turn(timeout)
        if self.clock.running and (rows := self.clock.due()):
            self._show(rows)

    def _silent(self) -> bool:
        return monotonic() < self._silent_until

    def _show(self, n: int) -> None:
        """Send the n rows that have become due; what has been lost counts too."""
        t0 = self.clock.time(self.clock.row - n)
        rows = self.truth.wrench_rows(t0, n, self.clock.rate)
        if not self._silent():
            self._send(t0, rows)
        self.counter += n

    def _faulty(self, packets: Packets) -> Packets:
        """A wake-up's packets after the faults that were asked for, one fault of each wake-up."""
        if not packets or not self._faults:
            return packets
        fault, packets, self._held = self._faults.popleft(), [*self._held, *packets], []
        changed = fault(packets)
        if changed is None:
            self._faults.appendleft(fault)
            self._held = packets
        return changed or []

    @abstractmethod
    def _open(self) -> None:
        """Listen."""

    @abstractmethod
    def _close(self) -> None:
        """Leave no socket."""

    @abstractmethod
    def _cut(self) -> None:
        """Leave no connection."""

    @abstractmethod
    def _wanted(self) -> bool:
        """Whether anybody wants rows."""

    @abstractmethod
    def _turn(self, timeout: float) -> None:
        """Take what comes within so many seconds."""

    @abstractmethod
    def _send(self, t0: float, rows: Array) -> None:
        """Send rows (n, 6), the first of them of `t0`, with numbers from `counter` on."""
