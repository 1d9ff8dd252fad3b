"""A recording as if it were live: `--from FILE [--speed X]`."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterator
from itertools import chain
from math import inf, isfinite, isnan
from pathlib import Path
from threading import Event
from time import monotonic
from typing import NamedTuple

import numpy as np

from ..errors import InputError
from ..files import name_of
from ..geometry.orientation import to_quat_xyzw
from ..recording.options import AS_USUAL, Options
from ..recording.read import batches
from ..samples.samples import OrientationStream, Streams, WrenchStream
from .source import About, Batch, EndOfStreamError, Note, NoteKind, Sample, now

ROWS = 2_000
"""Read at once: a table's block takes some 10 ms, which no watch on silence notices."""
NAN = "not recorded"
"""The flaw of a reading that is a NaN."""


class _Block(NamedTuple):
    """Samples by the recording's clock, and when each is due, s, never falling."""

    due: list[float]
    samples: list[Sample]
    damage: str


class Replay:
    """A recording as one source of wrench and orientation, in the order of their times: readings and poses are samples
    of their own, a pose before the reading of the same time.

    `Sample.arrival` is the recording's own time, shifted so that the first is now, at any speed; `device` is the time
    as recorded. With `speed` 0 a read never waits and gives `ROWS` samples at the most: whoever reads it takes the next
    when those are done with, and lets sinks be patient (sink.py), so that nothing is lost. Raises `InputError`: the
    speed is none.
    """

    def __init__(self, path: str | Path, options: Options = AS_USUAL, speed: float = 1.0) -> None:
        if not (isfinite(speed) and speed >= 0.0):
            raise InputError(f"speed is {speed:g}, expected times real time, or 0 for as fast as it goes")
        self.uri, self._path, self._options, self._speed = name_of(path), path, options, speed
        self._closed = Event()
        self._damage = ""

    def open(self) -> About:
        """Read the first block. Raises as `read_streams`."""
        blocks = batches(self._path, self._options, ROWS)
        first = next(blocks)
        self._first = float(np.r_[first.wrench.t, first.orientation.t].min())
        shift = now() - self._first
        self._blocks = (_merged(block, shift) for block in chain([first], blocks))
        self._block, self._next = next(self._blocks), 0
        self._begun = monotonic()
        gaps = np.diff(first.wrench.t)
        gap = float(np.median(gaps)) if len(gaps) else 0.0
        rate = 1.0 / gap if gap > 0.0 else None
        return About(f"recording {Path(self.uri).name}", True, True, rate, replay=True)

    def read(self, timeout: float) -> Batch:
        """The samples that are due. Raises `EndOfStreamError` behind the last one, and as `read_streams`."""
        if self._next == len(self._block.due):
            if (block := next(self._blocks, None)) is None:
                raise EndOfStreamError(f"{self.uri}: the recording has ended")
            self._block, self._next = block, 0
        due, begin = self._block.due, self._next
        if begin < len(due):
            if (ahead := due[begin] - self._recorded_now()) > 0.0:
                self._closed.wait(min(ahead / self._speed, timeout))
            self._next = min(bisect_right(due, self._recorded_now(), lo=begin), begin + ROWS)
        before, self._damage = self._damage, self._block.damage
        notes = [Note(NoteKind.STATUS, self._damage)] if self._damage != before else []
        return Batch(self._block.samples[begin : self._next], notes)

    def close(self) -> None:
        """End a read that waits."""
        self._closed.set()

    def _recorded_now(self) -> float:
        return inf if self._speed == 0.0 else self._first + self._speed * (monotonic() - self._begun)


def _merged(block: Streams, shift: float) -> _Block:
    """Both streams in the order of their times, each in its own."""
    samples = [*_poses(block.orientation, shift), *_readings(block.wrench, shift)]
    due = np.r_[np.maximum.accumulate(block.orientation.t), np.maximum.accumulate(block.wrench.t)]
    order = np.argsort(due, kind="stable")
    return _Block(due[order].tolist(), [samples[k] for k in order.tolist()], block.damage)


def _poses(pose: OrientationStream, shift: float) -> Iterator[Sample]:
    quaternions = to_quat_xyzw(pose.R_base_flange).tolist()
    position = np.full((len(pose), 3), np.nan) if pose.position is None else pose.position
    for t, turn, (x, y, z) in zip(pose.t.tolist(), quaternions, position.tolist(), strict=True):
        yield Sample(t + shift, t, orientation=tuple(turn), position=None if isnan(x + y + z) else (x, y, z))


def _readings(wrench: WrenchStream, shift: float) -> Iterator[Sample]:
    saturated = np.zeros(len(wrench), np.bool_) if wrench.saturated is None else wrench.saturated
    for t, values, limit in zip(wrench.t.tolist(), wrench.wrench.tolist(), saturated.tolist(), strict=True):
        yield Sample(t + shift, t, tuple(values), flaw=NAN if isnan(sum(values)) else "saturated" * limit)
