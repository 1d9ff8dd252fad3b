"""Parquet as pyarrow itself writes it, with types of every kind, against the same recording as CSV."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import contactwrench as cw
from contactwrench.errors import ContactWrenchError, FileAccessError, FileFormatError, MissingExtraError
from contactwrench.recording.options import Options
from contactwrench.recording.read import batches, begins_with_pairs, read_streams
from tests.recording.test_bad_files import assert_one_line_that_names
from tests.recording.test_tables import HEADER, Motion, assert_same, joined, rows, with_gaps
from tests.support.recordings import MATRIX, PANDA, WRENCH, run, written

pa = pytest.importorskip("pyarrow", reason="pyarrow is not installed")
pq = pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed")

QUAT = ("qx", "qy", "qz", "qw")


def columns() -> dict[str, Any]:
    return {name: rows()[:, k] for k, name in enumerate(HEADER)}


def stored(folder: Path, table: Any, name: str = "run.parquet", **options: Any) -> Path:
    path = folder / name
    path.parent.mkdir(exist_ok=True)
    pq.write_table(table if isinstance(table, pa.Table) else pa.table(table), path, **options)
    return path


def refusal(path: Path) -> str:
    with pytest.raises(FileFormatError) as caught:
        cw.read(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert "\n" not in message
    return message.removeprefix(f"{path}: ")


@pytest.mark.slow
@pytest.mark.parametrize(
    "options",
    [
        {},
        {"row_group_size": 7},
        {"compression": "gzip", "row_group_size": 1},
        {"use_dictionary": True},
        {"version": "1.0"},
    ],
)
def test_whole_and_in_batches_it_is_the_recording(tmp_path: Path, options: dict[str, Any]) -> None:
    path = stored(tmp_path, columns(), **options)
    assert_same(read_streams(path), Motion.R, slice(None))
    for n in (1, 8, 1000):
        assert_same(joined(list(batches(path, rows=n))), Motion.R, slice(None))
    assert np.array_equal(cw.read(path).wrench, Motion.wrench)


def test_nulls_and_nans_are_gaps(tmp_path: Path) -> None:
    for of_gap in (None, float("nan")):
        table = {name: list(values) for name, values in columns().items()}
        for name in HEADER[7:]:
            table[name] = [value if posed else of_gap for value, posed in zip(table[name], Motion.posed, strict=True)]
        path = stored(tmp_path, table, row_group_size=11)
        assert_same(read_streams(path), Motion.R, Motion.posed)
        assert_same(joined(list(batches(path, rows=4))), Motion.R, Motion.posed)
        assert not begins_with_pairs(path)


def test_csv_and_parquet_say_the_same_to_the_last_digit(tmp_path: Path) -> None:
    text = written(tmp_path, with_gaps())
    from pyarrow import csv

    other = stored(tmp_path, csv.read_csv(text))
    a, b = read_streams(text), read_streams(other)
    assert np.array_equal(a.wrench.wrench, b.wrench.wrench)
    assert np.array_equal(a.wrench.t, b.wrench.t)
    assert np.array_equal(a.orientation.R_base_flange, b.orientation.R_base_flange)


def test_a_folder_of_parts_is_one_recording(tmp_path: Path) -> None:
    table = pa.table(columns())
    for k in range(12):
        stored(tmp_path, table.slice(5 * k, 5), f"run/part-{k}.parquet")
    (tmp_path / "run" / "_SUCCESS").write_text("")
    stored(tmp_path, table.slice(0, 0), "run/part-12.parquet")
    assert_same(read_streams(tmp_path / "run"), Motion.R, slice(None))
    assert_same(joined(list(batches(tmp_path / "run", rows=3))), Motion.R, slice(None))


def odd_types() -> list[Any]:
    single = Motion.wrench.astype(np.float32)
    whole = np.round(10.0 * Motion.wrench)
    return [
        (single.astype(float), [pa.array(c) for c in single.T]),
        (whole, [pa.array(c.astype(kind)) for c, kind in zip(whole.T, "bhilqi", strict=True)]),
        (whole, [pa.array(c).dictionary_encode() for c in whole.T]),
        (whole, [pa.array(c).cast(pa.decimal128(6, 2)) for c in whole.T]),
        (whole, [pa.chunked_array([c[:17], c[17:]]) for c in whole.T]),
        (Motion.wrench.astype(np.float16).astype(float), [pa.array(c) for c in Motion.wrench.astype(np.float16).T]),
    ]


@pytest.mark.parametrize("which", range(6))
def test_numbers_of_every_type(tmp_path: Path, which: int) -> None:
    expected, values = odd_types()[which]
    path = stored(tmp_path, {**columns(), **dict(zip(WRENCH, values, strict=True)), "note": ["text"] * 60})
    assert np.array_equal(cw.read(path).wrench, expected)


def test_lists_stand_for_columns(tmp_path: Path) -> None:
    from scipy.spatial.transform import Rotation

    quat = Rotation.from_matrix(Motion.R).as_quat()
    for kind in (pa.list_(pa.float64()), pa.list_(pa.float64(), 6), pa.large_list(pa.float32())):
        exact = Motion.wrench if kind.value_type == pa.float64() else Motion.wrench.astype(np.float32).astype(float)
        quats = [list(q) if posed else None for q, posed in zip(quat, Motion.posed, strict=True)]
        table = {
            "t": Motion.t,
            "wrench": pa.array(Motion.wrench.tolist(), kind),
            "quat_xyzw": pa.array(quats, pa.list_(pa.float64())),
            "image": pa.array([[1, 2]] * 60),
        }
        found = read_streams(stored(tmp_path, table, row_group_size=13))
        assert np.array_equal(found.wrench.wrench, exact)
        assert np.array_equal(found.orientation.t, Motion.t[Motion.posed])
        assert found.orientation.R_base_flange == pytest.approx(Motion.R[Motion.posed], abs=1e-12)
    table["wrench"] = pa.array([*Motion.wrench.tolist()[:-1], [1.0, 2.0]])
    path = stored(tmp_path, table)
    assert refusal(path) == ("row 60, column wrench: found a list of 2, expected 6: complete it or leave the row out")


@pytest.mark.parametrize("unit", ["s", "ms", "us", "ns"])
def test_time_stamps_have_their_own_unit(tmp_path: Path, unit: str) -> None:
    counts = (1_700_000_000 + np.arange(60)) * {"s": 1, "ms": 1000, "us": 10**6, "ns": 10**9}[unit]
    for name in ("t", "t_ns"):
        table = {name: pa.array(counts, pa.timestamp(unit)), **{k: v for k, v in columns().items() if k != "t"}}
        assert np.array_equal(read_streams(stored(tmp_path, table)).wrench.t, 1_700_000_000.0 + np.arange(60))


def test_saturation_is_a_boolean(tmp_path: Path) -> None:
    samples = cw.read(stored(tmp_path, {**columns(), "Saturated": np.arange(60) == 4}))
    assert samples.saturated is not None
    assert np.flatnonzero(samples.saturated).tolist() == [4]


BAD = [
    ({"fx": ["a"] * 60}, "column fx: found string, expected numbers: write it as double"),
    (
        {"fx": pa.array([None] * 60, pa.timestamp("ms"))},
        "column fx: found timestamp[ms], expected numbers: write it as double",
    ),
    (
        {"r22": [*[1.0] * 58, float("nan"), 1.0]},
        "row 59, column r22: found no number, expected one: fill it in or leave the row out",
    ),
    (
        {"fy": [*[1.0] * 58, float("-inf"), 1.0]},
        "row 59, column fy: found -inf, expected a finite number: leave the row out",
    ),
    ({"t": [None, *[1.0] * 59]}, "row 1, column t: found no number, expected one: fill it in or leave the row out"),
    ({"T": [1.0] * 60}, "column T is there twice, expected once: rename or remove one"),
    (
        {"tz": [2e9] * 60},
        "row 1, column tz: found 2e+09, expected at most 1e+09 N or N m: correct it or leave the row out",
    ),
]


@pytest.mark.parametrize(("change", "message"), BAD)
def test_columns_that_cannot_be_read_are_named(tmp_path: Path, change: dict[str, Any], message: str) -> None:
    assert refusal(stored(tmp_path, {**columns(), **change}, row_group_size=10)) == message


def test_rows_are_counted_over_batches_and_parts(tmp_path: Path) -> None:
    table = {**columns(), "fy": [*[1.0] * 58, float("inf"), 1.0]}
    path = stored(tmp_path, table)
    with pytest.raises(FileFormatError, match="row 59, column fy: found inf"):
        list(batches(path, rows=7))
    for k in range(3):
        stored(tmp_path, pa.table(table).slice(20 * k, 20), f"run/{k}.parquet")
    with pytest.raises(FileFormatError, match="row 59, column fy: found inf"):
        list(batches(tmp_path / "run", rows=7))


def test_files_that_are_no_parquet(tmp_path: Path) -> None:
    good = stored(tmp_path, columns()).read_bytes()
    for content in (b"", b"PAR1", good[:-20], good[:200] + good[400:], b"x" * 4000):
        path = written(tmp_path, content, "bad.parquet")
        message = refusal(path)
        assert message.startswith("cannot be read as Parquet (")
        assert message.endswith("), expected a whole Parquet file: write it anew")
    with pytest.raises(FileAccessError) as caught:
        cw.read(tmp_path / "gone.parquet")
    assert str(caught.value) == (
        f"{tmp_path / 'gone.parquet'}: there is no such file, expected a readable file: check the path"
    )
    assert refusal(stored(tmp_path, pa.table(columns()).slice(0, 0))) == (
        "found columns and no rows, expected a row for each reading: add them"
    )
    stored(tmp_path, columns(), "run/a.parquet")
    other = stored(tmp_path, {**columns(), "more": Motion.t}, "run/b.parquet")
    with pytest.raises(FileFormatError) as found:
        cw.read(tmp_path / "run")
    assert str(found.value) == f"{other}: found other columns than in a.parquet, expected the same: name one file"


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    return stored(tmp_path_factory.mktemp("whole"), columns(), row_group_size=20).read_bytes()


@pytest.mark.slow
@given(data=st.data())
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_damaged_files_are_refused_in_one_line(tmp_path: Path, whole: bytes, data: st.DataObject) -> None:
    content = bytearray(whole)
    for _ in range(data.draw(st.integers(1, 3))):
        at = data.draw(st.integers(0, len(content) - 1))
        content[at : at + data.draw(st.integers(0, 3))] = data.draw(st.binary(max_size=3))
    path = written(tmp_path, bytes(content), "damaged.parquet")
    try:
        found = joined(list(batches(path, rows=20)))
    except ContactWrenchError as error:
        assert_one_line_that_names(error, path)
    else:
        assert np.isfinite(found.wrench.wrench).all()


def test_without_pyarrow_the_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = stored(tmp_path, columns())
    for name in [name for name in sys.modules if name.partition(".")[0] == "pyarrow"]:
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(MissingExtraError) as caught:
        cw.read(path)
    assert str(caught.value) == ("Parquet needs pyarrow, which is not installed: pip install 'contactwrench[parquet]'")


def test_two_files_of_different_kinds(tmp_path: Path) -> None:
    path = stored(tmp_path, {name: columns()[name] for name in ("t", *WRENCH)}, "wrench.parquet")
    poses = written(tmp_path, with_gaps(), "pose.csv")
    assert_same(read_streams(path, Options(pose_file=poses)), Motion.R, Motion.posed)
    assert_same(joined(list(batches(path, Options(pose_file=poses), rows=9))), Motion.R, Motion.posed)


def test_diagnose_and_calibrate_read_parquet(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from pyarrow import csv

    content = "\n".join(line for line in PANDA.read_text().splitlines() if not line.startswith("#"))
    path = stored(tmp_path, csv.read_csv(written(tmp_path, content)))
    for verb in ("calibrate", "diagnose"):
        done, plain = run(capsys, verb, path), run(capsys, verb, PANDA)
        assert (done.status, done.out.replace(str(path), str(PANDA))) == (plain.status, plain.out)
    assert len(MATRIX) == 9
