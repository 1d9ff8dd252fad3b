"""One recording of a table: of a set, as robot learning has them, an episode; and times for rows that have none.

A data set of LeRobot, version 2 or 3, is a folder: `meta/info.json`, and an episode a file or many of them in
`data/chunk-*/*.parquet` (huggingface/lerobot, docs/source/lerobot-dataset-v3.mdx; the paths of version 2 are in
src/lerobot/datasets/v30/convert_dataset_v21_to_v30.py).
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Any, NoReturn, Self

import numpy as np
from numpy.typing import NDArray

from ...errors import FileFormatError, InputError
from ...files import read_bytes
from ...geometry.arrays import Array
from ...geometry.ranges import EPISODE as EPISODES
from .batch import readable
from .columns import Body, Column, Naming, OpenTable, counted_times, listed, taken_for
from .roles import time_columns

EPISODE = "episode_index"
LEROBOT = Path("meta") / "info.json"
"""What a folder has that is such a set."""


def episode_column(table: OpenTable) -> Column | None:
    """The column that says of which episode a row is; None where there is none."""
    return next((Column(place, name, 1.0) for name, place in table.places.items() if name.lower() == EPISODE), None)


def episodes_of(body: Body, column: Column) -> Array:
    """The episode (n,) of each row. Raises `FileFormatError` naming the row of what is no whole number from 0 on."""
    values: Array = body.numbers([column])[:, 0]
    whole = EPISODES.holds(values) & (values == np.rint(values))
    if not whole.all():
        index = int(np.argmin(whole))
        raise FileFormatError(
            f"{body.source}: row {body.row_of(index)}, column {column.name}: found {values[index]:g}, expected the "
            f"number of an episode, {EPISODES}: correct it or leave the row out"
        )
    return values


def one_episode(table: OpenTable, episode: int | None) -> OpenTable:
    """The rows of one recording, of a set those of an `episode`, or of the only one: each has its own time, bias and
    contacts. Raises `FileFormatError` for one that is not there; when read, also for several and none stated.
    """
    column = episode_column(table)
    if column is None:
        if episode is not None:
            raise FileFormatError(
                f"{table.source}: found no column {EPISODE}, expected one of which --episode {episode} is: leave it out"
            )
        return table

    def bodies(columns: Collection[Column]) -> Iterator[Body]:
        blocks, seen, yielded = table.bodies([*columns, column]), set[float](), False
        for body in blocks:
            numbers = episodes_of(body, column)
            seen |= set(np.unique(numbers).tolist())
            if episode is None and len(seen) > 1:
                raise _one_expected(table.source, seen, blocks, column)
            kept = numbers == (episode if episode is not None else numbers)
            if kept.any():
                yielded = True
                yield body if kept.all() else body.select(kept)
        if not yielded:
            raise FileFormatError(
                f"{table.source}: found no episode {episode}, expected one that is there, as {_named(seen)}: choose "
                "with --episode"
            )

    return OpenTable(table.source, table.places, bodies)


def episodes_in(table: OpenTable) -> list[int]:
    """The episodes of a set, in the order of their rows. Raises `FileFormatError` where rows of one are apart."""
    column = episode_column(table)
    if column is None:
        raise FileFormatError(
            f"{table.source}: found no column {EPISODE}, expected a set of recordings: leave out --all-episodes"
        )
    found: dict[int, None] = {}
    last = -1
    for body in table.bodies([column]):
        numbers = episodes_of(body, column).astype(int)
        begins, last = np.flatnonzero(np.diff(numbers, prepend=last)), int(numbers[-1])
        for index, episode in zip(begins.tolist(), numbers[begins].tolist(), strict=True):
            if episode in found:
                raise FileFormatError(
                    f"{body.source}: row {body.row_of(index)}: found episode {episode} again, expected its rows "
                    f"together: sort the table by {EPISODE}"
                )
            found[episode] = None
    return list(found)


def _one_expected(source: str, seen: set[float], others: Iterable[Body], column: Column) -> FileFormatError:
    every = seen.union(*(episodes_of(body, column).tolist() for body in others))
    return FileFormatError(
        f"{source}: found {len(every)} episodes, {_named(every)}, expected one recording: choose it, as with "
        f"--episode {min(every):g}; compensate --all-episodes takes each by itself"
    )


def _named(episodes: set[float]) -> str:
    return listed(f"{episode:g}" for episode in sorted(episodes))


def names_of_elements(folder: Path) -> dict[str, tuple[str, ...]]:
    """What LeRobot calls the elements of each list in a set, by the list's name; of another folder nothing."""
    if not (folder / LEROBOT).is_file():
        return {}
    import msgspec

    with readable(str(folder / LEROBOT), "JSON", (msgspec.DecodeError,)):
        features = msgspec.json.decode(read_bytes(folder / LEROBOT), type=dict[str, Any]).get("features")
    described = features.items() if isinstance(features, dict) else ()
    found = {feature: _in_order(is_so.get("names")) for feature, is_so in described if isinstance(is_so, dict)}
    return {feature: names for feature, names in found.items() if all(isinstance(name, str) for name in names)}


def _in_order(names: Any) -> tuple[Any, ...]:
    """Names that are written as a list, as lists of several parts, or each with its place."""
    if isinstance(names, dict) and all(isinstance(place, int) for place in names.values()):
        return tuple(sorted(names, key=names.__getitem__))
    if isinstance(names, dict) and all(isinstance(part, list) for part in names.values()):
        return tuple(chain.from_iterable(names.values()))
    return tuple(names) if isinstance(names, list) else ()


def at_rate(table: OpenTable, naming: Naming, rate: float) -> OpenTable:
    """A recording with a column of times, s, 0 in the first row. Raises `InputError` where it has times of its own."""
    if own := time_columns(table, replace(naming, rate=None)):
        raise InputError(
            f"{table.source}: found the times {taken_for(own)}, and --rate {rate:g}, expected one of them: leave out "
            "--rate, or the times with --time-column none"
        )
    place = max(table.places.values(), default=-1) + 1

    def bodies(columns: Collection[Column]) -> Iterator[Body]:
        begin = 0
        for body in table.bodies([column for column in columns if column.place != place]):
            t = np.arange(begin, begin + len(body)) / rate
            yield _Counted(body.rows, body.source, body.done, body, t, place)
            begin += len(body)

    return OpenTable(table.source, {**table.places, counted_times(rate): place}, bodies)


@dataclass(eq=False)
class _Counted(Body):
    """Rows with times `t` (n,) in a column of its own."""

    body: Body
    t: Array
    place: int

    def numbers(self, columns: Sequence[Column], may_lack: Collection[Column] = ()) -> Array:
        of_file = np.array([column.place != self.place for column in columns], dtype=bool)
        values = np.repeat(self.t[:, None], len(columns), axis=1)
        values[:, of_file] = self.body.numbers([column for column in columns if column.place != self.place], may_lack)
        return values

    def select(self, kept: NDArray[np.bool_]) -> Self:
        return replace(self, rows=self.rows[kept], body=self.body.select(kept), t=self.t[kept])

    def refuse_lack(self, index: int, column: Column) -> NoReturn:
        self.body.refuse_lack(index, column)
