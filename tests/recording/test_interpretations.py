"""All ways to read a file: the flags that are named make the reading that they stand for; which rows are taken."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import contactwrench as cw
from contactwrench.assess.diagnose import diagnose
from contactwrench.recording.interpretations import interpretations
from contactwrench.recording.options import Options
from tests.support.recordings import MATRIX, WRENCH, csv_text, written
from tests.support.rigs import NOISE, example
from tests.support.world import noisy_readings, random_rotations
from tests.support.written import QUAT, Written, column_by_column, euler, quat


def _stated(flags: tuple[str, ...]) -> dict[str, object]:
    stated: dict[str, object] = {}
    for flag in flags:
        name, _, value = flag.partition(" ")
        stated[name.removeprefix("--").replace("-", "_")] = value or True
    return stated


HEADERS = {
    "angles": (("rx", "ry", "rz"), euler("ZYX")),
    "angles in rad": (("rx", "ry", "rz"), euler("ZYX", degrees=False)),
    "angles by an option": (("rx", "ry", "rz"), euler("ZYX")),
    "angles with their unit": (("a_deg", "b_deg", "c_deg"), euler("ZYX")),
    "quaternion": (QUAT, quat),
    "matrix": (MATRIX, lambda R: R.reshape(-1, 9)),
    "pose": (tuple(f"o_t_ee_{k}" for k in range(16)), column_by_column),
}


@pytest.mark.parametrize("header", HEADERS)
def test_flags_make_the_reading_that_they_stand_for(header: str, tmp_path: Path) -> None:
    columns, numbers = HEADERS[header]
    R = random_rotations(6, np.random.default_rng(0))
    path = written(tmp_path, Written(columns, numbers).text(R, np.ones((6, 6))))
    tried = 0
    units = "angle=deg" if header == "angles by an option" else None
    file = interpretations(path, Options("franka_matrix" if header == "pose" else "auto", units=units))
    for k, reading in enumerate(file.orientations):
        if not reading.mends:
            made = cw.read(path, **_stated(file.interpretation(k, 0, 0).options))  # type: ignore[arg-type]
            assert made.R_base_flange == pytest.approx(reading.R_base_flange, abs=1e-9)
            tried += 1
    assert tried >= 2


def test_rows_with_a_load_are_left_out(tmp_path: Path) -> None:
    rig, R, rng = example(14, poses=12)
    wrench = noisy_readings(rig, R, NOISE, rng)
    wrench[6:, 2] += 9.8
    load = np.repeat([0.0, 1000.0], 6)
    rows = np.column_stack([-wrench, quat(R), load])
    diagnosis = diagnose(interpretations(written(tmp_path, csv_text((*WRENCH, *QUAT, "load_g"), rows))))
    assert diagnosis.n == 6
    assert diagnosis.best.interpretation.options == ("--sign reaction",)


def test_a_long_recording_is_thinned(tmp_path: Path) -> None:
    """A moving arm: hundreds of poses spread over the whole recording, each with its own wrench."""
    rig, R, rng = example(1, poses=2000)
    path = written(tmp_path, Written(QUAT, quat).text(R, noisy_readings(rig, R, NOISE, rng)))
    found = interpretations(path)
    assert found.wrench.shape == (300, 6)
    assert found.stated is not None
    stated = found.orientations[found.stated.orientation]
    assert stated.R_base_flange[0] == pytest.approx(R[0], abs=1e-9)
    assert stated.R_base_flange[-1] == pytest.approx(R[-1], abs=1e-9)
    assert diagnose(found).read_rightly


@pytest.mark.slow
def test_a_file_of_several_blocks_is_one(tmp_path: Path) -> None:
    """Its rows are counted through, and one that is no rotation leaves nothing stated."""
    R = np.repeat(random_rotations(8, np.random.default_rng(2)), 5000, axis=0)
    lines = csv_text((*WRENCH, *QUAT), np.column_stack([np.ones((len(R), 6)), quat(R)])).splitlines()
    whole = interpretations(written(tmp_path, "\n".join(lines)))
    assert (len(whole.wrench), whole.complaint) == (8, None)
    assert whole.stated is not None
    assert whole.stated.options == ()
    lines[39_000] = "1,1,1,1,1,1,0,0,0,2"
    broken = interpretations(written(tmp_path, "\n".join(lines)))
    assert broken.stated is None
    assert str(broken.complaint).startswith(f"{tmp_path / 'poses.csv'}: row 39001, columns qx,qy,qz,qw: found")
