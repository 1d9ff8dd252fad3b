"""How drives and links shake the tool: damped modes stirred by noise, the more the faster the arm moves.

Encoders sit before the links and see nothing of it, so that no stated pose has it.
"""

from __future__ import annotations

import numpy as np

from ..geometry.arrays import Array
from .kinematics import flange_pose
from .rig import Rig
from .trajectory import Motion

MODES, DAMPING = (12.0, 30.0), 0.05
"""Hz, of an arm of medium reach, and the share of critical damping; assumed."""


def shaking(rig: Rig, motion: Motion, rng: np.random.Generator) -> Array | None:
    """The tool's acceleration (n, 3), m/s^2, base axes, beside the motion: each mode has half of the mean square. None
    where nothing shakes; a mode that the motion's rate cannot show is left out.
    """
    of_acceleration, of_speed = rig.settings.arm.vibration
    if not of_acceleration and not of_speed:
        return None
    period = float(motion.t[1] - motion.t[0])
    velocity = np.gradient(flange_pose(rig, motion.joints)[1], period, axis=0)
    acceleration = np.linalg.norm(np.gradient(velocity, period, axis=0), axis=1)
    level = of_acceleration * acceleration + of_speed * np.abs(motion.velocity).max(axis=1)
    modes = [_mode(frequency, level, period, rng) for frequency in MODES if frequency < 0.5 / period]
    return np.asarray(np.sqrt(1.0 / len(MODES)) * np.sum(modes, axis=0)) if modes else None


def _mode(frequency: float, level: Array, period: float, rng: np.random.Generator) -> Array:
    """White noise of a `level` (n,) through a resonance (n, 3), as large as the level is where that stays."""
    from scipy.signal import iirpeak, lfilter

    numerator, denominator = iirpeak(frequency, 0.5 / DAMPING, 1.0 / period)
    bandwidth = np.pi * frequency * 2.0 * DAMPING * period
    stirred = level[:, None] * rng.normal(size=(len(level), 3))
    return np.asarray(lfilter(numerator, denominator, stirred, axis=0) / np.sqrt(bandwidth))
