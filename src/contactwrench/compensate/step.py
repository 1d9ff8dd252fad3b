"""One sample: compensate, filter, watch for faults, detect. One source for plain Python and for numba.

Everything is flat sequences of floats, which numba compiles as arrays and plain Python runs as lists: an item of a list
costs a few ns, one of an array ten times that. What needs matrices (drift, covariances) is done by compensator.py, ten
times a second and whenever the arm has turned: `advance` stops for that and says why in `memory[ASK]`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from math import nan, sqrt
from typing import Any

from ..errors import MissingExtraError
from . import contact_events as touch
from . import faults as watch
from . import signal
from . import state as slot
from .contact_events import detect, gather
from .faults import SQUARED_TOLERANCE, far, rotation, turned, watched_orientation, watched_reading
from .signal import as_the_wrench_is_stamped, low_pass, settle
from .state import Numbers

BLOCK_SECONDS = 0.1


def advance(
    tool: Numbers,
    live: Numbers,
    filters: Numbers,
    memory: Numbers,
    ring: Sequence[Numbers],
    wrench: Sequence[Numbers],
    orientation: Sequence[Numbers],
    times: Numbers,
    heat: Numbers,
    out: Sequence[Numbers],
    start: int,
    stop: int,
) -> int:
    """Take samples from `start` until `stop`, or until something has to be done; the first that was not taken."""
    for i in range(start, stop):
        memory[slot.ASK] = 0.0
        if not take(tool, live, filters, memory, ring, wrench[i], orientation[i], times[i], heat[i], out[i]):
            return i
        if memory[slot.ASK] != 0.0:
            return i + 1
    return stop


def take(
    tool: Numbers,
    live: Numbers,
    filters: Numbers,
    memory: Numbers,
    ring: Sequence[Numbers],
    reading: Numbers,
    orientation: Numbers,
    now: float,
    heat: float,
    out: Numbers,
) -> bool:
    """Take one sample into `out`; False where something has to be done first, and the sample is still to be taken."""
    fault, detail, channel = unreadable(memory, reading, orientation, now)
    if fault != slot.FINE:
        return refused(memory, out, fault, detail, channel)
    fault, detail = interrupted(live, memory, now)
    restart = fault != slot.FINE or memory[slot.STARTED] == 0.0
    changed = turned(memory)
    if waits(memory, restart, changed, now):
        return False
    arrive(memory, reading, restart, now)
    fault, detail, channel = watched(tool, memory, reading, changed, now, fault, detail)
    fresh_pose = restart or (memory[slot.FRESH] == slot.WHOLLY and fault < slot.STUCK)
    if without_past(tool, memory, fresh_pose, now) and fault == slot.FINE:
        fault, detail = slot.NO_PAST, tool[slot.LOOK_BACK]
    recovers = memory[slot.FRESH] != 0.0 and fault < slot.STUCK
    fresh = restart or recovers
    compensate(tool, live, filters, memory, ring, reading, fresh, fresh_pose, now, heat)
    statistic = statistic_of(live, memory)
    for k in range(6):
        out[k] = memory[slot.WRENCH + k]
    if recovers:
        memory[slot.SINCE], memory[slot.STALE], memory[slot.SPOILED] = 0.0, 1.0, 1.0
        memory[slot.RUN] = memory[slot.QUIET] = 0.0
    memory[slot.SINCE] += 1.0
    if fault == slot.FROZEN:
        memory[slot.FRESH] = slot.WHOLLY
    elif fault >= slot.STUCK:
        memory[slot.FRESH] = max(memory[slot.FRESH], slot.WRENCH_ALONE)
    else:
        memory[slot.FRESH] = 0.0
    out[slot.CONTACT] = -1.0
    if fault in (slot.FINE, slot.OVERLOAD):
        if not recovers:
            detect(tool, live, memory, statistic, now)
        out[slot.CONTACT] = memory[slot.TOUCHING]
    else:
        memory[slot.SPOILED] = 1.0
    out[slot.FAULT], out[slot.DETAIL], out[slot.CHANNEL], out[slot.STATISTIC] = fault, detail, channel, statistic
    if now - memory[slot.BLOCK_TIME] >= BLOCK_SECONDS:
        memory[slot.ASK] += slot.BLOCK
    return True


def unreadable(memory: Numbers, reading: Numbers, orientation: Numbers, now: float) -> tuple[int, float, int]:
    """What keeps a sample from being computed at all, with a figure and the channel; writes its rotation matrix."""
    if now - now != 0.0:
        return slot.NO_TIME, now, -1
    if now == memory[slot.TIME]:
        return slot.REPEATED, now, -1
    total = reading[0] + reading[1] + reading[2] + reading[3] + reading[4] + reading[5]
    if total - total != 0.0:
        for k in range(6):
            if reading[k] - reading[k] != 0.0:
                return slot.NO_READING, reading[k], k
    squared = rotation(orientation, memory)
    if squared - squared != 0.0:
        return slot.NO_ORIENTATION, squared, -1
    if abs(squared - 1.0) > SQUARED_TOLERANCE:
        return slot.NO_ROTATION, squared, -1
    return slot.FINE, 0.0, -1


def interrupted(live: Numbers, memory: Numbers, now: float) -> tuple[int, float]:
    """Whether time jumped back or left a gap, and how far."""
    passed = now - memory[slot.TIME]
    if passed < 0.0:
        return slot.BACK, -passed
    if passed > live[slot.LONGEST_GAP]:
        return slot.GAP, passed
    return slot.FINE, 0.0


def waits(memory: Numbers, restart: bool, changed: bool, now: float) -> bool:
    """Whether something has to be done before a sample is taken: a contact that an interruption ends, or covariances
    that are not those of its orientation.
    """
    if restart and memory[slot.TOUCHING] != 0.0:
        memory[slot.RELEASE] = memory[slot.TIME]
        memory[slot.TOUCHING] = 0.0
        memory[slot.ASK] = slot.RELEASED
        return True
    if memory[slot.READY] == 0.0 and (restart or memory[slot.STALE] != 0.0 or (changed and far(memory))):
        if restart:
            memory[slot.SINCE] = 0.0
        memory[slot.NEXT_TIME] = now
        memory[slot.ASK] = slot.REFRESH
        return True
    memory[slot.READY] = 0.0
    return False


def arrive(memory: Numbers, reading: Numbers, restart: bool, now: float) -> None:
    """The sample is taken: begin anew with it, or count the time since the last."""
    if restart:
        begin(memory, reading, now)
    elif memory[slot.STAMPS] < slot.N_INTERVALS:
        memory[slot.INTERVALS + int(memory[slot.STAMPS])] = now - memory[slot.TIME]
        memory[slot.STAMPS] += 1.0
        if memory[slot.STAMPS] == slot.N_INTERVALS:
            memory[slot.ASK] += slot.RATE
    memory[slot.TIME] = now


def watched(
    tool: Numbers, memory: Numbers, reading: Numbers, changed: bool, now: float, fault: int, detail: float
) -> tuple[int, float, int]:
    """What else is wrong with a sample, the gravest first, with a figure and the channel."""
    frozen = watched_orientation(memory, changed, now)
    stuck = watched_reading(tool, memory, reading, now)
    if fault != slot.FINE:
        return fault, detail, -1
    if frozen > 0.0:
        return slot.FROZEN, frozen, -1
    if stuck == 6:
        return slot.STILL, now - memory[slot.NEW_TIME], -1
    if stuck >= 0:
        return slot.STUCK, memory[slot.REPEATS + stuck], stuck
    for k in range(6):
        if abs(reading[k]) >= tool[slot.RANGES + k]:
            return slot.OVERLOAD, reading[k], k
    return slot.FINE, 0.0, -1


def without_past(tool: Numbers, memory: Numbers, fresh_pose: bool, now: float) -> bool:
    """Whether the delay asks for an orientation from before the first one that counts."""
    if fresh_pose:
        memory[slot.POSES_FROM] = now
        memory[slot.FRESH] = min(memory[slot.FRESH], slot.WRENCH_ALONE)
    return tool[slot.DELAY] != 0.0 and now - tool[slot.LOOK_BACK] < memory[slot.POSES_FROM]


def compensate(
    tool: Numbers,
    live: Numbers,
    filters: Numbers,
    memory: Numbers,
    ring: Sequence[Numbers],
    reading: Numbers,
    fresh: bool,
    fresh_pose: bool,
    now: float,
    heat: float,
) -> None:
    """The contact wrench, filtered: the reading less what the model gives at the wrench's moment, behind the sensor's
    own filter. The model is linear in down as the flange sees it, so three numbers are filtered and not six.
    """
    x, y, z = down_in_flange(tool, memory)
    if tool[slot.DELAY] != 0.0:
        x, y, z = as_the_wrench_is_stamped(tool, memory, ring, fresh_pose, now, x, y, z)
    if filters[slot.SENSOR] > 0.0:
        at = slot.DOWN_IN_FLANGE
        memory[at], memory[at + 1], memory[at + 2] = x, y, z
        low_pass(filters, slot.SENSOR, memory, slot.SENSOR_STATE, at, 3, fresh_pose)
        x, y, z = memory[at], memory[at + 1], memory[at + 2]
    warmer = heated(memory, heat)
    grain = slot.GRAIN
    for k in range(6):
        free = tool[grain] * x + tool[grain + 1] * y + tool[grain + 2] * z + live[k] + tool[slot.WARMTH + k] * warmer
        left = reading[k] - free
        memory[slot.WRENCH + k] = left
        memory[slot.BLOCK_SUM + k] += left
        grain += 3
    memory[slot.BLOCK_ROWS] += 1.0
    if filters[slot.LOWPASS] > 0.0:
        low_pass(filters, slot.LOWPASS, memory, slot.LOWPASS_STATE, slot.WRENCH, 6, fresh)


def down_in_flange(tool: Numbers, memory: Numbers) -> tuple[float, float, float]:
    """`R_base_flange^T d`, of length 1 also where the matrix was rounded."""
    a, b, c = tool[slot.DOWN], tool[slot.DOWN + 1], tool[slot.DOWN + 2]
    R = slot.R_NOW
    x = a * memory[R] + b * memory[R + 3] + c * memory[R + 6]
    y = a * memory[R + 1] + b * memory[R + 4] + c * memory[R + 7]
    z = a * memory[R + 2] + b * memory[R + 5] + c * memory[R + 8]
    scale = 1.0 / sqrt(x * x + y * y + z * z)
    return x * scale, y * scale, z * scale


def heated(memory: Numbers, heat: float) -> float:
    """By how much it is warmer than at first; the last temperature counts where there is none."""
    if heat - heat == 0.0:
        memory[slot.HEAT] = heat
        if memory[slot.FIRST_HEAT] != memory[slot.FIRST_HEAT]:
            memory[slot.FIRST_HEAT] = heat
    return memory[slot.HEAT] - memory[slot.FIRST_HEAT] if memory[slot.FIRST_HEAT] == memory[slot.FIRST_HEAT] else 0.0


def statistic_of(live: Numbers, memory: Numbers) -> float:
    """`|W f|^2` of the contact wrench f; written out, as a loop costs plain Python twice as much."""
    at = slot.WRENCH
    fx, fy, fz, tx, ty, tz = memory[at], memory[at + 1], memory[at + 2], memory[at + 3], memory[at + 4], memory[at + 5]
    w = slot.WHITENING
    a = live[w] * fx
    b = live[w + 1] * fx + live[w + 2] * fy
    c = live[w + 3] * fx + live[w + 4] * fy + live[w + 5] * fz
    d = live[w + 6] * fx + live[w + 7] * fy + live[w + 8] * fz + live[w + 9] * tx
    e = live[w + 10] * fx + live[w + 11] * fy + live[w + 12] * fz + live[w + 13] * tx + live[w + 14] * ty
    f = (
        live[w + 15] * fx
        + live[w + 16] * fy
        + live[w + 17] * fz
        + live[w + 18] * tx
        + live[w + 19] * ty
        + live[w + 20] * tz
    )
    return a * a + b * b + c * c + d * d + e * e + f * f


def refused(memory: Numbers, out: Numbers, fault: int, detail: float, channel: int) -> bool:
    """A sample that cannot be computed; everything else goes on with the next."""
    for k in range(6):
        out[k] = nan
    out[slot.CONTACT] = -1.0
    out[slot.FAULT] = fault
    out[slot.DETAIL] = detail
    out[slot.CHANNEL] = channel
    out[slot.STATISTIC] = nan
    memory[slot.SPOILED] = 1.0
    return True


def begin(memory: Numbers, reading: Numbers, now: float) -> None:
    """Begin anew in time: nothing of before is compared with what comes."""
    memory[slot.STARTED] = 1.0
    memory[slot.RUN] = 0.0
    memory[slot.KNOWN_FREE] = 0.0
    memory[slot.FREE_TIME] = nan
    memory[slot.BLOCK_TIME] = now
    memory[slot.BLOCK_ROWS] = 0.0
    memory[slot.SPOILED] = 1.0
    memory[slot.NEW_TIME] = now
    memory[slot.TURN_TIME] = now
    memory[slot.SPEED] = 0.0
    memory[slot.STEADY] = 0.0
    memory[slot.STEP_SQUARED] = 0.0
    for k in range(6):
        memory[slot.BLOCK_SUM + k] = 0.0
        memory[slot.LAST + k] = reading[k]
        memory[slot.REPEATS + k] = 0.0
    for k in range(9):
        memory[slot.R_NOW + k] = memory[slot.R_NEXT + k]
        memory[slot.R_STEP + k] = 0.0


IN_ORDER = (
    *(turned, far, rotation, watched_orientation, watched_reading, gather, detect, settle, low_pass),
    *(as_the_wrench_is_stamped, down_in_flange, heated, compensate, statistic_of, watched, without_past),
    *(begin, arrive, waits),
    *(interrupted, unreadable, refused, take, advance),
)
"""What the kernel consists of, each after what it calls."""


@cache
def compiled() -> Callable[..., int]:
    """`advance` and what it calls, compiled by numba over float64 arrays. Raises `MissingExtraError` without it."""
    from types import FunctionType

    try:
        import numba
    except ImportError:
        raise MissingExtraError(
            "numba is not installed, expected for a compiled step: pip install 'contactwrench[fast]'"
        ) from None

    names: dict[str, Any] = {}
    for module in (touch, signal, watch):
        names.update(vars(module))
    names.update(globals())
    for function in IN_ORDER:
        name = function.__name__
        same = FunctionType(function.__code__, names, name)
        names[name] = numba.njit(nogil=True, cache=True, error_model="numpy")(same)
    result: Callable[..., int] = names["advance"]
    return result
