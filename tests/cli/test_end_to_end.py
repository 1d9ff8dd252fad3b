"""CSV to calibration to contact wrench on the measured Panda set, as a user would run it."""

from pathlib import Path

import numpy as np
import pytest

import contactwrench as cw

PANDA = Path(cw.__file__).parent / "data" / "panda_mini45.csv"


def test_measured_panda_set_gives_the_mass_that_its_authors_found(tmp_path: Path) -> None:
    samples = cw.read(PANDA)
    calibration = cw.calibrate(samples, model="mount")
    assert calibration.mass == pytest.approx(0.788, abs=2 * calibration.std["weight"] / 9.81)
    assert calibration.residual_rms[:3] == pytest.approx([0.11, 0.18, 0.20], abs=0.02)

    calibration.save(tmp_path / "tool.json")
    loaded = cw.Calibration.load(tmp_path / "tool.json")
    contact = loaded.compensate(samples.wrench, samples.R_base_flange)
    assert np.linalg.norm(contact[:, :3], axis=1).max() < 0.5
