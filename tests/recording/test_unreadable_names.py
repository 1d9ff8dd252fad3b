"""Headers in a code that is not known: columns that nobody could type are told by number, and no unit is missed; signs
of full width, as Japanese and Chinese keyboards give them, are those of ASCII.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from contactwrench.errors import ContactWrenchError
from contactwrench.recording.tables.text_cells import named_or_numbered, of_unknown_code
from tests.recording.test_columns_by_number import BY_NUMBER, POSES, assert_read, read, refusal, text
from tests.support.recordings import run, written

KGF = 9.80665
CODES = pytest.mark.parametrize("code", ["cp932", "gb18030", "big5", "cp949"])
FORCES, TORQUES, QUATERNION = ("力X", "力Y", "力Z"), ("力偶X", "力偶Y", "力偶Z"), ("角x", "角y", "角z", "角w")
UNKNOWN = (
    "found a name that is no UTF-8 and may state a unit, expected to know it: say --units force=UNIT, or save the file"
)


def table(force: str = "", torque: str = "", below: str = "") -> str:
    names = [*(name + force for name in FORCES), *(name + torque for name in TORQUES), *QUATERNION]
    return f"{','.join(names)}\n{below}{text()}"


@CODES
def test_columns_are_told_by_number_and_their_units_read_or_asked_for(tmp_path: Path, code: str) -> None:
    assert_read(written(tmp_path, table("(N)", "(N m)").encode(code)))
    pounds = read(written(tmp_path, table("[lbf]", "[Nm]").encode(code)), **BY_NUMBER)
    assert pounds.wrench[:, :3] == pytest.approx(4.4482216152605 * POSES.wrench[:, :3], rel=1e-7)
    for force, torque in (("", ""), ("（kgf）", "（kgf）"), ("〔kgf〕", "〔kgf〕")):
        path = written(tmp_path, table(force, torque).encode(code))
        assert refusal(path) == f"column 1 [no UTF-8]: {UNKNOWN} as UTF-8"
        kgf = read(path, **BY_NUMBER, units="force=kgf,torque=Nm")
        assert kgf.wrench[:, :3] == pytest.approx(KGF * POSES.wrench[:, :3], rel=1e-7)


@CODES
def test_a_row_of_units_below_such_names_is_read(tmp_path: Path, code: str) -> None:
    path = written(tmp_path, table(below="kgf,kgf,kgf,kgf cm,kgf cm,kgf cm,,,,\n").encode(code))
    assert read(path, **BY_NUMBER).wrench[:, :3] == pytest.approx(KGF * POSES.wrench[:, :3], rel=1e-7)


@CODES
def test_names_that_are_known_are_read_beside_them(tmp_path: Path, code: str) -> None:
    lines = [f"{line}{'' if k else ',備'}" for k, line in enumerate(text().splitlines())]
    header = "Fx,Fy,Fz,Mx,My,Mz,qx,qy,qz,qw,角"
    content = "\n".join([header, *(f"{line.removesuffix(',備')},1" for line in lines)])
    assert "numbered" not in assert_read(written(tmp_path, content.encode(code)), orientation="auto").read_as


@pytest.mark.parametrize("code", ["cp932", "gb18030", "utf-8"])
def test_a_unit_in_a_remark_above_is_refused(tmp_path: Path, code: str) -> None:
    for remark in ("単位：kgf", "力 kgf"):
        content = f"{remark}\nFx,Fy,Fz,Mx,My,Mz,qx,qy,qz,qw\n{text()}"
        assert refusal(written(tmp_path, content.encode(code)), orientation="auto").startswith(
            "row 1: found kgf above the header"
        )


def test_what_windows_1252_and_utf_8_write_stays_a_name() -> None:
    western = ("Kräfte_x", "Größe Y", "Mx [N·m]", "Roll (°)", "Über", "force mesurée", "Nº", "Qualität (±)")
    assert named_or_numbered([of_unknown_code(name.encode("cp1252")) for name in western]) == list(western)
    every = (*FORCES, "Сила X", "힘X", "トルク（N・m）", "Τροχός", "Síla")
    assert named_or_numbered(every) == list(every)
    mixed = ("Fx", "Сила Y (N)", "С")
    assert named_or_numbered([of_unknown_code(name.encode("cp1251")) for name in mixed]) == [
        "Fx",
        "2 [N]",
        "3 [no UTF-8]",
    ]


@pytest.mark.parametrize("sign", ["Last ½", "1ª", "„Wert“", "‰", "© Labor", "Ñèëà"])
def test_signs_in_utf_8_are_what_was_written(tmp_path: Path, sign: str) -> None:
    """The name became a number, and so did each beside it that is not ASCII."""
    head = f"Kräfte_x,Fy,Fz,Mx,My,Mz,qx,qy,qz,qw,{sign}\n"
    content = head + "".join(f"{line},1\n" for line in text().splitlines())
    columns = {"wrench_columns": "Kräfte_x,Fy,Fz,Mx,My,Mz", "orientation": "auto"}
    assert_read(written(tmp_path, content), **columns)
    units = content.replace(sign, "v").replace("\n", f"\nN,N,N,Nm,Nm,Nm,-,-,-,-,{sign}\n", 1)
    path = written(tmp_path, units)
    if sign == "‰":
        assert_read(path, **columns)
    else:
        assert refusal(path, **columns).startswith("row 2, column Kräfte_x: found 'N'")


@pytest.mark.parametrize("unit", ["（kgf）", "［kgf］", "【kgf】", "〔kgf〕", "(ｋｇｆ)"])
def test_signs_of_full_width_are_read(tmp_path: Path, unit: str) -> None:
    """`力X（kgf）` was read as N."""
    names = {"wrench_columns": ",".join(name + unit for name in FORCES) + ",Mx,My,Mz", "units": "torque=Nm"}
    header = f"{names['wrench_columns']},qx,qy,qz,qw"
    found = read(written(tmp_path, f"{header}\n{text()}"), **names)
    assert found.wrench[:, :3] == pytest.approx(KGF * POSES.wrench[:, :3], rel=1e-7)
    usual = f"Fx{unit},Fy{unit},Fz{unit},Mx（N・m）,My（N･m）,Mz【N·m】,qx,qy,qz,qw"
    assert read(written(tmp_path, f"{usual}\n{text()}")).wrench == pytest.approx(found.wrench)


def test_info_lists_them_and_a_time_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = written(tmp_path, f"時間,{table('(N)', '(Nm)')}".replace("\n", "\n1,", 1).encode("cp932"))
    said = run(capsys, "info", path).out
    assert "  1 [no UTF-8], 2 [N], 3 [N], 4 [N], 5 [Nm]" in said
    lines = [f"{k},{line}" for k, line in enumerate(text().splitlines())]
    head = table("(N)", "(Nm)").partition("\n")[0]
    timed = written(tmp_path, "\n".join([f"時間,{head}", *lines]).encode("cp932"))
    columns = {"wrench_columns": "2,3,4,5,6,7", "orientation": "quat_xyzw:8,9,10,11"}
    assert assert_read(timed, **columns, time_column="1:ms").t == pytest.approx([1e-3 * k for k in range(len(lines))])
    with pytest.raises(
        ContactWrenchError, match="column 1 \\[no UTF-8\\]: found a name that is no UTF-8 and may state"
    ):
        read(timed, **columns, time_column="1")
