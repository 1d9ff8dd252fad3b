"""The calibration file: JSON with the fields of `Calibration` under their names, checked on reading (design: 6)."""

from __future__ import annotations

import codecs
from dataclasses import fields
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from ..errors import FileFormatError, InputError
from ..files import read_bytes, write_text
from ..geometry.arrays import Array
from ..geometry.orientation import nearest_rotations
from ..model import PARAMETERS, RigidTool, matrix_jacobian, wrench_matrix, yaw_of_mounting
from ..samples.poses import Pose, PoseMoments
from .alternative import Alternative
from .calibration import Calibration
from .observability import Observability

SCHEMA = "contactwrench/calibration/1"
_FAMILY, _, _NUMBER = SCHEMA.rpartition("/")
B_TOLERANCE = 1e-9
ROUNDING = 1e-14
COVARIANCE_TOLERANCE = 1e-6


class _Pose(msgspec.Struct):
    R_base_flange: list[list[float]]
    wrench: list[float]
    wrench_cov: list[list[float]]
    n: int
    t_start: float | None
    t_end: float | None
    rejected: str | None


class _Moments(msgspec.Struct):
    n: int
    design: list[list[float]]
    cross: list[list[float]]
    wrench: list[list[float]]


class _Observability(msgspec.Struct):
    rank: int
    singular_values: list[float]
    condition: float
    tilt_range: list[float]
    trade_offs: list[str]


class _Alternative(msgspec.Struct):
    model: str
    weight: float | None
    weight_std: float | None
    force_left: float
    torque_left: float
    B: list[list[float]]
    gravity_direction: list[float]


class _Std(msgspec.Struct):
    weight: float | None
    com: list[float] | None
    bias: list[float]
    yaw: float | None
    mount: list[float] | None
    gravity: list[float] | None


class _File(msgspec.Struct):
    """The file, key by key; msgspec names a key that is missing or of the wrong type."""

    schema: str
    requested_model: str
    model: str
    weight: float | None
    mass: float | None
    com: list[float] | None
    bias: list[float]
    R_flange_sensor: list[list[float]] | None
    yaw: float | None
    gravity_direction: list[float]
    B: list[list[float]]
    B_covariance: list[list[float]]
    parameter_names: list[str]
    parameters: list[float]
    covariance: list[list[float]]
    std: _Std
    noise: list[float]
    residual_rms: list[float]
    held_out_rms: list[float] | None
    reduced_chi2: float
    dof: float
    observability: _Observability
    warnings: list[str]
    provenance: dict[str, str | int | float | bool | None]
    poses: list[_Pose]
    moments: _Moments | None
    weight_xy: float | None
    weight_z: float | None
    parameter_dof: list[float] | None = None
    assumptions: list[str] = []
    alternatives: list[_Alternative] = []
    delay: float | None = None
    delay_std: float | None = None


def to_json(calibration: Calibration) -> str:
    """The saved form: one key a line, every number in the shortest form that reads back exactly."""
    values: dict[str, Any] = {"schema": SCHEMA}
    for field in fields(Calibration):
        values[field.name] = _plain(getattr(calibration, field.name))
        if field.name == "covariance":
            values["std"] = _plain(calibration.std)
    lines = [f"  {_encoded(key)}: {_encoded(value)}" for key, value in values.items()]
    return "{\n" + ",\n".join(lines) + "\n}\n"


def save(calibration: Calibration, path: str | Path) -> None:
    """Write the saved form to `path`; see files.py."""
    write_text(path, to_json(calibration))


def load(path: str | Path) -> Calibration:
    """Read and check a calibration file. Raises `FileAccessError`; `FileFormatError` naming what is wrong with it."""
    content = read_bytes(path).removeprefix(codecs.BOM_UTF8)
    try:
        values = msgspec.json.decode(content)
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
        file = msgspec.convert(values, _File)
    except msgspec.ValidationError as error:
        raise FileFormatError(f"{path}: {error}, expected a saved calibration: {_AGAIN}") from None
    try:
        with np.errstate(over="ignore", invalid="ignore"):
            _check(file)
            calibration = _calibration(file)
            _check_std(file.std, calibration)
        return calibration
    except InputError as error:
        raise FileFormatError(f"{path}: {error}: {_AGAIN}") from None


