"""A calibration with inertia as a file: read back as it was, and refused by name where it was edited."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="mujoco is not installed")

import contactwrench as cw
from contactwrench.errors import FileFormatError
from tests.support.in_motion import calibrated

Edit = Callable[[dict[str, Any]], None]


def test_it_is_read_back_as_it_was(tmp_path: Path) -> None:
    before = calibrated()
    before.save(tmp_path / "tool.json")
    after = cw.Calibration.load(tmp_path / "tool.json")
    assert before.dynamics is not None
    assert after.dynamics is not None
    for name, value in vars(before.dynamics).items():
        assert np.array_equal(getattr(after.dynamics, name), value), name
    assert after.requested_model == "dynamic"
    assert after.findings == before.findings
    assert str(after) == str(before)


def test_a_calibration_of_poses_has_none(tmp_path: Path) -> None:
    samples = cw.calibrate(calibrated_samples())
    samples.save(tmp_path / "tool.json")
    loaded = cw.Calibration.load(tmp_path / "tool.json")
    assert loaded.dynamics is None
    assert loaded.inertia is None
    assert loaded.sensor_offset is None


def calibrated_samples() -> cw.Samples:
    """At rest."""
    from tests.support.rigs import example, noisy

    rig, R, rng = example(3)
    return noisy(rig, R, rng)


def _matrix(d: dict[str, Any]) -> None:
    d["matrix"][0][9] *= 1.01


def _inertia(d: dict[str, Any]) -> None:
    d["inertia"][0][0] += 1e-4


def _no_body(d: dict[str, Any]) -> None:
    d["inertia"] = [[0.001, 0.0, 0.0], [0.0, 0.001, 0.0], [0.0, 0.0, 0.003]]


def _not_symmetric(d: dict[str, Any]) -> None:
    d["inertia"][0][1] += 1e-3


def _offset(d: dict[str, Any]) -> None:
    d["sensor_offset"][2] += 0.01


def _covariance(d: dict[str, Any]) -> None:
    d["covariance"][0][0] *= -1.0


def _between(d: dict[str, Any]) -> None:
    d["with_parameters"] = (1e6 * np.array(d["with_parameters"])).tolist()


def _shape(d: dict[str, Any]) -> None:
    d["covariance"] = [row[:8] for row in d["covariance"][:8]]


def _bandwidth(d: dict[str, Any]) -> None:
    d["bandwidth"] = -1.0


def _noise(d: dict[str, Any]) -> None:
    d["motion_noise"][0][0] = -0.1


EDITS: dict[str, tuple[Edit, str]] = {
    "matrix": (_matrix, "dynamics.matrix"),
    "inertia": (_inertia, "dynamics.matrix"),
    "no body": (_no_body, "dynamics.inertia is that of no body"),
    "not symmetric": (_not_symmetric, "dynamics.inertia is that of no body"),
    "sensor_offset": (_offset, "dynamics.matrix"),
    "covariance": (_covariance, "dynamics.covariance"),
    "with_parameters": (_between, "dynamics.covariance, with_parameters and covariance"),
    "shape": (_shape, "dynamics.covariance"),
    "bandwidth": (_bandwidth, "dynamics.bandwidth"),
    "motion_noise": (_noise, "dynamics.motion_noise"),
}


@pytest.mark.parametrize("what", EDITS)
def test_an_edited_file_is_refused_by_name(tmp_path: Path, what: str) -> None:
    edit, named = EDITS[what]
    path = tmp_path / "tool.json"
    calibrated().save(path)
    values = json.loads(path.read_text(encoding="utf-8"))
    edit(values["dynamics"])
    path.write_text(json.dumps(values), encoding="utf-8")
    with pytest.raises(FileFormatError) as refused:
        cw.Calibration.load(path)
    assert named in str(refused.value)
    assert "\n" not in str(refused.value)


def test_dynamics_of_a_model_without_a_tool_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "tool.json"
    cw.calibrate(calibrated_samples(), "affine").save(path)
    values = json.loads(path.read_text(encoding="utf-8"))
    other = tmp_path / "other.json"
    calibrated().save(other)
    values["dynamics"] = json.loads(other.read_text(encoding="utf-8"))["dynamics"]
    path.write_text(json.dumps(values), encoding="utf-8")
    with pytest.raises(FileFormatError, match="model affine has dynamics and no tool, expected a rigid model"):
        cw.Calibration.load(path)
