"""What is known before the readings, each with its standard deviation: tilts near nominal, a weighed tool, a drawing.

Knowledge of a tool is a tool and a whitener of what another one is off it, in nine coordinates: weight, centre of mass
(3), the small turn of the mounting (3), that of gravity (2). It gives the rows that join the readings in the least
squares: what is known, less what a tool says, in standard deviations.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from ..calibration.calibration import Calibration
from ..errors import InputError
from ..geometry import ranges
from ..geometry.arrays import Array
from ..geometry.orientation import nearest_rotations
from ..geometry.rotations import rotation_log
from ..geometry.wrench import cross_matrix, unit_direction
from ..model import GRAVITY, LINEAR_PARAMETERS, MOUNT, RigidTool, horizontal_axes, mounting_turn
from ..statistics import square_root
from .noise import MOST_DOF, StatedNoise, variance_of_means

LEAST_SHARE = 1e-6
"""Of the earlier covariance's variance: added to it, so that what the earlier model held is held here too."""

MOUNT_TILT_SD = np.deg2rad(1.41)
BASE_TILT_SD = np.deg2rad(0.71)
EXACT_TILT_SD = np.deg2rad(0.005)
"""What a machined face or a levelled base is off by: the readings cannot see it."""

SURE_OFF = 3.0
"""Standard deviations that two directions of gravity are apart, from which on they are two: 1 in 90 by chance."""

ON_THE_SPOT = 1e-4
"""rad: below, an angle is its sine."""

COORDINATES = (*LINEAR_PARAMETERS[:4], *MOUNT, *GRAVITY)
WEIGHT, COM, MOUNTING, DOWN = slice(0, 1), slice(1, 4), slice(4, 7), slice(7, 9)
ANY_TOOL = RigidTool(1.0, np.zeros(3), np.zeros(6), np.eye(3), np.array([0.0, 0.0, -1.0]))


@dataclass(frozen=True, eq=False)
class PriorRows:
    """What is known before the readings, as rows of unit variance.

    `residuals` (q,): what is known less what the tool says, in standard deviations; `jacobian` (q, p): the derivative
    of what the tool says, likewise; `dof` (q,) degrees of freedom behind the variance of each row.
    """

    residuals: Array
    jacobian: Array
    dof: Array


