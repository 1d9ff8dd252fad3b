"""What is known before the readings, each with its standard deviation: tilts near nominal, a weighed tool, a drawing.

Every piece of knowledge is a function of the tool and of the names of the parameters that are estimated; it gives the
rows that join the readings in the least squares: what is known, less what the tool says, in standard deviations.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from ..calibration.calibration import Calibration
from ..errors import InputError
from ..geometry.arrays import Array
from ..geometry.orientation import nearest_rotations
from ..geometry.rotations import rotation_log
from ..geometry.wrench import cross_matrix, unit_direction
from ..model import GRAVITY, MOUNT, RigidTool, horizontal_axes
from .noise import MOST_DOF, StatedNoise, variance_of_means


@dataclass(frozen=True, eq=False)
class PriorRows:
    """What is known before the readings, as rows of unit variance.

    `residuals` (q,): what is known less what the tool says, in standard deviations; `jacobian` (q, p): the derivative
    of what the tool says, likewise.
    """

    residuals: Array
    jacobian: Array


Knowledge: TypeAlias = Callable[[RigidTool, tuple[str, ...]], PriorRows]

KNOWABLE = ("weight", "com", "mount", "gravity")
LEAST_SHARE = 1e-6
"""Of the earlier covariance's variance: added to it, so that what the earlier model held is held here too."""

MOUNT_TILT_SD = np.deg2rad(1.41)
BASE_TILT_SD = np.deg2rad(0.71)
EXACT_TILT_SD = np.deg2rad(0.005)
"""What a machined face or a levelled base is off by: the readings cannot see it."""

ON_THE_SPOT = 1e-4
"""rad: below, an angle is its sine."""


@dataclass(frozen=True)
class TiltPriors:
    """Standard deviations (rad, an axis) of the mounting's and the base's tilt about nominal; None where what is known
    of it takes the place of a prior.
    """

    mount: float | None = MOUNT_TILT_SD
    base: float | None = BASE_TILT_SD


@dataclass(frozen=True, eq=False)
class Question:
    """What is asked of the readings: a model, and all that is known beside them.

    `gravity_direction` (3,) in base axes, stated or nominal; `noise` stated or None; `priors` of the tilts, for `auto`;
    `knowledge` of the parameters; the `earlier` tool, where an earlier calibration of it is among that knowledge.
    """

    model: str
    gravity_direction: Array
    noise: StatedNoise | None = None
    priors: TiltPriors = TiltPriors()
    knowledge: tuple[Knowledge, ...] = ()
    earlier: RigidTool | None = None


def known_weight(weight: float, std: float) -> Knowledge:
    """The weight (N), from a scale."""

    def rows(tool: RigidTool, names: tuple[str, ...]) -> PriorRows:
        jacobian = np.zeros((1, len(names)))
        jacobian[0, 0] = 1.0 / std
        return PriorRows(np.array([weight - tool.weight]) / std, jacobian)

    return rows


def known_com(com: Array, std: Array) -> Knowledge:
    """The centre of mass (3,) m, sensor frame, from a drawing; `std` (3,) m."""

    def rows(tool: RigidTool, names: tuple[str, ...]) -> PriorRows:
        jacobian = np.zeros((3, len(names)))
        jacobian[:, 1:4] = np.diag(1.0 / std)
        return PriorRows((com - tool.com) / std, jacobian)

    return rows


def known_mounting(R_flange_sensor: Array, std: Array) -> Knowledge:
    """The mounting (3, 3); `std` (3,) rad of small rotations about the sensor's axes."""

    def rows(tool: RigidTool, names: tuple[str, ...]) -> PriorRows:
        off = rotation_log(tool.R_flange_sensor.T @ R_flange_sensor)
        jacobian = _of_mounting(np.diag(1.0 / std) @ _log_derivative(off), names)
        return PriorRows(off / std, jacobian)

    return rows


def known_gravity(gravity_direction: Array, std: float) -> Knowledge:
    """The direction of gravity (3,) in base axes; `std` rad about either horizontal axis."""
    sides = np.stack(horizontal_axes(gravity_direction))

    def rows(tool: RigidTool, names: tuple[str, ...]) -> PriorRows:
        jacobian = np.zeros((2, len(names)))
        if GRAVITY[0] in names:
            a, b = horizontal_axes(tool.gravity_direction)
            jacobian[:, -2:] = sides @ np.stack([-b, a], axis=1) / std
        return PriorRows(-sides @ tool.gravity_direction / std, jacobian)

    return rows


