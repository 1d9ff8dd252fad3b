"""The pose at the wrench's moment, where that is stamped later or earlier, and what a delay that is not quite known
leaves of the weight while the arm turns, a wrench along that of the turn; or, of a pose that comes late, that the turn
is another by then.
"""

from __future__ import annotations

from math import ceil, sqrt

import numpy as np

from ..calibration.calibration import Calibration
from ..geometry.arrays import Array
from ..geometry.ranges import DELAY, DELAY_STD, LAG
from ..samples.delay import is_significant
from .filters import LowPass, low_pass
from .state import OF_DOWN, OF_FELT, OF_MOTION, TERMS, Matrix, State, kernel

LEAST_LOOK_BACK = 0.02
"""s: over which the arm's turn is taken that a pose which comes late is carried on with."""
USUAL_DELAY = 0.05
"""s: the scale of delays where nothing tells one."""
TURN_WINDOW = 0.02
"""s: over which a turn is followed; it is over where nothing turns for as long and twice the usual time between poses.
"""
DENSEST = 10_000.0
"""Hz: the ring of past orientations and accelerations has room for this many a second."""
NEXT_TO_NOTHING = 1e-4
"""Of a variance."""


def past_of(s: State, rate: float | None) -> Array:
    """Room for past orientations, and motions and accelerations where they count: as far back as a delay looks."""
    rows = 4 + ceil(max(s.look_back * (s.delay != 0.0), -s.felt_late) * max(DENSEST, 2.0 * (rate or 0.0)))
    return np.zeros((rows, OF_DOWN + OF_MOTION * s.knows_inertia + OF_FELT * s.feels))


def use_delay(
    s: State, calibration: Calibration, sensor_filter: LowPass | None, stated: float | None, std: float | None
) -> None:
    """What the kernel needs of the delay and its std, as stated or as the calibration has them. Raises `InputError`."""
    delay, within = (delay_of(calibration, sensor_filter), DELAY) if stated is None else (stated, LAG)
    s.delay = float(within.require(delay, "delay"))
    known = std_of_delay(calibration) if stated is None else 0.0
    s.delay_std = float(DELAY_STD.require(known if std is None else std, "delay_std"))
    s.look_back = s.delay if s.delay > 0.0 else max(-s.delay, LEAST_LOOK_BACK)
    s.past = s.look_back + max(-s.delay, 0.0)


def delay_of(calibration: Calibration, sensor_filter: LowPass | None = None) -> float:
    """The calibration's delay where its data tell it from zero, else 0; less the lag of a filter that is made up for by
    itself: what was estimated from a motion contains it.
    """
    delay, std = calibration.delay, calibration.delay_std
    if delay is None or std is None or not is_significant(delay, std):
        return 0.0
    return delay - (0.0 if sensor_filter is None else sensor_filter.lag)


def std_of_delay(calibration: Calibration) -> float:
    """By how much (s) a delay as `delay_of` gives it may be off: its std, and all of one that is not told from zero, as
    far as such delays are usual. 0 where nothing was estimated.
    """
    delay, std = calibration.delay, calibration.delay_std
    if delay is None or std is None or is_significant(delay, std):
        return std or 0.0
    told = USUAL_DELAY**2 / (std**2 + USUAL_DELAY**2)
    return float(np.hypot(told * delay, np.sqrt(told) * std))


@kernel
def as_the_wrench_is_stamped(s: State, ring: Matrix, now: float, fresh: bool) -> None:
    """Down in the flange, into `s.down`, as it was when the wrench was measured.

    A wrench that lags belongs to an orientation of before, between two that are kept. For one that leads, the pose
    being late, the turn of the last moments is carried on; that is wrong by half the angular acceleration times
    delay times (delay + the time looked back), as `miss` finds it.
    """
    down = s.down
    newest, s.ring_next, at = room_in(ring, s.ring_next, s.ring_at, fresh)
    entry = ring[newest]
    entry[0], entry[1], entry[2], entry[3] = now, down[0], down[1], down[2]
    at, after, share = looked_up(ring, 0, at, newest, now - s.look_back)
    s.ring_at = at
    older, later = ring[at], ring[after]
    x = older[1] + share * (later[1] - older[1])
    y = older[2] + share * (later[2] - older[2])
    z = older[3] + share * (later[3] - older[3])
    if s.delay < 0.0:
        past = min(s.look_back, now - older[0])
        ahead = -s.delay / past if past > 0.0 else 0.0
        a, b, c = down[0], down[1], down[2]
        x, y, z = a + ahead * (a - x), b + ahead * (b - y), c + ahead * (c - z)
        entry[4], entry[5], entry[6] = x, y, z
        miss(s, ring, newest, now, fresh)
    down[0], down[1], down[2] = x, y, z


