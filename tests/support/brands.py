"""Recordings as each brand's own recorder writes them: header, units, separators, decimals; physics from world.py.

Where the formats are from: UR, `CSVWriter` of UniversalRobots/RTDE_Python_Client_Library, rtde/csv_writer.py; KUKA,
FANUC and ABB, taught points in a program's .dat, .ls and .mod; the others by the programs that the pages in
docs/robots/ show.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from tests.support.bags import tf, transform, wrench_stamped, write_bag
from tests.support.recordings import MATRIX, WRENCH
from tests.support.rigs import NOISE
from tests.support.world import DOWN, Array, Rig, noisy_readings

GRIPPER = Rig(
    weight=11.27,
    com=np.array([0.0042, -0.0031, 0.0587]),
    bias=np.array([-3.1, 1.7, 8.4, 0.12, -0.21, 0.035]),
    R_flange_sensor=Rotation.from_euler("ZYX", [30.0, 0.3, -0.2], degrees=True).as_matrix(),
    down=DOWN,
)
"""Of 1.15 kg, on a sensor that is turned by 30 degrees, on a level base."""

UPSIDE_DOWN = Rotation.from_euler("x", 180.0, degrees=True)
"""Of a flange that points down."""


@dataclass(frozen=True, eq=False)
class Recorded:
    """Times (n,) s, flange orientations (n, 3, 3) and positions (n, 3) m, readings (n, 6) N and N m."""

    t: Array
    R_base_flange: Array
    position: Array
    wrench: Array

    @property
    def rotation(self) -> Rotation:
        return Rotation.from_matrix(self.R_base_flange)


def tilted(n: int, rng: np.random.Generator) -> Rotation:
    """`n` orientations of a flange, from pointing down to lying on its side and beyond."""
    angles = np.column_stack(
        [rng.uniform(-180.0, 180.0, n), rng.uniform(-75.0, 75.0, n), rng.uniform(-100.0, 100.0, n)]
    )
    return Rotation.from_euler("ZYX", angles, degrees=True) * UPSIDE_DOWN


def taught(rig: Rig, rng: np.random.Generator, n: int = 12) -> Recorded:
    """A row a pose: the mean of a second's readings."""
    R: Array = tilted(n, rng).as_matrix()
    position: Array = np.array([0.45, -0.1, 0.5]) + rng.uniform(-0.15, 0.15, (n, 3))
    return Recorded(np.linspace(0.0, 240.0, n), R, position, noisy_readings(rig, R, NOISE / 5.0, rng))


def stop_and_go(rig: Rig, rng: np.random.Generator, rate: float, push: float = 0.0, start: float = 0.0) -> Recorded:
    """An arm that stops for 2.5 s at each of twelve poses and takes 1.5 s to the next; at work, with a push along the
    sensor's -z of so many N for a second of the third stop, at four.
    """
    still, move, stops = 2.5, 1.5, 4 if push else 12
    knots = np.arange(stops) * (still + move)
    t = np.arange(round(rate * (knots[-1] + still))) / rate
    stop, since = np.divmod(t, still + move)
    s = np.clip((since - still) / move, 0.0, 1.0)
    place = np.minimum(stop + s**3 * (10.0 - 15.0 * s + 6.0 * s**2), stops - 1)
    R = Slerp(np.arange(stops), tilted(stops, rng))(place).as_matrix()
    between = rng.uniform(-0.15, 0.15, (stops, 3))
    offset = np.column_stack([np.interp(place, np.arange(stops), column) for column in between.T])
    wrench = noisy_readings(rig, R, NOISE, rng)
    wrench[(t > knots[2] + 1.0) & (t < knots[2] + 2.0), 2] -= push
    return Recorded(start + t, R, np.array([0.45, -0.1, 0.5]) + offset, wrench)


def write_table(path: Path, header: Sequence[str], numbers: Array, decimals: int, between: str = ",") -> None:
    lines = [between.join(header), *(between.join(f"{value:.{decimals}f}" for value in row) for row in numbers)]
    path.write_text("\n".join(lines) + "\n")


def ur(folder: Path, rig: Rig, rng: np.random.Generator) -> None:
    """`record.py --frequency 125` with the page's recipe: `robot_data.csv`, and `work.csv` with a push.

    The raw zero wanders as that of a UR5e did, by 9 N an hour (barikata1984/iparam_identifiacation,
    docs/LOGS/log_estimation_accuracy.md).
    """
    vectors = [f"{name}_{k}" for name in ("actual_TCP_pose", "ft_raw_wrench") for k in range(6)]
    for name, push in (("robot_data.csv", 0.0), ("work.csv", 8.0)):
        run = stop_and_go(rig, rng, 125.0, push=push, start=4211.376)
        zero = np.outer(run.t - run.t[0], np.array([-9.0, 9.0, 9.0, 0.0, 0.0, 0.0]) / 3600.0)
        with (folder / name).open("w", newline="") as file:
            writer = csv.writer(file, delimiter=" ")
            writer.writerow(["timestamp", *vectors])
            rotvec = run.rotation.as_rotvec()
            writer.writerows(np.column_stack([run.t, run.position, rotvec, run.wrench + zero]).tolist())


