"""Tables as people write them: columns by name, units by suffix, and the reading flags, each proven by physics."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import contactwrench as cw
from contactwrench.errors import InputError
from contactwrench.recording.tables.columns import Column
from contactwrench.recording.tables.csv import open_csv
from tests.support.recordings import (
    MATRIX,
    WRENCH,
    Array,
    csv_text,
    generic_rotations,
    matrix_table,
    rx,
    ry,
    rz,
    written,
)

QUAT = ("qx", "qy", "qz", "qw")
IDENTITY = (0.0, 0.0, 0.0, 1.0)
DEG = np.pi / 180.0
READING = (1.5, -2.25, 3.125, 0.25, -0.5, 0.75)


def read_one(folder: Path, header: str, row: str, **flags: str) -> cw.Samples:
    """A table of one row."""
    return cw.read(written(folder, f"{header}\n{row}\n"), **flags)  # type: ignore[arg-type]


def test_numbers_arrive_exactly_as_they_were_written(tmp_path: Path) -> None:
    wrench, R = np.random.default_rng(1).normal(size=(50, 6)), generic_rotations(50)
    samples = cw.read(written(tmp_path, matrix_table(wrench, R)))
    assert np.array_equal(samples.wrench, wrench)
    assert samples.R_base_flange == pytest.approx(R, abs=1e-12)
    assert (samples.t, samples.position, samples.load_mass) == (None, None, None)


def test_columns_come_in_any_case_and_order_between_others(tmp_path: Path) -> None:
    header = ("Note", "QW", "Tz", "FX", "temperature", "qX", "fY", "Qz", "fz", "qy", "TX", "ty")
    row = "first,0.8,6,1,,0.2,2,0.4,3,0.4,4,5"
    samples = read_one(tmp_path, ",".join(header), row)
    assert samples.wrench[0].tolist() == [1, 2, 3, 4, 5, 6]
    expected = np.array([[0.36, -0.48, 0.8], [0.8, 0.6, 0.0], [-0.48, 0.64, 0.6]])
    assert samples.R_base_flange[0] == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize(
    ("column", "attribute", "value", "expected"),
    [
        ("t", "t", 12.5, 12.5),
        ("t_s", "t", 12.5, 12.5),
        ("t_ms", "t", 12.5, 0.0125),
        ("T_us", "t", 12.5, 12.5e-6),
        ("t_ns", "t", 12.5, 12.5e-9),
        ("load_g", "load_mass", 250.0, 0.25),
        ("load_kg", "load_mass", 0.25, 0.25),
    ],
)
def test_a_suffix_states_the_unit_of_time_and_load(
    tmp_path: Path, column: str, attribute: str, value: float, expected: float
) -> None:
    samples = cw.read(written(tmp_path, csv_text((*WRENCH, *QUAT, column), [(*READING, *IDENTITY, value)])))
    assert getattr(samples, attribute)[0] == pytest.approx(expected, rel=1e-12)


def test_a_suffix_states_the_unit_of_force_torque_and_position(tmp_path: Path) -> None:
    header = ("fx_n", "fy", "fz_N", "tx_nmm", "ty_Nm", "tz_nmm", *QUAT, "x_mm", "y", "z_m")
    samples = cw.read(written(tmp_path, csv_text(header, [(1, 2, 3, 400, 5, 600, *IDENTITY, 7, 8, 9)])))
    assert samples.wrench[0] == pytest.approx([1, 2, 3, 0.4, 5, 0.6], rel=1e-12)
    assert samples.position is not None
    assert samples.position[0] == pytest.approx([0.007, 8, 9], rel=1e-12)


@pytest.mark.parametrize(
    ("columns", "values", "flag"),
    [
        ("a,b,c", (20, -35, 110), "auto"),
        ("a_deg,b_deg,c_deg", (20, -35, 110), "auto"),
        ("A_rad,B_rad,C_rad", (20 * DEG, -35 * DEG, 110 * DEG), "auto"),
        ("w,p,r", (110, -35, 20), "auto"),
        ("c,b,a", (20, -35, 110), "euler:ZYX:deg:c,b,a"),
        ("roll,pitch,yaw", (110, -35, 20), "rpy"),
        ("roll_rad,pitch_rad,yaw_rad", (110 * DEG, -35 * DEG, 20 * DEG), "rpy"),
        ("roll_rad,pitch_rad,yaw_rad", (110 * DEG, -35 * DEG, 20 * DEG), "rpy:roll_rad,pitch_rad,yaw_rad"),
        ("u_deg,v_deg,w_deg", (20, -35, 110), "euler:ZYX:rad:u_deg,v_deg,w_deg"),
        ("u_rad,v_rad,w_rad", (20 * DEG, -35 * DEG, 110 * DEG), "kuka_abc:u_rad,v_rad,w_rad"),
        ("r,p,y", (20, -35, 110), "nachi"),
    ],
)
def test_angles_are_read_in_the_unit_that_their_column_states(
    tmp_path: Path, columns: str, values: tuple[float, ...], flag: str
) -> None:
    path = written(tmp_path, csv_text((*WRENCH, *columns.split(",")), [(*READING, *values)]))
    expected = rz(20 * DEG) @ ry(-35 * DEG) @ rx(110 * DEG)
    assert cw.read(path, orientation=flag).R_base_flange[0] == pytest.approx(expected, abs=1e-12)


def test_rotation_vectors_are_radians_unless_the_column_says_otherwise(tmp_path: Path) -> None:
    for columns, angle in (("rx,ry,rz", 0.7), ("rx_rad,ry_rad,rz_rad", 0.7), ("rx_deg,ry_deg,rz_deg", 0.7 / DEG)):
        path = written(tmp_path, csv_text((*WRENCH, *columns.split(",")), [(*READING, 0, 0, angle)]))
        for flag in ("auto", "ur_rotvec", f"ur_rotvec:{columns}"):
            assert cw.read(path, orientation=flag).R_base_flange[0] == pytest.approx(rz(0.7), abs=1e-12)


def test_the_angle_y_of_nachi_is_not_taken_for_a_position(tmp_path: Path) -> None:
    path = written(tmp_path, csv_text((*WRENCH, "r", "p", "y", "x", "z"), [(*READING, 1, 2, 3, 4, 5)]))
    assert cw.read(path, orientation="nachi").position is None


@pytest.mark.parametrize(
    "dress",
    [
        lambda text: b"\xef\xbb\xbf" + text.encode(),
        lambda text: text.replace("\n", "\r\n").encode(),
        lambda text: text.replace("\n", "\r").encode(),
        lambda text: text.replace(",", ";").encode(),
        lambda text: text.replace(",", "\t").encode(),
        lambda text: text.replace(",", " , ").encode(),
        lambda text: text.replace(",", " ").encode(),
        lambda text: text.replace(",", "    ").replace("\n", "  \n  ").encode(),
        lambda text: ("# " + text.replace(",", " ")).encode(),
        lambda text: ("# by hand\n#fx, " + text.removeprefix("fx,")).encode(),
        lambda text: text.replace(",", ";").replace(".", ",").encode(),
        lambda text: text.replace(",", "\t").replace(".", ",").encode(),
        lambda text: text.replace(",", "  ").replace(".", ",").encode(),
        lambda text: text.replace(",", ";").replace(".", ",").replace("\n", "\r\n").encode("utf-16"),
        lambda text: text.replace(",", "\t").encode("utf-16"),
        lambda text: ("note, of what;" + text.replace(",", ";").replace("\n", "\nup, free;")).encode()[:-10],
        lambda text: ("# Köln, in °\n" + "\n".join(f"über,{line}" for line in text.split())).encode("cp1252"),
        lambda text: ("Log 2; Mini45, in N\nDate\t2024-05" + 14 * "\t" + "\n\n" + text.replace(",", "\t")).encode(),
        lambda text: text.rstrip("\n").encode(),
        lambda text: ("# made by hand, Köln\n\n" + text.replace("\n", "\n# and so on\n \n")).encode(),
        lambda text: b"\xef\xbb\xbf# note\r\n" + text.replace(",", ";").replace("\n", "\r\n").encode(),
        lambda text: "\n".join(",".join(f'"{cell}"' for cell in line.split(",")) for line in text.split()).encode(),
        lambda text: "\n".join(f'"down, {n}",{line}' for n, line in enumerate(text.split())).encode(),
        lambda text: text.replace("\n", ",\n").replace(",\n", "\n", 1).encode(),
        lambda text: text.replace(",", ";").replace("\n", ";\n", 1).encode(),
        lambda text: (text + 3 * (text.partition("\n")[0].count(",") * "," + "\n")).encode(),
    ],
    ids=[
        *("BOM", "CRLF", "CR", "semicolon", "tab", "spaces", "blank", "blanks", "numpy", "numpy with commas"),
        *("decimal comma", "comma and tabs", "comma and blanks", "Excel UTF-16", "UTF-16", "commas in text"),
        *("Windows", "remarks", "no end", "comments", "Excel", "quotes", "text"),
        *("commas behind rows", "a mark behind names", "rows of nothing"),
    ],
)
def test_what_is_plainly_meant_is_read(tmp_path: Path, dress: object) -> None:
    wrench, R = np.random.default_rng(2).normal(size=(7, 6)), generic_rotations(7)
    samples = cw.read(written(tmp_path, dress(matrix_table(wrench, R))))  # type: ignore[operator]
    assert np.array_equal(samples.wrench, wrench)
    assert samples.R_base_flange == pytest.approx(R, abs=1e-12)


def test_a_row_of_units_belongs_to_the_names_above_it(tmp_path: Path) -> None:
    for units in ("[s];[N];[Nm];[-];", "s;N;N m;-;", "(s);(N);(N m);(1);"):
        path = written(tmp_path, f"Time;Fx;Tx;Count;Note\n{units}\n1,5;2;3;4;free\n")
        table = open_csv(path, 100)
        names = [name.replace(" ", "").lower() for name in table.places]
        assert names == ["time[s]", "fx[n]", "tx[nm]", "count", "note"]
        (body,) = table.bodies(())
        assert body.numbers([Column(0, "t", 1.0), Column(2, "tx", 1.0)]).tolist() == [[1.5, 3.0]]
        assert body.row_of(0) == 3


@pytest.mark.parametrize("name", ["poses.CSV", "poses.tsv", "poses.txt", "poses.dat", "poses.log", "poses"])
def test_text_is_read_under_its_usual_suffixes(tmp_path: Path, name: str) -> None:
    path = written(tmp_path, csv_text((*WRENCH, *QUAT), [(*READING, *IDENTITY)], delimiter="\t"), name)
    assert cw.read(path).wrench[0] == pytest.approx(READING)
    assert cw.read(path).source == str(path)


class World:
    """A tool that hangs from a sensor on the flange (mounting: identity), and a push on it, all in base axes."""

    R = generic_rotations(9, seed=3)
    down = 20.0 * np.array([0.0, 0.0, -1.0])
    com = np.array([0.01, -0.02, 0.06])
    push = np.array([3.0, -7.0, 2.0])

    @classmethod
    def in_base_axes(cls) -> Array:
        """What acts on the sensor: weight and push, and their torques about the sensor's origin."""
        arm = cls.R @ cls.com
        return np.column_stack([np.tile(cls.down + cls.push, (9, 1)), np.cross(arm, cls.down + cls.push)])

    @classmethod
    def in_sensor_axes(cls) -> Array:
        """The same as the sensor reads it, one pose at a time."""
        turned = [np.r_[R.T @ w[:3], R.T @ w[3:]] for R, w in zip(cls.R, cls.in_base_axes(), strict=True)]
        return np.array(turned)


