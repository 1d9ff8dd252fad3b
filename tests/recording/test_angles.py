"""Angles in radians under a convention in degrees: `calibrate` says so, in the result or in the refusal, and only then.

The tool is the judge's; its readings are of large turns, whatever the unit of the angles.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import contactwrench as cw
from contactwrench.calibration.findings import Kind, Severity
from contactwrench.errors import AmbiguityError, UnobservableError
from tests.support.recordings import WRENCH, csv_text, run, written
from tests.support.rigs import NOISE, example
from tests.support.world import Array, noisy_readings, random_rotations
from tests.support.written import Written, euler, rotvec

IN_RADIANS = {
    "kuka_abc": Written(("a", "b", "c"), euler("ZYX", degrees=False)),
    "fanuc_wpr": Written(("w", "p", "r"), euler("xyz", degrees=False)),
}


def doubt(columns: str, convention: str) -> str:
    return (
        f"the angles {columns} are likely in radians: none is beyond 3.15, and {convention} reads degrees: say "
        "--units angle=rad, or, if they are degrees, --units angle=deg; contactwrench diagnose tries both"
    )


def outcome(samples: cw.Samples) -> tuple[str, cw.Calibration | None]:
    try:
        return "", cw.calibrate(samples)
    except (AmbiguityError, UnobservableError) as error:
        return str(error), None


@pytest.mark.parametrize(("convention", "seed"), [*zip(IN_RADIANS, (0, 1), strict=True)])
def test_radians_that_are_read_in_degrees_are_said(convention: str, seed: int, tmp_path: Path) -> None:
    way = IN_RADIANS[convention]
    rig, R, rng = example(seed, poses=12)
    path = written(tmp_path, way.text(R, noisy_readings(rig, R, NOISE, rng)))
    samples = cw.read(path, orientation=convention)
    said = doubt(", ".join(way.columns), convention)
    refusal, calibration = outcome(samples)
    if calibration is None:
        assert refusal.endswith(f"; but {said}")
    else:
        assert calibration.verdict != "good"
        (finding,) = (finding for finding in calibration.findings if finding.kind is Kind.ANGLES_IN_DOUBT)
        assert (finding.severity, finding.text) == (Severity.DOUBTFUL, f"doubtful: {said}")
    mended = cw.calibrate(cw.read(path, orientation=convention, units="angle=rad"), "mount")
    assert mended.weight == pytest.approx(rig.weight, abs=4.0 * mended.std["weight"])
    assert mended.verdict == "good"
    assert cw.read(path, orientation=convention, units="angle=deg").doubt == ""


def test_a_fit_that_is_good_by_chance_is_doubtful(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Poses tilted by a few degrees turn the readings in proportion: another unit is another weight, and fits."""
    rig, _, rng = example(4)
    down = Rotation.from_euler("ZYX", [0.0, 0.0, np.pi])
    tilts = Rotation.from_euler("ZYX", rng.uniform(-0.35, 0.35, size=(12, 3)))
    R: Array = (down * tilts).as_matrix()
    path = written(tmp_path, IN_RADIANS["kuka_abc"].text(R, noisy_readings(rig, R, 0.1 * NOISE, rng)))
    done = run(capsys, "calibrate", path, "--model", "mount", "--json")
    if done.status == 2:
        assert doubt("a, b, c", "kuka_abc") in done.err
    else:
        saved = json.loads(done.out)
        assert saved["verdict"] != "good"
        assert saved["findings"][0]["kind"] == "angles_in_doubt"


@pytest.mark.parametrize(
    "way",
    [
        Written(("a", "b", "c"), euler("ZYX")),
        Written(("rx", "ry", "rz"), rotvec),
    ],
    ids=["degrees", "a convention in radians"],
)
def test_angles_that_are_read_rightly_are_left_alone(way: Written, tmp_path: Path) -> None:
    rig, R, rng = example(5, poses=12)
    samples = cw.read(written(tmp_path, way.text(R, noisy_readings(rig, R, NOISE, rng))))
    assert samples.doubt == ""
    assert not [each for each in cw.calibrate(samples).findings if each.kind is Kind.ANGLES_IN_DOUBT]


