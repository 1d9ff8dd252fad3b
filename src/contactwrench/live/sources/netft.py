"""ATI Net F/T and Axia: records of counts by UDP (RDT), and what a count is worth from the box's own page."""

from __future__ import annotations

from contextlib import suppress
from http.client import HTTPConnection, HTTPException
from math import inf
from re import search
from socket import SHUT_RDWR
from struct import Struct
from threading import Event, Thread
from time import monotonic
from typing import TypeAlias

from ...recording.tables.units import per_si, unit_of
from ..counter import Counter
from ..source import About, Batch, DeviceError, Note, NoteKind, Sample
from ..uri import Uri, number_in
from .datagrams import Udp
from .reader import Reader

HTTP_PORT = 80
PAGE = "/netftapi2.xml"
_request = Struct(">HHI").pack
STOP, STREAM, ZERO = (_request(0x1234, command, 0) for command in (0, 2, 0x42))
_record = Struct(">III6i")
MODULUS = 1 << 32
MONITOR = 1 << 16
HARMLESS = 0, MONITOR, 1 << 31 | MONITOR
"""A threshold of the user's that was crossed is the only bit of the status that is no error, bit 31 sums all up."""
ENDS = -(1 << 31), (1 << 31) - 1
"""Counts that are no reading: what is beyond them looks the same."""
SATURATED = {"net": 1 << 17, "axia": 1 << 27 | 1 << 30}
"""ATI's manuals: of a Net F/T, saturation or A/D; of an Axia, a gage, or force and torque, out of range."""
RATES = "comrdtrate", "cfgcomrdtrate"
"""Of its page: as the box has it, and as it was taken to be."""
PATIENCE = 3.0
"""s for the page: to connect, and to answer."""
LOOK_AGAIN, SAME = 5.0, 1e-6
"""s from one look at the page to the next, and the part by which a number of it is another one."""
Said: TypeAlias = tuple[float, float, float]
NAMES = "counts of one N", "counts of one N m", "records a second"
AGAIN = 1.0
"""s of silence after which the stream is asked for again: a box that was switched off has forgotten it."""


class NetFtDecoder:
    """Records to samples: counts of one N and one N m, at `rate` Hz; `saturated`: the bits of a status that say it."""

    def __init__(self, force: float, torque: float, rate: float, saturated: int) -> None:
        self._force, self._torque = 1.0 / force, 1.0 / torque
        self._counter, self._saturated = Counter(1.0 / rate, MODULUS), saturated
        self._status = 0

    def feed(self, data: bytes, arrival: float, batch: Batch) -> None:
        """Put the records into the batch."""
        if not data or len(data) % _record.size:
            batch.notes.append(Note(NoteKind.GARBAGE, f"{len(data)} bytes that are no record", len(data)))
            return
        f, t = self._force, self._torque
        for number, _, status, fx, fy, fz, tx, ty, tz in _record.iter_unpack(data):
            device = self._counter.take(number, arrival, batch)
            if status != self._status:
                self._status = status
                batch.notes.append(Note(NoteKind.STATUS, f"status 0x{status:08x}"))
            if device is not None:
                flaw = self._flaw(status) if status else ""
                if min(fx, fy, fz, tx, ty, tz) == ENDS[0] or max(fx, fy, fz, tx, ty, tz) == ENDS[1]:
                    flaw = flaw or "saturated: a count is at the end of its range"
                wrench = fx * f, fy * f, fz * f, tx * t, ty * t, tz * t
                batch.samples.append(Sample(arrival, device, wrench, flaw=flaw))

    def _flaw(self, status: int) -> str:
        word = "saturated" if status & self._saturated else "broken" if status not in HARMLESS else ""
        return f"{word}: status 0x{status:08x}" if word else ""


