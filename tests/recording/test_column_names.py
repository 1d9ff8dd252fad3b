"""Names of columns as people write them, and the options for the rest: known answers and every refusal."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import contactwrench as cw
from contactwrench.errors import ContactWrenchError, FileFormatError
from contactwrench.recording.options import Options
from contactwrench.recording.read import read_streams
from contactwrench.recording.tables.columns import Naming
from contactwrench.recording.tables.roles import roles_of
from contactwrench.recording.tables.table import open_table
from tests.support.recordings import PANDA, run, written

Q = "qx,qy,qz,qw"
WRENCH = "fx,fy,fz,tx,ty,tz"
LBF = 4.4482216152605


def table(folder: Path, header: str, row: str | None = None) -> Path:
    """A file of one row, by default 1, 2, 3, ... and for the last four columns a quaternion."""
    count = header.count(",") + 1
    return written(folder, f"{header}\n{row or ','.join(map(str, [*range(1, count - 3), 0, 0, 0, 1]))}\n")


def understood(folder: Path, header: str, **stated: Any) -> str:
    return roles_of(open_table(table(folder, header)), Naming(**stated)).understood


def refusal(folder: Path, header: str, row: str | None = None, **stated: Any) -> str:
    path = table(folder, header, row)
    with pytest.raises(ContactWrenchError) as caught:
        cw.read(path, **stated)
    assert "\n" not in str(caught.value)
    return str(caught.value).removeprefix(f"{path}: ")


SPELLINGS = [
    "Fx,Fy,Fz,Tx,Ty,Tz",
    "FX,FY,FZ,TX,TY,TZ",
    "fx_n,fy_n,fz_n,tx_nm,ty_nm,tz_nm",
    "force_x,force_y,force_z,torque_x,torque_y,torque_z",
    "Force X (N),Force Y (N),Force Z (N),Torque X (Nm),Torque Y (Nm),Torque Z (Nm)",
    "F_x [N],F_y [N],F_z [N],T_x [N m],T_y [N·m],T_z [N*m]",
    "wrench.force.x,wrench.force.y,wrench.force.z,wrench.torque.x,wrench.torque.y,wrench.torque.z",
    "/wrench/force/x,/wrench/force/y,/wrench/force/z,/wrench/torque/x,/wrench/torque/y,/wrench/torque/z",
    "/my_ft/wrench/force/x,/my_ft/wrench/force/y,/my_ft/wrench/force/z,"
    "/my_ft/wrench/torque/x,/my_ft/wrench/torque/y,/my_ft/wrench/torque/z",
    "wrench_force_x,wrench_force_y,wrench_force_z,wrench_torque_x,wrench_torque_y,wrench_torque_z",
    "wrenchForceX,wrenchForceY,wrenchForceZ,wrenchTorqueX,wrenchTorqueY,wrenchTorqueZ",
    "fx,fy,fz,mx,my,mz",
    "FTC.Fx,FTC.Fy,FTC.Fz,FTC.Mx,FTC.My,FTC.Mz",
    "Fx,Fy,Fz,Mx,My,Mz",
    "x_force,y_force,z_force,moment_x,moment_y,moment_z",
    "Fx / N,Fy / N,Fz / N,Mx / Nm,My / Nm,Mz / Nm",
    "Kraft X in N,Kraft Y in N,Kraft Z in N,Drehmoment X in Nm,Drehmoment Y in Nm,Drehmoment Z in Nm",
    "F_x,F_y,F_z,τx (N·m),τy (N·m),τz (N·m)",
    "force[0],force[1],force[2],torque[0],torque[1],torque[2]",
    "observation.wrench[0],observation.wrench[1],observation.wrench[2],"
    "observation.wrench[3],observation.wrench[4],observation.wrench[5]",
    "ft_1,ft_2,ft_3,ft_4,ft_5,ft_6",
]


@pytest.mark.parametrize("names", SPELLINGS)
def test_a_wrench_as_people_write_it(tmp_path: Path, names: str) -> None:
    samples = cw.read(table(tmp_path, f"{names},{Q}"))
    assert samples.wrench.tolist() == [[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]]


@pytest.mark.parametrize(
    ("unit", "newton"),
    [("N", 1.0), ("kN", 1e3), ("mN", 1e-3), ("kgf", 9.80665), ("lbf", LBF), ("lb", LBF), ("gf", 9.80665e-3)],
)
@pytest.mark.parametrize("form", ["F{} ({})", "F{} [{}]", "force_{}_{}", "F{}/{}", "Force {} in {}"])
def test_units_of_force(tmp_path: Path, unit: str, newton: float, form: str) -> None:
    force = ",".join(form.format(axis, unit) for axis in "xyz")
    samples = cw.read(table(tmp_path, f"{force},Tx (Nm),Ty (Nm),Tz (Nm),{Q}"))
    assert samples.wrench[0] == pytest.approx([newton, 2 * newton, 3 * newton, 4, 5, 6], rel=1e-14)


@pytest.mark.parametrize(
    ("unit", "newton_metre"),
    [
        ("Nm", 1.0),
        ("N m", 1.0),
        ("N.m", 1.0),
        ("N-m", 1.0),
        ("Nmm", 1e-3),
        ("N mm", 1e-3),
        ("N cm", 1e-2),
        ("mNm", 1e-3),
        ("kgf cm", 9.80665e-2),
        ("lbf in", LBF * 0.0254),
        ("lbf-in", LBF * 0.0254),
        ("in-lb", LBF * 0.0254),
        ("ft-lbf", LBF * 0.3048),
    ],
)
def test_units_of_torque(tmp_path: Path, unit: str, newton_metre: float) -> None:
    torque = ",".join(f"M{axis} [{unit}]" for axis in "xyz")
    samples = cw.read(table(tmp_path, f"Fx [N],Fy [N],Fz [N],{torque},{Q}"))
    assert samples.wrench[0] == pytest.approx([1, 2, 3, *(newton_metre * np.array([4, 5, 6]))], rel=1e-14)


@pytest.mark.parametrize(
    ("name", "seconds"),
    [
        ("time", 7.0),
        ("timestamp", 7.0),
        ("t_sec", 7.0),
        ("Time [s]", 7.0),
        ("Time (ms)", 7e-3),
        ("elapsed time", 7.0),
        ("elapsed_us", 7e-6),
        ("Time [µs]", 7e-6),
        ("timestamp_ns", 7e-9),
        ("header.stamp", 7.0),
        ("field.header.stamp", 7e-9),
        ("%time", 7e-9),
        ("IPOC", 7e-3),
        ("Zeit / ms", 7e-3),
        ("sim_time", 7.0),
        ("%time,sim_time", 7e-9),
        ("recv_time_ms,seq,timestamp", 9.0),
        ("sample_time", None),
    ],
)
def test_times_as_people_write_them(tmp_path: Path, name: str, seconds: float | None) -> None:
    t = cw.read(table(tmp_path, f"{WRENCH},{name},{Q}")).t
    assert (t is None) == (seconds is None)
    assert t is None or t[0] == pytest.approx(seconds, rel=1e-14)


@pytest.mark.parametrize("names", ["sec,nanosec", "header.stamp.secs,header.stamp.nsecs", "t_sec,t_nsec"])
def test_a_stamp_in_two_columns(tmp_path: Path, names: str) -> None:
    path = table(tmp_path, f"{names},{WRENCH},{Q}", "1700000007,250000000,1,2,3,4,5,6,0,0,0,1")
    first, second = names.split(",")
    for column in (None, first):
        assert cw.read(path, time_column=column).t == pytest.approx([1700000007.25], abs=1e-6)
    assert refusal(tmp_path, f"{names},{WRENCH},{Q}", "7,1000000000,1,2,3,4,5,6,0,0,0,1") == (
        f"row 2, column {second}: found 1e+09, expected nanoseconds of 0 to 1e9: correct it or leave the row out"
    )


@pytest.mark.parametrize(
    ("names", "turned"),
    [
        ("roll,pitch,yaw", 1.0),
        ("Roll (deg),Pitch (deg),Yaw (deg)", 1.0),
        ("Roll [°],Pitch [°],Yaw [°]", 1.0),
        ("rpy_0,rpy_1,rpy_2", 1.0),
        ("roll_rad,pitch_rad,yaw_rad", 180.0 / np.pi),
    ],
)
def test_roll_pitch_yaw_are_told_by_their_names(tmp_path: Path, names: str, turned: float) -> None:
    row = "1,2,3,4,5,6,0.1,0.2,0.3"
    found = cw.read(table(tmp_path, f"{WRENCH},{names}", row)).R_base_flange
    expected = cw.read(table(tmp_path, f"{WRENCH},u,v,w2", row), orientation="euler:xyz:deg:u,v,w2").R_base_flange
    if turned != 1.0:
        expected = cw.read(table(tmp_path, f"{WRENCH},u,v,w2", row), orientation="euler:xyz:rad:u,v,w2").R_base_flange
    assert found == pytest.approx(expected, abs=1e-14)


def test_what_was_understood_is_one_line_and_nothing_of_usual_names(tmp_path: Path) -> None:
    assert understood(tmp_path, f"t_ms,{WRENCH.upper()},x_mm,y_mm,z_mm,{Q}") == ""
    header = "Time (ms),Force X (N),Force Y (N),Force Z (N),Mx [Nmm],My [Nmm],Mz [Nmm],"
    quaternion = ",".join(f"current_orientation_{axis}" for axis in "xyzw")
    assert understood(tmp_path, header + quaternion) == (
        'fx..fz from "Force X (N)".."Force Z (N)", tx..tz from "Mx [Nmm]".."Mz [Nmm]" in N mm, qx..qw from '
        '"current_orientation_x".."current_orientation_w", t from "Time (ms)" in ms'
    )
    assert understood(
        tmp_path, f"Fx (kN),Fy (N),Fz (N),tx,ty,tz,{Q}".replace("tx,ty,tz", "Tx (Nm),Ty (Nm),Tz (Nm)")
    ) == ('fx from "Fx (kN)" in kN, fy from "Fy (N)", fz from "Fz (N)", tx..tz from "Tx (Nm)".."Tz (Nm)"')
    assert understood(tmp_path, f"{WRENCH},{Q}", units="force=kgf,torque=Nm") == (
        'fx..fz from "fx".."fz" in kgf, tx..tz from "tx".."tz"'
    )


def test_usual_names_come_before_others(tmp_path: Path) -> None:
    header = f"t,timestamp,{WRENCH},force_x,force_y,force_z,mx,my,mz,roll,pitch,yaw,{Q}"
    samples = cw.read(table(tmp_path, header))
    assert samples.wrench.tolist() == [[3.0, 4.0, 5.0, 6.0, 7.0, 8.0]]
    assert samples.t == [1.0]
    assert samples.R_base_flange[0].tolist() == np.eye(3).tolist()


WORDS = "force_x,force_y,force_z,torque_x,torque_y,torque_z"
UNDECIDED = [
    (
        f"Fx,Fy,Fz,force_x,force_y,force_z,Mx,My,Mz,{Q}",
        'found "Fx" and "force_x" for fx, expected one: choose with --wrench-columns Fx,Fy,Fz,Mx,My,Mz',
    ),
    (
        f"sensor1_fx,sensor1_fy,sensor1_fz,sensor1_tx,sensor1_ty,sensor1_tz,sensor2_fx,{Q}",
        'found "sensor1_fx" and "sensor2_fx" for fx, expected one: choose with --wrench-columns '
        "sensor1_fx,sensor1_fy,sensor1_fz,sensor1_tx,sensor1_ty,sensor1_tz",
    ),
    (f"{WORDS},time,timestamp,{Q}", 'found "time" and "timestamp" for t, expected one: choose with --time-column time'),
    (
        f"{WORDS},pose.orientation.x,pose.orientation.y,pose.orientation.z,pose.orientation.w,quat_x",
        'found "pose.orientation.x" and "quat_x" for qx, expected one: choose with --orientation '
        "quat_xyzw:pose.orientation.x,pose.orientation.y,pose.orientation.z,pose.orientation.w",
    ),
    (
        f"{WORDS},P,W (deg),P (deg),R (deg)",
        'found "P" and "P (deg)" for p, expected one: choose with --orientation fanuc_wpr:\'W (deg),P (deg),R (deg)\'',
    ),
    (
        f"{WORDS},r,p,y",
        "found no orientation columns, expected usual names, as qx qy qz qw: rename them, or --orientation rpy:r,p,y "
        "or nachi:r,p,y, or --wrench W.csv --pose P.csv (found force_x, force_y, force_z, torque_x, torque_y, "
        "torque_z, r, p, y)",
    ),
    (
        f"{WORDS},O,A,T",
        "found no orientation columns, expected usual names, as qx qy qz qw: rename them, or --orientation "
        "kawasaki_oat:O,A,T, or --wrench W.csv --pose P.csv (found force_x, force_y, force_z, torque_x, torque_y, "
        "torque_z, O, A, T)",
    ),
    (f"{WORDS},time,T,{Q}", 'found "time" and "T" for t, expected one: choose with --time-column time'),
    (
        f"{WORDS},roll,pitch,yaw,quat_x,quat_y,quat_z,quat_w",
        "found the columns of quat_xyzw and of rpy, expected one orientation: choose with --orientation quat_xyzw",
    ),
    (
        f"force_x,force_y,force_z,tx,ty,tz,{Q}",
        'found "tx" and "ty" and "tz", a torque or something else by their names, expected one that their unit tells, '
        "or fx fy fz beside them: if they are the torque say --wrench-columns force_x,force_y,force_z,tx,ty,tz",
    ),
    (
        f"Fx,Fy,Fz,Mx,My,Mz,ax,ay,az,{Q}",
        'found "Mx" and "My" and "Mz", a torque or something else by their names, expected one that their unit tells, '
        "or fx fy fz beside them: if they are the torque say --wrench-columns Fx,Fy,Fz,Mx,My,Mz",
    ),
    (
        f"{WORDS},Rx (deg),Ry (deg),Rz (deg)",
        'found "Rx (deg)" and "Ry (deg)" and "Rz (deg)" in degrees, expected a rotation vector (UR) in rad: if these '
        "are angles, say whose (--orientation yaskawa or staubli), else --orientation ur_rotvec",
    ),
    (
        f"Fx (counts),Fy (counts),Fz (counts),Tx,Ty,Tz,{Q}",
        "column Fx (counts): found the unit counts, expected one of N, kN, mN, kgf, gf, lbf: convert the column "
        "to one of these, or rename it if counts is no unit",
    ),
    (
        f"Fx (MN),Fy (MN),Fz (MN),Tx,Ty,Tz,{Q}",
        "column Fx (MN): found the unit MN, expected one of N, kN, mN, kgf, gf, lbf: convert the column to one "
        "of these, or rename it if MN is no unit",
    ),
    (
        f"Fx (kN),Fy,Fz,Tx (Nm),Ty (Nm),Tz (Nm),{Q}",
        "column Fx (kN) is in kN and Fy says no unit, expected one for each: state it with --units force=UNIT",
    ),
    (
        f"Fx (lbf),Fy (lbf),Fz (lbf),Tx,Ty,Tz,{Q}",
        "column Fx (lbf) is in lbf and Tx says no unit, expected one for each: state it with --units torque=UNIT",
    ),
    (
        f"Fx,Fy,Fz,Mx (lbf in),My (lbf in),Mz (lbf in),{Q}",
        "column Mx (lbf in) is in lbf in and Fx says no unit, expected one for each: state it with --units force=UNIT",
    ),
    (
        f"Fx,Fy,Fz,Tx (mm),Ty (mm),Tz (mm),{Q}",
        "found no column tx, expected fx fy fz tx ty tz and an orientation: add it, or name the six with "
        "--wrench-columns A,B,C,D,E,F (found Fx, Fy, Fz, Tx (mm), Ty (mm), Tz (mm), qx, qy, qz, qw)",
    ),
    (
        f"tx,ty,tz,{Q},fx,fy,fz,mx,my,mz",
        'found "tx" and "mx" for tx, expected one: choose with --wrench-columns fx,fy,fz,mx,my,mz',
    ),
    *(
        (
            columns,
            'found "tx" and "ty" and "tz", a torque or something else by their names, expected one that their unit '
            "tells, or fx fy fz beside them: if they are the torque say --wrench-columns fx,fy,fz,tx,ty,tz",
        )
        for columns in ("t,tx,ty,tz,a,b,c,fx,fy,fz", f"t,fx,fy,fz,{Q},tx,ty,tz")
    ),
    (
        f"t,tx,ty,tz,{Q},fx,fy,fz,trq_x,trq_y,trq_z",
        'found "tx" and "ty" and "tz", a torque or something else by their names, expected one that their unit tells, '
        "or fx fy fz beside them: if they are the torque say --wrench-columns fx,fy,fz,tx,ty,tz",
    ),
    (
        f"raw_fx,raw_fy,raw_fz,ati_tx,ati_ty,ati_tz,{Q}",
        'found "raw_fx" and "ati_tx", not named alike, expected the columns of one set: if they are, say '
        "--wrench-columns raw_fx,raw_fy,raw_fz,ati_tx,ati_ty,ati_tz",
    ),
    (
        f"{WORDS},roll_rad,pitch,yaw",
        "column roll_rad is in rad and pitch says no unit, expected one for each: state it with --units angle=UNIT",
    ),
    (
        f"{WORDS},Time (min),{Q}",
        "column Time (min): found the unit min, expected one of s, ms, us, ns: convert the column to one of "
        "these, or rename it if min is no unit",
    ),
    (
        f"{WORDS},time,t_sec,t_nsec,{Q}",
        'found "t_sec" and "time" for t, expected one: choose with --time-column t_sec',
    ),
    (
        f"Fx_counts,Fy,Fz,torque_x,torque_y,torque_z,force_x,{Q}",
        'found "force_x" and "Fy", not named alike, expected the columns of one set: if they are, say --wrench-columns '
        "force_x,Fy,Fz,torque_x,torque_y,torque_z",
    ),
    (
        f"{WORDS},rot_x,rot_y,rot_z,qw",
        'found "rot_x" and "qw", not named alike, expected the columns of one set: if they are, say --orientation '
        "quat_xyzw:rot_x,rot_y,rot_z,qw",
    ),
    (f"{WORDS},quat_x,quat_y,quat_z", "found no column qw, expected all of quat_xyzw: add it"),
]


@pytest.mark.parametrize(("header", "message"), UNDECIDED)
def test_what_cannot_be_decided_is_named_with_the_option_that_decides(
    tmp_path: Path, header: str, message: str
) -> None:
    assert refusal(tmp_path, header, ",".join("0" for _ in header.split(","))) == message


@pytest.mark.parametrize("unit", ["daN", "V", "counts"])
def test_a_unit_that_is_not_known_is_not_overruled(tmp_path: Path, unit: str) -> None:
    header = f"Fx [{unit}],Fy [{unit}],Fz [{unit}],Tx,Ty,Tz,{Q}"
    for stated in ({}, {"units": "force=N"}, {"wrench_columns": f"Fx [{unit}],Fy [{unit}],Fz [{unit}],Tx,Ty,Tz"}):
        assert refusal(tmp_path, header, **stated) == (
            f"column Fx [{unit}]: found the unit {unit}, expected one of N, kN, mN, kgf, gf, lbf: convert the column "
            f"to one of these, or rename it if {unit} is no unit"
        )


@pytest.mark.parametrize(
    ("force", "torque"),
    [("ft1.F{}", "ft2.T{}"), ("ft1_force_{}", "ft2_torque_{}"), ("/ft1/wrench/force/{}", "/ft2/wrench/torque/{}")],
)
def test_force_of_one_sensor_and_torque_of_another_are_no_wrench(tmp_path: Path, force: str, torque: str) -> None:
    names = [*map(force.format, "xyz"), *map(torque.format, "xyz")]
    header = ",".join([*names, Q])
    assert refusal(tmp_path, header) == (
        f'found "{names[0]}" and "{names[3]}", not named alike, expected the columns of one set: if they are, say '
        f"--wrench-columns {','.join(names)}"
    )
    samples = cw.read(table(tmp_path, header), wrench_columns=",".join(names))
    assert samples.wrench.tolist() == [[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]]


@pytest.mark.parametrize(
    ("force", "torque"),
    [
        ("force.{}", "torque.{}"),
        ("Kraft {}", "M{} [Nm]"),
        ("F{} [N]", "M{} [Nm]"),
        ("ft1.force.{}", "ft1.moment.{}"),
        ("F{}_raw", "T{}_raw"),
        ("force[{}]", "torque[{}]"),
    ],
)
def test_force_and_torque_of_one_sensor_are_paired(tmp_path: Path, force: str, torque: str) -> None:
    axes = "012" if force == "force[{}]" else "xyz"
    header = ",".join([*map(force.format, axes), *map(torque.format, axes), Q])
    assert cw.read(table(tmp_path, header)).wrench.tolist() == [[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]]


def test_raw_counts_beside_newtons_are_chosen_by_option(tmp_path: Path) -> None:
    newtons = "Fx (N),Fy (N),Fz (N),Tx (Nm),Ty (Nm),Tz (Nm)"
    header = f"Fx (counts),Fy (counts),Fz (counts),{newtons},T (°C),Time (s),{Q}"
    assert refusal(tmp_path, header).startswith('found "Fx (counts)" and "Fx (N)" for fx, expected one: choose with')
    samples = cw.read(table(tmp_path, header), wrench_columns=newtons)
    assert samples.wrench.tolist() == [[4.0, 5.0, 6.0, 7.0, 8.0, 9.0]]
    assert samples.t == [11.0]


@pytest.mark.parametrize(
    "name", ["fx_std", "target_fx", "cmd_fx", "-fx", "fx_error", "joint_force_x", "fx1", "vx (m/s)", "fx/fz", "dfx"]
)
def test_names_that_say_something_else_are_left_alone(tmp_path: Path, name: str) -> None:
    found = refusal(tmp_path, f"{name},Fy,Fz,Mx,My,Mz,{Q}")
    assert found.startswith(
        "found no column fx, expected fx fy fz tx ty tz and an orientation: add it, or name the six"
    )


# The options

A_TO_F = "a,b,c,d,e,f"


@pytest.mark.parametrize(
    ("header", "stated", "wrench"),
    [
        (f"f,e,d,c,b,a,{Q}", {"wrench_columns": A_TO_F}, [6, 5, 4, 3, 2, 1]),
        (
            f"A (kN),B (kN),C (kN),D,E,F,{Q}",
            {"wrench_columns": "a (kn),b (kn),c (kn),d,e,f", "units": "torque=Nm"},
            [1e3, 2e3, 3e3, 4, 5, 6],
        ),
        (f"{A_TO_F},{Q}", {"wrench_columns": A_TO_F, "units": "torque=Nmm"}, [1, 2, 3, 4e-3, 5e-3, 6e-3]),
        (f"Fx,Fy,Fz,Tx,Ty,Tz,{Q}", {"units": "force=kgf,torque=N mm"}, [9.80665, 19.6133, 29.41995, 4e-3, 5e-3, 6e-3]),
        (
            ",".join(f"observation.state[{k}]" for k in range(8)) + f",{Q}",
            {"wrench_columns": "observation.state[2:8]"},
            [3, 4, 5, 6, 7, 8],
        ),
    ],
)
def test_options_name_the_columns_and_their_units(
    tmp_path: Path, header: str, stated: dict[str, Any], wrench: list[float]
) -> None:
    assert cw.read(table(tmp_path, header), **stated).wrench[0] == pytest.approx(wrench, rel=1e-14)


def test_an_orientation_is_named_as_the_file_spells_it(tmp_path: Path) -> None:
    row = "1,2,3,4,5,6,0.1,0.2,0.3"
    expected = cw.read(table(tmp_path, f"{WRENCH},roll,pitch,yaw", row), units="angle=rad").R_base_flange
    for names, orientation in [
        ("Rot 1 [rad],Rot 2 [rad],Rot 3 [rad]", "rpy:Rot 1 [rad],Rot 2 [rad],Rot 3 [rad]"),
        ("Rot 1 [rad],Rot 2 [rad],Rot 3 [rad]", "rpy:rot 1 [RAD],rot 2 [rad],rot 3 [rad]"),
        ("u,v,s", "euler:xyz:rad:u,v,s"),
        ("pose[0],pose[1],pose[2]", "euler:xyz:rad:pose[0:3]"),
    ]:
        found = cw.read(table(tmp_path, f"{WRENCH},{names}", row), orientation=orientation)
        assert found.R_base_flange == pytest.approx(expected, abs=1e-14)


@pytest.mark.parametrize(
    ("name", "stated", "t"),
    [
        ("clock", {"time_column": "clock"}, 7.0),
        ("clock", {"time_column": "CLOCK:ms"}, 7e-3),
        ("clock", {"time_column": "clock", "units": "time=us"}, 7e-6),
        ("clock [ms]", {"time_column": "clock [ms]"}, 7e-3),
        ("a:b", {"time_column": "a:b"}, 7.0),
        ("time", {"units": "time=ms"}, 7e-3),
    ],
)
def test_the_column_of_times_is_named_with_its_unit(
    tmp_path: Path, name: str, stated: dict[str, Any], t: float
) -> None:
    found = cw.read(table(tmp_path, f"{WRENCH},{name},{Q}"), **stated).t
    assert found == pytest.approx([t], rel=1e-14)
    assert cw.read(table(tmp_path, f"{WRENCH},time,{Q}"), time_column="none").t is None


def test_of_two_files_the_columns_of_the_wrench_are_none_of_the_poses(tmp_path: Path) -> None:
    """Both may have columns a, b and c."""
    wrench = written(tmp_path, f"t,{A_TO_F}\n0,1,2,3,4,5,6\n1,2,3,4,5,6,7\n", "wrench.csv")
    poses = written(tmp_path, "t,a,b,c\n0,20,-35,110\n1,20,-35,110\n", "poses.csv")
    found = read_streams(wrench, Options(pose_file=poses, wrench_columns=A_TO_F))
    assert found.wrench.wrench.tolist() == [[1, 2, 3, 4, 5, 6], [2, 3, 4, 5, 6, 7]]
    alone = cw.read(table(tmp_path, f"{WRENCH},a,b,c", "1,2,3,4,5,6,20,-35,110"))
    assert found.orientation.R_base_flange[0] == pytest.approx(alone.R_base_flange[0], abs=1e-15)


REFUSED_OPTIONS: list[tuple[str, dict[str, str], str]] = [
    (
        f"{A_TO_F},{Q}",
        {"wrench_columns": "a,b,c"},
        "--wrench-columns is 'a,b,c', expected six different names A,B,C,D,E,F, or a slice of six such as "
        "observation.wrench[0:6]",
    ),
    (
        f"{A_TO_F},{Q}",
        {"wrench_columns": "a,b,c,d,e,g"},
        "found no column g, expected what --wrench-columns names: name columns of the file (found a, b, c, d, e, f, "
        "qx, qy, qz, qw)",
    ),
    (
        f"{A_TO_F},{Q}",
        {"wrench_columns": "wrench[6:0]"},
        "found no elements wrench[6:0], expected those of a list: name one",
    ),
    (
        f"{WORDS},{Q}",
        {"units": "force=stone"},
        "--units: found force=stone, expected one of N, kN, mN, kgf, gf, lbf",
    ),
    (
        f"{WORDS},{Q}",
        {"units": "mass=kg"},
        "--units is 'mass=kg', expected each of force, torque, angle, time, length once at most, as force=kgf",
    ),
    (
        f"Fx (N),Fy (N),Fz (N),Tx,Ty,Tz,{Q}",
        {"units": "force=kgf"},
        "column Fx (N): found N in its name and --units force=kgf, expected one of them: leave the option out or "
        "correct it",
    ),
    (
        f"Fx [kN],Fy,Fz,Tx,Ty,Tz,{Q}",
        {"wrench_columns": "Fx,Fy,Fz,Tx,Ty,Tz"},
        "column Fx [kN] is in kN and Fy says no unit, expected one for each: state it with --units force=UNIT",
    ),
    (
        f"{A_TO_F},{Q}",
        {"wrench_columns": A_TO_F, "units": "force=kgf"},
        "column a is in kgf and d says no unit, expected one for each: state it with --units torque=UNIT",
    ),
    (
        f"{WORDS},A (rad),B,C",
        {"orientation": "euler:ZYX:deg:A (rad),B,C"},
        "column A (rad) is in rad and B says no unit, expected one for each: state it with --units angle=UNIT",
    ),
    (
        f"{WORDS},Time (ms),{Q}",
        {"time_column": "Time (ms):s"},
        "found --time-column in s, and ms in the column's name or --units, expected one of them: leave one out",
    ),
    (
        f"{WORDS},{Q}",
        {"time_column": "clock"},
        "found no column clock, expected what --time-column names: name a column of the file, or none (found force_x, "
        "force_y, force_z, torque_x, torque_y, torque_z, qx, qy, qz, qw)",
    ),
    (
        f"{WORDS},clock,{Q}",
        {"time_column": "clock:ms", "units": "time=s"},
        "found --time-column in ms, and s in the column's name or --units, expected one of them: leave one out",
    ),
]


@pytest.mark.parametrize(("header", "stated", "message"), REFUSED_OPTIONS)
def test_options_that_cannot_be_are_refused(tmp_path: Path, header: str, stated: dict[str, str], message: str) -> None:
    assert refusal(tmp_path, header, **stated) == message


def test_every_verb_takes_the_options(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = PANDA.read_text(encoding="utf-8").replace("Fx,Fy,Fz,Tx,Ty,Tz", A_TO_F)
    other, tool = written(tmp_path, text, "lab.csv"), tmp_path / "tool.json"
    flags = ("--wrench-columns", A_TO_F)
    assert run(capsys, "calibrate", other).complaint.partition(": ")[2].startswith("found no column fx")
    assert run(capsys, "calibrate", other, *flags, "-o", tool).status == 0
    assert cw.Calibration.load(tool).weight == cw.calibrate(cw.read(PANDA)).weight
    assert run(capsys, "verify", other, "-c", tool, *flags).status == 0
    assert run(capsys, "weigh", other, "-c", tool, *flags).status in (0, 1)
    assert run(capsys, "compensate", other, "-c", tool, "-o", tmp_path / "out.csv", *flags).status == 0
    assert run(capsys, "diagnose", other, *flags).status == 0


def test_bags_have_no_columns() -> None:
    with pytest.raises(ContactWrenchError, match="found a bag, and units force=kgf, which is for tables: leave it out"):
        Options(units="force=kgf").require_for("run.mcap", bag=True)


def test_a_list_column_named_like_a_wrench_is_one_in_any_file(tmp_path: Path) -> None:
    for name in ("observation.force_torque", "observation.wrench", "wrench", "ft"):
        path = table(tmp_path, ",".join(f"{name}[{k}]" for k in range(6)) + f",{Q}")
        assert cw.read(path).wrench.tolist() == [[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]]
    path = table(tmp_path, ",".join(f"wrench[{k}]" for k in range(7)) + f",{Q}")
    with pytest.raises(FileFormatError, match="found no column fx"):
        cw.read(path)


@pytest.mark.parametrize(
    ("names", "perhaps"),
    [
        ("q1,q2,q3,q4", "abb_quat:q1,q2,q3,q4"),
        ("Q0,Q1,Q2,Q3", "quat_wxyz:Q0,Q1,Q2,Q3 or quat_xyzw:Q0,Q1,Q2,Q3"),
        ("w,x,y,z", "quat_wxyz:w,x,y,z"),
        ("pose[0],pose[1],pose[2],pose[3]", "quat_xyzw:pose[0:4] or quat_wxyz:pose[0:4]"),
    ],
)
def test_four_columns_that_may_be_a_quaternion_are_asked_for(tmp_path: Path, names: str, perhaps: str) -> None:
    assert f"as qx qy qz qw: rename them, or --orientation {perhaps}" in refusal(tmp_path, f"{WRENCH},{names}")
    for option in perhaps.split(" or "):
        assert len(cw.read(table(tmp_path, f"{WRENCH},{names}"), orientation=option)) == 1


def test_a_list_is_named_by_its_elements(tmp_path: Path) -> None:
    header = f"{WRENCH},pose[0],pose[1],pose[2],pose[3]"
    assert refusal(tmp_path, header, orientation="quat_xyzw:pose") == (
        "found the list pose, expected 4 columns: say --orientation quat_xyzw:pose[0:4]"
    )


def test_poses_alone_or_wrenches_alone_are_one_of_two_files(tmp_path: Path) -> None:
    assert ", or --wrench W.csv --pose P.csv (found t, qx" in refusal(tmp_path, f"t,{Q}")
    assert ", or --wrench W.csv --pose P.csv (found t, fx" in refusal(tmp_path, f"t,{WRENCH}")
