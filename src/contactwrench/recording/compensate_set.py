"""Every recording of a set to contact wrenches, each by itself: its own time, bias and contacts."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..calibration.calibration import Calibration
from ..compensate.contact_wrenches import ContactWrenches
from ..errors import ContactWrenchError
from ..statistics import counted
from .compensate import Treatment, compensated, without_wrench
from .options import ACCEPT_FLAG, Options
from .read import begins_with_pairs
from .tables.columns import Advance, Tell, unheard
from .tables.roles import wrench_columns
from .tables.table import open_table

MOST_NOTES = 20
"""Of all recordings of a set together."""


def compensated_set(
    path: str | Path,
    options: Options,
    calibration: Calibration,
    treatment: Treatment,
    episodes: Sequence[int],
    advance: Advance = unheard,
    note: Tell = unheard,
    *,
    accept_damaged: bool = False,
) -> Iterator[ContactWrenches]:
    """As `compensated`, of each of the `episodes` of a set by itself. One that cannot be compensated ends it, or, with
    `accept_damaged`, has rows without a contact wrench that say why; where none can, that is raised.
    """
    said: dict[str, list[int]] = {}
    lost: list[ContactWrenches] = []
    have_times: bool | None = None
    for k, episode in enumerate(episodes, 1):
        notes, done, of_it = list[str](), 0, replace(options, episode=episode)
        try:
            for batch in compensated(path, of_it, calibration, treatment, note=notes.append):
                have_times = batch.t is not None
                yield from (each if have_times else replace(each, t=None) for each in lost)
                lost, done = [], done + len(batch)
                yield _of_episode(episode, batch)
        except ContactWrenchError as error:
            if not accept_damaged:
                raise type(error)(f"episode {episode}: {error}; {ACCEPT_FLAG} takes the others") from None
            if have_times is None and k == len(episodes):
                raise type(error)(f"none of {counted(k, 'episode')} can be compensated: {error}") from None
            notes.append(f"left out: {error}")
            lacking = _rows_of(path, of_it, begins_with_pairs(path, options)) - done
            lost.append(_of_episode(episode, without_wrench(str(error), np.full(lacking, np.nan))))
        for text in notes:
            said.setdefault(text, []).append(episode)
        advance(k / len(episodes))
    yield from (each if have_times else replace(each, t=None) for each in lost)
    for text, those in list(said.items())[:MOST_NOTES]:
        more = f" and {counted(len(those) - 1, 'other')}" if len(those) > 1 else ""
        note(f"{text} (episode {those[0]}{more})")
    if len(said) > MOST_NOTES:
        note(f"and {counted(len(said) - MOST_NOTES, 'note')} more: --episode N gives those of one")


def one_of_set(path: str | Path, options: Options, episodes: Sequence[int]) -> Options:
    """The options for one recording of a set by which all are judged: the first that can be read."""
    each = [replace(options, episode=episode, accept_damaged=False) for episode in episodes]
    for one in each:
        with suppress(ContactWrenchError):
            begins_with_pairs(path, one)
            return one
    return each[0]


def _rows_of(path: str | Path, options: Options, every: bool) -> int:
    """How many rows one that can be compensated would have: `every` one, or those with a reading."""
    table, count = open_table(path, options), 0
    wrench = [] if every else wrench_columns(table, options)
    for body in table.bodies(wrench):
        count += len(body)
        with suppress(ContactWrenchError):  # what is no number is there
            count -= int(np.isnan(body.numbers(wrench, wrench)).all(axis=1).sum()) if wrench else 0
    return count


def _of_episode(episode: int, batch: ContactWrenches) -> ContactWrenches:
    return replace(batch, episode=np.full(len(batch), episode), judged=True)
