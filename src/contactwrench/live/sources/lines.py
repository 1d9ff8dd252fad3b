"""Anything else: one JSON object or CSV line a sample, by UDP, TCP or standard input, with the names of a recording."""

from __future__ import annotations

import re
from abc import abstractmethod
from collections.abc import Sequence
from contextlib import suppress
from math import nan
from typing import Any

import msgspec

from ...errors import InputError, visible
from ...geometry.orientation import convention
from ...recording.tables.columns import Naming
from ...recording.tables.layout import layout_of
from ...recording.tables.text_cells import cells
from ...recording.tables.units import stated_units
from ...statistics import counted
from ..source import TAKEN_FOR_THE_FLANGE, About, Batch, DeviceError, Note, NoteKind, now
from ..uri import Uri
from .columns import NamedColumns
from .datagrams import Udp
from .reader import AnyLink, Reader
from .transport import LISTENS, Deadline, StandardInput, Tcp

OPTIONS = "[?rate=HZ][&columns=t,fx,..][&orientation=NAME[:COLUMNS]][&units=force=kgf,..]"
LONGEST, SHOWN = 65_536, 60
"""Bytes of a line, and of one that is shown."""
_no_number = re.compile(rb"(?<=[\s:,[])-?(?:NaN|Infinity)(?=[\s,\]}])").sub
MOST_KINDS = 16
"""Sets of names that are remembered."""
OTHERS = 0.3
"""s after the first sample in which a line of another kind may come: wrench and orientation may have one each."""
EXPECTED = (
    'lines such as {"t": 0.001, "fx": 0, "fy": 0, "fz": 0, "tx": 0, "ty": 0, "tz": 0, "qx": 0, "qy": 0, "qz": 0, '
    '"qw": 1}, or CSV below a header'
)


class LinesDecoder:
    """Bytes to samples; `columns` of CSV without a header; `whole`: what is fed ends with a line's end."""

    def __init__(self, naming: Naming, rate: float | None, columns: Sequence[str] = (), whole: bool = False) -> None:
        self._naming, self._rate, self._whole, self.rest = naming, rate, whole, b""
        self._kinds: dict[tuple[str, ...], NamedColumns] = {}
        self._csv: NamedColumns | None = self._kind(tuple(columns)) if columns else None
        self._separator = ""
        self.refused = b""
        """The last line that was no sample; `rest` is what has no end yet."""

    def feed(self, data: bytes, arrival: float, batch: Batch) -> None:
        """Put what is whole into the batch, and keep the rest."""
        *lines, self.rest = (self.rest + data + (b"\n" if self._whole else b"")).split(b"\n")
        if len(self.rest) > LONGEST:
            lines, self.rest = [*lines, self.rest[:LONGEST]], b""
        kind: NamedColumns | None = None
        rows: list[Sequence[float]] = []
        for line in filter(None, map(bytes.strip, lines)):
            try:
                of, row = self._row(line)
            except (InputError, ValueError):
                self.refused = line
                batch.notes.append(Note(NoteKind.GARBAGE, f"a line of {len(line)} bytes that is no sample", len(line)))
                continue
            if of is not kind and kind is not None:
                kind.samples(rows, arrival, batch)
                rows = []
            kind = of or kind
            rows += [row] if of is not None else []
        if kind is not None:
            kind.samples(rows, arrival, batch)

    @property
    def lacks(self) -> dict[str, str]:
        """Why lines have no `wrench`, or no `orientation`, though they have columns for one."""
        return {what: why for kind in self._kinds.values() for what, why in kind.lacks.items()}

    def _row(self, line: bytes) -> tuple[NamedColumns | None, Sequence[float]]:
        """The numbers of a line and what they are; nothing of a header or comment. Raises `ValueError`."""
        if line.startswith(b"{"):
            values = _flat(_object(line))
            return self._kind(tuple(values)), list(values.values())
        text = line.decode()
        if text.startswith("#"):
            return None, ()
        if self._csv is not None:
            try:
                return self._csv, self._numbers(text, self._csv.width)
            except ValueError:
                if self._is_numbers(text):
                    raise
        return self._header(text)

    def _header(self, text: str) -> tuple[None, Sequence[float]]:
        numbers = self._is_numbers(text)
        found = None if numbers else layout_of([text], "the line")
        if numbers or (found is not None and found[1].unnamed):
            raise ValueError("found numbers, expected a header first: send one, or say ?columns=t,fx,fy,fz,tx,ty,tz,..")
        if found is None:
            return None, ()
        layout = found[1]
        self._csv, self._separator = self._kind(layout.names), layout.separator
        return None, ()

    def _numbers(self, text: str, width: int) -> list[float]:
        separator = self._separator or next((each for each in ("\t", ";", ",") if each in text), " ")
        row = cells(text, separator, 0, "the line") if '"' in text else text.split(separator.strip(" ") or None)
        if len(row) != width:
            raise ValueError(f"found {counted(len(row), 'value')}, expected {width} as in the header")
        if separator != "," and "," in text:
            row = [cell.replace(",", ".") for cell in row]
        return [float(cell) if cell.strip() else nan for cell in row]

    def _is_numbers(self, text: str) -> bool:
        return text[0] in "+-.0123456789"

    def _kind(self, names: tuple[str, ...]) -> NamedColumns:
        if (found := self._kinds.get(names)) is None:
            if len(self._kinds) >= MOST_KINDS:
                self._kinds.clear()
            found = self._kinds[names] = NamedColumns(names, self._naming, self._rate)
        return found


