"""Lines with names to samples: what a recording's columns are called, and their units, hold here too."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import nullcontext, suppress
from functools import partial
from itertools import compress
from math import inf, isfinite, nan
from typing import cast

import numpy as np

from ...errors import FileFormatError, InputError
from ...geometry.orientation import to_quat_xyzw
from ...geometry.quaternions import unit
from ...recording.tables.columns import WRENCH_COLUMNS, Column, Naming, OpenTable, places_of
from ...recording.tables.header import Header
from ...recording.tables.orientations import orientation_columns
from ...recording.tables.roles import roles_beside, wrench_columns
from ...recording.tables.table import in_seconds
from ..counter import SLACK, Counter
from ..source import Batch, Four, Note, NoteKind, Sample, Six, Three

NO_NUMBER, WITHOUT = "broken: no number", "a line without a whole orientation"
LEAPS = 10
"""Lines in a row whose times are further apart than they can be: one is a clock that was set."""


class NamedColumns:
    """Rows of numbers under the same names, as in a recording, with what the URI states of them; `rate` Hz of such
    rows, None: not known, so that no loss is seen. Raises `InputError`: neither wrench nor orientation is among them.
    """

    def __init__(self, names: Iterable[str], naming: Naming, rate: float | None) -> None:
        table = OpenTable("the line", places_of(names, "the line"), partial(iter, ()))
        self.width = len(table.places)
        wrench: list[Column] = []
        self.lacks: dict[str, str] = {}
        """Why there is no `wrench`, or no `orientation`, though there are columns for one."""
        self._convention, angles = None, list[Column]()
        try:
            wrench = wrench_columns(table, naming)
        except FileFormatError as error:
            if Header.of(table, naming).candidates.keys() >= set(WRENCH_COLUMNS):
                self.lacks["wrench"] = str(error).removeprefix("the line: ").replace("--units ", "units=")
        with suppress(FileFormatError) if wrench or self.lacks else nullcontext():
            self._convention, angles = orientation_columns(table, naming)
        roles = roles_beside(table, naming, wrench, self._convention, angles)
        self._roles, self._counter = roles, Counter(1e-6, step=round(1e6 / rate) if rate else None, learns=True)
        self._first: float | None = None
        self._told = ""
        self._per_s, self._leaps, self._before = 0.0, 0, (inf, inf)

    def samples(self, rows: list[Sequence[float]], arrival: float, batch: Batch) -> None:
        """Put the rows into the batch; what is NaN in them is not there."""
        roles = self._roles
        turns = self._turns(rows) if roles.orientation else [(None, "")] * len(rows)
        for row, (turn, why) in zip(rows, turns, strict=True):
            device = sum(_in_si(row, roles.t)) if roles.t else nan
            if self._per_s == 0.0 and 0.0 < device < inf:  # the first may have no time
                self._per_s = device / float(np.asarray(in_seconds(np.array([_in_si(row, roles.t)]), roles.t))[0])
            device /= self._per_s or 1.0
            leap = self._leap(device, arrival)
            if isfinite(1e6 * device) and not leap:
                self._first = device if self._first is None else self._first
                if (fresh := self._counter.take(round(1e6 * device), arrival, batch)) is None:
                    continue
                device = self._first + fresh  # kinds of lines that begin at different times have one clock
            else:
                device = nan
            reading = _in_si(row, roles.wrench)
            wrench = cast(Six | None, _whole(reading))
            position = cast(Three | None, _whole(_in_si(row, roles.position)))
            flaw = "saturated: said by the sender" if any(row[each.place] > 0.0 for each in roles.saturated) else ""
            if wrench or turn:
                flaw = flaw or leap
                batch.samples.append(Sample(arrival, device, wrench, turn, position, flaw=flaw))
            elif reading:  # the sender has lost one, and goes on
                batch.samples.append(Sample(arrival, device, cast(Six, reading), flaw=NO_NUMBER))
            none = why or ("" if turn or reading else self.lacks.get("wrench", WITHOUT))
            if none and (none != self._told or not reading):  # a reading is used all the same
                batch.notes.append(Note(NoteKind.GARBAGE, none))
            self._told = none

    def _leap(self, device: float, arrival: float) -> str:
        """What is wrong with times that go on in another unit than s, which no clock does; else an empty text."""
        (before, arrived), self._before = self._before, (device, arrival)
        passed = device - before
        if passed != 0.0:  # two lines of one ms say nothing
            self._leaps = self._leaps + 1 if passed > 2.0 * (arrival - arrived) + SLACK else 0
        if self._leaps < LEAPS:
            return ""
        return f"broken: t goes on by {passed:.3g} s a line, expected s: name its unit, as t_ms, t_us or t_ns"

    def _turns(self, rows: list[Sequence[float]]) -> list[tuple[Four | None, str]]:
        """The orientations of rows; None where there is none, and why, where numbers are there for one."""
        values = [_in_si(row, self._roles.orientation) for row in rows]
        there = [all(map(isfinite, each)) for each in values]
        if self._convention is None or not any(there):
            return [(None, "")] * len(rows)
        if self._convention.name == "quat_xyzw" and all(map(unit, compress(cast(list[Four], values), there))):
            return [(cast(Four, q) if fine else None, "") for q, fine in zip(values, there, strict=True)]
        try:
            matrices = self._convention.to_matrices(np.array(list(compress(values, there))))
        except InputError as error:  # of one of them
            if len(rows) > 1:
                return [turn for row in rows for turn in self._turns([row])]
            self.lacks["orientation"] = str(error).replace("orientation 0", "the orientation")
            return [(None, self.lacks["orientation"])]
        quaternions = iter(to_quat_xyzw(matrices).tolist())
        return [(cast(Four, tuple(next(quaternions))) if fine else None, "") for fine in there]


def _in_si(row: Sequence[float], columns: tuple[Column, ...]) -> tuple[float, ...]:
    return tuple([row[each.place] / each.per_si for each in columns])


def _whole(values: tuple[float, ...]) -> tuple[float, ...] | None:
    return values if values and all(map(isfinite, values)) else None
