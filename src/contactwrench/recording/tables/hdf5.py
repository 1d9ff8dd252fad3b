"""Named columns of numbers in HDF5 files: datasets of as many rows, a block of rows at a time, by h5py.

Groups `demo_0`, `demo_1` and so on hold an episode each and the same datasets, as robomimic has them
(ARISE-Initiative/robomimic, docs/datasets/overview.md): together one set; rows are counted within each.
"""

from __future__ import annotations

import os
import re
import zlib
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import lru_cache, partial
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import FileFormatError, of_extra
from ...files import open_bytes
from ...geometry.arrays import Array
from .batch import BYTES_PER_ROW, ROOM, Batch, Field, readable, require_room
from .columns import Column, Naming, OpenTable, places_of, shown
from .episodes import EPISODE
from .hdf5_columns import OLD, bytes_at_once, dataset_at, datasets_stated, fields_found, fields_of_roles, width_of

SUFFIXES = (".h5", ".hdf5", ".mat")
DEEPEST = 32
EPISODES = re.compile(r"((?:.*/)?)(?:demo|episode|traj)_?(\d{1,18})")


_readable = partial(readable, kind="HDF5", errors=(OSError, RuntimeError, KeyError, ValueError, TypeError, zlib.error))


@dataclass(frozen=True)
class _Group:
    """What holds the datasets of one recording: the whole file, or an episode of a set by its number."""

    path: str
    episode: int | None


def is_hdf5(path: str | Path) -> bool:
    """Whether a path is an HDF5 file by its suffix."""
    return Path(path).suffix.lower() in SUFFIXES and not os.path.isdir(path)


def open_hdf5(path: str | Path, naming: Naming, rows: int) -> OpenTable:
    """An HDF5 file; of a set the episode that is stated, where it has that, else all. Raises `FileAccessError`,
    `FileFormatError`, `InputError` for an `hdf5` that names no datasets, and `MissingExtraError`.
    """
    source = str(path)
    with _opened(path) as file, _readable(source):
        stated = None if naming.hdf5 is None else datasets_stated(naming.hdf5)
        in_file = stated is not None and None not in [dataset_at(file, name, source) for name in stated.values()]
        every = (_Group("/", None),) if in_file else _groups_of(source, os.stat(path).st_mtime_ns)
        groups = [group for group in every if group.episode == naming.episode] or every
        one, orientation = file[groups[0].path], naming.orientation
        fields = fields_found(one) if stated is None else fields_of_roles(one, stated, orientation, source)
    if not fields:
        raise FileFormatError(
            f"{source}: found no dataset of numbers (n,) or (n, k), expected one for each column or list: name them "
            "with --hdf5"
        )
    if groups[0].episode is not None:
        fields.append(Field(EPISODE, ()))

    def bodies(columns: Collection[Column]) -> Iterator[Datasets]:
        asked = {field.path[0]: field.length for column in columns if (field := fields[column.place]).path}
        with _opened(path) as file:
            for k, group in enumerate(groups):
                datasets = _datasets(file[group.path], group, asked, source)
                length = min(map(len, datasets.values())) if datasets else _longest(file[group.path], source)
                for start in range(0, length, rows):
                    block = np.arange(start, min(start + rows, length)) + 1
                    done = (k + block[-1] / length) / len(groups)
                    yield Datasets(block, source, done, datasets, group, fields)

    return OpenTable(source, places_of((field.name for field in fields), source), bodies)


@dataclass(eq=False)
class Datasets(Batch):
    """Rows of one group of datasets, read when they are asked for."""

    datasets: dict[str, Any]
    which: _Group
    fields: list[Field]
    _read: dict[str, Array] = field(default_factory=dict, init=False)

    def floats(self, column: Column) -> Array:
        """The numbers (n,) of a column. Raises `FileFormatError` where they cannot be read."""
        of = self.fields[column.place]
        if not of.path:
            return np.full(len(self), float(self.which.episode or 0))
        name, first = of.path[0], int(self.rows[0])
        if name not in self._read:
            with _readable(self.source):
                block = np.asarray(self.datasets[name][first - 1 : int(self.rows[-1])], dtype=np.float64)
            self._read[name] = block.reshape(len(block), -1)[self.rows - first]
        return self._read[name][:, of.element or 0]


