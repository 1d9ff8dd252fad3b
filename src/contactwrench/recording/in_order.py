"""Contact wrenches in the order of their recording, where readings are paired with orientations in another one."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..compensate.contact_wrenches import ContactWrenches
from ..compensate.faults import Reason
from ..geometry.arrays import Array
from ..samples.samples import Streams
from ..samples.synchronize import Synchronized

NOTHING = ContactWrenches(np.empty((0, 6)), np.empty((0, 6)), np.empty(0), True)


class InOrder:
    """Puts rows, as they are paired, back into the order of the recording; between two calls it holds what waits."""

    def __init__(self) -> None:
        self._begin = 0
        self._t: list[Array] = [np.empty(0)]
        self._ahead: tuple[NDArray[np.intp], ContactWrenches] = (np.empty(0, dtype=np.intp), NOTHING)

    def listening(self, recording: Iterable[Streams]) -> Iterator[Streams]:
        """The same batches; the stamps of their readings are kept."""
        for streams in recording:
            self._t.append(streams.wrench.t)
            yield streams

    def whole(self, paired: ContactWrenches, part: Synchronized) -> ContactWrenches:
        """All rows from where the last call ended up to the first that is not yet known."""
        t = np.concatenate(self._t)
        missing = [without_wrench(left.reason, t[left.rows - self._begin]) for left in part.left_out]
        rows = np.concatenate([self._ahead[0], part.rows, *(left.rows for left in part.left_out)])
        known = ContactWrenches.concatenate([self._ahead[1], paired, *missing])
        order = np.argsort(rows, kind="stable")
        rows, known = rows[order], known.select(order)
        count = int(np.argmin(np.r_[rows == self._begin + np.arange(len(rows)), False]))
        self._ahead = rows[count:], replace(known.select(slice(count, None)), contacts=())
        done = replace(known.select(slice(count)), t=t[:count])
        self._begin, self._t = self._begin + count, [t[count:]]
        return done


def without_wrench(reason: str, t: Array) -> ContactWrenches:
    """Rows at `t` (n,) that have no contact wrench, and why."""
    n, nan = len(t), np.full((len(t), 6), np.nan)
    return ContactWrenches(nan, nan, t, True, np.zeros(n, dtype=bool), (Reason(f"left out: {reason}", reason),) * n)
