"""Inertia, and where the sensor is, from readings in motion; all else is known from the stops already, and stays.

A cut posterior (Plummer 2015): motion has far more readings than the stops and the same faults, and would outvote them
(method, "Motion"). Its likelihood is that of the moments of motion_moments.py, with a variance for each axis and band,
and a weight for each window, so that a push or a shake counts little. Meanwhile the bias may be off by what poses
differ by, the readings a little late and blurred by the sensor's filter, an accelerometer's by its own, and all forces
as much too large as the weight: a sensor's scale, which stops and motion have in common, moves nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..calibration.dynamics import (
    ACCELERATION,
    DYNAMIC_PARAMETERS,
    elements,
    inertial_jacobian,
    inertial_matrix,
    symmetric,
)
from ..geometry.arrays import Array
from ..model import RigidTool, all_but_the_bias, response, response_jacobian, response_of, stepped
from .motion_moments import BENDS, CHANGES, MOTION, ONE, ORIENTATION, REGRESSORS, MotionMoments
from .rigidity import BeyondRigid, beyond_rigid
from .variance_components import inverse_of

GYRATION, GYRATION_STD = 0.05, 0.1
"""m: of the inertia before anything moved, the mass at so far from its centre, and its std."""
OFFSET_STD, STATED_OFFSET_STD = 0.1, 5e-4
"""m, of where the sensor is from the flange: unless it is stated, and as a data sheet or a ruler states it."""
LATE_STD, BLUR_STD = 1e-3, 1e-3
"""s, of what is left of the delay; s^2, of what a filter weakens of a second derivative: one of first order at 4 Hz."""
TOGETHER_STD, SHAKEN_STD, UNKNOWN_STD = 1e-4, 5e-3, 3e-2
"""s, by which accelerations are ahead of the wrench: of positions; of an accelerometer whose delay the shaking of
drives told, which its filter delays otherwise than slow motion; and of one whose delay nothing did, as of a wrench.
"""
SURELY_BELOW = 3.0
"""Standard deviations below zero of a moment of inertia that no body has."""
PASSES, SETTLED = 30, 1e-3
"""At most; and the standard deviations of a step that is none any more."""
OF_ITS_OWN = 0.5
"""Of the numbers in a window: from so many more, as noisy as all windows, its own noise is taken to be."""
LEAST_LEFT = 0.2
"""Of the numbers in a band, whatever the parameters take."""
LATER = BENDS.stop
INERTIA, OFFSET, LATE, BLUR, AHEAD, SLOW = slice(0, 6), slice(6, 9), 9, 10, 11, 12
ROWS = slice(SLOW + 1, SLOW + 13)
"""Places after the tool's parameters; last by how much an accelerometer is misread, three rows [E, e] of four."""
NO_ROWS = np.zeros((4, 4))
"""What positions have: nothing of them is found from stops."""
ANEW = ("weight", "bias_fx", "bias_fy", "bias_fz", "bias_tx", "bias_ty", "bias_tz")
"""Of these what the motion alone would have; of no further interest."""


@dataclass(frozen=True)
class Told:
    """What the motion says of a number: its `value`, and its `std`."""

    value: float
    std: float


@dataclass(frozen=True, eq=False)
class Moved:
    """What the motion tells: `inertia` (3, 3) kg m^2 about the centre of mass, sensor axes; `sensor_offset` (3,) m,
    flange axes; their `covariance` (9, 9) and that with the tool's parameters (9, p), the std (9,) `before` of the
    same, and the `weight` (w, 6) of each window. The RMS `left` (6,) of readings in motion, N and N m, in the bands
    used, and the `blur` of the sensor's filter beside the poses, s^2; by how much an accelerometer is `slow` beside the
    wrench, s^2, and `ahead` of it, s; and the wrench `late` beside the poses, s. What goes `beyond` a rigid tool, which
    is in the covariance. What the tool `weighs` in motion, N, beside the std of that at the stops.
    """

    inertia: Array
    sensor_offset: Array
    covariance: Array
    with_parameters: Array
    before: Array
    weight: Array
    left: Array
    late: Told
    blur: Told
    ahead: Told
    slow: Told
    beyond: BeyondRigid
    weighs: Told

    @property
    def is_negative(self) -> bool:
        """Whether the largest moment of inertia is surely below zero."""
        moments, axes = np.linalg.eigh(self.inertia)
        slope = elements(np.outer(axes[:, -1], axes[:, -1])) * [1.0, 2.0, 2.0, 1.0, 2.0, 1.0]
        return bool(moments[-1] < -SURELY_BELOW * np.sqrt(slope @ self.covariance[:6, :6] @ slope))


