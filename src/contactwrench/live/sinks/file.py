"""What a live session makes as files that can be read up to the last second, whatever happens to the program.

A file that is there is replaced: whether it may be is asked before (cli/outputs.py); a folder never is.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from time import monotonic
from typing import Any

from ...errors import FileFormatError
from ...files import cause_named, file_of
from ...recording.bags.write import nanoseconds, stamped
from ...recording.tables.write import JUDGEMENT, NAMES, columns_of, csv_lines
from ..sink import Turn
from ..uri import Uri
from .growing import Growing, GrowingMcap, GrowingParquet, GrowingText, Message, text_message

PORTION, EVERY = 0.05, 0.5
"""s of turns that become messages at once, as the worker waits meanwhile; between two writes: half of what may be lost,
and what the rows of a table are made of, as their positions lie between poses.
"""
FORMATS: dict[str, type[Growing]] = {".csv": GrowingText, ".parquet": GrowingParquet, ".mcap": GrowingMcap}
CONTACT = ("free", "in contact", "contact not judged")
"""By the code of `ContactWrenches.contact`, of which -1 is the last place."""


class GrowingFile(ABC):
    """Turns are put together in portions, and written each half second: it is enough to be given them now and then."""

    waits = gathers = True
    HEADER = ""
    """Of CSV, its line's end with it."""

    def __init__(self, path: Path) -> None:
        if path.suffix.lower() not in FORMATS:
            raise FileFormatError(f"{path}: found the suffix {path.suffix or '(none)'}, expected {', '.join(FORMATS)}")
        self.uri, self._path, self._kind = str(path), path, FORMATS[path.suffix.lower()]
        self.written = self.dropped = 0
        self._kept: list[Turn] = []
        self._unwritten, self._more, self._begun = 0, False, False
        self._added = self._wrote = monotonic()
        self._file: Growing | None = None

    def open(self) -> None:
        """Raises `FileAccessError`, and `MissingExtraError` without pyarrow or mcap."""
        with cause_named(self._path):
            file_of(self._path)
            self._file = self._kind(self._path)

    def write(self, turn: Turn) -> None:
        """Keep a turn, and write what is kept when it is time to. Raises `FileAccessError`."""
        self._kept.append(turn)
        t = monotonic()
        if t - self._added >= (PORTION if self._kind is GrowingMcap else EVERY):
            self._added = t
            try:
                self._add()
            except Exception:
                self._write()
                raise
        if t - self._wrote >= EVERY:
            self._wrote = t
            self._write()

    def close(self) -> None:
        """Write what is kept, and close the file. Raises `FileAccessError`."""
        try:
            with cause_named(self._path), ExitStack() as stack:
                if self._file is not None:
                    stack.callback(self._file.close)
                stack.callback(self._write)
                self._add()
                if isinstance(self._file, GrowingText) and not self._begun:
                    self._file.add(self.HEADER)  # no row came: a table without rows can be read, no bytes cannot
                    self._more = True
        finally:
            self._file = None
            self.dropped, self._unwritten = self.dropped + self._unwritten, 0

    def _add(self) -> None:
        turns, self._kept = self._kept, []
        if self._file is None or not any(turn.rows for turn in turns):
            return
        turn = Turn.joined(turns)
        rows = self._rows_of(turn)
        self._more = True
        self.dropped += rows
        with cause_named(self._path):
            match self._file:
                case GrowingMcap():
                    self._file.add(self._messages(turn))
                case GrowingParquet() if rows:
                    self._file.add(self._columns(turn))
                case GrowingText():
                    header = self.HEADER if rows and not self._begun else ""
                    self._file.add("".join([header, *self._lines(turn)]))
                    self._begun |= bool(rows)
        self.dropped, self._unwritten = self.dropped - rows, self._unwritten + rows

    def _write(self) -> None:
        if self._file is None or not self._more:
            return
        with cause_named(self._path):
            self._file.write()
        self._more = False
        self.written, self._unwritten = self.written + self._unwritten, 0

    @abstractmethod
    def _rows_of(self, turn: Turn) -> int:
        """How many rows of a table a turn makes."""

    @abstractmethod
    def _messages(self, turn: Turn) -> Iterator[Message]:
        """What an MCAP gets."""

    @abstractmethod
    def _columns(self, turn: Turn) -> dict[str, Any]:
        """What Parquet gets, by name; there is at least a row."""

    @abstractmethod
    def _lines(self, turn: Turn) -> Iterator[str]:
        """What CSV gets below the header."""


class ContactFile(GrowingFile):
    """`--out FILE`: the contact wrenches, in the columns of `compensate`. An MCAP has them in `/wrench/contact`, their
    std in `/wrench/contact/std`, and in `/wrench/contact/judgement` whether they are valid, whenever that changes.
    """

    FORM = "FILE.csv, FILE.parquet, FILE.mcap"
    ABOUT = "contact wrenches, in the columns of compensate; what is a second old survives a crash"
    RATE = "the sensor's"
    TESTED = "read again, also after kill -9"
    HEADER = ",".join(["t", *NAMES, *JUDGEMENT]) + "\n"

    def __init__(self, uri: Uri) -> None:
        super().__init__(Path(uri.text.partition(":")[2]))
        self._said = ""

    def _rows_of(self, turn: Turn) -> int:
        return 0 if turn.contact is None else len(turn.contact)

    def _messages(self, turn: Turn) -> Iterator[Message]:
        contact = turn.contact
        if contact is None or contact.t is None:
            return
        stamp = nanoseconds(contact.t)
        for topic, values in (("/wrench/contact", contact.wrench), ("/wrench/contact/std", contact.std)):
            for ns, payload in zip(stamp.tolist(), stamped(False, "sensor", stamp, values), strict=True):
                yield topic, ns, ns, payload
        judged = zip(stamp.tolist(), contact.valid.tolist(), contact.contact.tolist(), contact.reason, strict=True)
        for ns, valid, touches, reason in judged:
            said = f"{'valid' if valid else f'not valid ({reason})'}, {CONTACT[touches]}"
            if said != self._said:
                self._said = said
                yield "/wrench/contact/judgement", ns, ns, text_message(said)

    def _columns(self, turn: Turn) -> dict[str, Any]:
        return {} if turn.contact is None else columns_of(turn.contact)

    def _lines(self, turn: Turn) -> Iterator[str]:
        if turn.contact is not None:
            yield from csv_lines(turn.contact)
