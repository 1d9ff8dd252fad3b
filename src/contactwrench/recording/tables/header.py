"""Which columns of a table could be what: what each header says, judged beside all the others.

Letters alone are ambiguous: `tx` and `mx` are a torque where a force `fx` stands beside them, or where their unit or a
word such as `wrench` says so; else they may be a translation, and `mx` beside `ax` or `gx` a magnetometer's. Numbered
columns count from 0 or from 1, and only as a whole set.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from operator import attrgetter

from ...errors import FileFormatError, InputError
from .columns import NANOSECONDS, WRENCH_COLUMNS, Column, Naming, OpenTable, listed, shown, without_own_name
from .names import ESTIMATES, QUANTITIES, SECONDS, VECTORS, Meaning, meaning, quantity_of, stated_unit
from .units import UNITS, UNREADABLE, per_si, stated_units, symbol, unit_of

LONGEST_SLICE = 1000
"""Elements of a list that an option may name at once."""


@dataclass(frozen=True)
class Candidate:
    """A column by its name and place, and what its header says."""

    name: str
    place: int
    said: Meaning


@dataclass(frozen=True, eq=False)
class Header:
    """The names of a table's columns, each with its place, and the `units` that somebody stated. A part's `quantity`, a
    key of `UNITS`, is by default that of its usual name.
    """

    source: str
    places: dict[str, int]
    units: dict[str, str]

    @classmethod
    def of(cls, table: OpenTable, naming: Naming) -> Header:
        """That of a table. Raises `InputError` for units that are none."""
        return cls(table.source, table.places, stated_units(naming.units))

    @cached_property
    def candidates(self) -> dict[str, list[Candidate]]:
        """The columns that could be each part, by its usual name, in the order of the file."""
        by_part: dict[str, list[Candidate]] = defaultdict(list)
        numbered: dict[tuple[str, str], list[Candidate]] = defaultdict(list)
        for name, place in self.places.items():
            said = meaning(name)
            if said is not None and _could_be(said):
                candidate = Candidate(name, place, said)
                if said.index is None:
                    by_part[said.part].append(candidate)
                else:
                    numbered[said.part, said.of].append(candidate)
        for (vector, _), columns in numbered.items():
            parts = VECTORS.get(vector, tuple(f"{vector}_{k}" for k in range(len(WRENCH_COLUMNS))))
            columns.sort(key=lambda column: column.said.index or 0)
            indices = [column.said.index for column in columns]
            if indices in (list(range(len(parts))), list(range(1, len(parts) + 1))):
                for part, column in zip(parts, columns, strict=True):
                    by_part[part].append(column)
        beside_forces = any(column.said.letter for column in by_part["fx"])
        beside_an_imu = not {"ax", "gx"}.isdisjoint(name.lower() for name in self.places)
        for part in WRENCH_COLUMNS[3:]:
            by_part[part] = [
                column
                for column in by_part[part]
                if not column.said.letter or (beside_forces and not (beside_an_imu and column.name.lower()[0] == "m"))
            ]
        return {part: sorted(columns, key=attrgetter("place")) for part, columns in by_part.items() if columns}

    def first(self, part: str) -> Candidate | None:
        """The first column that could be a part."""
        return next(iter(self.candidates.get(part, ())), None)

    def perhaps_torque(self, missing: list[str]) -> list[Candidate]:
        """The columns whose one letter may be of a torque, of a part that is `missing`, or of something else."""
        said = [(name, place, meaning(name)) for name, place in self.places.items()]
        parts = set(missing) & set(WRENCH_COLUMNS[3:])
        return [Candidate(name, at, told) for name, at, told in said if told and told.letter and told.part in parts]

    def estimates(self) -> dict[str, list[Candidate]]:
        """Of each controller's estimate of the contact wrench that is there, its six columns."""
        return {
            vector: [self.candidates[f"{vector}_{k}"][0] for k in range(len(WRENCH_COLUMNS))]
            for vector in ESTIMATES
            if f"{vector}_0" in self.candidates
        }

    def stamps(self) -> list[tuple[Candidate, ...]]:
        """The times that a table has: a column, or those of seconds and nanoseconds of one stamp."""
        seconds, nanoseconds = self.candidates.get(SECONDS, []), self.candidates.get(NANOSECONDS, [])
        pairs = [(s, ns) for s in seconds for ns in nanoseconds if s.said.of == ns.said.of]
        paired = {column for pair in pairs for column in pair}
        alone = [column for column in (*seconds, *nanoseconds) if column not in paired and column.said.of]
        whole = [column for column in alone if column.said.unit == "s" or not column.said.of.endswith("stamp")]
        return [*pairs, *((column,) for column in (*self.candidates.get("t", []), *whole))]

    def usual(self, part: str, quantity: str | None = None) -> Candidate | None:
        """The column of a part's usual name, in any case, with a unit's suffix or without; two are refused."""
        known = UNITS[QUANTITIES.get(part, "") if quantity is None else quantity]
        spelled = {part: "", **{f"{part}_{symbol(unit)}": unit for unit in known if unit[:2] != "mN"}}
        there = [
            Candidate(name, place, Meaning(part, spelled[name.lower()]))
            for name, place in self.places.items()
            if name.lower() in spelled
        ]
        if len(there) > 1:
            names = " and ".join(column.name for column in sorted(there, key=lambda column: len(column.name)))
            raise FileFormatError(f"{self.source}: found columns {names}, expected one of them: remove the other")
        return there[0] if there else None

    def named(self, name: str, part: str, quantity: str | None = None) -> Candidate | None:
        """The column that an option names, in any case, with or without the unit in brackets after it, of an element of
        a list its name; None where there is none.
        """
        quantity = QUANTITIES.get(part, "") if quantity is None else quantity
        wanted = name.strip().lower()
        for form in (str, _without_unit, without_own_name):
            found = [spelled for spelled in self.places if form(spelled.lower()) == wanted]
            if len(found) == 1:
                unit = stated_unit(quantity, found[0]) if quantity else ""
                return Candidate(found[0], self.places[found[0]], Meaning(part, unit))
        return None

    def expanded(self, text: str) -> str:
        """Names in place of slices: `a[0],a[1]` for `a[0:2]`, or `a_0,a_1`. Raises `InputError` for slices that are
        none.
        """
        there = {without_own_name(_without_unit(name.lower())) for name in self.places}

        def elements(match: re.Match[str]) -> str:
            first, end = int(match[2] or 0), int(match[3])
            if not 0 < end - first <= LONGEST_SLICE:
                raise InputError(
                    f"{self.source}: found no elements {shown(match[0])}, expected those of a list: name one"
                )
            form = "{}[{}]" if f"{match[1]}[{first}]".lower() in there else "{}_{}"
            return ",".join(form.format(match[1], k) for k in range(first, end))

        return re.sub(r"([^,:]+)\[(\d*):(\d+)\]", elements, text)

    def column(self, candidate: Candidate, role: str, quantity: str | None = None, default: str = "") -> Column:
        """A column in the unit that its header states, or `units`, or `default`. Raises for none, or two."""
        quantity = QUANTITIES.get(role, "") if quantity is None else quantity
        where = f"{self.source}: column {shown(candidate.name)}"
        stated, by_option = candidate.said.unit, self.units.get(quantity)
        if stated == UNREADABLE and by_option is None:
            raise FileFormatError(
                f"{where}: found a name that is no UTF-8 and may state a unit, expected to know it: say --units "
                f"{quantity}=UNIT, or save the file as UTF-8"
            )
        stated = "" if stated == UNREADABLE else stated
        if stated and stated not in UNITS[quantity]:
            raise FileFormatError(
                f"{where}: found the unit {shown(stated)}, expected one of {', '.join(UNITS[quantity])}: convert the "
                f"column to one of these, or rename it if {shown(stated)} is no unit"
            )
        if stated and by_option is not None and by_option != stated:
            raise FileFormatError(
                f"{where}: found {stated} in its name and --units {quantity}={symbol(by_option)}, expected one of "
                "them: leave the option out or correct it"
            )
        unit = stated or by_option or ""
        return Column(candidate.place, candidate.name, per_si(quantity, unit or default), role, unit)

    def require_units(self, columns: Sequence[Column], quantity: str) -> None:
        """Raise `FileFormatError` where some columns of a quantity state an unusual unit, and others none."""
        silent = next((c for c in columns if not c.unit), None)
        other = next((c for c in columns if c.unit and silent is not None and c.per_si != silent.per_si), None)
        if other is not None and silent is not None:
            raise self.silence(other, silent, quantity)

    def silence(self, other: Column, silent: Column, quantity: str) -> FileFormatError:
        """A column of a quantity that says no unit beside an `other` that says an unusual one."""
        return FileFormatError(
            f"{self.source}: column {shown(other.name)} is in {other.unit} and {shown(silent.name)} says no unit, "
            f"expected one for each: state it with --units {quantity}=UNIT"
        )

    def require_one_set(
        self, columns: list[Candidate], option: str, words: Callable[[Meaning], str] = attrgetter("of")
    ) -> None:
        """Raise `FileFormatError` where columns are not named alike, in some of their `words`: they may be two sets."""
        other = next((each for each in columns if words(each.said) != words(columns[0].said)), None)
        if other is not None:
            raise FileFormatError(
                f"{self.source}: found {quoted([columns[0], other])}, not named alike, expected the columns of one "
                f"set: if they are, say {option}"
            )

    def lacking(self, part: str, expected: str, mend: str) -> FileFormatError:
        """A part that no column holds."""
        return FileFormatError(
            f"{self.source}: found no column {shown(part)}, expected {expected}: {mend} (found {listed(self.places)})"
        )

    def undecided(self, several: list[Candidate], part: str, option: str) -> FileFormatError:
        """Two columns or more that could be one part."""
        return FileFormatError(f"{self.source}: found {quoted(several)} for {part}, expected one: choose with {option}")


def _could_be(said: Meaning) -> bool:
    """Whether a column is what its header says, by its unit: one of the quantity, or none. One that nobody knows is to
    be stated, of a reading and of a time; `Tx (mm)` is no reading.
    """
    quantity = quantity_of(said)
    if not said.unit or said.unit in UNITS[quantity] or quantity == "time":
        return True
    return quantity in ("force", "torque") and not any(unit_of(other, said.unit) for other in ("length", "angle"))


def _without_unit(name: str) -> str:
    return re.sub(r" \[[^\[\]]*\]$", "", name)


def quoted(columns: Iterable[Candidate]) -> str:
    """The columns' names as a message sets them beside each other."""
    return " and ".join(f'"{shown(column.name)}"' for column in columns)


def as_listed(columns: Iterable[Candidate]) -> str:
    """The columns' names as an option takes them, in quotes where a shell needs them."""
    each = [column.name for column in columns]
    stem, n = "".join(each[:1]).removesuffix("_0"), len(each)
    names = f"{stem}[0:{n}]" if n > 1 and each == [f"{stem}_{k}" for k in range(n)] else ",".join(each)
    return names if re.fullmatch(r"[\w.,/%-]*", names) else f"'{names}'"
