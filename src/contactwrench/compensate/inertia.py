"""What a moving tool exerts, sample by sample: from one pose to the next its velocity, from those its acceleration.

Of three poses the second difference belongs to the one in the middle, so what is known now is of one pose ago. It is
kept with that pose's time, and looked up at the wrench's: a pose may come with a reading, or by itself. Nothing is
smoothed here: the low-pass of the contact wrench takes reading and model alike. Differences multiply the noise of
poses; what jumps from pose to pose is that noise, and widens the test.
"""

from __future__ import annotations

from math import inf, nan, sqrt

import numpy as np

from ..calibration.calibration import Calibration
from ..calibration.dynamics import ACCELERATION, covariance_of_terms
from .acceleration import feel, take_reading, use_accelerometer
from .delay import keep_terms, looked_up
from .faults import BRAKING, SQUARED_TOLERANCE, from_matrix, from_quaternion, placed_anywhere
from .filters import LowPass, low_pass
from .state import OF_DOWN, TERMS, Matrix, Row, Sample, State, kernel

MEMORY = 0.02
"""Of the mean over jumps, the share of the newest: fifty poses."""
OF_JUMPS = 0.3
"""White noise of poses: the variance of a second difference, 6, over that of how two in a row differ, 20."""
CHANGES, CHANGING = 0.25, 0.016
"""Of the mean over jumps that says how the wrench changes: four poses; or as many as come in so many s, if fewer and if
one jump is like the next, as those of noise are not.
"""
KINDS = (slice(0, 3), slice(3, 9), slice(9, 12))
"""Of terms: angular acceleration, products of the angular velocity, acceleration."""
SLOWEST_POSES = 0.036
"""s: between poses; more tell no acceleration, and for so long at least the same one says that the arm stands."""
REPEATED, NEWEST = 2.5, 0.5
"""Periods, for which a pose may be one that is sent again; of the usual time between poses, the share of the newest."""
STOPPING, BEYOND = 30.0, 100.0
"""m/s^2: no arm stops or starts faster; and no pose that is so far off jumped because an arm did, but for its time."""
SLOW, NEAR = 0.02, 0.002
"""m/s or rad/s, and m or rad: less is no motion."""
TURNED = 0.005
"""rad, from where the place was last told, it not being told since: by less an arm may stand."""


def use_inertia(s: State, calibration: Calibration, sensor_filter: LowPass | None) -> None:
    """What the kernel needs of a calibration that knows it. Three times the largest variance of a kind of term is no
    less than what all of them make together (Cauchy and Schwarz).
    """
    if calibration.dynamics is not None and calibration.mass is not None:
        s.knows_inertia, s.D = True, calibration.dynamics.matrix.tolist()
        s.shaken_by = np.sum(calibration.dynamics.matrix[:, ACCELERATION] ** 2, axis=1).tolist()
        force, torque = calibration.dynamics.motion_noise
        s.shaking = np.square([force / calibration.mass, torque]).tolist()
        of_units = covariance_of_terms(calibration)
        s.uncertain = [[3.0 * float(np.linalg.eigvalsh(C[kind, kind])[-1]) for kind in KINDS] for C in of_units]
        use_accelerometer(s, calibration, sensor_filter)


@kernel
def follow_motion(s: State, sample: Sample, ring: Matrix, fresh: bool) -> None:
    """Take what a sample says of the motion: its terms where they are known, a pose, or what an accelerometer reads
    beside an orientation. With none of them the arm is at rest, unless poses come by themselves.
    """
    if sample.motion[0] == sample.motion[0]:
        for k in range(TERMS):
            s.terms[k] = sample.motion[k]
        s.felt_time, s.felt_off = -inf, 0.0
        keep_terms(s, ring, sample.time, fresh=fresh)
    elif take_reading(s, sample, ring, fresh) if s.feels else placed_anywhere(sample):
        place = s.last_position if s.feels else sample.told
        follow_pose(s, sample, place, ring, inf if fresh else sample.time - s.pose_time)
    elif not s.poses_alone:
        lose_place(s, sample, ring, fresh)


