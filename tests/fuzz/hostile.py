"""Files of less than a megabyte that ask for gigabytes, hours, or something that is not theirs."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import count
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from tests.support.bags import Message
from tests.support.hostile_bags import HOSTILE_BAGS, HOSTILE_MCAPS
from tests.support.hostile_sqlite import CHANGED, ROWS, changed, endless
from tests.support.hostile_tables import TEXTS, URDFS, hdf5_files, parquet_stating

COLUMNS = ("fx", "fy", "fz", "tx", "ty", "tz", "qx", "qy", "qz", "qw")
STATED: dict[str, dict[str, int]] = {
    "2^60 rows": {"rows": 2**60},
    "2^60 rows in a group": {"rows_of_group": 2**60},
    "a page of 2^40 bytes": {"size": 2**40},
    "2^31 - 1 values": {"values": 2**31 - 1},
    "10,000 structs in each other": {"nested": 10_000},
}
"""In a Parquet footer."""


def hostile(folder: Path, messages: list[Message]) -> Iterator[tuple[str, Path]]:
    """What each is, and where it was written: a folder each."""
    numbers = count()

    def place(name: str) -> Path:
        path = folder / f"hostile-{next(numbers)}" / name
        path.parent.mkdir()
        return path

    for suffix, made in {".mcap": HOSTILE_MCAPS, ".bag": HOSTILE_BAGS}.items():
        for name, content in made.items():
            yield name, _file(place(f"run{suffix}"), content())
    for name, sql in {**CHANGED, **ROWS}.items():
        yield name, changed(place("run.db3"), messages, sql)
    yield "a tree without an end", endless(place("run.db3"), messages)
    for name, (text, _) in TEXTS.items():
        yield name, _file(place("run.csv"), text)
    for name, stated in STATED.items():
        yield name, _file(place("run.parquet"), parquet_stating(**stated))
    for name in hdf5_files(Path()):
        yield name, _hdf5(place("run.h5"), name)
    for name, (text, _) in URDFS.items():
        yield name, _file(place("arm.urdf"), text)


def _file(path: Path, content: bytes | str) -> Path:
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def _hdf5(path: Path, name: str) -> Path:
    elsewhere = path.with_name("elsewhere.h5")
    for one in (path, elsewhere):
        with h5py.File(one, "w") as file:
            for column in COLUMNS if one == elsewhere else COLUMNS[1:]:
                file[column] = np.full(3, float(column == "qw"))
    make: Callable[[Any], None] = hdf5_files(elsewhere)[name][0]
    with h5py.File(path, "a") as file:
        make(file)
    return path
