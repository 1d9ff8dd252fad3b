"""Named columns of numbers in Parquet files, one or a folder of them, a batch of rows at a time, by pyarrow.

Rows are counted from 1, over all files of a folder. A list stands for columns `name[0]`, `name[1]` and so on, a struct
for columns `name.field`. A folder may be a data set of LeRobot (episodes.py).
"""

from __future__ import annotations

import os
from collections.abc import Collection, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import chain
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from ...errors import FileFormatError, of_extra
from ...files import by_numbers, entries, open_bytes
from ...geometry.arrays import Array
from .batch import BYTES_PER_ROW, MOST_ELEMENTS, Batch, Field, Part, readable, require_room, require_room_for_pages
from .columns import Column, OpenTable, places_of, shown
from .episodes import EPISODE, LEROBOT, names_of_elements
from .units import per_si

SUFFIXES = (".parquet", ".pq")
BUFFER = 2**20
"""Bytes of a column that are read at once, so that memory does not grow with the size of the file's row groups."""
FIRST_ROWS = 64
"""Read at once to see how long lists are."""


@dataclass(frozen=True)
class _Leaf:
    """What a schema has under a path: lists of `length` numbers, 0 where only the rows tell; None: no lists."""

    path: tuple[str, ...]
    length: int | None

    @property
    def name(self) -> str:
        return ".".join(part.strip() for part in self.path)

    def fields(self, length: int | None, names: tuple[str, ...]) -> list[Field]:
        """The columns that it stands for, where its lists are that long; what the `names` of their elements are."""
        if not length or length > MOST_ELEMENTS:
            return [Field(self.name, self.path)]
        of_each = [f".{name}" for name in names] if len(names) == length else [""] * length
        return [Field(f"{self.name}[{k}]{of_each[k]}", self.path, k, length) for k in range(length)]


def is_parquet(path: str | Path) -> bool:
    """Whether a path is a Parquet file by its suffix, or a folder that has such files."""
    return bool(_parts(Path(path))) if os.path.isdir(path) else Path(path).suffix.lower() in SUFFIXES


def open_parquet(path: str | Path, rows: int, episode: int | None, *, whole: bool = False) -> OpenTable:
    """A Parquet file, or a folder of them as one table, its files in the order of their names; with all their columns
    where they are read `whole`. Row groups without the episode that is stated are left out where some have it. Raises
    `FileAccessError`, `FileFormatError` and `MissingExtraError`.
    """
    parts, fields = _described(path)
    total = sum(sum(part.rows) for part in parts)
    having = [part.with_episode(episode) for part in parts]
    if not any(part.episodes[k] for part, groups in zip(parts, having, strict=True) for k in groups):
        having = [part.with_episode(None) for part in parts]

    def bodies(columns: Collection[Column]) -> Iterator[Records]:
        names = sorted({".".join(fields[column.place].path) for column in columns})
        before = 0
        for part, groups in zip(parts, having, strict=True):
            numbers, read = before + 1 + part.numbers(groups), 0
            before += sum(part.rows)
            for record in _records(part.path, None if whole else names, rows, groups) if groups else ():
                here = numbers[read : read + len(record)]
                read += len(record)
                if 0 < len(here) == len(record):
                    yield Records(here, str(path), here[-1] / total, record, fields)
            if read != len(numbers):
                stated = f"the {len(numbers)} stated"
                raise FileFormatError(f"{part.path}: found {read} rows, expected {stated}: write it anew")

    return OpenTable(str(path), places_of((field.name for field in fields), str(path)), bodies)


