"""Times without a unit that are no seconds: said with the flag that reads them, or refused where two files differ."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import contactwrench as cw
from contactwrench.calibration.findings import Kind
from tests.support.recordings import WRENCH, csv_text, run, written
from tests.support.rigs import NOISE, example
from tests.support.world import Array, readings
from tests.support.written import QUAT, quat


def _streams(seconds: float = 40.0) -> tuple[Array, Array, Array]:
    """Times (n,) s at 20 Hz of poses held for 2 s each, the wrench and the quaternion of each."""
    t = np.arange(0.0, seconds, 0.05)
    rig, R, rng = example(3, poses=int(seconds / 2.0))
    held = R[(t / 2.0).astype(int)]
    return t, readings(rig, held) + NOISE * rng.normal(size=(len(t), 6)), quat(held)


def _timed(tmp_path: Path, per_s: float) -> Path:
    t, wrench, q = _streams()
    return written(tmp_path, csv_text(("Time", *WRENCH, *QUAT), np.column_stack([per_s * t, wrench, q])))


def test_times_that_are_likely_no_seconds_are_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, tool = _timed(tmp_path, 1e3), tmp_path / "tool.json"
    said = (
        "Note: the times Time are likely in ms: read as s, 800 rows come 50 s apart: read them with --units time=ms; "
        "if they are seconds, say --units time=s\n"
    )
    assert said in run(capsys, "calibrate", path, "-o", tool, "--model", "mount").err
    for verb in ("compensate", "verify"):
        assert said in run(capsys, verb, path, "-c", tool).err
        assert "likely in" not in run(capsys, verb, path, "-c", tool, "--units", "time=ms").err


@pytest.mark.parametrize(("unit", "per_s"), [("us", 1e6), ("ns", 1e9)])
def test_times_for_which_nobody_waits_are_refused_unless_they_are_stated(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], unit: str, per_s: float
) -> None:
    tool = tmp_path / "tool.json"
    assert run(capsys, "calibrate", _timed(tmp_path, 1.0), "-o", tool, "--model", "mount").status == 0
    path = _timed(tmp_path, per_s)
    said = (
        f": found 800 rows {0.05 * per_s:g} s apart by the times Time, expected seconds: read them with --units "
        f"time={unit}; if they are seconds, say --units time=s\n"
    )
    for arguments in (("calibrate", path), ("compensate", path, "-c", tool), ("verify", path, "-c", tool)):
        refused = run(capsys, *arguments)
        assert (refused.status, refused.err.endswith(said)) == (2, True)
        assert said not in run(capsys, *arguments, "--units", f"time={unit}").err
        assert said not in run(capsys, *arguments, "--units", "time=s").err


@pytest.mark.parametrize("t", [np.arange(0.0, 40.0, 0.05), np.arange(0.0, 2000.0, 10.3), np.arange(0.0, 2000.0, 10.0)])
def test_seconds_are_left_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str], t: Array) -> None:
    rig, R, _ = example(3, poses=12)
    R = R[np.arange(len(t)) * 12 // len(t)]
    path = written(tmp_path, csv_text(("t", *WRENCH, *QUAT), np.column_stack([t, readings(rig, R), quat(R)])))
    done = run(capsys, "calibrate", path, "--model", "mount")
    assert "likely in" not in done.err


@pytest.mark.parametrize("in_ms", ["wrench", "orientation"])
def test_two_files_of_which_one_is_in_ms(tmp_path: Path, capsys: pytest.CaptureFixture[str], in_ms: str) -> None:
    t, wrench, q = _streams()
    per_s = {"wrench": 1.0, "orientation": 1.0, in_ms: 1e3}
    of_wrench = csv_text(("t", *WRENCH), np.column_stack([per_s["wrench"] * t, wrench]))
    of_pose = csv_text(("t", *QUAT), np.column_stack([per_s["orientation"] * t, q]))
    files = written(tmp_path, of_wrench, "w.csv"), written(tmp_path, of_pose, "p.csv")
    done = run(capsys, "calibrate", "--wrench", files[0], "--pose", files[1])
    assert done.status == 2
    assert done.err.splitlines()[-1].endswith(
        f"and they have only 40 s in common: the {in_ms}'s stamps look like ms, 1000 times as long, give them in s, or "
        "name their column t_ms"
    )


@pytest.mark.parametrize(("per_s", "step", "unit"), [(1e3, "50", "ms"), (1e6, "50000", "us"), (1.0, "", "")])
def test_arrays_with_times_that_are_likely_no_seconds(per_s: float, step: str, unit: str) -> None:
    t, wrench, q = _streams()
    found = cw.calibrate(cw.Samples(wrench, q, np.round(per_s * t, 3)), model="mount").findings
    said = f"t is likely in {unit}, expected s: 800 samples would come {step} s apart; if they do not, give it in s"
    assert [each.text for each in found if each.kind is Kind.TIMES_IN_DOUBT] == [said] * bool(unit)
