"""What a free tool still reads after compensation: drift of the bias, the calibration's own error. A Kalman filter.

The offset at orientation R is `z = drift + H(R) eta + u(R)`: the drift a random walk; eta, standard normal, the error
of the calibration's parameters (covariance L L^T, H = J(R) L); u what poses differ by for no reason that the model
knows, of which two orientations share less the further they are apart, and nothing of what readings are rounded by.
Only z is estimated. eta and u are *considered* (Schmidt, 1966): their covariance with the error of z is carried along
(of u axis by axis) and they are never updated themselves, so that

- at one orientation z is learned from free samples, the calibration's error there included, and counted once;
- a turn to another orientation brings back exactly the part of that error which is not known there;
- nothing that live data do, a contact taken for drift included, can wear out the calibration.
"""

from __future__ import annotations

from math import asin, exp, inf, log, nan, pi, sqrt

import numpy as np

from ..calibration.calibration import Calibration
from ..errors import InputError
from ..geometry.arrays import Array
from ..geometry.rotations import rotation_angle
from ..model import AXES
from ..samples.poses import SAME_POSE_ANGLE
from ..samples.samples import Samples, require_samples
from ..statistics import square_root
from .noise import SampleNoise, stated_noise
from .state import Matrix, Row, State, kernel

TYPICAL_DRIFT = np.array([0.05, 0.05, 0.05, 0.0025, 0.0025, 0.0025])
"""N and N m: std of a warm sensor's random walk after one hour."""
HOUR = 3600.0
ALIKE = 0.5
"""rad: orientations this far apart share 1/e of what poses differ by."""
DITHER = 4.0 * pi**2
"""Of the mean of what is rounded to steps, with a normal noise: what is left of the error's variance falls as the
exponential of so many variances of the noise, in steps (the first harmonic; Widrow and Kollar, 2008)."""
LEAST_PIVOT = 1e-14
"""Of a covariance, over its diagonal: less is rounding."""
AGE = 300.0
"""s: a calibration is at least as old when the first sample comes, as to 1/f noise."""
LEVEL_KNOWN = 20.0
"""s: over which 1/f noise counts as noise of the samples; by how much more it wanders in longer times, as drift."""
REMNANT = 0.003
"""Of the largest contact wrench: the std of what a sensor still shows when the contact is over."""
CREEP, RECOVERY = 0.1, 60.0
"""s: from which on such a remnant creeps, and after which it stays."""
SETTLED, SETTLED_LATE = 0.5, 2.0
"""s for which free readings stay the same after a contact, and after a long one, before they teach the bias: shorter,
the braking of an arm and the end of a slow release are learned, longer, what strong pushes in a row leave adds up."""
MOST_TO_SETTLE = 10.0
"""Times as long after it, they teach it anyhow: of an arm that shakes they never stay the same."""
SAME_SECONDS = 10.0
"""For which a contact does not change, in sensor axes, before it may be a bias that moved."""
ALL_CREPT = log(1.0 + RECOVERY / CREEP)


def track(s: State, calibration: Calibration, between: Array) -> None:
    """Begin with the offset as a calibration leaves it, none that is known: H (6, q) at the identity, its derivatives
    (6, q, 9) to the nine entries of R, in which the free wrench is linear, and the variances (6,) of what poses differ
    by. eta is turned so that H depends on R in its first q columns only: what the others do looks like drift.
    """
    corners = np.vstack([np.zeros((1, 9)), np.eye(9), np.eye(3).reshape(1, 9)]).reshape(11, 3, 3)
    H = calibration.error_jacobian(corners) @ square_root(calibration.error_covariance)
    slopes = H[1:10] - H[0]
    _, size, turn = np.linalg.svd(slopes.reshape(54, -1))
    turn = turn[: np.sum(size > 1e-12 * size[0])].T
    s.between, s.parameters = between.tolist(), turn.shape[1]
    for into, values in zip(s.H_slope, np.moveaxis(slopes @ turn, 0, -1).tolist(), strict=True):
        into[: len(values)] = values
    start(s, np.zeros(6), H[10] @ H[10].T + np.diag(between), H[10] @ turn, between, np.eye(3), nan)
    s.age = AGE


def start(s: State, mean: Array, covariance: Array, H: Array, between: Array, R_base_flange: Array, now: float) -> None:
    """An offset where nothing of before counts: its `mean` (6,), the `covariance` (6, 6) of its error, and that error's
    covariances `H` (6, q) with eta and `between` (6,) with u.
    """
    s.offset_time, s.age, s.stale, s.clean_blocks = now, 0.0, True, 0
    s.offset[:], s.offset_R[:], s.with_pose[:] = mean.tolist(), R_base_flange.ravel().tolist(), between.tolist()
    for into, values in ((s.offset_covariance, covariance - H @ H.T), (s.with_calibration, H)):
        for row, numbers in zip(into, values.tolist(), strict=True):
            row[: len(numbers)] = numbers


