"""A recording read as its calibration's was: an option that nobody stated is the calibration's, where it fits.

A file's columns say whether options of the columns fit. What the numbers mean (sign, axes, inverse, a stated unit) no
column says: it goes with the columns, and where these are others it is asked for.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import chain, combinations
from pathlib import Path
from shlex import join
from typing import Any, TypeAlias

import numpy as np

from ..assess.robot_arms import R_between
from ..calibration.calibration import Calibration
from ..errors import ContactWrenchError, FileFormatError, InputError
from ..files import name_of
from ..geometry.orientation import RECOGNISED_BY_NAME
from .bags.chunks import Topic
from .bags.open import Bag, opened_bag
from .bags.read import base_frame
from .bags.topics import pose_topics, wrench_topic
from .options import AS_USUAL, OF_MEANING, Options, remembered
from .read import read_as_bag
from .tables.columns import ColumnRoles, shown, taken_for
from .tables.roles import roles_of, wrench_columns
from .tables.table import open_table
from .tables.units import per_si, stated_units, symbol
from .urdf import arm_of

OF_COLUMNS = ("units", "hdf5", "orientation", "wrench_columns", "time_column")
"""Where not all fit, the first are kept first."""

OF_POSE = ("pose_topic", "frames", "robot")
"""Where a bag has its pose: stated together, and so taken together."""

ASKED_FOR = {
    "sign": ("wrench_columns", "--sign pull"),
    "wrench_frame": ("wrench_columns", "--wrench-frame sensor"),
    "inverse_orientation": ("orientation", "--no-inverse-orientation"),
    "units": ("wrench_columns", "--units force=N,torque=Nm"),
}
"""By which option of the columns a table shows that it is written as another one; and what says so."""


@dataclass(frozen=True, eq=False)
class AsCalibrated:
    """How to read a recording, the calibration in the recording's base, and what there is to say of both."""

    options: Options
    calibration: Calibration
    notes: tuple[str, ...]


_Taken: TypeAlias = tuple[dict[str, Any], frozenset[str], str | None]
"""Options of the calibration that fit, those of them that would be so anyhow, and the base that is named."""


def as_calibrated(
    path: Path, options: Options, stated: Collection[str], calibration: Calibration, *, gravity_stated: bool = False
) -> AsCalibrated:
    """Complete the options of reading, of which somebody `stated` some, by those of a calibration, and bring that into
    the recording's base, unless `gravity_stated`. Raises as reading, and `InputError` for an option that may or may not
    hold here, and for a base that nobody knows against the calibration's.
    """
    known = remembered(calibration.provenance)
    left_open = {name: value for name, value in known.items() if name not in stated}
    is_bag = read_as_bag(path, options)
    was_bag = "wrench_topic" in known if known.keys() & {"orientation", "wrench_topic"} else is_bag
    fitting = left_open if was_bag == is_bag else {}
    numbered = str(calibration.provenance.get("numbered", ""))
    completed = _of_bag(path, options, stated, fitting) if is_bag else _of_table(path, options, fitting, numbered)
    taken, anyhow, named_base = completed
    read = replace(options, **taken)
    others = [name for name in OF_COLUMNS if getattr(read, name) != known.get(name, getattr(AS_USUAL, name))]
    changed = set(others)
    meant = {n: value for n, value in left_open.items() if n in OF_MEANING and value != getattr(AS_USUAL, n)}
    by_names = not (is_bag or was_bag or read.wrench_columns or "units" in others)
    units = taken.get("units", "")
    asked = meant | ({"units": units} if "force" in units or "torque" in units else {})
    if asked and by_names and _wrench_has_other_names(path, read, calibration):
        changed.add("wrench_columns")
    for name, value in asked.items():
        shown_by, otherwise = ASKED_FOR[name]
        if was_bag != is_bag or shown_by in changed:
            found = "other columns" if was_bag == is_bag else "a bag" if is_bag else "a table"
            raise InputError(
                f"{name_of(path)}: found {found}, and a calibration read with {_options({name: value})}, expected to "
                f"be told whether that holds here: repeat it, or say {otherwise}"
            )
    read = replace(read, **meant)
    if not (is_bag or was_bag):
        _require_units(path, read, calibration.provenance)
    taken_on = {name: value for name, value in taken.items() if name not in anyhow} | meant
    notes = [f"read as the calibration was: {_options(taken_on)}"] if taken_on else []
    notes += _differences(options, stated, known, {name: fitting[name] for name in others if name in fitting})
    if not gravity_stated:
        frame = None if read.inverse_orientation else named_base  # which names the flange then
        calibration, of_base = in_base_of_recording(calibration, options.base_frame or frame, str(path))
        notes += [of_base] if of_base is not None else []
    doubts = [finding.brief for finding in calibration.findings if finding.severity == calibration.verdict]
    notes += [f"the calibration is {calibration.verdict}: {doubt}" for doubt in doubts[:1]]  # `show` has it whole
    return AsCalibrated(read, calibration, tuple(notes))


