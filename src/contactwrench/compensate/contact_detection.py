"""Is something touching? Chi-square of a contact wrench against its own covariance, at a stated false-alarm rate; when
a contact begins and ends, and what it was.
"""

from __future__ import annotations

from functools import lru_cache
from math import log, nan, sqrt
from typing import Any

import numpy as np

from ..geometry.arrays import Array, read_only
from ..geometry.ranges import Range
from ..samples.poses import SAME_POSE_ANGLE
from .bias_tracking import CREEP, RECOVERY, REMNANT, SAME_SECONDS, SETTLED, SETTLED_LATE, predict, whiten
from .contact_wrenches import FREE, TOUCHING, Contact
from .faults import FINE, SAME
from .noise import SampleNoise, learn_noise
from .shaking import LINEAR, of_motion, weigh_stray
from .state import COVARIANCE, ENDED, THRESHOLDS, Matrix, Row, Sample, State, kernel

RELEASE_RATE = 0.01
"""A contact is over when the statistic falls to what this share of free samples exceeds."""
ONSET_RATE = 0.01
"""Of the false-alarm rate: a run of samples is a contact where one of them is as rare as that."""
TURNED_FAR = 0.0152
"""Squared distance |R - R'|^2 at which covariances are computed anew: 2 angle^2 for 5 degrees."""
LEARN_FIRST, LEARN_LAST = 1.0, 32.0
"""s of free samples, from which the noise is learned; anew whenever they are twice as many, up to the last."""
SAMPLES_OF_END = 10.0
"""In which, and half a second, a contact that changes may end by what the bias may have moved since it began."""
SAME_SHARE, SAME_POSE = 0.03, 2.0 * SAME_POSE_ANGLE**2
"""Of force and torque, by which what may be a bias that moved may change while the arm turns."""
FIRST_LOG_DOF, LAST_LOG_DOF = log(0.5), log(1e6)


def thresholds(false_alarm_rate: float) -> tuple[Array, Array, Array]:
    """Of the statistic, over the logarithm of the degrees of freedom behind its covariance: above the first a sample is
    taken for a contact, below the second for free, and one above the third makes a contact of its run. For 6 axes:
    6 F(6, dof), chi-square where the covariance is known.

    Raises `InputError` unless the rate lies between 1e-9 and `RELEASE_RATE`.
    """
    return _thresholds(float(Range(1e-9, RELEASE_RATE, "per sample").require(false_alarm_rate, "false-alarm rate")))


@lru_cache(8)
def _thresholds(false_alarm_rate: float) -> tuple[Array, Array, Array]:
    from scipy.special import fdtri

    dof = np.exp(np.linspace(FIRST_LOG_DOF, LAST_LOG_DOF, THRESHOLDS))
    rates = (false_alarm_rate, RELEASE_RATE, ONSET_RATE * false_alarm_rate)
    contact, release, onset = (read_only(6.0 * fdtri(6.0, dof, 1.0 - rate)) for rate in rates)
    return contact, release, onset


@kernel
def threshold_at(table: Row, dof: float) -> float:
    """A threshold between its knots; `dof` 0: the covariance is known."""
    if dof == 0.0:
        return table[THRESHOLDS - 1]
    place = (log(dof) - FIRST_LOG_DOF) * ((THRESHOLDS - 1) / (LAST_LOG_DOF - FIRST_LOG_DOF))
    place = min(max(place, 0.0), THRESHOLDS - 1.0)
    knot = min(int(place), THRESHOLDS - 2)
    return table[knot] + (place - knot) * (table[knot + 1] - table[knot])


@kernel
def satterthwaite(W: Matrix, estimated: Matrix, dof: float) -> float:
    """Degrees of freedom behind a covariance of which the part `estimated` (6, 6) rests on `dof` (0: all is known) and
    the rest is known, by its mean share of the variance (Satterthwaite, 1946).
    """
    if dof == 0.0:
        return 0.0
    share = 0.0
    for i in range(6):
        row = W[i]
        for j in range(i + 1):
            along = 0.0
            for k in range(i + 1):
                along += estimated[j][k] * row[k]
            share += row[j] * along
    share = min(share / 6.0, 1.0)
    return dof / max(share * share, 1e-12)