Knowledge: TypeAlias = Callable[[RigidTool, tuple[str, ...]], PriorRows]


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
    `knowledge` of the parameters; the `earlier` calibration, where that of its tool is among the knowledge.
    """

    model: str
    gravity_direction: Array
    noise: StatedNoise | None = None
    priors: TiltPriors = TiltPriors()
    knowledge: tuple[Knowledge, ...] = ()
    earlier: Calibration | None = None

    @cached_property
    def nominal(self) -> tuple[Knowledge, ...]:
        """That the centre of mass is the sensor's, and mounting and base are not tilted, with standard deviations of
        1 m and 1 rad, (7) rows: of `auto` beside no earlier calibration, else nothing.
        """
        if self.model != "auto" or self.earlier is not None:
            return ()
        com, down = known_as("com", np.zeros(3), 1.0), known_as("gravity", self.gravity_direction, 1.0)
        return com, nominal_mounting(1.0), down


@dataclass(frozen=True, eq=False)
class KnownTool:
    """`whitener` (q, 9) times the `COORDINATES` that lead from `tool` to the truth is `value` (q,); unit variance."""

    tool: RigidTool
    whitener: Array
    value: Array | float = 0.0
    dof: Array | float = MOST_DOF

    def __call__(self, tool: RigidTool, names: tuple[str, ...]) -> PriorRows:
        """What a tool contradicts it by."""
        back, jacobian = np.zeros(9), np.zeros((9, len(names)))
        back[0], back[COM] = self.tool.weight - tool.weight, self.tool.com - tool.com
        jacobian[:4, :4] = np.eye(4)
        if self.whitener[:, MOUNTING].any():
            back[MOUNTING] = rotation_log(tool.R_flange_sensor.T @ self.tool.R_flange_sensor)
            jacobian[MOUNTING] = _log_derivative(back[MOUNTING]) @ mounting_turn(names)
        if self.whitener[:, DOWN].any():
            turn, derivative = _turn_of_gravity(self.tool.gravity_direction, tool.gravity_direction)
            back[DOWN] = -turn
            if GRAVITY[0] in names:
                jacobian[DOWN, -2:] = derivative
        dof = np.broadcast_to(self.dof, len(self.whitener))
        return PriorRows(self.value + self.whitener @ back, self.whitener @ jacobian, dof)


def known_as(name: str, value: Any, std: ArrayLike) -> Knowledge:
    """One of `KNOWABLE`, as it is stated: the `weight` N, from a scale; the `com` (3,) m, sensor frame, from a drawing;
    the `mount`, R_flange_sensor (3, 3), whose std, rad, is of small rotations about the sensor's axes; the direction of
    `gravity` (3,), base axes, whose std, rad, is about either horizontal axis.
    """
    field, coordinates, *_ = KNOWABLE[name]
    rows = np.eye(9)[coordinates]
    whitener = rows / np.broadcast_to(np.asarray(std, dtype=np.float64), len(rows))[:, None]
    return KnownTool(replace(ANY_TOOL, **{field: value}), whitener)


def nominal_mounting(std: float) -> Knowledge:
    """The sensor's z lies along the flange's, or against it: what its z is off by, as the sines of its tilt about the
    two axes across, has the standard deviation `std` (rad) each. The yaw is free.
    """

    def rows(tool: RigidTool, names: tuple[str, ...]) -> PriorRows:
        flange_z = tool.R_flange_sensor[2]
        of_tilt = cross_matrix(flange_z)[:2] @ mounting_turn(names)
        return PriorRows(-flange_z[:2] / std, of_tilt / std, np.full(2, MOST_DOF))

    return rows


def earlier_calibration(tool: RigidTool, covariance: Array, dof: Array | float = MOST_DOF) -> Knowledge:
    """An earlier calibration of the same tool, its bias forgotten: `covariance` (9, 9), `dof` of its `COORDINATES`."""
    # a row is one of them, given those before it
    return KnownTool(tool, np.linalg.inv(np.linalg.cholesky(covariance)), dof=dof)


def known_rotations(R_flange_sensor: Array, gravity_direction: Array, information: Array, turn: Array) -> KnownTool:
    """Mounting and gravity, by the small turns (5,) that lead to them from these two, those of `mount_x` to
    `gravity_b`: `information` (q, 5), rows of unit variance, times the turns is `turn` (q,). What the rows leave open
    is not known.
    """
    tool = replace(ANY_TOOL, R_flange_sensor=R_flange_sensor, gravity_direction=gravity_direction)
    return KnownTool(tool, np.hstack([np.zeros((len(information), 4)), information]), turn)


def rows_of(knowledge: tuple[Knowledge, ...], tool: RigidTool, names: tuple[str, ...]) -> PriorRows:
    """All rows together."""
    rows = [PriorRows(np.zeros(0), np.zeros((0, len(names))), np.zeros(0)), *(each(tool, names) for each in knowledge)]
    return PriorRows(*map(np.concatenate, zip(*((r.residuals, r.jacobian, r.dof) for r in rows), strict=True)))


def _turn_of_gravity(before: Array, after: Array) -> tuple[Array, Array]:
    """The small turn (2,) about the horizontal axes of one direction that leads to another, and its derivative (2, 2)
    with respect to a turn of that other about its own axes. An angle, unlike its sine, tells down from up.
    """
    (a, b), (after_a, after_b) = horizontal_axes(before), horizontal_axes(after)
    across, moves = np.array([-b, a]), np.array([-after_b, after_a]).T
    sine, cosine = across @ after, float(before @ after)
    length = math.hypot(*sine.tolist())
    per_sine, bend = 1.0, 1.0 / 3.0  # the angle over its sine, and how that falls with the cosine
    if length >= ON_THE_SPOT or cosine <= 0.0:
        length = max(length, ON_THE_SPOT)
        angle = math.atan2(length, cosine)
        per_sine, bend = angle / length, (length - angle * cosine) / length**3
    return per_sine * sine, per_sine * across @ moves - bend * sine[:, None] * (before @ moves)


def _log_derivative(vector: Array) -> Array:
    """Derivative (3, 3) of `-log(exp(-delta) exp(vector))` at delta = 0: the inverse of the left Jacobian of SO(3)
    (Sola, Deray and Atchuthan, A micro Lie theory, 2018, Eq. 146).
    """
    angle = float(np.linalg.norm(vector))
    K = cross_matrix(vector)
    if angle < 1e-6:
        return np.eye(3) - 0.5 * K
    half = 0.5 * angle
    return np.asarray(np.eye(3) - 0.5 * K + (1.0 - half / np.tan(half)) / angle**2 * K @ K)


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
        _, _, of_value, within, shapes = KNOWABLE[name]
        pieces.append(known_as(name, of_value(value), within.require(std, f"std of known {name}", *shapes)))
    return tuple(pieces)


def _mounting(value: ArrayLike) -> Array:
    return np.asarray(nearest_rotations(ranges.ENTRY.require(value, "known mount", (3, 3))[None])[0])


KNOWABLE: dict[str, tuple[str, slice, Callable[[Any], Any], ranges.Range, tuple[tuple[int, ...], ...]]] = {
    "weight": ("weight", WEIGHT, lambda x: float(ranges.WEIGHT.require(x, "known weight")), ranges.WEIGHT_STD, ((),)),
    "com": ("com", COM, lambda x: ranges.POINT.require(x, "known com", (3,)), ranges.POINT_STD, ((), (3,))),
    "mount": ("R_flange_sensor", MOUNTING, _mounting, ranges.TILT_STD, ((), (3,))),
    "gravity": ("gravity_direction", DOWN, lambda x: unit_direction(x, "known gravity"), ranges.TILT_STD, ((),)),
}
"""What may be known: the field of a tool that it is, its `COORDINATES`, how its value is read, what its std may be."""


def tool_of(prior: Calibration) -> RigidTool:
    """The tool of a calibration. Raises `InputError` for `affine`, which only an earlier one may be."""
    if prior.rigid_tool is None:
        raise InputError(
            "the prior is a calibration of model affine, expected a rigid tool: calibrate with another model"
        )
    return prior.rigid_tool


def known_of(prior: Calibration, rows: int, gravity: tuple[Any, Any] | None = None) -> tuple[Knowledge, StatedNoise]:
    """What an earlier calibration knows of its tool, its bias forgotten, and the noise of a pose that is the mean of so
    many `rows`: what poses differed by, and the scatter of a sample over the rows.

    What the earlier model held, mounting or base, is held to `EXACT_TILT_SD`. Raises `InputError` for `affine`, and
    for another `gravity`, as stated beside it: direction (3,), base axes, and std, rad an axis.
    """
    _require_same_gravity(prior, gravity)
    place = {"mount_z" if name == "yaw" else name: k for k, name in enumerate(prior.parameter_names)}
    there = [k for k, name in enumerate(COORDINATES) if name in place]
    source = [place[COORDINATES[k]] for k in there]
    covariance = EXACT_TILT_SD**2 * np.eye(9)
    covariance[np.ix_(there, there)] = prior.covariance[np.ix_(source, source)]
    covariance[range(9), range(9)] *= 1.0 + LEAST_SHARE
    of_noise, dof = prior.dof or MOST_DOF, np.full(9, MOST_DOF)
    dof[there] = of_noise if prior.parameter_dof is None else prior.parameter_dof[source]
    noise = np.sqrt(variance_of_means(prior.noise, prior.fitted_poses, np.array([float(rows)]))[0])
    return earlier_calibration(tool_of(prior), covariance, dof), StatedNoise(noise, of_noise)


def _require_same_gravity(prior: Calibration, stated: tuple[Any, Any] | None) -> None:
    """Raise `InputError` where they are apart by more than both may be off: a single pose would not show that the base
    stands otherwise now.
    """
    if stated is None:
        return
    direction, own = unit_direction(stated[0]), prior.gravity_direction
    off = float(np.arctan2(np.linalg.norm(np.cross(direction, own)), direction @ own))
    found = [k for k, name in enumerate(prior.parameter_names) if name in GRAVITY]
    most = SURE_OFF * float(np.sqrt(float(stated[1]) ** 2 + max(np.diag(prior.covariance)[found], default=0.0)))
    if off > most:
        brought, given = (",".join(f"{part:.3g}" for part in np.round(each, 4) + 0.0) for each in (own, direction))
        raise InputError(
            f"an earlier calibration brings gravity {brought}, and {given} is stated, {np.rad2deg(off):.2g} deg from "
            f"it, expected at most {np.rad2deg(most):.2g}: leave one of them out"
        )


def with_errors_of(calibration: Calibration, prior: Calibration | None) -> Calibration:
    """A calibration with what an earlier one found of the sensor's gain and the robot's orientation: a new zero makes
    neither exact, and is off by what a gain reads in its poses.
    """
    if prior is None:
        return calibration
    covariance, of_B = calibration.covariance.copy(), calibration.B_covariance.copy()
    if (gain := prior.gain_covariance) is not None:
        kept, many = [pose.R_base_flange for pose in calibration.fitted_poses], calibration.moments
        mean = np.mean(kept, axis=0) if many is None else many.design[9, :9].reshape(3, 3) / many.n
        of_mean = np.append(calibration.gravity_direction @ mean, 0.0)
        root = np.kron(np.eye(6), of_mean) @ square_root(gain)  # read as a bias
        covariance[4:10, 4:10] += root @ root.T
        of_B[3::4, 3::4] += root @ root.T
    return replace(
        calibration,
        covariance=covariance,
        B_covariance=of_B,
        gain_covariance=gain,
        orientation_std=prior.orientation_std,
    )
