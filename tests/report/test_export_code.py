"""Lines of code for a loop of one's own: compiled, run and read back, they compensate as the calibration does."""

from __future__ import annotations

import re
import shutil
import subprocess
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import contactwrench as cw
from contactwrench.report.export.code import in_c
from contactwrench.report.export.exported import TARGETS, exported
from contactwrench.report.export.target import Setup
from tests.support.exports import unwrapped
from tests.support.rigs import noise_free
from tests.support.world import Array, random_rig, random_rotations, tilted_down, with_down

EVERY_LANGUAGE = pytest.mark.parametrize("name", ["c", "python", "matlab"])
MODELS = ("mount", "mount+base", "affine")
EXACT = 1e-12
"""N and N m: rounding in the last digits."""


@cache
def calibrated(model: str) -> cw.Calibration:
    rng = np.random.default_rng(5)
    rig = random_rig(rng)
    if model == "mount+base":
        rig = with_down(rig, tilted_down(0.2, rng))
    return cw.calibrate(noise_free(rig, random_rotations(20, rng)), model=model)


def written(name: str, calibration: cw.Calibration, setup: Setup | None = None) -> str:
    return unwrapped(exported(TARGETS[name], calibration, setup or Setup(), "cal.json").text)


def pushed(n: int) -> tuple[Array, Array]:
    """Readings (n, 6) of anything, at any orientation (n, 3, 3)."""
    rng = np.random.default_rng(11)
    return rng.normal(size=(n, 6)) * [20.0, 20.0, 20.0, 1.0, 1.0, 1.0], random_rotations(n, rng)


LOOP = """\
#include <stdio.h>
#include "tool.h"

int main(void)
{
    double wrench[6], R[9], q[4], of_matrix[6];
    int i;
    for (;;) {
        for (i = 0; i < 6; ++i)
            if (scanf("%lf", &wrench[i]) != 1) return 0;
        for (i = 0; i < 9; ++i)
            if (scanf("%lf", &R[i]) != 1) return 1;
        for (i = 0; i < 4; ++i)
            if (scanf("%lf", &q[i]) != 1) return 1;
        contactwrench_of_matrix(wrench, R, of_matrix);
        contactwrench_of_quaternion(wrench, q, wrench);
        for (i = 0; i < 6; ++i) printf("%.17g ", of_matrix[i]);
        for (i = 0; i < 6; ++i) printf("%.17g ", wrench[i]);
        printf("\\n");
    }
}
"""