def test_a_wrench_in_base_axes_is_turned_into_the_sensors(tmp_path: Path) -> None:
    path = written(tmp_path, matrix_table(World.in_base_axes(), World.R))
    assert cw.read(path, wrench_frame="base").wrench == pytest.approx(World.in_sensor_axes(), abs=1e-12)


def test_the_reaction_is_turned_round(tmp_path: Path) -> None:
    path = written(tmp_path, matrix_table(-World.in_sensor_axes(), World.R))
    assert cw.read(path, sign="reaction").wrench == pytest.approx(World.in_sensor_axes(), abs=1e-12)


def test_an_inverse_orientation_is_inverted(tmp_path: Path) -> None:
    path = written(tmp_path, matrix_table(World.in_sensor_axes(), World.R.transpose(0, 2, 1)))
    samples = cw.read(path, inverse_orientation=True)
    assert samples.R_base_flange == pytest.approx(World.R, abs=1e-12)
    assert samples.wrench == pytest.approx(World.in_sensor_axes(), abs=1e-12)


def test_all_reading_flags_together(tmp_path: Path) -> None:
    table = csv_text(
        (*WRENCH, *(f"m{k}" for k in range(9))),
        np.column_stack([-World.in_base_axes(), World.R.transpose(0, 2, 1).reshape(-1, 9)]),
    )
    names = ",".join(f"m{k}" for k in range(9))
    samples = cw.read(
        written(tmp_path, table), f"matrix:{names}", wrench_frame="base", sign="reaction", inverse_orientation=True
    )
    assert samples.R_base_flange == pytest.approx(World.R, abs=1e-12)
    assert samples.wrench == pytest.approx(World.in_sensor_axes(), abs=1e-12)


