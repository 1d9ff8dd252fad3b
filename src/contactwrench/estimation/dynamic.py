"""Inertia, and where the sensor is, from readings in motion; all else is known from the stops already, and stays.

Readings at rest have been judged with care: contacts, a bias that moves, gain, cables. Motion has far more readings and
the same faults, and would outvote them; so what the stops know is taken from the stops alone (a cut posterior, Plummer
2015), and its uncertainty is carried on. The motion has a likelihood of its own: the moments of motion_moments.py under
a noise that has a variance for each axis and band, estimated from what is left, and a weight for each window, so that a
push or a shake counts little. Meanwhile the bias may be off by what poses differ by, and the readings a little late.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..calibration.dynamics import DYNAMIC_PARAMETERS, inertial_jacobian, inertial_matrix, symmetric
from ..geometry.arrays import Array
from ..model import RigidTool, response, response_jacobian
from .motion_moments import CHANGES, MOTION, ONE, ORIENTATION, READINGS, REGRESSORS, MotionMoments

GYRATION, GYRATION_STD = 0.05, 0.1
"""m: of the inertia before anything moved, the mass at so far from its centre, and its std."""
OFFSET_STD, STATED_OFFSET_STD = 0.1, 5e-4
"""m, of where the sensor is from the flange: unless it is stated, and as a data sheet or a ruler states it."""
LATE_STD = 1e-3
"""s: of what is left of the delay."""
PASSES, SETTLED = 30, 1e-3
"""At most; and the standard deviations of a step that is none any more."""
OF_ITS_OWN = 0.5
"""Of the numbers in a window: from so many more, as noisy as all windows, its own noise is taken to be."""
LEAST_LEFT = 0.2
"""Of the numbers in a band, whatever the parameters take."""
LATER = CHANGES.stop
INERTIA, OFFSET, BIAS, LATE = slice(0, 6), slice(6, 9), slice(9, 15), 15
"""Places of what is estimated; the last two are of no further interest."""


@dataclass(frozen=True, eq=False)
class Moved:
    """What the motion tells: `inertia` (3, 3) kg m^2 about the centre of mass, sensor axes; `sensor_offset` (3,) m,
    flange axes; their `covariance` (9, 9) and that with the tool's parameters (9, p), the std (9,) `before` of the
    same, and the `weight` (w, 6) of each window.
    """

    inertia: Array
    sensor_offset: Array
    covariance: Array
    with_parameters: Array
    before: Array
    weight: Array


@dataclass(frozen=True, eq=False)
class _Point:
    """Where Gauss and Newton are."""

    inertia: Array
    sensor_offset: Array
    bias_off: Array
    late: float

    def stepped(self, step: Array) -> _Point:
        return _Point(
            self.inertia + symmetric(step[INERTIA]),
            self.sensor_offset + step[OFFSET],
            self.bias_off + step[BIAS],
            self.late + float(step[LATE]),
        )


def moved(
    tool: RigidTool,
    mass: float,
    names: tuple[str, ...],
    covariance: Array,
    noise: Array,
    moments: MotionMoments,
    sensor_offset: Array | None,
) -> Moved:
    """The posterior of inertia and offset.

    Args:
        tool: as the stops have it.
        mass: its mass, kg.
        names: of its parameters, p.
        covariance: of these (p, p).
        noise: std (6,) by which a pose's reading is off the model, N and N m.
        moments: of the motion.
        sensor_offset: (3,) m, where it is stated.
    """
    before = np.r_[np.full(6, mass * GYRATION_STD**2), np.full(3, OFFSET_STD)]
    at = _Point(mass * GYRATION**2 * np.eye(3), np.zeros(3), np.zeros(6), 0.0)
    if sensor_offset is not None:
        before[OFFSET], at = STATED_OFFSET_STD, replace(at, sensor_offset=sensor_offset)
    information = np.diag(1.0 / np.r_[before, noise, LATE_STD] ** 2)
    weight, of_all = np.ones((len(moments.products), 6)), 0.5 * moments.count * len(moments.products)
    off, spent = np.zeros(len(information)), np.zeros((6, len(moments.count)))
    usual = OF_ITS_OWN * moments.count.sum()
    for _ in range(PASSES):
        left, J = _left(at, tool, mass), _jacobian(at, tool, mass, names)
        power = np.sum((left @ moments.products) * left, axis=3).transpose(0, 2, 1)
        variance = np.einsum("wa,wab->ab", weight, power) / np.maximum(of_all - spent, LEAST_LEFT * of_all)
        weight = (usual + moments.count.sum()) / (usual + 2.0 * np.sum(power / variance, axis=2))
        summed = np.einsum("wa,wbij->abij", weight, moments.products)[:, :, :LATER] / variance[:, :, None, None]
        each = J.transpose(0, 2, 1)[:, None] @ summed[..., :LATER] @ J[:, None]
        own = len(names)
        inverse = _inverse(information + each[:, :, own:, own:].sum(axis=(0, 1)))
        spent = np.einsum("pq,abqp->ab", inverse, each[:, :, own:, own:])
        step = inverse @ (np.einsum("aip,abij,aj->p", J[:, :, own:], summed, left) - information @ off)
        at, off = at.stepped(step), off + step
        if float(np.max(np.abs(step) / np.sqrt(np.diag(inverse)))) < SETTLED:
            break
    follows = -(inverse @ each[:, :, own:, :own].sum(axis=(0, 1)))[: len(DYNAMIC_PARAMETERS)]
    of_motion = inverse[: len(DYNAMIC_PARAMETERS), : len(DYNAMIC_PARAMETERS)]
    with_parameters = follows @ covariance
    total = of_motion + with_parameters @ follows.T
    return Moved(at.inertia, at.sensor_offset, total, with_parameters, before, weight)


def _inverse(information: Array) -> Array:
    unit = 1.0 / np.sqrt(np.diag(information))
    scale = np.outer(unit, unit)
    inverse: Array = np.linalg.inv(information * scale) * scale
    return inverse


def _left(at: _Point, tool: RigidTool, mass: float) -> Array:
    """What is left of the readings as a combination (6, 50) of the columns of the moments."""
    left = np.zeros((6, READINGS.stop))
    left[:, ORIENTATION] = -response(tool)
    left[:, ONE] = -tool.bias - at.bias_off
    left[:, MOTION] = -inertial_matrix(tool, mass, at.inertia, at.sensor_offset)
    left[:, CHANGES] = -at.late * left[:, :REGRESSORS]
    left[:, READINGS] = np.eye(6)
    return left


def _jacobian(at: _Point, tool: RigidTool, mass: float, names: tuple[str, ...]) -> Array:
    """The derivative (6, 44, p + 16) of the free wrench's combination of columns by the tool's parameters `names`, and
    by what is estimated.
    """
    p = len(names)
    J = np.zeros((6, LATER, p + LATE + 1))
    bias = [k for k, name in enumerate(names) if name.startswith("bias")]
    J[:, ORIENTATION, np.delete(np.arange(p), bias)] = response_jacobian(tool, names).transpose(1, 2, 0)
    J[range(6), ONE, bias] = J[range(6), ONE, range(p + BIAS.start, p + BIAS.stop)] = 1.0
    of_motion = inertial_jacobian(tool, mass, at.inertia, at.sensor_offset, names)
    J[:, MOTION, : p + BIAS.start] = of_motion.transpose(1, 0, 2)
    J[:, CHANGES] = -at.late * J[:, :REGRESSORS]
    J[:, CHANGES, p + LATE] = _left(at, tool, mass)[:, :REGRESSORS]
    return J