@dataclass(frozen=True, eq=False)
class _Point:
    """Where Gauss and Newton are, `timing` (4,) as `Moved` has it from `late` to `slow`; an accelerometer is late or
    ahead by itself, `apart` from the rest.
    """

    tool: RigidTool
    inertia: Array
    sensor_offset: Array
    timing: Array
    apart: bool

    def stepped(self, step: Array, names: tuple[str, ...]) -> _Point:
        of_motion = step[len(names) :]
        return _Point(
            stepped(self.tool, step[: len(names)], names),
            self.inertia + symmetric(of_motion[INERTIA]),
            self.sensor_offset + of_motion[OFFSET],
            self.timing + of_motion[LATE : SLOW + 1],
            self.apart,
        )


def moved(
    tool: RigidTool,
    g: float,
    names: tuple[str, ...],
    covariance: Array,
    noise: Array,
    moments: MotionMoments,
    sensor_offset: Array | None,
    ahead_std: float | None = None,
    of_rows: Array = NO_ROWS,
) -> Moved:
    """The posterior of inertia and offset.

    Args:
        tool: as the stops have it.
        g: m/s^2, by which its weight is its mass.
        names: of its parameters, p.
        covariance: of these (p, p).
        noise: std (6,) by which a pose's reading is off the model, N and N m.
        moments: of the motion.
        sensor_offset: (3,) m, where it is stated.
        ahead_std: s, of by how much an accelerometer is ahead of the wrench; None: positions told the accelerations.
        of_rows: covariance (4, 4) of each row [E, e] by which it is misread at the stops.
    """
    apart = ahead_std is not None
    of_timing = LATE_STD, BLUR_STD, TOGETHER_STD, TOGETHER_STD**2
    if ahead_std is not None:
        of_timing = UNKNOWN_STD, BLUR_STD, ahead_std, BLUR_STD
    p, mass = len(names), tool.weight / g
    before = np.r_[np.full(6, mass * GYRATION_STD**2), np.full(3, OFFSET_STD)]
    begin = np.zeros(3) if sensor_offset is None else sensor_offset
    at = _Point(tool, mass * GYRATION**2 * np.eye(3), begin, np.zeros(4), apart)
    if sensor_offset is not None:
        before[OFFSET] = STATED_OFFSET_STD
    anew = [names.index(name) for name in ANEW]
    stays = [*(k for k in range(p) if k not in anew), *range(p + SLOW + 1, p + ROWS.stop)]
    sought = [*anew, *range(p, p + SLOW + 1)]
    own = slice(len(ANEW), len(ANEW) + len(DYNAMIC_PARAMETERS))
    prior = np.diag(1.0 / np.r_[np.sqrt(covariance[0, 0]), noise, before, of_timing] ** 2)
    weight, of_all = np.ones((len(moments.products), 6)), 0.5 * moments.count * len(moments.products)
    off, spent = np.zeros(len(prior)), np.zeros((6, len(moments.count)))
    of_window = float(moments.count.sum())
    usual = OF_ITS_OWN * of_window
    for _ in range(PASSES):
        left, J = _left_and_jacobian(at, g, names)
        power = np.sum((left @ moments.products) * left, axis=3).transpose(0, 2, 1)
        variance = np.einsum("wa,wab->ab", weight, power) / np.maximum(of_all - spent, LEAST_LEFT * of_all)
        weight = (usual + of_window) / (usual + 2.0 * np.sum(power / variance, axis=2))
        summed = np.tensordot(weight, moments.products, (0, 0))[:, :, :LATER] / variance[:, :, None, None]
        each = J.transpose(0, 2, 1)[:, None] @ summed[..., :LATER] @ J[:, None]
        of_sought = each[:, :, sought][..., sought]
        inverse = inverse_of(prior + of_sought.sum(axis=(0, 1)))
        spent = np.einsum("pq,abqp->ab", inverse, of_sought)
        step = inverse @ (np.einsum("aip,ai->p", J[:, :, sought], np.einsum("abij,aj->ai", summed, left)) - prior @ off)
        off, whole = off + step, np.zeros(p + SLOW + 1)
        whole[sought] = step
        at = at.stepped(whole, names)
        if float(np.max(np.abs(step) / np.sqrt(np.diag(inverse)))) < SETTLED:
            break
    follows = np.zeros((len(DYNAMIC_PARAMETERS), J.shape[2]))
    follows[:, stays] = -(inverse @ each[:, :, sought][..., stays].sum(axis=(0, 1)))[own]
    of_motion = inverse[own, own]
    if apart:
        pull = _pull(left, J[:, :, sought], weight, variance, moments.products)
        of_motion = (inverse @ (prior + pull) @ inverse)[own, own]
        of_motion *= 1.0 + 2.0 / (usual + of_window)  # so much less Student's t tells of a location (Lange 1989)
    of_motion = of_motion - np.outer(inverse[own, 0], inverse[own, 0]) * prior[0, 0]
    follows[:, 0] = inverse[own, 0] * prior[0, 0]
    beyond = beyond_rigid(left, weight, variance, moments)
    if beyond.shows:
        of_motion = beyond.ratio * of_motion
    of_stops = np.zeros((J.shape[2], J.shape[2]))
    of_stops[:p, :p], of_stops[p:, p:][ROWS, ROWS] = covariance, np.kron(np.eye(3), of_rows)
    late, blur, ahead, slow = map(Told, at.timing.tolist(), np.sqrt(np.diag(inverse))[LATE - SLOW - 1 :].tolist())
    return Moved(
        inertia=at.inertia,
        sensor_offset=at.sensor_offset,
        covariance=of_motion + follows @ of_stops @ follows.T,
        with_parameters=(follows @ of_stops)[:, :p],
        before=before,
        weight=weight,
        left=np.sqrt(power.sum(axis=2).mean(axis=0) / moments.rows),
        late=late,
        blur=blur,
        ahead=ahead,
        slow=slow,
        beyond=beyond,
        weighs=Told(at.tool.weight, float(np.sqrt(covariance[0, 0]))),
    )


