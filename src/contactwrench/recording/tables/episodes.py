"""Sets of recordings in one table, as robot learning has them: a column says which episode a row is of."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator

import numpy as np

from ...errors import FileFormatError
from .columns import Body, Column, OpenTable, listed

EPISODE = "episode_index"


def episode_column(table: OpenTable) -> Column | None:
    """The column that says of which episode a row is; None where there is none."""
    return next((Column(place, name, 1.0) for name, place in table.places.items() if name.lower() == EPISODE), None)


def one_episode(table: OpenTable, episode: int | None) -> OpenTable:
    """The rows of one recording: each episode has its own time, bias and contacts.

    Args:
        table: one recording, or a set of them.
        episode: which one of a set; None: the only one.

    Raises:
        FileFormatError: for an episode that is stated and not there; when read, also for several and none stated.
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
            numbers = body.numbers([column])[:, 0]
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


def _one_expected(source: str, seen: set[float], others: Iterable[Body], column: Column) -> FileFormatError:
    every = seen.union(*(body.numbers([column])[:, 0].tolist() for body in others))
    return FileFormatError(
        f"{source}: found {len(every)} episodes, {_named(every)}, expected one recording: choose it, as with "
        f"--episode {min(every):g}"
    )


def _named(episodes: set[float]) -> str:
    return listed(f"{episode:g}" for episode in sorted(episodes))
