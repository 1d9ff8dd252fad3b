"""Tables that cannot be read: each is refused in one line, word for word; rows count as an editor counts lines."""

import os
from pathlib import Path

import pytest

import contactwrench as cw
from contactwrench.errors import FileAccessError, FileFormatError, InputError
from tests.support.recordings import MATRIX, WRENCH, written

QUAT_HEADER = "fx,fy,fz,tx,ty,tz,qx,qy,qz,qw"
GOOD = "1,2,3,4,5,6,0,0,0,1"
QUAT_TABLE = f"{QUAT_HEADER}\n{GOOD}\n"
MATRIX_HEADER = ",".join((*WRENCH, *MATRIX))
NO_HEADER = (
    "found numbers, expected a header with the columns' names: write one, or tell the 10 columns by number, as "
    "--wrench-columns 1,2,3,4,5,6 --orientation quat_xyzw:7,8,9,10"
)
IN_UTF8 = "expected CSV text in UTF-8: save it as that"
HEADER_AND_ROWS = "expected a header line and rows of numbers"
NO_ORIENTATION = (
    "expected qx qy qz qw, r11..r33, a b c (KUKA), w p r (FANUC), rx ry rz (UR) or roll pitch yaw: rename them, or "
    "--orientation NAME:COLUMNS, or --wrench W.csv --pose P.csv"
)
CUT_OFF = "expected 1 within 1 %: check the order of its parts and that none is cut off"
ORTHONORMAL = "expected orthonormal within 1 % and determinant 1: check the order of its entries"


def refusal(path: Path, **flags: str) -> str:
    """The message, without the folder, with which `read` refuses a file."""
    with pytest.raises(FileFormatError) as caught:
        cw.read(path, **flags)  # type: ignore[arg-type]
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert "\n" not in message
    return message.removeprefix(f"{path}: ")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", f"the file is empty, {HEADER_AND_ROWS}"),
        (b" \n\t\n", f"the file is empty, {HEADER_AND_ROWS}"),
        (b"\xef\xbb\xbf\r\n", f"the file is empty, {HEADER_AND_ROWS}"),
        (b"# one\n\n# two\n", f"found comments only, {HEADER_AND_ROWS}"),
        (QUAT_TABLE.encode("utf-16-le"), f"found UTF-16 or binary content, {IN_UTF8}"),
        (QUAT_TABLE.encode("utf-16-be"), f"found UTF-16 or binary content, {IN_UTF8}"),
        (QUAT_TABLE.encode("utf-32"), f"found UTF-16 or binary content, {IN_UTF8}"),
        (
            b"\xef\xbb\xbf" + f"# one\n{QUAT_TABLE}# Meßreihe\n".encode("latin-1"),
            "row 4: found a byte that is no UTF-8, expected UTF-8: save it as that",
        ),
        (GOOD, f"row 1: {NO_HEADER}"),
        (f"# no header\n\n{GOOD}\n", f"row 3: {NO_HEADER}"),
        (f"{QUAT_HEADER}\n", "found a header and no rows, expected a row for each reading: add them"),
        (f"{QUAT_HEADER}\n# 1\n \n", "found a header and no rows, expected a row for each reading: add them"),
    ],
)
def test_files_without_a_table(tmp_path: Path, content: str | bytes, message: str) -> None:
    assert refusal(written(tmp_path, content)) == message


@pytest.mark.parametrize(
    ("remark", "found", "column"),
    [
        ("Units: lbf, in-lb", "lbf", "fx [lbf]"),
        ("torque=N mm", "N mm", "tx [N mm]"),
        ('"Force","lbf"', "lbf", "fx [lbf]"),
        ("in N/Nmm", "Nmm", "tx [N mm]"),
        ("{kgf}|{N-mm}", "kgf", "fx [kgf]"),
        ("Angles in rad", "rad", "roll [rad]"),
        ("Time: ms", "ms", "t [ms]"),
        ("Positions (mm)", "mm", "x [mm]"),
        ("Force unit: talents", "'Force unit: talents'", "fx [N], tx [Nm]"),
        ("Force: pounds", "'Force: pounds'", "fx [N], tx [Nm]"),
    ],
)
def test_a_unit_above_the_header_is_named(tmp_path: Path, remark: str, found: str, column: str) -> None:
    said = refusal(written(tmp_path, f"Log 2\n{remark}\n{QUAT_TABLE}"))
    which = "them" if "," in column else "it"
    assert said == (
        f"row 2: found {found} above the header, expected units beside the names, as in {column}: write {which} there, "
        "and # before that row"
    )


ALL_BUT = "expected fx fy fz tx ty tz and an orientation: add it, or name the six with --wrench-columns A,B,C,D,E,F"


