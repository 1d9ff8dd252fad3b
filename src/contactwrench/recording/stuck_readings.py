"""Readings that stand still though the sensor is told to move: from their first row on, as a recording shows it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..compensate.contact_wrenches import NOT_GIVEN, NOT_JUDGED, ContactWrenches
from ..compensate.faults import Reason
from ..model import AXES
from ..samples.limits import channels_at_limit
from ..samples.samples import Samples
from ..statistics import counted

SATURATED = Reason("saturated: a channel stands at its limit")
STUCK = "stuck"


class StuckReadings:
    """What a control loop learns only after a while is told here of each row, batch by batch: that a channel stands at
    its limit, which the batch before and this one show, and that a reading was stuck, back to where it began in it.
    """

    def __init__(self) -> None:
        self._before, self._at_limit = np.full((1, 6), np.nan), np.zeros(6, dtype=int)

    def marked(self, rows: ContactWrenches, samples: Samples) -> ContactWrenches:
        """The same rows, of the next samples; those that stand are not valid, and nobody can tell what touches while a
        reading is stuck.
        """
        wrench, valid, reasons, contact = samples.wrench, rows.valid.copy(), list(rows.reason), rows.contact.copy()
        saturated, moves = self._saturated(rows, samples), np.diff(wrench, axis=0, prepend=self._before[-1:]) != 0.0
        self._before = wrench if len(wrench) else self._before
        channels = {row: why.channel for row, why in enumerate(rows.reason) if why is not None and why.kind == STUCK}
        for row in np.flatnonzero(saturated & (valid | np.isin(np.arange(len(wrench)), list(channels)))).tolist():
            reasons[row], valid[row] = SATURATED, False
        of_each = zip((*range(6), -1), (*AXES, "the whole reading"), (*moves.T, moves.any(axis=1)), strict=True)
        for channel, what, moved in of_each:
            stretch = np.cumsum(moved)
            stuck = [stretch[row] for row, own in channels.items() if own == channel]
            for row in np.flatnonzero(valid & ~moved & np.isin(stretch, stuck)).tolist():
                reasons[row] = Reason(f"{STUCK}: {what} has begun to stand still", channel=channel)
                valid[row], contact[row] = False, NOT_JUDGED
        return replace(
            rows,
            valid=valid,
            reason=tuple(reasons),
            contact=contact,
            statistic=NOT_GIVEN,
            threshold=NOT_GIVEN,
            covariance_of=NOT_GIVEN,
            covariance=None,
        )

    def _saturated(self, rows: ContactWrenches, samples: Samples) -> NDArray[np.bool_]:
        """As the recording says; else, where rows were judged, as readings do that are not what a free tool gives: a
        coarse and quiet sensor at rest may stand at its least value too.
        """
        if samples.saturated is not None:
            return samples.saturated
        if rows.statistic is None:
            return np.zeros(len(rows), dtype=bool)
        limit = channels_at_limit(np.vstack([self._before, samples.wrench]))[len(self._before) :]
        limit &= ~(rows.statistic <= rows.threshold)[:, None]
        self._at_limit += limit.sum(axis=0)
        return np.asarray(limit.any(axis=1))

    def __str__(self) -> str:
        """How many rows of which channels stand at their limits; empty where none does."""
        of = [f"{axis} in {counted(int(n), 'row')}" for axis, n in zip(AXES, self._at_limit, strict=True) if n]
        return f"readings stand at the sensor's limit and show less than there was: {', '.join(of)}" if of else ""
