"""Every interpretation of a file that a person could have meant: by options, or by words about the file."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import cache
from itertools import permutations
from pathlib import Path
from shlex import quote
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..assess.interpretations import Interpretations, OrientationInterpretation, TorqueUnit, WrenchInterpretation
from ..errors import FileFormatError, InputError
from ..files import name_of
from ..geometry.arrays import Array
from ..geometry.orientation import CONVENTIONS, LONGEST_ROTATION_VECTOR, Convention, convention
from .options import AS_USUAL, Options
from .tables.columns import Column
from .tables.names import stated_unit
from .tables.units import ANGLE, per_si, stated_units, symbol
from .written_poses import Written, poses_of, rows_as_written

NAMED, GENERIC, UNIT, INVERSE, FRAME, TORQUE_UNIT = 1.0, 2.5, 1.0, 1.0, 1.0, 1.5
SHIFTED, BOTH_KINDS, ONE_KIND, TORQUE_REVERSED = 2.0, 2.0, 3.0, 2.5
"""What a change costs, in changes as likely as a wrong option (see diagnose.py): the rarer the mistake, the more."""

UNITS_OF_SENSORS = {
    "N": ("N m", "N mm", "N cm", "kgf cm", "lbf in"),
    "kgf": ("N m", "kgf m", "kgf cm"),
    "lbf": ("N m", "lbf in", "lbf ft"),
    "mN": ("N m", "mN m"),
    "kN": ("N m", "kN m"),
}
"""Of force: those of torque that sensors, drivers and hurried scripts pair it with."""

MOST_POSES = 300
"""A longer recording is thinned: a wrong interpretation shows in a few dozen poses."""

ROWS_LOOKED_AT = 10_000
JUMPS = 3.0
"""Times the shortest path, from which on an orientation jumps by its convention: angles beyond a half turn begin anew.
"""

TURNED_AXES = (*map("".join, permutations("XYZ")), *(f"{a}{b}{a}" for a, b in permutations("XYZ", 2)))
FORMULAS_OF_ANGLES = (*TURNED_AXES, *(letters.lower() for letters in TURNED_AXES), "rotvec")
PROBE = np.array([[0.3, -0.5, 0.7]])

_Attempt: TypeAlias = tuple[str, str, tuple[str, ...], float, Callable[[Array], Array], Array]
"""What --orientation and --units take for it, mends and cost, a formula, and the numbers that may make rotations by it.
"""


def interpretations(path: str | Path, options: Options = AS_USUAL, gravity: Array | None = None) -> Interpretations:
    """All interpretations of a file: of its orientation, times those of its wrench.

    The poses are those that `calibrate` takes, each visit to an orientation for itself. Of a wrench without an
    orientation in its row, a bag's or one of two files, base axes are no interpretation: nothing reads it so.

    Args:
        path: of the recording.
        options: of reading, as stated.
        gravity: (3,) the stated direction, base axes; None: down.

    Returns:
        The readings, N and N m, and what they and the orientations may mean.

    Raises:
        FileAccessError: it cannot be read.
        FileFormatError: columns are missing or hold no numbers, or all rows have a load.
        InputError: options that are none, or a stream in which the arm never stands still.
    """
    rows = rows_as_written(path, options)
    if not len(rows.wrench):
        raise FileFormatError(f"{name_of(path)}: found no contact-free samples, expected poses without a load")
    rotations = _rotations(rows)
    written = rows if rotations is None else poses_of(rows, rotations)
    n = len(written.wrench)
    picked = np.unique(np.linspace(0, n - 1, min(n, MOST_POSES)).astype(np.intp))
    stated_option = () if options.orientation == "auto" else (f"--orientation {quote(str(options.orientation))}",)
    units = stated_units(options.units)
    candidates: list[OrientationInterpretation] = []
    if written.stated is not None:
        candidates.append(OrientationInterpretation(stated_option, (), 0.0, written.stated))
    for columns, numbers in written.sets:
        tried = _candidates(columns, numbers, written, units.get("angle", ""))
        for option, of_angle, mends, cost, to_matrices, values in tried:
            with suppress(InputError):
                stated = (f"--orientation {quote(option)}",)
                made = OrientationInterpretation(stated, mends, cost, to_matrices(values), units=of_angle)
                candidates.append(made)
    distinct: dict[bytes, OrientationInterpretation] = {}
    for each in sorted(_turned_and_shifted(candidates, options.inverse_orientation, picked), key=lambda o: o.cost):
        distinct.setdefault(repr(each.rows).encode() + np.round(each.R_base_flange, 9).tobytes(), each)
    return Interpretations(
        source=written.source,
        wrench=written.wrench[picked],
        orientations=tuple(distinct.values()),
        wrenches=tuple(_of_wrench(options.wrench_frame, written.in_rows)),
        sign=options.sign,
        gravity=gravity,
        units=tuple(f"{quantity}={symbol(unit)}" for quantity, unit in units.items()),
        torque_unit=_other_torque_unit(written.wrench_columns[3:]),
        wrench_units=tuple(_units_of_wrench(written.wrench_columns)),
        complaint=written.complaint,
    )


def _rotations(rows: Written) -> Array | None:
    """Rotations (n, 3, 3) that tell one stop from the next: as stated, unless these may be radians read in degrees, or
    jump; else by the convention by which the arm turns least. None where no convention makes any.
    """
    may_be_radians = all(np.abs(numbers).max(initial=0.0) <= LONGEST_ROTATION_VECTOR for _, numbers in rows.sets)
    some = slice(None, None, 1 + len(rows.wrench) // ROWS_LOOKED_AT)
    tried: list[tuple[float, Callable[[Array], Array], Array]] = []
    for names, numbers in rows.sets:
        attempts = [(to_matrices, values) for *_, to_matrices, values in _candidates(names, numbers, rows, "")]
        largest = max((float(np.abs(values).max(initial=0.0)) for _, values in attempts), default=0.0)
        for to_matrices, values in attempts:
            with suppress(InputError):
                if float(np.abs(values).max(initial=0.0)) >= 0.5 * largest:  # of two units the one that turns more
                    tried.append((_path(to_matrices(values[some])), to_matrices, values))
    tried.sort(key=lambda attempt: attempt[0])
    trusted = rows.stated is not None and not (rows.in_degrees and may_be_radians)
    if rows.stated is not None and trusted and (not tried or _path(rows.stated[some]) <= JUMPS * tried[0][0]):
        return rows.stated
    for _, to_matrices, values in tried:
        with suppress(InputError):
            return to_matrices(values)
    return rows.stated


def _path(R: Array) -> float:
    """How far an arm turns from row to row, in all."""
    return float(np.sqrt(np.sum(np.diff(R, axis=0) ** 2, axis=(1, 2))).sum())


def _turned_and_shifted(
    candidates: list[OrientationInterpretation], inverse: bool, picked: NDArray[np.intp]
) -> Iterator[OrientationInterpretation]:
    for made in candidates:
        for is_inverse in (inverse, not inverse):
            R = made.R_base_flange.transpose(0, 2, 1) if is_inverse else made.R_base_flange
            options = (*made.options, *(["--inverse-orientation"] if is_inverse else []))
            for shift, whose in ((0, ""), (1, "next"), (-1, "previous")):
                mends = (*made.mends, *([f"each orientation belonging to the {whose} row's wrench"] if shift else []))
                cost = made.cost + INVERSE * (is_inverse != inverse) + SHIFTED * bool(shift)
                there = np.flatnonzero((picked >= shift) & (picked - shift < len(R)))
                rows = slice(int(there[0]), int(there[-1]) + 1) if len(there) else slice(0, 0)
                yield OrientationInterpretation(options, mends, cost, R[picked[there] - shift], rows, made.units)


def _candidates(names: tuple[str, ...], numbers: Array, written: Written, by_option: str) -> Iterator[_Attempt]:
    """Angles; quaternions as named and as they stand in the file; matrices by rows or columns."""
    if (k := len(names)) == 3:
        yield from _of_angles(names, numbers, written.convention, by_option)
        return
    as_named = list(range(k))
    in_file = sorted(as_named, key=lambda place: written.places[names[place]])
    another = {4: in_file, 16: [4 * i + j for j in range(4) for i in range(4)]}.get(k, as_named)
    for named in CONVENTIONS.values():
        for order in (as_named, another) if len(named.columns) == k else ():
            columns = tuple(names[place] for place in order)
            yield (_option(named, columns), "", (), NAMED, named.to_matrices, numbers[:, order])


def _of_angles(
    columns: tuple[str, ...], numbers: Array, stated: Convention | None, by_option: str
) -> Iterator[_Attempt]:
    """Every Euler sequence about turned and about fixed axes, and the rotation vector, in degrees and in radians; one
    unit may be stated by the columns' names, or `by_option`.
    """
    suffixes = [unit if (unit := stated_unit("angle", name)) in ANGLE else "" for name in columns]
    said = suffixes[0] if len(set(suffixes)) == 1 else ""
    for unit in ANGLE:
        scale = np.array([ANGLE[suffix if suffix and not said else unit] for suffix in suffixes])
        angles = numbers / scale
        if np.abs(angles).max(initial=0.0) > LONGEST_ROTATION_VECTOR and unit == "rad":
            continue
        renamed = tuple(f"{name}_{unit}" for name in _bare(columns))
        rename = f"the angles in {unit} (rename {', '.join(columns)} to {', '.join(renamed)})"
        for letters in FORMULAS_OF_ANGLES:
            to_matrices = _to_matrices(letters)
            named = _named(letters)
            same = stated is not None and bool(np.allclose(stated.to_matrices(PROBE), to_matrices(PROBE)))
            fitting = tuple(c for c in named if said or by_option or c.angle_unit == unit)
            usual = (
                said or by_option or (stated.angle_unit if same and stated else named[0].angle_unit if named else unit)
            )
            cost = (0.0 if same else NAMED if named else GENERIC) + UNIT * (unit != usual)
            must_rename, of_angle = bool(said) and unit != said, ""
            names, fitting = (renamed, named) if must_rename else (columns, fitting)
            if by_option or (not fitting and letters == "rotvec"):
                of_angle, fitting = f"angle={unit}", named
            best = min(fitting, key=lambda c: c.columns != _bare(names), default=None)
            option = _option(best, names) if best else f"euler:{letters}:{unit}:{','.join(names)}"
            yield (option, of_angle, (rename,) if must_rename else (), cost, to_matrices, angles)


@cache
def _to_matrices(letters: str) -> Callable[[Array], Array]:
    formula = CONVENTIONS["ur_rotvec"] if letters == "rotvec" else convention(f"euler:{letters}:rad")
    return formula.to_matrices


@cache
def _named(letters: str) -> tuple[Convention, ...]:
    """The conventions that have a name and are this formula."""
    R = _to_matrices(letters)(PROBE)
    of_angles = (c for c in CONVENTIONS.values() if len(c.columns) == 3)
    return tuple(c for c in of_angles if np.allclose(c.to_matrices(PROBE), R))


def _bare(columns: tuple[str, ...]) -> tuple[str, ...]:
    """The columns' names in small letters, without the unit of an angle."""
    return tuple(re.sub(r"\s*[\[(][^])]*[\])]$|_(deg|rad)$", "", name).lower() for name in columns)


