"""One sample: compensate, filter, watch for faults, detect. One source for plain Python and for numba."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import inf, nan, sqrt

from .acceleration import LONGEST_SILENCE
from .bias_tracking import MOST_TO_SETTLE, learn
from .contact_detection import far, judge, readings_held, renew_covariance, statistic_of, stays_the_same
from .contact_wrenches import NOT_JUDGED
from .delay import as_the_wrench_is_stamped, follow_turn
from .faults import BACK, FINE, FROZEN, GAP, NO_MOTION, NO_PAST, OVERLOAD, SILENT, STUCK, standing_still, unreadable
from .filters import low_pass
from .inertia import exerted, follow_motion, take_pose, terms_then
from .noise import BLOCK_SECONDS
from .shaking import explained_in_motion, noise_of_motion
from .state import ANOTHER, MOST_INTERVALS, RATE_FOUND, TERMS, Matrix, Sample, State, kernel

HOTTEST = 1e4
"""K or degrees C: a sensor that says more says nothing, and the last temperature counts."""
RENEW_SECONDS = 5.0
"""After which the covariance counts again what the bias may have moved."""
WRENCH_ALONE, WHOLLY = 1, 2
"""What starts anew with the next good sample."""
ASK = 2
"""What a sample says that is not just fine, `FREE` or `TOUCHING`."""


def taking(digest: str) -> Callable[..., int]:
    """`take`, compiled or not, with the digest of all its files in its closure: by itself numba's cache would not see
    that another file than this one has changed. What it calls it calls itself, as numba optimises a function anew in
    each that is above it.
    """

    def take(
        states: Sequence[State], samples: Sequence[Sample], ring: Matrix, width: int, begin: int, inertia: bool | None
    ) -> int:
        """Take samples from `begin` on, to the first with an event, with orientations of `width` 4 or 9 numbers; how
        many are taken.

        `ring` (k, 7 or 24): times and directions of down, for a delay; times and terms of the motion, and what is felt.
        `inertia`: None where the state knows none: by its type numba leaves out all that is of one, a third of all.
        """
        digest  # noqa: B018
        s = states[0]
        for i in range(begin, len(samples)):
            sample = samples[i]
            sample.events, sample.contact = 0, NOT_JUDGED
            if sample.passed == sample.passed:
                take_pose(s, sample, ring, width, inertia)
                continue
            fault, detail, channel = unreadable(s, sample, width)
            if fault == FINE:
                now, passed, changed = sample.time, sample.time - s.time, turned(s)
                interruption = BACK if passed < 0.0 else GAP if passed > s.longest_gap else FINE
                restart = interruption != FINE or s.time != s.time
                if restart or s.stale or (changed and far(s)):
                    renew_covariance(s, sample, restart, inertia)
                arrive(s, sample, restart)
                fault, detail, channel = standing_still(s, sample, changed)
                if interruption != FINE:
                    fault, detail, channel = interruption, abs(passed), -1
                fresh_pose = restart or (s.fresh == WHOLLY and fault < STUCK)
                if fresh_pose:
                    s.poses_from, s.fresh = now, min(s.fresh, WRENCH_ALONE)
                if fault == FINE and s.delay != 0.0 and now - s.past < s.poses_from:
                    fault, detail = NO_PAST, s.past
                recovers = s.fresh != 0 and fault < STUCK
                look_down(s, ring, now, fresh_pose)
                if inertia is not None:
                    follow_motion(s, sample, ring, fresh_pose)
                    terms_then(s, ring, now, fresh_pose)
                compensate(s, sample, restart or recovers, fresh_pose, inertia)
                weigh(s, sample, passed, restart or recovers, fresh_pose, inertia)
                fault, detail = conclude(s, sample, fault, detail, recovers)
                if now - s.block_time >= BLOCK_SECONDS:
                    end_block(s)
            else:
                s.spoiled = s.spoiled or not sample.time - s.time < max(s.minimum_duration, 1.5 * s.interval)
                for k in range(6):
                    sample.wrench[k] = sample.wrench_std[k] = sample.statistic = nan
            sample.fault, sample.detail, sample.channel, sample.threshold = fault, detail, channel, s.fire
            sample.said = sample.contact if fault == FINE and sample.events == 0 else ASK
            if sample.events != 0:
                return i + 1
        return len(samples)

    return take


@kernel
def turned(s: State) -> bool:
    """Whether the orientation differs from the last one, in any digit."""
    R, last = s.R, s.last_R
    for k in range(9):  # noqa: SIM110, a generator is not compiled
        if R[k] != last[k]:
            return True
    return False


@kernel
def arrive(s: State, sample: Sample, restart: bool) -> None:
    """The sample is taken: count the time since the last, or begin anew, so that nothing of before is compared with
    what comes.
    """
    if not restart:
        s.counted += sample.time - s.time
        s.stamps += 1
        if s.stamps == s.stamps_awaited:
            s.rate_found, s.stamps, s.counted = s.stamps / s.counted, 0, 0.0
            if s.interval < inf:
                s.stamps_awaited = min(2 * s.stamps_awaited, MOST_INTERVALS)
            if not 1.0 / ANOTHER < s.rate_found * s.interval < ANOTHER:
                sample.events |= RATE_FOUND
    s.time = sample.time
    if not restart:
        return
    s.run = 0
    s.free_time = nan
    s.block_time = s.new_time = s.turn_time = sample.time
    s.block_rows = s.speed = 0.0
    s.known_free, s.spoiled, s.steady = False, True, False
    for k in range(6):
        s.block_sum[k] = s.repeats[k] = 0.0
        s.last_reading[k] = sample.reading[k]
    for k in range(9):
        s.last_R[k] = s.R[k]
        s.last_turn[k] = 0.0


@kernel
def look_down(s: State, ring: Matrix, now: float, fresh: bool) -> None:
    """Write `R_base_flange^T d` of the wrench's moment, of length 1 also where the matrix was rounded."""
    d, R, down = s.gravity_direction, s.R, s.down
    a, b, c = d[0], d[1], d[2]
    x = a * R[0] + b * R[3] + c * R[6]
    y = a * R[1] + b * R[4] + c * R[7]
    z = a * R[2] + b * R[5] + c * R[8]
    scale = 1.0 / sqrt(x * x + y * y + z * z)
    down[0], down[1], down[2] = x * scale, y * scale, z * scale
    if s.delay != 0.0:
        as_the_wrench_is_stamped(s, ring, now, fresh)