@kernel
def lose_place(s: State, sample: Sample, ring: Matrix, fresh: bool) -> None:
    """No place is told, for more than a moment. Where none ever was, the arm is at rest; where it moved at the last
    one, or has turned since, what it does is not known until three are told again.
    """
    turn = 0.0
    for k in range(9):
        step = s.R[k] - s.pose_R[k]
        turn += 0.5 * (step * step)
    turned, wait = turn > TURNED * TURNED, REPEATED * s.pose_usual if s.pose_usual > 0.0 else SLOWEST_POSES
    said = s.pose_time != s.pose_time and s.unknown > 0
    if not fresh and (said or sample.time - s.pose_time < wait or (s.resting and not turned)):
        return
    moves = s.placed and (turned or (s.poses > 0 and too_fast_to_stop(s)))
    s.unknown = 0 if fresh else 3 if moves else s.unknown
    s.pose_time, s.pose_period, s.resting, s.poses = nan, 0.0, True, 0
    begin_at_rest(s, ring, sample.time, fresh=True)


@kernel
def take_pose(s: State, sample: Sample, ring: Matrix, width: int, inertia: bool | None) -> None:
    """Take a pose that comes by itself, `sample.passed` s after the one before."""
    if inertia is None:
        return
    R = s.R
    squared = from_quaternion(sample.orientation, R) if width == 4 else from_matrix(sample.orientation, R)
    s.pose_repeats += sample.passed
    if abs(squared - 1.0) <= SQUARED_TOLERANCE and placed_anywhere(sample):
        s.poses_alone = True
        follow_pose(s, sample, sample.told, ring, s.pose_repeats)


@kernel
def follow_pose(s: State, sample: Sample, position: Row, ring: Matrix, passed: float) -> None:
    """Take a pose, `s.R` and a position, `passed` s after the last that was another one, and what it says of the
    terms at that one. Where poses stand still though the arm was too fast to stop, go on from somewhere else, or are
    too rare, what it does is not known until three in a row tell it.
    """
    last, R, before = s.last_position, s.R, s.pose_R
    moved = turn = 0.0
    for k in range(3):
        step = position[k] - last[k]
        moved += step * step
    for k in range(9):
        step = R[k] - before[k]
        turn += 0.5 * (step * step)
    moved, turn = sqrt(moved), sqrt(turn)
    if moved == 0.0 and turn == 0.0 and passed < inf:
        stand_still(s, sample, ring, passed)
        return
    if passed <= 0.0:
        return
    usual = s.pose_usual
    if usual == 0.0:
        usual = sample.passed if sample.passed == sample.passed else s.interval
    if further_than_known(s, moved, turn, passed):
        s.unknown = 3
    starts = s.resting and s.unknown == 0 and 0.0 < usual <= SLOWEST_POSES and passed < inf
    if starts and moved <= STOPPING * usual * usual and turn <= BRAKING * usual * usual:
        start(s, sample, position, ring, usual)
    elif s.resting or not passed < 2.0 * SLOWEST_POSES:
        s.poses = 0
        begin_at_rest(s, ring, sample.time, fresh=True)
    else:
        known, s.poses = s.poses, min(s.poses + 1, 3)
        differentiate(s, position, passed, known)
    s.unknown = max(s.unknown - 1, 0)
    s.resting, s.placed = False, True
    if s.poses > 1:
        keep_terms(s, ring, s.pose_time, fresh=False)
    s.pose_time, s.pose_repeats = sample.time, 0.0
    last[0], last[1], last[2] = position[0], position[1], position[2]
    for k in range(9):
        before[k] = R[k]