def start_anew(s: State, mean: Array, variance: Array, R_base_flange: Array) -> None:
    """From now on the offset is a mean (6,) of free readings with a variance (6,), at the temperature of now."""
    start(s, mean, np.diag(variance), np.zeros((6, s.parameters)), np.zeros(6), R_base_flange, float(s.time))
    s.to_settle = 0.0
    if s.first_temperature == s.first_temperature:
        s.first_temperature = s.temperature


def poses_differ_by(s: State, between: Array) -> None:
    """Another variance (6,) of what poses differ by, from now on."""
    for k, variance in enumerate(between.tolist()):
        gone = min(s.between[k] - variance, s.with_pose[k])
        s.offset_covariance[k][k] -= gone
        s.with_pose[k] -= gone
        s.between[k] = variance


@kernel
def dot(a: Row, b: Row, n: int) -> float:
    """The sum of n products."""
    total = 0.0
    for k in range(n):
        total += a[k] * b[k]
    return total


@kernel
def crept(s: State, t: float) -> float:
    """How many times its variance the remnant of the last contact has moved by then: at once, and within a minute once
    more, with the logarithm of time, as strain gauges and glue creep.
    """
    return 1.0 + log(1.0 + min(t - s.release, RECOVERY) / CREEP) / ALL_CREPT if t >= s.release else 0.0


@kernel
def rounded_by(s: State, axis: int) -> float:
    """The variance of what an axis is rounded by, as far as its noise does not carry it over the steps: the next load
    is rounded otherwise. Of one that has not moved yet it may be all that poses differ by.
    """
    squared = s.quantum[axis] * s.quantum[axis]
    if squared == inf:
        return s.between[axis]
    return squared / 12.0 * exp(-DITHER * s.noise_variance[axis] / squared) if squared > 0.0 else 0.0


@kernel
def predict(s: State, R: Row, now: float) -> None:
    """Write the offset's `systematic` covariance at another orientation and time, and `moved`, its covariance with eta
    there; and the share of u that is `lost` on the way. A clock that went back adds nothing.
    """
    passed, there = max(now - s.offset_time, 0.0), s.offset_R
    a, b, c = R[0] - there[0], R[1] - there[1], R[2] - there[2]
    d, e, f = R[3] - there[3], R[4] - there[4], R[5] - there[5]
    g, h, i = R[6] - there[6], R[7] - there[7], R[8] - there[8]
    squared = a * a + b * b + c * c + d * d + e * e + f * f + g * g + h * h + i * i
    kept, n = exp(-2.0 / ALIKE * asin(min(1.0, sqrt(squared / 8.0)))), s.parameters
    ages = (passed + s.age) / LEVEL_KNOWN
    wandered = log(1.0 + ages * ages)
    crept_on = max(crept(s, now) - crept(s, s.offset_time), 0.0)
    for row in range(6):
        moved, slopes, before = s.moved[row], s.H_slope[row], s.with_calibration[row]
        for k in range(n):
            m = slopes[k]
            turned = a * m[0] + b * m[1] + c * m[2] + d * m[3] + e * m[4] + f * m[5] + g * m[6] + h * m[7] + i * m[8]
            moved[k] = before[k] + turned
        for k in range(row + 1):
            variance = s.offset_covariance[row][k] + dot(moved, s.moved[k], n)
            s.systematic[row][k] = s.systematic[k][row] = variance
        of_time = s.walk[row] * passed + s.flicker[row] * wandered + s.remnant[row] * crept_on
        between, rounded = s.between[row], rounded_by(s, row)
        s.lost[row] = 1.0 - kept * max(1.0 - rounded / between, 0.0) if between > 0.0 else 0.0
        anew = s.lost[row] * (between - s.with_pose[row]) + max(rounded - between, 0.0)
        s.systematic[row][row] += of_time + 2.0 * anew