class NetFt(Reader[Udp]):
    """The box; its rate is set on its page."""

    FORM = "netft://HOST[:49152][?http=80][&zero=1]"
    ABOUT = "ATI Net F/T, Axia with Ethernet: wrench; http: the port of its page; zero=1: the box zeroes itself first"
    RATE = "as set on its page, at most 7000 Hz"
    TESTED = "its fake in the lab, written from ATI's manual; no box"
    PORT, OPTIONS = 49_152, ("http", "zero")

    def __init__(self, uri: Uri) -> None:
        super().__init__(uri, Udp(uri.text, "Net F/T"), STOP)
        self._http = uri.whole("http", HTTP_PORT)
        self._changed, self._closed = "", Event()

    def open(self) -> About:
        """As `Source`."""
        deadline = self._link.deadline()
        self._changed, self._closed = "", Event()
        self._link.addresses(*self._at)  # or the page would be asked of nobody
        name, said, address = self._said()
        *_, rate = said
        self._link.connect(address, self._at[1])
        if self._is_to_zero:
            self._link.send(ZERO)
        self._link.send(STREAM)
        saturated = SATURATED["axia" if "axia" in name.lower() else "net"]
        self._begin(NetFtDecoder(*said, saturated))
        self._heard = monotonic()
        self._first(deadline, lambda: self._link.silent("records"))
        settings = self._zeroed_now()
        Thread(target=self._look, args=(said, self._closed), name=f"page of {self.uri}", daemon=True).start()
        return About(f"ATI {name}", wrench=True, orientation=False, rate=rate, settings=settings)

    def read(self, timeout: float) -> Batch:
        """As `Source`; after silence the stream is asked for again, and what its page says has to stay."""
        if self._changed:
            do = f"it is connected to again; what it sent in the last {LOOK_AGAIN:g} s may be off by that"
            raise self._link.error(self._changed, "what its page said before", do)
        batch = super().read(timeout)
        if batch.samples:
            self._heard = monotonic()
        elif monotonic() - self._heard > AGAIN:
            self._heard = monotonic()
            self._link.send(STREAM)
        return batch

    def close(self) -> None:
        """As `Source`."""
        self._closed.set()
        with suppress(OSError, AttributeError):  # not connected, or just closed
            self._asking.sock.shutdown(SHUT_RDWR)
        super().close()

    def _look(self, before: Said, closed: Event) -> None:
        """Look at the page again and again: what a count is worth may be changed on it, and no record says so."""
        while not closed.wait(LOOK_AGAIN):
            with suppress(DeviceError):  # a page that is gone is no fault while records come
                now = self._said()[1]
                for name, was, said in zip(NAMES, before, now, strict=True):
                    if abs(said - was) > SAME * was and not closed.is_set():
                        self._changed = f"{said:g} {name}"
                        return

    def _said(self) -> tuple[str, Said, str]:
        """What the page says: the box's name; counts of one N and of one N m, and Hz; and the address at which it was
        found: a name may have others, at which the box is not.
        """
        page, address = self._page()
        name = _text(page, "prodname") or "Net F/T"
        rate = number_in(next(filter(None, (_text(page, tag) for tag in RATES)), ""))
        counts = self._counts(page, "force", "cfgcpf", "scfgfu"), self._counts(page, "torque", "cfgcpt", "scfgtu")
        if not 0.0 < rate < inf:
            raise self._link.error("no rate on the page", RATES[0], "set the RDT rate on the box's page")
        return name, (*counts, rate), address

    def _page(self) -> tuple[str, str]:
        self._asking = connection = HTTPConnection(self._at[0], self._http, timeout=PATIENCE)
        try:
            connection.connect()
            address: str = connection.sock.getpeername()[0]
            connection.request("GET", PAGE)
            page = connection.getresponse().read(1 << 18).decode("latin-1")
        except (OSError, HTTPException) as error:
            found = (
                f"no page at port {self._http} ({(getattr(error, 'strerror', '') or str(error) or 'other').lower()})"
            )
            raise self._link.error(found, f"the box's {PAGE}", "check its power, cable and address") from None
        finally:
            connection.close()
        if not _text(page, "cfgcpf"):
            raise self._link.another(page.encode("latin-1"), f"the box's {PAGE}")
        return page, address

    def _counts(self, page: str, quantity: str, of: str, unit: str) -> float:
        """Counts of one N or N m."""
        number, spelled = _text(page, of), _text(page, unit)
        kilo = quantity == "force" and spelled.lower().startswith("klb")  # the only unit of ATI's that no table has
        counts, known = number_in(number), unit_of(quantity, spelled[1:] if kilo else spelled)
        if known is None or not 0.0 < counts < inf:
            expected = f"counts of a unit of {quantity}"
            do = f"set its {quantity} units to {'N' if quantity == 'force' else 'N-m'} on its page"
            found = f"{number or 'nothing'} per {spelled or 'nothing'}"
            raise self._link.error(found, expected, "set it on its page" if known else do)
        return counts * per_si(quantity, known) / (1e3 if kilo else 1.0)


def _text(page: str, tag: str) -> str:
    found = search(f"<{tag}>([^<]*)</{tag}>", page)
    return found[1].strip() if found else ""
