"""Steps through samples, plain or compiled: state and samples as each of the two takes them."""

from __future__ import annotations

import gc
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache, wraps
from hashlib import sha256
from inspect import getsource
from math import inf, nan
from threading import Timer, get_ident
from typing import Any, Concatenate, ParamSpec, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError, MissingExtraError, has_compiler
from ..geometry.arrays import Array, numbers, read_only, seconds
from ..geometry.orientation import OrientationLike, numbers_of
from ..geometry.ranges import require_seconds
from ..geometry.wrench import wrench_rows
from ..subtract import compiled_by_numba
from .contact_wrenches import Contact, ContactWrenches
from .faults import SAME, reasons_of
from .state import COVARIANCE, KERNEL, SAMPLE, STATE, Sample, State
from .step import taking

Given = ParamSpec("Given")
Made = TypeVar("Made")

MOMENT = 1.0
"""s: what takes longer is said."""
TAKEN = "found a call from a second thread, expected one: give each a Compensator of its own, or begin anew, reset()"
ROWS_AT_ONCE = 128
NOTHING_TOLD = np.full(3, nan)
"""Of a motion, with a reading alone."""
TOLD = ("events", "fault", "detail", "channel", "contact")
TAKEN_IN = ("reading", "orientation", "time", "temperature", "told", "passed", "motion", "motion_variance")
MADE = tuple(name for name in SAMPLE.names or () if name not in TAKEN_IN)

take = taking("")
"""In plain Python."""


def by_one_thread(method: Callable[Concatenate[Any, Given], Made]) -> Callable[Concatenate[Any, Given], Made]:
    """Refuse the method to every thread but the first that calls one."""

    @wraps(method)
    def owned(self: Any, /, *args: Given.args, **named: Given.kwargs) -> Made:
        if vars(self).setdefault("owner", me := get_ident()) != me:
            raise InputError(TAKEN)
        return method(self, *args, **named)

    return owned


def require_one(reading: Array, turn: Array, place: Array) -> None:
    """Raise `InputError` for what is no single reading, orientation and position or acceleration by its shapes."""
    if reading.shape != (6,) or turn.shape not in {(4,), (3, 3)}:
        raise InputError(
            f"wrench and orientation have shapes {reading.shape} and {turn.shape}, expected (6,) and (3, 3) or (4,)"
        )
    if place.shape != (3,):
        raise InputError(f"position or acceleration has shape {place.shape}, expected (3,)")


def heat_told(temperature: ArrayLike | None) -> Array:
    """A temperature that there must be. Raises `InputError`."""
    if temperature is None:
        expected = "expected one with each reading, as there is a temperature_coefficient"
        raise InputError(f"found no temperature, {expected}: pass it, NaN where it is not known")
    return numbers(temperature, "temperature")


def samples_of(
    wrench: ArrayLike,
    orientation: OrientationLike,
    t: ArrayLike,
    temperature: ArrayLike | None,
    by_heat: bool,
    told: Array | None,
    *moving: Array,
) -> tuple[NDArray[np.void], int]:
    """Samples (n,) to be taken, and how many numbers an orientation has: 4 or 9. `told` (n, 3) of the motion, or in
    `moving` its terms (n, 12), and by how much the variance (n, 6) grows in it, where they are known. Raises
    `InputError` for shapes that do not pair, and for times of which none is in s: one alone is a fault of its sample.
    """
    readings, leading = wrench_rows(wrench)
    if len(leading) > 1:
        found = f"wrench has shape {(*leading, 6)}, expected (n, 6), one after the other in time"
        raise InputError(f"{found}: run each sequence by itself, after reset()")
    n, turns, times = len(readings), numbers_of(orientation), seconds(t)
    heats = np.full(n, nan) if temperature is None and not by_heat else heat_told(temperature)
    told = np.full((n, 3), nan) if told is None else told
    if turns.shape not in {(n, 4), (n, 3, 3)} or times.shape != (n,) or heats.shape != (n,):
        raise InputError(
            f"orientation, t and temperature have shapes {turns.shape}, {times.shape} and {heats.shape}, expected "
            f"({n}, 3, 3) or ({n}, 4), ({n},) and ({n},) for {n} readings"
        )
    if told.shape != (n, 3):
        raise InputError(f"position or acceleration has shape {told.shape}, expected ({n}, 3) for {n} readings")
    require_seconds(float(np.fmin.reduce(times, initial=inf)))
    width = 4 if turns.shape[1:] == (4,) else 9
    samples = np.zeros(n, SAMPLE)
    samples["reading"], samples["orientation"][:, :width] = readings, turns.reshape(-1, width)
    samples["time"], samples["temperature"], samples["told"] = times, heats, told
    samples["passed"], (samples["motion"], samples["motion_variance"]) = nan, moving or (nan, nan)
    return samples, width