@pytest.mark.parametrize(
    ("header", "message"),
    [
        ("fx,fy,tx,ty,tz,qx", f"found no column fz, {ALL_BUT} (found fx, fy, tx, ty, tz, qx)"),
        ("fx,fy,fz,tx,ty", f"found no column tz, {ALL_BUT} (found fx, fy, fz, tx, ty)"),
        ("fx,fy,fz,nx,ny,nz", f"found no column tx, {ALL_BUT} (found fx, fy, fz, nx, ny, nz)"),
        (f"fx,{QUAT_HEADER}", "column fx is there twice, expected once: rename or remove one"),
        (f"note,{QUAT_HEADER},Note", "column Note is there twice, expected once: rename or remove one"),
        (f"{QUAT_HEADER},tx_nmm", "found columns tx and tx_nmm, expected one of them: remove the other"),
        (f"{QUAT_HEADER},t,t_ms", "found columns t and t_ms, expected one of them: remove the other"),
        ("fx,fy,fz,tx,ty,tz,qx,qy,qz", "found no column qw, expected all of quat_xyzw: add it"),
        ("fx,fy,fz,tx,ty,tz,b_deg,c_deg", "found no column a, expected all of kuka_abc: add it"),
        (
            f"{QUAT_HEADER},a,b,c",
            "found the columns of quat_xyzw and of kuka_abc, expected one orientation: choose with --orientation "
            "quat_xyzw",
        ),
        (
            "fx,fy,fz,tx,ty,tz,phi,theta,psi",
            f"found no orientation columns, {NO_ORIENTATION} (found fx, fy, fz, tx, ty, tz, phi, theta, psi)",
        ),
        (
            "fx,fy,fz,tx,ty,tz," + ",".join(f"u{k}" for k in range(20)),
            f"found no orientation columns, {NO_ORIENTATION} (found fx, fy, fz, tx, ty, tz, "
            + ", ".join(f"u{k}" for k in range(14))
            + ", ...)",
        ),
    ],
)
def test_headers_that_do_not_tell_everything(tmp_path: Path, header: str, message: str) -> None:
    row = ",".join("0" for _ in header.split(","))
    assert refusal(written(tmp_path, f"{header}\n{row}\n")) == message


def test_a_column_that_a_flag_names_must_be_there(tmp_path: Path) -> None:
    assert refusal(written(tmp_path, QUAT_TABLE), orientation="abb_quat") == (
        "found no column q1, expected q1,q2,q3,q4 for abb_quat: name the columns, as in --orientation NAME:COLUMNS "
        "(found fx, fy, fz, tx, ty, tz, qx, qy, qz, qw)"
    )


def test_an_unknown_orientation_is_refused_with_the_known_ones(tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        cw.read(written(tmp_path, QUAT_TABLE), orientation="abb")
    assert str(caught.value) == (
        "orientation 'abb' is not known, expected one of quat_xyzw, quat_wxyz, kuka_abc, fanuc_wpr, yaskawa, staubli, "
        "kawasaki_oat, nachi, ur_rotvec, abb_quat, matrix, franka_matrix, rot6d, rot6d_rows, rpy, euler:ZYX:deg, or "
        "auto"
    )


CORRECT = "expected a number: correct it or leave the row out"


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("1,2,3,4,oops,6,0,0,0,1", f"column ty: found 'oops', {CORRECT}"),
        ("1,2,3,4,5,6,0,0,0,0x1", f"column qw: found '0x1', {CORRECT}"),
        ("1_000,2,3,4,5,6,0,0,0,1", f"column fx: found '1_000', {CORRECT}"),
        (f"1,2,{'z' * 60},4,5,6,0,0,0,1", f"column fz: found '{'z' * 40}', {CORRECT}"),
        ("1,2,NaN,4,5,6,0,0,0,1", "column fz: found NaN, expected a finite number: leave the row out"),
        ("1,2,3,4,5,-inf,0,0,0,1", "column tz: found -inf, expected a finite number: leave the row out"),
        ("1,2,3,4,5,1e999,0,0,0,1", "column tz: found 1e999, expected a finite number: leave the row out"),
        ("1,,3,4,5,6,0,0,0,1", "column fy: found nothing, expected a number: fill it in or leave the row out"),
        ('1,"  ",3,4,5,6,0,0,0,1', "column fy: found nothing, expected a number: fill it in or leave the row out"),
        ('1,"2,5",3,4,5,6,0,0,0,1', "column fy: found the decimal comma '2,5', expected a point: write it so"),
    ],
)
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_cells_that_are_no_number_are_named_by_row_and_column(tmp_path: Path, row: str, message: str, end: str) -> None:
    table = end.join(["# a comment", QUAT_HEADER, GOOD, "", "# another", row, GOOD, ""])
    assert refusal(written(tmp_path, table.encode())) == f"row 6, {message}"


