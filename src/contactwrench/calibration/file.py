"""The calibration file: JSON with the fields of `Calibration` under their names, checked on reading (design: 6)."""

from __future__ import annotations

import codecs
import json
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any, TypeVar, get_args

import msgspec
import numpy as np

from ..errors import FileFormatError, InputError
from ..files import read_bytes
from ..geometry.arrays import Array, Vector
from ..geometry.orientation import nearest_rotations
from ..model import PARAMETERS, RigidTool, matrix_jacobian, wrench_matrix, yaw_of_mounting
from .fields import CalibrationFields
from .findings import Kind, Severity

SCHEMA = "contactwrench/calibration/1"
_FAMILY, _, _NUMBER = SCHEMA.rpartition("/")
B_TOLERANCE = 1e-9
ROUNDING = 1e-14
COVARIANCE_TOLERANCE = 1e-6
NOT_NEGATIVE = ("residual_rms", "held_out_rms", "observability.tilt_range", "parameter_dof", "still_noise.std")
_AGAIN = "calibrate again or restore the file"

Form = TypeVar("Form", bound=CalibrationFields)


class _Std(msgspec.Struct):
    weight: float | None
    com: Vector | None
    bias: Vector
    yaw: float | None
    mount: Vector | None
    gravity: Vector | None


class _Derived(msgspec.Struct):
    """What the file says beside the fields, for programs that read it; it follows from them."""

    std: _Std
    warnings: list[str]


def to_json(calibration: CalibrationFields) -> str:
    """The saved form: one key a line, every number in the shortest form that reads back exactly."""
    values: dict[str, Any] = {"schema": SCHEMA}
    for field in fields(CalibrationFields):
        values[field.name] = getattr(calibration, field.name)
        if field.name == "covariance":
            values["std"] = calibration.std
        if field.name == "findings":
            values |= {name: getattr(calibration, name) for name in ("warnings", "verdict", "expected_error")}
    lines = [f"  {_encoded(key)}: {_encoded(value)}" for key, value in values.items()]
    return "{\n" + ",\n".join(lines) + "\n}\n"


def load(path: str | Path, form: type[Form]) -> Form:
    """Read and check a calibration file. Raises `FileAccessError`; `FileFormatError` naming what is wrong with it."""
    content = read_bytes(path).removeprefix(codecs.BOM_UTF8)
    try:
        values = msgspec.json.decode(content)
        json.loads(content, object_pairs_hook=_each_once)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise FileFormatError(f"{path}: no whole JSON file ({error}), expected a saved calibration: {_AGAIN}") from None
    schema = values.get("schema") if isinstance(values, dict) else None
    if not isinstance(schema, str) or not schema.startswith(f"{_FAMILY}/"):
        raise FileFormatError(
            f"{path}: found schema {repr(schema)[:60]}, expected {SCHEMA!r}: name a file that calibrate wrote"
        )
    if schema != SCHEMA:
        number = schema.rpartition("/")[2]
        newer = number.isdecimal() and float(number) > float(_NUMBER)
        remedy = "upgrade contactwrench" if newer else _AGAIN
        raise FileFormatError(f"{path}: found schema {repr(schema)[:60]}, this version reads {SCHEMA!r}: {remedy}")
    try:
        derived = msgspec.convert(values, _Derived, dec_hook=_array)
        calibration = msgspec.convert(_with_findings(values, derived.warnings), form, dec_hook=_array)
    except msgspec.ValidationError as error:
        where = _whole_path(str(error))
        raise FileFormatError(f"{path}: {where}, expected a saved calibration: {_AGAIN}") from None
    try:
        with np.errstate(over="ignore", invalid="ignore"):
            _check(calibration)
            _check_derived(calibration, derived)
        return calibration
    except InputError as error:
        raise FileFormatError(f"{path}: {error}: {_AGAIN}") from None


def _each_once(pairs: list[tuple[str, Any]]) -> None:
    if len(dict(pairs)) < len(pairs):
        raise msgspec.DecodeError(f"a key is there twice beside {pairs[0][0][:40]!r}")


def _encoded(value: Any) -> str:
    return msgspec.json.encode(value, enc_hook=np.ndarray.tolist).decode()


