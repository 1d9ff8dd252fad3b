"""Which columns of a table are the orientation, and how it is written."""

from __future__ import annotations

from dataclasses import replace

from ...errors import FileFormatError, InputError, with_room_for
from ...geometry.orientation import CONVENTIONS, RECOGNISED_BY_NAME, USUAL_NAMES, Convention, convention
from .candidates import (
    Candidate,
    as_listed,
    candidates,
    column,
    expanded,
    lacking,
    named,
    quoted,
    require_one_set,
    require_units,
    undecided,
    usual,
)
from .columns import WRENCH_COLUMNS, Column, Naming, OpenTable, listed, shown
from .units import stated_units

PERHAPS = (
    ("abb_quat", ("q1", "q2", "q3", "q4")),
    ("quat_wxyz", ("q0", "q1", "q2", "q3")),
    ("quat_xyzw", ("q0", "q1", "q2", "q3")),
    ("quat_wxyz", ("w", "x", "y", "z")),
    ("rpy", ("r", "p", "y")),
    ("nachi", ("r", "p", "y")),
)
"""Names that an orientation may have, and how it is written then: asked for, not guessed."""
LISTS = {4: ("quat_xyzw", "quat_wxyz"), 9: ("matrix",), 16: ("franka_matrix",)}
"""What a list of so many numbers may be."""


def orientation_columns(table: OpenTable, naming: Naming) -> tuple[Convention, list[Column]]:
    """The columns of the orientation, and what they are. Raises as `wrench_columns`."""
    table = _beside_the_wrench(table, naming)
    if (stated := naming.orientation or "auto") != "auto":
        return _stated_orientation(table, naming, stated)
    found = {name: _usual_angles(table, CONVENTIONS[name]) for name in USUAL_NAMES}
    whole = _whole(found)
    by_part = candidates(table)
    if not whole:
        found = {
            name: [by_part[part][0] if part in by_part else None for part in CONVENTIONS[name].columns]
            for name in RECOGNISED_BY_NAME
        }
        whole = _whole(found)
    if len(whole) > 1:
        raise FileFormatError(
            f"{table.source}: found the columns of {' and of '.join(whole)}, expected one orientation: choose with "
            f"--orientation {next(iter(whole))}"
        )
    if whole:
        name, columns = next(iter(whole.items()))
        return CONVENTIONS[name], _angles(table, naming, CONVENTIONS[name], columns, by_part)
    perhaps = _perhaps(table)
    for name, parts in found.items():
        if sum(part is not None for part in parts) > len(parts) / 2 and not perhaps:
            missing = [want for want, part in zip(CONVENTIONS[name].columns, parts, strict=True) if part is None]
            raise FileFormatError(f"{table.source}: found no column {missing[0]}, expected all of {name}: add it")
    alone = by_part.keys() >= set(WRENCH_COLUMNS)
    two = ", or --wrench W.csv --pose P.csv" if alone else ""
    known = "qx qy qz qw, r11..r33, a b c (KUKA), w p r (FANUC), rx ry rz (UR) or roll pitch yaw"
    mend = f"{known}: rename them, or --orientation NAME:COLUMNS"
    if perhaps:
        mend = f"usual names, as qx qy qz qw: rename them, or --orientation {perhaps}"
    found_none = f"{table.source}: found no orientation columns, expected {mend}"
    raise FileFormatError(with_room_for(found_none, two, end=f" (found {listed(table.places)})"))


def _perhaps(table: OpenTable) -> str:
    """What --orientation may be for columns whose names an orientation may bear, and for lists of as many numbers as a
    quaternion, a matrix and a pose have.
    """
    there = {name.lower(): name for name in table.places}
    perhaps = [
        f"{how}:{','.join(there[name] for name in names)}" for how, names in PERHAPS if there.keys() >= set(names)
    ]
    lists = [name.removesuffix("[0]") for name in table.places if name.endswith("[0]")]
    lists.sort(key=lambda name: name.startswith("next_"))  # robomimic's observation after the action
    perhaps += [
        f"{how}:{name}[0:{n}]"
        for n, conventions in LISTS.items()
        for name in lists
        if f"{name}[{n - 1}]" in table.places and f"{name}[{n}]" not in table.places
        for how in conventions
    ]
    return " or ".join(perhaps[:2])


def _whole(found: dict[str, list[Candidate | None]]) -> dict[str, list[Candidate]]:
    """The conventions of which every column is there."""
    return {name: [c for c in columns if c is not None] for name, columns in found.items() if None not in columns}


