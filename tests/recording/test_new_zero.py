"""`compensate --zero S`: each recording has a zero of its own, told by its first seconds."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import contactwrench as cw
from tests.support.recordings import MATRIX, WRENCH, Run, csv_text, run, written
from tests.support.rigs import example
from tests.support.world import Array, Rig, noisy_readings, random_rotations

Capture = pytest.CaptureFixture[str]
RATE, N, REST = 50.0, 400, 75
NOISE = np.array([0.05, 0.05, 0.05, 0.002, 0.002, 0.002])
SHIFT = np.array([0.6, -0.4, 0.5, 0.03, -0.02, 0.01])
SETS = 3
AXES = ("fx", "fy", "fz", "tx", "ty", "tz")


@cache
def tool() -> tuple[Rig, cw.Calibration]:
    rig, R, rng = example(6, poses=16)
    return rig, cw.calibrate(cw.Samples(noisy_readings(rig, R, 0.1 * NOISE, rng), R))


def episode(seed: int, bias: Array, moves_from: int = REST) -> Array:
    """Rows of t, readings and matrices of a free tool: at rest for 1.5 s, then turning; its bias `bias` off."""
    rng = np.random.default_rng(seed)
    start, turn = random_rotations(1, rng)[0], rng.normal(size=3)
    way = 0.02 * np.maximum(np.arange(N) - moves_from, 0)[:, None] * turn / np.linalg.norm(turn)
    R = start @ Rotation.from_rotvec(way).as_matrix()
    wrench = noisy_readings(tool()[0], R, NOISE, rng) + bias
    return np.column_stack([np.arange(N) / RATE, wrench, R.reshape(N, 9)])


def compensated(folder: Path, capsys: Capture, rows: Array, *more: str) -> Run:
    """A table of `episode` rows, a set where there is a column more, through the program into `out.csv`."""
    tool()[1].save(folder / "tool.json")
    header = ("t", *WRENCH, *MATRIX, "episode_index")[: rows.shape[1]]
    path = written(folder, csv_text(header, rows), "run.csv")
    return run(capsys, "compensate", path, "-c", folder / "tool.json", "-o", folder / "out.csv", "--force", *more)


def left(folder: Path) -> Array:
    table = np.genfromtxt(folder / "out.csv", delimiter=",", names=True)
    return np.column_stack([table[axis] for axis in AXES])


@pytest.mark.parametrize("judged", [(), ("--contact", "--noise", "0.05")])
def test_the_bias_of_a_recording_is_that_of_its_first_second(
    tmp_path: Path, capsys: Capture, judged: tuple[str, ...]
) -> None:
    assert compensated(tmp_path, capsys, episode(1, SHIFT), *judged).status == 0
    assert left(tmp_path)[REST:].mean(axis=0) == pytest.approx(SHIFT, abs=0.1)
    assert compensated(tmp_path, capsys, episode(1, SHIFT), *judged, "--zero", "1").status == 0
    assert np.abs(left(tmp_path)[REST:].mean(axis=0) / NOISE).max() < 1.0


def test_each_of_a_set_has_its_own(tmp_path: Path, capsys: Capture) -> None:
    rows = np.vstack([np.column_stack([episode(k, k * SHIFT), np.full(N, k)]) for k in range(SETS)])
    done = compensated(tmp_path, capsys, rows, "--all-episodes", "--contact", "--noise", "0.05", "--zero", "1.2")
    assert done.status == 0, done.err
    assert "no contact" in done.out + done.err
    assert np.abs(left(tmp_path).reshape(SETS, N, 6).mean(axis=1) / NOISE).max() < 1.0


def test_a_beginning_that_moves_or_is_short_is_no_zero(tmp_path: Path, capsys: Capture) -> None:
    moving, path = episode(2, SHIFT, moves_from=0), tmp_path / "run.csv"
    assert compensated(tmp_path, capsys, moving, "--zero", "1").complaint == (
        f"{path}, its first 1 s: no new zero: the arm turns by 56 deg in these samples, expected at most 0.2; hold it "
        "still"
    )
    assert compensated(tmp_path, capsys, moving, "--zero", "0.1").complaint == (
        f"{path}, its first 0.1 s: no new zero: found 5 samples, expected at least 10 at rest"
    )
