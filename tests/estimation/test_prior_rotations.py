"""What is known of mounting and gravity together: its rows change with the tool as their derivative says."""

from __future__ import annotations

import numpy as np
import pytest

from contactwrench.estimation.priors import Knowledge, earlier_calibration, known_rotations
from contactwrench.model import PARAMETERS, RigidTool, stepped
from tests.support.world import random_rotations, tilted_down

NAMES = PARAMETERS["mount+base"]
STEP = 1e-6


def _pieces(tool: RigidTool, rng: np.random.Generator) -> dict[str, Knowledge]:
    root = rng.normal(size=(9, 9))
    R, d = tool.R_flange_sensor, tool.gravity_direction
    return {
        "earlier": earlier_calibration(tool, root @ root.T + np.eye(9)),
        "message": known_rotations(R, d, rng.normal(size=(4, 5)), rng.normal(size=4)),
    }


@pytest.mark.parametrize("which", ["earlier", "message"])
@pytest.mark.parametrize("tilt", [1e-6, 0.3, 2.5])
def test_derivative_of_the_rows(which: str, tilt: float) -> None:
    rng = np.random.default_rng(2)
    known = RigidTool(10.0, np.full(3, 0.02), np.zeros(6), random_rotations(1, rng)[0], tilted_down(0.2, rng))
    piece = _pieces(known, rng)[which]
    tool = stepped(known, np.r_[0.1, np.full(3, 0.01), np.zeros(6), 0.2, -0.1, 0.3, tilt, 0.5 * tilt], NAMES)
    for k, step in enumerate(STEP * np.eye(len(NAMES))):
        ahead, behind = (piece(stepped(tool, sign * step, NAMES), NAMES).residuals for sign in (1.0, -1.0))
        assert piece(tool, NAMES).jacobian[:, k] == pytest.approx((behind - ahead) / (2.0 * STEP), abs=1e-6)


def test_gravity_is_told_from_its_opposite() -> None:
    down = np.array([0.0, 0.0, -1.0])
    piece = known_rotations(np.eye(3), down, np.eye(5), np.zeros(5))
    opposite = RigidTool(10.0, np.zeros(3), np.zeros(6), np.eye(3), tilted_down(np.pi - 0.01, np.random.default_rng(0)))
    assert np.linalg.norm(piece(opposite, NAMES).residuals) == pytest.approx(np.pi - 0.01)
