"""The calibration file: JSON with the fields of `Calibration` under their names, checked on reading (design: 6)."""

from __future__ import annotations

import codecs
import json
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path
from threading import Lock
from typing import Any, TypeVar, get_args

import msgspec
import numpy as np

from ..errors import FileFormatError, InputError
from ..files import read_bytes
from ..geometry.arrays import Array
from .consistency import FOLLOWS, Derived, require_consistent
from .fields import CalibrationFields
from .findings import Kind, Severity

SCHEMA = "contactwrench/calibration/1"
_FAMILY, _, _NUMBER = SCHEMA.rpartition("/")
_AGAIN = "calibrate again or restore the file"
ADDED = (
    *("parameter_dof", "assumptions", "alternatives"),  # with auto
    *("delay", "delay_std"),  # with recordings
    *("findings", "verdict", "expected_error"),
    *("still_noise", "gain_covariance", "left_of_poses"),
    *("dynamics", "dynamics.accelerometer", "dynamics.accelerometer.delay", "dynamics.accelerometer.drift"),
    *("orientation_std", "still_noise.row_std"),
)
"""Keys that the first files did not have, in the order in which they came, those of an object with its name: a file
that has one of them has all before it, or was cut. A new key goes to the end.
"""
_ONE_AT_A_TIME = Lock()  # msgspec 0.22 crashes where two threads look at a type for the first time

Form = TypeVar("Form", bound=CalibrationFields)


def to_json(calibration: CalibrationFields) -> str:
    """The saved form: one key a line, every number in the shortest form that reads back exactly."""
    values: dict[str, Any] = {"schema": SCHEMA}
    for field in fields(CalibrationFields):
        values[field.name] = getattr(calibration, field.name)
        if field.name == "covariance":
            values["std"] = calibration.std
        if field.name == "findings":
            values |= {name: getattr(calibration, name) for name in ("warnings", *FOLLOWS)}
    values["alternatives"] = tuple(calibration.alternatives)
    lines = [f"  {_encoded(key)}: {_encoded(value)}" for key, value in values.items()]
    return "{\n" + ",\n".join(lines) + "\n}\n"


def load(path: str | Path, form: type[Form]) -> Form:
    """Read and check a calibration file. Raises `FileAccessError`; `FileFormatError` naming what is wrong with it."""
    content = read_bytes(path).removeprefix(codecs.BOM_UTF8)
    if content[:1].isalnum():
        raise FileFormatError(f"{path}: found no JSON, expected a saved calibration: name one (info shows a recording)")
    try:
        values = msgspec.json.decode(content)
        json.loads(content, object_pairs_hook=_each_once)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        found = _no_number(content) or f"no whole JSON file ({error})"
        raise FileFormatError(f"{path}: {found}, expected a saved calibration: {_AGAIN}") from None
    schema = values.get("schema") if isinstance(values, dict) else None
    if schema != SCHEMA:
        number, remedy = str(schema).rpartition("/")[2], _AGAIN
        if not str(schema).startswith(f"{_FAMILY}/"):
            remedy = "name a file that calibrate wrote"
        elif number.isdecimal() and float(number) > float(_NUMBER):
            remedy = "upgrade contactwrench"
        raise FileFormatError(f"{path}: found schema {repr(schema)[:60]}, expected {SCHEMA!r}: {remedy}")
    try:
        _require_all_before(values)
        with _ONE_AT_A_TIME:
            derived = msgspec.convert(values, Derived, dec_hook=_array)
            calibration = msgspec.convert(_with_findings(values, derived.warnings), form, dec_hook=_array)
    except msgspec.ValidationError as error:
        where = _whole_path(str(error))
        raise FileFormatError(f"{path}: {where}, expected a saved calibration: {_AGAIN}") from None
    try:
        with np.errstate(over="ignore", invalid="ignore"):
            require_consistent(calibration, derived)
        return calibration
    except InputError as error:
        raise FileFormatError(f"{path}: {error}: {_AGAIN}") from None


def _each_once(pairs: list[tuple[str, Any]]) -> None:
    if len(dict(pairs)) < len(pairs):
        raise msgspec.DecodeError(f"a key is there twice beside {pairs[0][0][:40]!r}")


def _require_all_before(values: dict[str, Any]) -> None:
    """Raise `msgspec.ValidationError`, in its words, for a key of `ADDED` that a file with a later one lacks."""
    lacking = ""
    for key in ADDED:
        within: Any = values
        *whole, part = key.split(".")
        for name in whole:
            within = within.get(name) if isinstance(within, dict) else None
        if isinstance(within, dict) and part not in within:
            place = f" - at `$.{'.'.join(whole)}`" if whole else ""
            lacking = lacking or f"Object missing required field `{part}`{place}"
        elif isinstance(within, dict) and lacking:
            raise msgspec.ValidationError(lacking)


class _Constant(str):
    """NaN, Infinity or -Infinity, which Python writes and JSON does not have."""


def _no_number(content: bytes) -> str:
    """The first of these in a file, and its place; nothing where something else is wrong."""
    try:
        return next(_constants(json.loads(content, parse_constant=_Constant), "$"), "")
    except (ValueError, RecursionError):
        return ""


def _constants(value: Any, where: str) -> Iterator[str]:
    if isinstance(value, _Constant):
        yield f"Expected `float`, got {value} - at `{where}`"
    elif isinstance(value, dict):
        for key, each in value.items():
            yield from _constants(each, f"{where}.{key}")
    elif isinstance(value, list):
        for k, each in enumerate(value):
            yield from _constants(each, f"{where}[{k}]")


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
    """A file from before findings has their texts only; "weak" at the beginning says how bad one is."""
    if "findings" in values:
        return values
    severity = {text: Severity.WEAK if text.startswith("weak") else Severity.WARNING for text in warnings}
    findings = [{"kind": Kind.OTHER, "severity": severity[text], "text": text} for text in warnings]
    return {**values, "findings": findings}
