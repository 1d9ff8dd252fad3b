"""What a tool exerts on the sensor because it moves: Newton and Euler (docs/method.md#motion), linear in
`FlangeMotion.terms`, which are of the flange in its own axes the angular acceleration alpha (3), the products of its
angular velocity omega (6) and the acceleration without gravity a (3). So a tool is one matrix D (6, 12), and the free
wrench is `B @ [r, 1] + D @ terms`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ..errors import InputError
from ..geometry.arrays import Array, Frozen, Matrix, Vector, read_only, shaped
from ..geometry.wrench import cross_matrix
from ..model import LINEAR_PARAMETERS, MOUNT, RigidTool
from ..samples.accelerometer import Accelerometer
from ..samples.flange_motion import FlangeMotion
from ..samples.motion import PRODUCTS
from ..statistics import SPOKEN

if TYPE_CHECKING:
    from .fields import CalibrationFields

LEAST_SIZE = 1e-4
"""m: a tool is no smaller in any direction."""
INERTIA = ("inertia_xx", "inertia_xy", "inertia_xz", "inertia_yy", "inertia_yz", "inertia_zz")
SENSOR_OFFSET = ("offset_x", "offset_y", "offset_z")
DYNAMIC_PARAMETERS = (*INERTIA, *SENSOR_OFFSET)
_UNITS = ("N", *["m"] * 3, *["N"] * 3, *["N m"] * 3, "rad", "s", *["kg m^2"] * 6, *["m"] * 3)
UNIT_OF = dict(zip((*LINEAR_PARAMETERS, "yaw", "delay", *DYNAMIC_PARAMETERS), _UNITS, strict=True))
"""The unit of each parameter."""
SPOKEN_UNIT_OF = {name: SPOKEN.get(unit, (1.0, unit)) for name, unit in UNIT_OF.items()}
"""How many of the unit that people speak make one of it, and that unit."""
TERMS = 12
ACCELERATION = slice(9, 12)
SECOND_DERIVATIVES = [*range(3), *range(9, 12)]
"""Places in the terms."""

_UNIT_ALPHA, _UNIT_PRODUCTS, _UNIT_ACCELERATION = np.zeros((TERMS, 3)), np.zeros((TERMS, 3, 3)), np.zeros((TERMS, 3))
_UNIT_ALPHA[:3], _UNIT_ACCELERATION[9:] = np.eye(3), np.eye(3)
for _k, (_i, _j) in enumerate(PRODUCTS):
    _UNIT_PRODUCTS[3 + _k, _i, _j] = _UNIT_PRODUCTS[3 + _k, _j, _i] = 1.0


@dataclass(frozen=True, eq=False)
class Dynamics(Frozen):
    """What a tool that moves has beside a weight, and how well that is known.

    Attributes:
        matrix: D (6, 12), N and N m for each unit of `FlangeMotion.terms`.
        inertia: (3, 3), kg m^2, about the centre of mass, sensor axes.
        sensor_offset: where the sensor's origin is (3,), m from the flange's, or from the accelerometer, flange axes.
        covariance: of inertia xx xy xz yy yz zz and of the offset (9, 9).
        with_parameters: their covariance (9, p) with the calibration's parameters.
        bandwidth: Hz, up to which the motion was told from the noise of the poses.
        motion_noise: std, N and N m, of the force and of the torque about the centre of mass that is there for each
            m/s^2 of the sensor's acceleration and for each rad/s (2, 2), RMS over the last `RINGING` s, in the
            direction in which it is largest: what drives and links shake.
        residual_rms: in motion (6,), N and N m; `static_rms` (6,) what is left without the inertia.
        seconds: of motion that were used.
        accelerometer: how the one sits that told the accelerations; None: positions did.
    """

    matrix: Matrix = field(metadata=shaped(6, TERMS))
    inertia: Matrix = field(metadata=shaped(3, 3))
    sensor_offset: Vector = field(metadata=shaped(3))
    covariance: Matrix = field(metadata=shaped(9, 9))
    with_parameters: Matrix = field(metadata=shaped(9, "p"))
    bandwidth: float
    motion_noise: Matrix = field(metadata=shaped(2, 2, least=0.0))
    residual_rms: Vector = field(metadata=shaped(6, least=0.0))
    static_rms: Vector = field(metadata=shaped(6, least=0.0))
    seconds: float
    accelerometer: Accelerometer | None = None

    @cached_property
    def std(self) -> Array:
        """Standard deviations (9,) of `DYNAMIC_PARAMETERS`."""
        return read_only(np.sqrt(np.diag(self.covariance)))

    def with_covariance(self, of_parameters: Array) -> Array:
        """Covariance (p + 9, p + 9) of the calibration's parameters, whose own is (p, p), and `DYNAMIC_PARAMETERS`."""
        between = self.with_parameters
        return np.block([[of_parameters, between.T], [between, self.covariance]])


