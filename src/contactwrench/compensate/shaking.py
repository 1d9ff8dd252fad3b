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
from .state import Sample, State, kernel

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
def whiten_shaking(s: State) -> None:
    """The wrench of a shaking acceleration along each axis, whitened as the contact wrench at rest is, and its Gram
    matrix.
    """
    whitened, gram = s.shaken_whitened, s.shaken_gram
    for i in range(6):
        row = s.whitening[i]
        for axis in range(3):
            total = 0.0
            for k in range(i + 1):
                total += row[k] * s.D[k][LINEAR + axis]
            whitened[i][axis] = total
    for axis in range(3):
        for other in range(axis + 1):
            total = 0.0
            for i in range(6):
                total += whitened[i][axis] * whitened[i][other]
            gram[axis][other] = total


@kernel
def noise_of_motion(s: State, sample: Sample, fresh: bool) -> float:
    """By what share the variance of a contact wrench grows in motion, but for what shakes, on the axis where it grows
    most; writes the variance of the shaking acceleration, `s.shaken`, and all that motion adds to that of the turn,
    `s.of_motion`: what shakes, by what an accelerometer is off, what is not known of the inertia, the noise of poses
    behind the low-pass, which a `fresh` sample begins anew, and by how much the terms are older than the wrench, or
    were for as long as it remembers that.
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
    return most


@kernel
def statistic_in_motion(s: State, sample: Sample, growth: float) -> float:
    """`f^T C^-1 f` of a contact wrench f, for C = (1 + growth) S + shaken L L^T: S its covariance at rest, L (6, 3) the
    wrenches of a shaking acceleration (inversion lemma, in axes whitened by S).
    """
    wrench, gram, power = sample.wrench, s.shaken_gram, s.shaken / (1.0 + growth)
    squared = x = y = z = 0.0
    for i in range(6):
        row, along, white = s.whitening[i], s.shaken_whitened[i], 0.0
        for k in range(i + 1):
            white += row[k] * wrench[k]
        squared += white * white
        x, y, z = x + along[0] * white, y + along[1] * white, z + along[2] * white
    # Cholesky of 1 + power * gram, and forward substitution.
    a = sqrt(1.0 + power * gram[0][0])
    b, c = power * gram[1][0] / a, power * gram[2][0] / a
    d = sqrt(1.0 + power * gram[1][1] - b * b)
    e = (power * gram[2][1] - c * b) / d
    g = sqrt(1.0 + power * gram[2][2] - c * c - e * e)
    x = x / a
    y = (y - b * x) / d
    z = (z - c * x - e * y) / g
    return (squared - power * (x * x + y * y + z * z)) / (1.0 + growth)


def of_motion(s: Any) -> Array:
    """The covariance (6, 6) that motion adds to a contact wrench: force and torque of what shakes go together."""
    along = np.array(s.D)[:, LINEAR:]
    shaken: Array = s.shaken * along @ along.T
    return shaken + np.diag(np.maximum(np.array(s.of_motion) - np.diag(shaken), 0.0))