@kernel
def start(s: State, sample: Sample, position: Row, ring: Matrix, usual: float) -> None:
    """Take the pose by which an arm moves that stood at the one before, `usual` s ago, and from then on."""
    stood = ring[(s.motion_next - 1) % len(ring)][OF_DOWN]
    s.poses, s.pose_period, s.pose_time = 2, usual, max(sample.time - usual, stood)
    if s.pose_time - usual > stood:
        keep_terms(s, ring, s.pose_time - usual, fresh=False)
    differentiate(s, position, usual, 1)
    for k in range(6):  # all that is known of how it changes
        s.trend[k] = s.inertial[k]


@kernel
def stand_still(s: State, sample: Sample, ring: Matrix, passed: float) -> None:
    """Take a pose that has stood for so many s: until it surely is one that is sent again, it says nothing. Where the
    arm was too fast to stop from one pose to the next, what it does is not known.
    """
    usual = REPEATED * s.pose_usual
    if s.poses == 0 or usual == 0.0:
        usual = max(usual, SLOWEST_POSES)
    if s.resting or passed < usual:
        return
    fast = too_fast_to_stop(s)
    s.unknown = 3 if s.poses > 0 and fast else 0
    for k in range(6 if s.unknown > 0 else 0):  # the last jump was none of noise
        s.pose_noise[k] = s.noise_before[k]
    stops = s.poses > 1 and not fast
    if stops:  # by then readings that are late have yet to come from the time before; if no pose was lost
        differentiate(s, s.last_position, s.pose_usual, s.poses)
        keep_terms(s, ring, s.pose_time, fresh=False)
        s.stopping_until = s.pose_time + s.pose_usual
        for k in range(6):
            s.stopping[k] = s.inertial[k]
    s.poses, s.resting = 0, True
    begin_at_rest(s, ring, s.pose_time + s.pose_usual if stops else sample.time, fresh=not stops)


@kernel
def too_fast_to_stop(s: State) -> bool:
    """Whether it moved faster than an arm that stops from one pose to the next."""
    rate, turning, moving = s.rate, 0.0, 0.0
    for k in range(3):
        turning += rate[k] * rate[k]
        moving += rate[3 + k] * rate[3 + k]
    return sqrt(turning) > max(BRAKING * s.pose_usual, SLOW) or sqrt(moving) > max(STOPPING * s.pose_usual, SLOW)


@kernel
def further_than_known(s: State, moved: float, turn: float, passed: float) -> bool:
    """Whether it moved further, m and rad, than an arm that stood does from one pose to the next, or moves while poses
    are too rare; notes how often they come.
    """
    usual = s.pose_usual
    from_rest = s.resting or not passed < 2.0 * SLOWEST_POSES
    squared = usual * usual
    jumped = turn > max(BRAKING * squared, NEAR) or moved > max(STOPPING * squared, NEAR)
    if passed < 1.0 and (jumped or not from_rest):
        s.pose_usual = passed if usual == 0.0 else usual + NEWEST * (passed - usual)
    return (from_rest and jumped and s.pose_time == s.pose_time) or (
        s.pose_usual > SLOWEST_POSES and max(moved, turn) > SLOW * passed
    )


@kernel
def begin_at_rest(s: State, ring: Matrix, now: float, fresh: bool) -> None:
    """Nothing is known of a motion, or there is none; `fresh`: nor of the one before."""
    for k in range(TERMS):
        s.terms[k] = 0.0
    for k in range(6):
        s.rate[k] = s.inertial[k] = s.trend[k] = 0.0
    keep_terms(s, ring, now, fresh)