def _option(named: Convention, columns: tuple[str, ...]) -> str:
    """What --orientation takes for a convention of these columns: its name alone where they bear its names."""
    return named.name if _bare(columns) == named.columns else f"{named.name}:{','.join(columns)}"


def _of_wrench(stated_frame: str, in_rows: bool) -> Iterator[WrenchInterpretation]:
    """Every interpretation of the wrench but for its sign, the stated one first."""
    for frame in (stated_frame, "base" if stated_frame == "sensor" else "sensor") if in_rows else ("sensor",):
        options = ("--wrench-frame base",) if frame == "base" else ()
        for mends, cost, matrix in _axes(frame):
            yield WrenchInterpretation(options, mends, cost + FRAME * (frame != stated_frame), matrix, frame == "base")


def _axes(frame: str) -> Iterator[tuple[tuple[str, ...], float, Array]]:
    """Axes exchanged, reversed or renamed: of force and torque alike, or of one of them."""
    from scipy.linalg import block_diag

    same = np.eye(3)
    yield (), 0.0, np.eye(6)
    for words, R in _axis_changes():
        yield (words.format("fx", "fy", "fz"),), ONE_KIND, block_diag(R, same)
    for words, R in _axis_changes():
        force, torque = (words.format(*(kind + axis for axis in "xyz")) for kind in "ft")
        yield (torque,), ONE_KIND, block_diag(same, R)
        if frame == "base" or np.linalg.det(R) < 0.0:  # in the sensor's axes a rotation of all is another mounting
            yield (force, torque), BOTH_KINDS, block_diag(R, R)
    yield ("tx, ty and tz reversed",), TORQUE_REVERSED, block_diag(same, -same)
    yield ("force and torque exchanged",), BOTH_KINDS, np.roll(np.eye(6), 3, axis=0)


