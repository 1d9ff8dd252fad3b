"""Samples are checked once and never change."""

from datetime import datetime
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import contactwrench as cw
from contactwrench.errors import InputError
from contactwrench.samples.samples import OrientationStream, WrenchStream
from tests.support.recordings import generic_rotations
from tests.support.rigs import NOISE, example, noisy
from tests.support.world import Array, noisy_readings


def fields(n: int = 4) -> dict[str, Any]:
    return {
        "wrench": np.arange(6.0 * n).reshape(n, 6),
        "R_base_flange": generic_rotations(n),
        "t": np.arange(float(n)),
        "position": np.zeros((n, 3)),
        "load_mass": np.zeros(n),
    }


def with_value(name: str, place: tuple[int, ...], value: float) -> dict[str, Any]:
    values = fields()
    values[name][place] = value
    return values


def test_samples_keep_copies_that_cannot_be_written_to() -> None:
    given = fields()
    samples = cw.Samples(**given)
    given["wrench"][0, 0] = 99.0
    assert samples.wrench[0, 0] == 0.0
    for name in given:
        with pytest.raises(ValueError, match="read-only"):
            getattr(samples, name)[0] = 1.0


def test_orientations_of_other_kinds_are_made_matrices() -> None:
    R = generic_rotations(4)
    turns = Rotation.from_matrix(R)
    for given in (turns, turns.as_quat(), turns.as_quat().tolist()):
        assert cw.Samples(**fields() | {"R_base_flange": given}).R_base_flange == pytest.approx(R, abs=1e-12)
    with pytest.raises(
        InputError, match=r"^R_base_flange has shape \(3, 3, 3\), expected \(n, 3, 3\) with n = 4 as in wr"
    ):
        cw.Samples(**fields() | {"R_base_flange": turns[:3]})
    with pytest.raises(InputError, match=r"^orientation 1 is "):
        cw.Samples(**fields() | {"R_base_flange": np.diag([1.0, 3.0, 1.0, 1.0])})


def test_what_is_taken_is_what_the_types_say() -> None:
    """Without an `ignore`: this file is checked by mypy, as a user's is. What the fields are then is arrays."""
    readings: list[list[float]] = [[0.0] * 6, [1.0] * 6]
    quaternions: list[list[float]] = [[0.0, 0.0, 0.0, 1.0]] * 2
    whole = np.arange(2)
    made = [
        cw.Samples(readings, quaternions),
        cw.Samples(np.array(readings, np.float32), Rotation.from_quat(quaternions), t=whole, came=[0, 1]),
        cw.Samples(readings, quaternions, [datetime(2024, 5, 1), datetime(2024, 5, 2)], saturated=[True, False]),
        cw.Samples(np.zeros((2, 6), int), quaternions, [0, 1], [[0, 0, 0]] * 2, [0, 1], accelerometer=np.eye(3)[:2]),
    ]
    of_wrench, of_arm = WrenchStream([0, 1], readings, load_mass=[0, 1]), OrientationStream(whole, [np.eye(3)] * 2)
    arrays: list[Array | None] = [made[1].t, made[3].load_mass, of_wrench.load_mass, of_arm.t, made[0].R_base_flange]
    assert all(isinstance(each, np.ndarray) and each.dtype == np.float64 for each in arrays)


ORIENTATIONS = "(n, 3, 3) rotation matrices, (n, 4) quaternions x, y, z, w or a scipy Rotation"


@pytest.mark.parametrize("shape", [(4, 3), (4, 7), (4, 9), (4, 4, 4), (3, 3)])
def test_orientations_of_another_shape_are_told_every_kind_that_is_taken(shape: tuple[int, ...]) -> None:
    """As rotation vectors and poses are."""
    with pytest.raises(InputError) as raised:
        cw.Samples(**fields() | {"R_base_flange": np.zeros(shape)})
    assert str(raised.value) == f"R_base_flange has shape {shape}, expected {ORIENTATIONS}"