@kernel
def far(s: State) -> bool:
    """Whether the orientation is too far from the one that the covariances belong to."""
    R, there = s.R, s.covariance_R
    squared = 0.0
    for k in range(9):
        apart = R[k] - there[k]
        squared += apart * apart
    return squared > TURNED_FAR


@kernel
def renew_covariance(s: State, sample: Sample, restart: bool, inertia: bool | None) -> None:
    """The covariance of the contact wrench where and when the sample comes; one with which all starts anew ends it."""
    if restart:
        s.since_fresh = s.clean_blocks = 0
        if s.touching:
            end_contact(s, sample, s.time)
    if s.offset_time != s.offset_time:
        s.offset_time = sample.time
    held, settled = readings_held(s), s.since_fresh >= s.settled
    for k in range(6):
        s.noise_left[k] = min(s.noise_filtered[k] * held, s.noise_variance[k]) if settled else s.noise_variance[k]
    if s.touching:
        predict(s, s.R, s.onset)
        whiten(s.systematic, s.noise_left, s.whitening_then)
    predict(s, s.R, sample.time)
    for k in range(6):
        s.wrench_std[k] = sqrt(s.systematic[k][k] + s.noise_left[k]) if s.knows_noise else nan
    whiten(s.systematic, s.noise_left, s.whitening)
    if inertia is not None:
        weigh_stray(s, s.D, LINEAR)
    else:
        weigh_stray(s, s.B, 0)
    dof = satterthwaite(s.whitening, s.systematic, s.dof)
    s.fire, s.end, s.begin = threshold_at(s.fires, dof), threshold_at(s.ends, dof), threshold_at(s.begins, dof)
    for k in range(9):
        s.covariance_R[k] = s.R[k]
    s.stale, s.covariance_time = False, sample.time
    sample.events |= COVARIANCE


@kernel
def statistic_of(f: Row, W: Matrix) -> float:
    """`|W f|^2` of a contact wrench f; written out, as a loop costs plain Python twice as much."""
    fx, fy, fz, tx, ty, tz = f[0], f[1], f[2], f[3], f[4], f[5]
    b, c, d, e, g = W[1], W[2], W[3], W[4], W[5]
    u = W[0][0] * fx
    v = b[0] * fx + b[1] * fy
    w = c[0] * fx + c[1] * fy + c[2] * fz
    x = d[0] * fx + d[1] * fy + d[2] * fz + d[3] * tx
    y = e[0] * fx + e[1] * fy + e[2] * fz + e[3] * tx + e[4] * ty
    z = g[0] * fx + g[1] * fy + g[2] * fz + g[3] * tx + g[4] * ty + g[5] * tz
    return u * u + v * v + w * w + x * x + y * y + z * z


@kernel
def judge(s: State, sample: Sample, recovers: bool) -> tuple[int, float]:
    """Whether something touches, once the noise is known; what is to be said of the sample, with a figure."""
    said, detail = FINE, 0.0
    if s.learn_next <= LEARN_LAST and not s.touching and s.run == 0:
        said, detail = learn_noise(s, sample)
    if not s.knows_noise:
        s.spoiled, sample.statistic = True, nan
        return said, detail
    if not recovers:
        detect(s, sample)
    sample.contact = TOUCHING if s.touching else FREE
    if s.touching and s.time - s.same_since >= SAME_SECONDS:
        return SAME, s.time - s.same_since
    return said, detail


@kernel
def detect(s: State, sample: Sample) -> None:
    """The contact, with hysteresis: it begins with the first of a run of samples above one threshold, and ends with the
    first of a run below another, raised by what is left of the contact when it is over; a run lasts the minimum
    duration, and two samples. What stays the same is not over because the bias is known worse and worse: it is held
    against what was known as it began.
    """
    end = sqrt(s.end) + REMNANT * sqrt(s.peak_statistic) if s.touching else 0.0
    now, above = sample.time, sample.statistic > (end * end if s.touching else s.fire)
    ends_in = SETTLED + s.minimum_duration + (SAMPLES_OF_END + s.settled) * s.interval
    if s.touching and not above and now - s.same_since >= ends_in:
        above = statistic_of(sample.wrench, s.whitening_then) > end * end
    if not s.touching and not above:
        s.run = 0
        if s.free_time != s.free_time:
            s.free_time = now
        elif now - s.free_time >= s.minimum_duration:
            s.known_free = True
        return
    s.spoiled = True
    if not s.touching:
        s.free_time = nan
        if s.run == 0:
            s.onset = now
            s.contact_rows = 0.0
            s.peak_statistic = -1.0
            for k in range(6):
                s.contact_sum[k] = 0.0
        s.run += 1
        gather(s, sample)
        if s.run >= 2 and now - s.onset >= s.minimum_duration and s.peak_statistic > s.begin:
            s.touching, s.stale, s.same_since = True, True, nan
            s.onset_seen = s.known_free
            s.quiet = 0
        return
    if above:
        s.quiet = 0
        gather(s, sample)
        return
    if s.quiet == 0:
        s.free_time = now
    s.quiet += 1
    if s.quiet >= 2 and now - s.free_time >= s.minimum_duration:
        s.run = 0
        s.known_free = True
        end_contact(s, sample, s.free_time)