def _angles(
    table: OpenTable, naming: Naming, chosen: Convention, columns: list[Candidate], by_part: dict[str, list[Candidate]]
) -> list[Column]:
    """The columns of a convention that the names tell, in their units."""
    made = _in_their_units(table, naming, chosen, columns)
    if chosen.name in USUAL_NAMES and all(each.is_usual for each in made):
        return made
    for part in chosen.columns:
        if len(several := by_part[part]) > 1:
            raise undecided(table, several, part, _by_names(chosen, by_part))
    if not all(each.is_usual for each in made):
        require_one_set(table, columns, _by_names(chosen, by_part))
    require_units(table, made, "angle")
    if chosen.name == "ur_rotvec" and any(each.unit == "deg" for each in made):
        raise FileFormatError(
            f"{table.source}: found {quoted(columns)} in degrees, expected a rotation vector (UR) in rad: if these are "
            "angles, say whose (--orientation yaskawa or staubli), else --orientation ur_rotvec"
        )
    return made


def _stated_orientation(table: OpenTable, naming: Naming, text: str) -> tuple[Convention, list[Column]]:
    name, _, of_list = text.rpartition(":")
    if name and f"{of_list}[0]".lower() in map(str.lower, table.places):
        count = len(convention(name).columns)
        raise InputError(
            f"{table.source}: found the list {shown(of_list)}, expected {count} columns: say --orientation "
            f"{name}:{of_list}[0:{count}]"
        )
    chosen = convention(expanded(table, text))
    roles = CONVENTIONS[chosen.name].columns if chosen.name in CONVENTIONS else ("e1", "e2", "e3")
    by_name = chosen.columns == roles
    quantity = "" if chosen.angle_unit is None else "angle"
    by_part = candidates(table) if by_name else {}
    columns = []
    for name, role in zip(chosen.columns, roles, strict=True):
        found = (None if by_name else named(table, name, role, quantity)) or usual(table, name, quantity)
        if found is None and len(several := by_part.get(role, [])) > 1:
            raise undecided(table, several, role, _by_names(chosen, by_part))
        found = found or next(iter(by_part.get(role, ())), None)
        if found is None:
            wanted = ",".join(shown(each) for each in chosen.columns)
            mend = "name the columns, as in --orientation NAME:COLUMNS"
            raise lacking(table, name, f"{wanted} for {chosen.name}", mend)
        columns.append(found)
    made = _in_their_units(table, naming, replace(chosen, columns=roles), columns)
    require_units(table, made, "angle")
    return chosen, made


def _beside_the_wrench(table: OpenTable, naming: Naming) -> OpenTable:
    """The table without the columns that were stated to be the wrench's, whatever they are named."""
    if naming.wrench_columns is None:
        return table
    of_wrench = {name.strip().lower() for name in expanded(table, naming.wrench_columns).split(",")}
    return replace(table, places={n: place for n, place in table.places.items() if n.lower() not in of_wrench})


def _by_names(chosen: Convention, by_part: dict[str, list[Candidate]]) -> str:
    """The option that chooses of several columns the first in the unit of all parts, so far as they state one."""
    several = [by_part[each] for each in chosen.columns if each in by_part]
    common = set.intersection(*({each.said.unit for each in columns} for columns in several))
    in_common = [[each for each in columns if each.said.unit in common] or columns for columns in several]
    return f"--orientation {chosen.name}:{as_listed(columns[0] for columns in in_common)}"


def _in_their_units(table: OpenTable, naming: Naming, chosen: Convention, columns: list[Candidate]) -> list[Column]:
    units, pairs = stated_units(naming.units), list(zip(columns, chosen.columns, strict=True))
    if chosen.angle_unit is None:
        return [column(table, each, part, "", {}) for each, part in pairs]
    return [column(table, each, part, "angle", units, chosen.angle_unit) for each, part in pairs]


def _usual_angles(table: OpenTable, wanted: Convention) -> list[Candidate | None]:
    return [usual(table, part, "" if wanted.angle_unit is None else "angle") for part in wanted.columns]


def whole_sets(table: OpenTable, naming: Naming) -> list[list[Column]]:
    """Every set of columns that bears the names of a convention, or says the like, each once."""
    table = _beside_the_wrench(table, naming)
    by_part = candidates(table)
    sets: dict[tuple[str, ...], list[Column]] = {}
    for wanted in CONVENTIONS.values():
        of_names = _usual_angles(table, wanted)
        told = [next(iter(by_part.get(part, ())), None) for part in wanted.columns]
        found = [usual_one or said for usual_one, said in zip(of_names, told, strict=True)]
        columns = [each for each in found if each is not None]
        if len(columns) == len(wanted.columns):
            sets.setdefault(
                tuple(sorted(each.name for each in columns)), _in_their_units(table, naming, wanted, columns)
            )
    return list(sets.values())


def numbered_angles(table: OpenTable, names: list[str]) -> tuple[Column, ...]:
    """The columns `names` of angles in rad, or in the unit of a suffix, if all are there; else none."""
    found = [usual(table, name, "angle") for name in names]
    whole = [each for each in found if each is not None]
    if len(whole) < len(names):
        return ()
    return tuple(column(table, each, name, "angle", {}, "rad") for each, name in zip(whole, names, strict=True))
