"""Text tables without a header, whose columns the options tell by number, from 1: read as they are meant, or refused in
one line; a calibration remembers the numbers for tables of as many columns, and for no others.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import contactwrench as cw
from contactwrench.errors import ContactWrenchError, FileFormatError
from tests.recording.test_bad_files import assert_one_line_that_names
from tests.support.recordings import WRENCH, run, written

POSES = cw.read(Path(cw.__file__).parent / "data" / "panda_mini45.csv")
ROWS = np.hstack([POSES.wrench, Rotation.from_matrix(POSES.R_base_flange).as_quat()])
BY_NUMBER = {"wrench_columns": "1,2,3,4,5,6", "orientation": "quat_xyzw:7,8,9,10"}
SHIFTED = {"wrench_columns": "2,3,4,5,6,7", "orientation": "quat_xyzw:8,9,10,11"}
OPTIONS = ("--wrench-columns", "1,2,3,4,5,6", "--orientation", "quat_xyzw:7,8,9,10")


def text(separator: str = ",", form: str = "%.18e") -> str:
    return "".join(separator.join(form % value for value in row) + "\n" for row in ROWS)


def with_first(first: str, separator: str = ",") -> str:
    """The rows behind a column of their own; `{}` is the row's number."""
    lines = text(separator).splitlines()
    return "".join(f"{first.format(k)}{separator}{line}\n" for k, line in enumerate(lines))


def read(path: Path, **options: str) -> cw.Samples:
    return cw.read(path, **options)  # type: ignore[arg-type]


def assert_read(path: Path, **options: str) -> cw.Samples:
    found = read(path, **(options or BY_NUMBER))
    assert found.wrench == pytest.approx(POSES.wrench, abs=1e-6)
    assert found.R_base_flange == pytest.approx(POSES.R_base_flange, abs=1e-6)
    return found


def refusal(path: Path, **options: str) -> str:
    with pytest.raises(ContactWrenchError) as caught:
        read(path, **(options or BY_NUMBER))
    assert "\n" not in str(caught.value)
    return str(caught.value).removeprefix(f"{path}: ")


@pytest.mark.parametrize(
    "content",
    [
        *(text(separator) for separator in (",", ";", "\t", " ", "   ", ", ", " \t")),
        text(" ", "%24.12f"),
        *(text(separator, "%.9f").replace(".", ",") for separator in (";", "\t", " ")),
        "# by hand\n# free, and, at, rest\n\n" + text(),
        "# fx fy fz\n" + text(" "),
        "".join(",".join(f'"{value:.9f}"' for value in row) + "\n" for row in ROWS),
        text(";").replace("\n", ";\n"),
        "sep=;\n" + text(";"),
        text().encode("utf-16"),
        b"\xef\xbb\xbf" + text().encode(),
        ",".join(str(k) for k in range(1, 11)) + "\n" + text(),
    ],
)
def test_every_layout_is_read(tmp_path: Path, content: str | bytes) -> None:
    assert_read(written(tmp_path, content, "log.txt"))


def test_numpy_savetxt_is_read_as_it_comes(tmp_path: Path) -> None:
    np.savetxt(tmp_path / "poses.txt", ROWS)
    found = assert_read(tmp_path / "poses.txt")
    assert found.read_as["columns"] == 'fx..fz from "1".."3", tx..tz from "4".."6", qx..qw from "7".."10"'


def test_the_names_that_pandas_gives_are_names(tmp_path: Path) -> None:
    by_name = {"wrench_columns": "0,1,2,3,4,5", "orientation": "quat_xyzw:6,7,8,9"}
    header = ",".join(map(str, range(10))) + "\n"
    index = f",{header}" + with_first("{}")
    for content in (header + text(), f"Log 2\n{header}{text()}", index):
        assert_read(written(tmp_path, content), **by_name)
    assert refusal(written(tmp_path, header + text())).startswith("found no column 10, expected 7,8,9,10 for quat_xyzw")


def test_a_counter_is_a_column_and_may_be_the_times(tmp_path: Path) -> None:
    path = written(tmp_path, with_first("{}00", "\t"))
    assert_read(path, **SHIFTED)
    found = assert_read(path, **SHIFTED, time_column="1:ms")
    assert found.t == pytest.approx(0.1 * np.arange(len(ROWS)))