@kernel
def gather(s: State, sample: Sample) -> None:
    """Add a sample to the contact's mean, and keep the one that stands out most."""
    s.contact_rows += 1.0
    stands_out = sample.statistic > s.peak_statistic
    if stands_out:
        s.peak_statistic = sample.statistic
    wrench, total, peak = sample.wrench, s.contact_sum, s.peak
    for k in range(6):
        total[k] += wrench[k]
        if stands_out:
            peak[k] = wrench[k]


@kernel
def end_contact(s: State, sample: Sample, now: float) -> None:
    """The contact is over; its covariance is the one of before a gap. Where it may have moved the bias by more than the
    noise of a block, free samples are learned from until nothing creeps.
    """
    s.touching, s.stale, s.same_since = False, True, nan
    s.to_settle = SETTLED if now - s.onset < RECOVERY else SETTLED_LATE
    kept = 1.0 / (1.0 + (now - s.release) / CREEP) if s.offset_time > s.release else 1.0
    s.release = now
    for group in range(0, 6, 3):
        x, y, z = s.peak[group], s.peak[group + 1], s.peak[group + 2]
        left = REMNANT * REMNANT * (x * x + y * y + z * z)
        for k in range(group, group + 3):
            remnant = s.remnant[k] = left + kept * s.remnant[k]
            if remnant > s.block_noise[k]:
                s.follow_until = now + RECOVERY
    sample.events |= ENDED
    for i in range(6):
        for k in range(6):
            s.contact_covariance[i][k] = s.systematic[i][k]


@kernel
def stays_the_same(s: State, mean: Row) -> None:
    """Note since when a contact has not changed by more than noise, nor, while the arm turns, than a share of it; its
    mean (6,) over a block.
    """
    moved = turned = 0.0
    for k in range(9):
        step = s.R[k] - s.same_R[k]
        turned += step * step
    share = SAME_SHARE if turned > SAME_POSE else 0.0
    for group in range(0, 6, 3):
        x, y, z = s.same_mean[group], s.same_mean[group + 1], s.same_mean[group + 2]
        most = share * sqrt(x * x + y * y + z * z)
        for k in range(group, group + 3):
            apart = max(abs(mean[k] - s.same_mean[k]) - most, 0.0)
            moved += apart * apart / (2.0 * s.block_noise[k])
    if s.same_since == s.same_since and moved < (s.begin if s.touching else s.end):
        return
    s.same_since = s.block_time
    for k in range(6):
        s.same_mean[k] = mean[k]
    for k in range(9):
        s.same_R[k] = s.R[k]


@kernel
def readings_held(s: State) -> float:
    """For how many samples one reading of the sensor stands, where a driver repeats each: so much less do a filter
    and a mean reduce the noise.
    """
    held = s.new_usual / s.interval
    return held if held > 1.5 else 1.0


def covariance_of(s: Any) -> Array:
    """Of the contact wrench (6, 6), as it was renewed last."""
    return np.array(s.systematic) + np.diag(s.noise_left)


def contact_so_far(s: Any, noise: SampleNoise, release: float | None) -> Contact:
    """The contact that lasts (`release` None), or the one that ended with the last sample."""
    rows = float(s.contact_rows)
    of_mean = np.minimum(noise.of_mean(rows) * readings_held(s), noise.of_sample)
    covariance = np.array(s.systematic if release is None else s.contact_covariance) + np.diag(of_mean) + of_motion(s)
    mean = np.array(s.contact_sum) / rows
    return Contact(float(s.onset), release, np.array(s.peak), mean, covariance, bool(s.onset_seen))
