"""What a number may be: of each quantity the least and the most that somebody could mean, for options and arguments."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError
from .arrays import Array, numbers


@dataclass(frozen=True)
class Range:
    """Numbers from `least` to `most`, both included, in a `unit`; and 0, which is none, where `or_zero`."""

    least: float
    most: float
    unit: str = ""
    or_zero: bool = False

    def __str__(self) -> str:
        return f"{'0 or ' if self.or_zero else ''}{self.least:g} to {self.most:g} {self.unit}".rstrip()

    def holds(self, values: Array) -> NDArray[np.bool_]:
        """Which of the values lie within; a NaN does not."""
        inside: NDArray[np.bool_] = (self.least <= values) & (values <= self.most)
        return inside | (values == 0.0) if self.or_zero else inside

    def outside(self, values: Array) -> Array:
        """Those (k,) of `values` that do not."""
        return values[~self.holds(values)]

    def require(self, values: ArrayLike, name: str, *shapes: tuple[int, ...]) -> Array:
        """`values` as an array of one of the `shapes`; none: a number. Raises `InputError` that calls them `name`."""
        shapes = shapes or ((),)
        array = numbers(values, name)
        if array.shape not in shapes:
            of_shape = " or ".join(f"numbers {shape}" if shape else "a number" for shape in shapes)
            raise InputError(f"{name} is {' '.join(repr(values)[:80].split())}, expected {of_shape}, {self}")
        if len(beyond := self.outside(array)):
            raise InputError(f"{name} is {beyond[0]:g}, expected {self}")
        return array


G = Range(0.1, 100.0, "m/s^2")
"""From an asteroid's to a large planet's; a centrifuge's."""
WEIGHT, WEIGHT_STD = Range(1e-6, 1e6, "N"), Range(1e-6, 1e6, "N")
LOAD, LOAD_KG = Range(1e-3, 1e6, "g", or_zero=True), Range(1e-6, 1e6, "kg", or_zero=True)
TOOL_MASS, SENSOR_MASS = Range(1e-6, 200.0, "kg (is it in g?)"), Range(0.0, 50.0, "kg (is it in g?)")
POINT, POINT_STD = Range(-10.0, 10.0, "m (is it in mm?)"), Range(1e-6, 10.0, "m")
ON_FLANGE = Range(-2.0, 2.0, "m (is it in mm?)")
DIRECTION, ENTRY = Range(-1e6, 1e6), Range(-2.0, 2.0)
TURN, TURN_DEG, JOINT = Range(-1e5, 1e5, "rad"), Range(-360.0, 360.0, "deg"), Range(-1e3, 1e3, "rad")
TILT_STD, TILT_STD_DEG = Range(1e-6, np.pi, "rad"), Range(1e-4, 180.0, "deg")
READING, NOISE_OR_NONE = Range(-1e9, 1e9, "N or N m"), Range(0.0, 1e6, "N or N m")
NOISE, NOISE_OF_AXIS, WALK = Range(1e-9, 1e6, "N"), Range(1e-12, 1e6, "N or N m"), Range(0.0, 1e6, "N or N m")
LEFT_FORCE, LEFT_TORQUE = Range(0.0, 1e9, "N"), Range(0.0, 1e9, "N m")
PER_KELVIN, CAPACITY = Range(-1e6, 1e6, "N/K or N m/K"), Range(1e-6, 1e9, "N or N m")
TIME, PLACE = Range(-1e19, 1e19, "s"), Range(-1e6, 1e6, "m")
"""Of a recording: s since 1970, were they ns; a position from the base."""
RATE, CUTOFF = Range(1e-3, 1e6, "Hz"), Range(1e-3, 1e6, "Hz")
LAG = Range(-1.0, 1.0, "s (is it in ms?)")
"""Of a delay that is stated sample by sample: a recording's may be two clocks'."""
DELAY, DELAY_STD = Range(-10.0, 10.0, "s (is it in ms?)"), Range(0.0, 10.0, "s (is it in ms?)")
DURATION = Range(1e-6, 1e6, "s")
ROWS = Range(0, 1e7, "(fewer, or a lower rate)")
"""Of a recording: 3 GB of CSV."""
MOTION_TIME = Range(10.0, 600.0, "s")
HEIGHT, NEAR = Range(-10.0, 10.0, "m (is it in mm?)"), Range(0.01, 10.0, "m (is it in mm?)")
"""Of a motion that is planned: how long, how high the flange stays, how near to where it starts."""
POSES, PUSHES = Range(1, 100), Range(0, 1000)
EPISODE, SEED = Range(0, 1e15), Range(0, 1e15)

UNIX_TIMES = Range(1e9, 4.2e9, "s")
"""From 2001 to 2103; in ms, us or ns a thousand times as much or more, where no clock that counts seconds gets."""


def per_second(t: float) -> float:
    """How many of a Unix time's unit, by its size, a second has; 1 of any other time."""
    return next((each for each in (1e3, 1e6, 1e9) if UNIX_TIMES.least <= t / each <= UNIX_TIMES.most), 1.0)


def require_seconds(t: float) -> None:
    """Raise `InputError` for a Unix time, one of several, that by its size is none in s."""
    if (per_s := per_second(t)) > 1.0:
        raise InputError(f"t is up to {t:.6g}, a time since 1970, expected s: divide it by {per_s:,.0f}")


FEWEST_TIMES, SLOWEST_STEP, LONGEST_RECORDING = 200, 1.0, 1e4
"""So many times, of which the middle step is of so many s or more, are likely in another unit: where they are whole
numbers, or go on for longer than so many s.
"""
SLOWER_UNITS = ((1e3, "ms"), (1e6, "us"), (np.inf, "ns"))
"""Of steps that would be less than so many s."""


def likely_unit(t: Array | None) -> tuple[str, float] | None:
    """The unit that times (n,) without one are likely in, and the step between them, were it s; None: s will do."""
    if t is None or len(t) <= FEWEST_TIMES or not np.isfinite(t).all():
        return None
    step = float(np.median(np.diff(t)))
    if step < SLOWEST_STEP or (np.any(t % 1.0) and t[-1] - t[0] <= LONGEST_RECORDING):
        return None
    return next(unit for most, unit in SLOWER_UNITS if step < most), step