def results_of(samples: NDArray[np.void], contacts: list[Contact], covariances: list[Array]) -> ContactWrenches:
    """What was made of samples (n,), with the covariances as they followed each other."""
    return ContactWrenches(
        wrench=samples["wrench"],
        std=samples["wrench_std"],
        t=samples["time"],
        judged=True,
        valid=samples["fault"] <= SAME,
        reason=reasons_of(samples),
        contact=samples["contact"],
        contacts=tuple(contacts),
        statistic=samples["statistic"],
        threshold=samples["threshold"],
        covariance_of=np.cumsum(samples["events"] & COVARIANCE != 0),
        covariance=read_only(covariances),
    )


class Plain:
    """In plain Python, on attributes and lists: an item of a list costs a tenth of one of an array."""

    def __init__(self, state: State, ring: Array) -> None:
        self.state: Any = state
        self.sample: Any = Sample()
        self._given, self._inertia = ([state], [self.sample], ring.tolist()), state.knows_inertia or None

    def told(self) -> tuple[Any, ...]:
        """`TOLD` of the last sample."""
        sample = self.sample
        return sample.events, sample.fault, sample.detail, sample.channel, sample.contact

    def step(self, reading: Array, turn: Array, t: float, temperature: float, told: Array) -> tuple[int, Array]:
        """What a sample says, and its contact wrench (6,)."""
        sample = self.sample
        sample.told, sample.reading, sample.orientation = told.tolist(), reading.tolist(), turn.ravel().tolist()
        sample.time, sample.temperature = t, temperature
        take(*self._given, turn.size, 0, self._inertia)
        return sample.said, read_only(sample.wrench)

    def std(self) -> Array:
        """Of the last contact wrench (6,)."""
        return read_only(self.sample.wrench_std)

    def pose(self, turn: Array, place: Array, t: float, passed: float) -> None:
        """A pose without a reading."""
        sample = self.sample
        sample.orientation, sample.told = turn.ravel().tolist(), place.tolist()
        sample.time, sample.passed = t, passed
        try:
            take(*self._given, turn.size, 0, self._inertia)
        finally:
            sample.passed = nan

    def advance(self, samples: NDArray[np.void], width: int, begin: int) -> int:
        """Take samples from `begin` on, to the first with an event or before; how many are taken."""
        rows, made, sample = slice(begin, begin + ROWS_AT_ONCE), [], Sample()
        states, _, ring = self._given
        for values in zip(*(samples[name][rows].tolist() for name in TAKEN_IN), strict=True):
            sample.reading, sample.orientation, sample.time, sample.temperature, *moved = values
            sample.told, sample.passed, sample.motion, sample.motion_variance = moved
            take(states, [sample], ring, width, 0, self._inertia)
            made.append([sample.wrench[:], sample.wrench_std[:], *(getattr(sample, name) for name in MADE[2:])])
            if sample.events:
                break
        for name, values in zip(MADE, zip(*made, strict=True), strict=True):
            samples[name][begin : begin + len(made)] = values
        return begin + len(made)