@pytest.mark.parametrize(
    ("first", "separator", "columns"), [("12:30:{:02d}.5", ",", SHIFTED), ("01.05.2024T12:30:{:02d}", " ", SHIFTED)]
)
def test_a_time_of_day_is_a_column_and_no_time(
    tmp_path: Path, first: str, separator: str, columns: dict[str, str]
) -> None:
    """The first row was taken for a header: of whole readings, 2 among them, a column was found by its value."""
    path = written(tmp_path, with_first(first, separator))
    assert_read(path, **columns)
    assert refusal(path, **columns, time_column="1") == (
        f"row 1, column 1: found {first.format(0)!r}, a date or time of day, expected s, or "
        "2024-05-01 12:00:00: write those, or leave the times out, if the rows are poses, with --time-column none"
    )


def test_columns_named_by_numbers_beside_others_are_still_a_header(tmp_path: Path) -> None:
    header = ",".join((*WRENCH, "qx", "qy", "qz", "qw", *(f"{100 * k}" for k in range(1, 8))))
    lines = "".join(f"{line},1,2,3,4,5,6,7\n" for line in text().splitlines())
    assert_read(written(tmp_path, f"{header}\n{lines}"), orientation="auto")


@pytest.mark.parametrize("separator", [" ; ", " ;", "; ", " , ", ", ", " \t ", "\t "])
@pytest.mark.parametrize("rows", [len(ROWS), 1])
def test_names_that_end_in_numbers_are_names_between_blanks_too(tmp_path: Path, separator: str, rows: int) -> None:
    """Apart at the blanks they are six numbers: the table was taken for one without a header."""
    header = separator.join(
        ["force 1", "force 2", "force 3", "torque 1", "torque 2", "torque 3", "qx", "qy", "qz", "qw"]
    )
    lines = text(separator).splitlines(keepends=True)[:rows]
    found = read(written(tmp_path, f"{header}\n{''.join(lines)}"))
    assert found.wrench == pytest.approx(POSES.wrench[:rows], abs=1e-6)


LOST = "expected what --wrench-columns names: name columns of the file"


@pytest.mark.parametrize(
    ("content", "options", "message"),
    [
        (
            text(),
            {"wrench_columns": "1,2,3,4,5"},
            "--wrench-columns is '1,2,3,4,5', expected six different names A,B,C,D,E,F, or a slice of six such as "
            "observation.wrench[0:6]",
        ),
        (
            text(),
            {"wrench_columns": "0,1,2,3,4,5"},
            f"found no column 0, {LOST} (found 1, 2, 3, 4, 5, 6, 7, 8, 9, 10)",
        ),
        (
            text(),
            {"orientation": "quat_xyzw:6,7,8,9"},
            "found no column 6, expected 6,7,8,9 for quat_xyzw: name the columns, as in --orientation NAME:COLUMNS "
            "(found 7, 8, 9, 10)",
        ),
        (
            text(),
            {"time_column": "1"},
            "found column 1 as times and as wrench or orientation, expected one of them: correct --time-column or the "
            "others",
        ),
        (f"{text()}1,2,3\n", {}, "row 18: found 3 values, expected 10 as in the first row: complete the row, and "),
        ("fx,fy,fz,tx,ty,tz,qx,qy,qz\n" + text(), {}, f"found no column 1, {LOST} (found fx, fy, fz, tx, ty, tz, qx,"),
        (b"\x93fx\x02\n" + text().encode(), {}, f"found no column 1, {LOST} (found "),
        ("Logger 1\n" + text(), {}, f"found no column 2, {LOST} (found Logger, 1)"),
        (
            text(",", "%.6f").replace(".", ","),
            {},
            "row 1: found numbers between commas, which may be decimal commas, and no header, expected a header, "
            "or decimals with a point: write them so",
        ),
        (
            "# Forces: lbf\n" + text(),
            {},
            "row 1: found lbf above columns without names, expected to be told the units: say --units "
            "force=N,torque=Nm, or what else they are",
        ),
    ],
)
def test_what_is_not_meant_so_is_refused(
    tmp_path: Path, content: str | bytes, options: dict[str, str], message: str
) -> None:
    assert refusal(written(tmp_path, content), **{**BY_NUMBER, **options}).startswith(message)


