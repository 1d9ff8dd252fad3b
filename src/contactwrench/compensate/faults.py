"""Faults that a single sample does not show: a channel or an orientation that stands still.

Part of the kernel: see kernel.py.
"""

from __future__ import annotations

from math import erf, inf, log, sqrt

from . import state as slot
from .state import Numbers

TURNED_FAR = 0.0152
"""Squared distance |R - R'|^2 at which covariances are computed anew: 2 angle^2 for 5 degrees."""
SQUARED_TOLERANCE = 0.02
"""As in compensate.py: an orientation may be off unit length by 1 %."""
LEAST_REPEATS = 100.0
CHANCE_OF_REPEATS = 207.0
"""-10 log 1e-9: a run of repeated values that independent noise gives once in 10^9, ten times over, as noise that was
filtered moves that much more slowly."""
LOG_SAME_UNSEEN = -0.0207
"""Of a channel that never moved: it may repeat 10,000 times."""
BRAKING = 20.0
"""rad/s^2: no arm stops a turn faster."""


def rotation(orientation: Numbers, memory: Numbers) -> float:
    """Write the rotation matrix of a quaternion x, y, z, w or of a row-major matrix; its squared length, 1 expected,
    or, of a matrix that is not square and right-handed, how far it is off in place of that.
    """
    if len(orientation) == 4:
        x, y, z, w = orientation[0], orientation[1], orientation[2], orientation[3]
        squared = x * x + y * y + z * z + w * w
        if not abs(squared - 1.0) <= SQUARED_TOLERANCE:
            return squared
        two = 2.0 / squared
        xx, yy, zz = two * x * x, two * y * y, two * z * z
        xy, xz, yz = two * x * y, two * x * z, two * y * z
        wx, wy, wz = two * w * x, two * w * y, two * w * z
        memory[slot.R_NEXT] = 1.0 - yy - zz
        memory[slot.R_NEXT + 1] = xy - wz
        memory[slot.R_NEXT + 2] = xz + wy
        memory[slot.R_NEXT + 3] = xy + wz
        memory[slot.R_NEXT + 4] = 1.0 - xx - zz
        memory[slot.R_NEXT + 5] = yz - wx
        memory[slot.R_NEXT + 6] = xz - wy
        memory[slot.R_NEXT + 7] = yz + wx
        memory[slot.R_NEXT + 8] = 1.0 - xx - yy
        return squared
    a, b, c = orientation[0], orientation[1], orientation[2]
    d, e, f = orientation[3], orientation[4], orientation[5]
    g, h, i = orientation[6], orientation[7], orientation[8]
    lengths = (a * a + b * b + c * c, d * d + e * e + f * f, g * g + h * h + i * i)
    total = lengths[0] + lengths[1] + lengths[2]
    if total - total != 0.0:
        return total
    worst = lengths[0]
    for length in lengths:
        if abs(length - 1.0) > abs(worst - 1.0):
            worst = length
    if not abs(worst - 1.0) <= SQUARED_TOLERANCE:
        return worst
    # The third row of a rotation is the cross product of the others.
    off = abs(g - (b * f - c * e)) + abs(h - (c * d - a * f)) + abs(i - (a * e - b * d))
    if off > 3.0 * SQUARED_TOLERANCE or abs(a * d + b * e + c * f) > SQUARED_TOLERANCE:
        return 1.0 + off + abs(a * d + b * e + c * f)
    for k in range(9):
        memory[slot.R_NEXT + k] = orientation[k]
    return worst


def turned(memory: Numbers) -> bool:
    """Whether the orientation differs from the last one, in any digit."""
    for k in range(9):  # noqa: SIM110, a generator is not compiled
        if memory[slot.R_NEXT + k] != memory[slot.R_NOW + k]:
            return True
    return False


def far(memory: Numbers) -> bool:
    """Whether the orientation is too far from the one that the covariances belong to."""
    squared = 0.0
    for k in range(9):
        apart = memory[slot.R_NEXT + k] - memory[slot.R_REFRESHED + k]
        squared += apart * apart
    return squared > TURNED_FAR


