"""Which columns of a table are the wrench, the orientation, the times and the position.

What an option states comes first, then the usual names (docs: conventions), then what the headers say (see `names`).
Where two columns could be one thing, neither is taken: the message says which option chooses.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from operator import attrgetter

from ...errors import FileFormatError, InputError
from ...geometry.orientation import Convention
from .columns import (
    NANOSECONDS,
    POSITION,
    SATURATED,
    WRENCH_COLUMNS,
    Column,
    ColumnRoles,
    Naming,
    OpenTable,
    counted_times,
    listed,
    shown,
)
from .header import Candidate, Header, as_listed, quoted
from .names import ESTIMATES, OTHER_CLOCKS, meaning
from .orientations import orientation_columns
from .units import UNREADABLE, unit_of

WITHOUT_TIMES = "none"
"""What --time-column takes where a column that looks like times is to be left alone."""
BESIDE_SI = ("", "N", "N m", "N mm", "N cm", "mN m")
"""Units of force and torque beside which the other, without a unit, is taken to be in SI."""
BEGIN_ORIENTATIONS = ("qx", "qw", "rx", "roll", "yaw", "r11", "a", "w")
END_ORIENTATIONS = ("qw", "qz", "rz", "yaw", "roll", "r33", "c", "r")
"""What stands behind or before a translation, as in `timestamp tx ty tz qx qy qz qw` of a trajectory."""


def roles_of(table: OpenTable, naming: Naming, *, wrench: bool = True) -> ColumnRoles:
    """Which columns of a recording are what, or of one of two files: in the one with the orientations no `wrench` is
    looked for. Raises `FileFormatError` for a column that is missing, times of two files among them, or could be two
    things, and `InputError` for options that are none.
    """
    if not wrench:
        naming = replace(naming, wrench_columns=None)
    of_wrench = wrench_columns(table, naming) if wrench else []
    chosen, angles = (None, []) if naming.orientation is None else orientation_columns(table, naming)
    roles = roles_beside(table, naming, of_wrench, chosen, angles)
    if not roles.t and not (of_wrench and angles):
        raise FileFormatError(
            f"{table.source}: found no column t, expected one in each of two files, on one clock: add the times, or "
            f"name them with --time-column (found {listed(table.places)})"
        )
    return roles


def roles_beside(
    table: OpenTable, naming: Naming, wrench: list[Column], chosen: Convention | None, angles: list[Column]
) -> ColumnRoles:
    """What the other columns are where those of the wrench and of the orientation are chosen already."""
    header, taken = Header.of(table, naming), {column.place for column in (*angles, *wrench)}
    t = time_columns(table, naming, taken)
    load = _load_column(header) if wrench else None
    saturated = header.usual(SATURATED) if wrench else None
    position = position_columns(table, naming, taken) if chosen else ()
    of_pose = tuple(angles[12:15]) if chosen and chosen.name == "franka_matrix" else ()  # 4 x 4, column by column
    roles = ColumnRoles(
        wrench=tuple(wrench),
        convention=chosen,
        orientation=tuple(angles),
        t=t,
        position=position or of_pose,
        load=() if load is None or load.place in taken else (load,),
        saturated=() if saturated is None else (header.column(saturated, SATURATED),),
    )
    if not any(each.is_numbered for each in roles.columns):
        return roles
    numbered = [place for name, place in table.places.items() if Column(place, name, 1.0).is_numbered]
    return replace(roles, numbered=(len(numbered),))


def wrench_columns(table: OpenTable, naming: Naming) -> list[Column]:
    """The columns fx..tz. Raises `FileFormatError` where one is not there or could be two, `InputError` for options."""
    header = Header.of(table, naming)
    found = _wrench_by_names(header) if naming.wrench_columns is None else _stated_wrench(header, naming.wrench_columns)
    chosen = [header.column(candidate, part) for candidate, part in zip(found, WRENCH_COLUMNS, strict=True)]
    if all(each.is_usual for each in chosen):
        return chosen
    force, torque = chosen[:3], chosen[3:]
    header.require_units(force, "force")
    header.require_units(torque, "torque")
    for stating, others, quantity in ((force[0], torque, "torque"), (torque[0], force, "force")):
        silent = next((each for each in others if not each.unit), None)
        if stating.unit not in BESIDE_SI and silent is not None:
            raise header.silence(stating, silent, quantity)
    return chosen


def _wrench_by_names(header: Header) -> list[Candidate]:
    """The columns fx..tz by their usual names, else by what their headers say."""
    whole = [candidate for part in WRENCH_COLUMNS if (candidate := header.usual(part)) is not None]
    by_part = header.candidates
    if len(whole) == len(WRENCH_COLUMNS):
        by_axis = {part: [each for each in by_part[part] if each.said.index is None] for part in WRENCH_COLUMNS}
        if [part for part, several in by_axis.items() if len(several) > 1] == list(WRENCH_COLUMNS[3:]):
            # one fx, with tx, which may be a translation, and with mx
            behind = [min(by_axis[part], key=lambda each: each.place < whole[2].place) for part in WRENCH_COLUMNS[3:]]
            raise header.undecided(by_axis["tx"], "tx", f"--wrench-columns {as_listed([*whole[:3], *behind])}")
        if _is_of_a_pose(header, whole):
            raise _perhaps_a_torque(header, whole[:3], whole[3:])
        return whole
    controllers = header.estimates()
    missing = [part for part in WRENCH_COLUMNS if part not in by_part]
    if controllers and len(missing) == len(WRENCH_COLUMNS):
        vector, columns = next(iter(controllers.items()))
        whose, instead, axes = ESTIMATES[vector]
        raise FileFormatError(
            f"{header.source}: found no wrench but {quoted(columns[:1])} and so on, what {whose} makes of it, its "
            f"payload subtracted already, expected the sensor's own reading: {instead}, or, recorded with a payload "
            f"of 0 kg, take these with --wrench-columns {as_listed(columns)}{axes}"
        )
    if set(missing) == set(WRENCH_COLUMNS[3:]) and len(letters := header.perhaps_torque(missing)) == len(missing):
        raise _perhaps_a_torque(header, [by_part[part][0] for part in WRENCH_COLUMNS[:3]], letters)
    if missing:
        two = ", or --wrench W.csv --pose P.csv" if len(missing) == len(WRENCH_COLUMNS) else ""
        mend = f"add it, or name the six with --wrench-columns A,B,C,D,E,F{two}"
        raise header.lacking(missing[0], "fx fy fz tx ty tz and an orientation", mend)
    firsts = [by_part[part][0] for part in WRENCH_COLUMNS]
    option = f"--wrench-columns {as_listed(firsts)}"
    for part in WRENCH_COLUMNS:
        if len(by_part[part]) > 1:
            raise header.undecided(by_part[part], part, option)
    for one_vector in (firsts[:3], firsts[3:]):
        header.require_one_set(one_vector, option)
    header.require_one_set(firsts, option, attrgetter("sensor"))
    return firsts


def _is_of_a_pose(header: Header, whole: list[Candidate]) -> bool:
    """Whether tx ty tz, of no unit, stand beside an orientation and not beside forces, as a translation does; names in
    the alphabet's order, as HDF5 lists them, do not tell.
    """
    places, names = [each.place for each in whole], {place: name for name, place in header.places.items()}
    before, behind = places[3] - 1, places[3] + 3
    apart = places[3:] == [*range(places[3], behind)] and before != places[2] and behind != places[0]
    last, first = (said.part if (said := meaning(names.get(place, ""))) else "" for place in (before, behind))
    of_a_pose = first in BEGIN_ORIENTATIONS or last in END_ORIENTATIONS
    in_order = [names[place] for place in sorted(names)]
    tells = in_order != sorted(in_order) and not any(each.said.unit for each in whole[3:])
    return apart and of_a_pose and tells


def _perhaps_a_torque(header: Header, force: list[Candidate], letters: list[Candidate]) -> FileFormatError:
    return FileFormatError(
        f"{header.source}: found {quoted(letters)}, a torque or something else by their names, expected one that "
        "their unit tells, or fx fy fz beside them: if they are the torque say --wrench-columns "
        f"{as_listed([*force, *letters])}"
    )


def _stated_wrench(header: Header, text: str) -> list[Candidate]:
    names = header.expanded(text).split(",")
    if len(names) != len(WRENCH_COLUMNS) or len({name.strip().lower() for name in names}) != len(names):
        raise InputError(
            f"--wrench-columns is {shown(text, 200)!r}, expected six different names A,B,C,D,E,F, or a slice of six "
            "such as observation.wrench[0:6]"
        )
    found = []
    for name, part in zip(names, WRENCH_COLUMNS, strict=True):
        candidate = header.named(name, part)
        if candidate is None:
            raise header.lacking(name.strip(), "what --wrench-columns names", "name columns of the file")
        found.append(candidate)
    return found


def time_columns(table: OpenTable, naming: Naming, taken: Collection[int] = ()) -> tuple[Column, ...]:
    """The column of the times, those of seconds and nanoseconds of one stamp, or none; none at the places `taken`. Of
    several the row's own (PlotJuggler) comes before a message's stamp, and that before the recorder's clock. Raises
    `FileFormatError` for a column that is stated and not there, and two that could be the times, and `InputError`.
    """
    header = Header.of(table, naming)
    if naming.rate is not None and (name := counted_times(naming.rate)) in table.places:
        return (Column(table.places[name], name, 1.0, "t", "s"),)
    if naming.time_column is not None:
        return _stated_times(header, naming.time_column, taken)
    found = [times for times in header.stamps() if all(each.place not in taken for each in times)]
    usual = header.usual("t")
    if usual is not None and usual.place not in taken and (usual.name != "T" or len(found) == 1):  # T: temperature
        return (header.column(usual, "t"),)
    first = min(map(_preference, found), default=0)
    found = [times for times in found if _preference(times) == first]
    if len(found) > 1:
        raise header.undecided([times[0] for times in found], "t", f"--time-column {as_listed(found[0][:1])}")
    return _as_times(header, found[0]) if found else ()


def _preference(times: tuple[Candidate, ...]) -> int:
    of = times[0].said.of.split()
    if of == ["__time"]:
        return 0
    if "header" in of or (len(times) > 1 and (not of or "stamp" in of)):
        return 1
    return 4 if OTHER_CLOCKS & set(of) else 3 if of in (["%time"], ["rosbagtimestamp"]) else 2


def _as_times(header: Header, times: tuple[Candidate, ...]) -> tuple[Column, ...]:
    """Columns of times; ms where libfranka wrote them (its src/logging/robot_state_log.cpp) and nobody says another."""
    if "success_rate" in header.places and "time" in header.places:
        header = replace(header, units={"time": "ms", **header.units})
    return tuple(header.column(each, role) for each, role in zip(times, ("t", NANOSECONDS), strict=False))


def _stated_times(header: Header, text: str, taken: Collection[int]) -> tuple[Column, ...]:
    if text == WITHOUT_TIMES:
        return ()
    found = header.named(text, "t")
    if found is None and unit_of("time", text.rpartition(":")[2]) is not None:
        name, _, spelled = text.rpartition(":")
        found, unit = header.named(name, "t"), unit_of("time", spelled) or ""
        others = {header.units.get("time"), found.said.unit if found is not None else None}
        if others := others - {None, "", unit, UNREADABLE}:
            raise InputError(
                f"{header.source}: found --time-column in {unit}, and {others.pop()} in the column's name or --units, "
                "expected one of them: leave one out"
            )
        header = replace(header, units={**header.units, "time": unit})
    if found is None:
        raise header.lacking(text, "what --time-column names", "name a column of the file, or none")
    if found.place in taken:
        raise FileFormatError(
            f"{header.source}: found column {shown(found.name)} as times and as wrench or orientation, expected one of "
            "them: correct --time-column or the others"
        )
    pairs = (times for times in header.stamps() if len(times) > 1 and times[0].place == found.place)
    return _as_times(header, next(pairs, (found,)))


def position_columns(table: OpenTable, naming: Naming, taken: Collection[int]) -> tuple[Column, ...]:
    """The columns x y z if all are there, each once and of one set, and at none of the places `taken`; else none."""
    header = Header.of(table, naming)
    found = [header.usual(part) for part in POSITION]
    if None in found:
        candidates = [header.candidates.get(part, []) for part in POSITION]
        found = [several[0] if len(several) == 1 else None for several in candidates]
        found = found if len({each.said.of for each in found if each is not None}) == 1 else []
    whole = [each for each in found if each is not None and each.place not in taken]
    if len(whole) < len(POSITION):
        return ()
    made = tuple(header.column(each, part) for each, part in zip(whole, POSITION, strict=True))
    if not all(each.is_usual for each in made):
        header.require_units(made, "length")
    return made


def _load_column(header: Header) -> Column | None:
    """The column of a load hung on the tool. Raises `FileFormatError` for one without a unit."""
    found = header.usual("load") or header.first("load")
    if found is not None and not found.said.unit:
        raise FileFormatError(f"{header.source}: column load has no unit, expected load_g or load_kg: rename it")
    return None if found is None else header.column(found, "load")