@kernel
def learn(s: State, R: Row, now: float, mean: Row, variance: Row) -> None:
    """The mean (6,) of free samples at an orientation and time goes into the offset, with its white noise's variance
    (6,), one axis after the other. The error's covariances with eta and u shrink with it; those two stay as they were.
    """
    predict(s, R, now)
    n, C, moved = s.parameters, s.systematic, s.moved
    s.offset_time, s.age = now, 0.0
    for k in range(9):
        s.offset_R[k] = R[k]
    for i in range(6):
        total, of_eta, found, column = C[i][i] + variance[i], s.of_eta, mean[i] - s.offset[i], s.column
        s.with_pose[i] = (s.with_pose[i] + s.lost[i] * (s.between[i] - s.with_pose[i])) * variance[i] / total
        here, eta_here = C[i], moved[i]
        for k in range(6):
            column[k] = here[k]
        for k in range(n):
            of_eta[k] = eta_here[k]
        for k in range(6):
            gain, row, to_eta = column[k] / total, C[k], moved[k]
            s.offset[k] += gain * found
            for j in range(k + 1):
                row[j] -= gain * column[j]
                C[j][k] = row[j]
            for j in range(n):
                to_eta[j] -= gain * of_eta[j]
    for i in range(6):
        for k in range(n):
            s.with_calibration[i][k] = moved[i][k]
        for k in range(i + 1):
            s.offset_covariance[i][k] = s.offset_covariance[k][i] = C[i][k] - dot(moved[i], moved[k], n)


@kernel
def whiten(covariance: Matrix, noise: Row, W: Matrix) -> None:
    """Write the lower triangular W (6, 6) with `W S W^T = 1` for S, the covariance with the variances of a noise on its
    diagonal: Cholesky's root of S, and then its inverse in place.
    """
    for i in range(6):
        row, variance = W[i], covariance[i][i] + noise[i]
        for j in range(i):
            row[j] = (covariance[i][j] - dot(row, W[j], j)) / W[j][j]
        row[i] = sqrt(max(variance - dot(row, row, i), LEAST_PIVOT * variance))
    for i in range(6):
        row = W[i]
        row[i] = 1.0 / row[i]
        for j in range(i):
            total = 0.0
            for k in range(j, i):
                total += row[k] * W[k][j]
            row[j] = -total * row[i]


LEAST_SAMPLES = 10
MOST_SCATTER = 2.0
"""Times the noise, beyond what chance gives to so few samples."""
MOST_MOVED = 5.0
"""Standard deviations between the means of the two halves."""


def free_mean(calibration: Calibration, samples: Samples, noise: SampleNoise | None) -> tuple[Array, Array, Array]:
    """What the calibration leaves of the samples on average (6,), the variance (6,) of that, and their orientation
    (3, 3). Where no noise is known it is that of the samples. Raises `InputError` where they turn, scatter or move by
    more than noise does, or are too few.
    """
    require_samples(samples)
    n = len(samples)
    if n < LEAST_SAMPLES:
        raise InputError(f"no new zero: found {n} samples, expected at least {LEAST_SAMPLES} at rest")
    R = samples.R_base_flange
    angle = rotation_angle(R[0].T @ R[np.argmax(np.sum((R - R[0]) ** 2, axis=(1, 2)))])
    if angle > SAME_POSE_ANGLE:
        raise InputError(
            f"no new zero: the arm turns by {np.degrees(angle):.2g} deg in these samples, expected at most "
            f"{np.degrees(SAME_POSE_ANGLE):.2g}; hold it still"
        )
    left = calibration.compensate(samples.wrench, R)
    noise = noise or stated_noise(left)
    # A coarse and quiet reading stands at most loads, and at some goes to and fro between two steps: that is rest, too.
    own = np.array([len(np.unique(axis)) == 2 for axis in samples.wrench.T]) * left.var(axis=0, ddof=1)
    scatter = np.sqrt((left.var(axis=0, ddof=1) - own) / noise.of_sample)
    most = MOST_SCATTER * (1.0 + 2.0 / np.sqrt(n))
    if scatter.max() > most:
        axis = int(np.argmax(scatter))
        raise InputError(
            f"no new zero: {AXES[axis]} scatters {scatter[axis]:.3g} times its noise, expected at most {most:.2g}; "
            "keep everything away from the tool, and the arm still"
        )
    half = n // 2
    std = np.sqrt(2.0 * (noise.allan_of(np.array([half]))[0] + own / half))
    moved = np.abs(left[:half].mean(axis=0) - left[half:].mean(axis=0)) / std
    if moved.max() > MOST_MOVED:
        axis = int(np.argmax(moved))
        raise InputError(
            f"no new zero: {AXES[axis]} moves by {moved[axis]:.3g} standard deviations between the halves of these "
            f"samples, expected at most {MOST_MOVED:g}; wait until nothing touches the tool"
        )
    return left.mean(axis=0), noise.of_mean(n), R[half]


def require_let_go(s: State) -> None:
    """Raise `InputError` in a contact whose beginning was seen, unless it has stayed the same for long."""
    if s.touching and s.onset_seen and not s.time - s.same_since >= SAME_SECONDS:
        raise InputError(
            f"no new zero: in contact since t = {s.onset:g} s, expected a free tool; let go of it, or, if "
            "nothing touches it, reset() first"
        )