def _object(line: bytes) -> Any:
    """What a line of JSON holds; Python's NaN and Infinity, which no JSON has, as null. Raises `ValueError`."""
    try:
        return msgspec.json.decode(line)
    except msgspec.DecodeError:
        return msgspec.json.decode(_no_number(b"null", line))


def _flat(values: Any) -> dict[str, float]:
    """Numbers by name, those of a list as `name[0]`; null is NaN. Raises `ValueError`."""
    found: dict[str, float] = {}
    for name, value in values.items():
        for k, each in enumerate(value) if isinstance(value, list) else [(None, value)]:
            if each is None or isinstance(each, int | float):
                found[name if k is None else f"{name}[{k}]"] = nan if each is None else each
    return found


class _Lines(Reader[AnyLink]):
    ABOUT = (
        "one JSON object or CSV line a sample, columns named as in a recording; columns: of CSV without a header; "
        "orientation, units: as --orientation and --units; rate: by which lost lines show"
    )
    RATE = "the sender's"
    TESTED = "the lab's senders"
    OPTIONS = "rate", "columns", "orientation", "units"
    WHOLE, LIKE = False, ""
    """Whether what comes ends with a line's end; and an address with its port, where it has to have one."""
    WAITS: float | None = LISTENS
    """s for the first line; None: as for any device that is connected to."""

    def __init__(self, uri: Uri, link: AnyLink) -> None:
        super().__init__(uri, link)
        if self.LIKE and uri.port is None:
            raise InputError(f"{uri}: found no port, expected one, as {self.LIKE}")
        self._rate = uri.rate()
        self._naming = Naming(orientation=uri.options.get("orientation", "auto"), units=uri.options.get("units"))
        self._columns = [name.strip() for name in uri.options.get("columns", "").split(",") if name.strip()]
        try:
            stated_units(self._naming.units)
            if (named := uri.options.get("orientation", "auto")) != "auto":
                convention(named)
            self._fresh()
        except InputError as error:
            raise InputError(f"{uri}: {str(error).removeprefix('the line: ').removeprefix('--')}") from None

    def open(self) -> About:
        """As `Source`."""
        deadline = self._link.deadline(self.WAITS)
        self._connect(deadline)
        decoder = self._fresh()
        self._begin(decoder)
        try:
            early = self._first(deadline, self._silent)
        except DeviceError:
            for why in decoder.lacks.values():
                raise DeviceError(f"{self.uri}: {why}") from None
            if not (line := (decoder.refused or decoder.rest)[:SHOWN]):
                raise
            found = f"the line '{visible(line.decode('latin-1'))}'"
            do = "name what it sends so, or state ?columns=t,fx,fy,fz,tx,ty,tz,.."
            raise self._link.error(found, EXPECTED, do) from None
        others = self._link.deadline(OTHERS)
        with suppress(DeviceError):  # lines that end so soon are lines all the same
            while others.left and not (_any(early, "wrench") and _any(early, "orientation")):
                for data in self._link.receive(others.left):
                    decoder.feed(data, now(), early)
        wrench, orientation = _any(early, "wrench"), _any(early, "orientation")
        name = f"lines of {self.uri.partition('?')[0]}"
        settings = {f"no {what}": why for what, why in decoder.lacks.items() if not _any(early, what)}
        settings |= {"pose": TAKEN_FOR_THE_FLANGE} if orientation else {}
        return About(name, wrench, orientation, self._rate, settings=settings, listens=self.WHOLE)

    def _silent(self) -> DeviceError:
        """What is raised where nothing comes."""
        return self._link.silent(EXPECTED)

    def _fresh(self) -> LinesDecoder:
        return LinesDecoder(self._naming, self._rate, self._columns, self.WHOLE)

    @abstractmethod
    def _connect(self, deadline: Deadline) -> None:
        """To whoever sends."""


def _any(batch: Batch, name: str) -> bool:
    return any(getattr(sample, name) is not None for sample in batch.samples)


class UdpLines(_Lines[Udp]):
    """A port that others send to."""

    FORM = f"udp://[HOST]:PORT{OPTIONS}"
    WHOLE, LIKE = True, "udp://:9000"

    def __init__(self, uri: Uri) -> None:
        super().__init__(uri, Udp(uri.text, "sender of lines"))

    def _connect(self, deadline: Deadline) -> None:
        self.port = self._link.bind(*self._at)

    def _silent(self) -> DeviceError:
        do = f"let the sender send to port {self.port} of this computer"
        return self._link.nobody(f"port {self.port}", EXPECTED, do)


class TcpLines(_Lines[Tcp]):
    """A server."""

    FORM, LIKE = f"tcp://HOST:PORT{OPTIONS}", "tcp://192.168.0.10:9000"
    WAITS = None

    def __init__(self, uri: Uri) -> None:
        super().__init__(uri, Tcp(uri.text, "server of lines"))

    def _connect(self, deadline: Deadline) -> None:
        self._link.connect(*self._at, deadline)


class StdinLines(_Lines[StandardInput]):
    """What another program writes."""

    FORM = f"stdin:{OPTIONS}"

    def __init__(self, uri: Uri) -> None:
        super().__init__(uri, StandardInput(uri.text, "program that writes lines"))

    def _connect(self, deadline: Deadline) -> None:
        self._link.start()

    def _silent(self) -> DeviceError:
        return self._link.nobody("standard input", EXPECTED, "let the program write lines, and flush each of them")