def compiled(folder: Path, source: str, *, standard: str = "c99") -> subprocess.CompletedProcess[str]:
    """The program `folder/loop` from its source, every warning an error."""
    compiler = shutil.which("cc")
    if compiler is None:
        pytest.skip("no C compiler here: nothing to compile the header with")
    (folder / "loop.c").write_text(source, encoding="utf-8")
    flags = [f"-std={standard}", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Werror"]
    return subprocess.run(
        [compiler, *flags, "-o", str(folder / "loop"), str(folder / "loop.c")],
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.parametrize("model", MODELS)
def test_the_header_compiles_in_c99_and_compensates(model: str, tmp_path: Path) -> None:
    calibration = calibrated(model)
    (tmp_path / "tool.h").write_text(written("c", calibration), encoding="utf-8")
    built = compiled(tmp_path, LOOP)
    assert built.returncode == 0, built.stderr
    wrench, R = pushed(50)
    length = np.random.default_rng(2).uniform(0.1, 9.0, size=(50, 1))
    quaternions = length * Rotation.from_matrix(R).as_quat()
    rows = np.column_stack([wrench, R.reshape(-1, 9), quaternions])
    lines = "\n".join(" ".join(map(repr, row)) for row in rows.tolist())
    out = subprocess.run([tmp_path / "loop"], input=lines, capture_output=True, text=True, check=True).stdout
    contact = np.array([line.split() for line in out.splitlines()], dtype=float)
    expected = calibration.compensate(wrench, R)
    assert np.abs(contact[:, :6] - expected).max() < EXACT
    assert np.abs(contact[:, 6:] - expected).max() < EXACT


def test_the_headers_of_two_tools_are_not_mixed_up_in_silence(tmp_path: Path) -> None:
    for name, model in (("tool.h", "mount"), ("other.h", "mount+base")):
        (tmp_path / name).write_text(written("c", calibrated(model)), encoding="utf-8")
    twice = compiled(tmp_path, '#include "tool.h"\n' + LOOP)
    assert twice.returncode == 0, twice.stderr
    assert "redefinition" in compiled(tmp_path, '#include "other.h"\n' + LOOP).stderr


def test_no_line_of_a_header_ends_the_comment_early(tmp_path: Path) -> None:
    body = TARGETS["c"].parameters(calibrated("mount"), Setup()).body
    header = in_c(["from runs/*/x.csv", "*/ int trap(; /*", ""], body)
    (tmp_path / "tool.h").write_text(header, encoding="utf-8")
    built = compiled(tmp_path, LOOP)
    assert built.returncode == 0, built.stderr


@pytest.mark.parametrize("model", MODELS)
def test_the_lines_of_python_compensate_one_and_many(model: str) -> None:
    calibration = calibrated(model)
    names: dict[str, object] = {}
    exec(written("python", calibration), names)
    assert np.array_equal(np.asarray(names["B"]), calibration.B)
    assert np.array_equal(np.asarray(names["d"]), calibration.gravity_direction)
    contact_wrench = names["contact_wrench"]
    assert callable(contact_wrench)
    wrench, R = pushed(50)
    expected = calibration.compensate(wrench, R)
    assert np.abs(contact_wrench(wrench, R) - expected).max() < EXACT
    assert np.abs(contact_wrench(wrench[3].tolist(), R[3].tolist()) - expected[3]).max() < EXACT


@pytest.mark.parametrize("model", MODELS)
def test_the_lines_of_matlab_hold_every_number_exactly(model: str) -> None:
    calibration = calibrated(model)
    text = written("matlab", calibration)
    inside = re.search(r"B = \[\n(.*?)\n\];\nd = \[(.*?)\]\.';", text, re.S)
    assert inside
    B = [[float(number) for number in row.split(",")] for row in inside.group(1).split(";")]
    assert np.array_equal(B, calibration.B)
    assert np.array_equal([float(number) for number in inside.group(2).split(",")], calibration.gravity_direction)
    code = [line for line in text.splitlines() if not line.startswith("%")]
    assert code[0] == "function contact = contact_wrench(wrench, R_base_flange)"
    assert code[-2:] == ["contact = wrench(:) - B * [R_base_flange.' * d; 1];", "end"]


@pytest.mark.skipif(shutil.which("octave") is None, reason="no Octave here: the numbers are read back without it")
def test_octave_compensates(tmp_path: Path) -> None:
    calibration = calibrated("mount+base")
    (tmp_path / "contact_wrench.m").write_text(written("matlab", calibration), encoding="utf-8")
    wrench, R = pushed(1)
    as_matlab = "[" + "; ".join(" ".join(map(repr, row)) for row in R[0].tolist()) + "]"
    program = f"printf('%.17g ', contact_wrench([{' '.join(map(repr, wrench[0].tolist()))}], {as_matlab}))"
    out = subprocess.run(
        ["octave", "--no-gui", "--quiet", "--eval", program], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert np.abs(np.array(out.stdout.split(), dtype=float) - calibration.compensate(wrench, R)[0]).max() < EXACT


@EVERY_LANGUAGE
def test_what_was_done_to_the_recording_is_to_be_done_to_every_reading(name: str) -> None:
    calibration = calibrated("mount")
    said: dict[str, dict[str, str | int | float | None]] = {
        "negate force and torque before": {"sign": "reaction"},
        "turn it into flange axes, by R_base_flange transposed, before": {"wrench_frame": "base"},
        "the robot reports R_flange_base (--inverse-orientation): hand over its transpose": {
            "inverse_orientation": True
        },
    }
    for sentence, option in said.items():
        assert sentence not in written(name, calibration)
        assert sentence in written(name, replace(calibration, provenance={**calibration.provenance, **option}))


@EVERY_LANGUAGE
def test_a_weighed_mass_is_in_B_and_its_price_in_the_header(name: str) -> None:
    calibration = calibrated("mount")
    assert calibration.mass is not None
    parameters = TARGETS[name].parameters(calibration, Setup(tool_mass=1.1 * calibration.mass))
    assert parameters.B is not None
    assert np.allclose(parameters.B[:, :3], 1.1 * calibration.B[:, :3], rtol=1e-9, atol=1e-12)
    assert np.allclose(parameters.B[:, 3], calibration.bias, rtol=1e-12)
    assert calibration.weight is not None
    text = written(name, calibration, Setup(tool_mass=1.1 * calibration.mass))
    assert f"the contact force is off by up to {0.1 * calibration.weight:.4g} N" in text
    assert "is off by" not in written(name, calibration)