def in_base_of_recording(
    calibration: Calibration, base_frame: str | None, source: str
) -> tuple[Calibration, str | None]:
    """A calibration for a recording, `source` in words, whose orientations are in `base_frame` (None: it does not say),
    in that base; and what there is to say of it. Raises `InputError` where nobody knows how the two bases stand.
    """
    own, new = (str(name or "").removeprefix("/") for name in (calibration.provenance.get("base_frame"), base_frame))
    if not own or not new:
        upright = np.array_equal(np.abs(calibration.gravity_direction), [0.0, 0.0, 1.0])  # so no turn about z matters
        silent = "the calibration" if new else "this recording"
        said = f"{silent} does not name its base: taken to be {own or new} (--base-frame names it)"
        return calibration, said if (own or new) and not upright else None
    R = R_between(new, own)
    if R is None:
        raise InputError(
            f"{source}: found orientations in {new}, expected the calibration's base, {own}: if the two are one, say "
            f"{join(['--base-frame', own])}, else which way gravity points in {new}, with --gravity X,Y,Z"
        )
    if np.array_equal(R, np.eye(3)):
        return calibration, None
    said = f"orientations are in {new}, half a turn about z from the calibration's {own}: it was turned into that"
    return calibration.with_base(R, new), said


def _differences(
    options: Options, stated: Collection[str], known: Mapping[str, Any], left_out: Mapping[str, Any]
) -> Iterator[str]:
    """What was stated otherwise for the calibration, and what of its columns is not in the recording."""
    auto = left_out.get("orientation") in RECOGNISED_BY_NAME  # and so is the recording's own
    lacking = {name: value for name, value in left_out.items() if not (auto and name == "orientation")}
    if lacking:
        yield f"not read as the calibration was, no columns for {_options(lacking)}"
    for name, before in known.items():
        now = getattr(options, name)
        if name in stated and now != before:
            yield f"{_option(name)} was {_value(before)} for the calibration and is {_value(now)} for this recording"


def _of_table(path: Path, options: Options, known: Mapping[str, Any], numbered: str) -> _Taken:
    """As many of the options of the columns as a table has columns for; the units of columns that are not there say
    nothing of others, nor do numbers of columns where there are not as many as were `numbered` for the calibration.
    """
    names = [name for name in OF_COLUMNS if name in known]
    for count in range(len(names), 0, -1):
        for some in combinations(names, count):
            if "units" in some and "wrench_columns" in names and "wrench_columns" not in some:
                continue
            values = {name: known[name] for name in some}
            with suppress(FileFormatError, InputError):
                roles = _roles(path, replace(options, **values))
                if not set(map(str, roles.numbered)) <= set(numbered.split(",")):
                    continue
                return values, _orientation_anyhow(path, options, values), None
    if names:
        _roles(path, options)  # complains of a table that is none
    return {}, frozenset(), None


