"""Which columns of a table are the orientation, and how it is written."""

from __future__ import annotations

from dataclasses import replace

from ...errors import FileFormatError, InputError, with_room_for
from ...geometry.orientation import CONVENTIONS, RECOGNISED_BY_NAME, USUAL_NAMES, Convention, convention
from .columns import AS_NAMED, WRENCH_COLUMNS, Column, Naming, OpenTable, listed, shown
from .header import Candidate, Header, as_listed, quoted

PERHAPS = (
    ("abb_quat", ("q1", "q2", "q3", "q4")),
    ("quat_wxyz", ("q0", "q1", "q2", "q3")),
    ("quat_xyzw", ("q0", "q1", "q2", "q3")),
    ("quat_wxyz", ("w", "x", "y", "z")),
    ("rpy", ("r", "p", "y")),
    ("nachi", ("r", "p", "y")),
    ("kawasaki_oat", ("o", "a", "t")),
    ("quat_xyzw", ("quat_1", "quat_2", "quat_3", "quat_4")),
    ("quat_wxyz", ("quat_1", "quat_2", "quat_3", "quat_4")),
    ("matrix", tuple(f"r{row}{column}" for row in range(3) for column in range(3))),
)
"""Names that an orientation may have, and how it is written then: asked for, not guessed."""
LISTS = {4: ("quat_xyzw", "quat_wxyz"), 9: ("matrix",), 16: ("franka_matrix",)}
"""What a list of so many numbers may be."""


def orientation_columns(table: OpenTable, naming: Naming) -> tuple[Convention, list[Column]]:
    """The columns of the orientation, and what they are. Raises as `wrench_columns`."""
    header = _beside_the_wrench(table, naming)
    if (stated := naming.orientation or "auto") != "auto":
        return _stated_orientation(header, stated)
    found = {name: _usual_angles(header, CONVENTIONS[name]) for name in USUAL_NAMES}
    whole = _whole(found)
    if not whole:
        found = {name: [header.first(part) for part in CONVENTIONS[name].columns] for name in RECOGNISED_BY_NAME}
        whole = _whole(found)
    if len(whole) > 1:
        raise FileFormatError(
            f"{table.source}: found the columns of {' and of '.join(whole)}, expected one orientation: choose with "
            f"--orientation {next(iter(whole))}"
        )
    if whole:
        name, columns = next(iter(whole.items()))
        return CONVENTIONS[name], _angles(header, CONVENTIONS[name], columns)
    perhaps = _perhaps(header)
    for name, parts in found.items():
        if sum(part is not None for part in parts) > len(parts) / 2 and not perhaps:
            missing = [want for want, part in zip(CONVENTIONS[name].columns, parts, strict=True) if part is None]
            raise FileFormatError(f"{table.source}: found no column {missing[0]}, expected all of {name}: add it")
    alone = header.candidates.keys() >= set(WRENCH_COLUMNS)
    two = ", or --wrench W.csv --pose P.csv" if alone else ""
    known = "qx qy qz qw, r11..r33, a b c (KUKA), w p r (FANUC), rx ry rz (UR) or roll pitch yaw"
    mend = f"{known}: rename them, or --orientation NAME:COLUMNS"
    if perhaps:
        mend = f"usual names, as qx qy qz qw: rename them, or --orientation {perhaps}"
    found_none = f"{table.source}: found no orientation columns, expected {mend}"
    raise FileFormatError(with_room_for(found_none, two, end=f" (found {listed(header.places)})"))


def _perhaps(header: Header) -> str:
    """What --orientation may be for names that an orientation may bear, and for lists as long as one."""
    there = {name.lower(): name for name in header.places}
    perhaps = [
        f"{how}:{','.join(there[name] for name in names)}" for how, names in PERHAPS if there.keys() >= set(names)
    ]
    lists = [name.removesuffix("[0]") for name in header.places if name.endswith("[0]")]
    lists.sort(key=lambda name: name.startswith("next_"))  # robomimic's observation after the action
    perhaps += [
        f"{how}:{name}[0:{n}]"
        for n, conventions in LISTS.items()
        for name in lists
        if f"{name}[{n - 1}]" in header.places and f"{name}[{n}]" not in header.places
        for how in conventions
    ]
    return " or ".join(perhaps[:2])


def _whole(found: dict[str, list[Candidate | None]]) -> dict[str, list[Candidate]]:
    """The conventions of which every column is there."""
    return {name: [c for c in columns if c is not None] for name, columns in found.items() if None not in columns}


