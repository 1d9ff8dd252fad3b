"""A sensor or a robot as a stream of batches, for a program of one's own."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Self

import numpy as np

from ..geometry.arrays import Array, Frozen
from .source import HALF_OPEN, NO_WRENCH, UNKNOWN, About, Batch, DeviceError, EndOfStreamError, Note, Source, now
from .uri import source_of

WAIT = 0.02
"""s that a read waits before it looks again whether the stream was closed."""


def batches(source: Source, about: About, ended: Callable[[], bool], silent: str) -> Iterator[Batch]:
    """What comes from an open source, an empty batch where that is nothing for `WAIT` s, until it has `ended`. Raises
    `EndOfStreamError`, and `DeviceError` where it is cut, or a device that is connected to is `silent` for so many s.
    """
    last = now()
    while not ended():
        batch = source.read(WAIT)
        came = bool(batch.samples or batch.notes)
        if not came and now() - last > HALF_OPEN and not (about.replay or about.listens or ended()):
            raise DeviceError(f"{source.uri}: {silent.format(HALF_OPEN)}")
        yield batch
        last = now() if came else last  # whatever was done meanwhile is no silence of the device's


@dataclass(frozen=True, eq=False)
class StreamBatch(Frozen):
    """Samples that came together.

    Attributes:
        t: (n,) s since 1970, when each came.
        device: (n,) s by the device's own clock; NaN where it has none.
        wrench: (n, 6) N and N m; NaN where a sample has none, or is not to be used.
        orientation: (n, 4) quaternions x, y, z, w of the flange in base axes; NaN likewise.
        flaw: (n) why a sample is not to be used, or an empty text.
        notes: what was lost, repeated or garbled.
    """

    t: Array
    device: Array
    wrench: Array
    orientation: Array
    flaw: tuple[str, ...]
    notes: tuple[Note, ...] = field(default=())

    def __len__(self) -> int:
        return len(self.t)


class Stream:
    """An open source. Iterating gives batches with at least one sample or note, as they come, until it is closed or
    ends. It raises `DeviceError` where the connection is cut, or a device that is connected to has been silent for a
    second: close it, and open the device again. A port that others send to has no such silence.
    """

    def __init__(self, source: Source) -> None:
        self._source = source
        self._closed = False
        try:
            self.about: About = source.open()
        except BaseException:
            source.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __iter__(self) -> Iterator[StreamBatch]:
        said = "found nothing for {:g} s, expected samples: check its power and cable, and open it again"
        with suppress(EndOfStreamError):
            came = batches(self._source, self.about, lambda: self._closed, said)
            yield from (batch_of(batch) for batch in came if batch.samples or batch.notes)

    def close(self) -> None:
        """End the stream; also from another thread."""
        self._closed = True
        self._source.close()


def batch_of(batch: Batch) -> StreamBatch:
    """Samples as arrays."""
    samples = batch.samples
    wrench = [NO_WRENCH if each.wrench is None or each.flaw else each.wrench for each in samples]
    turn = [UNKNOWN if each.orientation is None or each.flaw else each.orientation for each in samples]
    return StreamBatch(
        np.array([each.arrival for each in samples], dtype=np.float64),
        np.array([each.device for each in samples], dtype=np.float64),
        np.array(wrench, dtype=np.float64).reshape(-1, 6),
        np.array(turn, dtype=np.float64).reshape(-1, 4),
        tuple(each.flaw for each in samples),
        tuple(batch.notes),
    )


def open_stream(uri: str) -> Stream:
    """Connect to a sensor or a robot.

    Args:
        uri: as `sri://192.168.0.108` or `ur://10.0.0.5`; `contactwrench devices` lists all.

    Returns:
        The stream: use it in a `with` block, and iterate over it.

    Raises:
        InputError: no such URI.
        DeviceError: the device does not answer, or is another; from the loop: it was cut off, or silent for a second.
    """
    return Stream(source_of(uri))
