"""Identification on the rig against the figures of an independent simulation, and planned poses on two kinematics."""

from __future__ import annotations

import numpy as np
import pytest

from contactwrench.assess.robot_arms import flange_orientation, known_arm
from contactwrench.simulate.kinematics import flange_pose
from contactwrench.simulate.rig import build
from reproduction import identification, planned
from reproduction.methods import Method, calibrated
from reproduction.part import root_mean_square
from reproduction.trials import DEFAULT, free_readings, joints_of_paper, left_by, recordings, unseen_joints
from tests.support.experiments import cell, figures, one_thread, undrawn

pytest.importorskip("mujoco")


@pytest.mark.slow
@pytest.mark.parametrize(("model", "newtons"), [("paper", 0.486), ("yaw", 0.085)])
def test_the_rig_gives_the_figures_of_the_method_page(model: str, newtons: float) -> None:
    free = free_readings(DEFAULT, unseen_joints())
    learn = calibrated(model, model)
    rngs = [np.random.default_rng((11, number)) for number in range(10)]
    left = [left_by(learn(samples), free).force for samples in recordings(DEFAULT, joints_of_paper(), rngs)]
    found = root_mean_square(left)
    assert found.standard_error is not None
    assert abs(found.value - newtons) < 3.5 * found.standard_error


def test_what_is_left_is_judged_by_the_rig() -> None:
    """A method that takes nothing off leaves the reading itself, the bias and the tool's weight."""
    free = free_readings(DEFAULT, unseen_joints())
    nothing = left_by(Method("nothing", np.zeros((6, 4)), np.array([0.0, 0.0, -1.0])), free)
    bias, weight = np.array(DEFAULT.sensor.bias[:3]), DEFAULT.tool.mass * DEFAULT.gravity
    assert nothing.force == pytest.approx(bias @ bias + weight**2, rel=0.02)


def test_planned_joints_bring_the_rig_where_the_planner_thinks() -> None:
    joints = planned.planned_joints(6)
    R, _ = flange_pose(build(DEFAULT), joints)
    np.testing.assert_allclose(R, flange_orientation(known_arm("iiwa7"), joints), atol=1e-9)


@pytest.mark.slow
def test_the_parts_repeat_themselves_and_say_how_many() -> None:
    with one_thread() as pool:
        first = identification.part(pool, 0.01, 4)
        with undrawn():
            again = identification.part(pool, 0.01, 4)
        poses = planned.part(pool, 0.01, 4)
    assert figures(first) == figures(again)
    assert first.paragraphs == again.paragraphs
    assert "2 data sets" in first.tables[0].note
    expected = {row: cell(first, "unseen", row, "expected: force, N").trials for row in ("paper", "ours")}
    assert expected == {"paper": 20_000, "ours": 60}
    assert "Fz reaches 1.177 N in 0" in first.paragraphs[2]
    assert cell(first, "parameters", "true", "G, N").value == pytest.approx(1.980)
    assert cell(first, "parameters", "true", "theta, deg").value == pytest.approx(33.918)
    assert abs(cell(first, "parameters", "ours: mean error", "F0x, N").value) < 0.1
    assert cell(first, "unseen", "gravity only", "force, N").value == pytest.approx(58.2, abs=0.1)
    assert cell(poses, "poses", "ours", "six planned: force, N").value < 0.1
    assert all(picture.html.startswith("<svg") for part in (first, poses) for picture in part.pictures)