_AGAIN = "calibrate again or restore the file"


def _plain(value: Any) -> Any:
    """Arrays as nested lists, records as objects."""
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, dict):
        return {key: _plain(part) for key, part in value.items()}
    if isinstance(value, tuple):
        return [_plain(part) for part in value]
    if isinstance(value, Pose | PoseMoments | Observability | Alternative):
        return {field.name: _plain(getattr(value, field.name)) for field in fields(value)}
    return value


def _encoded(value: Any) -> str:
    return msgspec.json.encode(value).decode()


def _check(file: _File) -> None:
    """Raise `InputError` unless the shapes fit, the rotation is one, and whatever follows from other numbers does."""
    if file.model not in PARAMETERS:
        raise InputError(f"model is {file.model!r}, expected one of {', '.join(PARAMETERS)}")
    names = PARAMETERS[file.model]
    if tuple(file.parameter_names) != names:
        raise InputError(f"parameter_names do not fit model {file.model}, expected {', '.join(names)}")
    p = len(names)
    shapes: dict[str, tuple[int, ...]] = {
        "bias": (6,),
        "gravity_direction": (3,),
        "B": (6, 4),
        "B_covariance": (24, 24),
        "parameters": (p,),
        "covariance": (p, p),
        "noise": (6,),
        "residual_rms": (6,),
    }
    arrays = {name: _array(name, getattr(file, name), shape) for name, shape in shapes.items()}
    arrays["observability.tilt_range"] = _array("observability.tilt_range", file.observability.tilt_range, (2,))
    if file.parameter_dof is not None:
        arrays["parameter_dof"] = _array("parameter_dof", file.parameter_dof, (p,))
    for k, other in enumerate(file.alternatives):
        _array(f"alternatives[{k}].B", other.B, (6, 4))
        _array(f"alternatives[{k}].gravity_direction", other.gravity_direction, (3,))
    if file.held_out_rms is not None:
        arrays["held_out_rms"] = _array("held_out_rms", file.held_out_rms, (6,))
    if file.moments is not None:
        for name, shape in {"design": (10, 10), "cross": (10, 6), "wrench": (6, 6)}.items():
            _array(f"moments.{name}", getattr(file.moments, name), shape)
    _check_signs(file, arrays)
    for k, pose in enumerate(file.poses):
        _array(f"poses[{k}].wrench", pose.wrench, (6,))
        _array(f"poses[{k}].wrench_cov", pose.wrench_cov, (6, 6))
        _rotation(f"poses[{k}].R_base_flange", pose.R_base_flange)
    if not abs(float(np.linalg.norm(arrays["gravity_direction"])) - 1.0) <= B_TOLERANCE:
        raise InputError("gravity_direction has not length 1")
    if file.model == "affine":
        _check_affine(file, arrays)
    else:
        _check_rigid(file, arrays)


def _check_signs(file: _File, arrays: dict[str, Array]) -> None:
    for name in ("noise", "residual_rms", "held_out_rms", "observability.tilt_range", "parameter_dof"):
        if (arrays.get(name, np.zeros(1)) < 0.0).any():
            raise InputError(f"{name} has a number below 0, expected 0 or more")
    if file.dof < 0.0 or file.reduced_chi2 < 0.0:
        raise InputError(f"dof is {file.dof:g} and reduced_chi2 {file.reduced_chi2:g}, expected 0 or more")
    if file.delay_std is not None and file.delay_std < 0.0:
        raise InputError(f"delay_std is {file.delay_std:g}, expected 0 or more")
    if (file.delay is None) != (file.delay_std is None):
        raise InputError("found one of delay and delay_std, expected both or neither")
    if (np.diag(arrays["covariance"]) < 0.0).any():
        raise InputError("covariance has a variance below 0, expected 0 or more")


def _check_affine(file: _File, arrays: dict[str, Array]) -> None:
    rigid = (file.weight, file.mass, file.com, file.R_flange_sensor, file.yaw)
    if any(value is not None for value in rigid):
        raise InputError("model affine has a weight, mass, com, R_flange_sensor or yaw, expected null")
    _require_near("the last column of B", arrays["B"][:, 3], arrays["bias"], "bias")
    _require_near("parameters", arrays["parameters"], arrays["B"].ravel(), "B")
    _check_B_covariance(arrays, np.eye(24))


