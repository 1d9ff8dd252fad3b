"""What a live session makes as files that can be read up to the last second, whatever happens to the program: raw
recordings, as `calibrate`, `compensate` and `--from` read them, and contact wrenches, in the columns of `compensate`.

A file that is there is replaced: whether it may be is asked before (cli/outputs.py); a folder never is.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import ExitStack
from itertools import chain
from pathlib import Path
from time import monotonic
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ...errors import FileFormatError
from ...files import cause_named, file_of
from ...geometry.arrays import Array
from ...geometry.orientation import ROTATION_TOLERANCE
from ...recording.bags.write import nanoseconds, stamped
from ...recording.tables.columns import FLAW, POSITION, WRENCH_COLUMNS
from ...recording.tables.write import JUDGEMENT, NAMES, columns_of, csv_lines, quoted
from ...samples.samples import LARGEST_READING
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
RAW_NAMES = ("t", *WRENCH_COLUMNS, "qx", "qy", "qz", "qw", *POSITION, FLAW)
RAW_ROW = "%r," * 7 + "%.9g," * 7 + "%s\n"
"""Times and readings to their last bit."""
POSES_KEPT = 1_000
"""Between which the positions at the times of later readings are found: 2 s of the fastest robot."""
Stamps: TypeAlias = NDArray[np.int64]


class GrowingFile(ABC):
    """Turns are put together in portions, and written each half second: it is enough to be given them now and then."""

    waits = gathers = True
    NAMES: tuple[str, ...] = ()
    """Of the columns."""
    ROWS = "judged"
    """What of a turn is a row of a table each."""

    def __init__(self, path: Path) -> None:
        if path.suffix.lower() not in FORMATS:
            raise FileFormatError(f"{path}: found the suffix {path.suffix or '(none)'}, expected {', '.join(FORMATS)}")
        self.uri, self._path, self._kind = str(path), path, FORMATS[path.suffix.lower()]
        self.written = self.dropped = 0
        self._kept: list[Turn] = []
        self._unwritten, self._more = 0, False
        self._added = self._wrote = monotonic()
        self._file: Growing | None = None

    def open(self) -> None:
        """Raises `FileAccessError`, and `MissingExtraError` without pyarrow or mcap."""
        with cause_named(self._path):
            file_of(self._path)
            self._file = self._kind(self._path)
            if isinstance(self._file, GrowingText):
                self._file.add([",".join(self.NAMES) + "\n"])  # comes with the first rows, or the end

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
        finally:
            self._file = None
            self.dropped, self._unwritten = self.dropped + self._unwritten, 0

    def _add(self) -> None:
        turns, self._kept = self._kept, []
        if self._file is None or not any(turn.rows for turn in turns):
            return
        turn = Turn.joined(turns)
        rows = len(getattr(turn, self.ROWS))
        self._more = True
        self.dropped += rows
        of: dict[Any, Any] = {GrowingText: self._lines, GrowingParquet: self._columns, GrowingMcap: self._messages}
        with cause_named(self._path):
            self._file.add(of[self._kind](turn))  # of poses alone no rows, but a Recorder keeps where they were
        self.dropped, self._unwritten = self.dropped - rows, self._unwritten + rows

    def _write(self) -> None:
        if self._file is None or not self._more:
            return
        with cause_named(self._path):
            self._file.write()
        self._more = False
        self.written, self._unwritten = self.written + self._unwritten, 0

    @abstractmethod
    def _messages(self, turn: Turn) -> Iterator[Message]:
        """What an MCAP gets."""

    @abstractmethod
    def _columns(self, turn: Turn) -> dict[str, Any]:
        """What Parquet gets, by name."""

    @abstractmethod
    def _lines(self, turn: Turn) -> Iterator[str]:
        """What CSV gets below the header; of poses alone nothing."""


class ContactFile(GrowingFile):
    """`--out FILE`: the contact wrenches, in the columns of `compensate`. An MCAP has them in `/wrench/contact`, their
    std in `/wrench/contact/std`, and in `/wrench/contact/judgement` whether they are valid, whenever that changes.
    """

    FORM = "FILE.csv, FILE.parquet, FILE.mcap"
    ABOUT = "contact wrenches, in the columns of compensate; what is a second old survives a crash"
    RATE = "the sensor's"
    TESTED = "read again, also after kill -9"
    NAMES = ("t", *NAMES, *JUDGEMENT)

    def __init__(self, uri: Uri) -> None:
        super().__init__(Path(uri.text.partition(":")[2]))
        self._said = ""

    def _messages(self, turn: Turn) -> Iterator[Message]:
        contact = turn.contact
        if contact is None or contact.t is None:
            return
        stamp = nanoseconds(contact.t)
        for topic, values in (("/wrench/contact", contact.wrench), ("/wrench/contact/std", contact.std)):
            yield from _stamped(topic, "sensor", stamp, stamp, values)
        judged = zip(stamp.tolist(), contact.valid.tolist(), contact.contact.tolist(), contact.reason, strict=True)
        for ns, valid, touches, reason in judged:
            said = f"{'valid' if valid else f'not valid ({reason})'}, {CONTACT[touches]}"
            if said != self._said:
                self._said = said
                yield "/wrench/contact/judgement", ns, ns, text_message(said)

    def _columns(self, turn: Turn) -> dict[str, Any]:
        return {} if turn.contact is None else columns_of(turn.contact)

    def _lines(self, turn: Turn) -> Iterator[str]:
        return iter(()) if turn.contact is None else csv_lines(turn.contact)


class Recorder(GrowingFile):
    """`--record FILE`. A table has a row for each reading with the orientation at its time, and the position, linear
    between two; an MCAP has `/wrench` and `/pose` at their own times, logged when they came.

    What no reader takes as a reading, because it has a flaw, is no number or has no orientation beside readings that
    have one, is a NaN there, and its numbers stand as text behind the reason: column `flaw`, topic `/flaw`.
    """

    NAMES, ROWS = RAW_NAMES, "readings"

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._posed = False
        self._pose_t, self._position = np.empty(0), np.empty((0, 3))

    def _messages(self, turn: Turn) -> Iterator[Message]:
        flaws, known = _flaws(turn), _is_orientation(turn.pose)
        stamp, arrival = nanoseconds(turn.t), nanoseconds(turn.arrival)
        yield from _stamped("/wrench", "sensor", arrival, stamp, _usable(turn.wrench, flaws))
        for came, ns, flaw in zip(arrival.tolist(), stamp.tolist(), _with_numbers(flaws, turn.wrench), strict=True):
            if flaw:
                yield "/flaw", came, ns, text_message(flaw)
        stamp, pose = nanoseconds(turn.pose_t), np.hstack([turn.position, turn.pose])
        yield from _stamped("/pose", "base", stamp[known], stamp[known], pose[known])
        for ns, row in zip(stamp[~known].tolist(), pose[~known].tolist(), strict=True):
            yield "/flaw", ns, ns, text_message(f"pose: no orientation {row}")

    def _columns(self, turn: Turn) -> dict[str, Any]:
        known = _is_orientation(turn.orientation)
        self._posed |= bool(known.any())
        flaws = [
            flaw or ("" if there or not self._posed else "no orientation")
            for flaw, there in zip(_flaws(turn), known.tolist(), strict=True)
        ]
        orientation = np.where(known[:, None], turn.orientation, np.nan)
        columns = np.column_stack([turn.t, _usable(turn.wrench, flaws), orientation, self._positions(turn)])
        return {**dict(zip(RAW_NAMES, columns.T, strict=False)), FLAW: _with_numbers(flaws, turn.wrench)}

    def _lines(self, turn: Turn) -> Iterator[str]:
        *numbers, flaws = self._columns(turn).values()
        cells = (*(column.tolist() for column in numbers), map(quoted, flaws))
        yield RAW_ROW * len(turn.t) % tuple(chain.from_iterable(zip(*cells, strict=True)))

    def _positions(self, turn: Turn) -> Array:
        known = np.isfinite(turn.position).all(axis=1)
        t, position = np.r_[self._pose_t, turn.pose_t[known]], np.vstack([self._position, turn.position[known]])
        order = np.argsort(t, kind="stable")[-POSES_KEPT:]
        if not len(order):
            return np.full((len(turn.t), 3), np.nan)
        self._pose_t, self._position = t[order], position[order]
        return np.column_stack([np.interp(turn.t, self._pose_t, axis) for axis in self._position.T])


def _stamped(topic: str, frame: str, came: Stamps, stamp: Stamps, values: Array) -> Iterator[Message]:
    for logged, ns, payload in zip(came.tolist(), stamp.tolist(), stamped(False, frame, stamp, values), strict=True):
        yield topic, logged, ns, payload


def _flaws(turn: Turn) -> list[str]:
    """Why each reading is none; empty: it is one."""
    number = np.asarray((np.abs(turn.wrench) <= LARGEST_READING).all(axis=1))
    return [flaw or ("" if good else "no number") for flaw, good in zip(turn.flaw, number.tolist(), strict=True)]


def _usable(wrench: Array, flaws: list[str]) -> Array:
    """The readings (n, 6), NaN where they have a flaw."""
    flawed = np.array(list(map(bool, flaws)), np.bool_)
    return np.where(flawed[:, None], np.nan, wrench)


def _with_numbers(flaws: list[str], wrench: Array) -> list[str]:
    """The flaws, each with what was read."""
    return [flaw and f"{flaw} {row}" for flaw, row in zip(flaws, wrench.tolist(), strict=True)]


def _is_orientation(quat_xyzw: Array) -> NDArray[np.bool_]:
    """Which of (n, 4) are quaternions as the readers take them."""
    length: Array = np.linalg.norm(quat_xyzw, axis=1)
    return np.asarray(np.abs(length - 1.0) < ROTATION_TOLERANCE, np.bool_)
