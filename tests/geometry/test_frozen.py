"""Results are frozen all the way down: as they come, and as copies from a pickle, `deepcopy` and `replace`."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import fields, is_dataclass, replace
from functools import cache
from pathlib import Path
from tempfile import mkdtemp
from typing import Any, get_args, get_type_hints

import numpy as np
import pytest

import contactwrench as cw
from contactwrench.assess.diagnose import diagnose
from contactwrench.assess.plan import expected_tool, plan
from contactwrench.assess.verify import verify
from contactwrench.assess.weigh import weigh
from contactwrench.calibration.alternative import Alternatives
from contactwrench.compensate.contact_wrenches import contact_wrenches
from contactwrench.geometry.arrays import ReadOnlyDict, Sealed
from contactwrench.recording.interpretations import interpretations
from contactwrench.samples.samples import OrientationStream, Streams, WrenchStream
from contactwrench.samples.still_segments import still_segments
from contactwrench.samples.synchronize import synchronize
from tests.support.recordings import PANDA
from tests.support.world import random_rotations

COPIES: dict[str, Callable[[Any], Any]] = {
    "as it is": lambda result: result,
    "pickled": lambda result: pickle.loads(pickle.dumps(result)),
    "copied": copy.copy,
    "deeply copied": copy.deepcopy,
    "replaced": replace,
}


@cache
def results() -> dict[str, Any]:
    """One of each kind of result that a user gets, by name."""
    table = cw.read(PANDA)
    rng = np.random.default_rng(2)
    R = np.repeat(random_rotations(6, rng), 150, axis=0)
    calibration = cw.calibrate(table, "mount")
    t = 0.01 * np.arange(900.0) + np.repeat(2.0 * np.arange(6), 150)
    wrench = calibration.predict(R) + [0.05, 0.05, 0.05, 0.0025, 0.0025, 0.0025] * rng.normal(size=(900, 6))
    wrench[300:400, 2] += 20.0
    samples = cw.Samples(wrench, R, t, read_as={"sign": "pull"})
    streams = Streams(WrenchStream(t, wrench), OrientationStream(t[::5], R[::5]), {"sign": "pull"})
    compensator = cw.Compensator(calibration, rate=100.0, noise=0.05, fast=False)
    contacts = compensator.run(wrench, R, t)
    return {
        "Samples": table,
        "Samples with times": samples,
        "Streams": streams,
        "Calibration": calibration,
        "of auto": cw.calibrate(table),
        "of affine, for another gravity": cw.calibrate(table, "affine").with_gravity([0.0, 0.1, -1.0]),
        "of a stream": cw.calibrate(samples, "mount"),
        "Difference": calibration.diff(cw.calibrate(table, "mount+base")),
        "ContactWrench": compensator(wrench[0], R[0], 100.0),
        "a fault": compensator(np.full(6, np.nan), R[0], 101.0),
        "ContactWrenches": contacts,
        "a selection": contacts.select(slice(3, 9)),
        "Contact": contacts.contacts[0],
        "its line": contacts.contacts[0].line,
        "Zero": compensator.zero(samples.select(slice(0, 100))),
        "contact_wrenches": contact_wrenches(calibration, table, "flange"),
        "Verification": verify(calibration, table),
        "HeldObject": weigh(calibration, table),
        "Plan": plan(2, expected_tool(table)),
        "Diagnosis": diagnose(interpretations(PANDA)),
        "StillSegments": still_segments(samples),
        "Synchronized": synchronize(streams),
    }


def within(value: Any, path: str) -> Iterator[tuple[str, Any]]:
    """Everything that hangs on a result, what it has computed and cached included."""
    yield path, value
    if is_dataclass(value) and not isinstance(value, type):
        for name in sorted({*(each.name for each in fields(value)), *vars(value)}):
            yield from within(getattr(value, name), f"{path}.{name}")
    elif isinstance(value, list | tuple | Alternatives):
        for k, part in enumerate(value):
            yield from within(part, f"{path}[{k}]")
    elif isinstance(value, dict):
        for key, part in value.items():
            yield from within(part, f"{path}[{key!r}]")


def can_be_changed(value: Any) -> bool:
    if isinstance(value, np.ndarray):
        with suppress(ValueError):
            value.setflags(write=True)
        return bool(value.flags.writeable)
    if isinstance(value, dict):
        return not isinstance(value, ReadOnlyDict)
    if is_dataclass(value):
        return not value.__dataclass_params__.frozen  # type: ignore[union-attr]
    return isinstance(value, list | set | bytearray)


@pytest.mark.parametrize("way", COPIES)
def test_nothing_on_a_result_can_be_changed(way: str) -> None:
    for name, result in results().items():
        if isinstance(result, cw.Calibration):
            assert result.std, result.error_covariance.size  # cached
        copied = COPIES[way](result)
        assert [path for path, value in within(copied, name) if can_be_changed(value)] == []


def test_a_copy_is_equal() -> None:
    for name, result in results().items():
        for way in COPIES.values():
            here, there = dict(within(result, name)), dict(within(way(result), name))
            for path, value in there.items():
                if isinstance(value, np.ndarray):
                    assert np.array_equal(value, here[path], equal_nan=value.dtype.kind == "f"), path
                    assert value.dtype == here[path].dtype


def test_changing_a_result_is_refused_in_every_way() -> None:
    calibration = cw.Calibration.load(_saved(results()["Calibration"]))
    changes: list[Callable[[], Any]] = [
        lambda: calibration.std.update(weight=0.0),
        lambda: calibration.provenance.pop("g"),
        lambda: calibration.provenance.setdefault("x", 1),
        calibration.std.clear,
        calibration.std.popitem,
        lambda: calibration.std.__setitem__("weight", 0.0),
        lambda: calibration.std.__delitem__("weight"),
        lambda: calibration.std.__ior__({"weight": 0.0}),
        lambda: results()["Samples with times"].read_as.update(sign="reaction"),
    ]
    for change in changes:
        with pytest.raises(TypeError, match=r"^a result cannot be changed: change a copy, dict\(\.\.\.\)$"):
            change()
    with pytest.raises(ValueError, match="read-only"):
        calibration.std["com"][0] = 0.0
    with pytest.raises(ValueError, match="read-only"):
        calibration.error_covariance[0, 0] = 0.0
    own = dict(calibration.provenance) | {"mine": 1}
    own["g"] = 0.0
    assert calibration.provenance["g"] == 9.80665


def _saved(calibration: cw.Calibration) -> Path:
    path = Path(mkdtemp()) / "tool.json"
    calibration.save(path)
    return path


def test_what_a_frozen_result_may_hold_is_frozen_too() -> None:
    """By the types of their fields: no dataclass that could be changed, or copied into one that could."""
    kinds: list[Any] = list(_kinds(Sealed))
    held = {part for kind in kinds for hint in get_type_hints(kind).values() for part in _parts(hint)}
    assert sorted(part.__name__ for part in held if _is_open_ended(part)) == []
    assert len(kinds) > 25


def _is_open_ended(kind: Any) -> bool:
    if not hasattr(kind, "__dataclass_params__") or issubclass(kind, Sealed):
        return False
    return not kind.__dataclass_params__.frozen or any(map(_holds_arrays, get_type_hints(kind).values()))


def _kinds(base: type) -> Iterator[type]:
    kind: type
    for kind in base.__subclasses__():
        if kind.__module__.startswith("contactwrench."):
            yield kind
            yield from _kinds(kind)


def _parts(hint: Any) -> Iterator[Any]:
    if isinstance(hint, type):
        yield hint
    for part in get_args(hint):
        yield from _parts(part)


def _holds_arrays(hint: Any) -> bool:
    return any(
        issubclass(part, np.ndarray | dict | list | set) for part in [*_parts(hint), getattr(hint, "__origin__", int)]
    )