def test_a_flag_chooses_where_the_columns_would_tell_something_else(tmp_path: Path) -> None:
    R = rx(0.4) @ ry(-1.2) @ rz(2.2)
    header = (*WRENCH, "rx_rad", "ry_rad", "rz_rad", *QUAT)
    path = written(tmp_path, csv_text(header, [(*READING, 0.4, -1.2, 2.2, *IDENTITY)]))
    assert cw.read(path, "staubli").R_base_flange[0] == pytest.approx(R, abs=1e-12)
    assert cw.read(path, "quat_xyzw").R_base_flange[0] == pytest.approx(np.eye(3), abs=1e-12)


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        ({"wrench_frame": "tool"}, "wrench_frame is 'tool', expected sensor or base"),
        ({"sign": "push"}, "sign is 'push', expected pull or reaction"),
        (
            {"wrench_columns": ["a", "b"]},
            "wrench_columns is ['a', 'b'], expected a text: write it as for --wrench-columns on the command line",
        ),
        (
            {"units": {"time": "ms"}},
            "units is {'time': 'ms'}, expected a text: write it as for --units on the command line",
        ),
        ({"episode": "1"}, "episode is '1', expected a whole number: read one at a time"),
        ({"episode": range(3)}, "episode is range(0, 3), expected a whole number: read one at a time"),
        ({"orientation": 3}, "orientation is 3, expected a text: write it as for --orientation on the command line"),
    ],
)
def test_an_unknown_reading_flag_is_refused(tmp_path: Path, flags: dict[str, Any], message: str) -> None:
    path = written(tmp_path, csv_text((*WRENCH, *MATRIX), [(*READING, *np.eye(3).ravel())]))
    with pytest.raises(InputError) as caught:
        cw.read(path, **flags)
    assert str(caught.value) == message