def _angles(header: Header, chosen: Convention, columns: list[Candidate]) -> list[Column]:
    """The columns of a convention that the names tell, in their units."""
    made = _in_their_units(header, chosen, columns)
    usual = all(each.is_usual for each in made)
    if chosen.name in USUAL_NAMES and usual:
        return made
    for part in chosen.columns:
        if len(several := header.candidates[part]) > 1:
            raise header.undecided(several, part, _by_names(header, chosen))
    if not usual:
        header.require_one_set(columns, _by_names(header, chosen))
    header.require_units(made, "angle")
    if chosen.name == "ur_rotvec" and any(each.unit == "deg" for each in made):
        raise FileFormatError(
            f"{header.source}: found {quoted(columns)} in degrees, expected a rotation vector (UR) in rad: if these "
            "are angles, say whose (--orientation yaskawa or staubli), else --orientation ur_rotvec"
        )
    return made


def _stated_orientation(header: Header, text: str) -> tuple[Convention, list[Column]]:
    name, _, of_list = text.rpartition(":")
    if name and f"{of_list}[0]".lower() in map(str.lower, header.places):
        count = len(convention(name).columns)
        raise InputError(
            f"{header.source}: found the list {shown(of_list)}, expected {count} columns: say --orientation "
            f"{name}:{of_list}[0:{count}]"
        )
    chosen = convention(header.expanded(text))
    roles = CONVENTIONS[chosen.name].columns if chosen.name in CONVENTIONS else ("e1", "e2", "e3")
    by_name, quantity = chosen.columns == roles, _quantity(chosen)
    columns = []
    for name, role in zip(chosen.columns, roles, strict=True):
        found = (None if by_name else header.named(name, role, quantity)) or header.usual(name, quantity)
        several = header.candidates.get(role, []) if by_name and found is None else []
        if len(several) > 1:
            raise header.undecided(several, role, _by_names(header, chosen))
        found = found or next(iter(several), None)
        if found is None:
            wanted = ",".join(shown(each) for each in chosen.columns)
            mend = "name the columns, as in --orientation NAME:COLUMNS"
            raise header.lacking(name, f"{wanted} for {chosen.name}", mend)
        columns.append(found)
    made = _in_their_units(header, replace(chosen, columns=roles), columns)
    header.require_units(made, "angle")
    return chosen, made


def _beside_the_wrench(table: OpenTable, naming: Naming) -> Header:
    """The header without the columns that were stated to be the wrench's, whatever they are named."""
    header = Header.of(table, naming)
    if naming.wrench_columns is None:
        return header
    of_wrench = {name.strip().lower() for name in header.expanded(naming.wrench_columns).split(",")}
    return replace(header, places={n: place for n, place in table.places.items() if n.lower() not in of_wrench})


def _by_names(header: Header, chosen: Convention) -> str:
    """The option that chooses of several columns the first in the unit of all parts, so far as they state one."""
    several = [header.candidates[each] for each in chosen.columns if each in header.candidates]
    common = set.intersection(*({each.said.unit for each in columns} for columns in several))
    in_common = [[each for each in columns if each.said.unit in common] or columns for columns in several]
    return f"--orientation {chosen.name}:{as_listed(columns[0] for columns in in_common)}"


def _quantity(of: Convention) -> str:
    return "" if of.angle_unit is None else "angle"


def _in_their_units(header: Header, chosen: Convention, columns: list[Candidate]) -> list[Column]:
    quantity, unit, pairs = _quantity(chosen), chosen.angle_unit or "", zip(columns, chosen.columns, strict=True)
    return [header.column(each, part, quantity, unit) for each, part in pairs]


def _usual_angles(header: Header, wanted: Convention) -> list[Candidate | None]:
    return [header.usual(part, _quantity(wanted)) for part in wanted.columns]


def whole_sets(table: OpenTable, naming: Naming) -> list[list[Column]]:
    """Every set of columns that bears the names of a convention, or says the like, each once."""
    header = _beside_the_wrench(table, naming)
    sets: dict[tuple[str, ...], list[Column]] = {}
    for wanted in CONVENTIONS.values():
        pairs = zip(_usual_angles(header, wanted), wanted.columns, strict=True)
        columns = [each for usual, part in pairs if (each := usual or header.first(part)) is not None]
        if len(columns) == len(wanted.columns):
            sets.setdefault(tuple(sorted(each.name for each in columns)), _in_their_units(header, wanted, columns))
    return list(sets.values())


def numbered_angles(table: OpenTable, names: list[str]) -> tuple[Column, ...]:
    """The columns `names` of angles in rad, or in the unit of a suffix, if all are there; else none."""
    header = Header.of(table, AS_NAMED)
    found = [(header.usual(name, "angle"), name) for name in names]
    made = tuple(header.column(each, name, "angle", "rad") for each, name in found if each is not None)
    return made if len(made) == len(names) else ()
