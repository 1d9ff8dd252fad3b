"""Whether a calibration that was read is one: what follows from other numbers does, and the rest can be."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any

import numpy as np

from ..errors import InputError
from ..geometry.arrays import Array, Vector
from ..geometry.orientation import off_rotation
from ..geometry.ranges import NOISE_OF_AXIS
from ..model import PARAMETERS, matrix_jacobian, parameters_of, wrench_matrix, yaw_of_mounting
from ..samples.delay import LONGEST_DELAY, is_significant
from .dynamics import Dynamics, can_exist, inertial_matrix
from .fields import CalibrationFields

B_TOLERANCE = 1e-9
ROUNDING = 1e-14
ROUNDING_OF_SUMS = ROUNDING**0.5  # a root of what sums of squares leave of each other
COVARIANCE_TOLERANCE, ROTATION_TOLERANCE = 1e-6, 2e-6
OFF_POSES = (0.5, 10.0)
"""Of the weight, and times what is stated: a file that leaves more in its own poses is another's."""
LARGEST_NUMBER = 1e30
UNEDITED = "expected a file as it was saved"
FOLLOWS = ("verdict", "expected_error", "left_of_poses")
"""Properties that are written to the file."""


@dataclass(frozen=True, eq=False)
class Derived:
    """What the file says beside the fields, for programs that read it; it follows from them."""

    std: dict[str, float | list[float] | None]
    warnings: list[str]
    verdict: str | None = None
    expected_error: Vector | None = None
    left_of_poses: Vector | None = None


def require_consistent(c: CalibrationFields, derived: Derived) -> None:
    """Raise `InputError` unless shapes fit, rotations and covariances are such, and what follows from others does."""
    if c.model not in PARAMETERS:
        raise InputError(f"model is {c.model!r}, expected one of {', '.join(PARAMETERS)}")
    names = PARAMETERS[c.model]
    if c.parameter_names != names:
        raise InputError(f"parameter_names do not fit model {c.model}, expected {', '.join(names)}")
    sizes = {"p": len(names), "k": 0 if c.still_noise is None else len(c.still_noise.duration)}
    of_model = replace(c, dynamics=None) if c.model == "affine" else c
    for name, array, shape, least in _shapes(of_model, sizes):
        _require_shape(name, array, shape)
        if not (np.abs(array) <= LARGEST_NUMBER).all():
            raise InputError(f"{name} has a number beyond 1e30, expected none")
        if least is not None and (array < least).any():
            raise InputError(f"{name} has a number below {least:g}, expected {least:g} or more")
    if not (c.noise > 0.0).all():
        raise InputError("noise has a number that is not above 0, expected 6 above 0")
    if (c.noise > NOISE_OF_AXIS.most).any():
        raise InputError(f"noise has a number beyond {NOISE_OF_AXIS.most:g}, expected none")
    _check_numbers(c)
    _check_poses(c)
    if not abs((length := float(np.linalg.norm(c.gravity_direction))) - 1.0) <= B_TOLERANCE:
        raise InputError(f"gravity_direction has length {length:.10g}, expected 1")
    if c.model == "affine":
        _check_affine(c)
    else:
        _check_rigid(c)
    _require_covariance("covariance", c.covariance)
    if c.dynamics is not None:
        _check_dynamics(c, c.dynamics)
    if c.gain_covariance is not None:
        _require_symmetric("gain_covariance", c.gain_covariance)  # a mean of several: not quite positive
    _check_derived(c, derived)


def _check_poses(c: CalibrationFields) -> None:
    for k, pose in enumerate(c.poses):
        _require_covariance(f"poses[{k}].wrench_cov", pose.wrench_cov)
        _require_rotation(f"poses[{k}].R_base_flange", pose.R_base_flange)
        if pose.n < 1:
            raise InputError(f"poses[{k}].n is {pose.n}, expected 1 row or more")
    if (m := c.moments) is not None:
        _require_covariance("moments", np.block([[m.design, m.cross], [m.cross.T, m.wrench]]))
        _require_near("moments.design", m.design[9, 9], float(m.n), "moments.n")


def _shapes(
    part: Any, sizes: dict[str, int], where: str = ""
) -> Iterator[tuple[str, Array, tuple[int, ...], float | None]]:
    """Every array whose shape its field says, of all parts, too: its name, that shape, and the least of its numbers."""
    for each in fields(part):
        name, value = f"{where}{each.name}", getattr(part, each.name)
        if "shape" in each.metadata and value is not None:
            yield name, value, tuple(sizes.get(n, n) for n in each.metadata["shape"]), each.metadata["least"]
        elif is_dataclass(value):
            yield from _shapes(value, sizes, f"{name}.")
        elif isinstance(value, tuple):
            for k, one in enumerate(value):
                yield from _shapes(one, sizes, f"{name}[{k}].") if is_dataclass(one) else ()


