"""Numbers without a stated unit that look like another one: radians read as degrees, ms read as seconds."""

from __future__ import annotations

import re
from os import SEEK_END
from pathlib import Path

import numpy as np

from ...errors import InputError
from ...files import TEXT_AT_ONCE, name_of, open_bytes
from ...geometry.arrays import Array
from ...geometry.ranges import likely_unit
from .columns import FLAW, Naming, shown
from .csv import SUFFIXES
from .layout import is_row
from .orientations import orientation_columns
from .roles import time_columns
from .table import open_table
from .units import ANGLE

HALF_A_TURN = 3.15
"""A bit more than pi: angles in degrees go beyond it wherever an arm turns enough to calibrate."""

LEAST_TURN = 0.3
"""By how much some angle differs from row to row, in radians that poses tell anything, in degrees not."""

FEWEST_ROWS = 5

LONGEST_WAIT = 600.0
"""s from row to row: in so many rows nobody waits for longer."""


def turns_little(R_base_flange: Array) -> bool:
    """Whether none of some orientations (n, 3, 3) turns more than angles that are beyond half a turn in no unit can."""
    widest = 3.0 * np.deg2rad(HALF_A_TURN)
    return bool((np.einsum("nii->n", R_base_flange) >= 1.0 + 2.0 * np.cos(widest)).all())


def angles_in_doubt(path: str | Path, naming: Naming) -> str:
    """What to say of angles, not known to turn more than a little (see `turns_little`), if none of them, read in
    degrees, goes beyond half a turn of radians; empty where file or options state the unit.
    """
    table = open_table(path, naming)
    convention, columns = orientation_columns(table, naming)
    in_degrees = convention.angle_unit is not None and all(column.per_si == ANGLE["deg"] for column in columns)
    if not in_degrees or any(column.unit for column in columns):
        return ""
    angles = np.concatenate([body.numbers(columns, columns) for body in table.bodies(columns)])
    if len(angles) < FEWEST_ROWS or np.isnan(angles).all():
        return ""
    if not (np.nanmax(np.abs(angles)) <= HALF_A_TURN and np.nanmax(np.ptp(angles, axis=0)) > LEAST_TURN):
        return ""
    return (
        f"the angles {', '.join(shown(column.name) for column in columns)} are likely in radians: none is beyond "
        f"{HALF_A_TURN}, and {convention.name} reads degrees: say --units angle=rad, or, if they are degrees, "
        "--units angle=deg; contactwrench diagnose tries both"
    )


def end_in_doubt(path: str | Path) -> str:
    """What to say of a text file whose last row has no line end; empty for any other file."""
    if Path(path).suffix.lower() not in SUFFIXES or Path(path).is_dir():
        return ""
    with open_bytes(path) as file:
        header = file.readline(TEXT_AT_ONCE).strip()
        file.seek(max(file.seek(0, SEEK_END) - TEXT_AT_ONCE, 0))
        last = re.split(rb"[\r\n]", file.read())[-1].replace(b"\0", b"")
    unfinished = header.endswith(f",{FLAW}".encode()) and last.count(b",") < header.count(b",")
    what = " and too few cells: it was left out" if unfinished else ": its last number may be cut off"
    return f"{name_of(path)}: the last line has no line end{what}" if is_row(last.decode(errors="replace")) else ""


def times_in_doubt(path: str | Path, naming: Naming, t: Array | None) -> str:
    """What to say of a table's times (n,), read as s, if that is likely not their unit; empty where nothing is in
    doubt, or where file or options state the unit. Raises `InputError` where nobody waits so long from row to row.
    """
    if t is None or (likely := likely_unit(t)) is None:
        return ""
    columns, (unit, step) = time_columns(open_table(path, naming), naming), likely
    if not columns or columns[0].unit:
        return ""
    to_do = f"read them with --units time={unit}; if they are seconds, say --units time=s"
    if step > LONGEST_WAIT:
        where = f"{name_of(path)}: found {len(t)} rows {step:g} s apart by the times {shown(columns[0].name)}"
        raise InputError(f"{where}, expected seconds: {to_do}")
    seen = f"read as s, {len(t)} rows come {step:g} s apart"
    return f"the times {shown(columns[0].name)} are likely in {unit}: {seen}: {to_do}"