def _wrench_has_other_names(path: Path, options: Options, calibration: Calibration) -> bool:
    """Whether the columns of a table's wrench, found by their names, bear others than those of the calibration."""
    columns = wrench_columns(open_table(path, options), options)
    known = str(calibration.provenance.get("columns", "")).lower()
    usual = all(each.is_usual for each in columns)
    return known.startswith("fx") if usual else not known.startswith(taken_for(columns).lower())


def _orientation_anyhow(path: Path, options: Options, values: Mapping[str, Any]) -> frozenset[str]:
    """The orientation's name, where the columns tell it."""
    with suppress(FileFormatError):
        by_itself = _roles(path, replace(options, **{**values, "orientation": options.orientation})).convention
        if by_itself is not None and by_itself.name == values.get("orientation"):
            return frozenset({"orientation"})
    return frozenset()


def _require_units(path: Path, read: Options, provenance: Mapping[str, Any]) -> None:
    """Raise `InputError` where the calibration's columns stated an unusual unit and those of a table state none."""
    by_option = stated_units(provenance.get("units"))
    before = {q: unit for q, unit in stated_units(provenance.get("units_read")).items() if q not in by_option}
    for quantity, columns in _roles(path, read).with_units.items() if before else ():
        unit, silent = before.get(quantity), next((column for column in columns if not column.unit), None)
        if unit is not None and silent is not None and silent.per_si != per_si(quantity, unit):
            raise InputError(
                f"{name_of(path)}: found no unit of the {quantity} in {shown(silent.name)}, and a calibration whose "
                f"{quantity} was read in {unit}, expected to be told which: say --units {quantity}={symbol(unit)}, or "
                "another unit"
            )


def _roles(path: Path, options: Options) -> ColumnRoles:
    """Which columns are what, of two files together. Raises as reading."""
    if options.pose_file is None:
        return roles_of(open_table(path, options), options)
    of_wrench = replace(options, orientation=None)
    wrenches = roles_of(open_table(path, of_wrench), of_wrench)
    poses = roles_of(open_table(options.pose_file, options), options, wrench=False)
    return replace(poses, wrench=wrenches.wrench, numbered=(*wrenches.numbered, *poses.numbered))


def _of_bag(path: Path, options: Options, stated: Collection[str], known: Mapping[str, Any]) -> _Taken:
    """The topic of the wrench, and where the pose is unless anything of that is stated."""
    of_pose = () if any(name in stated for name in OF_POSE) else OF_POSE
    values = {name: known[name] for name in ("wrench_topic", *of_pose) if name in known}
    read = replace(options, **values)
    with opened_bag(path, accept_damaged=options.accept_damaged) as bag:
        try:
            arm = None if read.robot is None else arm_of(read.robot)
            wrench = wrench_topic(bag, read.wrench_topic)
            pose = pose_topics(bag, read.pose_topic, read.frames, arm)
        except ContactWrenchError as error:
            if not values:
                raise
            raise type(error)(f"{error} (as the calibration was read: {_options(values)})") from None
        anyhow = frozenset(_topics_anyhow(bag, values, wrench, pose[0]))
        return values, anyhow, base_frame(bag, pose, read.frames, arm)


def _topics_anyhow(bag: Bag, values: Mapping[str, Any], wrench: Topic, pose: Topic) -> Iterator[str]:
    """The names of topics that are the only ones."""
    with suppress(FileFormatError):
        if wrench_topic(bag, None) == wrench:
            yield "wrench_topic"
    with suppress(FileFormatError):
        if not values.keys() & {"frames", "robot"} and pose_topics(bag, None, None, None) == (pose,):
            yield "pose_topic"


def _options(values: Mapping[str, Any]) -> str:
    """Options as on a command line."""
    words = ([_option(name)] if value is True else [_option(name), _value(value)] for name, value in values.items())
    return join(chain.from_iterable(words))


def _option(name: str) -> str:
    return f"--{name.replace('_', '-')}"


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return "given" if value else "left out"
    return ",".join(value) if isinstance(value, tuple) else str(value)