def write_wrench(folder: Path, run: Recorded) -> None:
    """What the page my-own.md reads from a sensor: a row a pose."""
    write_table(folder / "wrench.csv", WRENCH, run.wrench, 5)


def kuka_krc(folder: Path, rig: Rig, rng: np.random.Generator) -> None:
    """Taught points of the program FTPOSES in ftposes.dat, REAL numbers as KRL writes them; wrench.csv beside."""
    run = taught(rig, rng)
    lines = ["&ACCESS RVP", "&REL 3", "DEFDAT  FTPOSES", ";FOLD EXTERNAL DECLARATIONS;%{PE}", ";ENDFOLD"]
    for k, (x, abc) in enumerate(
        zip(1000.0 * run.position, run.rotation.as_euler("ZYX", degrees=True), strict=True), 1
    ):
        numbers = zip("XYZABC", np.array([*x, *abc], np.float32).tolist(), strict=True)
        placed = ",".join(f"{letter} {value:.9G}" for letter, value in numbers)
        external = ",".join(f"E{j} 0.0" for j in range(1, 7))
        lines.append(f"DECL E6POS XP{k}={{{placed},S 2,T 10,{external}}}")
        lines.append(f'DECL FDAT FP{k}={{TOOL_NO 0,BASE_NO 0,IPO_FRAME #BASE,POINT2[] " "}}')
        lines.append(f"DECL PDAT PPDAT{k}={{VEL 100.000,ACC 100.000,APO_DIST 100.000}}")
    (folder / "ftposes.dat").write_bytes("\r\n".join([*lines, "ENDDAT", ""]).encode())
    write_wrench(folder, run)


def kuka_iiwa(folder: Path, rig: Rig, rng: np.random.Generator) -> None:
    """Two streams on the PC's clock: the flange by UDP at 50 Hz, angles in rad, and the sensor at 250 Hz, 8 ms late."""
    run = stop_and_go(rig, rng, 250.0, start=1_760_000_000.25)
    poses = np.column_stack([run.t, 1000.0 * run.position, run.rotation.as_euler("ZYX")])[2::5]
    write_table(folder / "pose.csv", ("t", "x_mm", "y_mm", "z_mm", "a_rad", "b_rad", "c_rad"), poses, 6)
    write_table(folder / "wrench.csv", ("t", *WRENCH), np.column_stack([run.t + 0.008, run.wrench]), 6)


def fanuc_number(value: float) -> str:
    """As in a listing: nine places, three decimals, no zero before the point."""
    return f"{value:.3f}".replace("-0.", "-.").removeprefix("0" if 0.0 < abs(value) < 1.0 else "").rjust(9)


def fanuc(folder: Path, rig: Rig, rng: np.random.Generator) -> None:
    """Taught points of the program FTPOSES in ftposes.ls; wrench.csv beside."""
    run = taught(rig, rng)
    lines = ["/PROG  FTPOSES", "/ATTR", "OWNER\t\t= MNEDITOR;", "PROTECT\t\t= READ_WRITE;", "/MN"]
    for k in range(1, 13):
        lines += [f"{2 * k + 1:4d}:J P[{k}] 20% FINE    ;", f"{2 * k + 2:4d}:  WAIT   3.00(sec) ;"]
    lines.append("/POS")
    for k, (x, rpw) in enumerate(
        zip(1000.0 * run.position, run.rotation.as_euler("ZYX", degrees=True), strict=True), 1
    ):
        lines += [f"P[{k}]{{", "   GP1:", "\tUF : 0, UT : 1,\t\tCONFIG : 'N U T, 0, 0, 0',"]
        lines.append(
            ",".join(f"\t{letter} = {fanuc_number(value)}  mm" for letter, value in zip("XYZ", x, strict=True)) + ","
        )
        lines.append(
            ",".join(f"\t{letter} = {fanuc_number(value)} deg" for letter, value in zip("WPR", rpw[::-1], strict=True))
        )
        lines.append("};")
    (folder / "ftposes.ls").write_bytes("\r\n".join([*lines, "/END", ""]).encode())
    write_wrench(folder, run)


