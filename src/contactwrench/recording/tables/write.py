"""Contact wrenches as files, batch by batch: CSV, or Parquet beside the columns of the recording.

Columns: `episode_index` of a set, `t` where there are times, fx..tz the contact wrench, fx_std..tz_std; where they were
judged also `valid` (1 or 0), `contact` (1, 0, or nothing where nobody can tell) and `reason`, where `valid` is 0.
"""

from __future__ import annotations

import io
from collections.abc import Iterable, Iterator
from itertools import chain
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from ...compensate.contact_wrenches import TOUCHING, ContactWrenches
from ...errors import InputError
from ...files import write_bytes, write_text
from .columns import AS_NAMED, ROWS, WRENCH_COLUMNS, Naming
from .episodes import EPISODE, one_episode
from .parquet import SUFFIXES, Records, import_parquet, is_parquet, open_parquet
from .roles import wrench_columns

NAMES = (*WRENCH_COLUMNS, *(f"{name}_std" for name in WRENCH_COLUMNS))
JUDGEMENT = ("valid", "contact", "reason")
CONTACT = ("0", "1", "")
"""How contact is written: none, some, or, at place -1, that nobody can tell."""
PREFIX = "contact_"
"""Of the new columns' names in a Parquet file, where the recording's columns have one of their names."""

LINES = 2000
"""Formatted at once: their text stays in the cache."""


def write_contact_wrenches(
    path: str | Path,
    batches: Iterable[ContactWrenches],
    recording: str | Path | None = None,
    naming: Naming = AS_NAMED,
    *,
    every_row: bool = False,
) -> None:
    """Write one row per sample, in order: CSV, on stdout as `-`, or Parquet, by the suffix. Memory for one batch.

    Where the `recording` that was compensated is Parquet too, its columns are kept, and the new ones, named contact_fx
    and so on where it has one of their names, stand beside them: null in rows without a wrench, unless `every_row` was
    compensated. Batches with their `episode` are of every recording of a set. Raises `FileAccessError` where the file
    cannot be written, and `InputError` where the recording has other rows.
    """
    if Path(path).suffix.lower() not in SUFFIXES:
        write_text(path, _csv(batches))
    elif recording is not None and is_parquet(recording):
        write_bytes(Path(path), _parquet(_beside(recording, naming, batches, every_row)))
    else:
        write_bytes(Path(path), _parquet(map(columns_of, batches)))


def _csv(batches: Iterable[ContactWrenches]) -> Iterator[str]:
    for k, batch in enumerate(batches):
        if k == 0:
            before = [*([EPISODE] if batch.episode is not None else []), *(["t"] if batch.t is not None else [])]
            yield ",".join([*before, *NAMES, *(JUDGEMENT if batch.judged else [])]) + "\n"
        yield from csv_lines(batch)


def csv_lines(batch: ContactWrenches) -> Iterator[str]:
    """The rows of a batch, many at a time, by one `%` for many lines: Python writes numbers faster than numpy."""
    known = [(form, column) for form, column in (("%d", batch.episode), ("%r", batch.t)) if column is not None]
    columns = [*(column for _, column in known), *batch.wrench.T, *batch.std.T]
    judgement = ["%d,%s,%s"] if batch.judged else []
    line = ",".join([*(form for form, _ in known), *(["%.9g"] * len(NAMES)), *judgement]) + "\n"
    for start in range(0, len(batch), LINES):
        some = slice(start, start + LINES)
        cells = [column[some].tolist() for column in columns]
        if batch.judged:
            contact = [CONTACT[touches] for touches in batch.contact[some].tolist()]
            cells += [batch.valid[some].tolist(), contact, [quoted(reason) for reason in batch.reason[some]]]
        yield line * len(cells[0]) % tuple(chain.from_iterable(zip(*cells, strict=True)))


