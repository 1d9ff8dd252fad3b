"""Which columns the datasets of an HDF5 file stand for: by their own names, or as `--hdf5` says.

A dataset (n,) is a column, one of (n, k) stands for columns `path[0]` to `path[k-1]`, and so does one of 3 x 3
matrices, row by row. An attribute `units` belongs to the name, as if it stood there in brackets. MATLAB (MAT-files of
version 7.3) has all dimensions the other way round: its W(n, 6) is a dataset (6, n), its R(3, 3, n) one (n, 3, 3) of
transposed rotations.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from math import prod
from typing import Any, TypeGuard
from zlib import decompressobj

import numpy as np
from numpy.typing import NDArray

from ...errors import FileFormatError, InputError
from ...geometry.orientation import CONVENTIONS, convention
from .batch import BYTES_PER_ROW, MOST_ELEMENTS, ROOM, Field, require_room
from .columns import POSITION, WRENCH_COLUMNS, shown

GZIP, SHUFFLE, CHECKSUM, LZF = 1, 2, 3, 32000
BOUNDED: tuple[list[int], ...] = ([], [SHUFFLE], [GZIP], [LZF], [SHUFFLE, GZIP], [SHUFFLE, LZF])
"""Filters of chunks, by their numbers in the format, and those that unpack to no more than what was packed can hold."""
PACKED = {"scale_factor": 1.0, "add_offset": 0.0}
"""Attributes that say what to make of the numbers (CF conventions, 8.1), as netCDF's libraries do and HDF5's do not."""
UNITS = ("units", "unit", "units_of_measure", "unit_of_measure", "unit_of_measurement", "physical_unit")
MOST_BY_GZIP = 1032
"""Bytes that one byte can become (zlib's technical details)."""
OLD = b"MATLAB 5.0"
"""How a MAT-file before version 7.3 begins."""
CLASSES = {
    b"double",
    b"single",
    b"logical",
    *(f"{sign}int{size}".encode() for sign in ("", "u") for size in (8, 16, 32, 64)),
}
"""Of numbers. Those of letters, cells and tables are numbers too that stand for something else."""


def fields_found(group: Any) -> list[Field]:
    """The columns that all datasets of a group stand for."""
    fields: list[Field] = []

    def visit(path: str, item: Any) -> None:
        item = OfMatlab(item) if is_of_matlab(item) and holds_numbers(item) else item
        listed = holds_numbers(item) and not path.startswith("#") and (len(item.shape) < 3 or item.shape[1:] == (3, 3))
        if listed and width_of(item) <= MOST_ELEMENTS:
            width = width_of(item)
            names = [path] if width == 1 else [f"{path}[{k}]" for k in range(width)]
            fields.extend(_with_units(item, path, dict(enumerate(names))))

    group.visititems(visit)
    return fields


def datasets_stated(text: str) -> dict[str, str]:
    """The paths of datasets by their roles, of `wrench=/path,pose=/path,time=/path`. Raises `InputError`."""
    pairs = [[part.strip() for part in pair.partition("=")[::2]] for pair in text.split(",")]
    stated = {role: path.strip("/") for role, path in pairs}
    if len(stated) < len(pairs) or set(stated) - {"wrench", "pose", "time"} or not all(stated.values()):
        raise InputError(f"hdf5 is {text!r}, expected wrench=/PATH,pose=/PATH,time=/PATH, or some of them, each once")
    return stated


def fields_of_roles(group: Any, stated: dict[str, str], orientation: str | None, source: str) -> list[Field]:
    """The columns of the datasets that were `stated` (see `datasets_stated`); without poses where the `orientation` is
    None. Raises `FileFormatError` for a dataset that is not there, and for one of another shape.
    """
    fields: list[Field] = []
    for role, path in stated.items():
        dataset = dataset_at(group, path, source)
        if dataset is None:
            raise FileFormatError(
                f"{source}: found no dataset of numbers {shown(path)}, expected the one of the {role}: name another "
                "with --hdf5"
            )
        if role == "pose":
            names = {} if orientation is None else _of_pose(dataset, path, orientation, source)
        else:
            names = dict(enumerate(WRENCH_COLUMNS if role == "wrench" else ("t",)))
            if width_of(dataset) != len(names):
                raise _wrong_shape(dataset, path, "(n, 6)" if role == "wrench" else "(n,)", source)
        fields.extend(_with_units(dataset, path, names))
    return fields


def dataset_at(group: Any, path: str, source: str) -> Any:
    """The dataset of numbers under a path; None where there is none. Raises `FileFormatError` for one whose rows are
    elsewhere, were not all written, or are more than the file can hold.
    """
    where = f"{source}: dataset {shown(path)}"
    for end in re.finditer("/|$", path):
        if hasattr(group.get(path[: end.start()], getlink=True), "path"):
            raise FileFormatError(f"{where}: found a link, expected a dataset of this file: name what it points at")
    dataset = group.get(path)
    if not holds_numbers(dataset):
        return None
    if is_of_matlab(dataset):
        sizes, dataset = " x ".join(map(str, dataset.shape[::-1])), OfMatlab(dataset)
        if dataset.shape is None:
            raise FileFormatError(
                f"{where}: found {sizes} numbers of MATLAB, whose rows cannot be told from their columns, expected "
                "more rows than columns: add rows, or write them as CSV"
            )
    if packed := [name for name, plain in PACKED.items() if np.any(dataset.attrs.get(name, plain) != plain)]:
        raise FileFormatError(
            f"{where}: found numbers packed by {' and '.join(packed)}, expected those that they stand for: write them "
            "unpacked, times scale_factor, plus add_offset"
        )
    if dataset.external or dataset.is_virtual:
        raise FileFormatError(
            f"{where}: found rows that other files hold, expected them here: copy them into this file"
        )
    require_room(source, len(dataset), f"rows in {shown(path)}", BYTES_PER_ROW)
    require_room(source, bytes_at_once(dataset), f"bytes in a chunk of {shown(path)}")
    chunks = [-(-n // max(k, 1)) for n, k in zip(dataset.shape, dataset.chunks or dataset.shape, strict=True)]
    if prod(chunks) > (dataset.id.get_num_chunks() if dataset.chunks else dataset.id.get_storage_size()):
        raise FileFormatError(f"{where}: found rows that were never written, expected readings: leave them out")
    if dataset.chunks:
        _require_packed_as_stated(dataset, where)
    return dataset


def _require_packed_as_stated(dataset: Any, where: str) -> None:
    """Raise `FileFormatError` for chunks that unpack to more than they state, and for filters that take from the file
    how much that is: HDF5 holds none of them to it.
    """
    properties = dataset.id.get_create_plist()
    filters = [properties.get_filter(k)[0] for k in range(properties.get_nfilters())]
    if [code for code in filters if code != CHECKSUM] not in BOUNDED:
        raise FileFormatError(
            f"{where}: found rows packed by filters {', '.join(map(str, filters))}, expected gzip or LZF, alone or "
            "after shuffle: write it anew"
        )
    large: list[Any] = []
    if GZIP in filters:
        dataset.id.chunk_iter(lambda chunk: large.append(chunk) if MOST_BY_GZIP * chunk.size > ROOM else None)
    size = bytes_at_once(dataset)
    for chunk in large:
        _, packed = dataset.id.read_direct_chunk(chunk.chunk_offset)
        is_packed = not chunk.filter_mask >> filters.index(GZIP) & 1
        if is_packed and len(decompressobj().decompress(packed, size + 1)) > size:
            raise FileFormatError(
                f"{where}: found a chunk that unpacks to more than the {size} bytes that it states, expected as many: "
                "write it anew"
            )


def bytes_at_once(dataset: Any) -> int:
    """The least that can be read of a dataset."""
    return prod(dataset.chunks) * int(dataset.dtype.itemsize) if dataset.chunks else 0


def holds_numbers(item: Any) -> TypeGuard[Any]:
    """Whether something in a file is a dataset of numbers that has rows, and stand for nothing else: in MATLAB's those
    of an empty array are its size.
    """
    if getattr(item, "shape", None) in (None, ()) or item.dtype.kind not in "fiub":
        return False
    return not is_of_matlab(item) or ("MATLAB_empty" not in item.attrs and item.attrs["MATLAB_class"] in CLASSES)


def width_of(dataset: Any) -> int:
    """How many numbers there are in a row."""
    return prod(dataset.shape[1:])


def _with_units(dataset: Any, path: str, names: dict[int, str]) -> Iterator[Field]:
    """The columns that some elements of a dataset are, by their names, with the units that the dataset states."""
    width, units = width_of(dataset), _units(dataset)
    if (len(units), width) == (2, 6):
        units = [unit for unit in units for _ in range(3)]
    if len(units) != width:
        units = [", ".join(units)] * width
    for element, name in names.items():
        yield Field(f"{name} [{units[element]}]" if units[element] else name, (path,), element, width)


def _units(dataset: Any) -> list[str]:
    """What an attribute as `units` or `Unit` says: for all columns alike, for each, or for force and torque."""
    name = next((name for known in UNITS for name in dataset.attrs if name.lower() == known), "")
    if not name or prod(dataset.attrs.get_id(name).shape) > MOST_ELEMENTS:  # that many are no units
        return [""]
    stated = np.ravel(dataset.attrs[name]).tolist()
    texts = [text.decode(errors="replace") if isinstance(text, bytes) else str(text) for text in stated]
    return [shown(unit.strip()) for text in texts for unit in re.split("[,;]", text)]


def _of_pose(dataset: Any, path: str, orientation: str, source: str) -> dict[int, str]:
    """The columns of poses by their elements: of three more than the orientation has, the position's first."""
    width = width_of(dataset)
    if orientation == "auto" and width == 16:
        return _of_transforms(dataset, path, source)
    if orientation == "auto" and width != 9:
        raise FileFormatError(
            f"{source}: dataset {shown(path)}: found {width} numbers a row, expected to be told which orientation they "
            "are: say --orientation quat_xyzw, quat_wxyz or another"
        )
    columns: Sequence[str] = (CONVENTIONS["matrix"] if orientation == "auto" else convention(orientation)).columns
    if width == len(columns) + 3:
        columns = (*POSITION, *columns)
    if width != len(columns):
        raise _wrong_shape(dataset, path, f"(n, {len(columns)}), or 3 more with the position first", source)
    return dict(enumerate(columns))


def _of_transforms(dataset: Any, path: str, source: str) -> dict[int, str]:
    """The columns of 4 x 4 poses by their elements; that their last row is 0, 0, 0, 1 tells rows from columns."""
    pose = np.asarray(dataset[:1], dtype=np.float64).reshape(4, 4) if len(dataset) else np.eye(4)
    row_last, column_last = (bool(np.allclose(last, (0.0, 0.0, 0.0, 1.0))) for last in (pose[3], pose[:, 3]))
    if row_last == column_last:
        raise FileFormatError(
            f"{source}: dataset {shown(path)}: found 4 x 4 poses whose rows cannot be told from their columns, "
            "expected 0, 0, 0, 1 as the last row and a position: give the rotations alone"
        )
    at = np.arange(16).reshape(4, 4) if row_last else np.arange(16).reshape(4, 4).T
    rotation = {int(at[i, j]): f"r{i + 1}{j + 1}" for i in range(3) for j in range(3)}
    return rotation | {int(at[i, 3]): name for i, name in enumerate(POSITION)}


def _wrong_shape(dataset: Any, path: str, expected: str, source: str) -> FileFormatError:
    return FileFormatError(
        f"{source}: dataset {shown(path)}: found shape {dataset.shape}, expected {expected}: name another with --hdf5"
    )


def is_of_matlab(item: Any) -> bool:
    """Whether MATLAB wrote a dataset."""
    return "MATLAB_class" in getattr(item, "attrs", ())


class OfMatlab:
    """A dataset of MATLAB with its rows, the longest dimension, first; `shape` None: two are as long."""

    def __init__(self, dataset: Any) -> None:
        self._dataset = dataset
        sizes = dataset.shape[::-1]
        self._rows = sizes.index(max(sizes))
        chunks = dataset.chunks
        self.chunks = None if chunks is None else self._rows_first(chunks[::-1])
        self.shape = self._rows_first(sizes) if sizes.count(max(sizes)) == 1 else None

    def _rows_first(self, sizes: tuple[int, ...]) -> tuple[int, ...]:
        return sizes[self._rows], *sizes[: self._rows], *sizes[self._rows + 1 :]

    def __getattr__(self, name: str) -> Any:
        return getattr(self._dataset, name)

    def __len__(self) -> int:
        return int(max(self._dataset.shape))

    def __getitem__(self, rows: slice) -> NDArray[Any]:
        before = (slice(None),) * (self._dataset.ndim - 1 - self._rows)
        return np.moveaxis(np.asarray(self._dataset[(*before, rows)]).T, self._rows, 0)
