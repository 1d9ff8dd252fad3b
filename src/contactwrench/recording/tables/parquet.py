"""Named columns of numbers in Parquet files, one or a folder of them, a batch of rows at a time, by pyarrow.

Rows are counted from 1, over all files of a folder. Of pyarrow: https://arrow.apache.org/docs/python/parquet.html.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from ...errors import FileFormatError, MissingExtraError
from ...files import open_bytes
from ...geometry.arrays import Array
from .columns import ROWS, WRENCH_COLUMNS, Column, Naming, OpenTable, places_of, shown
from .roles import wrench_columns

SUFFIXES = (".parquet", ".pq")
LISTS = {
    "wrench": WRENCH_COLUMNS,
    "quat_xyzw": ("qx", "qy", "qz", "qw"),
    "position": ("x", "y", "z"),
}
"""Columns of lists, as recordings for robot learning have them, and the columns that they stand for."""

BUFFER = 2**20
"""Bytes of a column that are read at once, so that memory does not grow with the size of the file's row groups."""
PER_SECOND = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}


@dataclass(frozen=True)
class _Field:
    """A column by its name, the file's column that holds it, and which element of its lists it is."""

    name: str
    column: str
    element: int | None


def is_parquet(path: str | Path) -> bool:
    """Whether a path is a Parquet file by its suffix, or a folder that has such files."""
    return bool(_parts(Path(path))) if Path(path).is_dir() else Path(path).suffix.lower() in SUFFIXES


def open_parquet(path: str | Path, rows: int) -> OpenTable:
    """A Parquet file, or a folder of them as one table, its files in the order of their names, numbers in these by
    value; at most `rows` rows at a time. Raises `FileAccessError`, `FileFormatError` and `MissingExtraError`.
    """
    parts, fields, places, total = _described(path)

    def bodies(columns: Collection[Column]) -> Iterator[Batch]:
        names = sorted({fields[column.place].column for column in columns})
        before = 0
        for part in parts:
            for record in _records(part, names, rows):
                yield Batch(record, fields, str(path), before, (before + len(record)) / total)
                before += len(record)

    return OpenTable(str(path), places, bodies)


def rows_as_stored(path: str | Path, naming: Naming) -> Iterator[tuple[Any, NDArray[np.bool_]]]:
    """All columns as the files have them, a record batch at a time, and which of its rows (n,) have a wrench."""
    parts, fields, places, _ = _described(path)
    fx = wrench_columns(OpenTable(str(path), places, lambda _: iter(())), naming)[0]
    for part in parts:
        for record in _records(part, None, ROWS):
            yield record, ~np.isnan(Batch(record, fields, str(path), 0, 1.0).numbers([fx], may_lack=[fx])[:, 0])


class Batch:
    """Rows of Parquet files in a record batch, `before` which there were so many. A `Body`."""

    def __init__(self, record: Any, fields: list[_Field], source: str, before: int, done: float) -> None:
        self._record, self._fields, self._before = record, fields, before
        self.source, self.done = source, done

    def __len__(self) -> int:
        return len(self._record)

    def row_of(self, index: int) -> int:
        """The number of the index-th row, over all files, from 1."""
        return self._before + index + 1

    def refuse_lack(self, index: int, column: Column) -> NoReturn:
        """Raise the `FileFormatError` for a null or a NaN."""
        raise FileFormatError(
            f"{self.source}: row {self.row_of(index)}, column {column.name}: found no number, expected one: fill it in "
            "or leave the row out"
        )

    def numbers(self, columns: Sequence[Column], may_lack: Collection[Column] = ()) -> Array:
        """The numbers (n, k) of the columns, as written; NaN where a column in `may_lack` has a null or a NaN.

        Raises `FileFormatError` naming row and column of what is no finite number.
        """
        values = np.empty((len(self), len(columns)))
        for k, column in enumerate(columns):
            values[:, k] = self._floats(column)
        fine = np.isfinite(values)
        for index, k in np.argwhere(~fine) if not fine.all() else ():
            column, value = columns[k], values[index, k]
            if np.isinf(value):
                raise FileFormatError(
                    f"{self.source}: row {self.row_of(int(index))}, column {column.name}: found {value}, expected a "
                    "finite number: leave the row out"
                )
            if column not in may_lack:
                self.refuse_lack(int(index), column)
        return values

    def _floats(self, column: Column) -> Array:
        """The numbers (n,) of a column; NaN for null."""
        import pyarrow as pa

        field = self._fields[column.place]
        values = self._record.column(self._record.schema.get_field_index(field.column))
        with _readable(self.source):
            if field.element is not None:
                values = self._elements(values, field)
            if pa.types.is_dictionary(values.type):
                values = values.dictionary_decode()
            kind = values.type
            if pa.types.is_boolean(kind):
                values = values.cast(pa.uint8())
                kind = values.type
            if pa.types.is_temporal(kind) and hasattr(kind, "unit") and column.role == "t":
                per_unit = column.per_si / PER_SECOND[kind.unit]
                counted = values.cast(pa.int64()).cast(pa.float64(), safe=False)
                return np.asarray(counted.to_numpy(zero_copy_only=False), dtype=np.float64) * per_unit
            if not _is_number(kind):
                raise FileFormatError(
                    f"{self.source}: column {column.name}: found {shown(str(kind))}, expected numbers: write it as "
                    "double"
                )
            floats = values.cast(pa.float64(), safe=False).to_numpy(zero_copy_only=False)
            return np.asarray(floats, dtype=np.float64)

    def _elements(self, lists: Any, field: _Field) -> Any:
        """One element of each list. Raises `FileFormatError` for a list of another length."""
        import pyarrow.compute as pc

        expected = len(LISTS[field.column.lower()])
        length = pc.fill_null(pc.list_value_length(lists), expected).to_numpy(zero_copy_only=False)
        if (length != expected).any():
            index = int(np.argmax(length != expected))
            raise FileFormatError(
                f"{self.source}: row {self.row_of(index)}, column {field.column}: found a list of "
                f"{length[index]}, expected {expected}: complete it or leave the row out"
            )
        return pc.list_element(lists, field.element)