@pytest.mark.parametrize(
    ("row", "found"),
    [
        ("1,2,3", "3 values"),
        (f"{GOOD},7", "11 values"),
        ('"1,2,3,4,5,6,0,0,0,1"', "1 value"),
        (f"{GOOD},7,8,9,10", "14 values"),
    ],
)
def test_ragged_rows_are_named(tmp_path: Path, row: str, found: str) -> None:
    assert refusal(written(tmp_path, f"{QUAT_TABLE}{row}\n")) == (
        f"row 3: found {found}, expected 10 as in the header: complete the row, and write decimals with a point"
    )


def perhaps_decimal_commas(row: int, column: str, found: int, width: int) -> str:
    return (
        f"row {row}, from column {column} on: found {found} values between commas, expected {width} as in the header: "
        "if these are decimal commas, write them as points, or separate the cells by semicolons"
    )


def test_decimal_commas_between_commas_are_named(tmp_path: Path) -> None:
    table = f"{QUAT_TABLE}{GOOD.replace(',', ',0,')},0\n"
    assert refusal(written(tmp_path, table)) == perhaps_decimal_commas(3, "fx", 20, 10)
    table = f'name,{QUAT_HEADER}\n"down",0,0,0,0,0,0,0,0,0,1,5,0,0,0,0,0\n"up",{GOOD}\n'
    assert refusal(written(tmp_path, table)) == perhaps_decimal_commas(2, "name", 17, 11)


IN_COMMA_FILE = "in a file with decimal commas, expected one mark: write it so"
SET_APART = "expected digits and one decimal mark: write it so"


@pytest.mark.parametrize(
    ("other", "cell", "message"),
    [
        ("1,5", "2.5", f"found the decimal point '2.5' {IN_COMMA_FILE}"),
        ("1,5", "1.234", f"found the decimal point '1.234' {IN_COMMA_FILE}"),
        ("1,5", "1.234,5", f"found thousands set apart in '1.234,5', {SET_APART}"),
        ("1,5", "1,234,567", f"found thousands set apart in '1,234,567', {SET_APART}"),
        ("1,5", "1 234,5", f"found thousands set apart in '1 234,5', {SET_APART}"),
        ("1.5", "1,234.5", f"found thousands set apart in '1,234.5', {SET_APART}"),
        ("1.5", "12'345", f'found thousands set apart in "12\'345", {SET_APART}'),
        ("1.5", "2,345", "found '2,345', which may be a decimal comma or thousands, expected a point: write it so"),
        ("1,5", "1,5,5", f"found '1,5,5', {CORRECT}"),
        ("1,5", "", "found nothing, expected a number: fill it in or leave the row out"),
    ],
)
@pytest.mark.parametrize("separator", [";", "\t"])
def test_one_decimal_mark_and_no_thousands(tmp_path: Path, other: str, cell: str, message: str, separator: str) -> None:
    rows = [QUAT_HEADER.split(","), [other, *GOOD.split(",")[1:]], ["1", "2", cell, *GOOD.split(",")[3:]]]
    table = "\n".join(separator.join(row) for row in rows)
    assert refusal(written(tmp_path, table)) == f"row 3, column fz: {message}"


def test_what_could_be_thousands_throughout_is_no_decimal_comma(tmp_path: Path) -> None:
    table = f"{QUAT_HEADER}\n{GOOD}".replace(",", ";").replace("\n1;", "\n12,345;")
    assert refusal(written(tmp_path, table)) == (
        "row 2, column fx: found '12,345', which may be a decimal comma or thousands, expected a point: write it so"
    )


@pytest.mark.parametrize(
    "comment",
    ["fx fy fz tx ty tz qx qy qz", QUAT_HEADER, "", "10 readings of 2024-05-01 at 10 Hz, free and still", GOOD],
)
def test_a_comment_that_does_not_name_each_column_is_no_header(tmp_path: Path, comment: str) -> None:
    table = f"# {comment}\n{GOOD.replace(',', ' ')}\n"
    assert refusal(written(tmp_path, table)) == f"row 2: {NO_HEADER}"


def test_a_second_row_that_is_not_units_throughout_is_named(tmp_path: Path) -> None:
    units = "N,N,N,Nm,Nm,Nm,-,-,-,measured"
    assert refusal(written(tmp_path, f"{QUAT_HEADER}\n{units}\n{GOOD}\n")) == f"row 2, column fx: found 'N', {CORRECT}"


@pytest.mark.parametrize("quote", ["", '"'])
def test_a_cell_of_enormous_length_is_refused(tmp_path: Path, quote: str) -> None:
    cell = quote + "y" * 200_000 + quote
    assert refusal(written(tmp_path, f"{QUAT_TABLE}{cell},2,3,4,5,6,0,0,0,1\n")).startswith("row 3")
    assert refusal(written(tmp_path, f"{cell},{QUAT_HEADER}\n1,{GOOD}\n")) == (
        "row 1: found what is no CSV (field larger than field limit (131072)), expected cells of names and numbers: "
        "correct it"
    )