def nominal_mounting(std: float) -> Knowledge:
    """The sensor's z lies along the flange's, or against it: what its z is off by, as the sines of its tilt about the
    two axes across, has the standard deviation `std` (rad) each. The yaw is free.
    """

    def rows(tool: RigidTool, names: tuple[str, ...]) -> PriorRows:
        flange_z = tool.R_flange_sensor[2]
        return PriorRows(-flange_z[:2] / std, _of_mounting(cross_matrix(flange_z)[:2] / std, names))

    return rows


def earlier_calibration(tool: RigidTool, covariance: Array) -> Knowledge:
    """An earlier calibration of the same tool, its bias forgotten: `covariance` (9, 9) of weight, com, the mounting's
    small rotation and that of gravity, as in `Calibration`.
    """
    whitener = np.linalg.inv(np.linalg.cholesky(covariance))
    weight, com = known_weight(tool.weight, 1.0), known_com(tool.com, np.ones(3))
    rotations = _known_turns(tool.R_flange_sensor, tool.gravity_direction)

    def rows(now: RigidTool, names: tuple[str, ...]) -> PriorRows:
        parts = [piece(now, names) for piece in (weight, com, rotations)]
        off = np.concatenate([part.residuals for part in parts])
        jacobian = np.concatenate([part.jacobian for part in parts])
        return PriorRows(whitener @ off, whitener @ jacobian)

    return rows


def known_rotations(R_flange_sensor: Array, gravity_direction: Array, information: Array, turn: Array) -> Knowledge:
    """Mounting and gravity, by the small turns (5,) that lead to them from these two, those of `mount_x` to
    `gravity_b`: `information` (q, 5), rows of unit variance, times the turns is `turn` (q,). What the rows leave open
    is not known.
    """
    rotations = _known_turns(R_flange_sensor, gravity_direction)

    def rows(tool: RigidTool, names: tuple[str, ...]) -> PriorRows:
        back = rotations(tool, names)
        return PriorRows(turn + information @ back.residuals, information @ back.jacobian)

    return rows


def _known_turns(R_flange_sensor: Array, gravity_direction: Array) -> Knowledge:
    """Both rotations with a std of 1 rad, as five turns: of the mounting about the sensor's axes, of gravity about its
    horizontal axes. Unlike the sine of `known_gravity`, the turn tells gravity from its opposite.
    """
    mounting = known_mounting(R_flange_sensor, np.ones(3))
    axes = np.stack(horizontal_axes(gravity_direction))

    def rows(tool: RigidTool, names: tuple[str, ...]) -> PriorRows:
        of_mounting = mounting(tool, names)
        d = tool.gravity_direction
        # about a towards -b, about b towards a
        sine, cosine = np.array([-axes[1] @ d, axes[0] @ d]), float(gravity_direction @ d)
        per_sine, bend = _angle_per_sine(float(np.linalg.norm(sine)), cosine)
        jacobian = np.zeros((2, len(names)))
        if GRAVITY[0] in names:
            a, b = horizontal_axes(d)
            moves = np.stack([-b, a], axis=1)
            jacobian[:, -2:] = per_sine * np.stack([-axes[1], axes[0]]) @ moves
            jacobian[:, -2:] -= bend * np.outer(sine, gravity_direction @ moves)
        return PriorRows(
            np.concatenate([of_mounting.residuals, -per_sine * sine]), np.concatenate([of_mounting.jacobian, jacobian])
        )

    return rows


def _angle_per_sine(sine: float, cosine: float) -> tuple[float, float]:
    """The angle over its sine, and how that falls with the cosine."""
    if sine < ON_THE_SPOT and cosine > 0.0:
        return 1.0, 1.0 / 3.0
    sine = max(sine, ON_THE_SPOT)
    angle = float(np.arctan2(sine, cosine))
    return angle / sine, (sine - angle * cosine) / sine**3


def rows_of(knowledge: tuple[Knowledge, ...], tool: RigidTool, names: tuple[str, ...]) -> PriorRows | None:
    """All rows together, None where nothing is known."""
    if not knowledge:
        return None
    rows = [piece(tool, names) for piece in knowledge]
    return PriorRows(np.concatenate([r.residuals for r in rows]), np.concatenate([r.jacobian for r in rows]))


def _of_mounting(derivative: Array, names: tuple[str, ...]) -> Array:
    """A derivative (q, 3) with respect to small rotations of the mounting, in the columns of `names` (q, p)."""
    jacobian = np.zeros((len(derivative), len(names)))
    if MOUNT[0] in names:
        first = names.index(MOUNT[0])
        jacobian[:, first : first + 3] = derivative
    elif "yaw" in names:
        jacobian[:, names.index("yaw")] = derivative[:, 2]
    return jacobian