def require_same_place(dynamics: Dynamics, motion: FlangeMotion) -> None:
    """Raise `InputError` for a motion of another place than the inertia counts from."""
    of, needs = (
        ("an accelerometer" if by_one else "positions")
        for by_one in (motion.of_accelerometer, dynamics.accelerometer is not None)
    )
    if of != needs:
        raise InputError(
            f"found a motion by {of}, and a calibration by {needs}, expected both by one: take the motion that "
            "contactwrench.compensate.contact_wrenches.motion_of(calibration, samples) gives"
        )


def elements(inertia: Array) -> Array:
    """xx, xy, xz, yy, yz, zz of a symmetric matrix (3, 3)."""
    return np.array([inertia[pair] for pair in PRODUCTS])


def symmetric(elements: Array) -> Array:
    """The matrix (3, 3) of those elements (6,)."""
    xx, xy, xz, yy, yz, zz = elements
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def can_exist(inertia: Array) -> bool:
    """Whether a body has this inertia (3, 3) about its centre of mass: of a density rho >= 0 the second moments are
    positive definite, which says at once that its principal moments obey the triangle inequality (Wensing, Kim and
    Slotine 2018).
    """
    return bool(np.linalg.eigvalsh(second_moments(inertia))[0] >= 0.0)


def second_moments(inertia: Array) -> Array:
    """The integral of rho x x^T about the centre of mass, (3, 3), kg m^2."""
    return np.asarray(0.5 * np.trace(inertia) * np.eye(3) - inertia)


def nearest_possible(inertia: Array, covariance: Array, mass: float) -> tuple[Array, float]:
    """The inertia (3, 3) of a body that can exist which is nearest in standard deviations, and how many these are:
    `covariance` (6, 6) of its elements. Second moments are L L^T with a triangular L (Rucker and Wensing 2022, who take
    the logarithm of its diagonal; that goes to minus infinity for the nearest body, which is flat in some direction).
    """
    from scipy.optimize import least_squares

    whiten = np.linalg.inv(np.linalg.cholesky(covariance))
    wanted, size = elements(inertia), mass * LEAST_SIZE**2

    def inertia_of(lower: Array) -> Array:
        L = np.zeros((3, 3))
        L[np.tril_indices(3)] = lower
        second = mass * (L @ L.T) + size * np.eye(3)
        return np.asarray(np.trace(second) * np.eye(3) - second)

    values, vectors = np.linalg.eigh(second_moments(inertia))
    begin = np.linalg.cholesky((vectors * np.maximum(values / mass, 10.0 * LEAST_SIZE**2)) @ vectors.T)
    first = begin[np.tril_indices(3)]
    found = least_squares(lambda lower: whiten @ (elements(inertia_of(lower)) - wanted), first, x_scale="jac")
    return symmetric(elements(inertia_of(found.x))), float(np.sqrt(2.0 * found.cost))


@dataclass(frozen=True, eq=False)
class Ellipsoid(Frozen):
    """The uniform solid ellipsoid that has a tool's mass and inertia, about its centre of mass.

    `axes`: the principal ones, columns of (3, 3), sensor axes, the least moment first; `moments` of inertia about them
    (3,) and `moment_std` (3,), kg m^2; `semi_axes` (3,) m, with `low` (3,) and `high` (3,) m, where two std less and
    more of their squares are, 0 where that is below.
    """

    axes: Matrix
    moments: Vector
    moment_std: Vector
    semi_axes: Vector
    low: Vector
    high: Vector