def _axis_changes() -> Iterator[tuple[str, Array]]:
    same = np.eye(3)
    yield "{0} and {1} exchanged", same[[1, 0, 2]]
    yield "{1} and {2} exchanged", same[[0, 2, 1]]
    yield "{2} and {0} exchanged", same[[2, 1, 0]]
    for axis in range(3):
        yield f"{{{axis}}} reversed", np.diag(1.0 - 2.0 * same[axis])
    yield "{0}, {1}, {2} written as {2}, {0}, {1}", same[[1, 2, 0]]
    yield "{0}, {1}, {2} written as {1}, {2}, {0}", same[[2, 0, 1]]


def _other_torque_unit(torque: tuple[Column, ...]) -> TorqueUnit:
    """N mm where the file states N m, and the other way round."""
    if not torque:
        return TorqueUnit(1e-3, "", "the torque in N mm", TORQUE_UNIT)
    in_nmm, per_si = torque[0].per_si == 1e3, torque[0].per_si
    factor, unit = (per_si, "N m") if in_nmm else (1e-3 * per_si, "N mm")
    if not any(stated_unit("torque", column.name) for column in torque):
        return TorqueUnit(factor, f"torque={symbol(unit).capitalize()}", "", TORQUE_UNIT)
    new = ", ".join(name if in_nmm else f"{name}_nmm" for name in ("tx", "ty", "tz"))
    mend = f"the torque in {unit} (rename {', '.join(column.name for column in torque)} to {new})"
    return TorqueUnit(factor, "", mend, TORQUE_UNIT)


def _units_of_wrench(columns: tuple[Column, ...]) -> Iterator[tuple[str, float, float]]:
    """Pairs of units, by the option where no column states its own."""
    stated = [column.per_si for column in columns] or [1.0]
    named = not columns or any(stated_unit("force", c.name) or stated_unit("torque", c.name) for c in columns)
    words = "forces in {}, torques in {}" if named else "--units force={},torque={}"
    for force, torques in UNITS_OF_SENSORS.items():
        for torque in torques:
            label = words.format(force, torque if named else torque.replace(" ", ""))
            yield label, stated[0] / per_si("force", force), stated[-1] / per_si("torque", torque)