@dataclass(eq=False)
class Records(Batch):
    """Rows of Parquet files in a record batch."""

    record: Any
    fields: list[Field]

    def select(self, kept: NDArray[np.bool_]) -> Self:
        """As of `Body`."""
        import pyarrow as pa

        return replace(self, rows=self.rows[kept], record=self.record.filter(pa.array(kept)))

    def floats(self, column: Column) -> Array:
        """The numbers (n,) of a column; NaN for null. Raises `FileFormatError` for what are no numbers."""
        import pyarrow as pa

        field = self.fields[column.place]
        with _readable(self.source):
            values = _at(self.record, field.path)
            if field.element is not None:
                values = self._elements(values, field)
            if pa.types.is_dictionary(values.type):
                values = values.dictionary_decode()
            if pa.types.is_boolean(values.type):
                values = values.cast(pa.uint8())
            kind = values.type
            if pa.types.is_temporal(kind) and hasattr(kind, "unit") and column.role == "t":
                per_unit = column.per_si / per_si("time", kind.unit)
                counted = values.cast(pa.int64()).cast(pa.float64(), safe=False)
                return np.asarray(counted.to_numpy(zero_copy_only=False), dtype=np.float64) * per_unit
            if not _is_number(kind):
                raise FileFormatError(
                    f"{self.source}: column {column.name}: found {shown(str(kind))}, expected numbers: write it as "
                    "double"
                )
            floats = values.cast(pa.float64(), safe=False).to_numpy(zero_copy_only=False)
            return np.asarray(floats, dtype=np.float64)

    def _elements(self, lists: Any, field: Field) -> Any:
        """One element of each list. Raises `FileFormatError` for a list of another length."""
        import pyarrow.compute as pc

        length = pc.fill_null(pc.list_value_length(lists), field.length).to_numpy(zero_copy_only=False)
        if (length != field.length).any():
            index = int(np.argmax(length != field.length))
            raise FileFormatError(
                f"{self.source}: row {self.row_of(index)}, column {'.'.join(field.path)}: found a list of "
                f"{length[index]}, expected {field.length}: complete it or leave the row out"
            )
        return pc.list_element(lists, field.element)


def _at(record: Any, path: tuple[str, ...]) -> Any:
    """The column of a record batch, or what is under that path in its structs."""
    import pyarrow.compute as pc

    values = record.column(record.schema.get_field_index(path[0]))
    return values if len(path) == 1 else pc.struct_field(values, list(path[1:]))


def _is_number(kind: Any) -> bool:
    import pyarrow as pa

    is_one = (pa.types.is_integer, pa.types.is_floating, pa.types.is_decimal, pa.types.is_null)
    return any(is_kind(kind) for is_kind in is_one)


def _described(path: str | Path) -> tuple[list[Part], list[Field]]:
    """The files, and their columns. Raises `FileFormatError` for files with different ones, or without rows."""
    files = _parts(Path(path)) if os.path.isdir(path) else [Path(path)]
    there = [file for file in (*files, Path(path) / LEROBOT) if os.path.isfile(file)]
    written, sizes = (tuple(map(of, there)) for of in (os.path.getmtime, os.path.getsize))
    return _as_written(path, tuple(files), written, sizes)


@lru_cache(maxsize=2)
def _as_written(
    path: str | Path, files: tuple[Path, ...], written: tuple[float, ...], sizes: tuple[int, ...]
) -> tuple[list[Part], list[Field]]:
    """The same, once for files that stay as they are: a set is opened anew for each of its episodes."""
    parts: list[Part] = []
    leaves: list[_Leaf] = []
    lengths: dict[tuple[str, ...], int] = {}
    for part in files:
        with _opened(part) as file, _readable(str(part)):
            _require_room(part, file.metadata)
            found = list(_leaves(file.schema_arrow))
            groups = [file.metadata.row_group(k) for k in range(file.metadata.num_row_groups)]
            ranges = _episodes(file.metadata, groups)
            parts.append(Part(part, tuple(group.num_rows for group in groups), ranges))
            if sum(parts[-1].rows) != file.metadata.num_rows:
                found_rows = f"{part}: found {sum(parts[-1].rows)} rows, expected the {file.metadata.num_rows} stated"
                raise FileFormatError(f"{found_rows}: write it anew")
            unknown = [leaf.path for leaf in found if leaf.length == 0 and leaf.path not in lengths]
            lengths |= _lengths(file, unknown) if unknown and file.metadata.num_rows else {}
        if leaves and [leaf.name for leaf in found] != [leaf.name for leaf in leaves]:
            raise FileFormatError(
                f"{part}: found other columns than in {parts[0].path.name}, expected the same: name one file"
            )
        leaves = found
    if not any(any(part.rows) for part in parts):
        raise FileFormatError(f"{path}: found columns and no rows, expected a row for each reading: add them")
    names = names_of_elements(Path(path))
    fields = [leaf.fields(lengths.get(leaf.path, leaf.length), names.get(leaf.name, ())) for leaf in leaves]
    return parts, list(chain.from_iterable(fields))


