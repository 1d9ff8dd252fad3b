"""HDF5 as h5py itself writes it, against what was written: datasets by their names, by --hdf5, episodes, bad files."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import contactwrench as cw
from contactwrench.errors import ContactWrenchError, FileFormatError, InputError, MissingExtraError
from contactwrench.recording.options import Options
from contactwrench.recording.read import batches
from contactwrench.recording.tables.columns import Naming
from contactwrench.recording.tables.table import open_table
from tests.recording.test_bad_files import assert_one_line_that_names
from tests.recording.test_tables import HEADER, Motion, assert_same, joined, rows
from tests.support.recordings import PANDA, Array, run

h5py = pytest.importorskip("h5py", reason="h5py is not installed")

QUAT = Rotation.from_matrix(Motion.R).as_quat()
POSES = np.tile(np.eye(4), (60, 1, 1))
POSES[:, :3, :3], POSES[:, :3, 3] = Motion.R, Motion.position


def stored(folder: Path, datasets: dict[str, Any], name: str = "run.h5", **options: Any) -> Path:
    """A file of datasets by their paths, each an array, or with its attributes."""
    with h5py.File(folder / name, "w") as file:
        for path, values in datasets.items():
            array, attributes = values if isinstance(values, tuple) else (values, {})
            file.create_dataset(path, data=array, **options).attrs.update(attributes)
    return folder / name


def lab_file(folder: Path, **options: Any) -> Path:
    datasets = {
        "ft/wrench": Motion.wrench,
        "robot/quat": QUAT,
        "robot/xyz_quat": np.hstack([Motion.position, QUAT]),
        "robot/xyz_wxyz": np.hstack([Motion.position, QUAT[:, [3, 0, 1, 2]]]),
        "robot/abc": Rotation.from_matrix(Motion.R).as_euler("ZYX", degrees=True),
        "robot/R": Motion.R,
        "robot/R_flat": Motion.R.reshape(60, 9),
        "robot/T": POSES,
        "robot/T_flat": POSES.reshape(60, 16),
        "robot/T_by_columns": POSES.transpose(0, 2, 1).reshape(60, 16),
        "time": Motion.t,
        "short": Motion.t[:7],
        "camera": np.zeros((60, 2, 2, 3), np.uint8),
        "note": np.array([b"free"] * 60),
    }
    return stored(folder, datasets, **options)


def refusal(path: Path, **flags: Any) -> str:
    with pytest.raises((FileFormatError, InputError)) as caught:
        cw.read(path, **flags)
    message = str(caught.value)
    assert "\n" not in message
    return message.removeprefix(f"{path}: ")


@pytest.mark.parametrize(
    ("pose", "orientation", "with_position"),
    [
        ("quat", "quat_xyzw", False),
        ("xyz_quat", "quat_xyzw", True),
        ("xyz_wxyz", "quat_wxyz", True),
        ("abc", "kuka_abc", False),
        ("R", "auto", False),
        ("R", "matrix", False),
        ("R_flat", "auto", False),
        ("T", "auto", True),
        ("T_flat", "auto", True),
        ("T_by_columns", "auto", True),
        ("T_by_columns", "franka_matrix", True),
    ],
)
def test_wrench_pose_and_time_are_read_where_the_flag_says(
    tmp_path: Path, pose: str, orientation: str, with_position: bool
) -> None:
    path = lab_file(tmp_path)
    found = cw.read(path, orientation, hdf5=f"wrench=/ft/wrench,pose=/robot/{pose}/, time = time")
    assert np.array_equal(found.wrench, Motion.wrench)
    assert found.t is not None
    assert np.array_equal(found.t, Motion.t)
    assert found.R_base_flange == pytest.approx(Motion.R, abs=1e-12)
    assert (found.position is not None) == with_position
    if found.position is not None:
        assert np.array_equal(found.position, Motion.position)


def test_poses_of_a_franka_are_known_by_their_name(tmp_path: Path) -> None:
    poses = POSES.transpose(0, 2, 1).reshape(60, 16)
    path = stored(tmp_path, {"ft/wrench": Motion.wrench, "panda/robot_state/O_T_EE": poses, "time": Motion.t})
    assert "no orientation columns" in refusal(path)  # whose panda?
    path = stored(tmp_path, {"ft/wrench": Motion.wrench, "robot_state/O_T_EE": poses, "time": Motion.t})
    found = cw.read(path)
    assert found.R_base_flange == pytest.approx(Motion.R, abs=1e-12)
    assert found.position is not None
    assert np.array_equal(found.position, Motion.position)


def test_a_long_name_keeps_its_end_which_tells_it_from_others(tmp_path: Path) -> None:
    path = stored(
        tmp_path, {"observation/robot_state/force_torque": Motion.wrench, "quat_xyzw": QUAT, "time": Motion.t}
    )
    short = "observation/robot_st…e/force_torque"
    assert f'fx..fz from "{short}[0:3]", tx..tz from "{short}[3:6]"' in cw.read(path).notes[0]


@pytest.mark.parametrize(("dataset", "said"), [("T", "franka_matrix:robot/T[0:16]"), ("R", "matrix:robot/R[0:9]")])
def test_a_refusal_names_the_option_that_reads_matrices(tmp_path: Path, dataset: str, said: str) -> None:
    matrices = {"T": POSES.transpose(0, 2, 1).reshape(60, 16), "R": Motion.R}[dataset]
    path = stored(tmp_path, {"ft/wrench": Motion.wrench, f"robot/{dataset}": matrices, "time": Motion.t})
    assert f"rename them, or --orientation {said}, or --wrench W.csv --pose P.csv (found ft/" in refusal(path)
    assert cw.read(path, said).R_base_flange == pytest.approx(Motion.R, abs=1e-12)


def test_poses_that_are_no_columns_stand_beside_an_orientation(tmp_path: Path) -> None:
    several = {"ft/wrench": Motion.wrench, "time": Motion.t, "quat_xyzw": QUAT, "robot_state/O_T_EE": POSES}
    assert cw.read(stored(tmp_path, several)).R_base_flange == pytest.approx(Motion.R, abs=1e-12)


@pytest.mark.parametrize("options", [{}, {"chunks": True, "compression": "gzip"}, {"dtype": "f4"}])
def test_datasets_bear_the_names_of_columns_whole_and_in_blocks(tmp_path: Path, options: dict[str, Any]) -> None:
    path = stored(tmp_path, dict(zip(HEADER, rows().T, strict=True)), "run.HDF5", **options)
    for n in (1, 7, 1000):
        found = joined(list(batches(path, rows=n)))
        if not options.get("dtype"):
            assert_same(found, Motion.R, slice(None))
        assert found.wrench.wrench == pytest.approx(Motion.wrench, rel=1e-6)


def test_the_columns_of_a_file_and_their_units(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = lab_file(tmp_path)
    out = run(capsys, "info", path).out.lower()
    assert out.startswith(
        f"{path}\ntable, 60 rows of 79 columns\n  ft/wrench[0:6], robot/r[0:9], robot/r_flat[0:9], "
        "robot/t_by_columns[0:16], robot/t_flat[0:16], robot/abc[0:3], robot/quat[0:4], robot/xyz_quat[0:7], "
        "robot/xyz_wxyz[0:7], short, time\n"
    )
    units = {"a": np.ones((2, 6)), "b": np.ones((2, 3)), "c": np.ones((2, 2)), "d": np.ones(2), "e": np.ones((2, 1))}
    stated = {"a": "N, Nm", "b": b"mm", "c": ["V", "A"], "d": "ms", "e": 3}
    path = stored(tmp_path, {name: (units[name], {"units": stated[name]}) for name in units})
    assert [*open_table(path).places] == [
        *("a[0] [N]", "a[1] [N]", "a[2] [N]", "a[3] [Nm]", "a[4] [Nm]", "a[5] [Nm]"),
        *("b[0] [mm]", "b[1] [mm]", "b[2] [mm]", "c[0] [V]", "c[1] [A]", "d [ms]", "e [3]"),
    ]
    assert [*open_table(path, Naming(hdf5="wrench=a,time=d", orientation=None)).places] == [
        *("fx [N]", "fy [N]", "fz [N]", "tx [Nm]", "ty [Nm]", "tz [Nm]", "t [ms]"),
    ]


TOLD = "expected to be told which orientation they are: say --orientation quat_xyzw, quat_wxyz or another"
OTHER = "name another with --hdf5"


@pytest.mark.parametrize(
    ("hdf5", "orientation", "message"),
    [
        ("pose=robot/quat", "auto", f"dataset robot/quat: found 4 numbers a row, {TOLD}"),
        ("pose=robot/xyz_quat", "auto", f"dataset robot/xyz_quat: found 7 numbers a row, {TOLD}"),
        ("pose=robot/abc", "auto", f"dataset robot/abc: found 3 numbers a row, {TOLD}"),
        (
            "pose=robot/R",
            "quat_xyzw",
            f"dataset robot/R: found shape (60, 3, 3), expected (n, 4), or 3 more with the position first: {OTHER}",
        ),
        ("wrench=robot/R,pose=robot/R", "auto", f"dataset robot/R: found shape (60, 3, 3), expected (n, 6): {OTHER}"),
        ("time=robot/abc", "auto", f"dataset robot/abc: found shape (60, 3), expected (n,): {OTHER}"),
        ("pose=robot/nix", "auto", f"found no dataset of numbers robot/nix, expected the one of the pose: {OTHER}"),
        ("pose=robot", "auto", f"found no dataset of numbers robot, expected the one of the pose: {OTHER}"),
        ("pose=note", "auto", f"found no dataset of numbers note, expected the one of the pose: {OTHER}"),
        (
            "pose=robot/R,time=short",
            "auto",
            "found 60 rows in ft/wrench and 7 in short, expected as many in each: export them on one clock, or as two "
            "files for --wrench and --pose",
        ),
        (
            "pose=time",
            "franka_matrix",
            f"dataset time: found shape (60,), expected (n, 16), or 3 more with the position first: {OTHER}",
        ),
    ],
)
def test_datasets_that_are_something_else_are_named(tmp_path: Path, hdf5: str, orientation: str, message: str) -> None:
    flag = hdf5 if hdf5.startswith("wrench") else f"wrench=/ft/wrench,{hdf5}"
    assert refusal(lab_file(tmp_path), hdf5=flag, orientation=orientation) == message


@pytest.mark.parametrize("hdf5", ["wrench", "wrench=", "=a", "pose=a,pose=b", "force=/a", "", "wrench=a;pose=b=c,"])
def test_a_flag_that_names_no_datasets_is_refused(tmp_path: Path, hdf5: str) -> None:
    assert refusal(lab_file(tmp_path), hdf5=hdf5) == (
        f"hdf5 is {hdf5!r}, expected wrench=/PATH,pose=/PATH,time=/PATH, or some of them, each once"
    )


def test_poses_at_the_origin_do_not_tell_rows_from_columns(tmp_path: Path) -> None:
    poses = POSES.copy()
    poses[:, :3, 3] = 0.0
    assert refusal(stored(tmp_path, {"w": Motion.wrench, "T": poses}), hdf5="wrench=w,pose=T") == (
        "dataset T: found 4 x 4 poses whose rows cannot be told from their columns, expected 0, 0, 0, 1 as the last "
        "row and a position: give the rotations alone"
    )


def test_the_flag_is_for_hdf5(tmp_path: Path) -> None:
    assert refusal(PANDA, hdf5="wrench=/a,pose=/b") == (
        "found no HDF5 file, and hdf5 wrench=/a,pose=/b, which is for those: leave it out"
    )


def demonstrations(folder: Path, parent: str = "data/", name: str = "demo_") -> Path:
    """A set as robomimic has it: an episode a group."""
    datasets: dict[str, Any] = {f"{parent}note": np.arange(3), "mask/train": np.array([b"demo_0"])}
    for episode, of_it in EPISODES.items():
        group = f"{parent}{name}{episode}"
        datasets |= {f"{group}/obs/ft": Motion.wrench[of_it], f"{group}/obs/R": Motion.R[of_it]}
        datasets |= {
            f"{group}/demo_0/deeper": np.arange(3),
            f"{group}/actions": np.zeros((of_it.stop - of_it.start, 7)),
        }
    return stored(folder, datasets, "set.hdf5")


EPISODES = {0: slice(0, 20), 2: slice(20, 45), 11: slice(45, 60)}
RELATIVE = "wrench=obs/ft,pose=obs/R"


@pytest.mark.parametrize(("parent", "name"), [("data/", "demo_"), ("", "episode_"), ("a/b/", "traj_")])
def test_one_recording_an_episode(tmp_path: Path, parent: str, name: str) -> None:
    path = demonstrations(tmp_path, parent, name)
    for episode, of_it in EPISODES.items():
        stated = ",".join(
            f"{role}=/{parent}{name}{episode}/obs/{what}" for role, what in (("wrench", "ft"), ("pose", "R"))
        )
        for found in (cw.read(path, hdf5=RELATIVE, episode=episode), cw.read(path, hdf5=stated)):
            assert np.array_equal(found.wrench, Motion.wrench[of_it])
            assert found.R_base_flange == pytest.approx(Motion.R[of_it], abs=1e-12)
    assert refusal(path, hdf5=RELATIVE) == (
        "found 3 episodes, 0, 2, 11, expected one recording: choose it, as with --episode 0; "
        "compensate --all-episodes takes each by itself"
    )
    assert refusal(path, hdf5=RELATIVE, episode=1) == (
        "found no episode 1, expected one that is there, as 0, 2, 11: choose with --episode"
    )


def test_all_episodes_of_a_set_are_compensated_in_the_order_of_their_numbers(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, tool, out = demonstrations(tmp_path), tmp_path / "tool.json", tmp_path / "out.csv"
    calibration = cw.calibrate(cw.read(PANDA))
    calibration.save(tool)
    wanted = ("--hdf5", RELATIVE, "--orientation", "matrix", "--all-episodes")
    done = run(capsys, "compensate", path, "-c", tool, *wanted, "-o", out)
    assert done.status == 0, done.err
    found = np.genfromtxt(out, delimiter=",", names=True, usecols=(0, 1, 2, 3))
    assert found["episode_index"].tolist() == np.repeat([0, 2, 11], [20, 25, 15]).tolist()
    forces = np.column_stack([found[name] for name in ("fx", "fy", "fz")])
    assert forces == pytest.approx(calibration.compensate(Motion.wrench, Motion.R)[:, :3], rel=1e-6, abs=1e-6)


def test_info_of_a_set(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = demonstrations(tmp_path)
    assert run(capsys, "info", path).out.startswith(
        f"{path}\nTable, 60 rows of 24 columns\n  actions[0:7], demo_0/deeper, obs/R[0:9], obs/ft[0:6], episode_index\n"
        "  3 episodes, 0, 2, 11: --episode N chooses one; times of the first:\n  no times"
    )


def test_episodes_that_differ_are_refused_where_they_are_read(tmp_path: Path) -> None:
    path = demonstrations(tmp_path)
    with h5py.File(path, "a") as file:
        del file["data/demo_2/obs/ft"]
    assert len(cw.read(path, hdf5=RELATIVE, episode=11)) == 15
    assert refusal(path, hdf5=RELATIVE, episode=2) == (
        f"found no dataset of numbers obs/ft, expected the one of the wrench: {OTHER}"
    )
    with h5py.File(path, "a") as file:
        file["other/demo_1/x"] = np.arange(3)
    assert refusal(path, hdf5=RELATIVE) == (
        "found the groups data/demo_0 and other/demo_1, expected the episodes of one set, each with its number: name "
        "the datasets with --hdf5"
    )


def test_gaps_and_bad_numbers_are_named_by_row(tmp_path: Path) -> None:
    values = rows()
    values[~Motion.posed, 7:] = np.nan
    path = stored(tmp_path, dict(zip(HEADER, values.T, strict=True)))
    assert_same(joined(list(batches(path, rows=7))), Motion.R, Motion.posed)
    for value, said in (
        (np.nan, "found no number, expected one: fill it in or leave the row out"),
        (-np.inf, "found -inf, expected a finite number: leave the row out"),
    ):
        values[32, 0] = value
        path = stored(tmp_path, dict(zip(HEADER, values.T, strict=True)), f"{value}.h5")
        with pytest.raises(FileFormatError) as caught:
            list(batches(path, rows=7))
        assert str(caught.value) == f"{path}: row 33, column t: {said}"


def test_two_files_of_different_clocks(tmp_path: Path) -> None:
    wrench = stored(tmp_path, {"t": Motion.t, **dict(zip(HEADER[1:7], Motion.wrench.T, strict=True))}, "w.h5")
    poses = stored(tmp_path, {"pose": POSES[::5], "time": Motion.t[::5]}, "p.h5")
    found = joined(list(batches(wrench, Options(pose_file=poses_as_columns(tmp_path, poses)), rows=9)))
    assert np.array_equal(found.wrench.wrench, Motion.wrench)
    assert found.orientation.R_base_flange == pytest.approx(Motion.R[::5], abs=1e-12)


@pytest.mark.parametrize("name", ["Units", "UNIT", "unit_of_measure", "physical_unit"])
def test_units_are_found_however_the_attribute_is_called(tmp_path: Path, name: str) -> None:
    """They were passed over: 12 N in mN became 12,000 N."""
    path = stored(tmp_path, {"a": (np.ones((2, 6)), {name: "mN, N m", "id": 3}), "d": (np.ones(2), {"limit": "ms"})})
    columns = "a[0] [mN]", "a[1] [mN]", "a[2] [mN]", "a[3] [N m]", "a[4] [N m]", "a[5] [N m]", "d"
    assert (*open_table(path).places,) == columns


@pytest.mark.parametrize("names", [["scale_factor"], ["add_offset"], ["scale_factor", "add_offset"]])
def test_packed_numbers_are_not_taken_for_what_they_stand_for(tmp_path: Path, names: list[str]) -> None:
    """Readings stored by half were read as half, and the fit was good."""
    packed = (0.5 * Motion.wrench, dict.fromkeys(names, 2.0))
    path = stored(tmp_path, {"ft": packed, "quat": QUAT, "t": Motion.t})
    assert refusal(path, hdf5="wrench=ft,pose=quat,time=t", orientation="quat_xyzw") == (
        f"dataset ft: found numbers packed by {' and '.join(names)}, expected those that they stand for: write them "
        "unpacked, times scale_factor, plus add_offset"
    )


def poses_as_columns(folder: Path, path: Path) -> Path:
    with h5py.File(path) as file:
        R: Array = file["pose"][:, :3, :3].reshape(-1, 9)
        return stored(folder, {"t": file["time"][:], **dict(zip(HEADER[7:16], R.T, strict=True))}, "columns.h5")


def test_files_that_are_no_hdf5(tmp_path: Path) -> None:
    good = lab_file(tmp_path).read_bytes()
    for content in (b"", b"fx,fy\n1,2\n", good[:500], good[:-2000]):
        path = tmp_path / "bad.h5"
        path.write_bytes(content)
        message = refusal(path)
        assert message.startswith("cannot be read as HDF5 (")
        assert message.endswith("), expected a whole HDF5 file: write it anew")
    assert refusal(stored(tmp_path, {"note": np.array([b"a"]), "one": 3.0, "image": np.zeros((2, 9, 9))})) == (
        "found no dataset of numbers (n,) or (n, k), expected one for each column or list: name them with --hdf5"
    )
    assert refusal(stored(tmp_path, {name: np.empty(0) for name in HEADER})) == (
        "found datasets and no rows, expected a row for each reading: add them"
    )


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    return demonstrations(tmp_path_factory.mktemp("whole")).read_bytes()


@given(data=st.data())
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_damaged_files_are_refused_in_one_line(tmp_path: Path, whole: bytes, data: st.DataObject) -> None:
    content = bytearray(whole)
    if data.draw(st.booleans()):
        content = content[: data.draw(st.integers(0, len(content)))]
    for _ in range(data.draw(st.integers(0, 3))):
        at = data.draw(st.integers(0, max(len(content) - 1, 0)))
        content[at : at + 2] = data.draw(st.binary(min_size=2, max_size=2))
    path = tmp_path / "damaged.h5"
    path.write_bytes(bytes(content))
    try:
        found = cw.read(path, hdf5=RELATIVE, episode=2)
    except ContactWrenchError as error:
        assert_one_line_that_names(error, path)
    else:
        assert np.isfinite(found.wrench).all()


def test_without_h5py_the_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = lab_file(tmp_path)
    for name in [name for name in sys.modules if name.partition(".")[0] == "h5py"]:
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(MissingExtraError) as caught:
        cw.read(path)
    assert str(caught.value) == "HDF5 needs h5py, which is not installed: pip install 'contactwrench[hdf5]'"


def test_calibrate_and_compensate_read_hdf5(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    panda = cw.read(PANDA)
    path = stored(tmp_path, {"ft": panda.wrench, "R": panda.R_base_flange})
    tool, out = tmp_path / "tool.json", tmp_path / "out.csv"
    assert run(capsys, "calibrate", path, "--hdf5", "wrench=/ft,pose=/R", "-o", tool).status == 0
    assert cw.Calibration.load(tool).weight == pytest.approx(cw.calibrate(panda).weight, rel=1e-9)
    done = run(capsys, "compensate", path, "--hdf5", "wrench=/ft,pose=/R", "-c", tool, "-o", out)
    assert done.status == 0
    assert len(out.read_text().splitlines()) == len(panda) + 1


def test_radians_that_are_read_in_degrees_are_said_of_the_datasets_that_were_chosen(tmp_path: Path) -> None:
    angles = np.random.default_rng(0).uniform(-3.0, 3.0, size=(60, 3))
    path = stored(tmp_path, {"ft/wrench": Motion.wrench, "robot/abc": angles, "robot/quat": QUAT})
    samples = cw.read(path, hdf5="wrench=/ft/wrench,pose=/robot/abc", orientation="kuka_abc")
    assert "likely in radians: none is beyond 3.15, and kuka_abc reads degrees" in samples.doubt
