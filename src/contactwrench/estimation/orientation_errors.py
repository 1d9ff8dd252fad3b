"""Errors that go with the orientation: of the sensor, of the robot, of cables. Neighbouring poses have them in common.

Taken for independent from pose to pose they would make a calibration far too sure: in a cone the same error comes with
every pose, and what is learned there does not hold elsewhere. Each is a covariance across poses with a strength in
units of the noise, beside those of a bias that moves (bias_drift.py): none is chosen, all are in the mean.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..calibration.fields import Kind
from ..geometry.arrays import Array
from ..model import gravity_in_flange
from .bias_drift import Drift

PROBABILITY = {Kind.GAIN: 0.2, Kind.CABLE: 0.1, Kind.ROBOT: 0.1}
FIELD_LENGTH = 0.5
"""rad over which the pull of a cable changes."""

CORRELATION = 0.85
"""Of the robot's error in orientation from one pose to the next."""

MOST_POSES = 100
"""With more, poses taken on the way most often, only the sensor's gain is looked for."""


def orientation_errors(R_base_flange: Array, gravity_direction: Array) -> tuple[Drift, ...]:
    """Columns (n, q) of unit strength: of gain and cross-talk, of a cable, of the robot's orientation."""
    n = len(R_base_flange)
    r = gravity_in_flange(R_base_flange, gravity_direction)
    gain = Drift(Kind.GAIN, r)
    if n > MOST_POSES:
        return (gain,)
    flat = R_base_flange.reshape(n, 9)
    chord = np.maximum(6.0 - 2.0 * flat @ flat.T, 0.0)  # ||R_i - R_j||^2, about twice the squared angle
    cable = np.exp(-chord / (4.0 * FIELD_LENGTH**2))
    apart = np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
    robot = CORRELATION**apart * (r @ r.T)
    return gain, Drift(Kind.CABLE, _root(cable)), Drift(Kind.ROBOT, _root(robot))


def _root(covariance: Array) -> Array:
    """L (n, q) with `L @ L.T` the covariance."""
    values, vectors = np.linalg.eigh(covariance)
    seen = values > 1e-6 * values[-1]
    return np.asarray(vectors[:, seen] * np.sqrt(values[seen]))


def two_levels(low: NDArray[np.bool_]) -> Drift:
    """A bias that comes back in two levels, as backlash has: poses of the lower one (n,) and the others, the constant
    halfway between.
    """
    return Drift(Kind.TWO_LEVELS, np.where(low, -0.5, 0.5)[:, None])