@pytest.mark.parametrize(
    ("orientation", "message"),
    [
        ("0,0,0,0", f"found a quaternion of length 0, {CUT_OFF}"),
        ("0,0,0,1.02", f"found a quaternion of length 1.02, {CUT_OFF}"),
        ("0.6,0,0,0.7", f"found a quaternion of length 0.921954, {CUT_OFF}"),
        ("1e200,1e200,0,0", f"found a quaternion of length inf, {CUT_OFF}"),
    ],
)
def test_quaternions_off_unit_length(tmp_path: Path, orientation: str, message: str) -> None:
    table = f"# first\n{QUAT_TABLE}\n1,2,3,4,5,6,{orientation}\n{GOOD}\n"
    assert refusal(written(tmp_path, table)) == f"row 5, columns qx,qy,qz,qw: {message}"


@pytest.mark.parametrize(
    ("matrix", "found"),
    [
        ("1,0,0,0,1,0,0,0,-1", "(columns off orthonormal by 0, determinant -1)"),
        ("1,0,0,0,1,0,1,0,0", "(columns off orthonormal by 1, determinant 0)"),
        ("1,2,3,4,5,6,7,8,9", "(columns off orthonormal by 125, determinant 0)"),
    ],
)
def test_matrices_that_are_no_rotation(tmp_path: Path, matrix: str, found: str) -> None:
    table = f"{MATRIX_HEADER}\n1,2,3,4,5,6,1,0,0,0,1,0,0,0,1\n1,2,3,4,5,6,{matrix}\n"
    assert refusal(written(tmp_path, table)) == (
        f"row 3, columns {','.join(MATRIX)}: found a matrix that is no rotation {found}, {ORTHONORMAL}"
    )


def test_angles_in_degrees_are_not_read_as_a_rotation_vector_in_radians(tmp_path: Path) -> None:
    table = "fx,fy,fz,tx,ty,tz,rx,ry,rz\n1,2,3,4,5,6,0,0,0\n1,2,3,4,5,6,0,90,0\n"
    assert refusal(written(tmp_path, table)) == (
        "row 3, columns rx,ry,rz: found a rotation vector of 90 rad, expected at most a whole turn: if these are "
        "angles in degrees, say whose (--orientation yaskawa or staubli; contactwrench diagnose tells)"
    )


def test_a_negative_load_is_named_in_the_unit_of_its_column(tmp_path: Path) -> None:
    table = f"{QUAT_HEADER},load_g\n{GOOD},0\n# hung\n{GOOD},-250\n"
    assert refusal(written(tmp_path, table)) == (
        "row 4, column load_g: found -250, expected 0 or 0.001 to 1e+09 g: correct it or leave the row out"
    )


@pytest.mark.parametrize("reading", ["-1e308", "2e12"])
def test_a_reading_that_no_sensor_gives_is_named(tmp_path: Path, reading: str) -> None:
    table = f"{QUAT_HEADER.replace('ty', 'ty_nmm')}\n{GOOD}\n1,2,3,4,{reading},6,0,0,0,1\n"
    assert refusal(written(tmp_path, table)) == (
        f"row 3, column ty_nmm: found {float(reading):g}, expected at most 1e+09 N or N m: correct it or leave the row "
        "out"
    )


@pytest.mark.parametrize("suffix", [".xls", ".XLSX"])
def test_formats_that_cannot_be_read_are_refused_by_their_suffix(tmp_path: Path, suffix: str) -> None:
    assert refusal(written(tmp_path, QUAT_TABLE, f"log{suffix}")) == (
        f"found the suffix {suffix.lower()}, expected .csv, .parquet, .h5, .bag, .db3 or .mcap: export the recording "
        "as one of them"
    )


def test_a_directory_and_a_missing_file(tmp_path: Path) -> None:
    with pytest.raises(FileAccessError) as caught:
        cw.read(tmp_path)
    assert str(caught.value) == f"{tmp_path}: found a directory, expected a file: name the file in it"
    with pytest.raises(FileAccessError) as caught:
        cw.read(tmp_path / "gone.csv")
    assert str(caught.value) == (
        f"{tmp_path / 'gone.csv'}: there is no such file, expected a readable file: check the path"
    )


def test_a_file_without_permission_to_read(tmp_path: Path) -> None:
    path = written(tmp_path, QUAT_TABLE)
    path.chmod(0)
    if os.access(path, os.R_OK):
        pytest.skip("this user may read every file")
    with pytest.raises(FileAccessError) as caught:
        cw.read(path)
    assert str(caught.value) == f"{path}: cannot be read (permission denied): check the path and its permissions"