def _is_number(kind: Any) -> bool:
    import pyarrow as pa

    is_one = (pa.types.is_integer, pa.types.is_floating, pa.types.is_decimal, pa.types.is_null)
    return any(is_kind(kind) for is_kind in is_one)


def _described(path: str | Path) -> tuple[list[Path], list[_Field], dict[str, int], int]:
    """The files, their columns, the place of each by its name, and the number of rows in all."""
    parts = _parts(Path(path)) if Path(path).is_dir() else [Path(path)]
    fields: list[_Field] = []
    total = 0
    for part in parts:
        with _opened(part) as file:
            schema, rows = file.schema_arrow, file.metadata.num_rows
        found = _fields(schema)
        if fields and found != fields:
            raise FileFormatError(
                f"{part}: found other columns than in {parts[0].name}, expected the same: name one file"
            )
        fields, total = found, total + rows
    places = places_of((field.name for field in fields), str(path))
    if not total:
        raise FileFormatError(f"{path}: found columns and no rows, expected a row for each reading: add them")
    return parts, fields, places, total


def _parts(folder: Path) -> list[Path]:
    """The Parquet files in a folder, part 2 before part 10."""

    def by_numbers(path: Path) -> list[tuple[int, str]]:
        return [(int(word), "") if word.isdecimal() else (-1, word) for word in re.split(r"(\d+)", path.name)]

    return sorted((path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES), key=by_numbers)


def _fields(schema: Any) -> list[_Field]:
    import pyarrow as pa

    is_list = (pa.types.is_list, pa.types.is_large_list, pa.types.is_fixed_size_list)
    fields = []
    for field in schema:
        name = field.name.strip()
        if name.lower() in LISTS and any(is_kind(field.type) for is_kind in is_list):
            fields += [_Field(part, field.name, k) for k, part in enumerate(LISTS[name.lower()])]
        else:
            fields.append(_Field(name, field.name, None))
    return fields


def _records(path: Path, columns: list[str] | None, rows: int) -> Iterator[Any]:
    """Record batches of some columns, or of all, of at most `rows` rows."""
    with _opened(path) as file, _readable(str(path)):
        yield from file.iter_batches(batch_size=rows, columns=columns)


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """An open Parquet file. Raises `FileAccessError`, `FileFormatError` and `MissingExtraError`."""
    pq = import_parquet()
    with open_bytes(path):
        pass
    with _readable(str(path)):
        file = pq.ParquetFile(path, buffer_size=BUFFER, pre_buffer=False)
    with file:
        yield file


@contextmanager
def _readable(source: str) -> Iterator[None]:
    """Raise `FileFormatError` for what pyarrow cannot read."""
    import pyarrow as pa

    try:
        yield
    except (pa.ArrowException, OSError) as error:
        reason = shown(str(error).partition("\n")[0].partition(". ")[0], 100)
        raise FileFormatError(
            f"{source}: cannot be read as Parquet ({reason}), expected a whole Parquet file: write it anew"
        ) from None


def import_parquet() -> Any:
    """The Parquet module of pyarrow, or the error that says how to install it."""
    try:
        import pyarrow.parquet as pq
    except ImportError:
        raise MissingExtraError(
            "Parquet needs pyarrow, which is not installed: pip install 'contactwrench[parquet]'"
        ) from None
    return pq
