"""Text tables in every layout: the numbers that were written come back, or one line says why not; never other ones."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import contactwrench as cw
from contactwrench.errors import FileFormatError
from contactwrench.recording.read import batches
from tests.recording.test_bad_files import assert_one_line_that_names
from tests.recording.test_tables import HEADER, Motion, assert_same, joined, rows, with_gaps
from tests.support.recordings import WRENCH, run, written

NUMBERS = ("{!r}", "{:.3f}", "{:.6g}", "{:.9e}", "{:+.4f}", "{:,.3f}", "{:.0f}")
SEPARATORS = (",", ";", "\t", " ", "   ", ", ", "; ", " \t")
IDENTITY = ("qx", "qy", "qz", "qw")


def with_decimal_comma(text: str) -> str:
    """A number as a German locale writes it: points apart thousands, a comma before the decimals."""
    return text.translate(str.maketrans(",.", ".,"))


@given(data=st.data())
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_what_is_written_is_read_or_refused(tmp_path: Path, data: st.DataObject) -> None:
    form, separator = data.draw(st.sampled_from(NUMBERS)), data.draw(st.sampled_from(SEPARATORS))
    comma = data.draw(st.booleans())
    readings = st.floats(-3e4, 3e4) | st.integers(-2000, 2000).map(float) | st.just(0.0)
    wrenches = data.draw(st.lists(st.tuples(*[readings] * 6), min_size=1, max_size=4))
    cells = [[form.format(value) for value in wrench] for wrench in wrenches]
    quat = [form.format(0.0)] * 3 + [form.format(1.0)]
    table = [[*(with_decimal_comma(cell) if comma else cell for cell in (*row, *quat))] for row in cells]
    quote = data.draw(st.sampled_from(["", '"']))
    head = data.draw(st.sampled_from(["", "# ", "# made by hand\n"]))
    lines = [
        separator.join((*WRENCH, *IDENTITY)),
        *(separator.join(f"{quote}{c}{quote}" for c in row) for row in table),
    ]
    encoding = data.draw(st.sampled_from(["utf-8", "utf-8-sig", "utf-16"]))
    path = written(tmp_path, (head + "\r\n".join(lines)).encode(encoding))
    try:
        found = cw.read(path).wrench
    except FileFormatError as error:
        assert_one_line_that_names(error, path)
        grouped = any(("." if comma else ",") in cell for row in table for cell in row)
        grouped |= "may be thousands or a number with decimals" in str(error) and form != "{:.3f}"
        apart = separator.strip() in (";", "") or (not comma and separator.strip() == ",")
        assert grouped or not apart or (quote and separator not in (",", ";", "\t"))
        return
    expected = np.array([[float(cell.replace(",", "")) for cell in row] for row in cells])
    assert np.array_equal(found, expected)


@pytest.mark.parametrize("separator", [";", "\t"])
def test_gaps_between_decimal_commas_whole_and_in_blocks(tmp_path: Path, separator: str) -> None:
    path = written(tmp_path, with_gaps().replace(",", separator).replace(".", ","))
    for n in (1, 7, 1000):
        assert_same(joined(list(batches(path, rows=n))), Motion.R, Motion.posed)


def test_a_recording_with_blanks_of_any_width_in_blocks(tmp_path: Path) -> None:
    """As UR's RTDE recorder writes it (UniversalRobots/RTDE_Python_Client_Library, rtde/csv_writer.py), and columns set
    one below the other.
    """
    for width in (0, 26):
        lines = [" ".join(f"{cell:>{width}}" for cell in line) for line in [HEADER, *map(repr_of, rows())]]
        path = written(tmp_path, "\n".join(lines))
        for n in (1, 7, 1000):
            assert_same(joined(list(batches(path, rows=n))), Motion.R, slice(None))


def repr_of(row: np.ndarray) -> list[str]:
    return [repr(float(value)) for value in row]


def test_numpy_savetxt_is_read_as_it_comes(tmp_path: Path) -> None:
    for delimiter in (" ", ",", ";", "\t"):
        path = tmp_path / "run.txt"
        np.savetxt(path, rows(), delimiter=delimiter, header="by hand\n" + delimiter.join(HEADER))
        found = joined(list(batches(path)))
        assert np.array_equal(found.wrench.wrench, Motion.wrench)
        assert np.array_equal(found.wrench.t, Motion.t)


def test_a_header_behind_the_percent_sign_of_matlab_is_read(tmp_path: Path) -> None:
    """As `% time fx fy ...` it was a column more than there are; a unit of percent is no comment."""
    path = tmp_path / "run.txt"
    np.savetxt(path, rows(), delimiter=" ", header=" ".join(HEADER), comments="% ")
    assert np.array_equal(joined(list(batches(path))).wrench.wrench, Motion.wrench)
    units = ",".join(["%", *("N" for _ in range(3)), *("Nmm" for _ in range(3)), *(7 * [""])])
    text = f"humidity,fx,fy,fz,tx,ty,tz,t,x,y,z,a,b,c\n{units}\n50,1,2,3,4,5,6,0,0,0,0,10,20,30\n"
    assert cw.read(written(tmp_path, text)).wrench[0, 3] == pytest.approx(0.004)


def test_info_shows_the_columns_of_every_layout(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for text in ("t;fx\n0,5;1,5\n1,5;2,5\n", "# t fx\n0.5 1.5\n1.5 2.5\n", "t  fx\n0.5  1.5\n1.5 2.5\n"):
        path = written(tmp_path, text)
        assert run(capsys, "info", path).out.startswith(
            f"{path}\nTable, 2 rows of 2 columns\n  t, fx\n  times: 1 s\n  rate: 1 Hz, longest gap 1 s at 0.000 s\n"
        )


UNITS_APART = "time [s]  Fx [N]  Fy [N]  Fz [N]  Mx [N m]  My (Nmm)  Mz [kgf cm]  qx qy qz qw"


@pytest.mark.parametrize("before", ["", "# "])
def test_units_apart_between_blanks_belong_to_the_name_before(tmp_path: Path, before: str) -> None:
    path = written(tmp_path, f"{before}{UNITS_APART}\n0.5  1 2  3 4 5000 6  0 0 0 1\n5.5 1 2 3 4 5000 6 0 0 0 1\n")
    found = cw.read(path)
    assert found.wrench == pytest.approx(np.tile([1.0, 2.0, 3.0, 4.0, 5.0, 6.0 * 0.0980665], (2, 1)), rel=1e-12)
    assert found.t == pytest.approx([0.5, 5.5])


def test_a_minus_sign_of_typography_is_a_minus(tmp_path: Path) -> None:
    row = "-1,5;2,5;-3;4;-5;6;0;0;0;-1".replace("-", "\N{MINUS SIGN}")
    path = written(tmp_path, f"{';'.join((*WRENCH, *IDENTITY))}\n{row}\n")
    assert cw.read(path).wrench.tolist() == [[-1.5, 2.5, -3.0, 4.0, -5.0, 6.0]]


@pytest.mark.parametrize("mark", [".", ","])
def test_whole_numbers_with_points_for_thousands_are_refused(tmp_path: Path, mark: str) -> None:
    header = ";".join((*WRENCH, *IDENTITY))
    rows = [f"14{mark}884;-1{mark}537;9{mark}180;-57;753;152;0{mark}5;0{mark}5;0{mark}5;0{mark}5"] * 3
    with pytest.raises(FileFormatError) as caught:
        cw.read(written(tmp_path, "\n".join([header, *rows])))
    if mark == ".":
        assert str(caught.value).endswith(
            "row 2, column fx: found '14.884' beside whole numbers, which may be thousands or a number with decimals, "
            "expected digits and decimals in all rows: write them so"
        )


@pytest.mark.parametrize(
    "wrench",
    ["14.884;-1.537;9.180;-0.057;0.753;0", "14.884;-1.53;9.18;-57;753;152", "14.884;-1.537;9.180;-57.000;1.000;2.000"],
)
def test_decimals_that_can_be_nothing_else_are_read(tmp_path: Path, wrench: str) -> None:
    path = written(tmp_path, f"{';'.join((*WRENCH, *IDENTITY))}\n{wrench};0;0;0;1\n")
    assert cw.read(path).wrench.tolist() == [[float(cell) for cell in wrench.split(";")]]


def test_what_a_spreadsheet_could_not_compute_is_no_comment(tmp_path: Path) -> None:
    row = "1,2,3,4,5,6,0,0,0,1"
    path = written(
        tmp_path, "\n".join([",".join((*WRENCH, *IDENTITY)), row, "# moved", row.replace("1,2", "#N/A,2"), row])
    )
    with pytest.raises(FileFormatError) as caught:
        cw.read(path)
    assert str(caught.value) == (
        f"{path}: row 4, column fx: found '#N/A', expected a number: correct it or leave the row out"
    )
