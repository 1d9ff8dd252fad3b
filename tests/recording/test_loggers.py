"""What programs of laboratories write above their numbers: LabVIEW's .lvm (ni.com/tutorial/4139), ATI's Net F/T demo, a
Japanese data logger, TwinCAT's scope (infosys.beckhoff.com, te13xx): read, or refused by what is to be mended.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.recording.test_columns_by_number import POSES, ROWS, assert_read, read, refusal
from tests.support.recordings import written

NAMES = ("Fx", "Fy", "Fz", "Mx", "My", "Mz", "qx", "qy", "qz", "qw")
BY_ORDER = {"orientation": "auto"}


def lines(separator: str, before: str = "", after: str = "") -> str:
    rows = (separator.join(f"{value:.9f}" for value in row) for row in ROWS)
    return "".join(f"{before.format(k)}{row}{after}\n" for k, row in enumerate(rows))


def labview(units: str, numbers: str, ends: str = "") -> str:
    said = {
        "Samples": "17",
        "Date": "2024/01/01",
        "Time": "12:30:01.5",
        "Y_Unit_Label": units,
        "X_Dimension": "Time",
        "X0": "0.0000000000000000E+0",
        "Delta_X": "0.010000",
    }
    segment = "".join("\t".join([key, *[value] * 10]) + ends + "\n" for key, value in said.items())
    header = "\t".join(("X_Value", *NAMES, "Comment"))
    return (
        "LabVIEW Measurement\t\nWriter_Version\t2\nSeparator\tTab\nX_Columns\tOne\nTime\t12:30:01.5\n"
        f"***End_of_Header***\t\n\t\nChannels\t10{ends}\n{segment}***End_of_Header***{ends}\n{header}\n{numbers}"
    )


@pytest.mark.parametrize("after", ["", "\t"])
@pytest.mark.parametrize("ends", ["", "\t", "\t\t"])
def test_labview_names_a_comment_that_rows_may_not_have(tmp_path: Path, after: str, ends: str) -> None:
    """The rows Samples, X0 and Delta_X of its own head were taken for the first numbers."""
    content = labview("N", lines("\t", "0.0{}\t", after), ends)
    assert_read(written(tmp_path, content, "run.lvm"), **BY_ORDER)
    timed = read(written(tmp_path, content), **BY_ORDER, time_column="X_Value:ms")
    assert timed.t is not None
    assert timed.t[3] == pytest.approx(3e-5)
    comma = labview("N", lines("\t", "0.0{}\t", after), ends).replace(".", ",")
    assert_read(written(tmp_path, comma), **BY_ORDER)


@pytest.mark.parametrize(("units", "found"), [("lbf", "lbf"), ("Volts", "'Y_Unit_Label")])
def test_labview_units_are_not_passed_over(tmp_path: Path, units: str, found: str) -> None:
    path = written(tmp_path, labview(units, lines("\t", "0.0{}\t")), "run.lvm")
    assert refusal(path, **BY_ORDER).startswith(f"row 12: found {found}")


NET_FT = "Status (hex), RDT Sequence, F/T Sequence, Fx, Fy, Fz, Tx, Ty, Tz, qx, qy, qz, qw"
BESIDE = (
    "above the header, expected units beside the names, as in fx [N], tx [Nm]: write them there, and # before that row"
)


def test_units_of_ati_are_read_and_its_counts_refused(tmp_path: Path) -> None:
    """`Torque Units: Nm` was refused, and counts per newton were read as newtons where N stood beside them."""
    numbers = lines(", ", "0x00000000, {0}, {0}, ")
    head = f"Start Time: 1/1/24 12:30 PM\nForce Units: N\nTorque Units: Nm\n{NET_FT}\n"
    assert_read(written(tmp_path, head + numbers), **BY_ORDER)
    counts = "Force Units: N, Torque Units: Nm, Counts per Unit Force: 1000000"
    path = written(tmp_path, f"{counts}\n{NET_FT}\n{numbers}")
    assert refusal(path, **BY_ORDER) == f"row 1: found {counts[:40]!r} {BESIDE}"
    for remark in ("Force Units: daN, Torque Units: Nm", "Torque Units: talents"):
        path = written(tmp_path, f"Log 1\n{remark}\n{NET_FT}\n{numbers}")
        assert refusal(path, **BY_ORDER) == f"row 2: found {remark[:40]!r} {BESIDE}"


@pytest.mark.parametrize("code", ["cp932", "utf-8"])
def test_a_japanese_logger_with_a_row_of_units(tmp_path: Path, code: str) -> None:
    channels = ",".join(f"CH{k}" for k in range(1, 11))
    by_channel = {"wrench_columns": "CH1,CH2,CH3,CH4,CH5,CH6", "orientation": "quat_xyzw:CH7,CH8,CH9,CH10"}
    head = f"機種名,NR-X100\nサンプリング周期,10ms\n日時,{channels}\n"
    numbers = lines(",", "2024/01/01 12:30:00.{},")
    in_n = written(tmp_path, f"{head},N,N,N,N・m,N・m,N・m,,,,\n{numbers}".encode(code))
    in_kgf = written(tmp_path, f"{head},kgf,kgf,kgf,kgf・cm,kgf・cm,kgf・cm,,,,\n{numbers}".encode(code), "kgf.csv")
    if code == "utf-8":
        assert_read(in_n, **by_channel)
        assert read(in_kgf, **by_channel).wrench[:, 3:] == pytest.approx(0.0980665 * POSES.wrench[:, 3:], abs=1e-9)
    else:  # the dot is no UTF-8
        for path in (in_n, in_kgf):
            assert refusal(path, **by_channel).startswith("column CH4 [no UTF-8]: found a name that is no UTF-8")
        assert_read(in_n, **by_channel, units="torque=Nm")


def test_what_twincat_says_of_its_channels_is_refused_by_its_row(tmp_path: Path) -> None:
    own = "\t".join(f"Name\t{name}" for name in NAMES)
    pairs = written(tmp_path, f"Name\tScope01\n\n{own}\n\n{lines(chr(9), '{}' + chr(9))}")
    assert refusal(pairs, **BY_ORDER).startswith("found no column fx")
    one = f"Name\tScope01\nName\t{chr(9).join(NAMES)}\nNetId\t{chr(9).join(['172.16.8.205'] * 10)}\n"
    path = written(tmp_path, one + lines("\t", "{}\t"))
    assert refusal(path, **BY_ORDER).startswith("row 3, column Fx: found '172.16.8.205', expected a number")


@pytest.mark.parametrize("end", ["1.5,2.5,3.5", "1,2,3,4,5,6.5,7", "End of file"])
@pytest.mark.parametrize("rows", [1, 2, 3])
def test_few_rows_below_remarks_have_their_header_whatever_ends_them(tmp_path: Path, rows: int, end: str) -> None:
    """The remark was taken for the header, and its words were complained about."""
    numbers = "".join(lines(",").splitlines(keepends=True)[:rows])
    path = written(tmp_path, f"Logger 3\nCell B\n{','.join(NAMES)}\n{numbers}{end}\n")
    found = f"row {rows + 4}: found {end.count(',') + 1} value"
    assert refusal(path, **BY_ORDER).startswith(found)