def watched_orientation(memory: Numbers, changed: bool, now: float) -> float:
    """Take the new orientation over; the time (s) for which it has been frozen, or 0.

    An orientation that repeats is usual: poses come more rarely than readings, and an arm may be quite still. It is
    frozen where it has repeated for longer than poses take to come, although the arm was turning too fast to stop in
    that time; or for much longer than ever before, although at rest it always jittered.
    """
    usual = memory[slot.TURN_USUAL]
    since = now - memory[slot.TURN_TIME]
    if not changed:
        if memory[slot.STEADY] != 0.0 and since > max(5.0 * usual, 0.02):
            return since
        if memory[slot.JITTER] >= 50.0 and since > max(20.0 * usual, 5.0 * memory[slot.LONGEST_REST], 0.2):
            return since
        return 0.0
    if since <= 0.0:
        return 0.0
    if usual == 0.0:
        usual = since
    usual += 0.05 * (min(since, 5.0 * usual) - usual)
    squared = along = 0.0
    for k in range(9):
        new = memory[slot.R_NEXT + k]
        step = new - memory[slot.R_NOW + k]
        squared += step * step
        along += step * memory[slot.R_STEP + k]
        memory[slot.R_STEP + k] = step
        memory[slot.R_NOW + k] = new
    before = memory[slot.STEP_SQUARED]
    memory[slot.STEP_SQUARED] = squared
    speed = sqrt(0.5 * squared) / since
    straight = along > 0.5 * sqrt(squared * before)
    memory[slot.STEADY] = 1.0 if straight and min(speed, memory[slot.SPEED]) > BRAKING * max(since, usual) else 0.0
    memory[slot.LONGEST_REST] = max(memory[slot.LONGEST_REST], since)
    if along < 0.0 and speed < 0.05:
        memory[slot.JITTER] += 1.0
    memory[slot.SPEED] = speed
    memory[slot.TURN_USUAL] = usual
    memory[slot.TURN_TIME] = now
    return 0.0


def watched_reading(tool: Numbers, memory: Numbers, reading: Numbers, now: float) -> int:
    """The channel that has stood still for longer than its noise and its quantum allow, 6 for all together, or -1.

    Where all six repeat the reading itself was repeated, as a driver does that runs faster than the sensor; that
    is a fault only where it lasts.
    """
    same = 0
    while same < 6 and reading[same] == memory[slot.LAST + same]:
        same += 1
    since = now - memory[slot.NEW_TIME]
    if same == 6:
        chance = 0.0
        for k in range(6):
            chance -= memory[slot.LOG_SAME + k]
        allowed = max(LEAST_REPEATS, CHANCE_OF_REPEATS / chance) if chance > 0.0 else inf
        return 6 if since > max(0.2, 20.0 * memory[slot.NEW_USUAL], allowed * min(memory[slot.NEW_USUAL], 0.01)) else -1
    memory[slot.NEW_USUAL] += 0.05 * (min(since, 1.0) - memory[slot.NEW_USUAL])
    memory[slot.NEW_TIME] = now
    stuck = -1
    for k in range(6):
        value = reading[k]
        step = abs(value - memory[slot.LAST + k])
        if step == 0.0:
            memory[slot.REPEATS + k] += 1.0
            allowed = CHANCE_OF_REPEATS / -memory[slot.LOG_SAME + k] if memory[slot.LOG_SAME + k] < 0.0 else inf
            if memory[slot.REPEATS + k] > max(LEAST_REPEATS, allowed):
                stuck = k
        else:
            memory[slot.REPEATS + k] = 0.0
            memory[slot.LAST + k] = value
            if step < memory[slot.QUANTUM + k]:
                memory[slot.QUANTUM + k] = step
                same_bin = erf(step / (2.8284271247461903 * tool[slot.NOISE + k]))
                memory[slot.LOG_SAME + k] = log(same_bin) if same_bin > 0.0 else -700.0
    return stuck