@kernel
def differentiate(s: State, position: Row, passed: float, known: int) -> None:
    """The velocity from the last pose to this one, `passed` s later; with the one before, if `known`, the terms."""
    R, before, last, rate, terms = s.R, s.pose_R, s.last_position, s.rate, s.terms
    # Half the antisymmetric part of before^T R is the axis times the sine of the turn.
    turn_x = turn_y = turn_z = 0.0
    for k in range(0, 9, 3):
        turn_x += before[k + 2] * R[k + 1] - before[k + 1] * R[k + 2]
        turn_y += before[k] * R[k + 2] - before[k + 2] * R[k]
        turn_z += before[k + 1] * R[k] - before[k] * R[k + 1]
    half, between = 0.5 / passed, 2.0 / (passed + s.pose_period)
    now_x, now_y, now_z = half * turn_x, half * turn_y, half * turn_z
    a, b, c = (position[0] - last[0]) / passed, (position[1] - last[1]) / passed, (position[2] - last[2]) / passed
    if known > 0:
        x, y, z = 0.5 * (now_x + rate[0]), 0.5 * (now_y + rate[1]), 0.5 * (now_z + rate[2])
        now = (now_x, now_y, now_z)
        for k in range(3):
            terms[k] = between * (now[k] - rate[k])
        terms[3], terms[4], terms[5] = x * x, x * y, x * z
        terms[6], terms[7], terms[8] = y * y, y * z, z * z
        d, e, f = between * (a - rate[3]), between * (b - rate[4]), between * (c - rate[5])
        for k in range(3):
            terms[9 + k] = before[k] * d + before[3 + k] * e + before[6 + k] * f
        if d * d + e * e + f * f > BEYOND * BEYOND:
            s.unknown = 3
        jump(s, known > 2 and s.unknown == 0)
    rate[0], rate[1], rate[2], rate[3], rate[4], rate[5] = now_x, now_y, now_z, a, b, c
    s.pose_period = passed


@kernel
def jump(s: State, counts: bool) -> None:
    """By how much the model's wrench differs from that at the pose before: on average that is how it changes, and the
    rest the noise of the poses.
    """
    rare = max(CHANGES, min(s.pose_usual / CHANGING, 1.0))
    for i in range(6):
        wrench = exerted(s.D[i], s.terms)
        off = wrench - s.inertial[i]
        s.inertial[i] = wrench
        if counts:
            s.alike[i] += MEMORY * (off * s.off[i] - s.alike[i])
        s.off[i] = off if s.unknown == 0 else 0.0
        s.trend[i] += (rare if s.alike[i] > 0.0 else CHANGES) * (off - s.trend[i])
        s.noise_before[i] = s.pose_noise[i]
        if counts:
            s.pose_noise[i] += MEMORY * (OF_JUMPS * off * off - s.pose_noise[i])


@kernel
def exerted(row: Row, t: Row) -> float:
    """On an axis, N or N m: the row of D times the terms. Written out it takes half the time of a loop in Python."""
    return (
        row[0] * t[0] + row[1] * t[1] + row[2] * t[2] + row[3] * t[3] + row[4] * t[4] + row[5] * t[5]
        + row[6] * t[6] + row[7] * t[7] + row[8] * t[8] + row[9] * t[9] + row[10] * t[10] + row[11] * t[11]
    )  # fmt: skip


@kernel
def terms_then(s: State, ring: Matrix, now: float, fresh: bool) -> None:
    """The terms at the moment of the wrench, behind the sensor's own filter, into `s.seen`: between two poses whose
    terms are known, else the newest; the acceleration as an accelerometer has it, where one has read.
    """
    seen, first = s.seen, OF_DOWN + 1
    newest = (s.motion_next - 1) % len(ring)
    at, after, share = looked_up(ring, OF_DOWN, s.motion_at, newest, now - s.delay)
    s.motion_at = at
    older, later = ring[at], ring[after]
    for k in range(TERMS):
        seen[k] = older[first + k] + share * (later[first + k] - older[first + k])
    if s.felt_time > -inf:
        feel(s, ring, now)
    elif s.feels:  # of a whole recording, where it was looked up at the wrench's time
        for k in range(9, TERMS):
            seen[k] = s.terms[k]
    low_pass(s.sensor, s.motion_memory, seen, TERMS, fresh)