@kernel
def miss(s: State, ring: Matrix, newest: int, now: float, fresh: bool) -> None:
    """What was carried on with a delay ago, less what has come of it: so much is missed now too, along that; along
    how it changes, as much as within a delay; and whatever way as much as that changes. All three go beside down, into
    `s.down`, and through the filters that it goes through; none before enough of the past is known.
    """
    down, missed, changed = s.down, s.missed[0], s.missed[1]
    _, _, at = room_in(ring, newest, s.missed_at, fresh)
    at, after, share = looked_up(ring, 0, at, newest, now + s.delay)
    s.missed_at = at
    older, later = ring[at], ring[after]
    since = 0.0 if fresh else now - ring[(newest - 1) % len(ring)][0]
    follows, known = since / (since - s.delay), now - s.past >= s.poses_from
    for k in range(3):
        off = older[4 + k] + share * (later[4 + k] - older[4 + k]) - down[k]
        missed[k] += follows * (off - missed[k])
        change = off - missed[k]
        changed[k] += follows * (change - changed[k])
        down[3 + k] = off if known else 0.0
        down[6 + k] = change if known else 0.0
        down[9 + k] = change - changed[k] if known else 0.0


@kernel
def keep_terms(s: State, ring: Matrix, when: float, fresh: bool) -> None:
    """Put the terms, which are those of a moment, into the ring; a `fresh` one forgets what was before."""
    newest, s.motion_next, s.motion_at = room_in(ring, s.motion_next, s.motion_at, fresh)
    entry = ring[newest]
    entry[OF_DOWN] = when
    for k in range(TERMS):
        entry[OF_DOWN + 1 + k] = s.terms[k]


@kernel
def room_in(ring: Matrix, newest: int, at: int, fresh: bool) -> tuple[int, int, int]:
    """Where in a ring the newest entry goes, and then the next; and from where on to look up, which was `at`: what is
    there may be overwritten. A `fresh` one begins anew.
    """
    after = 1 if fresh else (newest + 1) % len(ring)
    return 0 if fresh else newest, after, 0 if fresh else after if at == newest else at


@kernel
def looked_up(ring: Matrix, column: int, at: int, newest: int, wanted: float) -> tuple[int, int, float]:
    """The entries of a ring before and after a time, `at` or later, and how far it lies between the two. In `column`
    they have their times, s.
    """
    size = len(ring)
    while at != newest and ring[(at + 1) % size][column] <= wanted:
        at = (at + 1) % size
    after = at if at == newest else (at + 1) % size
    older, later = ring[at][column], ring[after][column]
    return at, after, max((wanted - older) / (later - older), 0.0) if later > older else 0.0


@kernel
def follow_turn(s: State, now: float, passed: float, fresh: bool, fresh_pose: bool) -> bool:
    """How fast down turns, behind the sensor's own filter, `passed` s after the sample before, and the wrench (6,) that
    is made of it, behind the low-pass, by a delay one standard deviation off and by the age of an orientation that is
    held; with it what is missed where down is carried on: as a covariance of down, `stray`. Whether they count.
    Nothing is learned of the bias where they are beyond the noise.
    """
    down, last, down_rate, counts = s.down, s.last_down, s.down_rate, False
    if fresh_pose:
        s.followed = s.since_turn = down_rate[0] = down_rate[1] = down_rate[2] = 0.0
    else:
        s.since_turn += passed
    turned = down[0] != last[0] or down[1] != last[1] or down[2] != last[2]
    if s.since_turn > 0.0 and (turned or s.since_turn > TURN_WINDOW + 2.0 * s.turn_usual):
        since = s.since_turn if turned else passed
        s.followed = max(min(s.followed + since, TURN_WINDOW), since)
        for k in range(3):
            down_rate[k] += (down[k] - last[k] - since * down_rate[k]) / s.followed
        s.since_turn = 0.0 if turned else s.since_turn
    age = age_of_orientation(s, now)
    off, lateness = s.turned_by, sqrt(s.delay_std * s.delay_std + age * age)
    for k in range(3):
        last[k] = down[k]
        off[k] = lateness * down_rate[k]
    count = 3
    if s.delay < 0.0:
        count = TERMS
        for k in range(3, TERMS):
            off[k] = down[k]
    low_pass(s.lowpass, s.turn_memory, off, count, fresh or fresh_pose)
    whatever = off[9] * off[9] + off[10] * off[10] + off[11] * off[11]
    for k in range(3):
        for i in range(k + 1):
            s.stray[k][i] = off[k] * off[i] + off[3 + k] * off[3 + i] + off[6 + k] * off[6 + i]
        s.stray[k][k] += whatever
    for k in range(6):
        B, at_rest = s.B[k], s.systematic[k][k] + s.noise_left[k]
        of_motion = whatever * (B[0] * B[0] + B[1] * B[1] + B[2] * B[2])
        for i in range(0, min(count, 9), 3):
            along = B[0] * off[i] + B[1] * off[i + 1] + B[2] * off[i + 2]
            of_motion += along * along
        s.of_motion[k] = of_motion
        counts = counts or of_motion > NEXT_TO_NOTHING * at_rest
        if of_motion > at_rest:
            s.spoiled = True
    return counts


@kernel
def age_of_orientation(s: State, now: float) -> float:
    """For how long (s) the orientation that a reading is taken with has been held at most: of one that is looked up, or
    carried on with, by a delay nobody knows where between two poses it was. Where an inertia is known, poses have their
    own age.
    """
    if s.knows_inertia:
        return 0.0
    if s.delay == 0.0 or s.turn_usual < 1.5 * s.interval:
        return now - s.turn_time
    return s.turn_usual if s.delay > 0.0 else 2.0 * s.turn_usual
