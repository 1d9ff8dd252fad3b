"""A finite Fourier series in every joint (Swevers et al., Optimal Robot Excitation and Identification, 1997), which
rises from rest and comes back to rest where it began; how the flange moves then, from link to link (Luh, Walker and
Paul, On-Line Computational Scheme for Mechanical Manipulators, 1980); and within which limits an arm may follow it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..errors import InputError
from ..geometry.arrays import Array, Frozen
from ..geometry.wrench import cross_matrix
from ..samples.flange_motion import FlangeMotion
from .robot_arms import MARGIN, WRIST, Arm, flange_pose

HARMONICS = 5
FASTEST = 2.0
"""Hz, of the last harmonic: drives follow it, links hardly shake, and poses at 50 Hz still tell its acceleration."""
OF_MAKERS = 0.8
"""Of the maker's largest speeds and accelerations, so that no controller stops the motion."""
JOINT_SPEED, JOINT_ACCELERATION = np.deg2rad(60.0), np.deg2rad(300.0)
"""rad/s and rad/s^2, where the maker's are not known: any arm that carries a tool does that."""
TURN_SPEED, TURN_ACCELERATION = np.deg2rad(100.0), np.deg2rad(500.0)
"""rad/s and rad/s^2, of the flange: inertia shows, and cables and grippers bear it."""
FLANGE_SPEED = 0.5
"""m/s: safety settings stop many an arm at 0.75."""
ABOVE, WITHIN = 0.15, 0.1
"""m: the flange over the plane of the base, and from where it starts; more than that tells hardly more."""
LEAST_ROOM = np.deg2rad(10.0)
"""For each joint of the wrist, to both sides: with less, the inertia hardly shows."""


@dataclass(frozen=True, eq=False)
class FourierMotion(Frozen):
    """`start + sum_k sine_k sin(k w t) + cosine_k (cos(k w t) - 1)`, w = 2 pi `frequency`, over whole `periods`.

    `start` (k,) rad; `sine` and `cosine` (HARMONICS, k) rad, with `sum k sine_k = sum k^2 cosine_k = 0`, so that speed
    and acceleration are zero at both ends; `frequency` Hz.
    """

    start: Array
    sine: Array
    cosine: Array
    frequency: float
    periods: int

    @property
    def duration(self) -> float:
        """Of all periods, s."""
        return self.periods / self.frequency

    def at(self, t: Array) -> tuple[Array, Array, Array]:
        """Joints at times (n,), s from its beginning, and their derivatives (n, k): rad, rad/s, rad/s^2."""
        w = 2.0 * np.pi * self.frequency
        shape, slope, curvature = _series(w * t, self.sine, self.cosine)
        return self.start + shape, w * slope, w**2 * curvature


@dataclass(frozen=True, eq=False)
class Limits(Frozen):
    """What a motion of an arm from where it starts keeps.

    `room` (2, k) rad, down and up from the start; `speed` and `acceleration` (k,) rad/s and rad/s^2; the flange's
    height `above` the plane of the base, m, and `within` which distance from where it starts, m.
    """

    room: Array
    speed: Array
    acceleration: Array
    above: float
    within: float

    def reduced(self, part: float) -> Limits:
        """The same with a part of the room."""
        above = self.above + (1.0 - part) * self.within
        return replace(self, room=part * self.room, within=part * self.within, above=above)


def limits_of(arm: Arm, start: Array, above: float = ABOVE, within: float = WITHIN) -> Limits:
    """The limits of a motion from joints `start` (k,), rad. Raises `InputError` where they leave the wrist no room, or
    the flange starts too low.
    """
    room = np.maximum(np.stack([start - arm.limits[:, 0], arm.limits[:, 1] - start]) - MARGIN, 0.0)
    for joint in range(max(len(arm) - WRIST, 0), len(arm)):
        if room[:, joint].min() < LEAST_ROOM:
            degrees = np.rad2deg((room[:, joint].min() + MARGIN, LEAST_ROOM + MARGIN))
            raise InputError(
                f"q{joint + 1} of {arm.name} stands {degrees[0]:.1f} deg from its limit, expected {degrees[1]:.0f} deg "
                "or more, to swing: start elsewhere (--around)"
            )
    height = float(flange_pose(arm, start[None])[1][0, 2])
    if height < above:
        raise InputError(
            f"the flange of {arm.name} starts {height:.3g} m above the plane of its base, expected {above:g} m or "
            "more: start elsewhere (--around), or state --above"
        )
    speed = np.where(np.isnan(arm.max_speed), JOINT_SPEED, OF_MAKERS * arm.max_speed)
    acceleration = np.where(np.isnan(arm.max_acceleration), JOINT_ACCELERATION, OF_MAKERS * arm.max_acceleration)
    return Limits(room, speed, acceleration, above, within)


