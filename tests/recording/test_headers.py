"""Headers as found in the wild (tests/headers, each with its source): read right, or refused with the one flag that
then reads them. Every file says the same three readings in its own names, units and angles.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import contactwrench as cw
from contactwrench.errors import ContactWrenchError
from contactwrench.recording.options import Options
from contactwrench.recording.read import read_streams

HEADERS = Path(__file__).resolve().parents[1] / "headers"
W = np.array(
    [
        [1.5, -2.25, 10.0, 0.125, -0.25, 0.5],
        [-3.0, 4.5, -6.75, 0.0625, 0.75, -0.375],
        [0.25, 8.0, -1.5, -0.5, 0.1875, 0.25],
    ]
)
R = Rotation.from_rotvec([[0.3, -0.5, 0.7], [1.2, 0.4, -0.9], [-0.6, 1.1, 0.2]]).as_matrix()
POSITION = np.array([[0.5, -0.2, 0.4], [0.51, -0.21, 0.41], [0.52, -0.22, 0.42]])
T = np.array([12.5, 12.502, 12.504])
UNIX = 1_700_000_000.0
UR_FORCE = ",".join(f"actual_TCP_force_{k}" for k in range(6))


@dataclass(frozen=True)
class Header:
    """A file: the times at which its clock starts, None where it has none; whether it has wrenches, and orientations;
    what it is refused with, and the one flag that then reads it.
    """

    start: float | None = 0.0
    wrench: bool = True
    pose: bool = True
    position: bool = True
    refusal: str = ""
    flag: dict[str, Any] = field(default_factory=dict)


FOUND = {
    "ur_rtde_raw": Header(),
    "ur_rtde_tcp_force": Header(
        refusal='found no wrench but "actual_TCP_force_0" and so on, what UR\'s controller makes of it, its payload '
        "subtracted already, expected the sensor's own reading: record ft_raw_wrench, or, recorded with a "
        "payload of 0 kg, take these with --wrench-columns 'actual_TCP_force[0:6]' --wrench-frame base",
        flag={"wrench_columns": UR_FORCE},
    ),
    "ur_rtde_both": Header(),
    "rostopic_wrench": Header(UNIX, pose=False),
    "rostopic_pose": Header(UNIX, wrench=False),
    "bagpy_wrench": Header(UNIX, pose=False),
    "plotjuggler": Header(),
    "ros2_messages": Header(UNIX),
    "platonics": Header(None),
    "food_acquisition": Header(
        position=False,
        refusal="found no orientation columns, expected qx qy qz qw, r11..r33, a b c (KUKA), w p r (FANUC), rx ry rz "
        "(UR) or roll pitch yaw: rename them, or --orientation NAME:COLUMNS, or "
        "--wrench W.csv --pose P.csv (found Time(s), F_x(N), F_y(N), "
        "F_z(N), T_x(Nm), T_y(Nm), T_z(Nm), P_x(m), P_y(m), P_z(m), O_x(rad), O_y(rad), O_z(rad))",
        flag={"orientation": "euler:ZYX:rad:O_z(rad),O_y(rad),O_x(rad)"},
    ),
    "bota_sensone": Header(pose=False),
    "printed_fts": Header(pose=False),
    "libfranka_log": Header(
        wrench=False,
        position=False,
        refusal="found no orientation columns",
        flag={"orientation": "franka_matrix:cmd.O_T_EE_d[0:16]"},
    ),
    "ati_wireless": Header(
        pose=False,
        refusal="found no column fx, expected fx fy fz tx ty tz and an orientation: add it, or name the six with "
        "--wrench-columns A,B,C,D,E,F, or --wrench W.csv --pose P.csv "
        "(found Time, T1FX, T1FY, T1FZ, T1TX, T1TY, T1TZ)",
        flag={"wrench_columns": "T1FX,T1FY,T1FZ,T1TX,T1TY,T1TZ"},
    ),
    "ati_and_ur_logger": Header(UNIX, pose=False),
    "ur_poses_of_logger": Header(UNIX, wrench=False),
    "demonstrations": Header(),
    "policy_debug": Header(UNIX),
    "drone_controller": Header(),
    "haptics": Header(
        position=False,
        refusal="found no column fx, expected fx fy fz tx ty tz and an orientation: add it, or name the six with "
        "--wrench-columns A,B,C,D,E,F",
        flag={
            "wrench_columns": "robot force x (n),Robot Force Y (N),Robot Force Z (N),"
            "Robot Torque X (Nm),Robot Torque Y (Nm),Robot Torque Z (Nm)"
        },
    ),
    "german_excel": Header(position=False),
    "matlab_writetable": Header(position=False, refusal="", flag={"units": "angle=rad"}),
    "pandas_to_csv": Header(position=False),
}
"""`matlab_writetable` is rpy without a unit: degrees are what is read, and what its writer meant is for --units."""


def test_every_header_is_cited_and_tested() -> None:
    files = {path.stem: path.read_text(encoding="utf-8") for path in HEADERS.glob("*.csv")}
    assert set(files) == set(FOUND)
    assert len(files) >= 20
    assert all(text.startswith("# ") for text in files.values())


def _other_file(folder: Path, header: Header) -> tuple[Path | None, Path | None]:
    """What a file of wrenches or of poses alone lacks, in a second one with the usual names."""
    t = T + (header.start or 0.0)
    if not header.wrench:
        names, columns = "t,fx,fy,fz,tx,ty,tz", np.column_stack([t, W])
    elif not header.pose:
        names, columns = "t,r11,r12,r13,r21,r22,r23,r31,r32,r33", np.column_stack([t, R.reshape(-1, 9)])
    else:
        return None, None
    path = folder / "other.csv"
    path.write_text("\n".join([names, *(",".join(f"{v:.17g}" for v in row) for row in columns), ""]))
    return (path, None) if not header.wrench else (None, path)


@pytest.mark.parametrize("name", FOUND)
def test_a_header_is_read_right_or_refused_with_the_flag_that_reads_it(tmp_path: Path, name: str) -> None:
    header, path = FOUND[name], HEADERS / f"{name}.csv"
    wrenches, poses = _other_file(tmp_path, header)
    options = Options(pose_file=path if wrenches is not None else poses)
    if header.refusal:
        with pytest.raises(ContactWrenchError) as caught:
            cw.read(wrenches or path, pose_file=options.pose_file)
        assert str(caught.value).startswith(f"{path}: {header.refusal}")
        assert "\n" not in str(caught.value)
    if header.start is None:
        samples = cw.read(path)
        assert samples.t is None
        assert samples.position == pytest.approx(POSITION, abs=1e-8)
        found = samples.wrench, samples.R_base_flange
    else:
        streams = read_streams(wrenches or path, replace(options, **header.flag))
        assert streams.wrench.t == pytest.approx(T + header.start, rel=1e-15, abs=1e-6)
        assert streams.orientation.t == pytest.approx(T + header.start, rel=1e-15, abs=1e-6)
        if header.pose and header.position:
            assert streams.orientation.position == pytest.approx(POSITION, abs=1e-8)
        found = streams.wrench.wrench, streams.orientation.R_base_flange
    assert found[0] == pytest.approx(W, abs=1e-7)
    assert found[1] == pytest.approx(R, abs=1e-7)
