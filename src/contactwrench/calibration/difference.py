"""What changed between two calibrations: each parameter with its standard deviation, and jointly, cause by cause.

The parameters of one calibration correlate, so what a cause moves (the tool: weight and com; drift: the bias; a sensor
that slipped: the mounting; the stand: gravity) is tested as a whole, with the covariance that is left to it whatever
the other parameters do. What a motion told counts with the degrees of freedom of the stops, fewer than it has.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple
from zlib import crc32

import numpy as np

from ..geometry.arrays import Array, Frozen
from ..geometry.rotations import rotation_angle, rotation_log, spread_rotations
from ..model import (
    GRAVITY,
    LINEAR_PARAMETERS,
    MOUNT,
    PARAMETERS,
    free_wrench,
    gravity_in_flange,
    horizontal_axes,
    mounting_turn,
    yaw_of_mounting,
)
from ..statistics import SIGNIFICANCE, MisfitTest, in_standard_deviations, misfit_of_parameters
from .dynamics import DYNAMIC_PARAMETERS, INERTIA, SENSOR_OFFSET, UNIT_OF, Dynamics, elements
from .fields import CalibrationFields

SIGNIFICANT = 3.0


@dataclass(frozen=True, eq=False)
class GroupChange(Frozen):
    """The parameters that one cause moves: `tool`, `bias`, `mounting`, `gravity`, and where both know what a motion
    told `inertia` and `offset`; where a calibration is `affine`, `matrix` for all that gravity does; and `all` of them.

    `parameters` (k names), their `change` (k,) and its `covariance` (k, k); the `test` of no change at all, and whether
    it is `significant` so that all groups together raise a false alarm once in a hundred times.
    """

    name: str
    parameters: tuple[str, ...]
    change: Array
    covariance: Array
    test: MisfitTest
    significant: bool


@dataclass(frozen=True, eq=False)
class Difference(Frozen):
    """Changes from calibration a to b.

    `names`, `units`, `change` (k,) and `std` (k,): parameters that both have, the calibrations taken as independent.
    `free_wrench` (6,): the largest change of each axis of the free wrench over all orientations (of `R_base_flange`
    in either's own base), N and N m. `mounting_angle` rad between the two mountings, None where one has none;
    `gravity_angle` rad between the two directions of gravity in base axes. `groups`: what one cause moves together,
    and last all of it. Between mountings on opposite sides of the sensor yaw is left out: its zeros differ. Inertia and
    sensor offset are among them where both know these, the latter from the flange: `inertia_known` says it of a and
    of b. `copied`: tool, mounting and base of both are of one origin (`prior`), and no evidence.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    change: Array
    std: Array
    free_wrench: Array
    mounting_angle: float | None
    gravity_angle: float
    groups: tuple[GroupChange, ...]
    inertia_known: tuple[bool, bool] = (False, False)
    copied: bool = False

    @property
    def significant(self) -> tuple[str, ...]:
        """The parameters that changed by more than three standard deviations."""
        moved = np.abs(self.change) > SIGNIFICANT * self.std
        return tuple(name for name, yes in zip(self.names, moved, strict=True) if yes)

    @property
    def in_std(self) -> Array:
        """Each change (k,) in its standard deviations; infinite for a change of what was known exactly."""
        return in_standard_deviations(self.change, self.std)

    @cached_property
    def meaning(self) -> tuple[str, ...]:
        """What happened to tool, sensor and base, in plain sentences."""
        from .difference_text import meaning

        return meaning(self)


def difference(a: CalibrationFields, b: CalibrationFields) -> Difference:
    """The changes from `a` to `b`."""
    before, after = _told(a), _told(b)
    names = [name for name in before if name in after]
    angle = None
    if a.R_flange_sensor is not None and b.R_flange_sensor is not None:
        angle = rotation_angle(a.R_flange_sensor.T @ b.R_flange_sensor)
        if a.sensor_z_along_flange != b.sensor_z_along_flange:
            names.remove("yaw")
    change = {name: after[name][0] - before[name][0] for name in names}
    if "yaw" in change:
        change["yaw"] = _short_way_round(change["yaw"])
    everywhere = spread_rotations(288, 24)
    free_a, free_b = (free_wrench(c.B, gravity_in_flange(everywhere, c.gravity_direction)) for c in (a, b))
    return Difference(
        names=tuple(names),
        units=tuple(UNIT_OF[name] for name in names),
        change=np.array(list(change.values())),
        std=np.hypot([before[name][1] for name in names], [after[name][1] for name in names]),
        free_wrench=np.abs(free_b - free_a).max(axis=0),
        mounting_angle=angle,
        gravity_angle=float(np.linalg.norm(_turn_of_gravity(a, b))),
        groups=_tested(a, b),
        inertia_known=(a.dynamics is not None, b.dynamics is not None),
        copied=origin_of_tool(a) == origin_of_tool(b) and "tool_from" in (*a.provenance, *b.provenance),
    )


def origin_of_tool(c: CalibrationFields) -> str:
    """A mark of the calibration that found tool, mounting and base: this one, or the first of a chain of priors."""
    return str(c.provenance.get("tool_from", f"{crc32(np.asarray(c.parameters).tobytes()):08x}"))


def _told(c: CalibrationFields) -> dict[str, tuple[float, float]]:
    """Value and standard deviation of every parameter that a calibration tells."""
    parts = ("bias",) if c.weight is None else ("weight", "com", "bias", "yaw")
    values, std = np.hstack([getattr(c, part) for part in parts]), np.hstack([c.std[part] for part in parts])
    names = LINEAR_PARAMETERS[4:] if c.weight is None else (*LINEAR_PARAMETERS, "yaw")
    told = dict(zip(names, zip(values.tolist(), std.tolist(), strict=True), strict=True))
    if c.delay is not None and c.delay_std is not None:
        told["delay"] = (c.delay, c.delay_std)
    if c.dynamics is not None:
        of_motion = zip(_of_motion(c.dynamics), c.dynamics.std.tolist(), strict=True)
        told |= dict(zip(DYNAMIC_PARAMETERS, of_motion, strict=True))
        if c.dynamics.accelerometer is not None:  # from which the offset counts, wherever it is
            told = {name: value for name, value in told.items() if name not in SENSOR_OFFSET}
    return told


def _of_motion(dynamics: Dynamics) -> list[float]:
    """Values of `DYNAMIC_PARAMETERS`."""
    return [*elements(dynamics.inertia).tolist(), *dynamics.sensor_offset.tolist()]


def _short_way_round(angle: float) -> float:
    """A change of an angle, rad, from -pi to pi."""
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


def _turn_of_gravity(a: CalibrationFields, b: CalibrationFields) -> Array:
    """Rotation vector (3,), base axes, from a's direction of gravity to b's."""
    across = np.cross(a.gravity_direction, b.gravity_direction)
    sine = float(np.linalg.norm(across))
    if sine == 0.0 and a.gravity_direction @ b.gravity_direction < 0.0:
        return np.pi * horizontal_axes(a.gravity_direction)[0]
    angle = np.arctan2(sine, a.gravity_direction @ b.gravity_direction)
    return across * (angle / sine if sine > 0.0 else 1.0)


class _Part(NamedTuple):
    """A group's change (k,), and how it follows the errors of either calibration's parameters (with an `affine` one, of
    either's B; where both know an inertia, of what a motion told too): `of_a` (k, p), `of_b` (k, q).
    """

    name: str
    parameters: tuple[str, ...]
    change: Array
    of_a: Array
    of_b: Array


def _parts(a: CalibrationFields, b: CalibrationFields) -> list[_Part]:
    """Every group of parameters that both calibrations tell."""
    if a.R_flange_sensor is None or b.R_flange_sensor is None:
        change, each = (b.B - a.B).ravel(), np.eye(24)
        constant = np.arange(24) % 4 == 3
        matrix = tuple(name for name in PARAMETERS["affine"] if not name.endswith("_1"))
        return [
            _Part("matrix", matrix, change[~constant], each[~constant], each[~constant]),
            _Part("bias", LINEAR_PARAMETERS[4:], change[constant], each[constant], each[constant]),
        ]
    of_motion = () if a.dynamics is None or b.dynamics is None else DYNAMIC_PARAMETERS
    names_a, names_b = ((*c.parameter_names, *of_motion) for c in (a, b))
    change = b.parameters[:10] - a.parameters[:10]
    of_a, of_b = (np.eye(10, len(names)) for names in (names_a, names_b))
    parts = [
        _Part("tool", LINEAR_PARAMETERS[:4], change[:4], of_a[:4], of_b[:4]),
        _Part("bias", LINEAR_PARAMETERS[4:], change[4:], of_a[4:], of_b[4:]),
        _mounting(a, b, names_a, names_b),
    ]
    if GRAVITY[0] in (*names_a, *names_b):
        axes = np.array(horizontal_axes(a.gravity_direction))
        of_a, of_b = _of_gravity(a, names_a, axes), _of_gravity(b, names_b, axes)
        parts.append(_Part("gravity", GRAVITY, axes @ _turn_of_gravity(a, b), of_a, of_b))
    if a.dynamics is not None and b.dynamics is not None:
        change = np.subtract(_of_motion(b.dynamics), _of_motion(a.dynamics))
        of_a, of_b = (np.eye(9, len(names), len(names) - 9) for names in (names_a, names_b))
        parts.append(_Part("inertia", INERTIA, change[:6], of_a[:6], of_b[:6]))
        if a.dynamics.accelerometer is None and b.dynamics.accelerometer is None:
            parts.append(_Part("offset", SENSOR_OFFSET, change[6:], of_a[6:], of_b[6:]))
    return parts


def _mounting(a: CalibrationFields, b: CalibrationFields, names_a: tuple[str, ...], names_b: tuple[str, ...]) -> _Part:
    """The turn from one mounting to the other: about all axes where both estimate it, else yaw; where a model that
    estimates yaw alone has the sensor on its other side, an angle without an error.
    """
    turns = [mounting_turn(names_a), mounting_turn(names_b)]
    R_a, R_b = np.asarray(a.R_flange_sensor), np.asarray(b.R_flange_sensor)
    if MOUNT[0] in names_a and MOUNT[0] in names_b:
        return _Part("mounting", MOUNT, rotation_log(R_a.T @ R_b), turns[0], turns[1])
    (yaw_a, flipped_a, of_a), (yaw_b, flipped_b, of_b) = yaw_of_mounting(R_a), yaw_of_mounting(R_b)
    if flipped_a != flipped_b:
        nothing = [np.zeros((1, turn.shape[1])) for turn in turns]
        return _Part("mounting", ("mounting_angle",), np.array([rotation_angle(R_a.T @ R_b)]), *nothing)
    change = np.array([_short_way_round(yaw_b - yaw_a)])
    return _Part("mounting", ("yaw",), change, of_a[None] @ turns[0], of_b[None] @ turns[1])


def _of_gravity(c: CalibrationFields, names: tuple[str, ...], axes: Array) -> Array:
    """How turns of gravity about `axes` (2, 3) follow the errors `names` (p) of c: (2, p), zero where it was stated."""
    J = np.zeros((2, len(names)))
    if GRAVITY[0] in names:
        places = [names.index(name) for name in GRAVITY]
        J[:, places] = np.stack([axes @ about for about in horizontal_axes(c.gravity_direction)], axis=1)
    return J


def _tested(a: CalibrationFields, b: CalibrationFields) -> tuple[GroupChange, ...]:
    """Every part as a group, and all together; the level of 1 % is shared among them (Bonferroni)."""
    each = _parts(a, b)
    rigid = a.R_flange_sensor is not None and b.R_flange_sensor is not None
    covariance_a, covariance_b = (c.covariance if rigid else c.B_covariance for c in (a, b))
    if a.dynamics is not None and b.dynamics is not None:
        covariance_a, covariance_b = a.dynamics.with_covariance(a.covariance), b.dynamics.with_covariance(b.covariance)
    _, parameters, change, of_a, of_b = zip(*each, strict=True)
    everything = _Part("all", sum(parameters, ()), np.concatenate(change), np.vstack(of_a), np.vstack(of_b))
    groups = []
    for part in (*each, everything):
        from_a = part.of_a @ covariance_a @ part.of_a.T
        from_b = part.of_b @ covariance_b @ part.of_b.T
        covariance = from_a + from_b
        dof = _dof_of_sum(from_a, from_b, _dof_behind(a, part.of_a), _dof_behind(b, part.of_b))
        test = MisfitTest(misfit_of_parameters(part.change, covariance), len(part.change), dof)
        significant = test.probability < SIGNIFICANCE / (len(each) + 1)
        groups.append(GroupChange(part.name, part.parameters, part.change, covariance, test, significant))
    return tuple(groups)


def _dof_behind(c: CalibrationFields, part: Array) -> float:
    """Degrees of freedom of the least known of the parameters that a part (k, p) rests on: weight, com and bias. Of
    rotations, which priors hold and no poses, of what a motion told, and where no parameter has its own, those of the
    calibration.
    """
    of = c.parameter_dof
    rests_on = np.flatnonzero(part.any(axis=0))
    if of is None or not len(rests_on) or rests_on[-1] >= len(LINEAR_PARAMETERS):
        return c.dof
    return float(of[rests_on].min())


def _dof_of_sum(from_a: Array, from_b: Array, dof_a: float, dof_b: float) -> float:
    """Degrees of freedom behind the sum of two estimated covariances (Welch, 1947); 0 where neither was estimated."""
    total = np.diag(from_a + from_b)
    known = total > 0.0
    if not known.any():
        return 0.0
    share_a, share_b = (float(np.mean(np.diag(part)[known] / total[known])) for part in (from_a, from_b))
    doubt = sum(share**2 / dof for share, dof in ((share_a, dof_a), (share_b, dof_b)) if dof > 0.0)
    return 1.0 / doubt if doubt > 0.0 else 0.0
