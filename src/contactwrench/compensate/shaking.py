"""The test for contact while the arm moves: what is noisier then, and in which directions.

Drives and links shake the tool as a whole: an acceleration that no pose has, alike in all directions. Its wrench is a
force through the centre of mass, so forces and torques are noisy together, three numbers and not six; a contact whose
force goes elsewhere still stands out. Taken for six independent axes that noise would pass the threshold ten times too
often. What the torque about the centre of mass has beside that, and all else that grows in motion, is taken to grow on
every axis as on the one where it grows most. What a low-pass takes of the shaking is not counted, so the test is on the
safe side.
"""

from __future__ import annotations

from dataclasses import replace
from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..calibration.calibration import Calibration
from ..calibration.dynamics import ACCELERATION
from ..geometry.arrays import Array
from ..samples.flange_motion import RINGING, FlangeMotion
from .filters import low_pass
from .state import Matrix, Row, Sample, State, kernel

LINEAR: int = ACCELERATION.start
"""Of the terms, the first of the flange's acceleration."""


def known_motion(calibration: Calibration, orientation: ArrayLike, motion: FlangeMotion) -> tuple[Array, Array]:
    """The terms (n, 12) of a motion, and by how much the variance (n, 6) of a contact wrench grows in it, but for what
    shakes; orientations as of `wrench_std`.
    """
    turns, unshaken = np.asarray(orientation), replace(motion, stirring=np.zeros((len(motion), 2)))
    growth = calibration.wrench_std(turns, unshaken) ** 2 - calibration.wrench_std(turns) ** 2
    return motion.terms, np.maximum(growth, 0.0)


@kernel
def weigh_stray(s: State, wrench_of: Matrix, first: int) -> None:
    """How far a contact wrench lies along each of three that motion makes astray, A (6, 3), weighed by its covariance
    at rest S: `by_stray` (3, 6), A^T S^-1, and `stray_gram` (3, 3), A^T S^-1 A. A are three columns of a matrix, from
    the `first` on: of B, of down that is off; or of D, of an acceleration that shakes.
    """
    for axis in range(3):
        row = s.by_stray[axis]
        for k in range(6):
            row[k] = 0.0
        for i in range(6):
            W, white = s.whitening[i], 0.0
            for k in range(i + 1):
                white += W[k] * wrench_of[k][first + axis]
            for k in range(i + 1):
                row[k] += W[k] * white
        for other in range(3):
            total = 0.0
            for k in range(6):
                total += row[k] * wrench_of[k][first + other]
            s.stray_gram[axis][other] = total


@kernel
def noise_of_motion(s: State, sample: Sample, fresh: bool) -> float:
    """By what share the variance of a contact wrench grows in motion, but for what shakes, on the axis where it grows
    most; writes the variance of the shaking acceleration, `s.shaken`, and `s.stray`, of what has grown a share, in
    place of the turn's; and all that motion adds to that of the turn, `s.of_motion`: what shakes, by what an
    accelerometer is off, what is not known of the inertia, the noise of poses behind the low-pass, which a `fresh`
    sample begins anew, and by how much the terms are older than the wrench, or were for as long as it remembers that.
    """
    terms, most = s.seen, 0.0
    given, of_motion, noise, shaken_by = sample.motion_variance, s.of_motion, s.pose_noise, s.shaken_by
    lag, trend = s.lag, s.trend
    held, octave = s.pose_period / s.interval, 0
    while octave < len(s.pose_gain) - 1 and held > 1.5:
        held, octave = 0.5 * held, octave + 1
    age = sample.time - s.pose_time + s.pose_period - s.delay
    poses_old = max(age, 0.0) / s.pose_period if s.pose_period > 0.0 else 0.0
    turning = terms[3] + terms[6] + terms[8]
    spun = terms[0] * terms[0] + terms[1] * terms[1] + terms[2] * terms[2]
    pushed = terms[9] * terms[9] + terms[10] * terms[10] + terms[11] * terms[11]
    stirred, newest = s.stirred, min(s.interval / RINGING, 1.0)
    stirred[0] += newest * (pushed - stirred[0])
    stirred[1] += newest * (turning - stirred[1])
    of_tool, of_torque = s.shaking[0], s.shaking[1]
    shaken = of_tool[0] * stirred[0] + of_tool[1] * stirred[1] + s.felt_off
    torque = of_torque[0] * stirred[0] + of_torque[1] * stirred[1]
    gain = 1.0 if fresh or s.since_fresh < s.settled else s.pose_gain[octave]
    guessed = 1.0 if sample.time - s.delay < s.stopping_until else 0.0
    for k in range(6):
        lag[k] = poses_old * abs(trend[k]) + guessed * abs(s.stopping[k])
    low_pass(s.lowpass, s.lag_memory, lag, 6, fresh)
    s.shaken = shaken
    for k in range(6):
        if given[k] == given[k]:
            variance = given[k]
        else:
            known, old = s.uncertain[k], max(poses_old * abs(trend[k]), abs(lag[k]))
            variance = gain * noise[k] + old * old
            variance += known[0] * spun + known[1] * turning * turning + known[2] * pushed
        if k > 2:
            variance += torque
        variance += of_motion[k]
        of_motion[k] = variance + shaken * shaken_by[k]
        at_rest = s.systematic[k][k] + s.noise_left[k]
        most = max(most, variance / at_rest)
        if of_motion[k] > at_rest:
            s.spoiled = True
    for i in range(3):
        for k in range(i):
            s.stray[i][k] = 0.0
        s.stray[i][i] = shaken / (1.0 + most)
    return most