def test_a_stated_unit_and_quaternions_of_small_turns_are_left_alone(tmp_path: Path) -> None:
    angles = np.random.default_rng(6).uniform(-3.0, 3.0, size=(8, 3))
    rows = np.column_stack([np.ones((8, 6)), angles])
    assert cw.read(written(tmp_path, csv_text((*WRENCH, "a", "b", "c"), rows))).doubt == doubt("a, b, c", "kuka_abc")
    rpy = written(tmp_path, csv_text((*WRENCH, "roll", "pitch", "yaw"), rows))
    assert cw.read(rpy, orientation="rpy").doubt == doubt("roll, pitch, yaw", "rpy")
    assert cw.read(written(tmp_path, csv_text((*WRENCH, "a_deg", "b_deg", "c_deg"), rows))).doubt == ""
    small = Rotation.from_euler("ZYX", angles, degrees=True).as_quat()
    rows = np.column_stack([np.ones((8, 6)), small])
    assert cw.read(written(tmp_path, csv_text((*WRENCH, "qx", "qy", "qz", "qw"), rows))).doubt == ""


def test_euler_letters_and_two_files_are_looked_at_too(tmp_path: Path) -> None:
    rng = np.random.default_rng(7)
    t, angles = np.arange(40.0) / 20.0, euler("ZYX", degrees=False)(random_rotations(40, rng))
    wrench = written(tmp_path, csv_text(("t", *WRENCH), np.column_stack([t, rng.normal(size=(40, 6))])), "w.csv")
    pose = written(tmp_path, csv_text(("t", "e1", "e2", "e3"), np.column_stack([t, angles])), "p.csv")
    samples = cw.read(wrench, orientation="euler:ZYX:deg", pose_file=pose)
    assert samples.doubt == doubt("e1, e2, e3", "euler")
    assert cw.read(wrench, orientation="euler:ZYX:rad", pose_file=pose).doubt == ""


def test_verbs_that_take_a_calibration_say_it_too(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rig, R, rng = example(8, poses=12)
    wrench, way = noisy_readings(rig, R, NOISE, rng), IN_RADIANS["kuka_abc"]
    degrees = written(tmp_path, Written(("a", "b", "c"), euler("ZYX")).text(R, wrench), "degrees.csv")
    radians = written(tmp_path, way.text(R, wrench), "radians.csv")
    tool = tmp_path / "tool.json"
    assert run(capsys, "calibrate", degrees, "-o", tool, "--model", "mount").status == 0
    for verb in ("compensate", "verify", "weigh"):
        assert run(capsys, verb, radians, "-c", tool).err.count(f"Note: {doubt('a, b, c', 'kuka_abc')}\n") == 1
        assert "likely in radians" not in run(capsys, verb, degrees, "-c", tool).err
        assert "likely in radians" not in run(capsys, verb, radians, "-c", tool, "--units", "angle=rad").err


def test_degrees_that_are_read_as_radians_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rig, R, rng = example(9, poses=12)
    wrench, way = noisy_readings(rig, R, NOISE, rng), Written(("a", "b", "c"), euler("ZYX"))
    radians = written(tmp_path, IN_RADIANS["kuka_abc"].text(R, wrench), "radians.csv")
    degrees, tool = written(tmp_path, way.text(R, wrench), "degrees.csv"), tmp_path / "tool.json"
    assert run(capsys, "calibrate", radians, "-o", tool, "--units", "angle=rad", "--model", "mount").status == 0
    widest = float(np.abs(euler("ZYX")(R))[0].max())
    for verb in ("compensate", "verify", "weigh"):
        done = run(capsys, verb, degrees, "-c", tool)
        assert done.status == 2
        assert done.err.splitlines()[-1] == (
            f"contactwrench: {degrees}: row 2, columns a,b,c: found an angle of {widest:.6g} rad, expected at most a "
            "whole turn: if these are degrees, read them with --units angle=deg"
        )
        assert run(capsys, verb, degrees, "-c", tool, "--units", "angle=deg").status == 0