def equal_ellipsoid(mass: float, inertia: Array, covariance: Array) -> Ellipsoid:
    """That of a mass, kg, and an inertia (3, 3), kg m^2, about the centre of mass; `covariance` (7, 7) of the mass and
    xx xy xz yy yz zz. A second moment of a uniform ellipsoid is `m a^2 / 5` (Landau and Lifshitz, Mechanics, section
    32): so `a^2` is linear in the inertia, and its std holds for a flat body too, whose semi-axis is near zero.
    """
    moments, axes = np.linalg.eigh(inertia)
    doubled = np.array([1.0, 2.0, 2.0, 1.0, 2.0, 1.0])
    of_moments = doubled * np.array([elements(np.outer(axis, axis)) for axis in axes.T])
    squares = 5.0 / mass * (0.5 * moments.sum() - moments)
    of_squares = 5.0 / mass * (0.5 * elements(np.eye(3)) - of_moments)
    J = np.column_stack([-squares / mass, of_squares])
    std = np.sqrt(np.einsum("ij,jk,ik->i", J, covariance, J))
    low, semi_axes, high = np.sqrt(np.maximum(squares + np.multiply.outer([-2.0, 0.0, 2.0], std), 0.0))
    moment_std = np.sqrt(np.einsum("ij,jk,ik->i", of_moments, covariance[1:, 1:], of_moments))
    return Ellipsoid(axes, moments, moment_std, semi_axes, low, high)


def turning(alpha: Array, products: Array) -> Array:
    """W (k, 3, 3): the acceleration of a point of a turning body from its place, of its angular acceleration (k, 3)
    and the products omega omega^T (k, 3, 3) of its angular velocity.
    """
    return np.asarray(cross_matrix(alpha) + products - np.trace(products, axis1=1, axis2=2)[:, None, None] * np.eye(3))


def inertial_matrix(tool: RigidTool, mass: float, inertia: Array, sensor_offset: Array) -> Array:
    """D (6, 12), N and N m for each unit of `terms`; `mass` kg, the rest as in `Dynamics`."""
    force, alpha, _, products = _unit_motions(tool, mass, sensor_offset)
    torque = force @ cross_matrix(tool.com).T - _spin(inertia, alpha, products)
    return np.concatenate([force, torque], axis=1).T


def inertial_jacobian(
    tool: RigidTool, mass: float, inertia: Array, sensor_offset: Array, names: tuple[str, ...]
) -> Array:
    """Derivative (12, 6, p + 9) of D with respect to the tool's parameters `names`, then `DYNAMIC_PARAMETERS`."""
    force, alpha, W, products = _unit_motions(tool, mass, sensor_offset)
    R_sensor_flange, com = tool.R_flange_sensor.T, cross_matrix(tool.com)
    p = len(names)
    J = np.zeros((TERMS, 6, p + len(DYNAMIC_PARAMETERS)))
    J[:, :3, 0] = force / tool.weight
    J[:, :3, 1:4] = -mass * W
    about = [k for k, name in enumerate(names) if name in (*MOUNT, "yaw")]
    if about:
        turn = np.eye(3)[:, -len(about) :]
        J[:, :3, about] = (cross_matrix(force) + mass * W @ com) @ turn
        for k, axis in zip(about, turn.T, strict=True):
            K = cross_matrix(axis)
            J[:, 3:, k] = -_spin(inertia, alpha @ K, products @ K - K @ products)
    J[:, :3, p + 6 :] = -mass * R_sensor_flange @ turning(_UNIT_ALPHA, _UNIT_PRODUCTS)
    J[:, 3:] += com @ J[:, :3]
    J[:, 3:, 1:4] -= cross_matrix(force)
    for k, unit in enumerate(np.eye(6)):
        J[:, 3:, p + k] = -_spin(symmetric(unit), alpha, products)
    return J


