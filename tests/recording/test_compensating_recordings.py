"""`compensate` on recordings: whatever they are written in, and what the flags ask for."""

from __future__ import annotations

from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import contactwrench as cw
from contactwrench.compensate.runner import compiled
from contactwrench.recording import compensate as compensation
from contactwrench.recording.bags.write import write_streams_bag
from contactwrench.recording.compensate import Treatment
from contactwrench.recording.options import Options
from contactwrench.recording.tables.columns import ROWS
from contactwrench.samples.samples import OrientationStream, Streams, WrenchStream
from contactwrench.simulate.trajectory import Push
from tests.support.in_motion import moving
from tests.support.live import RATE, calibrated, free, still, swinging, times
from tests.support.recordings import MATRIX, WRENCH, csv_text, run, written
from tests.support.world import Array

Capture = pytest.CaptureFixture[str]
N = 2000


def table(folder: Path, t: Array, wrench: Array, R: Array, name: str = "run.csv") -> Path:
    rows = np.column_stack([t, wrench, R.reshape(len(t), 9)])
    return written(folder, csv_text(("t", *WRENCH, *MATRIX), rows), name)


def tool(folder: Path) -> Path:
    calibrated(3)[0].save(folder / "tool.json")
    return folder / "tool.json"


@cache
def with_inertia() -> cw.Calibration:
    """Of the moving rig's tool."""
    return cw.calibrate(moving(7, stops=8, seconds=12.0, rate=250.0).samples(), "dynamic")