def _require_shape(name: str, array: Array | None, shape: tuple[int, ...]) -> None:
    if array is not None and array.shape != shape:
        raise InputError(f"found {name} of another shape, expected {shape}")


def _require_rotation(name: str, R: Array) -> None:
    deviation, determinant = off_rotation(R.reshape(1, 9))
    if not deviation[0] <= ROTATION_TOLERANCE or determinant[0] < 0.0:
        raise InputError(f"found a matrix {name} that does more or less than turn, expected a rotation")


def _check_numbers(c: CalibrationFields) -> None:
    if c.dof < 0.0 or c.reduced_chi2 < 0.0:
        raise InputError(f"dof is {c.dof:g} and reduced_chi2 {c.reduced_chi2:g}, expected 0 or more")
    if c.orientation_std is not None and not 0.0 < c.orientation_std < np.pi:
        raise InputError(f"orientation_std is {c.orientation_std:g}, expected above 0 and below pi rad")
    if (c.delay is None) != (c.delay_std is None):
        raise InputError("found one of delay and delay_std, expected both or neither")
    if c.delay is not None and c.delay_std is not None:
        if c.delay_std < 0.0:
            raise InputError(f"delay_std is {c.delay_std:g}, expected 0 or more")
        if abs(c.delay) > LONGEST_DELAY and is_significant(c.delay, c.delay_std):
            raise InputError(f"delay is {c.delay:g} s, expected at most {LONGEST_DELAY:g} s either way")
    if c.still_noise is not None and not (np.diff(c.still_noise.duration, prepend=0.0) > 0.0).all():
        raise InputError("found still_noise.duration out of order, expected it ascending from above 0")
    least = c.dof if c.parameter_dof is None else float(c.parameter_dof.min())
    if not c.dof <= least + B_TOLERANCE or (c.dof == 0.0 < least):
        raise InputError(f"dof is {c.dof:g}, expected no more than the least parameter_dof, {least:g}, and not 0")
    if (np.diag(c.covariance) < 0.0).any():
        raise InputError("covariance has a variance below 0, expected 0 or more")


def _require_covariance(name: str, C: Array) -> None:
    _require_symmetric(name, C)
    unit = np.sqrt(np.abs(np.diag(C)))
    unit[unit == 0.0] = 1.0
    correlation = C / unit[:, None] / unit
    if not (np.isfinite(correlation).all() and np.linalg.eigvalsh(correlation)[0] >= -COVARIANCE_TOLERANCE):
        raise InputError(f"{name} is not positive semi-definite, expected a covariance")


def _require_symmetric(name: str, C: Array) -> None:
    std = np.sqrt(np.abs(np.diag(C)))
    least = COVARIANCE_TOLERANCE**2 * np.abs(C).max()
    if not (np.abs(C - C.T) <= COVARIANCE_TOLERANCE * np.outer(std, std) + least).all():
        raise InputError(f"{name} is not symmetric, expected a covariance")


def _check_affine(c: CalibrationFields) -> None:
    if any(value is not None for value in (c.weight, c.mass, c.com, c.R_flange_sensor, c.yaw)):
        raise InputError("model affine has a weight, mass, com, R_flange_sensor or yaw, expected null")
    _require_near("the last column of B", c.B[:, 3], c.bias, "bias")
    _require_near("parameters", c.parameters, c.B.ravel(), "B")
    _check_B_covariance(c, np.eye(24))


def _check_rigid(c: CalibrationFields) -> None:
    if (tool := c.rigid_tool) is None or c.mass is None or c.yaw is None:
        raise InputError(f"model {c.model} lacks weight, mass, com, R_flange_sensor or yaw, expected numbers")
    _require_rotation("R_flange_sensor", tool.R_flange_sensor)
    _require_near("B", c.B, wrench_matrix(tool), "weight, com, bias and R_flange_sensor")
    if not (tool.weight > 0.0 and c.mass > 0.0):
        raise InputError(f"weight is {tool.weight:g} N and mass {c.mass:g} kg, expected numbers above 0")
    g = c.provenance.get("g")
    if isinstance(g, float):
        _require_near("weight", tool.weight, c.mass * g, "mass and g")
    if c.weight_z is not None:
        _require_near("weight_z", c.weight_z, tool.weight, "weight")
    turned = c.yaw - yaw_of_mounting(tool.R_flange_sensor)[0]
    _require_near("yaw", np.exp(1j * turned), 1.0, "R_flange_sensor")
    _require_near(
        "parameters", c.parameters, parameters_of(tool, c.yaw, c.parameter_names), "weight, com, bias and yaw"
    )
    _check_B_covariance(c, matrix_jacobian(tool, c.parameter_names))


