"""What is wrong with a sample: what it shows by itself, and channels or an orientation that stand still."""

from __future__ import annotations

from math import erf, inf, log, sqrt

import numpy as np
from numpy.typing import NDArray

from ..calibration.calibration import Calibration
from ..geometry.ranges import TIME
from ..model import AXES
from ..samples.samples import LARGEST_READING
from .state import Row, Sample, State, kernel

# Up to `SAME` nothing is wrong, from `BACK` on the numbers are computed all the same.
FINE, LEARNING, LEARNED, SAME = range(4)
NO_TIME, REPEATED, NO_READING, NO_ORIENTATION, NO_ROTATION, BACK, GAP = range(4, 11)
OVERLOAD, STUCK, STILL, FROZEN, NO_PAST, NO_MOTION, SILENT = range(11, 18)

UNITS = ("N", "N", "N", "N m", "N m", "N m")

LATEST = TIME.most
MISSING = (9999.0, 99999.0, 999999.0)
"""What files and drivers have, of either sign, where there was no reading; 999 N may be one."""
SQUARED_TOLERANCE = 0.02
"""As in geometry/orientation.py: an orientation may be off unit length by 1 %."""
LEAST_REPEATS, LEAST_SECONDS, FEWEST_REPEATS, NEVER_MOVED = 100.0, 0.5, 20.0, 10.0
"""Of a channel while others move, and s of them where that is less, but so many at the least; times as many of one that
never did, whose noise and quantum are its group's.
"""
CHANCE_OF_REPEATS = 207.0
"""-10 log 1e-9: a run of repeated values that independent noise gives once in 10^9, ten times over, as noise that was
filtered moves that much more slowly."""
BRAKING, FASTEST = 20.0, 20.0
"""rad/s^2 and rad/s: no arm stops a turn faster, and none turns faster: poses that seem to were wrong ones."""
SHARPEST_LASTS = 5.0
"""s: a turn that was seen to change so sharply may end as sharply: where it is looked up between two poses, it changes
from one reading to the next. Longer misses a pose that froze and had leapt before."""
FURTHEST = 1e3
"""m, from the base: no arm's flange."""

REASONS = (
    "",
    "noise unknown: learned from the first second of free samples, until then no contact is judged",
    "noise learned: from {detail:.3g} s of samples that were taken for free; state noise where they were not",
    "contact or bias: nothing has changed for {detail:.3g} s; zero() where nothing touches",
    "time: {detail:g} is no time",
    "time: {detail:.6f} s again",
    "reading: {axis} is {detail:g}",
    "orientation: not a number",
    "orientation: its squared length is {detail:.6g}, expected 1 within 2 %",
    "time: jumped back by {detail:.6g} s",
    "gap: nothing for {detail:.6g} s, filters start anew",
    "overload: {axis} reads {detail:.6g} {unit}, at or beyond its range",
    "stuck: {axis} has not moved for {detail:.0f} readings while others did",
    "stuck: the whole reading has not moved for {detail:.3g} s",
    "frozen: the orientation has not moved for {detail:.3g} s",
    "orientation: that of {detail:.3g} s before, which the delay asks for, is not known yet",
    "frozen: poses stood still, jumped, were too rare or had no place while the arm moved: three in a row tell how",
    "frozen: the accelerometer has read nothing for {detail:.3g} s",
)


class Reason(str):
    """What is wrong with a sample in words; its `kind`, by which samples are counted, the word before the colon where
    none is stated; and the `channel`, -1 where it is of no single one.
    """

    __slots__ = ("channel", "kind")
    kind: str
    channel: int

    def __new__(cls, text: str, kind: str = "", channel: int = -1) -> Reason:
        """A string that knows its kind and channel."""
        reason = super().__new__(cls, text)
        reason.kind, reason.channel = kind or text.partition(":")[0], channel
        return reason

    def __getnewargs__(self) -> tuple[str, str, int]:  # type: ignore[override]
        return str(self), self.kind, self.channel


def reason_of(fault: int, detail: float, channel: int) -> Reason | None:
    """A fault of a sample; None where there is none."""
    if fault == FINE:
        return None
    return Reason(REASONS[fault].format(detail=detail, axis=AXES[channel], unit=UNITS[channel]), channel=channel)


def reasons_of(samples: NDArray[np.void]) -> tuple[Reason | None, ...]:
    """The faults of samples (n,)."""
    reasons: list[Reason | None] = [None] * len(samples)
    rows = np.flatnonzero(samples["fault"])
    each = (samples[name][rows].tolist() for name in ("fault", "detail", "channel"))
    for row, fault, detail, channel in zip(rows.tolist(), *each, strict=True):
        reasons[row] = reason_of(fault, detail, channel)
    return tuple(reasons)