def _require_room(path: Path, metadata: Any) -> None:
    """Raise `FileFormatError` where a file states more than one of its size holds, in its foot or page by page."""
    groups = [metadata.row_group(k) for k in range(metadata.num_row_groups)]
    chunks = [group.column(k) for group in groups for k in range(metadata.num_columns)]
    require_room(path, max(metadata.num_rows, sum(group.num_rows for group in groups)), "rows", BYTES_PER_ROW)
    require_room(path, sum(max(chunk.total_uncompressed_size, 0) for chunk in chunks), "bytes")
    require_room(path, sum(max(chunk.num_values, 0) for chunk in chunks), "numbers", 8)
    starts = [(chunk.dictionary_page_offset or chunk.data_page_offset, chunk.num_values) for chunk in chunks]
    require_room_for_pages(path, starts)


def _episodes(metadata: Any, groups: list[Any]) -> tuple[tuple[float, float] | None, ...]:
    """The least and the greatest episode in each row group, as far as its statistics say."""
    place = next((k for k in range(metadata.num_columns) if metadata.schema.column(k).path.lower() == EPISODE), None)
    found = [None if place is None else group.column(place).statistics for group in groups]
    return tuple(
        (each.min, each.max) if each and each.has_min_max and isinstance(each.min, int | float) else None
        for each in found
    )


def _parts(folder: Path) -> list[Path]:
    """The Parquet files in a folder, or of a data set of LeRobot, part 2 before part 10."""
    in_set = (folder / LEROBOT).is_file()
    files = (folder / "data").glob("*/*") if in_set else entries(folder)
    parts = (path for path in files if path.suffix.lower() in SUFFIXES)
    return sorted(parts, key=lambda path: by_numbers(str(path.relative_to(folder))))


def _leaves(schema: Any, above: tuple[str, ...] = ()) -> Iterator[_Leaf]:
    """What is no struct, in the order of the schema."""
    import pyarrow as pa

    for field in schema:
        path, kind = (*above, field.name), field.type
        if pa.types.is_struct(kind):
            yield from _leaves([kind.field(k) for k in range(kind.num_fields)], path)
        elif pa.types.is_fixed_size_list(kind) and _is_number(kind.value_type):
            yield _Leaf(path, kind.list_size)
        elif (pa.types.is_list(kind) or pa.types.is_large_list(kind)) and _is_number(kind.value_type):
            yield _Leaf(path, 0)
        else:
            yield _Leaf(path, None)


def _lengths(file: Any, paths: list[tuple[str, ...]]) -> dict[tuple[str, ...], int]:
    """How many elements the first list under each path has that is in the first row group."""
    import pyarrow.compute as pc

    lengths: dict[tuple[str, ...], int] = {}
    for record in file.iter_batches(FIRST_ROWS, row_groups=[0], columns=[".".join(path) for path in paths]):
        for path in [path for path in paths if path not in lengths]:
            if len(there := pc.list_value_length(_at(record, path)).drop_null()):
                lengths[path] = there[0].as_py()
        if len(lengths) == len(paths):
            break
    return lengths


def _records(path: Path, columns: list[str] | None, rows: int, groups: list[int]) -> Iterator[Any]:
    """Record batches of some columns, or of all, of at most `rows` rows, of some row groups."""
    with _opened(path) as file, _readable(str(path)):  # one of its threads that cannot start hangs
        yield from file.iter_batches(rows, row_groups=groups, columns=columns, use_threads=False)


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """An open Parquet file, by no name that pyarrow could take for a URI. Raises as `open_parquet`."""
    pq = import_parquet()
    with open_bytes(path) as opened:
        with _readable(str(path)):
            file = pq.ParquetFile(opened, buffer_size=BUFFER, pre_buffer=False, page_checksum_verification=True)
        with file:
            yield file


def _readable(source: str) -> AbstractContextManager[None]:
    """Raise `FileFormatError` for what pyarrow cannot read."""
    import pyarrow as pa

    return readable(source, "Parquet", (pa.ArrowException, OSError))


def import_parquet() -> Any:
    """The Parquet module of pyarrow. Raises `MissingExtraError`."""
    return of_extra("pyarrow.parquet", "Parquet", "parquet")