def _log_derivative(vector: Array) -> Array:
    """Derivative (3, 3) of `-log(exp(-delta) exp(vector))` at delta = 0: the inverse of the left Jacobian of SO(3)
    (Sola, Deray and Atchuthan, A micro Lie theory, 2018, Eq. 146).
    """
    angle = float(np.linalg.norm(vector))
    K = cross_matrix(vector)
    if angle < 1e-6:
        return np.eye(3) - 0.5 * K
    half = 0.5 * angle
    inverse: Array = np.eye(3) - 0.5 * K + (1.0 - half / np.tan(half)) / angle**2 * K @ K
    return inverse


def stated_knowledge(known: Mapping[str, tuple[Any, Any]]) -> tuple[Knowledge, ...]:
    """`known`: weight: (N, std); com: ((3,) m, std); mount: ((3, 3) R_flange_sensor, std rad); gravity: ((3,) in base
    axes, std rad). A std is one number, or three for com and mount. Raises `InputError`.
    """
    if not isinstance(known, Mapping):
        raise InputError(f"known is {type(known).__name__}, expected a mapping, as in {{'weight': (12.3, 0.1)}}")
    pieces: list[Knowledge] = []
    for name, pair in known.items():
        if name not in KNOWABLE:
            raise InputError(f"known {name!r} is not an unknown of the tool, expected one of {', '.join(KNOWABLE)}")
        try:
            value, std = pair
        except (TypeError, ValueError):
            raise InputError(f"known {name} is {pair!r}, expected a pair: the value and its std") from None
        shapes: tuple[tuple[int, ...], ...] = ((), (3,)) if name in ("com", "mount") else ((),)
        spread = np.broadcast_to(_finite(f"std of known {name}", std, shapes), (3,))
        if not (spread > 0.0).all():
            raise InputError(f"std of known {name} is {_listed(spread)}, expected numbers above 0")
        if name == "weight":
            weight = float(_finite("known weight", value, ((),)))
            if weight <= 0.0:
                raise InputError(f"known weight is {weight:g}, expected N above 0")
            pieces.append(known_weight(weight, float(spread[0])))
        elif name == "com":
            pieces.append(known_com(_finite("known com", value, ((3,),)), spread))
        elif name == "mount":
            R = _finite("known mount", value, ((3, 3),))
            pieces.append(known_mounting(nearest_rotations(R[None])[0], spread))
        else:
            pieces.append(known_gravity(unit_direction(value, "known gravity"), float(spread[0])))
    return tuple(pieces)


def earlier_tool(prior: Calibration, rows: int) -> tuple[RigidTool, Knowledge, StatedNoise]:
    """The tool of an earlier calibration, what that knows of it (its bias forgotten), and the noise of a pose that is
    the mean of so many `rows`: what poses differed by, and the scatter of a sample over the rows.

    What the earlier model held, mounting or base, is held to `EXACT_TILT_SD`. Raises `InputError` for `affine`.
    """
    if prior.weight is None or prior.com is None or prior.R_flange_sensor is None:
        raise InputError(
            "the prior is a calibration of model affine, expected a rigid tool: calibrate with another model"
        )
    tool = RigidTool(prior.weight, prior.com, prior.bias, prior.R_flange_sensor, prior.gravity_direction)
    names = ("weight", "com_x", "com_y", "com_z", *MOUNT, *GRAVITY)
    of_prior = ["yaw" if n == MOUNT[2] and "yaw" in prior.parameter_names else n for n in names]
    place = {name: k for k, name in enumerate(prior.parameter_names)}
    there = [k for k, name in enumerate(of_prior) if name in place]
    covariance = np.diag(np.full(len(names), EXACT_TILT_SD**2))
    source = [place[of_prior[k]] for k in there]
    covariance[np.ix_(there, there)] = prior.covariance[np.ix_(source, source)]
    covariance[range(9), range(9)] *= 1.0 + LEAST_SHARE
    noise = np.sqrt(variance_of_means(prior.noise, prior.fitted_poses, np.array([float(rows)]))[0])
    return tool, earlier_calibration(tool, covariance), StatedNoise(noise, prior.dof or MOST_DOF)


def _finite(what: str, value: ArrayLike, shapes: tuple[tuple[int, ...], ...]) -> Array:
    try:
        array = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        array = np.full(0, np.nan)
    if array.shape not in shapes or not np.isfinite(array).all():
        expected = " or ".join(str(shape) if shape else "a number" for shape in shapes)
        raise InputError(f"{what} is {value!r}, expected {expected}, finite")
    return array


def _listed(values: Array) -> str:
    return ", ".join(f"{value:g}" for value in values)
