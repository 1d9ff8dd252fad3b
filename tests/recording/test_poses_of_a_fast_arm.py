"""`compensate` beside an inertia, where the poses of a fast arm are stamped as they came, or are rare."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

import contactwrench as cw
from contactwrench.samples.samples import OrientationStream, Streams, WrenchStream
from contactwrench.samples.synchronize import synchronize
from contactwrench.simulate.kinematics import HOME
from contactwrench.simulate.recording import Recorded, record_motion
from contactwrench.simulate.settings import Settings, changed
from contactwrench.simulate.trajectory import Push, stopping
from tests.support.in_motion import TOOL, moving
from tests.support.recordings import MATRIX, WRENCH, csv_text, run, written
from tests.support.world import Array

Capture = pytest.CaptureFixture[str]
RATE = 500.0


@lru_cache
def of_exact_poses() -> cw.Calibration:
    return cw.calibrate(moving(7, stops=8, seconds=12.0, rate=RATE).samples(), "dynamic")


@lru_cache
def at_work(seed: int, pushes: tuple[Push, ...] = ()) -> Recorded:
    """From place to place in 0.7 s, with short stops: the jerk jumps at both ends of each move."""
    rng = np.random.default_rng(seed)
    reach = np.array([0.3, 0.2, 0.3, 0.25, 0.4, 0.25, 0.4])
    goals = HOME + rng.uniform(-reach, reach, size=(16, 7))
    settings = changed(Settings(), [*TOOL, f"recording.rate={RATE}"])
    return record_motion(settings, stopping(goals, 0.7, 0.5, RATE), pushes=pushes, rng=rng)


def compensated(
    folder: Path, capsys: Capture, rec: Recorded, pose_rate: float, jitter: float
) -> tuple[dict[str, Array], str]:
    """What becomes of it, in columns, and what is said."""
    of_exact_poses().save(folder / "tool.json")
    rows = slice(None, None, round(RATE / pose_rate))
    rng = np.random.default_rng(3)
    came = np.sort(rec.t[rows] + jitter * rng.normal(size=len(rec.t[rows])))
    poses = np.column_stack([came, rec.position[rows], rec.R_base_flange[rows].reshape(-1, 9)])
    wrench = written(folder, csv_text(("t", *WRENCH), np.column_stack([rec.t, rec.wrench])), "w.csv")
    pose = written(folder, csv_text(("t", "x", "y", "z", *MATRIX), poses), "p.csv")
    into = ("-c", folder / "tool.json", "-o", folder / "o.csv", "--contact")
    done = run(capsys, "compensate", "--wrench", wrench, "--pose", pose, *into)
    assert done.status == 0, done.err
    found = np.genfromtxt(folder / "o.csv", delimiter=",", names=True, usecols=range(15))
    return {name: found[name] for name in found.dtype.names or ()}, done.err


@pytest.mark.parametrize(("pose_rate", "jitter"), [(125.0, 0.0), (125.0, 0.0015), (31.25, 0.0)])
def test_free_motion_is_no_contact(tmp_path: Path, capsys: Capture, pose_rate: float, jitter: float) -> None:
    found, said = compensated(tmp_path, capsys, at_work(5), pose_rate, jitter)
    known = np.isfinite(found["fx_std"])
    z = np.abs([found[name][known] / found[f"{name}_std"][known] for name in WRENCH])
    assert known.mean() > 0.95
    assert not (found["contact"] == 1).any()
    assert z.max() < 5.0
    assert np.sqrt(np.mean(z**2)) > 0.3
    assert "last for less than" not in said


def test_a_push_while_the_poses_jitter_is_felt(tmp_path: Path, capsys: Capture) -> None:
    push = Push(4.0, 4.6, np.array([3.0, 0.0, 4.0]))
    rec = at_work(6, (push,))
    found, _ = compensated(tmp_path, capsys, rec, 125.0, 0.001)
    pushed = (found["t"] > push.t_start + 0.05) & (found["t"] < push.t_end)
    assert (found["contact"][pushed] == 1).all()
    assert not (found["contact"][np.abs(found["t"] - 4.3) > 0.6] == 1).any()


def test_stamps_that_are_those_of_the_motion_stay() -> None:
    """Poses that are taken at uneven times, and stamped so."""
    rec, rng = at_work(5), np.random.default_rng(4)
    taken = np.sort(rng.choice(len(rec.t), len(rec.t) // 3, replace=False))
    taken = np.r_[0, taken[(taken > 0) & (taken < len(rec.t) - 1)], len(rec.t) - 1]
    uneven = replace(rec, t=rec.t[taken], R_base_flange=rec.R_base_flange[taken], position=rec.position[taken])
    wrench = WrenchStream(rec.t, rec.wrench)
    even, found = (
        synchronize(Streams(wrench, OrientationStream(r.t, r.R_base_flange, r.position)), at_their_pace=True).samples
        for r in (rec, uneven)
    )
    assert np.abs(found.R_base_flange - even.R_base_flange).max() < 2e-3
