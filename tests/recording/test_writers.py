"""Contact wrenches written batch by batch: the same table whatever the batches, CSV to the byte as ever."""

from __future__ import annotations

import csv
import io
from contextlib import redirect_stdout
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import contactwrench as cw
from contactwrench.compensate.contact_wrenches import ContactWrenches
from contactwrench.compensate.faults import Reason
from contactwrench.errors import FileAccessError, InputError
from contactwrench.recording.tables.write import NAMES, write_contact_wrenches
from tests.recording.test_tables import HEADER, rows, with_gaps
from tests.support.recordings import PANDA, Array, csv_text, run, written

RNG = np.random.default_rng(3)
N = 2500
T: Array = 1.7e9 + 1e-3 * np.arange(N, dtype=np.float64)
WRENCH_OF = RNG.normal(size=(N, 6)) * 10.0 ** RNG.integers(-7, 10, size=(N, 6))
STD = np.abs(RNG.normal(size=(N, 6)))
WRENCH_OF[5], WRENCH_OF[6] = np.nan, [0.0, -0.0, 1.0, -1.0, 1e-300, 123456789.5]


def parts(sizes: list[int], t: Array | None = T) -> list[ContactWrenches]:
    ends = np.cumsum([0, *sizes])
    return [ContactWrenches(WRENCH_OF[a:b], STD[a:b], None if t is None else t[a:b]) for a, b in pairwise(ends)]


@pytest.mark.parametrize("sizes", [[N], [1, 999, 1, 1499], [1000, 1000, 500], [0, N, 0]])
@pytest.mark.parametrize("t", [None, T])
def test_a_row_is_as_python_formats_it(tmp_path: Path, sizes: list[int], t: Array | None) -> None:
    path = tmp_path / "out.csv"
    write_contact_wrenches(path, parts(sizes, t))
    names = [*(["t"] if t is not None else []), *NAMES]
    lines = [",".join(names)]
    for k in range(N):
        cells = [f"{value:.9g}" for value in (*WRENCH_OF[k], *STD[k])]
        lines.append(",".join([*([repr(float(T[k]))] if t is not None else []), *cells]))
    assert path.read_text() == "\n".join([*lines, ""])


def judged() -> ContactWrenches:
    stuck = Reason("stuck: fx has not moved", "stuck")
    reasons = [None, stuck, Reason('gap: nothing for 1 s, "filters" start anew', "gap"), None]
    return ContactWrenches(
        WRENCH_OF[:4],
        STD[:4],
        T[:4],
        True,
        np.array([True, False, False, True]),
        tuple(reasons),
        np.array([1, 0, -1, 1], np.int8),
    )


def test_a_judgement_stands_beside_each_wrench(tmp_path: Path) -> None:
    write_contact_wrenches(tmp_path / "out.csv", [judged(), judged()])
    table = list(csv.DictReader(io.StringIO((tmp_path / "out.csv").read_text())))
    assert list(table[0])[-3:] == ["valid", "contact", "reason"]
    assert [row["valid"] for row in table] == ["1", "0", "0", "1"] * 2
    assert [row["contact"] for row in table] == ["1", "0", "", "1"] * 2
    assert [row["reason"] or None for row in table] == list(judged().reason) * 2
    assert [float(row["fx"]) for row in table] == pytest.approx([*WRENCH_OF[:4, 0]] * 2, rel=1e-8)


def test_parquet_has_the_same_columns_exactly(tmp_path: Path) -> None:
    pq = pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed")
    path = tmp_path / "out.parquet"
    write_contact_wrenches(path, parts([1000, 1500]))
    table = pq.read_table(path)
    assert table.column_names == ["t", *NAMES]
    assert np.array_equal(table["t"].to_numpy(), T)
    found = np.column_stack([table[name].to_numpy() for name in NAMES])
    assert np.array_equal(found, np.hstack([WRENCH_OF, STD]), equal_nan=True)
    write_contact_wrenches(path, [judged()])
    table = pq.read_table(path)
    assert table["valid"].to_pylist() == [True, False, False, True]
    assert table["contact"].to_pylist() == [True, False, None, True]
    assert table["reason"].to_pylist() == list(judged().reason)
    of_columns = pq.ParquetFile(path).metadata.row_group(0)
    kept = [of_columns.column(k) for k in range(of_columns.num_columns)]
    looked_up = {each.path_in_schema for each in kept if any("DICTIONARY" in how for how in each.encodings)}
    assert not looked_up & set(NAMES)  # a dictionary of readings, none of which repeats, takes most of the time


def stored(folder: Path, table: dict[str, Any], **options: Any) -> Path:
    pa, pq = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    pq.write_table(pa.table(table), folder / "run.parquet", **options)
    return folder / "run.parquet"