def test_a_folder_goes_to_stdout(tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("rosbags", reason="rosbags is not installed")
    monkeypatch.chdir(tmp_path)
    _, rig, rng = calibrated(3)
    t, R = times(N), swinging(rng, N)
    write_streams_bag(tmp_path / "bag", Streams(WrenchStream(t, free(rig, R, rng)), OrientationStream(t, R)))
    done = run(capsys, "compensate", "bag", "-c", tool(tmp_path), "-o", "-")
    assert done.status == 0
    assert len(done.out.splitlines()) == 1 + N
    assert not (tmp_path / "-").exists()


@pytest.mark.slow
def test_a_delay_that_is_stated_counts_wherever_the_motion_begins(
    tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The arm stands still for longer than what is read at once."""
    monkeypatch.setattr(compensation, "ROWS", 2000)
    _, rig, rng = calibrated(3)
    rest, turn = 3400, np.deg2rad(60.0) * np.arange(1000) / RATE
    about_y = Rotation.from_rotvec(np.outer(np.r_[np.zeros(rest), turn], [0, 1, 0]))
    way = Rotation.from_matrix(still(rng, 1)[0]) * about_y
    R = way.as_matrix()
    lag = np.maximum(np.arange(len(R)) - 50, 0)
    path = table(tmp_path, times(len(R)), free(rig, R[lag], rng, 0.01), R)
    assert (
        run(capsys, "compensate", path, "-c", tool(tmp_path), "-o", tmp_path / "o.csv", "--delay", "0.05").status == 0
    )
    left = np.genfromtxt(tmp_path / "o.csv", delimiter=",", skip_header=1, usecols=range(1, 7))
    assert len(left) == len(R)
    moving = np.ptp(left[rest + 100 :, :3], axis=0).max()
    without = np.ptp(calibrated(3)[0].compensate(free(rig, R[lag], rng, 0.01), R)[rest + 100 :, :3], axis=0).max()
    assert moving < 0.3 * without


def test_noise_from_a_table_beside_two_files(tmp_path: Path, capsys: Capture) -> None:
    _, rig, rng = calibrated(3)
    t, R = times(N), swinging(rng, N)
    wrench = written(tmp_path, csv_text(("t", *WRENCH), np.column_stack([t, free(rig, R, rng)])), "w.csv")
    pose = written(tmp_path, csv_text(("t", *MATRIX), np.column_stack([t, R.reshape(N, 9)])), "p.csv")
    quiet = table(tmp_path, t + 5000.0, free(rig, R, rng), R, "free.csv")
    done = run(
        capsys,
        *("compensate", "--wrench", wrench, "--pose", pose, "-c", tool(tmp_path)),
        *("-o", tmp_path / "o.csv", "--contact", "--noise", quiet),
    )
    assert done.status == 0, done.err


def test_noise_from_a_free_motion_beside_an_inertia_is_what_that_leaves(tmp_path: Path, capsys: Capture) -> None:
    """Not what the inertia does, which is 20 times as much; a push of 5 N is felt."""
    with_inertia().save(tmp_path / "swing.json")
    push = Push(2.0, 2.6, np.array([3.0, 0.0, 4.0]))
    paths = []
    for seed, pushes in ((31, ()), (32, (push,))):
        arm = moving(seed, stops=0, seconds=5.0, rate=250.0, pushes=pushes)
        rec = arm.recorded
        columns = np.column_stack([rec.t, rec.wrench, rec.position, rec.R_base_flange.reshape(-1, 9)])
        names = ("t", *WRENCH, "x", "y", "z", *MATRIX)
        paths.append(written(tmp_path, csv_text(names, columns), f"{seed}.csv"))
    into = ("-c", tmp_path / "swing.json", "-o", tmp_path / "o.csv", "--contact", "--noise", paths[0])
    assert run(capsys, "compensate", paths[1], *into).status == 0
    left = np.genfromtxt(tmp_path / "o.csv", delimiter=",", names=True)
    assert np.nanmedian(left["fx_std"]) == pytest.approx(0.05, rel=0.2)
    assert (left["contact"][np.abs(left["t"] - arm.begin - 2.3) < 0.2] == 1).all()


@pytest.mark.skipif(find_spec("numba") is None, reason="numba is not installed")
def test_many_rows_are_stepped_through_compiled_and_few_where_that_is_at_hand(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Beside an inertia all rows are read at once, and many took five times as long, in plain Python."""
    rec = moving(33, stops=0, seconds=5.0, rate=250.0).recorded
    columns = np.column_stack([rec.t, rec.wrench, rec.position, rec.R_base_flange.reshape(-1, 9)])
    path = written(tmp_path, csv_text(("t", *WRENCH, "x", "y", "z", *MATRIX), columns))
    asked, found = list[bool | None](), list[Array]()

    def made(*given: Any, fast: bool | None, **stated: Any) -> cw.Compensator:
        asked.append(fast)
        return cw.Compensator(*given, fast=fast, **stated)

    monkeypatch.setattr(compensation, "Compensator", made)
    compiled.cache_clear()
    for rows in (ROWS, len(rec.t) // 2, ROWS):
        monkeypatch.setattr(compensation, "ROWS", rows)
        done = compensation.compensated(path, Options(), with_inertia(), Treatment(judged=True, noise=np.full(6, 0.05)))
        found.append(np.concatenate([each.wrench for each in done]))
    assert asked == [False, None, None]
    assert all(np.array_equal(each, found[0], equal_nan=True) for each in found)


def test_an_inertia_takes_poses_at_their_pace_whatever_their_stamps(tmp_path: Path) -> None:
    """Sent at 62.5 Hz and stamped as they came, some ms early or late: of free air no more is left than the noise."""
    rec = moving(33, stops=0, seconds=5.0, rate=250.0).recorded
    t = rec.t[::4] + np.random.default_rng(1).uniform(-0.004, 0.004, len(rec.t[::4]))
    wrench = written(tmp_path, csv_text(("t", *WRENCH), np.column_stack([rec.t, rec.wrench])), "w.csv")
    columns = np.column_stack([t, rec.position[::4], rec.R_base_flange[::4].reshape(-1, 9)])
    pose = written(tmp_path, csv_text(("t", "x", "y", "z", *MATRIX), columns), "p.csv")
    found = list(compensation.compensated(wrench, Options(pose_file=pose), with_inertia(), Treatment()))
    force = np.concatenate([each.wrench for each in found])[100:-100, :3]
    assert np.sqrt(np.mean(np.sum(force**2, axis=1))) < 1.5 * np.sqrt(3.0) * 0.05


def test_a_contact_that_lasts_to_the_end_goes_to_parquet(tmp_path: Path, capsys: Capture) -> None:
    pa, pq = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    _, rig, rng = calibrated(3)
    t, R = times(N), swinging(rng, N)
    wrench = free(rig, R, rng)
    wrench[-200:, 0] += 3.0
    columns = np.column_stack([t, wrench, R.reshape(N, 9)])
    names = ("t", *WRENCH, *MATRIX)
    pq.write_table(pa.table({name: columns[:, k] for k, name in enumerate(names)}), tmp_path / "run.parquet")
    done = run(
        capsys,
        *("compensate", tmp_path / "run.parquet", "-c", tool(tmp_path), "-o", tmp_path / "o.parquet"),
        *("--contact", "--noise", "0.06"),
    )
    assert done.status == 0, done.err
    touching = pq.read_table(tmp_path / "o.parquet")["contact_contact"].to_pylist()
    assert touching == [False] * (N - 195) + [True] * 195  # after 5 ms it is a contact
