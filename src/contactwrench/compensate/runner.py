"""Steps through samples, plain or compiled: where state and samples stand as each of the two takes them."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from hashlib import sha256
from pathlib import Path
from threading import Timer
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import MissingExtraError
from ..geometry.arrays import Array, read_only
from .state import KERNEL, SAMPLE, STATE, Sample, State
from .step import advance

MOMENT = 1.0
"""s: what takes longer is said."""
ROWS_AT_ONCE = 128
GIVEN = ("reading", "orientation", "time", "temperature")
MADE = tuple(name for name in SAMPLE.names or () if name not in GIVEN)


class Plain:
    """In plain Python, on attributes and lists: an item of a list costs a tenth of one of an array."""

    def __init__(self, state: State) -> None:
        self.state: Any = state
        self.sample: Any = Sample()

    def step(
        self, reading: Array, turn: Array, t: float, temperature: float, ring: Any, settling: Any
    ) -> tuple[int, Array]:
        """What a sample says, and its contact wrench (6,)."""
        sample = self.sample
        sample.reading, sample.orientation = reading.tolist(), turn.ravel().tolist()
        sample.time, sample.temperature = t, temperature
        advance([self.state], [sample], ring, settling, turn.size, 0)
        return sample.said, read_only(sample.wrench)

    def advance(self, samples: NDArray[np.void], ring: Any, settling: Any, width: int, begin: int) -> int:
        """Take samples from `begin` on, to the end or the first with an event; how many are taken."""
        rows, made, sample = slice(begin, begin + ROWS_AT_ONCE), [], self.sample
        for given in zip(*(samples[name][rows].tolist() for name in GIVEN), strict=True):
            sample.reading, sample.orientation, sample.time, sample.temperature = given
            advance([self.state], [sample], ring, settling, width, 0)
            made.append([sample.wrench[:], sample.wrench_std[:], *(getattr(sample, name) for name in MADE[2:])])
            if sample.events:
                break
        for name, values in zip(MADE, zip(*made, strict=True), strict=True):
            samples[name][begin : begin + len(made)] = values
        return begin + len(made)

    @staticmethod
    def flat(values: Array) -> Any:
        """Rows of numbers as the step takes them."""
        return values.tolist()


class Record:
    """The attributes of a record, by views on its fields."""

    def __init__(self, record: NDArray[np.void]) -> None:
        object.__setattr__(self, "fields", {name: record[name] for name in record.dtype.names or ()})

    def __getattr__(self, name: str) -> Any:
        return self.fields[name][0]

    def __setattr__(self, name: str, value: Any) -> None:
        self.fields[name][0] = value


class Compiled:
    """By numba, on records."""

    def __init__(self, state: State) -> None:
        self._step = compiled()
        self._state, self._samples = np.zeros(1, STATE), np.zeros(1, SAMPLE)
        self.state: Any = Record(self._state)
        self.sample: Any = Record(self._samples)
        for name in STATE.names or ():
            setattr(self.state, name, getattr(state, name))
        self._reading, self._wrench, orientation = self.sample.reading, self.sample.wrench, self.sample.orientation
        self._turns = {4: orientation[:4], 9: orientation.reshape(3, 3)}
        self._time, self._temperature, self._said = (self._samples[name] for name in ("time", "temperature", "said"))

    def step(
        self, reading: Array, turn: Array, t: float, temperature: float, ring: Any, settling: Any
    ) -> tuple[int, Array]:
        """What a sample says, and its contact wrench (6,)."""
        self._reading[...] = reading
        self._turns[turn.size][...] = turn
        self._time[0], self._temperature[0] = t, temperature
        self._step(self._state, self._samples, ring, settling, turn.size, 0)
        return self._said[0], np.frombuffer(self._wrench.tobytes())

    def advance(self, samples: NDArray[np.void], ring: Any, settling: Any, width: int, begin: int) -> int:
        """Take samples from `begin` on, to the end or the first with an event; how many are taken."""
        return self._step(self._state, samples, ring, settling, width, begin)

    @staticmethod
    def flat(values: Array) -> Any:
        """Rows of numbers as the step takes them."""
        return np.array(values)


@cache
def compiled() -> Callable[..., int]:
    """`advance`, compiled by numba over records and arrays. Raises `MissingExtraError` without it."""
    try:
        import numba
        from numba import types
        from numba.extending import register_jitable
    except ImportError:
        raise MissingExtraError(
            "numba is not installed, expected for a compiled step: pip install 'contactwrench[fast]'"
        ) from None
    for function in KERNEL:
        register_jitable(error_model="numpy")(function)
    state, sample, rows = numba.from_dtype(STATE), numba.from_dtype(SAMPLE), types.float64[:, ::1]
    signature = types.int64(state[::1], sample[::1], rows, rows, types.int64, types.int64)
    with said_while_it_lasts("compiling the step for one sample at a time, once on this machine"):
        step: Callable[..., int] = numba.njit(signature, cache=True, nogil=True, error_model="numpy")(_keyed(_digest()))
    return step


def _keyed(digest: str) -> Callable[..., int]:
    """`advance` with `digest` in its closure: numba's cache looks at the file of a function, and not at those of what
    it calls, but it does look at the closure.
    """

    def step(state, samples, ring, settling, width, begin):  # type: ignore[no-untyped-def]
        digest  # noqa: B018
        return advance(state, samples, ring, settling, width, begin)

    return step


def _digest() -> str:
    files = sorted({Path(function.__code__.co_filename) for function in KERNEL})
    return sha256(b"".join(file.read_bytes() for file in files)).hexdigest()


@contextmanager
def said_while_it_lasts(what: str) -> Iterator[None]:
    """A line on stderr, where that is a terminal, if it lasts longer than a moment."""
    timer = Timer(MOMENT, lambda: print(f"{what} ...", file=sys.stderr, flush=True))
    timer.daemon = True
    if sys.stderr.isatty():
        timer.start()
    try:
        yield
    finally:
        timer.cancel()
