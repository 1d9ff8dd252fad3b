"""A table without times whose rows came at a rate that somebody states."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import contactwrench as cw
from contactwrench.errors import InputError
from tests.recording.test_missing_readings import Capture, N, calibrated, recorded, rows_of
from tests.support.recordings import MATRIX, WRENCH, csv_text, run, written
from tests.support.world import Array

HZ = 100.0


def timeless(folder: Path, wrench: Array, R: Array, kind: str = "csv") -> Path:
    columns = np.column_stack([wrench, R.reshape(-1, 9)])
    if kind == "csv":
        return written(folder, csv_text((*WRENCH, *MATRIX), columns), "timeless.csv")
    h5py = pytest.importorskip("h5py")
    with h5py.File(folder / "timeless.h5", "w") as file:
        for k, half in enumerate((slice(None, N // 2), slice(N // 2, None))):
            file[f"data/demo_{k}/wrench"] = wrench[half]
            file[f"data/demo_{k}/rotation"] = R[half].reshape(-1, 9)
    return folder / "timeless.h5"


def test_its_rows_have_the_times_of_their_numbers(tmp_path: Path) -> None:
    t, wrench, R = recorded(5)
    samples = cw.read(timeless(tmp_path, wrench, R), rate=HZ)
    assert samples.t == pytest.approx(t)
    assert samples.read_as["rate"] == HZ
    assert samples.wrench == pytest.approx(wrench)
    assert cw.read(timeless(tmp_path, wrench, R)).t is None


def test_it_is_calibrated_and_compensated_as_one_with_times(tmp_path: Path, capsys: Capture) -> None:
    t, wrench, R = recorded(6)
    timed = written(tmp_path, csv_text(("t", *WRENCH, *MATRIX), np.column_stack([t, wrench, R.reshape(-1, 9)])))
    for path, how, name in ((timed, (), "a"), (timeless(tmp_path, wrench, R), ("--rate", "100"), "b")):
        done = run(capsys, "calibrate", path, *how, "-o", tmp_path / f"{name}.json")
        assert done.status == 0, done.err
        out = tmp_path / f"{name}.csv"
        done = run(capsys, "compensate", path, *how, "-c", tmp_path / f"{name}.json", "--contact", "-o", out)
        assert done.status == 0, done.err
    a, b = (cw.Calibration.load(tmp_path / f"{name}.json") for name in "ab")
    assert b.weight == pytest.approx(a.weight, abs=1e-9)
    assert b.std["weight"] == pytest.approx(a.std["weight"])
    assert rows_of(tmp_path / "a.csv") == rows_of(tmp_path / "b.csv")


def test_each_episode_of_a_set_begins_at_its_own_first_row(tmp_path: Path, capsys: Capture) -> None:
    _, wrench, R = recorded(7)
    path, tool = timeless(tmp_path, wrench, R, "h5"), calibrated(tmp_path, 7)
    how = ("--hdf5", "wrench=wrench,pose=rotation", "--orientation", "matrix", "--rate", "100", "--contact")
    out = tmp_path / "out.csv"
    done = run(capsys, "compensate", path, *how, "--all-episodes", "-c", tool, "-o", out)
    assert done.status == 0, done.err
    assert [float(row["t"]) for row in rows_of(out)] == pytest.approx(np.tile(np.arange(N // 2) / HZ, 2))


def test_beside_times_it_is_refused_unless_these_are_left_alone(tmp_path: Path, capsys: Capture) -> None:
    t, wrench, R = recorded(8)
    columns = np.column_stack([t, wrench, R.reshape(-1, 9)])
    path = written(tmp_path, csv_text(("Time [s]", *WRENCH, *MATRIX), columns))
    done = run(capsys, "calibrate", path, "--rate", "50")
    assert done.complaint == (
        f'{path}: found the times t from "Time [s]", and --rate 50, expected one of them: leave out --rate, or the '
        "times with --time-column none"
    )
    assert cw.read(path, rate=50.0, time_column="none").t == pytest.approx(2.0 * t)
    with pytest.raises(InputError) as error:
        cw.read(path, rate=-50.0)
    assert str(error.value) == "rate is -50, expected 0.001 to 1e+06 Hz"


def test_a_bag_has_times(tmp_path: Path, capsys: Capture) -> None:
    from tests.support.bags import recording, write_mcap

    bag = write_mcap(tmp_path / "run.mcap", recording(20)[0])
    done = run(capsys, "calibrate", bag, "--rate", "50")
    assert done.complaint == f"{bag}: found a bag, and rate 50.0, which is for tables: leave it out"


def test_two_files_have_times_of_their_own(tmp_path: Path, capsys: Capture) -> None:
    _, wrench, R = recorded(9)
    path = timeless(tmp_path, wrench, R)
    done = run(capsys, "calibrate", "--wrench", path, "--pose", path, "--rate", "100")
    assert done.complaint == "found two files and rate 100, expected times in each: leave it out"