@kernel
def unreadable(s: State, sample: Sample, width: int) -> tuple[int, float, int]:
    """What keeps a sample from being computed at all, with a figure and the channel; writes its rotation matrix."""
    now, reading = sample.time, sample.reading
    if not abs(now) <= LATEST:
        return NO_TIME, now, -1
    if now == s.time:
        return REPEATED, now, -1
    a, b, c, d, e, f = reading[0], reading[1], reading[2], reading[3], reading[4], reading[5]
    if not a * a + b * b + c * c + d * d + e * e + f * f < MISSING[0] * MISSING[0]:
        for k in range(6):
            size = abs(reading[k])
            if not size <= LARGEST_READING or size in MISSING:
                return NO_READING, reading[k], k
    squared = from_quaternion(sample.orientation, s.R) if width == 4 else from_matrix(sample.orientation, s.R)
    if squared - squared != 0.0:
        return NO_ORIENTATION, squared, -1
    if abs(squared - 1.0) > SQUARED_TOLERANCE:
        return NO_ROTATION, squared, -1
    return FINE, 0.0, -1


@kernel
def from_quaternion(quat_xyzw: Row, R: Row) -> float:
    """Write the rotation matrix of a quaternion x, y, z, w; its squared length."""
    x, y, z, w = quat_xyzw[0], quat_xyzw[1], quat_xyzw[2], quat_xyzw[3]
    squared = x * x + y * y + z * z + w * w
    if not abs(squared - 1.0) <= SQUARED_TOLERANCE:
        return squared
    two = 2.0 / squared
    tx, ty, tz = two * x, two * y, two * z
    xx, yy, zz = tx * x, ty * y, tz * z
    xy, xz, yz = tx * y, tx * z, ty * z
    wx, wy, wz = two * w * x, two * w * y, two * w * z
    R[0], R[1], R[2] = 1.0 - yy - zz, xy - wz, xz + wy
    R[3], R[4], R[5] = xy + wz, 1.0 - xx - zz, yz - wx
    R[6], R[7], R[8] = xz - wy, yz + wx, 1.0 - xx - yy
    return squared


@kernel
def from_matrix(given: Row, R: Row) -> float:
    """Write the rotation matrix as it was given, row-major; its squared length, 1 expected, or, where it is not square
    and right-handed, how far it is off in place of that.
    """
    a, b, c = given[0], given[1], given[2]
    d, e, f = given[3], given[4], given[5]
    g, h, i = given[6], given[7], given[8]
    first, second, third = a * a + b * b + c * c, d * d + e * e + f * f, g * g + h * h + i * i
    total = first + second + third
    if total - total != 0.0:
        return total
    worst = first
    for other in (second, third):
        if abs(other - 1.0) > abs(worst - 1.0):
            worst = other
    if not abs(worst - 1.0) <= SQUARED_TOLERANCE:
        return worst
    # The third row of a rotation is the cross product of the others.
    off = abs(g - (b * f - c * e)) + abs(h - (c * d - a * f)) + abs(i - (a * e - b * d))
    if off > 3.0 * SQUARED_TOLERANCE or abs(a * d + b * e + c * f) > SQUARED_TOLERANCE:
        return 1.0 + off + abs(a * d + b * e + c * f)
    for k in range(9):
        R[k] = given[k]
    return worst


@kernel
def placed_anywhere(sample: Sample) -> bool:
    """Whether its position is a place that an arm reaches, at a time."""
    for part in sample.told:
        if not abs(part) < FURTHEST:
            return False
    return abs(sample.time) < inf


@kernel
def standing_still(s: State, sample: Sample, changed: bool) -> tuple[int, float, int]:
    """What else is wrong with a sample that can be computed, with a figure and the channel; notes what moved."""
    frozen, stuck = frozen_for(s, changed, sample.time), stuck_channel(s, sample.reading, sample.time)
    if frozen > 0.0:
        return FROZEN, frozen, -1
    if stuck == 6:
        return STILL, sample.time - s.new_time, -1
    for k in range(6):
        if abs(sample.reading[k]) >= s.ranges[k]:
            return OVERLOAD, sample.reading[k], k
    if stuck >= 0:
        return STUCK, s.repeats[stuck], stuck
    return FINE, 0.0, -1


