"""What is handed over in Python is numbers or refused: nothing is parsed, cut off or made up."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime, timedelta, timezone
from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import contactwrench as cw
from contactwrench.assess.robot_arms import known_arm, within_limits
from contactwrench.compensate.line_of_action import line_of_action, point_on_axis, point_on_plane
from contactwrench.errors import InputError
from contactwrench.geometry.arrays import numbers, seconds
from contactwrench.samples.delay import estimate_delay
from contactwrench.samples.samples import OrientationStream, Streams, WrenchStream
from tests.support.rigs import example, noisy
from tests.support.world import Array, random_rotations

READINGS = np.arange(72.0).reshape(12, 6)
R = random_rotations(12, np.random.default_rng(1))
TIMES = np.arange(12.0)
COVARIANCE = np.eye(6)
STREAMS = Streams(WrenchStream(TIMES, READINGS), OrientationStream(TIMES, R))
CONVERT = "expected numbers: convert them, as by .astype(float)"
UNEQUAL = "rows of unequal length, expected an array of numbers"
MASKED = "masked values, expected none: leave such samples out, or fill them"


class Frame:
    """As a frame of pandas, polars or xarray comes: something that knows how to be an array."""

    def __init__(self, values: Any) -> None:
        self.values = values

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Any:
        return np.asarray(self.values, dtype)


def _masked(a: Array) -> Any:
    mask = np.zeros(a.shape, bool)
    mask.flat[-1] = True
    return np.ma.masked_array(a, mask)


def _ragged(a: Array) -> Any:
    return [*a.tolist()[:-1], [1.0, 2.0]]


NO_NUMBERS: dict[str, tuple[Callable[[Array], Any], str]] = {
    "text": (lambda a: a.astype(str), f"text, {CONVERT}"),
    "a list of text": (lambda a: a.astype(str).tolist(), f"text, {CONVERT}"),
    "bytes": (lambda a: a.astype(bytes), f"text, {CONVERT}"),
    "complex": (lambda a: a + 1j, f"complex numbers, {CONVERT}"),
    "objects": (lambda a: a.astype(object), f"objects, {CONVERT}"),
    "records": (lambda a: a.view([("x", "f8")]), f"objects, {CONVERT}"),
    "truth values": (lambda a: a > 1.0, f"truth values, {CONVERT}"),
    "dates": (lambda a: a.astype("M8[s]"), f"dates, {CONVERT}"),
    "durations": (lambda a: a.astype("m8[ms]"), f"durations, {CONVERT}"),
    "masked": (_masked, MASKED),
    "a list of masked": (lambda a: [*a[:-1], _masked(a[-1])], MASKED),
    "ragged": (_ragged, UNEQUAL),
    "a frame of text": (lambda a: Frame(a.astype(str)), f"text, {CONVERT}"),
    "a frame of objects": (lambda a: Frame(a.astype(object)), f"objects, {CONVERT}"),
}
PLAINLY: dict[str, Callable[[Array], Any]] = {
    "whole numbers": lambda a: np.rint(a).astype(np.int32),
    "lists": lambda a: a.tolist(),
    "tuples of rows": tuple,
    "32 bit": lambda a: a.astype(np.float32),
    "other byte order": lambda a: a.astype(">f8"),
    "every second": lambda a: np.repeat(a, 2, axis=0)[::2],
    "by columns": np.asfortranarray,
    "a mask without anything": lambda a: np.ma.masked_array(a, np.zeros(a.shape, bool)),
    "a frame": Frame,
}


@cache
def tool() -> tuple[cw.Calibration, cw.Compensator]:
    rig, at, rng = example(3)
    calibration = cw.calibrate(noisy(rig, at, rng), "mount")
    return calibration, cw.Compensator(calibration, rate=100.0, noise=0.1, fast=False)


WAYS_IN: dict[str, tuple[str, Array, Callable[[Any], Any]]] = {
    "Samples, wrench": ("wrench", READINGS, lambda a: cw.Samples(a, R)),
    "Samples, orientation": ("R_base_flange", R, lambda a: cw.Samples(READINGS, a)),
    "Samples, position": ("position", READINGS[:, :3], lambda a: cw.Samples(READINGS, R, position=a)),
    "Samples, load": ("load_mass", READINGS[:, 0], lambda a: cw.Samples(READINGS, R, load_mass=a)),
    "WrenchStream": ("wrench", READINGS, lambda a: WrenchStream(TIMES, a)),
    "compensate, wrench": ("wrench", READINGS, lambda a: tool()[0].compensate(a, R)),
    "compensate, orientation": ("orientation", R, lambda a: tool()[0].compensate(READINGS, a)),
    "predict": ("orientation", R, tool()[0].predict),
    "with_gravity": ("gravity", READINGS[0, :3], tool()[0].with_gravity),
    "run, wrench": ("wrench", READINGS, lambda a: tool()[1].run(a, R, TIMES)),
    "run, orientation": ("orientation", R, lambda a: tool()[1].run(READINGS, a, TIMES)),
    "run, temperature": ("temperature", TIMES, lambda a: tool()[1].run(READINGS, R, TIMES, a)),
    "call, wrench": ("wrench", READINGS[0], lambda a: tool()[1](a, R[0], 0.0)),
    "call, orientation": ("orientation", R[0], lambda a: tool()[1](READINGS[0], a, 0.0)),
    "Compensator, gravity": ("gravity", READINGS[0, :3], lambda a: cw.Compensator(tool()[0], gravity=a, fast=False)),
    "Compensator, ranges": ("range", 1.0 + READINGS[0], lambda a: cw.Compensator(tool()[0], ranges=a, fast=False)),
    "calibrate, noise": ("noise", 1.0 + READINGS[0], lambda a: cw.calibrate(cw.Samples(READINGS, R), noise=a)),
    "calibrate, gravity": ("gravity", READINGS[0, :3], lambda a: cw.calibrate(cw.Samples(READINGS, R), gravity=a)),
    "line, wrench": ("wrench", READINGS[0], lambda a: line_of_action(a, COVARIANCE)),
    "line, covariance": ("covariance", COVARIANCE, lambda a: line_of_action(READINGS[0], a)),
    "plane": ("normal", READINGS[0, :3], lambda a: point_on_plane(READINGS[0], COVARIANCE, np.zeros(3), a)),
    "axis": ("origin", READINGS[0, :3], lambda a: point_on_axis(READINGS[0], COVARIANCE, a, np.ones(3))),
    "joints": ("joints", 0.1 * READINGS[0], lambda a: within_limits(known_arm("ur5e"), a)),
    "delay": ("gravity", READINGS[0, :3], lambda a: estimate_delay(STREAMS, a)),
}


@pytest.mark.parametrize("way_in", WAYS_IN)
def test_what_is_no_numbers_is_refused_by_name(way_in: str) -> None:
    name, good, hand_over = WAYS_IN[way_in]
    for what, (made_of, words) in NO_NUMBERS.items():
        if what in ("ragged", "records") and good.ndim == 1:
            continue
        with pytest.raises(InputError) as caught:
            hand_over(made_of(good))
        assert str(caught.value) == f"{name} has {words}", what


@pytest.mark.parametrize("way", PLAINLY)
def test_what_is_plainly_numbers_is_taken(way: str) -> None:
    whole = np.rint(READINGS)
    assert np.array_equal(numbers(PLAINLY[way](whole), "wrench"), whole)
    assert np.array_equal(cw.Samples(PLAINLY[way](whole), R).wrench, whole)
    contact = tool()[0].compensate(PLAINLY[way](whole), R)
    assert np.array_equal(contact, tool()[0].compensate(whole, R))


def test_numbers_are_not_copied_where_they_are_numbers() -> None:
    assert numbers(READINGS, "wrench") is READINGS
    assert seconds(TIMES) is TIMES


@pytest.mark.parametrize("unit", ["s", "ms", "us", "ns"])
def test_dates_and_durations_are_times_in_seconds(unit: str) -> None:
    began = np.array("2024-05-01T12:00:00", f"M8[{unit}]")
    steps = (np.arange(12) * {"s": 1, "ms": 500, "us": 500_000, "ns": 500_000_000}[unit]).astype(f"m8[{unit}]")
    step = 1.0 if unit == "s" else 0.5
    since_1970 = 1714564800.0 + step * np.arange(12)
    for dates, expected in ((began + steps, since_1970), (steps, step * np.arange(12))):
        forms: tuple[Any, ...] = (dates, list(dates), Frame(dates))
        for given in forms:
            assert np.array_equal(seconds(given), expected)
            samples = cw.Samples(READINGS, R, given)
            assert samples.t is not None
            assert np.array_equal(samples.t, expected)
        assert np.array_equal(tool()[1].run(READINGS, R, dates).t, expected)  # type: ignore[arg-type]
        assert tool()[1](READINGS[0], R[0], dates[3]).t == expected[3]


def test_a_date_that_is_none_is_a_nan_as_any_time() -> None:
    dates = np.array(["2024-05-01", "NaT"], "M8[s]")
    assert np.isnan(seconds(dates)).tolist() == [False, True]
    with pytest.raises(
        InputError, match=r"^t in sample 1 is nan, expected -1e\+19 to 1e\+19 s: leave such samples out$"
    ):
        cw.Samples(READINGS[:2], R[:2], dates)


NOON = datetime(2024, 5, 1, 12)
"""1714564800 s since 1970, in UTC."""


@pytest.mark.parametrize("zone", [None, UTC, timezone(timedelta(hours=2))])
def test_dates_of_python_are_those_of_numpy_and_state_their_time_zone(zone: timezone | None) -> None:
    """Those of pandas are of this type too; a series with a time zone comes as an array of them."""
    dates = [NOON.replace(tzinfo=zone) + timedelta(seconds=0.5) * k for k in range(12)]
    hours = 0.0 if zone is None else (zone.utcoffset(None) or timedelta(0)).total_seconds()
    expected = 1714564800.0 - hours + 0.5 * np.arange(12)
    forms: tuple[Any, ...] = (dates, tuple(dates), np.array(dates), Frame(dates))
    for given in forms:
        assert np.array_equal(seconds(given), expected)
        assert np.array_equal(cw.Samples(READINGS, R, given).t, expected)  # type: ignore[arg-type]
        assert np.array_equal(cw.Samples(READINGS, R, given, came=given).came, expected)  # type: ignore[arg-type]
    assert tool()[1](READINGS[0], R[0], dates[3]).t == expected[3]  # type: ignore[arg-type]


def test_dates_of_which_some_state_a_time_zone_are_refused() -> None:
    with pytest.raises(InputError) as caught:
        seconds([NOON, NOON.replace(tzinfo=UTC)])
    assert str(caught.value) == (
        "t has dates with a time zone and without, expected all with one or all without: state it with each, as by "
        ".replace(tzinfo=)"
    )


def test_times_that_their_float_type_has_rounded_are_refused() -> None:
    since_1970 = (1.7e9 + TIMES).astype(np.float32)
    said = (
        "t is float32, which has steps of 128 s at 1.7e+09 s, expected float64: convert what it was made of, as these "
        "are rounded already"
    )
    ways: list[Callable[[], object]] = [
        lambda: cw.Samples(READINGS, R, since_1970),
        lambda: WrenchStream(since_1970, READINGS),
        lambda: tool()[1].run(READINGS, R, since_1970),
        lambda: tool()[1](READINGS[0], R[0], since_1970[0]),
    ]
    for way in ways:
        with pytest.raises(InputError) as caught:
            way()
        assert str(caught.value) == said
    with pytest.raises(InputError, match=r"^t is float16, which has steps of 0\.0312 s at 60 s, expected float64: "):
        seconds(np.array([0.0, 60.0], np.float16))


def test_times_of_32_bits_that_are_fine_enough_are_taken() -> None:
    for fine in (TIMES, 1e5 + TIMES, np.full(3, np.nan), np.array([np.inf, 1.0]), np.empty(0)):
        assert np.array_equal(seconds(fine.astype(np.float32)), fine, equal_nan=True)


def test_rotations_one_by_one_are_told_how_to_become_one() -> None:
    turns = Rotation.from_matrix(R)
    each: list[Any] = list(turns)
    forms: tuple[Any, ...] = (each, Frame(np.array(each)))
    for given in forms:
        for name, hand_over in (
            ("R_base_flange", lambda a: cw.Samples(READINGS, a)),
            ("orientation", tool()[0].predict),
            ("orientation", lambda a: tool()[0].compensate(READINGS, a)),
            ("orientation", lambda a: tool()[1].run(READINGS, a, TIMES)),
        ):
            with pytest.raises(InputError) as caught:
                hand_over(given)
            assert str(caught.value) == (
                f"{name} has Rotations one by one, expected one of them all: Rotation.concatenate(list)"
            )
    assert cw.Samples(READINGS, Rotation.concatenate(each)).R_base_flange == pytest.approx(R)


def test_none_is_no_column_but_where_it_may_be_left_out() -> None:
    wanted: tuple[tuple[str, Callable[[Any], object]], ...] = (
        ("wrench", lambda a: cw.Samples(a, R)),
        ("R_base_flange", lambda a: cw.Samples(READINGS, a)),
        ("t", lambda a: WrenchStream(a, READINGS)),
        ("wrench", lambda a: tool()[0].compensate(a, R)),
        ("t", lambda a: tool()[1](READINGS[0], R[0], a)),
    )
    for name, hand_over in wanted:
        with pytest.raises(InputError) as caught:
            hand_over(None)
        assert str(caught.value) == f"{name} is None, expected numbers"
    assert cw.Samples(READINGS, R, None, position=None).t is None


def test_a_time_and_a_temperature_are_one_number() -> None:
    with pytest.raises(InputError) as caught:
        tool()[1](READINGS[0], R[0], "1.0")  # type: ignore[arg-type]
    assert str(caught.value) == f"t has text, {CONVERT}"
    with pytest.raises(InputError) as caught:
        tool()[1](READINGS[0], R[0], TIMES)  # type: ignore[arg-type]
    assert str(caught.value) == "t has shape (12,), expected one number"
    with pytest.raises(InputError) as caught:
        tool()[1](READINGS[0], R[0], 0.0, "20")  # type: ignore[arg-type]
    assert str(caught.value) == f"temperature has text, {CONVERT}"
    with pytest.raises(InputError) as caught:
        cw.Compensator(tool()[0], delay="0.1", fast=False)  # type: ignore[arg-type]
    assert str(caught.value) == f"delay has text, {CONVERT}"


def test_a_column_of_truth_values() -> None:
    for good in (TIMES > 5.0, (TIMES > 5.0).tolist(), (TIMES > 5.0).astype(int)):
        saturated = cw.Samples(READINGS, R, saturated=good).saturated
        assert saturated is not None
        assert np.array_equal(saturated, TIMES > 5.0)
    for bad, found in ((["False"] * 12, "text"), (TIMES, "numbers"), ([None] * 12, "numbers")):
        with pytest.raises(InputError) as caught:
            cw.Samples(READINGS, R, saturated=bad)  # type: ignore[arg-type]
        assert str(caught.value) == f"saturated has {found}, expected truth values"


def _half(a: Array) -> Array:
    return np.concatenate([a, a])[3:15]


OUT = f"expected {READINGS.shape} float64, C order"
PASS_A_COPY = "expected wrench itself or memory of its own: pass a copy"


@pytest.mark.parametrize(
    ("out", "message"),
    [
        (lambda w: w.tolist(), f"out is a list, {OUT}"),
        (lambda w: np.ma.masked_array(np.empty_like(w)), f"out is a MaskedArray, {OUT}"),
        (lambda w: np.empty((11, 6)), f"out has shape (11, 6) and type float64, {OUT}"),
        (lambda w: np.empty((12, 6), np.float32), f"out has shape (12, 6) and type float32, {OUT}"),
        (lambda w: np.empty((12, 6), ">f8"), f"out has shape (12, 6) and type >f8, {OUT}"),
        (lambda w: np.empty((6, 12)).T, f"out has shape (12, 6) and type float64, {OUT}"),
        (lambda w: np.empty((24, 6))[::2], f"out has shape (12, 6) and type float64, {OUT}"),
        (lambda w: np.broadcast_to(w[:1], w.shape), f"out has shape (12, 6) and type float64, {OUT}"),
        (lambda w: cw.Samples(w, R).wrench, "out is read-only, expected an array that can be written to: pass a copy"),
    ],
)
def test_a_place_that_takes_no_result(out: Callable[[Array], Any], message: str) -> None:
    with pytest.raises(InputError) as caught:
        tool()[0].compensate(READINGS, R, out=out(READINGS))
    assert str(caught.value) == message


def test_a_result_may_take_the_place_of_the_readings_and_no_other_that_is_read() -> None:
    expected = tool()[0].compensate(READINGS, R)
    memory = np.zeros(200)
    readings = memory[:72].reshape(12, 6)
    readings[:] = READINGS
    assert tool()[0].compensate(readings, R, out=readings) is readings
    assert np.array_equal(readings, expected)
    quaternions = memory[100:148].reshape(12, 4)
    quaternions[:, 3] = 1.0
    wide = memory[:144].reshape(12, 12)[:, :6]
    for given, at, out in (
        (readings, R, memory[6:78].reshape(12, 6)),
        (wide, R, memory[:72].reshape(12, 6)),
        (READINGS, quaternions, memory[90:162].reshape(12, 6)),
    ):
        with pytest.raises(InputError) as caught:
            tool()[0].compensate(given, at, out=out)
        assert str(caught.value) == f"out overlaps with what is read, {PASS_A_COPY}"


@pytest.mark.parametrize("fused", [True, False])
@pytest.mark.parametrize("n", [17, 68_000])
def test_a_matrix_that_is_no_rotation_is_refused_in_few_rows_and_in_many(
    n: int, fused: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not fused:
        monkeypatch.setattr("contactwrench.subtract.has_compiler", lambda: False)
    matrices = np.resize(R, (n, 3, 3))
    row, wrench = n - 5, np.zeros((n, 6))
    assert len(tool()[0].compensate(wrench, matrices)) == n
    mirrored, sheared = np.diag([1.0, 1.0, -1.0]), np.array([[1.0, 0.1, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    for wrong, off in (
        (mirrored, "off orthonormal by 0, determinant -1"),
        (sheared / np.cbrt(np.linalg.det(sheared)), "off orthonormal by 0.1, determinant 1"),
        (np.full((3, 3), np.nan), "off orthonormal by nan, determinant nan"),
    ):
        bad = matrices.copy()
        bad[row] = wrong
        with pytest.raises(InputError) as caught:
            tool()[0].compensate(wrench, bad)
        assert str(caught.value) == (
            f"orientation {row} is a matrix that is no rotation (columns {off}), "
            "expected orthonormal within 1 % and determinant 1: check the order of its entries"
        )