def _check_dynamics(c: CalibrationFields, d: Dynamics) -> None:
    if (tool := c.rigid_tool) is None or c.mass is None:
        raise InputError(f"model {c.model} has dynamics and no tool, expected a rigid model")
    for name in ("seconds", "bandwidth"):
        if not getattr(d, name) >= 0.0:
            raise InputError(f"dynamics.{name} has a number below 0, expected 0 or more")
    if (imu := d.accelerometer) is not None:
        numbers = np.r_[imu.matrix.ravel(), imu.bias, imu.drift, imu.noise, imu.delay]
        if not (np.abs(numbers) <= LARGEST_NUMBER).all() or not imu.scale > 0.0 or not imu.noise >= 0.0:
            raise InputError("dynamics.accelerometer has numbers that none has, expected a matrix with an inverse")
    if not (np.array_equal(d.inertia, d.inertia.T) and can_exist(d.inertia)):
        raise InputError("dynamics.inertia is that of no body, expected symmetric, with moments of inertia of a body")
    whole = d.with_covariance(c.covariance)
    _require_covariance("dynamics.covariance, with_parameters and covariance", whole)
    matrix = inertial_matrix(tool, c.mass, d.inertia, d.sensor_offset)
    _require_near("dynamics.matrix", d.matrix, matrix, "mass, com, R_flange_sensor, inertia and sensor_offset")


def _check_B_covariance(c: CalibrationFields, J: Array) -> None:
    """Raise `InputError` unless the covariance of B is that of the parameters, J (24, p) being B's derivative."""
    size = np.abs(J) @ np.abs(c.covariance) @ np.abs(J).T
    off = np.abs(J @ c.covariance @ J.T - c.B_covariance)
    if not (off <= COVARIANCE_TOLERANCE * size).all():
        raise InputError(f"found B_covariance off what follows from covariance, {UNEDITED}")


def _check_derived(c: CalibrationFields, derived: Derived) -> None:
    """Raise `InputError` unless standard deviations, warnings and the verdict are those of the fields."""
    for name, value in c.std.items():
        stored = derived.std.get(name)
        if (stored is None) != (value is None):
            raise InputError(f"std.{name} does not fit {c.model}, expected {'null' if value is None else 'a number'}")
        if value is not None:
            _require_shape(f"std.{name}", np.asarray(stored), np.shape(value))
            _require_near(f"std.{name}", np.asarray(stored), value, "covariance")
    if tuple(derived.warnings) != c.warnings:
        raise InputError(f"found warnings other than the texts of findings, {UNEDITED}")
    if derived.verdict not in (None, c.verdict):
        raise InputError(f"verdict is {derived.verdict!r}, and findings make it {c.verdict!r}, {UNEDITED}")
    _require_shape("expected_error", derived.expected_error, (2,))
    _require_shape("left_of_poses", derived.left_of_poses, (6,))
    left = c.left_of_poses
    if left is None:
        return
    if derived.left_of_poses is None:  # from before this was written, as the error to expect may have been another
        force, stated = np.linalg.norm(left[:3]), np.linalg.norm(c.residual_rms[:3])
        if force > max(OFF_POSES[0] * np.linalg.norm(c.B[:3, :3], 2), OFF_POSES[1] * stated):
            raise InputError(f"found {force:.3g} N left in the poses, and residual_rms {stated:.3g} N, {UNEDITED}")
        return
    rounding = ROUNDING if c.moments is None else ROUNDING_OF_SUMS
    largest = float(np.abs(c.B).max())
    _require_near("left_of_poses", derived.left_of_poses, left, "B, gravity_direction and the poses", rounding, largest)
    if derived.expected_error is not None:
        _require_near("expected_error", derived.expected_error, np.array(c.expected_error), "noise and covariance")


def _require_near(
    name: str, found: Any, expected: Any, source: str, rounding: float = ROUNDING, largest: float = 0.0
) -> None:
    """Raise `InputError` where a number is off from what others in the file give, by more than `B_TOLERANCE` and the
    `rounding` of numbers as large as it, or as the `largest` of those that it is what is left of.
    """
    off = float(np.abs(found - expected).max())
    if not off <= B_TOLERANCE + rounding * max(float(np.abs(expected).max()), largest):
        raise InputError(f"found {name} {off:.3g} off what follows from {source}, {UNEDITED}")