def abb(folder: Path, rig: Rig, rng: np.random.Generator) -> None:
    """Taught robtargets of a module in FTPoses.mod; wrench.csv beside."""
    run = taught(rig, rng)
    lines = ["MODULE FTPoses"]
    for k, (x, q) in enumerate(zip(1000.0 * run.position, run.rotation.as_quat(), strict=True), 1):
        place, turn = ",".join(f"{value:.6g}" for value in x), ",".join(f"{value:.6g}" for value in (q[3], *q[:3]))
        lines.append(f"  CONST robtarget p{10 * k}:=[[{place}],[{turn}],[-1,0,-1,0],[9E9,9E9,9E9,9E9,9E9,9E9]];")
    lines.append("  PROC main()")
    for k in range(1, 13):
        lines += [f"    MoveJ p{10 * k}, v100, fine, tool0;", "    WaitTime 3;"]
    (folder / "FTPoses.mod").write_bytes("\r\n".join([*lines, "  ENDPROC", "ENDMODULE", ""]).encode())
    write_wrench(folder, run)


def franka(folder: Path, rig: Rig, rng: np.random.Generator) -> None:
    """The page's loop at 100 Hz: the state's O_T_EE, column by column, beside a sensor; and work.csv with a push."""
    for name, push in (("recording.csv", 0.0), ("work.csv", 8.0)):
        run = stop_and_go(rig, rng, 100.0, push=push)
        poses = np.tile(np.eye(4), (len(run.t), 1, 1))
        poses[:, :3, :3], poses[:, :3, 3] = run.R_base_flange, run.position
        numbers = np.column_stack([run.t, run.wrench, poses.transpose(0, 2, 1).reshape(-1, 16)])
        write_table(folder / name, ("t", *WRENCH, *(f"O_T_EE_{k}" for k in range(16))), numbers, 6)


def xarm(folder: Path, rig: Rig, rng: np.random.Generator) -> None:
    """The page's loop at 100 Hz: `get_position` in mm and degrees, the sensor's raw data; and work.csv with a push."""
    for name, push in (("recording.csv", 0.0), ("work.csv", 8.0)):
        run = stop_and_go(rig, rng, 100.0, push=push)
        angles = run.rotation.as_euler("xyz", degrees=True)
        numbers = np.column_stack([run.t, run.wrench, 1000.0 * run.position, angles])
        write_table(folder / name, ("t", *WRENCH, "x_mm", "y_mm", "z_mm", "roll", "pitch", "yaw"), numbers, 6)


def ros2(folder: Path, rig: Rig, rng: np.random.Generator) -> None:
    """`ros2 bag record -o calibration`: a broadcaster's wrench at 50 Hz and tf at 25 Hz; and `work` with a push.

    The flange hangs on wrist_3_link by a fixed transform in tf_static, as robot_state_publisher sends it.
    """
    fixed = Rotation.from_euler("zyx", [90.0, 0.0, -90.0], degrees=True)
    for name, push in (("calibration", 0.0), ("work", 8.0)):
        run = stop_and_go(rig, rng, 50.0, push=push)
        wrist = (run.rotation * fixed.inv()).as_matrix()
        messages = [tf(0.0, [transform(0.0, "wrist_3_link", "tool0", fixed.as_matrix(), np.zeros(3))], "/tf_static")]
        for k, t in enumerate(run.t):
            messages.append(wrench_stamped(t, run.wrench[k], "/force_torque_sensor_broadcaster/wrench", "ft_frame"))
            if k % 2 == 0:
                messages.append(tf(t, [transform(t, "base_link", "wrist_3_link", wrist[k], run.position[k])]))
        write_bag(folder / name, messages)


def my_own(folder: Path, rig: Rig, rng: np.random.Generator) -> None:
    """A table by hand, a row a pose, and the page's loop at 100 Hz with a push."""
    poses = taught(rig, rng)
    numbers = np.column_stack([poses.wrench, poses.rotation.as_quat()])
    write_table(folder / "poses.csv", (*WRENCH, "qx", "qy", "qz", "qw"), numbers, 4)
    run = stop_and_go(rig, rng, 100.0, push=8.0)
    numbers = np.column_stack([run.t, run.wrench, run.R_base_flange.reshape(-1, 9)])
    write_table(folder / "work.csv", ("t", *WRENCH, *MATRIX), numbers, 6)


BRANDS: dict[str, Callable[[Path, Rig, np.random.Generator], None]] = {
    "ur": ur,
    "kuka-krc": kuka_krc,
    "kuka-iiwa": kuka_iiwa,
    "fanuc": fanuc,
    "abb": abb,
    "franka": franka,
    "xarm": xarm,
    "ros2": ros2,
    "my-own": my_own,
}
"""By the page in docs/robots/."""

UR_ZERO = np.array([1794.1, 392.9, 25406.0, -7.88, -17.53, -76.0])
EXAMPLES = dict.fromkeys(BRANDS, GRIPPER) | {"ur": replace(GRIPPER, R_flange_sensor=np.eye(3), bias=UR_ZERO)}
"""A rig for each brand's page; the sensor of a UR is its flange, with the zero of that UR5e."""