def _array(kind: Any, value: Any) -> Array:
    """Nested lists of numbers as an array of the axes that its type says; rows of unequal length as an empty one."""
    axes = len(get_args(get_args(kind)[0]))
    try:
        numbers: Any = msgspec.convert(value, list[float] if axes == 1 else list[list[float]])
    except msgspec.ValidationError as error:
        raise ValueError(str(error)) from None  # so that msgspec adds the place of the array to that of the number
    try:
        return np.array(numbers, dtype=np.float64)
    except ValueError:
        return np.empty(0)


def _whole_path(message: str) -> str:
    """A complaint of msgspec with the place of a number in its array joined to the place of the array."""
    said, *places = message.split(" - at `$")
    path = "".join(place.removesuffix("`") for place in reversed(places))
    return f"{said} - at `${path}`" if path else said


def _with_findings(values: dict[str, Any], warnings: list[str]) -> dict[str, Any]:
    """A file from before findings has their texts only, in which the word "weak" at the beginning said how bad one is;
    nothing in it says of what kind.
    """
    if "findings" in values:
        return values
    severity = {text: Severity.WEAK if text.startswith("weak") else Severity.WARNING for text in warnings}
    findings = [{"kind": Kind.OTHER, "severity": severity[text], "text": text} for text in warnings]
    return {**values, "findings": findings}


def _check(c: CalibrationFields) -> None:
    """Raise `InputError` unless the shapes fit, the rotation is one, and whatever follows from other numbers does."""
    if c.model not in PARAMETERS:
        raise InputError(f"model is {c.model!r}, expected one of {', '.join(PARAMETERS)}")
    names = PARAMETERS[c.model]
    if c.parameter_names != names:
        raise InputError(f"parameter_names do not fit model {c.model}, expected {', '.join(names)}")
    for name, array, shape in _shapes(c):
        _require_shape(name, array, shape)
        if name in NOT_NEGATIVE and array is not None and (array < 0.0).any():
            raise InputError(f"{name} has a number below 0, expected 0 or more")
    if not (c.noise > 0.0).all():
        raise InputError("noise has a number that is not above 0, expected 6 above 0")
    _check_numbers(c)
    for k, pose in enumerate(c.poses):
        _require_shape(f"poses[{k}].wrench", pose.wrench, (6,))
        _require_shape(f"poses[{k}].wrench_cov", pose.wrench_cov, (6, 6))
        _require_rotation(f"poses[{k}].R_base_flange", pose.R_base_flange)
    if not abs(float(np.linalg.norm(c.gravity_direction)) - 1.0) <= B_TOLERANCE:
        raise InputError("gravity_direction has not length 1")
    if c.model == "affine":
        _check_affine(c)
    else:
        _check_rigid(c)


def _shapes(c: CalibrationFields) -> Iterator[tuple[str, Array | None, tuple[int, ...]]]:
    """Every array whose shape the model or the format says, its name, and that shape."""
    p = len(c.parameter_names)
    yield from [
        ("bias", c.bias, (6,)),
        ("gravity_direction", c.gravity_direction, (3,)),
        ("B", c.B, (6, 4)),
        ("B_covariance", c.B_covariance, (24, 24)),
        ("parameters", c.parameters, (p,)),
        ("covariance", c.covariance, (p, p)),
        ("noise", c.noise, (6,)),
        ("residual_rms", c.residual_rms, (6,)),
        ("observability.tilt_range", c.observability.tilt_range, (2,)),
        ("parameter_dof", c.parameter_dof, (p,)),
        ("held_out_rms", c.held_out_rms, (6,)),
        ("gain_covariance", c.gain_covariance, (24, 24)),
    ]
    for k, other in enumerate(c.alternatives):
        yield f"alternatives[{k}].B", other.B, (6, 4)
        yield f"alternatives[{k}].gravity_direction", other.gravity_direction, (3,)
    if c.still_noise is not None:
        yield "still_noise.std", c.still_noise.std, (len(c.still_noise.duration), 6)
    if c.moments is not None:
        yield "moments.design", c.moments.design, (10, 10)
        yield "moments.cross", c.moments.cross, (10, 6)
        yield "moments.wrench", c.moments.wrench, (6, 6)


def _require_shape(name: str, array: Array | None, shape: tuple[int, ...]) -> None:
    if array is not None and array.shape != shape:
        raise InputError(f"{name} has not the shape {shape}")


def _require_rotation(name: str, R: Array) -> None:
    _require_shape(name, R, (3, 3))
    try:
        nearest = nearest_rotations(R[None])[0]
    except InputError:
        raise InputError(f"{name} is no rotation matrix") from None
    if np.abs(nearest - R).max() > 1e-6:
        raise InputError(f"{name} is no rotation matrix")