def _pull(left: Array, J: Array, weight: Array, variance: Array, products: Array) -> Array:
    """Covariance (q, q) of what pulls at the parameters of J (6, 66, q): an axis is noisy together with another by what
    is left of both, as a force that shakes a tool, or an accelerometer's own noise, is in all six. Arguments as in
    `beyond_rigid`.
    """
    half, std = np.sqrt(weight), np.sqrt(variance).T
    pairs = (half[:, :, None] * half[:, None]).reshape(len(half), -1).T
    summed = (pairs @ products.reshape(len(half), -1)).reshape(6, 6, *products.shape[1:])
    cross = np.einsum("ai,acbij,cj->bac", left, summed, left, optimize=True)
    own = np.sqrt(np.einsum("baa->ba", cross)) * std
    share = cross / (own[:, :, None] * own[:, None])
    alike = np.einsum("bac,acbij->acij", share, summed[..., :LATER, :LATER])
    return np.asarray(np.einsum("aip,acij,cjq->pq", J, alike, J, optimize=True))


def _left_and_jacobian(at: _Point, g: float, names: tuple[str, ...]) -> tuple[Array, Array]:
    """What is left of the readings as a combination (6, 72) of the columns of the moments; and the derivative
    (6, 66, p + 12) of the combination that is taken from them, by the tool's parameters `names`, and by the rest.
    """
    p, mass = len(names), at.tool.weight / g
    late, blur, ahead, slow = at.timing
    free = np.zeros((6, REGRESSORS))
    free[:, ORIENTATION], free[:, ONE] = response(at.tool), at.tool.bias
    free[:, MOTION] = inertial_matrix(at.tool, mass, at.inertia, at.sensor_offset)
    of_acceleration, reading = free[:, MOTION][:, ACCELERATION], np.zeros((4, REGRESSORS))
    reading[:3, MOTION][:, ACCELERATION], reading[3, ONE] = np.eye(3), 1.0  # acceleration less gravity, and 1
    reading[:3, ORIENTATION] = -g * response_of(np.eye(3), at.tool.gravity_direction)
    felt = of_acceleration @ reading[:3]
    of_poses = free - felt if at.apart else free
    left = np.hstack([-free, late * of_poses + ahead * felt, slow * felt - blur * of_poses, np.eye(6)])
    of_free = np.zeros((6, REGRESSORS, p + len(DYNAMIC_PARAMETERS)))
    of_free[:, ORIENTATION, all_but_the_bias(names)] = response_jacobian(at.tool, names).transpose(1, 2, 0)
    of_free[range(6), ONE, [names.index(name) for name in ANEW[1:]]] = 1.0
    of_free[:, MOTION] = inertial_jacobian(at.tool, mass, at.inertia, at.sensor_offset, names).transpose(1, 0, 2)
    J = np.zeros((6, LATER, p + ROWS.stop))
    J[:, :, : p + LATE] = np.concatenate([of_free, -late * of_free, blur * of_free], axis=1)
    J[:, CHANGES, p + LATE], J[:, CHANGES, p + AHEAD] = -of_poses, -felt
    J[:, BENDS, p + BLUR], J[:, BENDS, p + SLOW] = of_poses, -felt
    J[:, :REGRESSORS, p + SLOW + 1 :] = -np.einsum("ai,jr->arij", of_acceleration, reading).reshape(6, REGRESSORS, 12)
    return left, J
