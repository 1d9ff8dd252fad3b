"""Prior work: exact under its own assumptions, and wrong by as much as the physics says when one fails."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from contactwrench.errors import UnobservableError
from contactwrench.simulate.settings import Base, Mounting, Settings, Tool
from reproduction import prior_work
from reproduction.methods import Learn, calibrated
from reproduction.prior_work import known_mounting, opposite_joints, opposite_poses
from reproduction.trials import DEFAULT, free_readings, joints_of_paper, unseen_joints
from tests.support.experiments import PRECISE, cell, figures, noise_free, one_thread, recorded, undrawn

pytest.importorskip("mujoco")


def rig(yaw_deg: float, seed: int) -> Settings:
    """Another tool on another mounting, free of noise, and light enough for the sensor's range in every pose."""
    rng = np.random.default_rng(seed)
    x, y, z = (float(value) for value in rng.uniform(-0.025, 0.025, size=3))
    tool = Tool(mass=float(rng.uniform(0.1, 0.5)), com=(x, y, z))
    return noise_free(replace(DEFAULT, tool=tool, mounting=Mounting(yaw_deg=yaw_deg)))


def largest_left(learn: Learn, settings: Settings, joints: np.ndarray) -> float:
    free = free_readings(settings, unseen_joints())
    method = learn(recorded(settings, joints))
    return float(np.abs(method.contact(free.wrench, free.R_base_flange)).max())


@pytest.mark.slow
@pytest.mark.parametrize(("yaw_deg", "seed"), [(33.918, 1), (-117.0, 2), (171.0, 3)])
def test_each_idea_is_exact_where_its_assumptions_hold(yaw_deg: float, seed: int) -> None:
    settings = rig(yaw_deg, seed)
    assert largest_left(opposite_poses(yaw_deg), settings, opposite_joints()) < PRECISE
    assert largest_left(known_mounting(yaw_deg), settings, opposite_joints()) < PRECISE
    assert largest_left(known_mounting(yaw_deg), settings, joints_of_paper()) < 20.0 * PRECISE
    tilted = replace(settings, mounting=Mounting(yaw_deg=yaw_deg, tilt_deg=(25.0, -40.0)))
    assert largest_left(calibrated("mount", "upright base"), tilted, opposite_joints()) < PRECISE


@pytest.mark.parametrize("off_deg", [2.0, -33.918, 90.0])
def test_a_yaw_that_is_off_leaves_what_the_physics_says(off_deg: float) -> None:
    """Gravity turned by the error, with the weight that the least squares make of it: (1 + 2 cos) / 3 of the true."""
    settings = rig(20.0, 5)
    free = free_readings(settings, unseen_joints())
    gravity = free.wrench[:, :3] - np.array(settings.sensor.bias[:3])
    weight = settings.tool.mass * settings.gravity
    u = gravity / weight
    cos = np.cos(np.deg2rad(off_deg))
    found = weight * (1.0 + 2.0 * cos) / 3.0
    between = cos * (u[:, 0] ** 2 + u[:, 1] ** 2) + u[:, 2] ** 2
    expected = np.sqrt(weight**2 + found**2 - 2.0 * weight * found * between)
    for idea in (opposite_poses, known_mounting):
        method = idea(20.0 + off_deg)(recorded(settings, opposite_joints()))
        left = np.linalg.norm(method.contact(free.wrench, free.R_base_flange)[:, :3], axis=1)
        np.testing.assert_allclose(left, expected, atol=PRECISE)
        np.testing.assert_allclose(method.B[:, 3], settings.sensor.bias, atol=PRECISE)


def test_on_balanced_poses_both_ideas_are_the_same_least_squares() -> None:
    samples = recorded(DEFAULT, opposite_joints(), seed=8)
    methods = [idea(30.0)(samples) for idea in (opposite_poses, known_mounting)]
    np.testing.assert_allclose(methods[0].B, methods[1].B, atol=1e-8)


def test_a_tilted_base_breaks_what_takes_it_for_upright() -> None:
    settings = noise_free(replace(DEFAULT, base=Base(tilt_deg=(2.0, 0.0))))
    turned = settings.tool.mass * settings.gravity * np.deg2rad(2.0)
    for learn in (calibrated("mount", "upright base"), known_mounting(33.918), opposite_poses(33.918)):
        assert 0.5 * turned < largest_left(learn, settings, opposite_joints()) < 3.0 * turned


def test_poses_that_an_idea_cannot_use_are_refused() -> None:
    with pytest.raises(UnobservableError, match="pairs of opposite poses"):
        opposite_poses(0.0)(recorded(DEFAULT, joints_of_paper()))
    with pytest.raises(UnobservableError, match="10 unknowns"):
        known_mounting(0.0)(recorded(DEFAULT, np.repeat(joints_of_paper()[:1], 3, axis=0)))


@pytest.mark.slow
def test_the_part_prints_every_idea_and_repeats_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    quick = {name: learn for name, learn in prior_work.ESTIMATORS.items() if "yaw" in name or name == "paper"}
    monkeypatch.setattr(
        prior_work, "ESTIMATORS", {**quick, "upright base (mount)": quick["paper"], "ours": quick["paper"]}
    )
    with one_thread() as pool, undrawn():
        first, again, other = (prior_work.part(pool, 0.01, seed) for seed in (1, 1, 2))
    assert figures(first) == figures(again) != figures(other)
    assert first.paragraphs == again.paragraphs
    assert 0.8 < cell(first, "level_base", "known mounting, yaw 34 deg off", "six planned").value < 1.1
    refused = dict(first.tables[0].rows)["opposite poses, yaw exact"]
    assert [isinstance(one, str) for one in refused] == [False, True, True]
    assert "expected three along different axes" in first.tables[0].note
    assert "opposite poses, yaw exact (six planned 2 of 2, paper's six 2 of 2)" in first.tables[0].note
    assert "known mounting" not in first.tables[0].note