def quoted(reason: str | None) -> str:
    """A text as a cell of CSV; nothing for None."""
    if reason is None:
        return ""
    return '"' + reason.replace('"', '""') + '"' if any(letter in reason for letter in ',"\n') else reason


def columns_of(batch: ContactWrenches) -> dict[str, Any]:
    """The columns by their names, as pyarrow takes them."""
    values = np.hstack([batch.wrench, batch.std])
    columns: dict[str, Any] = {} if batch.episode is None else {EPISODE: batch.episode}
    columns |= {} if batch.t is None else {"t": batch.t}
    columns |= {name: values[:, k] for k, name in enumerate(NAMES)}
    if batch.judged:
        import pyarrow as pa

        columns["valid"] = batch.valid
        columns["contact"] = pa.array(batch.contact == TOUCHING, mask=batch.contact < 0)
        columns["reason"] = pa.array(batch.reason, pa.string())
    return columns


def _beside(
    recording: str | Path, naming: Naming, batches: Iterable[ContactWrenches], every_row: bool
) -> Iterator[dict[str, Any]]:
    """The recording's columns and, in the rows that have a wrench, or in all, the new ones."""
    import pyarrow as pa

    tables: Iterator[Any] = (pa.table(columns_of(batch)) for batch in batches)
    waiting = next(tables, pa.table({}))
    whole_set = EPISODE in waiting.column_names
    for record, has_wrench in _rows_as_stored(recording, naming, every_row, whole_set):
        wanted = int(has_wrench.sum())
        while len(waiting) < wanted:
            if (more := next(tables, None)) is None:
                raise InputError(f"{recording}: found more rows than were compensated: write to another format")
            waiting = pa.concat_tables([waiting, more])
        new, waiting = waiting.slice(0, wanted), waiting.slice(wanted)
        if not has_wrench.all():
            at = np.cumsum(has_wrench) - 1
            new = new.take(pa.array(at, mask=~has_wrench))
        kept = {name: record.column(k) for k, name in enumerate(record.schema.names)}
        names = [name for name in new.column_names if name not in ("t", EPISODE)]
        prefix = PREFIX if any(name in kept for name in names) else ""
        yield kept | {prefix + name: new.column(name) for name in names}
    if len(waiting) or any(map(len, tables)):
        raise InputError(f"{recording}: found fewer rows than were compensated: write to another format")


def _rows_as_stored(
    path: str | Path, naming: Naming, every: bool, whole_set: bool
) -> Iterator[tuple[Any, NDArray[np.bool_]]]:
    """All columns as the files have them, of one recording or the `whole_set`, a record batch at a time, and which of
    its rows (n,) have any of a wrench, or that `every` one counts.
    """
    table = open_parquet(path, ROWS, None if whole_set else naming.episode, whole=True)
    table = table if whole_set else one_episode(table, naming.episode)
    wrench = wrench_columns(table, naming)
    for body in table.bodies(wrench):
        records = cast(Records, body)
        lacking = np.isnan([records.floats(column) for column in wrench]).all(axis=0)
        yield records.record, np.asarray(~lacking | every)


def _parquet(batches: Iterable[dict[str, Any]]) -> Iterator[bytes]:
    """The bytes of a Parquet file with a row group for each batch, as they come."""
    pq = import_parquet()
    import pyarrow as pa

    sink, writer = io.BytesIO(), None
    for columns in batches:
        table = pa.table(columns)
        if writer is None:
            # A dictionary of measured numbers, which do not repeat, makes the file larger and eight times as slow.
            repeating = [each.name for each in table.schema if not pa.types.is_floating(each.type)]
            writer = pq.ParquetWriter(sink, table.schema, use_dictionary=repeating)
        writer.write_table(table)
        yield _taken(sink)
    if writer is not None:
        writer.close()
        yield _taken(sink)


def _taken(sink: io.BytesIO) -> bytes:
    """What was written to it since the last time."""
    piece = sink.getvalue()
    sink.seek(0)
    sink.truncate()
    return piece
