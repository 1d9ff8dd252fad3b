"""Errors that go with the orientation: of the sensor, of cables. Neighbouring poses have them in common.

Taken for independent from pose to pose they would make a calibration far too sure: in a cone the same error comes with
every pose, and what is learned there does not hold elsewhere. Each is a kernel as a bias that moves is (bias_drift.py).
"""

from __future__ import annotations

import numpy as np

from ..calibration.findings import Kind
from ..geometry.arrays import Array
from ..model import gravity_in_flange
from .bias_drift import Drift

ODDS = {Kind.GAIN: 0.4, Kind.CREEP: 0.2, Kind.CABLE: 0.2}
"""Before the readings, against independent errors: sensors and cables err less often."""

FIELD_LENGTH, MOST_WITH_CABLE = 0.5, 100
"""rad over which the pull of a cable changes; with more poses, taken on the way most often, none is looked for."""


def orientation_errors(
    R_base_flange: Array, gravity_direction: Array, in_order: float
) -> tuple[list[Drift], list[float]]:
    """Errors of sensor and cable that poses may have by their orientation, and the logarithm of the odds of each: gain
    and cross-talk, creep, a cable; `in_order`: the probability that poses are.
    """
    r = gravity_in_flange(R_base_flange, gravity_direction)
    drifts = [Drift(Kind.GAIN, r), Drift(Kind.CREEP, np.diff(-r, axis=0, prepend=-r[:1]))]
    odds = [ODDS[Kind.GAIN], ODDS[Kind.CREEP] * in_order]
    if len(r) <= MOST_WITH_CABLE:
        flat = R_base_flange.reshape(-1, 9)
        chord = np.maximum(6.0 - 2.0 * flat @ flat.T, 0.0)  # ||R_i - R_j||^2, about twice the squared angle
        values, vectors = np.linalg.eigh(np.exp(-chord / (4.0 * FIELD_LENGTH**2)))
        seen = values > 1e-6 * values[-1]
        drifts.append(Drift(Kind.CABLE, vectors[:, seen] * np.sqrt(values[seen])))
        odds.append(ODDS[Kind.CABLE])
    return drifts, np.log(odds).tolist()