@kernel
def compensate(s: State, sample: Sample, fresh: bool, fresh_pose: bool, inertia: bool | None) -> None:
    """The contact wrench, filtered: the reading less what the model gives at the wrench's moment, behind the sensor's
    own filter. The model is linear in down as the flange sees it, so three numbers are filtered and not six, and what
    is missed of them.
    """
    down = s.down
    low_pass(s.sensor, s.sensor_memory, down, TERMS if s.delay < 0.0 else 3, fresh_pose)
    x, y, z = down[0], down[1], down[2]
    if abs(sample.temperature) <= HOTTEST:
        s.temperature = sample.temperature
        if s.first_temperature != s.first_temperature:
            s.first_temperature = s.temperature
    warmer = s.temperature - s.first_temperature if s.first_temperature == s.first_temperature else 0.0
    reading, wrench, total, offset, per_kelvin = sample.reading, sample.wrench, s.block_sum, s.offset, s.per_kelvin
    for k in range(6):
        B = s.B[k]
        left = reading[k] - (B[0] * x + B[1] * y + B[2] * z + B[3] + per_kelvin[k] * warmer)
        if inertia is not None:
            left -= exerted(s.D[k], s.seen)
        wrench[k] = left
        s.column[k] = left - offset[k]
        total[k] += s.column[k]
    s.block_rows += 1.0
    low_pass(s.lowpass, s.lowpass_memory, wrench, 6, fresh)
    for k in range(6):  # behind the filter, which would lag where the bias is learned and `std` falls at once
        wrench[k] -= offset[k]


@kernel
def weigh(s: State, sample: Sample, passed: float, fresh: bool, fresh_pose: bool, inertia: bool | None) -> None:
    """The statistic of the contact wrench and its std; in motion both know what is noisier then."""
    moving = follow_turn(s, sample.time, passed, fresh, fresh_pose) or inertia is not None
    growth = 0.0 if inertia is None else noise_of_motion(s, sample, fresh)
    sample.statistic = statistic_of(sample.wrench, s.whitening)
    if moving:
        sample.statistic = (sample.statistic - explained_in_motion(s, sample.wrench)) / (1.0 + growth)
    for k in range(6):
        at_rest = s.wrench_std[k]
        sample.wrench_std[k] = sqrt(at_rest * at_rest + s.of_motion[k]) if moving else at_rest


@kernel
def conclude(s: State, sample: Sample, fault: int, detail: float, recovers: bool) -> tuple[int, float]:
    """Whether something touches, where nothing is wrong; what is to be said of the sample, with a figure."""
    if fault == FINE and s.unknown > 0:
        fault = NO_MOTION
    if fault == FINE and -inf < s.felt_time < sample.time - LONGEST_SILENCE:
        fault, detail = SILENT, sample.time - s.felt_time
    if recovers:
        s.since_fresh, s.stale, s.spoiled = 0, True, True
        s.run = s.quiet = 0
    s.since_fresh += 1
    s.fresh = 0 if fault < STUCK else WHOLLY if fault == FROZEN else max(s.fresh, WRENCH_ALONE)
    if fault == FINE:
        return judge(s, sample, recovers)
    if fault == OVERLOAD and s.knows_noise:
        judge(s, sample, recovers)
    else:
        s.spoiled = True
    return fault, detail


@kernel
def end_block(s: State) -> None:
    """Learn from the block of samples before this one, where it, this one and the one before it were all free: so a
    contact that was too weak at first, or fades, is not taken for drift. After one, what comes is to stay the same for
    a while first: a bias that was not learned for long is known so badly that the end of a slow release passes for
    free, and what was taken for a contact may be a tool that the arm still accelerates.
    """
    rows, clean, mean, follows = s.block_rows, not s.spoiled, s.block_sum, s.follows_bias or s.time < s.follow_until
    for k in range(6):
        mean[k] = mean[k] / rows + s.offset[k]
    stays_the_same(s, mean)
    if s.time - s.same_since >= s.to_settle or s.time - s.release >= MOST_TO_SETTLE * s.to_settle:
        s.to_settle = 0.0
    if follows and clean and s.clean_blocks >= 2 and s.to_settle == 0.0:
        learn(s, s.block_R, s.block_time, s.block_mean, s.block_variance)
    s.clean_blocks = s.clean_blocks + 1 if clean else 0
    held = readings_held(s)
    for k in range(6):
        s.block_mean[k], mean[k] = mean[k], 0.0
        s.block_variance[k] = min(s.block_noise[k] * held, s.noise_variance[k])
    for k in range(9):
        s.block_R[k] = s.last_R[k]
    if follows or s.since_fresh < s.settled + 2.0 * rows or s.time - s.covariance_time > RENEW_SECONDS:
        s.stale = True
    s.block_time = s.time
    s.block_rows = 0.0
    s.spoiled = False