@kernel
def frozen_for(s: State, changed: bool, now: float) -> float:
    """Take the new orientation over; the time (s) for which it has been frozen, or 0.

    An orientation that repeats is usual: poses come more rarely than readings, and an arm may be quite still. It is
    frozen where it has repeated for longer than poses take to come, although the arm was turning too fast to stop in
    that time; or for much longer than ever before, although at rest it always jittered.
    """
    usual, since = s.turn_usual, now - s.turn_time
    if not changed:
        if s.steady and since > max(5.0 * usual, 0.02):
            return since
        if s.jitter >= 50.0 and since > max(20.0 * usual, 5.0 * s.longest_rest, 0.2):
            return since
        return 0.0
    if since <= 0.0:
        return 0.0
    usual = usual + 0.05 * (min(since, 5.0 * usual) - usual) if usual > 0.0 else since
    R, last, turn = s.R, s.last_R, s.last_turn
    squared = before = along = 0.0
    for k in range(9):
        new = R[k]
        step = new - last[k]
        squared += step * step
        before += turn[k] * turn[k]
        along += step * turn[k]
        turn[k] = step
        last[k] = new
    straight = along > 0.5 * sqrt(squared * before)
    speed = sqrt(0.5 * squared) / since
    s.steady = straight and max(BRAKING, s.sharpest) * max(since, usual) < min(speed, s.speed) < FASTEST
    kink = abs(speed - s.speed) / since if s.speed > 0.0 and max(speed, s.speed) < FASTEST else 0.0
    if kink > s.sharpest or now - s.sharpest_time > SHARPEST_LASTS:
        s.sharpest, s.sharpest_time = kink, now
    s.longest_rest = max(s.longest_rest, since)
    if along < 0.0 and speed < 0.05:
        s.jitter += 1.0
    s.speed = speed
    s.turn_usual = usual
    s.turn_time = now
    return 0.0


def measured_by(calibration: Calibration) -> list[float]:
    """1 for each channel that reads anything but zero at one of the poses, else 0; where none is kept, all do."""
    poses = calibration.fitted_poses
    return np.any([pose.wrench for pose in poses], axis=0).astype(float).tolist() if poses else [1.0] * 6


@kernel
def repeats_allowed(s: State, channel: int) -> float:
    """How often a channel may repeat itself: as often as its noise and its quantum allow, or, where it never moved and
    the others of its group did, ten times as often as those. One that was never anything but zero while others of its
    group are not either, or that was nothing else in the calibration, is not measured.
    """
    allowed = CHANCE_OF_REPEATS / -s.log_same[channel] if s.log_same[channel] < 0.0 else inf
    if s.quantum[channel] == inf:
        group, moved, of_others = channel // 3 * 3, 0, -inf
        for k in range(group, group + 3):
            if s.quantum[k] < inf:
                moved += 1
                of_others = max(of_others, s.log_same[k])
        if moved == 2 and of_others < 0.0 and s.measured[channel] > 0.0:
            allowed = min(allowed, NEVER_MOVED * max(LEAST_REPEATS, CHANCE_OF_REPEATS / -of_others))
        elif s.last_reading[channel] == 0.0:
            allowed = inf
    least = LEAST_REPEATS
    if s.new_usual > 0.0:
        least = min(least, max(FEWEST_REPEATS, LEAST_SECONDS / s.new_usual))
    return max(least, allowed)


@kernel
def stuck_channel(s: State, reading: Row, now: float) -> int:
    """The channel that has stood still for longer than its noise and its quantum allow, 6 for all together, or -1.

    Where all six repeat the reading itself was repeated, as a driver does that runs faster than the sensor; that
    is a fault only where it lasts.
    """
    last, repeats = s.last_reading, s.repeats
    same = 0
    while same < 6 and reading[same] == last[same]:
        same += 1
    since = now - s.new_time
    if same == 6:
        chance = 0.0
        for k in range(6):
            chance -= s.log_same[k]
        allowed = CHANCE_OF_REPEATS / chance if chance > 0.0 else inf
        return 6 if since > max(0.2, 20.0 * s.new_usual, allowed * min(s.new_usual, 0.01)) else -1
    s.new_usual += 0.05 * (min(since, 1.0) - s.new_usual)
    s.new_time = now
    quantum, stuck = s.quantum, -1
    for k in range(6):
        value = reading[k]
        step = abs(value - last[k])
        if step == 0.0:
            repeats[k] += 1.0
            if repeats[k] > repeats_allowed(s, k):
                stuck = k
        else:
            repeats[k] = 0.0
            last[k] = value
            if step < quantum[k]:
                quantum[k], s.stale = step, True
                same_bin = erf(step / sqrt(8.0 * s.noise_variance[k]))
                s.log_same[k] = log(same_bin) if same_bin > 0.0 else -700.0
    return stuck
