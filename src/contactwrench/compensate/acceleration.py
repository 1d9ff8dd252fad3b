"""What an accelerometer on the tool says of its motion, sample by sample, in place of positions.

It feels gravity too, as it was when it read. Most are late behind the wrench, and many read less often: by how much the
acceleration changes while a reading ages is in the std, as what drives and links shake is.
"""

from __future__ import annotations

from math import inf

import numpy as np
from numpy.typing import ArrayLike

from ..calibration.calibration import Calibration
from ..errors import InputError
from ..geometry.arrays import Array, numbers
from .delay import looked_up, room_in
from .filters import LowPass
from .state import OF_DOWN, OF_MOTION, Matrix, Row, Sample, State, kernel

FELT = OF_DOWN + OF_MOTION
"""Of the ring, where the accelerometer's columns begin: a time, and the specific force."""
LONGEST_SILENCE = 0.036
"""s, for which the last reading stands for the next: as long as poses may take that tell a motion."""
TURNING, PUSHED = 0.02, 0.2
"""rad/s and m/s^2, flange axes: with less an arm may stand."""


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
            f"found {what}, and a calibration whose inertia counts from {of}, expected {other}: give that "
            f"with the reading, `{other}=`, or calibrate by the other"
        )
    return numbers(position if acceleration is None else acceleration, what)


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
    has read before or now. When it last did is known across gaps; where the times begin anew it has just fallen silent.
    """
    now, told = sample.time, sample.told
    if fresh or s.felt_time == -inf:
        s.felt_anew = True
    if fresh and s.felt_time > now:
        s.felt_time = s.felt_news = now - LONGEST_SILENCE
    if abs(told[0]) + abs(told[1]) + abs(told[2]) < inf:
        for k in range(3):
            by = s.felt_by[k]
            s.specific_force[k] = by[0] * told[0] + by[1] * told[1] + by[2] * told[2] + by[3]
        if tells_more(s, told, now):
            keep_reading(s, ring, now)
            s.felt_time = now
        else:
            s.felt_time = s.felt_news
    return s.felt_time > -inf


@kernel
def tells_more(s: State, told: Row, now: float) -> bool:
    """Whether a reading is another than the one before: the same once more is held, or stuck, unless the arm stands by
    its poses and by what is read, as a coarse accelerometer repeats itself then.
    """
    last, other, turning, pushed = s.felt_told, False, 0.0, 0.0
    for k in range(3):
        felt = s.specific_force[k] + s.g * s.down[k]
        pushed, turning = pushed + felt * felt, turning + s.rate[k] * s.rate[k]
        other = other or told[k] != last[k]
        last[k] = told[k]
    if other:
        s.felt_news = now
    return other or (pushed <= PUSHED * PUSHED and (s.poses == 0 or turning <= TURNING * TURNING))


@kernel
def keep_reading(s: State, ring: Matrix, now: float) -> None:
    """Put it into the ring; one that begins anew forgets what was before."""
    when = now - s.felt_late
    s.felt_passed = s.interval if s.felt_anew else when - ring[(s.felt_next - 1) % len(ring)][FELT]
    newest, s.felt_next, s.felt_at = room_in(ring, s.felt_next, s.felt_at, s.felt_anew)
    entry, s.felt_anew = ring[newest], False
    entry[FELT] = when
    for k in range(3):
        entry[FELT + 1 + k] = s.specific_force[k]


@kernel
def feel(s: State, ring: Matrix, now: float) -> None:
    """The acceleration at the moment of the wrench, or the newest one, into `s.seen`, and the variance by which it is
    off into `s.felt_off`: of its own noise, and of what it changes in the time that it is old by. How fast it changes
    is known from one reading to the next, over as long as the reading was late.
    """
    newest = (s.felt_next - 1) % len(ring)
    at, after, share = looked_up(ring, FELT, s.felt_at, newest, now)
    s.felt_at = at
    older, later, age = ring[at], ring[after], max(now - ring[newest][FELT], 0.0)
    down, rate, back = s.down, s.rate, 0.0 if s.resting else age
    read, change = s.felt_time == now and s.felt_passed > 0.0, 0.0
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        before = down[k] + back * (rate[i] * down[j] - rate[j] * down[i])
        felt = older[FELT + 1 + k] + share * (later[FELT + 1 + k] - older[FELT + 1 + k]) + s.g * before
        if read:
            s.felt_rate[k] = (felt - s.felt[k] + age * s.felt_rate[k]) / (s.felt_passed + age)
            s.felt[k] = felt
        change += age * age * s.felt_rate[k] * s.felt_rate[k]
        s.seen[9 + k] = felt
    s.felt_off = s.felt_variance + max(change - 3.0 * s.felt_variance, 0.0)