@kernel
def explained_in_motion(s: State, wrench: Row) -> float:
    """By how much the statistic of a contact wrench is less, as motion may make some of it: its covariance grows by
    `A L L^T A^T`, where L L^T is `stray`, that of down, or of an acceleration (Woodbury, 1950).
    """
    K, G, to_x, to_y, to_z = s.stray, s.stray_gram, s.by_stray[0], s.by_stray[1], s.by_stray[2]
    x = y = z = 0.0
    for k in range(6):
        felt = wrench[k]
        x, y, z = x + to_x[k] * felt, y + to_y[k] * felt, z + to_z[k] * felt
    # Cholesky's L, of less than full rank where down turns about one axis: rows a; b d; c e f.
    a = sqrt(K[0][0])
    b, c = (K[1][0] / a, K[2][0] / a) if a > 0.0 else (0.0, 0.0)
    d = sqrt(max(K[1][1] - b * b, 0.0))
    e = (K[2][1] - b * c) / d if d > 0.0 else 0.0
    f = sqrt(max(K[2][2] - c * c - e * e, 0.0))
    x, y, z = a * x + b * y + c * z, d * y + e * z, f * z
    # 1 + L^T G L, and Gauss: each row less what the rows before have of it.
    p, q, r = G[0][0] * a + G[0][1] * b + G[0][2] * c, G[0][1] * d + G[0][2] * e, G[0][2] * f
    t, u, v = G[1][0] * a + G[1][1] * b + G[1][2] * c, G[1][1] * d + G[1][2] * e, G[1][2] * f
    g, h, w = G[2][0] * a + G[2][1] * b + G[2][2] * c, G[2][1] * d + G[2][2] * e, G[2][2] * f
    xx, xy, xz = 1.0 + a * p + b * t + c * g, a * q + b * u + c * h, a * r + b * v + c * w
    yy, yz, zz = 1.0 + d * u + e * h - xy * xy / xx, d * v + e * w - xy * xz / xx, 1.0 + f * w - xz * xz / xx
    y, z, zz = y - xy / xx * x, z - xz / xx * x, zz - yz * yz / yy
    z -= yz / yy * y
    return x * x / xx + y * y / yy + z * z / zz


def of_motion(s: Any) -> Array:
    """The covariance (6, 6) that motion adds to a contact wrench: force and torque of what shakes go together."""
    along = np.array(s.D)[:, LINEAR:]
    shaken: Array = s.shaken * along @ along.T
    return shaken + np.diag(np.maximum(np.array(s.of_motion) - np.diag(shaken), 0.0))