def _check_numbers(c: CalibrationFields) -> None:
    if c.dof < 0.0 or c.reduced_chi2 < 0.0:
        raise InputError(f"dof is {c.dof:g} and reduced_chi2 {c.reduced_chi2:g}, expected 0 or more")
    if c.delay_std is not None and c.delay_std < 0.0:
        raise InputError(f"delay_std is {c.delay_std:g}, expected 0 or more")
    if (c.delay is None) != (c.delay_std is None):
        raise InputError("found one of delay and delay_std, expected both or neither")
    if c.still_noise is not None and not (np.diff(c.still_noise.duration, prepend=0.0) > 0.0).all():
        raise InputError("found still_noise.duration not ascending from above 0")
    if (np.diag(c.covariance) < 0.0).any():
        raise InputError("covariance has a variance below 0, expected 0 or more")


def _check_affine(c: CalibrationFields) -> None:
    if any(value is not None for value in (c.weight, c.mass, c.com, c.R_flange_sensor, c.yaw)):
        raise InputError("model affine has a weight, mass, com, R_flange_sensor or yaw, expected null")
    _require_near("the last column of B", c.B[:, 3], c.bias, "bias")
    _require_near("parameters", c.parameters, c.B.ravel(), "B")
    _check_B_covariance(c, np.eye(24))


def _check_rigid(c: CalibrationFields) -> None:
    if c.weight is None or c.mass is None or c.com is None or c.R_flange_sensor is None or c.yaw is None:
        raise InputError(f"model {c.model} lacks weight, mass, com, R_flange_sensor or yaw, expected numbers")
    _require_rotation("R_flange_sensor", c.R_flange_sensor)
    _require_shape("com", c.com, (3,))
    tool = RigidTool(c.weight, c.com, c.bias, c.R_flange_sensor, c.gravity_direction)
    _require_near("B", c.B, wrench_matrix(tool), "weight, com, bias and R_flange_sensor")
    if not (c.weight > 0.0 and c.mass > 0.0):
        raise InputError(f"weight is {c.weight:g} N and mass {c.mass:g} kg, expected numbers above 0")
    g = c.provenance.get("g")
    if isinstance(g, float):
        _require_near("weight", c.weight, c.mass * g, "mass and g")
    if c.weight_z is not None:
        _require_near("weight_z", c.weight_z, c.weight, "weight")
    turned = c.yaw - yaw_of_mounting(c.R_flange_sensor)[0]
    _require_near("yaw", np.exp(1j * turned), 1.0, "R_flange_sensor")
    parameters = np.zeros(len(c.parameter_names))
    parameters[:10] = np.r_[c.weight, c.com, c.bias]
    if "yaw" in c.parameter_names:
        parameters[10] = c.yaw
    _require_near("parameters", c.parameters, parameters, "weight, com, bias and yaw")
    _check_B_covariance(c, matrix_jacobian(tool, c.parameter_names))


def _check_B_covariance(c: CalibrationFields, J: Array) -> None:
    """Raise `InputError` unless the covariance of B is that of the parameters, J (24, p) being B's derivative."""
    size = np.abs(J) @ np.abs(c.covariance) @ np.abs(J).T
    off = np.abs(J @ c.covariance @ J.T - c.B_covariance)
    if not (off <= COVARIANCE_TOLERANCE * size).all():
        raise InputError("found B_covariance off what follows from covariance: the file was edited")


def _check_derived(c: CalibrationFields, derived: _Derived) -> None:
    """Raise `InputError` unless the standard deviations and the warnings are those of the fields."""
    for name, value in c.std.items():
        stored = getattr(derived.std, name)
        if (stored is None) != (value is None):
            raise InputError(f"std.{name} does not fit model {c.model}")
        if value is not None:
            _require_shape(f"std.{name}", np.asarray(stored), np.shape(value))
            _require_near(f"std.{name}", stored, value, "covariance")
    if tuple(derived.warnings) != c.warnings:
        raise InputError("found warnings other than the texts of findings: the file was edited")


def _require_near(name: str, found: Any, expected: Any, source: str) -> None:
    """Raise `InputError` where a number is off from what others in the file give, by more than `B_TOLERANCE`."""
    off = float(np.abs(found - expected).max())
    if not off <= B_TOLERANCE + ROUNDING * float(np.abs(expected).max()):
        raise InputError(f"found {name} {off:.3g} off what follows from {source}: the file was edited")