def test_what_is_stated_of_all_samples_is_one_number() -> None:
    for name in ("delay", "delay_std", "pose_period", "accelerometer_period"):
        assert getattr(cw.Samples(**fields() | {name: 0.01}), name) == 0.01
        for given, said in (
            ("a", "has text, expected numbers: convert them, as by .astype(float)"),
            (np.nan, "is nan, expected -1e+19 to 1e+19 s"),
        ):
            with pytest.raises(InputError) as raised:
                cw.Samples(**fields() | {name: given})
            assert str(raised.value) == f"{name} {said}"


@pytest.mark.parametrize(
    ("rows", "found"),
    [
        ([99], "index 99 is out of bounds for axis 0 with size 4"),
        ([True], "boolean index did not match indexed array along axis 0; size of axis is 4 but size of corresponding "
         "boolean axis is 1"),
        ([0.0], "arrays used as indices must be of integer (or boolean) type"),
    ],
)  # fmt: skip
def test_rows_that_are_not_there_are_refused(rows: list[float], found: str) -> None:
    with pytest.raises(InputError) as raised:
        cw.Samples(**fields()).select(rows)
    assert str(raised.value) == (
        f"rows cannot be picked of 4 ({found}), expected a mask of as many, indices of rows that are there, or a slice"
    )


def test_arrays_in_place_of_samples_are_refused_in_one_line() -> None:
    given = fields()
    message = r"^found ndarray, expected Samples: cw\.read\(path\) or cw\.Samples\(wrench=, \.\.\.\)$"
    with pytest.raises(InputError, match=message):
        cw.calibrate(given["wrench"], given["R_base_flange"])
    rig, R, rng = example(1)
    found = cw.calibrate(noisy(rig, R, rng))
    with pytest.raises(InputError, match=message):
        cw.Compensator(found, noise=np.full(6, 0.1)).zero(given["wrench"])
    with pytest.raises(InputError, match=r"^other is a str, expected a Calibration: Calibration\.load\(path\)$"):
        found.diff("tool.json")  # type: ignore[arg-type]


def test_a_notebook_shows_them_in_a_line() -> None:
    rig, R, rng = example(1)
    samples = noisy(rig, R, rng)
    assert repr(samples) == "<Samples: 24 of arrays>"
    assert repr(cw.calibrate(samples)) == "<Calibration: mount+base, 24 poses, good; print it>"


def test_a_selection_keeps_every_field_in_its_order() -> None:
    samples = cw.Samples(**fields(), source="here")
    picks: list[Any] = [[3, 1], np.array([False, True, False, True]), slice(1, None, 2)]
    for rows in picks:
        chosen = samples.select(rows)
        expected = np.arange(4)[rows]
        assert len(chosen) == 2
        assert chosen.t is not None
        assert chosen.t.tolist() == expected.tolist()
        assert np.array_equal(chosen.wrench, samples.wrench[expected])
        assert chosen.R_base_flange == pytest.approx(samples.R_base_flange[expected], abs=1e-12)
        assert chosen.source == "here"


def test_samples_may_be_none_at_all() -> None:
    assert len(cw.Samples(wrench=np.empty((0, 6)), R_base_flange=np.empty((0, 3, 3)))) == 0


