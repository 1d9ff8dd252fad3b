"""Checks of `calibrate` beside its accuracy: the mass that was expected, and a fit that is bad."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import contactwrench as cw
from tests.support.recordings import PANDA, run, written
from tests.support.rigs import NOISE, example
from tests.support.world import noisy_readings, random_rotations
from tests.support.written import QUAT, Written, quat

Capture = pytest.CaptureFixture[str]
REFUSED = "contactwrench: Invalid value: {}: try 'contactwrench calibrate --help'\n"
DIAGNOSE = "contactwrench diagnose tries the other ways to read it"


@pytest.mark.parametrize(
    ("required", "missed"),
    [
        ("0.7,0.9", ""),
        ("0.9,1", "mass 0.7884 +- 0.0081 kg, expected 0.9 to 1"),
        ("0.1, 0.7", "mass 0.7884 +- 0.0081 kg, expected 0.1 to 0.7"),
        ("0.7,0.79", "mass 0.7884 +- 0.0081 kg, expected 0.7 to 0.79"),
    ],
    ids=["inside", "below", "above", "inside, but not by its std"],
)
def test_a_required_mass_that_is_missed_exits_1(tmp_path: Path, capsys: Capture, required: str, missed: str) -> None:
    done = run(capsys, "calibrate", PANDA, "--require-mass", required, "-o", tmp_path / "tool.json")
    line = f"Requirement missed: {missed}; contactwrench diagnose lists other units\n"
    assert (done.status, done.err) == ((1, line) if missed else (0, ""))
    assert (f", and misses what is required, {missed}:" in " ".join(done.out.split())) == bool(missed)
    assert (tmp_path / "tool.json").exists()


@pytest.mark.parametrize("text", ["0.9", "1,0.5", "1,1", "0,1", "-1,1", "1,nan", "1,inf", "a,b", "1,2,3", ""])
def test_a_required_mass_that_is_no_range(capsys: Capture, text: str) -> None:
    done = run(capsys, "calibrate", PANDA, f"--require-mass={text}")
    refusal = f"found --require-mass {text!r}, expected LOW,HIGH in kg, 0 < LOW < HIGH, as in 0.7,0.9"
    assert (done.status, done.err) == (2, REFUSED.format(refusal))


def test_a_matrix_has_no_mass(capsys: Capture) -> None:
    done = run(capsys, "calibrate", PANDA, "--model", "affine", "--require-mass", "1,2")
    refusal = "model affine has no mass, found --require-mass: leave one of them out"
    assert (done.status, done.err) == (2, REFUSED.format(refusal))


BADLY_READ = ("calibrate", PANDA, "--orientation", "quat_wxyz:qx,qy,qz,qw")


@pytest.mark.parametrize("model", ["mount", "affine"])
def test_a_bad_fit_is_written_by_force_only(tmp_path: Path, capsys: Capture, model: str) -> None:
    target = tmp_path / "tool.json"
    done = run(capsys, *BADLY_READ, "--model", model, "-o", target)
    assert (done.status, target.exists()) == (1, False)
    assert "\nThe fit is bad: " in done.err
    assert done.err.endswith(f" % of the weight: the file may be read wrongly (orientation, sign, units); {DIAGNOSE}; "
                             "not written, --force writes it\n")  # fmt: skip
    assert max(map(len, done.err.splitlines())) < 300
    assert "Verdict  weak" in done.out
    assert "Wrote" not in done.out
    forced = run(capsys, *BADLY_READ, "--model", model, "-o", target, "--force")
    assert (forced.status, forced.err) == (1, done.err.replace("; not written, --force writes it", ""))
    assert forced.out.endswith(f"Wrote the calibration to {target}\n")
    assert cw.Calibration.load(target).verdict == "weak"


def test_a_bad_fit_takes_the_place_of_no_file(tmp_path: Path, capsys: Capture) -> None:
    """--force replaces a calibration, or writes a bad fit: never both at once."""
    target = tmp_path / "tool.json"
    assert run(capsys, "calibrate", PANDA, "--model", "mount", "-o", target).status == 0
    good = target.read_bytes()
    done = run(capsys, *BADLY_READ, "--model", "mount", "-o", target, "--force")
    assert (done.status, target.read_bytes()) == (1, good)
    assert done.err.endswith(f"; {target} stays as it was: with --force it is written to a new name\n")
    assert "Wrote" not in done.out
    again = run(capsys, "calibrate", PANDA, "--model", "mount", "-o", target, "--force")
    assert again.status == 0
    assert again.out.endswith(f"Wrote the calibration to {target}\n")
    target.write_bytes(b"")
    assert run(capsys, *BADLY_READ, "--model", "mount", "-o", target, "--force").status == 1
    assert cw.Calibration.load(target).verdict == "weak"


@pytest.mark.parametrize("flags", [["--json"], ["-o", "-"]])
def test_a_bad_fit_is_printed(capsys: Capture, flags: list[str]) -> None:
    done = run(capsys, *BADLY_READ, "--model", "mount", *flags)
    assert done.status == 1
    assert done.out.startswith("{")
    assert "--force" not in done.err


def test_of_tools_that_share_a_mounting_none_is_written_where_one_fits_badly(tmp_path: Path, capsys: Capture) -> None:
    """What they share rests on all of them."""
    good, bad, out = tmp_path / "good.csv", tmp_path / "bad.csv", tmp_path / "out"
    good.write_bytes(PANDA.read_bytes())
    R = random_rotations(12, np.random.default_rng(0))
    bad.write_text(Written(QUAT, quat).text(R, np.random.default_rng(1).normal(size=(12, 6)) * 5.0))
    done = run(capsys, "calibrate", good, bad, "--shared", "mount", "--model", "mount", "-o", out)
    assert (done.status, out.exists()) == (1, False)
    assert f"{bad}: The fit is bad: " in done.err
    assert f"{good}: " not in done.err
    assert "not written, --force writes all" in done.err
    assert (
        run(capsys, "calibrate", good, bad, "--shared", "mount", "--model", "mount", "-o", out, "--force").status == 1
    )
    assert {path.name for path in out.iterdir()} == {"good.json", "bad.json"}


def test_a_bad_fit_by_what_is_known_names_that(tmp_path: Path, capsys: Capture) -> None:
    """A mounting that is stated 10 deg off: the file is read rightly, and is not the first to be looked at."""
    rig, R, rng = example(1, 12)
    path = written(tmp_path, Written(QUAT, quat).text(R, noisy_readings(replace(rig, weight=20.0), R, NOISE, rng)))
    off = rig.R_flange_sensor @ Rotation.from_euler("z", 10.0, degrees=True).as_matrix()
    for mount, expected in ((rig.R_flange_sensor, ""), (off, KNOWN_IS_WRONG)):
        done = run(capsys, "calibrate", path, f"--known=mount={','.join(map(repr, mount.ravel().tolist()))}+-0.3")
        assert re.fullmatch(expected, done.err), done.err
        assert done.status == bool(expected)


def test_a_new_zero_of_another_tool_fails_the_check_and_is_not_written(tmp_path: Path, capsys: Capture) -> None:
    rig, R, rng = example(1, 24)
    tool, other = replace(rig, weight=20.0), replace(rig, weight=27.0)
    table = Written(QUAT, quat)
    path = written(tmp_path, table.text(R[:12], noisy_readings(tool, R[:12], NOISE, rng)))
    earlier, zero = tmp_path / "tool.json", tmp_path / "zero.json"
    assert run(capsys, "calibrate", path, "-o", earlier).status == 0
    for now, status in ((tool, 0), (other, 1)):
        path = written(tmp_path, table.text(R[12:], noisy_readings(now, R[12:], NOISE, rng)))
        done = run(capsys, "calibrate", path, "--prior", earlier, "-o", zero)
        assert (done.status, zero.exists()) == (status, status == 0)
        zero.unlink(missing_ok=True)
    assert re.fullmatch(
        r"The fit is bad: \d\.?\d? N are left in the poses, \d\d % of the weight: the poses contradict the earlier "
        r"calibration: tool, mounting or base changed, the tool touches something, or the poses are noisier "
        r"\(--noise\); calibrate anew, without --prior; if it is the readings, contactwrench diagnose tries the other "
        r"ways to read the file; not written, --force writes it\n",
        done.err,
    ), done.err


KNOWN_IS_WRONG = (
    r"The fit is bad: \d\.?\d? N are left in the poses, \d\d % of the weight: the readings contradict the known mount "
    r"\(probability .+\): by themselves they give another direction: one of the two is wrong; if it is the readings, "
    r"contactwrench diagnose tries the other ways to read the file\n"
)
REMOUNTED = (
    r"{0}, {1}, {2}: The fit is bad: {2} contradicts the other recordings, the mounting by 2\d \+- \S+ deg "
    r"and gravity by \S+ \+- \S+ deg \(chance under 0\.01 %\): the sensor or the base moved in between, or the tool "
    r"touched something: calibrate it apart; what fits badly apart too may be read wrongly: contactwrench diagnose "
    r"tries the other ways"
)


def test_of_tools_that_share_a_mounting_the_one_that_was_remounted_is_named(tmp_path: Path, capsys: Capture) -> None:
    rig, _, rng = example(5)
    turned = rig.R_flange_sensor @ Rotation.from_euler("z", 20.0, degrees=True).as_matrix()
    files = [tmp_path / f"{name}.csv" for name in "abc"]
    for file, mount in zip(files, (rig.R_flange_sensor,) * 2 + (turned,), strict=True):
        R, tool = random_rotations(10, rng), replace(rig, weight=20.0, R_flange_sensor=mount)
        file.write_text(Written(QUAT, quat).text(R, noisy_readings(tool, R, NOISE, rng)))
    out = tmp_path / "out"
    both = ("--shared", "mount,gravity", "--model", "mount+base")
    shared: tuple[str | Path, ...] = ("calibrate", *files, *both, "-o", out)
    named = REMOUNTED.format(*(re.escape(str(file)) for file in files))
    done = run(capsys, *shared)
    assert re.fullmatch(rf"{named}; not written, --force writes all\n", done.err), done.err
    assert (run(capsys, *shared, "--force").status, len(list(out.iterdir()))) == (1, 3)
    done = run(capsys, *shared, "--force")
    stays = f"; what is in {out} stays as it was: with --force all are written to a new folder"
    assert re.fullmatch(named + re.escape(stays) + r"\n", done.err), done.err
    assert run(capsys, "calibrate", *files[:2], *both).err == ""


@pytest.mark.parametrize("verb", ["calibrate", "diagnose"])
def test_readings_of_zero_are_refused(tmp_path: Path, capsys: Capture, verb: str) -> None:
    R = random_rotations(8, np.random.default_rng(0))
    path = written(tmp_path, Written(QUAT, quat).text(R, np.zeros((8, 6))))
    done = run(capsys, verb, path)
    expected = (
        "found 0 in all six channels of every row, expected what a six-axis sensor reads: check its columns, cable"
    )
    assert (done.status, done.err) == (2, f"contactwrench: {path}: {expected} and driver\n")
