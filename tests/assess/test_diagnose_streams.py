"""Diagnosis of recordings through the moves of the arm: the poses are the still segments that `calibrate` finds."""

from __future__ import annotations

import json
import shlex
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from contactwrench.errors import FileFormatError
from contactwrench.recording.interpretations import interpretations
from contactwrench.recording.options import Options
from tests.support.recordings import WRENCH, csv_text, written
from tests.support.recordings import run as program
from tests.support.runs import run
from tests.support.world import Array
from tests.support.written import QUAT, Written, euler, in_base_axes, quat

TOOL_WEIGHT = 9.80665
STOPS = 8


@dataclass(frozen=True, eq=False)
class Moved:
    """A kilogram moved between stops of 1.2 s, at 100 Hz."""

    t: Array
    wrench: Array
    R: Array


@pytest.fixture(scope="module")
def moved() -> Moved:
    samples = run(stops=STOPS, stop=1.2, move=1.0, rate=100.0).samples
    assert samples.t is not None
    return Moved(samples.t, samples.wrench, samples.R_base_flange)


STREAMS = {  # reactions and inverse orientations are in the bag below
    "fanuc as kuka": (Written(("a", "b", "c"), euler("xyz")), "--orientation fanuc_wpr:a,b,c"),
    "scalar first": (Written(QUAT, lambda R: quat(R)[:, [3, 0, 1, 2]]), "--orientation quat_wxyz:qx,qy,qz,qw"),
    "base axes": (Written(QUAT, quat, in_base_axes), "--wrench-frame base"),
}


@pytest.mark.parametrize("mistake", STREAMS)
def test_a_stream_read_wrongly_is_mended_by_the_flags(
    mistake: str, moved: Moved, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    wrong, flags = STREAMS[mistake]
    rows = np.column_stack([moved.t, wrong.wrench(moved.R, moved.wrench), wrong.numbers(moved.R)])
    path = written(tmp_path, csv_text(("t", *WRENCH, *wrong.columns), rows))
    found = json.loads(program(capsys, "diagnose", path, "--json").out)
    assert found["n"] == STOPS
    assert " ".join(found["best"]["flags"]) == flags
    assert found["best"]["mends"] == []
    calibration = json.loads(program(capsys, "calibrate", path, "--model", "mount", *shlex.split(flags), "--json").out)
    assert calibration["verdict"] == "good"
    assert calibration["weight"] == pytest.approx(TOOL_WEIGHT, abs=0.1)


def test_columns_times_and_units_that_options_state_are_kept(
    moved: Moved, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    names = ("g1", "g2", "g3", "g4", "g5", "g6")
    wrench = moved.wrench * np.repeat([1e-3, 1e3], 3)
    rows = np.column_stack([1e3 * moved.t, wrench, euler("xyz")(moved.R)])
    path = written(tmp_path, csv_text(("when", *names, "a", "b", "c"), rows))
    stated = ("--wrench-columns", ",".join(names), "--time-column", "when:ms")
    found = json.loads(program(capsys, "diagnose", path, *stated, "--units", "force=kN,torque=Nm", "--json").out)
    flags = ["--orientation fanuc_wpr:a,b,c", "--units force=kn,torque=Nmm"]
    assert (found["n"], found["best"]["flags"], found["best"]["mends"]) == (STOPS, flags, [])
    mended = shlex.split(" ".join(flags))
    calibration = json.loads(program(capsys, "calibrate", path, "--model", "mount", *stated, *mended, "--json").out)
    assert calibration["verdict"] == "good"
    assert calibration["weight"] == pytest.approx(TOOL_WEIGHT, abs=0.1)


def test_two_files_are_diagnosed_by_the_moment(
    moved: Moved, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    every = slice(3, None, 4)
    wrench = written(tmp_path, csv_text(("t", *WRENCH), np.column_stack([moved.t, -moved.wrench])), "w.csv")
    numbers = euler("xyz")(moved.R[every])
    pose = written(tmp_path, csv_text(("t", "a", "b", "c"), np.column_stack([moved.t[every], numbers])), "p.csv")
    files = ("--wrench", wrench, "--pose", pose)
    verdict = program(capsys, "diagnose", *files).out.splitlines()[0]
    assert "; with `--orientation fanuc_wpr:a,b,c --sign reaction`: 0." in verdict
    flags = ("--orientation", "fanuc_wpr:a,b,c", "--sign", "reaction")
    calibration = json.loads(program(capsys, "calibrate", *files, *flags, "--json").out)
    assert calibration["weight"] == pytest.approx(TOOL_WEIGHT, abs=0.1)
    with pytest.raises(FileFormatError, match="found a wrench in base axes without an orientation in its row"):
        interpretations(wrench, Options(wrench_frame="base", pose_file=pose))


def test_a_bag_is_diagnosed_by_what_its_messages_leave_open(
    moved: Moved, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bags = pytest.importorskip("tests.support.bags")
    messages = []
    for k, t in enumerate(moved.t):
        messages.append(bags.wrench_stamped(t, -moved.wrench[k]))
        if k % 4 == 3:
            messages.append(bags.pose_stamped(t, moved.R[k].T, np.zeros(3)))
    path = bags.write_bag(tmp_path / "moved.mcap", messages)
    found = json.loads(program(capsys, "diagnose", path, "--json").out)
    assert found["best"]["flags"] == ["--inverse-orientation", "--sign reaction"]
    assert found["best"]["weight"] == pytest.approx(TOOL_WEIGHT, abs=0.1)
    every = [*found["ranked"], *found["alike"]]
    assert not any("--wrench-frame base" in each["flags"] or "rename" in str(each["mends"]) for each in every)


def test_a_stream_without_a_stop_is_refused_as_calibrate_refuses_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    t = np.arange(0.0, 6.0, 0.01)
    turned = euler("ZYX")(np.eye(3)[None].repeat(len(t), axis=0)) + np.outer(t, [50.0, 5.0, 40.0])
    rows = np.column_stack([t, np.random.default_rng(0).normal(size=(len(t), 6)), turned])
    path = written(tmp_path, csv_text(("t", *WRENCH, "a", "b", "c"), rows))
    complaint = program(capsys, "diagnose", path).complaint
    assert "found no stretch in 5.99 s in which arm and reading are still" in complaint
    assert complaint == program(capsys, "calibrate", path).complaint