class Compiled:
    """By numba, on records; else as `Plain`."""

    def __init__(self, state: State, ring: Array) -> None:
        parts: tuple[tuple[Any, Any], ...] = ((state, STATE), (Sample(), SAMPLE))
        records = [np.array([tuple(getattr(part, name) for name in part.__slots__)], kind) for part, kind in parts]
        self.__setstate__((*records, ring))

    def __getstate__(self) -> tuple[NDArray[Any], ...]:
        return self._record, self._samples, self._ring

    def __setstate__(self, arrays: tuple[NDArray[Any], ...]) -> None:
        self._record, self._samples, self._ring = arrays
        self.state: Any = self._record.view(np.recarray)[0]
        self._inertia = bool(self.state.knows_inertia) or None
        self._advance = compiled(bool(self._inertia))
        self.sample: Any = self._samples.view(np.recarray)[0]
        self._reading, self._wrench, orientation = self.sample.reading, self.sample.wrench, self.sample.orientation
        self._motion_told, self._std = self.sample.told, self.sample.wrench_std
        self._turns = {4: orientation[:4], 9: orientation.reshape(3, 3)}
        self._told = [self._samples[name] for name in TOLD]
        self._time, self._temperature, self._passed, self._said = (
            self._samples[name] for name in ("time", "temperature", "passed", "said")
        )

    def told(self) -> tuple[Any, ...]:
        """`TOLD` of the last sample."""
        return tuple(column.item() for column in self._told)

    def step(self, reading: Array, turn: Array, t: float, temperature: float, told: Array) -> tuple[int, Array]:
        """What a sample says, and its contact wrench (6,)."""
        width = turn.size
        if told is not NOTHING_TOLD:
            self._motion_told[...] = told
        self._reading[...] = reading
        self._turns[width][...] = turn
        self._time[0], self._temperature[0] = t, temperature
        self._advance(self._record, self._samples, self._ring, width, 0, self._inertia)
        if told is not NOTHING_TOLD:
            self._motion_told[...] = nan
        return self._said.item(), np.frombuffer(self._wrench.tobytes())

    def std(self) -> Array:
        """Of the last contact wrench (6,)."""
        return np.frombuffer(self._std.tobytes())

    def pose(self, turn: Array, place: Array, t: float, passed: float) -> None:
        """A pose without a reading."""
        width = turn.size
        self._motion_told[...] = place
        self._turns[width][...] = turn
        self._time[0], self._passed[0] = t, passed
        self._advance(self._record, self._samples, self._ring, width, 0, self._inertia)
        self._passed[0] = self._motion_told[...] = nan

    def advance(self, samples: NDArray[np.void], width: int, begin: int) -> int:
        """Take samples from `begin` on, to the end or the first with an event; how many are taken."""
        return self._advance(self._record, samples, self._ring, width, begin, self._inertia)


def steps_of(fast: bool | None) -> type[Plain] | type[Compiled]:
    """Compiled, where numba is installed or that is asked for. Raises `InputError`."""
    if fast not in (None, True, False):
        raise InputError(f"fast is {fast!r}, expected True, False or None: None takes numba where it is installed")
    return Compiled if fast or (fast is None and has_compiler()) else Plain


@cache
def compiled(inertia: bool) -> Callable[..., int]:
    """`take` of the step, compiled by numba over records and arrays: of a tool whose inertia is known, or without
    it, in two thirds of the time. Raises `MissingExtraError` without numba, and `InputError` where it is switched off.
    """
    try:
        from numba import from_dtype, types
    except ImportError:
        raise MissingExtraError(
            "numba is not installed, expected for a compiled step: pip install 'contactwrench[fast]'"
        ) from None
    if not has_compiler():
        raise InputError("NUMBA_DISABLE_JIT is set, expected not with fast=True: unset it, or leave fast out")
    state, sample, rows = from_dtype(STATE), from_dtype(SAMPLE), types.float64[:, ::1]
    arguments = (state[::1], sample[::1], rows, types.int64, types.int64, types.boolean if inertia else types.none)
    with said_while_it_lasts("compiling the step for one sample at a time, once on this machine"):
        take = taking(_told_to_numba())
        return compiled_by_numba(take, arguments, nogil=True, error_model="numpy", no_cfunc_wrapper=True)


@cache
def _told_to_numba() -> str:
    """Let numba compile the kernel's functions; a digest of their files."""
    from numba.extending import register_jitable

    for function in KERNEL:
        register_jitable(error_model="numpy", no_cfunc_wrapper=True, no_cpython_wrapper=True)(function)
    homes = {function.__module__ for function in KERNEL} | {State.__module__}  # which has constants of them all
    return sha256("".join(getsource(sys.modules[name]) for name in sorted(homes)).encode()).hexdigest()


@contextmanager
def said_while_it_lasts(what: str) -> Iterator[None]:
    """A line on stderr, where that is a terminal, if it lasts longer than a moment. Meanwhile no garbage is looked
    for: a compiler makes much that stays, and each look goes through all of it again.
    """
    timer = Timer(MOMENT, lambda: print(f"{what} ...", file=sys.stderr, flush=True))
    timer.daemon = True
    if sys.stderr is not None and sys.stderr.isatty():
        timer.start()
    collects = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        timer.cancel()
        if collects:
            gc.enable()
