"""Which columns of a recording's table are what: found by name, units by suffix (design: section 6)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...errors import FileFormatError
from ...geometry.orientation import CONVENTIONS, RECOGNISED_BY_NAME, Convention, convention
from .columns import SATURATED, Column, find, listed, optional, required, shown

FORCE = {"": 1.0, "n": 1.0}
TORQUE = {"": 1.0, "nm": 1.0, "nmm": 1e3}
TIME = {"": 1.0, "s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}
LENGTH = {"": 1.0, "m": 1.0, "mm": 1e3}
LOAD = {"g": 1e3, "kg": 1.0}
NO_UNIT = {"": 1.0}
ANGLE = {"deg": 180.0 / np.pi, "rad": 1.0}
"""These say how many of a unit make one of SI: a division rounds once, so that 300 ms are 0.3 s to the last digit."""

WRENCH_COLUMNS = ("fx", "fy", "fz", "tx", "ty", "tz")


@dataclass(frozen=True)
class Meaning:
    """Which columns of a table are what; empty where it has none. `convention`: None where `orientation` is empty."""

    wrench: tuple[Column, ...]
    convention: Convention | None
    orientation: tuple[Column, ...]
    t: tuple[Column, ...]
    position: tuple[Column, ...]
    load: tuple[Column, ...]
    saturated: tuple[Column, ...]

    @property
    def of_wrench(self) -> list[Column]:
        """What a row has with its wrench or not at all."""
        return [*self.wrench, *self.load, *self.saturated]

    @property
    def of_pose(self) -> list[Column]:
        """What a row has with its orientation or not at all."""
        return [*self.orientation, *self.position]


def meaning_of(
    places: dict[str, int],
    source: str,
    wrench: list[Column],
    chosen: Convention | None,
    of_orientation: list[Column],
) -> Meaning:
    """What the columns are beside those of the wrench and the orientation, which are `chosen` already, if any."""
    taken = {column.place for column in of_orientation}
    return Meaning(
        wrench=tuple(wrench),
        convention=chosen,
        orientation=tuple(of_orientation),
        t=tuple(optional(places, ["t"], TIME, taken, source)),
        position=tuple(optional(places, ["x", "y", "z"], LENGTH, taken, source)) if chosen else (),
        load=tuple(_load_column(places, taken, source)) if wrench else (),
        saturated=tuple(optional(places, [SATURATED], NO_UNIT, taken, source)) if wrench else (),
    )


def require_times(meaning: Meaning, places: dict[str, int], source: str) -> Meaning:
    """The same. Raises `FileFormatError` unless it has times."""
    if not meaning.t:
        raise FileFormatError(
            f"{source}: found no column t, expected one in each of two files, on one clock: add the times (found "
            f"{listed(places)})"
        )
    return meaning


def wrench_columns(places: dict[str, int], source: str) -> list[Column]:
    """The columns fx..tz. Raises `FileFormatError` where one is not there."""
    return [required(places, name, TORQUE if name[0] == "t" else FORCE, source) for name in WRENCH_COLUMNS]


def _load_column(places: dict[str, int], taken: set[int], source: str) -> list[Column]:
    if "load" in places:
        raise FileFormatError(f"{source}: column load has no unit, expected load_g or load_kg: rename it")
    return optional(places, ["load"], LOAD, taken, source)


def orientation_columns(places: dict[str, int], orientation: str, source: str) -> tuple[Convention, list[Column]]:
    """The columns of the orientation, and what they are; `orientation` as in `Layout`. Raises `FileFormatError`."""
    if orientation != "auto":
        chosen = convention(orientation)
        columns = _columns_of(places, chosen, source)
        missing = [name for name, column in zip(chosen.columns, columns, strict=True) if column is None]
        if missing:
            wanted = ",".join(shown(name) for name in chosen.columns)
            raise FileFormatError(
                f"{source}: found no column {shown(missing[0])}, expected {wanted} for {chosen.name}: name "
                f"the columns, as in --orientation NAME:COLUMNS (found {listed(places)})"
            )
        return chosen, [column for column in columns if column is not None]
    candidates = {name: _columns_of(places, CONVENTIONS[name], source) for name in RECOGNISED_BY_NAME}
    whole = {name: [c for c in columns if c is not None] for name, columns in candidates.items() if None not in columns}
    if len(whole) == 1:
        name, complete = next(iter(whole.items()))
        return CONVENTIONS[name], complete
    if whole:
        raise FileFormatError(
            f"{source}: found the columns of {' and of '.join(whole)}, expected one orientation: choose with "
            f"--orientation {next(iter(whole))}"
        )
    for name, columns in candidates.items():
        if sum(column is not None for column in columns) > len(columns) / 2:
            missing = [want for want, c in zip(CONVENTIONS[name].columns, columns, strict=True) if c is None]
            raise FileFormatError(f"{source}: found no column {missing[0]}, expected all of {name}: add it")
    raise FileFormatError(
        f"{source}: found no orientation columns, expected qx qy qz qw, r11..r33, a b c (KUKA), w p r (FANUC) or rx ry "
        f"rz (UR): rename them, or say --orientation NAME:COLUMNS (found {listed(places)})"
    )


def whole_sets(places: dict[str, int], source: str) -> list[list[Column]]:
    """Every set of columns that bears the names of a convention, each once."""
    sets: dict[tuple[str, ...], list[Column]] = {}
    for wanted in CONVENTIONS.values():
        columns = [column for column in _columns_of(places, wanted, source) if column is not None]
        if len(columns) == len(wanted.columns):
            sets.setdefault(tuple(sorted(column.name for column in columns)), columns)
    return list(sets.values())


def _columns_of(places: dict[str, int], wanted: Convention, source: str) -> list[Column | None]:
    if wanted.angle_unit is None:
        return [find(places, name, NO_UNIT, source) for name in wanted.columns]
    stated = {"": ANGLE[wanted.angle_unit], **ANGLE}
    columns = []
    for name in wanted.columns:
        unit = name.rpartition("_")[2]
        columns.append(find(places, name, {"": ANGLE[unit]} if unit in ANGLE else stated, source))
    return columns