def fitted_shapes(sine: Array, cosine: Array, limits: Limits, angle: Array) -> tuple[Array, Array, tuple[Array, ...]]:
    """Coefficients (p, HARMONICS, k) as near that begin at rest, each joint's so small that it keeps its room; and the
    shapes at angles (n,), rad, with their derivatives by the angle (p, n, k).
    """
    order = np.arange(1.0, HARMONICS + 1.0)
    sine, cosine = (
        each - weight[:, None] * (np.einsum("h,phk->pk", weight, each) / np.sum(weight**2))[:, None]
        for weight, each in ((order, sine), (order**2, cosine))
    )
    shape, slope, curvature = _series(angle, sine, cosine)
    taken = np.stack([-shape.min(axis=1), shape.max(axis=1)], axis=1)
    scale = np.min(np.minimum(1.0, limits.room / np.maximum(taken, 1e-12)), axis=1)[:, None]
    return scale * sine, scale * cosine, (scale * shape, scale * slope, scale * curvature)


def pace(flange: MovingFlange, slope: Array, curvature: Array, limits: Limits) -> Array:
    """How fast (p,) each of p ways may be gone, in their own unit of progress a second, that no limit of speed or
    acceleration is passed: speeds grow with the pace, accelerations with its square. `flange`: along the ways, p times
    n moments, one way after the other, at the pace 1; `slope` and `curvature` (p, n, k) of the joints by progress.
    """

    def largest(vectors: Array) -> Array:
        return np.asarray(np.linalg.norm(vectors, axis=1).reshape(len(slope), -1).max(axis=1))

    speed = np.max(np.abs(slope).max(axis=1) / limits.speed, axis=1)
    speed = np.maximum(speed, largest(flange.motion.angular_velocity) / TURN_SPEED)
    speed = np.maximum(speed, largest(flange.speed[:, None]) / FLANGE_SPEED)
    acceleration = np.max(np.abs(curvature).max(axis=1) / limits.acceleration, axis=1)
    acceleration = np.maximum(acceleration, largest(flange.motion.angular_acceleration) / TURN_ACCELERATION)
    return np.asarray(1.0 / np.maximum(np.maximum(speed, np.sqrt(acceleration)), 1e-12))


def _series(angle: Array, sine: Array, cosine: Array) -> tuple[Array, Array, Array]:
    """The series (..., n, k) of coefficients (..., HARMONICS, k) at angles (n,), and its derivatives by the angle."""
    order = np.arange(1.0, HARMONICS + 1.0)
    S, C = np.sin(angle[:, None] * order), np.cos(angle[:, None] * order)
    shape = S @ sine + (C - 1.0) @ cosine
    return shape, (order * C) @ sine - (order * S) @ cosine, -(order**2 * S) @ sine - (order**2 * C) @ cosine


@dataclass(frozen=True, eq=False)
class MovingFlange:
    """`motion` of a flange at n moments, its `position` (n, 3) m and `speed` (n,) m/s from the base."""

    motion: FlangeMotion
    position: Array
    speed: Array


def moving_flange(arm: Arm, joints: Array, velocity: Array, acceleration: Array) -> MovingFlange:
    """The flange at joint angles (n, k), rad, with their derivatives (n, k), rad/s and rad/s^2."""
    # Moments are the last axis: numpy then takes a third of the time.
    R = np.broadcast_to(np.eye(3)[..., None], (3, 3, len(joints)))
    position, v, a, omega, alpha = (np.zeros((3, len(joints))) for _ in range(5))
    links = zip(arm.offset[:-1], arm.R_before, arm.axis, joints.T, velocity.T, acceleration.T, strict=True)
    for offset, before, axis, q, speed, faster in links:
        K = cross_matrix(axis)
        # All of the turn I + sin q K + (1 - cos q) K^2, and of both vectors, that does not depend on q.
        still = np.column_stack([before, before @ K, before @ K @ K, before @ axis, offset]).T @ R
        position, v, a = _carried(still[:, 10], position, v, a, omega, alpha)
        R = still[:, :3] + np.sin(q) * still[:, 3:6] + (1.0 - np.cos(q)) * still[:, 6:9]
        along, turning = still[:, 9], still[:, 9] * speed
        alpha = alpha + along * faster + _cross(omega, turning)
        omega = omega + turning
    still = np.column_stack([arm.R_last_flange, arm.offset[-1]]).T @ R
    position, v, a = _carried(still[:, 3], position, v, a, omega, alpha)
    R = still[:, :3]
    omega, alpha, a = (np.einsum("jin,jn->ni", R, each) for each in (omega, alpha, a))
    motion = FlangeMotion(omega, alpha, a, R.transpose(2, 0, 1), np.full(len(joints), fill_value=True))
    return MovingFlange(motion, np.ascontiguousarray(position.T), np.sqrt(np.einsum("in,in->n", v, v)))


def _carried(lever: Array, position: Array, v: Array, a: Array, omega: Array, alpha: Array) -> tuple[Array, ...]:
    """Position, velocity and acceleration (3, n) of a point at the end of a `lever` (3, n) m that turns."""
    around = _cross(omega, lever)
    return position + lever, v + around, a + _cross(alpha, lever) + _cross(omega, around)


def _cross(a: Array, b: Array) -> Array:
    """`a x b` (3, n); numpy's own takes three times as long."""
    return a[[1, 2, 0]] * b[[2, 0, 1]] - a[[2, 0, 1]] * b[[1, 2, 0]]