LEAVE_OUT = "leave such samples out"


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (fields() | {"wrench": np.zeros(6)}, "wrench has shape (6,), expected (n, 6)"),
        (fields() | {"wrench": np.zeros((4, 3))}, "wrench has shape (4, 3), expected (n, 6)"),
        (
            fields() | {"R_base_flange": generic_rotations(3)},
            "R_base_flange has shape (3, 3, 3), expected (n, 3, 3) with n = 4 as in wrench",
        ),
        (fields() | {"t": np.zeros((4, 1))}, "t has shape (4, 1), expected (n,) with n = 4 as in wrench"),
        (
            with_value("wrench", (2, 1), np.nan),
            f"wrench in sample 2 is nan, expected -1e+09 to 1e+09 N or N m: {LEAVE_OUT}",
        ),
        (with_value("t", (1,), np.inf), f"t in sample 1 is inf, expected -1e+19 to 1e+19 s: {LEAVE_OUT}"),
        (
            with_value("wrench", (3, 5), -1.5e9),
            f"wrench in sample 3 is -1.5e+09, expected -1e+09 to 1e+09 N or N m: {LEAVE_OUT}",
        ),
        (
            with_value("load_mass", (2,), -0.5),
            f"load_mass in sample 2 is -0.5, expected 0 or 1e-06 to 1e+06 kg: {LEAVE_OUT}",
        ),
        (
            with_value("R_base_flange", (1,), 0.0),
            "orientation 1 is a matrix that is no rotation (columns off orthonormal by 1, determinant 0), expected "
            "orthonormal within 1 % and determinant 1: check the order of its entries",
        ),
    ],
)
def test_what_cannot_be_samples_is_refused(values: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError) as caught:
        cw.Samples(**values)
    assert str(caught.value) == message


def test_a_stream_holds_what_says_nothing_and_not_what_no_sensor_reads() -> None:
    """Numbers in the other order of bytes ended the search for the delay in an error of the program's own."""
    wrench = np.zeros((4, 6))
    wrench[1], wrench[2, 0] = np.nan, np.inf
    WrenchStream(np.arange(4.0), wrench)
    wrench[3, 5] = 1e300
    with pytest.raises(InputError) as caught:
        WrenchStream(np.arange(4.0), wrench)
    assert str(caught.value) == f"wrench in sample 3 is 1e+300, expected -1e+09 to 1e+09 N or N m: {LEAVE_OUT}"


def test_infinities_of_both_signs_are_refused_without_a_warning() -> None:
    values = fields()
    values["wrench"][1] = [np.inf, -np.inf, 0, 0, 0, 0]
    with pytest.raises(InputError, match="wrench in sample 1 is inf") as caught:
        cw.Samples(**values)
    assert caught.value.row == 1


def test_times_that_are_no_seconds_are_refused() -> None:
    """ns since 1970 were taken for s: 1,318 poses in place of 12 stops."""
    orientations, readings = np.tile(np.eye(3), (3, 1, 1)), np.ones((3, 6))
    unix: Any = 1.79e9 + np.arange(3)
    assert len(cw.Samples(readings, orientations, unix)) == 3
    for per_second in (1e3, 1e6, 1e9):
        with pytest.raises(InputError) as refused:
            cw.Samples(readings, orientations, (per_second * unix).astype(np.int64))
        said = f"t is up to {per_second * 1.79e9:.6g}, a time since 1970, expected s: divide it by {per_second:,.0f}"
        assert str(refused.value) == said


class Frame:
    """A table with named columns, as those of pandas and polars."""

    def __init__(self, columns: list[str], values: Array) -> None:
        self.columns, self.values = columns, values

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Array:
        return self.values


def framed(columns: str, values: Array) -> Any:
    return Frame(columns.split(), values)


def test_columns_in_another_order_are_refused() -> None:
    rig, R, rng = example(3)
    readings = noisy_readings(rig, R, NOISE, rng)
    calibration = cw.calibrate(cw.Samples(framed("fx fy fz tx ty tz", readings), R), "mount")
    assert calibration.compensate(framed("a b c d e f", readings), R).shape == readings.shape
    no_names: Any = Frame([], readings)
    no_names.columns = None
    assert len(cw.Samples(no_names, R)) == len(R)
    for of_another in ("tx ty tz fx fy fz", "FX FZ FY TX TY TZ"):
        turned = framed(of_another, readings)
        said = f"wrench has columns {of_another.lower()}, expected fx fy fz tx ty tz: put them in this order"
        with pytest.raises(InputError) as refused:
            cw.Samples(turned, R)
        assert str(refused.value) == said
        with pytest.raises(InputError) as refused:
            calibration.compensate(turned, R)
        assert str(refused.value) == said
