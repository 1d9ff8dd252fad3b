"""Readings that a recorder did not get: such rows come out without a contact wrench, and are counted."""

from __future__ import annotations

import csv
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import contactwrench as cw
from contactwrench.errors import InputError
from contactwrench.samples.samples import WrenchStream
from tests.support.bags import pose_stamped, wrench_stamped, write_mcap
from tests.support.recordings import MATRIX, WRENCH, csv_text, run, written
from tests.support.world import Array

Capture = pytest.CaptureFixture[str]
N, STOP = 2000, 250
WEIGHT, COM = 9.0, np.array([0.01, -0.02, 0.07])
BIAS = np.array([3.0, -4.0, 11.0, 0.2, -0.1, 0.05])
LACK = [0, 7, 8, 9, 700, 701, 1998, 1999]
"""Rows that lack all or a part of a reading, the first and the last ones too."""


def recorded(seed: int) -> tuple[Array, Array, Array]:
    """Times, readings, and orientations of an arm that goes from stop to stop with a free tool, at 100 Hz."""
    rng = np.random.default_rng(seed)
    t = np.arange(N) / 100.0
    mount, way = Rotation.random(random_state=rng), Rotation.random(N // STOP + 2, random_state=rng).as_rotvec()
    stop, moved = np.arange(N) // STOP, np.clip((np.arange(N) % STOP - 100) / 150.0, 0.0, 1.0)[:, None]
    share = 0.5 - 0.5 * np.cos(np.pi * moved)
    R = Rotation.from_rotvec(way[stop] + share * (way[stop + 1] - way[stop]))
    force = (R * mount).inv().apply([0.0, 0.0, -WEIGHT])
    noise = rng.normal(size=(N, 6)) * np.repeat([0.02, 0.001], 3)
    return t, np.hstack([force, np.cross(COM, force)]) + BIAS + noise, R.as_matrix()


def table_of(t: Array, wrench: Array, R: Array, cell: str, channels: list[int]) -> str:
    """As CSV, those channels of the rows that lack them written as `cell`."""
    lines = csv_text(("t", *WRENCH, *MATRIX), np.column_stack([t, wrench, R.reshape(-1, 9)])).splitlines()
    for row in LACK:
        cells = lines[row + 1].split(",")
        for channel in channels:
            cells[channel + 1] = cell
        lines[row + 1] = ",".join(cells)
    return "\n".join([*lines, ""])


def calibrated(folder: Path, seed: int) -> Path:
    _of_stops(seed).save(folder / "tool.json")
    return folder / "tool.json"


@cache
def _of_stops(seed: int) -> cw.Calibration:
    _, wrench, R = recorded(seed)
    at_stops = np.arange(50, N, STOP)
    calibration = cw.calibrate(cw.Samples(wrench[at_stops], R[at_stops]), "mount")
    assert calibration.weight == pytest.approx(WEIGHT, abs=0.1)
    return calibration


@pytest.mark.parametrize(
    ("rows", "n", "zeros_elsewhere", "are_lost"),
    [
        ([3, 900], 1000, 2, False),
        ([3, 500, 900], 1000, 2, True),
        ([900], N, 2, True),
        ([*range(300, 311)], N, 0, False),
        ([3, 900, 1500], N, 3, False),
    ],
    ids=["two, as after a tare", "three", "one of many", "eleven in a row are stuck", "half of another row is zero"],
)
def test_rows_of_zeros_are_lost_packets_or_readings(
    rows: list[int], n: int, zeros_elsewhere: int, are_lost: bool
) -> None:
    t, wrench, _ = recorded(5)
    wrench[rows], wrench[40, :zeros_elsewhere] = 0.0, 0.0
    left_out = np.flatnonzero(np.isnan(WrenchStream(t[:n], wrench[:n]).wrench).all(axis=1))
    assert left_out.tolist() == (rows if are_lost else [])


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.mark.parametrize(
    ("cell", "channels"),
    [
        ("", [3]),
        ("nan", [0, 1]),
        ("NaN", list(range(6))),
        ("-9999.0", [2]),
        ("-999", list(range(6))),
        ("NA", [0, 5]),
        ("-", list(range(6))),
        ('"null"', [4]),
        (" -nan(ind)", list(range(6))),
        ("0.0", list(range(6))),
    ],
)
def test_rows_without_a_reading_have_no_contact_wrench(
    tmp_path: Path, capsys: Capture, cell: str, channels: list[int]
) -> None:
    tool, (t, wrench, R) = calibrated(tmp_path, 1), recorded(1)
    path = written(tmp_path, table_of(t, wrench, R, cell, channels), "run.csv")
    plain = run(capsys, "compensate", path, "-c", tool, "-o", tmp_path / "plain.csv")
    assert plain.status == 0
    said = "found no whole reading (nothing, NaN, zeros alone, or -9999 and the like) in 8 rows: not used"
    assert (plain.err, cw.read(path).notes) == (f"Note: {said}\n", (said,))
    judged = run(capsys, "compensate", path, "-c", tool, "-o", tmp_path / "judged.csv", "--contact", "--noise", "0.02")
    assert judged.status == 0
    assert "Note: 8 readings that are not numbers left out" in judged.err
    whole = cw.Calibration.load(tool).compensate(wrench, R)
    for name in ("plain.csv", "judged.csv"):
        rows = rows_of(tmp_path / name)
        assert [float(row["t"]) for row in rows] == t.tolist()
        found = np.array([[float(row[axis]) for axis in WRENCH] for row in rows])
        assert np.flatnonzero(np.isnan(found).all(axis=1)).tolist() == LACK
        there = ~np.isnan(found).any(axis=1)
        assert there.sum() == N - len(LACK)
        assert np.allclose(found[there], whole[there], rtol=0.0, atol=1e-6)
    without = [row for row in rows if row["reason"] == "left out: the reading is not a number"]
    assert {row["valid"] for row in without} == {"0"}
    assert len(without) == len(LACK)
    assert np.mean([row["valid"] == "1" for row in rows]) > 0.99


@pytest.mark.parametrize("channels", [[5], list(range(6))])
def test_a_parquet_recording_keeps_its_rows(tmp_path: Path, capsys: Capture, channels: list[int]) -> None:
    pa = pytest.importorskip("pyarrow", reason="pyarrow is not installed")
    parquet = pytest.importorskip("pyarrow.parquet")
    tool, (t, wrench, R) = calibrated(tmp_path, 2), recorded(2)
    columns = dict(zip(("t", *WRENCH, *MATRIX), np.column_stack([t, wrench, R.reshape(-1, 9)]).T.copy(), strict=True))
    for channel in channels:
        columns[WRENCH[channel]][LACK] = np.nan
    parquet.write_table(pa.table(columns), tmp_path / "run.parquet", row_group_size=300)
    for judging in ((), ("--contact", "--noise", "0.02")):
        out = tmp_path / f"out{len(judging)}.parquet"
        done = run(capsys, "compensate", tmp_path / "run.parquet", "-c", tool, "-o", out, *judging)
        assert done.status == 0, done.err
        found = parquet.read_table(out)
        assert found.num_rows == N
        assert np.flatnonzero(np.isnan(found["contact_fx"].to_numpy())).tolist() == LACK
        assert found["r11"].to_numpy() == pytest.approx(R[:, 0, 0])


def test_a_pose_of_nines_is_none_and_one_that_reads_as_much_as_others_is(tmp_path: Path) -> None:
    """Twelve poses of which one was -9999 weighed 1112 N for 37; in mN a 9999 may be a reading."""
    _, wrench, R = (each[50::STOP] for each in recorded(3))
    for unit, per_si, code in (("N", 1.0, -9999.0), ("mN", 1e3, 9999.0)):
        table = np.column_stack([wrench * ([per_si] * 3 + [1.0] * 3), R.reshape(-1, 9)])
        table[4, 2] = code
        header = [*(f"{axis}_{unit}" for axis in WRENCH[:3]), *WRENCH[3:], *MATRIX]
        samples = cw.read(written(tmp_path, csv_text(header, table)))
        assert len(samples) == len(R) - (unit == "N"), unit


@pytest.mark.parametrize(("code", "row", "axis"), [(-9999.0, 3, 2), (99999.0, 0, 5)])
def test_arrays_with_a_code_are_refused_by_sample(code: float, row: int, axis: int) -> None:
    _, wrench, R = (each[50::STOP] for each in recorded(3))
    wrench[row, axis] = code
    with pytest.raises(InputError) as error:
        cw.Samples(wrench, R)
    found = f"wrench in sample {row} is {code:g}, which stands for no reading: leave such samples out"
    assert str(error.value) == found


def test_arrays_of_a_sensor_that_reads_as_much_are_taken() -> None:
    _, wrench, R = (each[50::STOP] for each in recorded(3))
    wrench[:, 2] += 2500.0
    wrench[4, 2] = 9999.0
    assert cw.Samples(wrench, R).wrench[4, 2] == 9999.0


def test_a_part_of_samples_is_taken_as_the_whole_was() -> None:
    _, wrench, R = (each[50::STOP] for each in recorded(3))
    wrench[:4, 2] = 950.0
    wrench[6, 2] = 999.0
    assert cw.Samples(wrench, R).select(slice(5, None)).wrench[1, 2] == 999.0
    stream = WrenchStream(np.arange(len(wrench), dtype=np.float64), wrench)
    assert stream.select(slice(5, None)).wrench[1, 2] == 999.0


def test_a_bag_with_codes_is_calibrated_as_without_those_readings(tmp_path: Path, capsys: Capture) -> None:
    t, wrench, R = recorded(3)
    found = []
    for name, value in (("code", -9999.0), ("nan", np.nan)):
        lacking = wrench.copy()
        lacking[LACK, 2] = value
        messages = [pose_stamped(when, each, np.zeros(3)) for when, each in zip(t, R, strict=True)]
        messages += [wrench_stamped(when, each) for when, each in zip(t, lacking, strict=True)]
        bag = write_mcap(tmp_path / f"{name}.mcap", messages)
        done = run(capsys, "calibrate", bag, "-o", tmp_path / f"{name}.json")
        assert done.status == 0, done.err
        assert "8 readings that are not numbers left out" in done.err
        found.append(cw.Calibration.load(tmp_path / f"{name}.json"))
    assert found[0].weight == found[1].weight == pytest.approx(WEIGHT, abs=0.1)


@pytest.mark.parametrize("channels", [[2], list(range(6))])
def test_a_calibration_does_without_them_and_says_so(tmp_path: Path, capsys: Capture, channels: list[int]) -> None:
    t, wrench, R = recorded(3)
    path = written(tmp_path, table_of(t, wrench, R, "", channels), "run.csv")
    done = run(capsys, "calibrate", path, "-o", tmp_path / "tool.json")
    assert done.status == 0, done.err
    assert (
        done.err.count("found no whole reading (nothing, NaN, zeros alone, or -9999 and the like) in 8 rows: not used")
        == 1
    )
    assert cw.Calibration.load(tmp_path / "tool.json").weight == pytest.approx(WEIGHT, abs=0.1)


@pytest.mark.parametrize("names", [("qx", "qy", "qz", "qw"), MATRIX])
def test_an_orientation_of_zeros_is_none(tmp_path: Path, capsys: Capture, names: tuple[str, ...]) -> None:
    """As loggers fill in what did not come; three angles that are zero are an orientation."""
    tool, (t, wrench, R) = calibrated(tmp_path, 1), recorded(1)
    turn = Rotation.from_matrix(R).as_quat() if len(names) == 4 else R.reshape(N, 9)
    turn[700:720] = 0.0
    path = written(tmp_path, csv_text(("t", *WRENCH, *names), np.column_stack([t, wrench, turn])), "run.csv")
    done = run(capsys, "compensate", path, "-c", tool, "-o", tmp_path / "o.csv")
    assert done.status == 0
    assert "no orientation from 6.990 s to 7.200 s: 20 readings left out" in done.err
    angles = np.zeros((N, 3))
    table = csv_text(("t", *WRENCH, "rx", "ry", "rz"), np.column_stack([t, wrench, angles]))
    done = run(capsys, "compensate", written(tmp_path, table, "b.csv"), "-c", tool, "-o", tmp_path / "b_o.csv")
    assert done.status == 0
    assert "no orientation" not in done.err


def test_a_whole_recording_says_nothing_of_it(tmp_path: Path, capsys: Capture) -> None:
    tool, (t, wrench, R) = calibrated(tmp_path, 4), recorded(4)
    path = written(tmp_path, csv_text(("t", *WRENCH, *MATRIX), np.column_stack([t, wrench, R.reshape(-1, 9)])), "a.csv")
    done = run(capsys, "compensate", path, "-c", tool, "-o", tmp_path / "o.csv")
    assert (done.status, done.err) == (0, "")


def test_a_table_of_poses_has_a_number_in_each_cell(tmp_path: Path, capsys: Capture) -> None:
    _, wrench, R = recorded(5)
    text = csv_text((*WRENCH, *MATRIX), np.column_stack([wrench, R.reshape(-1, 9)])[50::STOP])
    lines = text.splitlines()
    lines[4] = ",".join(["", *lines[4].split(",")[1:]])
    path = written(tmp_path, "\n".join([*lines, ""]), "poses.csv")
    done = run(capsys, "calibrate", path)
    assert done.status == 2
    said = "row 5, column fx: found nothing, expected a number: fill it in or leave the row out"
    assert done.err == f"contactwrench: {path}: {said}\n"


def test_a_pose_without_its_orientation_is_not_put_between_its_neighbours(tmp_path: Path, capsys: Capture) -> None:
    """In a table of poses with times an orientation half way stood in for an empty one: 3 N of contact in free air."""
    t, wrench, R = recorded(4)
    poses = np.arange(50, N, STOP)
    lines = csv_text(("t", *WRENCH, *MATRIX), np.column_stack([t, wrench, R.reshape(-1, 9)])[poses]).splitlines()
    lines[3] = ",".join([*lines[3].split(",")[:7], *[""] * 9])
    path, out = written(tmp_path, "\n".join([*lines, ""])), tmp_path / "out.csv"
    samples = cw.read(path)
    assert samples.t is not None
    np.testing.assert_allclose(samples.t, np.delete(t[poses], 2))
    run(capsys, "compensate", path, "-c", calibrated(tmp_path, 4), "-o", out)
    rows = list(csv.DictReader(out.read_text(encoding="utf-8").splitlines()))
    assert [row["valid"] for row in rows] == ["0" if k == 2 else "1" for k in range(len(poses))]
    assert rows[2]["reason"] == "left out: in a gap of the orientation"
