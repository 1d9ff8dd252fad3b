"""The measurement model against world-frame physics, and its derivatives against finite differences of that physics."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from contactwrench.model import (
    PARAMETERS,
    RigidTool,
    free_wrench,
    gravity_in_flange,
    horizontal_axes,
    matrix_jacobian,
    stepped,
    wrench_jacobian,
    wrench_matrix,
    yaw_of_mounting,
)
from tests.support.rigs import example, seeds
from tests.support.world import Array, Rig, random_rotations, readings, tilted_down

FLIPPED = np.diag([1.0, -1.0, -1.0])
RIGID = ("yaw", "mount", "mount+base")


def _tool(rig: Rig) -> RigidTool:
    return RigidTool(rig.weight, rig.com, rig.bias, rig.R_flange_sensor, rig.down)


def _physics(tool: RigidTool, R: Array) -> Array:
    return readings(Rig(tool.weight, tool.com, tool.bias, tool.R_flange_sensor, tool.gravity_direction), R)


def _any_rig(seed: int) -> tuple[Rig, Array]:
    rig, R, rng = example(seed, poses=7)
    return replace(rig, down=tilted_down(rng.uniform(0.0, np.pi), rng)), R


@settings(deadline=None, max_examples=30)
@given(seed=seeds)
def test_the_matrix_b_is_the_physics(seed: int) -> None:
    rig, R = _any_rig(seed)
    r = gravity_in_flange(R, rig.down)
    assert r == pytest.approx(np.array([M.T @ rig.down for M in R]))
    assert free_wrench(wrench_matrix(_tool(rig)), r) == pytest.approx(readings(rig, R), abs=1e-10)


@settings(deadline=None, max_examples=20)
@given(seed=seeds, model=st.sampled_from(RIGID))
def test_derivative_of_the_wrench(seed: int, model: str) -> None:
    rig, R = _any_rig(seed)
    tool, names = _tool(rig), PARAMETERS[model]
    J = wrench_jacobian(tool, R, names)
    for k in range(len(names)):
        step = np.zeros(len(names))
        step[k] = 1e-5
        ahead, behind = stepped(tool, step, names), stepped(tool, -step, names)
        assert J[:, :, k] == pytest.approx((_physics(ahead, R) - _physics(behind, R)) / 2e-5, abs=1e-6)


@settings(deadline=None, max_examples=20)
@given(seed=seeds, model=st.sampled_from(RIGID))
def test_derivative_of_the_matrix_b(seed: int, model: str) -> None:
    tool, names = _tool(_any_rig(seed)[0]), PARAMETERS[model]
    J = matrix_jacobian(tool, names)
    assert J.shape == (24, len(names))
    for k in range(len(names)):
        step = np.zeros(len(names))
        step[k] = 1e-5
        ahead, behind = wrench_matrix(stepped(tool, step, names)), wrench_matrix(stepped(tool, -step, names))
        assert J[:, k] == pytest.approx((ahead - behind).ravel() / 2e-5, abs=1e-6)


@settings(deadline=None, max_examples=30)
@given(seed=seeds)
def test_steps_are_what_the_design_says(seed: int) -> None:
    rig, _ = _any_rig(seed)
    tool, rng = _tool(rig), np.random.default_rng(seed)
    step = 0.3 * rng.normal(size=15)
    moved = stepped(tool, step, PARAMETERS["mount+base"])
    assert moved.weight == pytest.approx(rig.weight + step[0])
    assert moved.com == pytest.approx(rig.com + step[1:4])
    assert moved.bias == pytest.approx(rig.bias + step[4:10])
    assert moved.R_flange_sensor == pytest.approx(rig.R_flange_sensor @ Rotation.from_rotvec(step[10:13]).as_matrix())
    assert np.arccos(np.clip(moved.gravity_direction @ rig.down, -1, 1)) == pytest.approx(np.hypot(*step[13:]))


@settings(deadline=None, max_examples=50)
@given(seed=seeds)
def test_axes_of_gravity_complete_it_to_a_right_handed_base(seed: int) -> None:
    d = tilted_down(float(np.random.default_rng(seed).uniform(0.0, np.pi)), np.random.default_rng(seed))
    base = np.stack([*horizontal_axes(d), d], axis=1)
    assert base.T @ base == pytest.approx(np.eye(3), abs=1e-12)
    assert np.linalg.det(base) == pytest.approx(1.0)


def _tilt(tilt: float, towards: float) -> Array:
    """The smallest rotation that tilts z by `tilt`."""
    turn: Array = Rotation.from_rotvec(tilt * np.array([np.cos(towards), np.sin(towards), 0.0])).as_matrix()
    return turn


@settings(deadline=None, max_examples=200)
@given(
    yaw=st.floats(-3.14, 3.14),
    tilt=st.floats(0.0, 1.55),
    towards=st.floats(0.0, 6.28),
    against=st.booleans(),
)
def test_yaw_is_what_the_smallest_tilt_leaves(yaw: float, tilt: float, towards: float, against: bool) -> None:
    untilted = (FLIPPED if against else np.eye(3)) @ Rotation.from_euler("z", yaw).as_matrix()
    found, flipped, _ = yaw_of_mounting(_tilt(tilt, towards) @ untilted)
    assert flipped is against
    assert np.angle(np.exp(1j * (found - yaw))) == pytest.approx(0.0, abs=1e-9)


@settings(deadline=None, max_examples=50)
@given(seed=seeds)
def test_derivative_of_yaw(seed: int) -> None:
    R = random_rotations(1, np.random.default_rng(seed))[0]
    _, _, derivative = yaw_of_mounting(R)
    for k in range(3):
        step = np.zeros(3)
        step[k] = 1e-6
        ahead, behind = (yaw_of_mounting(R @ Rotation.from_rotvec(s).as_matrix())[0] for s in (step, -step))
        change = float(np.angle(np.exp(1j * (ahead - behind))))
        # near a tilt of 90 deg the side flips: both sides are right there
        if abs(R[2, 2]) > 1e-3:
            assert derivative[k] == pytest.approx(change / 2e-6, rel=1e-3, abs=1e-5)


@pytest.mark.parametrize("yaw", [np.pi, -np.pi, np.pi - 1e-9, 3.0, -3.0])
@pytest.mark.parametrize("tilt", [0.0, 1e-9, 0.3])
def test_yaw_of_half_a_turn(yaw: float, tilt: float) -> None:
    found, _, derivative = yaw_of_mounting(_tilt(tilt, 0.7) @ Rotation.from_euler("z", yaw).as_matrix())
    assert np.angle(np.exp(1j * (found - yaw))) == pytest.approx(0.0, abs=1e-7)
    assert -np.pi <= found <= np.pi
    assert derivative[2] == pytest.approx(1.0)