@pytest.mark.slow
def test_parquet_to_parquet_keeps_every_other_column(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pq = pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed")
    table: dict[str, Any] = {name: rows()[:, k] for k, name in enumerate(HEADER)}
    table |= {"note": [f"row {k}" for k in range(60)], "image": [b"\0\1"] * 60, "joints": [[1, 2]] * 60}
    path, tool = stored(tmp_path, table, row_group_size=17), tmp_path / "tool.json"
    cw.calibrate(cw.read(PANDA)).save(tool)
    text = written(tmp_path, csv_text(HEADER, rows()))
    assert run(capsys, "compensate", path, "-c", tool, "-o", tmp_path / "out.parquet").status == 0
    assert run(capsys, "compensate", text, "-c", tool, "-o", tmp_path / "plain.parquet").status == 0
    assert run(capsys, "compensate", text, "-c", tool, "-o", tmp_path / "plain.csv").status == 0
    assert run(capsys, "compensate", path, "-c", tool, "-o", tmp_path / "other.csv").status == 0
    assert (tmp_path / "plain.csv").read_bytes() == (tmp_path / "other.csv").read_bytes()
    before, after, plain = (pq.read_table(tmp_path / name) for name in ("run.parquet", "out.parquet", "plain.parquet"))
    assert after.column_names == [*before.column_names, *(f"contact_{name}" for name in NAMES)]
    assert after.select(before.column_names).equals(before)
    assert plain.column_names == ["t", *NAMES]
    for name in NAMES:
        assert np.array_equal(after[f"contact_{name}"].to_numpy(), plain[name].to_numpy())


def test_rows_without_a_wrench_have_no_contact_wrench(tmp_path: Path) -> None:
    pq = pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed")
    gaps = np.arange(N) % 4 == 1
    table = {f"f{axis}": np.where(gaps, np.nan, 1.0) for axis in "xyz"} | {
        f"t{axis}": np.where(gaps, np.nan, 1.0) for axis in "xyz"
    }
    recording = stored(tmp_path, table | {"k": np.arange(N)}, row_group_size=300)
    left = int((~gaps).sum())
    for sizes in ([left], [10, left - 10], [left - 1, 1], [0, left, 0]):
        write_contact_wrenches(tmp_path / "out.parquet", parts(sizes), recording)
        found = pq.read_table(tmp_path / "out.parquet")
        assert found["k"].to_pylist() == list(range(N))
        values = found["contact_fz_std"].to_pylist()
        assert [value is None for value in values] == gaps.tolist()
        assert [value for value in values if value is not None] == STD[:left, 2].tolist()
    before = (tmp_path / "out.parquet").read_bytes()
    for rows_of, more in ((left - 1, "more"), (left + 1, "fewer")):
        with pytest.raises(InputError, match=f"{recording}: found {more} rows than were compensated"):
            write_contact_wrenches(tmp_path / "out.parquet", parts([rows_of]), recording)
    assert (tmp_path / "out.parquet").read_bytes() == before


@pytest.mark.parametrize("name", ["out.csv", "out.parquet"])
def test_what_breaks_off_leaves_the_old_file(tmp_path: Path, name: str) -> None:
    pytest.importorskip("pyarrow", reason="pyarrow is not installed")
    path = written(tmp_path, "old", name)

    def breaking() -> Any:
        yield parts([1000])[0]
        raise FileAccessError("run.csv: cannot be read")

    with pytest.raises(FileAccessError, match=r"^run\.csv: cannot be read$"):
        write_contact_wrenches(path, breaking())
    assert path.read_text() == "old"
    assert [entry.name for entry in tmp_path.iterdir()] == [name]
    with pytest.raises(FileAccessError, match="found no folder"):
        write_contact_wrenches(tmp_path / "gone" / name, parts([1]))


def test_gaps_are_compensated_through_pairing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    tool = tmp_path / "tool.json"
    cw.calibrate(cw.read(PANDA)).save(tool)
    done = run(capsys, "compensate", written(tmp_path, with_gaps()), "-c", tool, "-o", tmp_path / "out.csv")
    assert done.status in (0, 2)  # poses at random: they lie too far apart to be interpolated
    assert "Traceback" not in done.err


def numbers_written(numbers: Array) -> list[str]:
    """The numbers as the column fx of a CSV has them."""
    with redirect_stdout(io.StringIO()) as out:
        write_contact_wrenches("-", [ContactWrenches(np.tile(numbers[:, None], 6), np.zeros((len(numbers), 6)))])
    return [line.partition(",")[0] for line in out.getvalue().splitlines()[1:]]


@given(st.lists(st.floats() | st.integers(-(10**10), 10**10).map(lambda k: k / 16.0), min_size=1, max_size=50))
def test_numbers_are_written_as_python_writes_them(numbers: list[float]) -> None:
    assert numbers_written(np.array(numbers)) == [f"{number:.9g}" for number in numbers]


def test_numbers_near_a_power_of_ten_or_half_a_digit_are_rounded_as_python_does() -> None:
    powers = 10.0 ** np.arange(-7, 13)
    halves = (RNG.integers(10**8, 10**9, size=2000) + 0.5) / 10.0 ** RNG.integers(0, 13, size=2000)
    at = np.concatenate([powers, powers * (1.0 - 5e-10), powers * (1.0 - 4.999999e-10), halves])
    numbers = np.concatenate([at, -at, np.nextafter(at, 0.0), np.nextafter(at, np.inf), [0.0, -0.0]])
    assert numbers_written(numbers) == [f"{number:.9g}" for number in numbers.tolist()]
