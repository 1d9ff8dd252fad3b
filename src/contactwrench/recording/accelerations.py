"""An accelerometer's readings in a recording: a topic of the bag, a table beside it, or three of its own columns."""

from __future__ import annotations

import os
import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..errors import FileFormatError, InputError
from ..samples.accelerometer import AccelerometerStream
from ..samples.bursts import bursts_in, spread
from .bags.messages import ACCELERATIONS, XYZ, numbers
from .bags.open import is_bag, messages, opened_bag
from .bags.topics import IMU_FLAG, named_topic
from .options import Options
from .tables.columns import AS_NAMED, Column, Naming, listed
from .tables.roles import time_columns
from .tables.table import SUFFIXES as SUFFIXES_OF_TABLES
from .tables.table import in_seconds, open_table, whole_columns

OF_AXIS = re.compile(r"(?!.*angular)(?:.*[/._ ])?(?:linear_?)?a(?:cc(?:el(?:eration)?)?)?[/._ ]?([xyz])", re.IGNORECASE)
"""The column of an axis, as ax, acc_x, accel_x, linear_acceleration.x."""


def accelerometer_of(path: str | Path, options: Options) -> AccelerometerStream | None:
    """The stream that `options.imu` names in a recording or beside it; None: it names nothing. Raises as reading."""
    if options.imu is None:
        return None
    suffix = Path(options.imu).suffix.lower()
    names_a_table = suffix and suffix in SUFFIXES_OF_TABLES
    if names_a_table or os.path.exists(options.imu):
        stream = _of_table(options.imu, None, AS_NAMED)
    elif is_bag(path):
        stream = _of_bag(path, options)
    else:
        stream = _of_table(path, options.imu, options)
    return replace(stream, t=spread(stream.t, bursts_in(stream.t)))


def _of_bag(path: str | Path, options: Options) -> AccelerometerStream:
    with opened_bag(path, accept_damaged=options.accept_damaged) as bag:
        topic = named_topic(bag, str(options.imu), tuple(ACCELERATIONS), IMU_FLAG)
        axes = tuple(ACCELERATIONS[topic.type] + axis for axis in XYZ)
        parts = [numbers(bag, topic, part[topic], axes)[:2] for part in messages(bag, (topic,)) if topic in part]
        t, reading = (np.concatenate(values) for values in zip((np.empty(0), np.empty((0, 3))), *parts, strict=True))
        return AccelerometerStream(t, reading, f"{path} {topic.name}")


def _of_table(path: str | Path, columns: str | None, naming: Naming) -> AccelerometerStream:
    """Of a table of its own, or those `columns` of one."""
    table = open_table(path, naming)
    names = _named_alike(list(table.places)) if columns is None else [name.strip() for name in columns.split(",")]
    lacking = [name for name in names if name not in table.places]
    if len(names) != 3 or lacking:
        found = f"found {listed(table.places)}"
        if columns is None:
            raise FileFormatError(f"{path}: {found}, expected one accelerometer's t, ax, ay, az: rename the columns")
        none = f"no column {lacking[0]}" if lacking else f"{len(names)} names in --imu"
        raise InputError(f"{path}: found {none}, expected a file, or three of {listed(table.places)} as ax,ay,az")
    axes = [Column(table.places[name], name, 1.0, role) for name, role in zip(names, ("ax", "ay", "az"), strict=True)]
    t = time_columns(table, naming)
    if not t:
        raise FileFormatError(f"{path}: found no column t, expected the time of each acceleration: add it")
    of_times, reading = whole_columns(table, t, axes, may_lack=axes)
    return AccelerometerStream(np.asarray(in_seconds(of_times, t)), reading, str(path))


def _named_alike(names: list[str]) -> list[str]:
    """The three columns named as accelerations are, in the order of their axes; none where there are others, too."""
    matches = [(match[1].lower(), name) for name in names if (match := OF_AXIS.fullmatch(name))]
    return [name for _, name in sorted(matches)] if sorted(axis for axis, _ in matches) == list("xyz") else []