@lru_cache(4)
def _groups_of(path: str, changed: int) -> tuple[_Group, ...]:
    """The episodes of a set in order, or the whole file; looked through once while it is as it `changed` last."""
    names: list[str] = []

    def too_deep(name: str) -> bool | None:
        names.append(name)
        return name.count("/") > DEEPEST or None

    with _opened(path) as file, _readable(path):
        if file.visit(too_deep):
            raise FileFormatError(f"{path}: found over {DEEPEST} groups in each other, expected fewer: export it anew")
        found = [(match[1], int(match[2]), name) for name in names if (match := EPISODES.fullmatch(name))]
        outer = [each for each in found if not EPISODES.fullmatch(each[0].rstrip("/"))]
        groups = [each for each in outer if hasattr(file[each[2]], "visititems")]
    if len({parent for parent, _, _ in groups}) > 1 or len({number for _, number, _ in groups}) < len(groups):
        raise FileFormatError(
            f"{path}: found the groups {shown(groups[0][2])} and {shown(groups[-1][2])}, expected the episodes of "
            "one set, each with its number: name the datasets with --hdf5"
        )
    episodes = (_Group(name, number) for _, number, name in sorted(groups, key=itemgetter(1)))
    return tuple(episodes) or (_Group("/", None),)


def _longest(group: Any, source: str) -> int:
    """The number of rows of the longest dataset."""
    with _readable(source):
        length = max((max(group[field.path[0]].shape) for field in fields_found(group)), default=0)
    require_room(source, length, "rows", BYTES_PER_ROW)
    return length


def _datasets(group: Any, which: _Group, asked: dict[str, int], source: str) -> dict[str, Any]:
    """The datasets that are asked for, by their paths and how many numbers they have in a row; each has as many."""
    if not asked:
        return {}
    datasets: dict[str, Any] = {}
    with _readable(source):
        for path, width in asked.items():
            dataset = dataset_at(group, path, source)
            if dataset is None or width_of(dataset) != width:
                raise FileFormatError(
                    f"{source}: found no dataset {shown(path)} of {width} numbers a row in {shown(which.path)}, "
                    "expected the same datasets in each episode: choose another with --episode"
                )
            datasets[path] = dataset
    require_room(source, sum(map(bytes_at_once, datasets.values())), "bytes in chunks")
    lengths = {path: len(dataset) for path, dataset in datasets.items()}
    shortest, longest = min(lengths, key=lengths.__getitem__), max(lengths, key=lengths.__getitem__)
    if lengths[shortest] != lengths[longest]:
        raise FileFormatError(
            f"{source}: found {lengths[longest]} rows in {shown(longest)} and {lengths[shortest]} in "
            f"{shown(shortest)}, expected as many in each: export them on one clock, or as two files for --wrench and "
            "--pose"
        )
    if not lengths[longest]:
        raise FileFormatError(f"{source}: found datasets and no rows, expected a row for each reading: add them")
    return datasets


@contextmanager
def _opened(path: str | Path) -> Iterator[Any]:
    """An open HDF5 file. Raises `FileAccessError`, `FileFormatError` and `MissingExtraError`."""
    h5py = of_extra("h5py", "HDF5", "hdf5")
    with open_bytes(path) as content:
        if content.read(len(OLD)) == OLD:
            raise FileFormatError(
                f"{path}: found a MAT-file before version 7.3, expected that, which is HDF5: write it in MATLAB with "
                "save(..., '-v7.3'), or as CSV with writetable; in Python contactwrench.Samples takes arrays"
            )
    with _readable(str(path)):
        file = h5py.File(path, "r", rdcc_nbytes=ROOM)
    with file:
        yield file
