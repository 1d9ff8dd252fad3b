"""What is known before the readings: every row's derivative is that of the row, for any tool."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings

import contactwrench as cw
from contactwrench.estimation.priors import (
    Knowledge,
    earlier_calibration,
    known_as,
    nominal_mounting,
)
from contactwrench.model import PARAMETERS, RigidTool, stepped
from tests.support.recordings import PANDA
from tests.support.rigs import seeds
from tests.support.world import random_rig, tilted_down

NAMES = PARAMETERS["mount+base"]


def _tool(rng: np.random.Generator) -> RigidTool:
    rig = random_rig(rng)
    return RigidTool(rig.weight, rig.com, rig.bias, rig.R_flange_sensor, tilted_down(rng.uniform(0.0, 1.5), rng))


def _pieces(tool: RigidTool, rng: np.random.Generator) -> dict[str, Knowledge]:
    """Every piece of knowledge, of a tool that is another one than `tool` by a few degrees, and so on."""
    other = stepped(tool, 0.03 * rng.normal(size=len(NAMES)), NAMES)
    factor = rng.normal(size=(9, 9))
    return {
        "weight": known_as("weight", other.weight, 0.1),
        "com": known_as("com", other.com, np.array([0.001, 0.002, 0.003])),
        "mounting": known_as("mount", other.R_flange_sensor, np.array([0.01, 0.02, 0.03])),
        "gravity": known_as("gravity", other.gravity_direction, 0.01),
        "nominal mounting": nominal_mounting(0.02),
        "earlier, at it": earlier_calibration(tool, factor @ factor.T + np.eye(9)),
    }


@pytest.mark.slow
@settings(deadline=None, max_examples=13)
@given(seed=seeds)
def test_derivatives_are_those_of_the_rows(seed: int) -> None:
    rng = np.random.default_rng(seed)
    tool = _tool(rng)
    for name, piece in _pieces(tool, rng).items():
        rows = piece(tool, NAMES)
        for k in range(len(NAMES)):
            step = np.zeros(len(NAMES))
            step[k] = 1e-6
            ahead, behind = (piece(stepped(tool, side * step, NAMES), NAMES).residuals for side in (1.0, -1.0))
            slope = (behind - ahead) / 2e-6
            assert slope == pytest.approx(rows.jacobian[:, k], abs=1e-4 * (1.0 + np.abs(rows.jacobian).max())), name


def test_one_pose_cannot_make_an_earlier_calibration_less_certain(tmp_path: Path) -> None:
    """A pose adds to what is known of tool, mounting and base, and the result is a file like any other."""
    samples = cw.read(PANDA)
    earlier = cw.calibrate(samples)
    zeroed = cw.Samples(samples.wrench[:1] - samples.wrench[5], samples.R_base_flange[:1])
    calibration = cw.calibrate(zeroed, prior=earlier)
    known = [k for k, name in enumerate(NAMES) if not name.startswith("bias")]
    gained = (earlier.covariance - calibration.covariance)[np.ix_(known, known)]
    unit = np.sqrt(np.diag(earlier.covariance))[known]
    assert np.linalg.eigvalsh(gained / np.outer(unit, unit))[0] > -1e-4
    assert np.isfinite(calibration.observability.condition)
    calibration.save(tmp_path / "rezeroed.json")
    assert cw.Calibration.load(tmp_path / "rezeroed.json").weight == calibration.weight