def _check_rigid(file: _File, arrays: dict[str, Array]) -> None:
    if file.weight is None or file.mass is None or file.com is None or file.R_flange_sensor is None or file.yaw is None:
        raise InputError(f"model {file.model} lacks weight, mass, com, R_flange_sensor or yaw, expected numbers")
    R_flange_sensor = _rotation("R_flange_sensor", file.R_flange_sensor)
    com = _array("com", file.com, (3,))
    tool = RigidTool(file.weight, com, arrays["bias"], R_flange_sensor, arrays["gravity_direction"])
    _require_near("B", arrays["B"], wrench_matrix(tool), "weight, com, bias and R_flange_sensor")
    if not (file.weight > 0.0 and file.mass > 0.0):
        raise InputError(f"weight is {file.weight:g} N and mass {file.mass:g} kg, expected numbers above 0")
    g = file.provenance.get("g")
    if isinstance(g, float):
        _require_near("weight", np.array(file.weight), np.array(file.mass * g), "mass and g")
    if file.weight_z is not None:
        _require_near("weight_z", np.array(file.weight_z), np.array(file.weight), "weight")
    turned = file.yaw - yaw_of_mounting(R_flange_sensor)[0]
    _require_near("yaw", np.exp(np.array(1j * turned)), np.array(1.0), "R_flange_sensor")
    names = PARAMETERS[file.model]
    parameters = np.zeros(len(names))
    parameters[:10] = np.r_[file.weight, com, arrays["bias"]]
    if "yaw" in names:
        parameters[10] = file.yaw
    _require_near("parameters", arrays["parameters"], parameters, "weight, com, bias and yaw")
    _check_B_covariance(arrays, matrix_jacobian(tool, names))


def _check_B_covariance(arrays: dict[str, Array], J: Array) -> None:
    """Raise `InputError` unless the covariance of B is that of the parameters, J (24, p) being B's derivative."""
    size = np.abs(J) @ np.abs(arrays["covariance"]) @ np.abs(J).T
    off = np.abs(J @ arrays["covariance"] @ J.T - arrays["B_covariance"])
    if not (off <= COVARIANCE_TOLERANCE * size).all():
        raise InputError("found B_covariance off what follows from covariance: the file was edited")


def _check_std(std: _Std, calibration: Calibration) -> None:
    for name, value in calibration.std.items():
        stored = getattr(std, name)
        if (stored is None) != (value is None):
            raise InputError(f"std.{name} does not fit model {calibration.model}")
        if value is not None:
            expected = np.asarray(value)
            _require_near(f"std.{name}", _array(f"std.{name}", stored, expected.shape), expected, "covariance")


def _require_near(name: str, found: Any, expected: Any, source: str) -> None:
    """Raise `InputError` where a number is off from what others in the file give, by more than `B_TOLERANCE`."""
    off = float(np.abs(found - expected).max())
    if not off <= B_TOLERANCE + ROUNDING * float(np.abs(expected).max()):
        raise InputError(f"found {name} {off:.3g} off what follows from {source}: the file was edited")


def _array(name: str, values: Any, shape: tuple[int, ...]) -> Array:
    try:
        array = np.array(values, dtype=np.float64)
    except ValueError:
        array = np.empty(0)
    if array.shape != shape:
        raise InputError(f"{name} has not the shape {shape}")
    return array


def _rotation(name: str, values: list[list[float]]) -> Array:
    R = _array(name, values, (3, 3))
    try:
        nearest = nearest_rotations(R[None])[0]
    except InputError:
        raise InputError(f"{name} is no rotation matrix") from None
    if np.abs(nearest - R).max() > 1e-6:
        raise InputError(f"{name} is no rotation matrix")
    return R


def _calibration(file: _File) -> Calibration:
    values = {field.name: getattr(file, field.name) for field in fields(Calibration)}
    values["observability"] = Observability(**msgspec.structs.asdict(file.observability))
    values["poses"] = tuple(Pose(**msgspec.structs.asdict(pose)) for pose in file.poses)
    values["moments"] = None if file.moments is None else PoseMoments(**msgspec.structs.asdict(file.moments))
    values["alternatives"] = tuple(Alternative(**msgspec.structs.asdict(other)) for other in file.alternatives)
    return Calibration(**values)
