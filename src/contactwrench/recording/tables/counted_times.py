"""Times of a table that has none: of its rows, counted, at a rate that somebody stated."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from ...geometry.arrays import Array
from .columns import Body, Column, Naming, OpenTable, counted_times, taken_for
from .roles import time_columns


def at_rate(table: OpenTable, naming: Naming, rate: float) -> OpenTable:
    """A recording with a column of times beside its own, s, 0 in the first row. Raises `InputError` where it has times
    of its own that nobody said to leave alone.
    """
    if own := time_columns(table, replace(naming, rate=None)):
        raise InputError(
            f"{table.source}: found the times {taken_for(own)}, and --rate {rate:g}, expected one of them: leave out "
            "--rate, or the times with --time-column none"
        )
    place = max(table.places.values(), default=-1) + 1

    def bodies(columns: Collection[Column]) -> Iterator[Body]:
        begin = 0
        for body in table.bodies([column for column in columns if column.place != place]):
            yield _Counted(body, np.arange(begin, begin + len(body)) / rate, place)
            begin += len(body)

    return OpenTable(table.source, {**table.places, counted_times(rate): place}, bodies)


@dataclass(eq=False)
class _Counted:
    """Rows (a `Body`) with times `t` (n,) in a column of its own."""

    body: Body
    t: Array
    place: int

    def __post_init__(self) -> None:
        self.source, self.done = self.body.source, self.body.done

    def __len__(self) -> int:
        return len(self.t)

    def numbers(self, columns: Sequence[Column], may_lack: Collection[Column] = ()) -> Array:
        of_file = np.array([column.place != self.place for column in columns], dtype=bool)
        values = np.repeat(self.t[:, None], len(columns), axis=1)
        values[:, of_file] = self.body.numbers([column for column in columns if column.place != self.place], may_lack)
        return values

    def select(self, kept: NDArray[np.bool_]) -> _Counted:
        return _Counted(self.body.select(kept), self.t[kept], self.place)

    def row_of(self, index: int) -> int:
        return self.body.row_of(index)

    def refuse_lack(self, index: int, column: Column) -> NoReturn:
        self.body.refuse_lack(index, column)