def test_units_are_stated(tmp_path: Path) -> None:
    path = written(tmp_path, "# Forces: lbf\n" + text())
    found = read(path, **BY_NUMBER, units="force=lbf,torque=Nm")
    assert found.wrench[:, :3] == pytest.approx(4.4482216152605 * POSES.wrench[:, :3], rel=1e-7)


def test_a_calibration_remembers_numbers_for_as_many_columns(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, wider, out = (
        written(tmp_path, text(), "a.txt"),
        written(tmp_path, with_first("{}"), "b.txt"),
        tmp_path / "o.csv",
    )
    named = written(tmp_path, f"{','.join((*reversed(WRENCH), 'qx', 'qy', 'qz', 'qw'))}\n{text()}", "c.csv")
    assert run(capsys, "calibrate", log, "-o", tmp_path / "cal.json", *OPTIONS).status == 0
    with_it = ("-c", tmp_path / "cal.json", "-o", out, "--force")
    again = run(capsys, "compensate", log, *with_it)
    said = "--orientation quat_xyzw:7,8,9,10 --wrench-columns 1,2,3,4,5,6"
    assert (again.status, f"Note: read as the calibration was: {said}\n" in again.err) == (0, True)
    assert run(capsys, "verify", log, "-c", tmp_path / "cal.json").status == 0
    other = run(capsys, "compensate", wider, *with_it)
    assert (other.status, "or tell the 11 columns by number" in other.err) == (2, True)
    by_names = run(capsys, "compensate", named, *with_it)
    assert (by_names.status, f"Note: not read as the calibration was, no columns for {said}" in by_names.err) == (
        0,
        True,
    )


def test_two_files_without_headers(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    t = np.arange(float(len(ROWS)))[:, None]
    wrench, pose, wider = tmp_path / "w.txt", tmp_path / "p.txt", tmp_path / "wide.txt"
    for path, columns in ((wrench, ROWS[:, :6]), (pose, ROWS[:, 6:]), (wider, np.hstack([t, ROWS[:, 6:]]))):
        np.savetxt(path, np.hstack([t, columns]))
    by_number = ("--wrench-columns", "2,3,4,5,6,7", "--orientation", "quat_xyzw:2,3,4,5", "--time-column", "1")
    calibrated = run(capsys, "calibrate", "--wrench", wrench, "--pose", pose, *by_number, "-o", tmp_path / "cal.json")
    assert calibrated.status == 0
    with_it = ("-c", tmp_path / "cal.json", "-o", tmp_path / "o.csv", "--force")
    again = run(capsys, "compensate", "--wrench", wrench, "--pose", pose, *with_it)
    assert (again.status, "read as the calibration was: --orientation quat_xyzw:2,3,4,5" in again.err) == (0, True)
    other = run(capsys, "compensate", "--wrench", wrench, "--pose", wider, *with_it)
    assert (other.status, "or tell the 7 columns by number" in other.err) == (2, True)


@given(data=st.data())
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_numbers_come_back_or_are_refused(tmp_path: Path, data: st.DataObject) -> None:
    """With decimal commas between commas every number was two."""
    form = data.draw(st.sampled_from(("{!r}", "{:.3f}", "{:.6g}", "{:.9e}", "{:+.4f}", "{:.0f}", "{:.1f}")))
    separator, comma = data.draw(st.sampled_from((",", ";", "\t", " ", "   ", ", ", " \t"))), data.draw(st.booleans())
    number = st.floats(10.0, 3e3) | st.floats(-3e3, -10.0) | st.integers(10, 99).map(float)
    cells = data.draw(st.lists(st.lists(number, min_size=9, max_size=9), min_size=1, max_size=4))
    texts = [[form.format(value) for value in row] for row in cells]
    lines = [separator.join(text.replace(".", ",") if comma else text for text in row) for row in texts]
    path = written(tmp_path, "\n".join(lines), "log.txt")
    try:
        found = read(path, wrench_columns="1,2,3,4,5,6", orientation="kuka_abc:7,8,9", units="angle=deg")
    except FileFormatError as error:
        assert_one_line_that_names(error, path)
        said, may_be_two = str(error), separator.strip() == "," and (comma or form in ("{:.0f}", "{:.6g}"))
        assert may_be_two or comma or (form == "{:.3f}" and "thousands" in said)
        return
    assert found.wrench == pytest.approx(np.array([[float(text) for text in row[:6]] for row in texts]))
