"""MAT-files of version 7.3, made as MATLAB makes them (HDF5 behind 512 bytes, dimensions the other way round), against
what was put in; others say what to do.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat
from scipy.spatial.transform import Rotation

import contactwrench as cw
from contactwrench.errors import ContactWrenchError
from tests.support.recordings import Array, run, written

h5py = pytest.importorskip("h5py", reason="h5py is not installed")

POSES = cw.read(Path(cw.__file__).parent / "data" / "panda_mini45.csv")
W, R, N = POSES.wrench, POSES.R_base_flange, len(POSES)
Q = Rotation.from_matrix(R).as_quat()
T = np.tile(np.eye(4), (N, 1, 1))
T[:, :3, :3], T[:, :3, 3] = R, [0.4, 0.1, 0.3]
BY_NAME = {"wrench_columns": "W[0:6]", "orientation": "quat_xyzw:Q[0:4]"}
START = b"MATLAB 7.3 MAT-file, Platform: GLNXA64 HDF5 schema 1.00 ."


def saved(
    folder: Path, arrays: dict[str, Array], name: str = "run.mat", kind: str = "double", packed: bool = False
) -> Path:
    """Arrays as MATLAB has them."""
    options = {"chunks": True, "compression": "gzip"} if packed else {}
    with h5py.File(folder / name, "w", userblock_size=512) as file:
        for path, values in arrays.items():
            dataset = file.create_dataset(path, data=np.atleast_2d(values).T, **options)
            dataset.attrs["MATLAB_class"] = np.bytes_(kind)
    content = (folder / name).read_bytes()
    (folder / name).write_bytes(START.ljust(124) + b"\0\2IM" + content[128:])
    return folder / name


def assert_read(path: Path, **options: str) -> None:
    found = cw.read(path, **options)  # type: ignore[arg-type]
    assert np.array_equal(found.wrench, W)
    assert found.R_base_flange == pytest.approx(R, abs=1e-12)


@pytest.mark.parametrize("packed", [False, True])
@pytest.mark.parametrize("name", ["run.mat", "run.h5"])
def test_rows_and_columns_are_those_of_matlab(tmp_path: Path, name: str, packed: bool) -> None:
    t = np.arange(float(N))[:, None] * 0.5
    for wrench, quaternion, times in ((W, Q, t), (W.T, Q.T, t.T)):
        path = saved(tmp_path, {"W": wrench, "Q": quaternion, "t": times}, name, packed=packed)
        assert_read(path, **BY_NAME)
        assert_read(path, hdf5="wrench=/W,pose=/Q,time=/t", orientation="quat_xyzw")
        assert cw.read(path, hdf5="wrench=/W,pose=/Q,time=/t", orientation="quat_xyzw").t == pytest.approx(t[:, 0])


@pytest.mark.parametrize(("name", "poses"), [("R", R), ("T", T)])
def test_rotations_are_not_transposed(tmp_path: Path, name: str, poses: Array) -> None:
    """As .h5 a 3 x 3 x n was read by columns: the inverse orientation."""
    for each in (poses, poses.transpose(1, 2, 0)):
        path = saved(tmp_path, {"s/W": W, f"s/{name}": each}, "run.h5")
        assert_read(path, hdf5=f"wrench=/s/W,pose=/s/{name}")
        if name == "R":
            assert_read(path, wrench_columns="s/W[0:6]", orientation="matrix:s/R[0:9]")


def test_vectors_are_columns_by_their_names(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    names = ("fx", "fy", "fz", "tx", "ty", "tz", "qx", "qy", "qz", "qw")
    path = saved(tmp_path, {name: column[:, None] for name, column in zip(names, np.hstack([W, Q]).T, strict=True)})
    assert_read(path)
    assert run(capsys, "info", path).out.startswith(f"{path}\nTable, {N} rows of 10 columns\n")


def test_what_is_no_recording_is_left_alone(tmp_path: Path) -> None:
    path = saved(tmp_path, {"W": W, "Q": Q, "stiffness": np.eye(6), "mass": np.array([[1.2]]), "#refs#/a": Q})
    with h5py.File(path, "r+") as file:
        for name, kind in (("title", "char"), ("log", "table"), ("none", "double")):
            file[name] = np.zeros((1, 30), np.uint16)
            file[name].attrs["MATLAB_class"] = np.bytes_(kind)
        file["none"].attrs["MATLAB_empty"] = 1
    assert_read(path, **BY_NAME)
    with pytest.raises(ContactWrenchError) as caught:
        cw.read(path)
    assert str(caught.value).endswith("(found Q[0:4], W[0:6])")


def refusal(path: Path, **options: str) -> str:
    with pytest.raises(ContactWrenchError) as caught:
        cw.read(path, **options)  # type: ignore[arg-type]
    return str(caught.value).removeprefix(f"{path}: ")


def test_rows_that_cannot_be_told_are_refused(tmp_path: Path) -> None:
    path = saved(tmp_path, {"W": W[:6], "Q": Q[:6]})
    assert refusal(path, hdf5="wrench=/W,pose=/Q", orientation="quat_xyzw") == (
        "dataset W: found 6 x 6 numbers of MATLAB, whose rows cannot be told from their columns, expected more rows "
        "than columns: add rows, or write them as CSV"
    )
    for few in range(1, 6):
        assert refusal(saved(tmp_path, {"W": W[:few], "Q": Q[:few]}), **BY_NAME).startswith("found no column W")


def test_other_files_say_what_to_do(tmp_path: Path) -> None:
    savemat(tmp_path / "old.mat", {"W": W, "Q": Q})
    assert refusal(tmp_path / "old.mat") == (
        "found a MAT-file before version 7.3, expected that, which is HDF5: write it in MATLAB with save(..., "
        "'-v7.3'), or as CSV with writetable; in Python contactwrench.Samples takes arrays"
    )
    for name in ("old.mat", "new.mat"):
        content = saved(tmp_path, {"W": W}, "new.mat").parent / name
        assert refusal(written(tmp_path, content.read_bytes())) == "found a MAT-file, expected text: name it .mat"
    np.save(tmp_path / "run.npy", W)
    said = "found an array of numpy, expected text: write it with numpy.savetxt"
    assert refusal(written(tmp_path, (tmp_path / "run.npy").read_bytes())) == said
    assert refusal(written(tmp_path, b"no HDF5", "text.mat")).startswith("cannot be read as HDF5")