def covariance_of_terms(c: CalibrationFields) -> Array:
    """Of each axis the covariance (6, 12, 12) of what it shows of a motion's terms, by its row of D; zero without
    inertia.
    """
    if c.rigid_tool is None or c.mass is None or c.dynamics is None:
        return np.zeros((6, TERMS, TERMS))
    place = c.dynamics.inertia, c.dynamics.sensor_offset
    J = inertial_jacobian(c.rigid_tool, c.mass, *place, c.parameter_names).transpose(1, 0, 2)
    return J @ c.dynamics.with_covariance(c.covariance) @ J.transpose(0, 2, 1)


def covariance_in_motion(c: CalibrationFields, R_base_flange: Array, motion: FlangeMotion) -> Array:
    """What a motion adds to the covariance (n, 6, 6) of contact wrenches at orientations (n, 3, 3): the inertia's part,
    and what shakes; zero without inertia. Where the motion was guessed, beside a gap, that is all of what the inertia
    does.
    """
    tool, dynamics = c.rigid_tool, c.dynamics
    if tool is None or c.mass is None or dynamics is None:
        return np.zeros((len(R_base_flange), 6, 6))
    require_same_place(dynamics, motion)
    of_terms = inertial_jacobian(tool, c.mass, dynamics.inertia, dynamics.sensor_offset, c.parameter_names)
    J = (motion.terms @ of_terms.reshape(TERMS, -1)).reshape(-1, *of_terms.shape[1:])
    of_tool, own = np.split(J, [len(c.parameter_names)], axis=2)
    of_rest = c.free_wrench_jacobian(R_base_flange)
    half = (0.5 * of_tool + of_rest) @ c.covariance @ of_tool.transpose(0, 2, 1)
    half += 0.5 * own @ dynamics.covariance @ own.transpose(0, 2, 1)
    half += own @ dynamics.with_parameters @ (of_rest + of_tool).transpose(0, 2, 1)
    total: Array = half + half.transpose(0, 2, 1)
    force, torque = dynamics.motion_noise**2 @ motion.stirred.T
    variance = force / c.mass**2 + (0.0 if dynamics.accelerometer is None else dynamics.accelerometer.noise**2)
    of_acceleration = dynamics.matrix[:, ACCELERATION]
    total += variance[:, None, None] * (of_acceleration @ of_acceleration.T)
    total[:, range(3, 6), range(3, 6)] += torque[:, None]
    if motion.untold is not None:
        of_second = dynamics.matrix[:, SECOND_DERIVATIVES]
        total += (of_second * motion.untold[:, None]) @ of_second.T
    exerted = np.hypot(dynamics.static_rms, motion.terms @ dynamics.matrix.T)
    total[:, range(6), range(6)] += np.where(motion.inside[:, None], 0.0, exerted**2)
    return total


def _unit_motions(tool: RigidTool, mass: float, sensor_offset: Array) -> tuple[Array, Array, Array, Array]:
    """Of each unit of the terms the force (12, 3), and in sensor axes alpha (12, 3), W and the products (12, 3, 3)."""
    R_flange_sensor = tool.R_flange_sensor
    W = turning(_UNIT_ALPHA, _UNIT_PRODUCTS)
    of_origin = (_UNIT_ACCELERATION + W @ sensor_offset) @ R_flange_sensor
    W, products = (R_flange_sensor.T @ each @ R_flange_sensor for each in (W, _UNIT_PRODUCTS))
    return -mass * (of_origin + W @ tool.com), _UNIT_ALPHA @ R_flange_sensor, W, products


def _spin(inertia: Array, alpha: Array, products: Array) -> Array:
    """`I alpha + omega x I omega` (k, 3), with the products omega omega^T (k, 3, 3)."""
    M = products @ inertia
    gyroscopic = np.stack([M[:, 1, 2] - M[:, 2, 1], M[:, 2, 0] - M[:, 0, 2], M[:, 0, 1] - M[:, 1, 0]], axis=1)
    return alpha @ inertia + gyroscopic
