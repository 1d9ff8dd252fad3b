"""What an accelerometer on the tool says of its motion, sample by sample, in place of positions.

It feels gravity too, as it was when it read. Most are late behind the wrench: by how much the acceleration changes in
as long is in the std, as what drives and links shake is.
"""

from __future__ import annotations

from math import inf

import numpy as np
from numpy.typing import ArrayLike

from ..calibration.calibration import Calibration
from ..errors import InputError
from ..geometry.arrays import Array, numbers
from .filters import LowPass, looked_up
from .state import OF_DOWN, OF_MOTION, Matrix, Sample, State, kernel

FELT = OF_DOWN + OF_MOTION
"""Of the ring, where the accelerometer's columns begin: a time, and the specific force."""
LONGEST_SILENCE = 0.036
"""s, for which the last reading stands for the next: as long as poses may take that tell a motion."""


def told(calibration: Calibration, position: ArrayLike | None, acceleration: ArrayLike | None) -> Array:
    """What is told of the motion: positions, or an accelerometer's readings. Raises `InputError` where the
    calibration's inertia counts from the other.
    """
    what, other = ("position", "acceleration") if acceleration is None else ("acceleration", "position")
    if position is not None and acceleration is not None:
        raise InputError("found position and acceleration, expected what the inertia counts from: leave one out")
    dynamics = calibration.dynamics
    if dynamics is not None and (dynamics.accelerometer is None) == (position is None):
        of = "positions" if dynamics.accelerometer is None else "an accelerometer"
        raise InputError(
            f"found {what}, and a calibration whose inertia counts from {of}, expected {other}: give that, or "
            "calibrate by the other"
        )
    return numbers(position if acceleration is None else acceleration, what)  # type: ignore[arg-type]


def use_accelerometer(s: State, calibration: Calibration, sensor_filter: LowPass | None) -> None:
    """What the kernel needs of how one sits; a filter that is made up for by itself has a lag that its delay, which is
    behind the wrench, does not count.
    """
    sits = None if calibration.dynamics is None else calibration.dynamics.accelerometer
    if sits is not None:
        inverse = np.linalg.inv(sits.matrix)
        s.feels, s.felt_by = True, np.column_stack([inverse, -inverse @ sits.bias]).tolist()
        s.felt_late = sits.delay + (0.0 if sensor_filter is None else sensor_filter.lag)
        s.felt_variance, s.g = sits.noise**2, calibration.g


@kernel
def take_reading(s: State, sample: Sample, ring: Matrix, fresh: bool) -> bool:
    """Keep the specific force that the accelerometer reads, with the time of the wrench that it belongs to; whether it
    has read before or now.
    """
    a, b, c = sample.told[0], sample.told[1], sample.told[2]
    if fresh:
        s.felt_time, s.felt_off = -inf, 0.0
    if abs(a) + abs(b) + abs(c) < inf:
        newest = s.felt_next
        if s.felt_time == -inf:
            newest = s.felt_at = 0
        elif s.felt_at == newest:
            s.felt_at = (newest + 1) % len(ring)
        s.felt_next = (newest + 1) % len(ring)
        entry = ring[newest]
        entry[FELT] = sample.time - s.felt_late
        for k in range(3):
            row = s.felt_by[k]
            entry[FELT + 1 + k] = row[0] * a + row[1] * b + row[2] * c + row[3]
        s.felt_time = sample.time
    return s.felt_time > -inf


@kernel
def feel(s: State, ring: Matrix, now: float) -> None:
    """The acceleration at the moment of the wrench, or the newest one, into `s.seen`, and the variance by which it is
    off into `s.felt_off`: of its own noise, and of what it changes in the time that it is late by.
    """
    newest = (s.felt_next - 1) % len(ring)
    at, after, share = looked_up(ring, FELT, s.felt_at, newest, now)
    s.felt_at = at
    older, later, late = ring[at], ring[after], max(now - ring[newest][FELT], 0.0)
    down, rate, back = s.down, s.rate, 0.0 if s.resting else late
    newly = s.interval / (s.interval + late) if s.interval < inf else 1.0
    change = 0.0
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        before = down[k] + back * (rate[i] * down[j] - rate[j] * down[i])
        felt = older[FELT + 1 + k] + share * (later[FELT + 1 + k] - older[FELT + 1 + k]) + s.g * before
        s.felt_mean[k] += newly * (felt - s.felt_mean[k])
        change += (felt - s.felt_mean[k]) ** 2
        s.seen[9 + k] = felt
    s.felt_off = s.felt_variance + max(change - 3.0 * s.felt_variance, 0.0)
