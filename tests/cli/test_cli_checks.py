"""Checks of `calibrate` beside its accuracy: the mass that was expected, and a fit that is bad."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import contactwrench as cw
from tests.support.recordings import PANDA, run, written
from tests.support.world import random_rotations
from tests.support.written import QUAT, Written, quat

Capture = pytest.CaptureFixture[str]
REFUSED = "contactwrench: Invalid value: {}: try 'contactwrench calibrate --help'\n"
DIAGNOSE = "contactwrench diagnose tries the other ways to read it"


@pytest.mark.parametrize(
    ("required", "missed"),
    [
        ("0.7,0.9", ""),
        ("0.9,1", "mass 0.7885 +- 0.0071 kg, expected 0.9 to 1"),
        ("0.1, 0.7", "mass 0.7885 +- 0.0071 kg, expected 0.1 to 0.7"),
        ("0.7,0.79", "mass 0.7885 +- 0.0071 kg, expected 0.7 to 0.79"),
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
    assert "not written, --force writes it" in done.err
    assert (
        run(capsys, "calibrate", good, bad, "--shared", "mount", "--model", "mount", "-o", out, "--force").status == 1
    )
    assert {path.name for path in out.iterdir()} == {"good.json", "bad.json"}


@pytest.mark.parametrize("verb", ["calibrate", "diagnose"])
def test_readings_of_zero_are_refused(tmp_path: Path, capsys: Capture, verb: str) -> None:
    R = random_rotations(8, np.random.default_rng(0))
    path = written(tmp_path, Written(QUAT, quat).text(R, np.zeros((8, 6))))
    done = run(capsys, verb, path)
    expected = (
        "found 0 in all six channels of every row, expected what a six-axis sensor reads: check its columns, cable"
    )
    assert (done.status, done.err) == (2, f"contactwrench: {path}: {expected} and driver\n")
