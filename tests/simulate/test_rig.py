"""The rig's physics: against a second program's, against the maker's figures, and by what anyone can work out."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

pytest.importorskip("mujoco", reason="mujoco is not installed")

from contactwrench.assess import robot_arms
from contactwrench.assess.robot_arms import ARMS
from contactwrench.errors import InputError
from contactwrench.simulate import kinematics
from contactwrench.simulate.arm import BASE_MASS, JOINT_RANGE, LINKS
from contactwrench.simulate.kinematics import HOME, flange_jacobian, flange_pose, joints_for
from contactwrench.simulate.rig import build, import_mujoco, inverse_dynamics
from contactwrench.simulate.settings import Base, Settings, Tool
from tests.support.pinocchio_arm import any_joints, any_settings, arm_of, forward, judge
from tests.support.rigs import rotation_angle, seeds
from tests.support.world import Array, random_rotations

few = hypothesis_settings(max_examples=10, deadline=None)
loads = st.sampled_from([0.0, 0.1, 0.5, 1.0, 5.0])
ELBOW_OUT = np.array([0.4, 0.7, -0.3, -1.2, 0.5, 0.9, -0.6])


@few
@given(seeds, loads)
def test_a_pose_held_still_is_the_same_to_both_judges(seed: int, load_mass: float) -> None:
    rng = np.random.default_rng(seed)
    settings = any_settings(rng)
    joints = any_joints(rng, 3)
    physics = inverse_dynamics(build(settings, load_mass), joints)
    arm = arm_of(settings, load_mass)
    for k in range(3):
        judged = judge(arm, joints[k])
        assert physics.wrench[k] == pytest.approx(judged.wrench, abs=1e-9)
        assert physics.joint_torque[k] == pytest.approx(judged.joint_torque, abs=1e-9)
        assert physics.R_base_flange[k] == pytest.approx(judged.R_base_flange, abs=1e-12)
        assert physics.position[k] == pytest.approx(judged.position, abs=1e-12)


@few
@given(seeds, loads)
def test_a_moment_of_motion_is_the_same_to_both_judges(seed: int, load_mass: float) -> None:
    rng = np.random.default_rng(seed)
    settings = any_settings(rng)
    joints, velocity, acceleration = any_joints(rng, 3), rng.normal(size=(3, 7)), 3.0 * rng.normal(size=(3, 7))
    physics = inverse_dynamics(build(settings, load_mass), joints, velocity, acceleration)
    arm = arm_of(settings, load_mass)
    for k in range(3):
        judged = judge(arm, joints[k], velocity[k], acceleration[k])
        assert physics.wrench[k] == pytest.approx(judged.wrench, abs=1e-9)
        assert physics.joint_torque[k] == pytest.approx(judged.joint_torque, abs=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_integrated_motion_is_the_same_to_both_judges(seed: int) -> None:
    """A fifth of a second under changing torques: MuJoCo's steps against our own on Pinocchio's accelerations."""
    rng = np.random.default_rng(seed)
    settings = any_settings(rng)
    load_mass, step, rows = float(rng.uniform(0.1, 2.0)), 1e-3, 200
    mujoco = import_mujoco()
    rig = build(settings, load_mass, option=f'integrator="RK4" timestep="{step}"')
    arm = arm_of(settings, load_mass)
    data, pinocchio_data = mujoco.MjData(rig.model), arm.free.createData()
    q, v = ELBOW_OUT + 0.05 * any_joints(rng, 1)[0], np.zeros(7)
    data.qpos[:] = q
    held = inverse_dynamics(rig, q[None]).joint_torque[0]
    swing, rate = np.array([8.0, 8.0, 2.0, 4.0, 0.3, 1.0, 0.05]), rng.uniform(20.0, 40.0, 7)

    def change(q: Array, v: Array, torque: Array) -> tuple[Array, Array]:
        return v, forward(arm, pinocchio_data, q, v, torque)

    largest, farthest = np.zeros(3), np.zeros(7)
    for row in range(rows):
        torque = held + swing * np.sin(rate * step * row)
        data.qfrc_applied[:] = torque
        mujoco.mj_forward(rig.model, data)
        if row % 20 == 0:
            judged = judge(arm, q, v, forward(arm, pinocchio_data, q, v, torque))
            off = (data.qpos - q, data.qvel - v, -data.sensordata - judged.wrench)
            largest = np.maximum(largest, [np.abs(part).max() for part in off])
        farthest = np.maximum(farthest, np.abs(q - ELBOW_OUT))
        mujoco.mj_step(rig.model, data)
        k1 = change(q, v, torque)
        k2 = change(q + 0.5 * step * k1[0], v + 0.5 * step * k1[1], torque)
        k3 = change(q + 0.5 * step * k2[0], v + 0.5 * step * k2[1], torque)
        k4 = change(q + step * k3[0], v + step * k3[1], torque)
        q = q + step / 6.0 * (k1[0] + 2.0 * k2[0] + 2.0 * k3[0] + k4[0])
        v = v + step / 6.0 * (k1[1] + 2.0 * k2[1] + 2.0 * k3[1] + k4[1])
    assert farthest.min() > 1e-3
    assert np.all(np.abs(ELBOW_OUT) + farthest < JOINT_RANGE)
    assert largest.max() < 1e-6


@pytest.mark.parametrize("load_mass", [0.0, 0.5])
def test_a_hanging_tool_pulls_down(load_mass: float) -> None:
    """Tool straight down, sensor turned by nothing: +z of the sensor is down, and it reads the weight there."""
    settings = Settings(tool=Tool(mass=1.5, com=(0.02, -0.01, 0.06), hook=(0.0, 0.0, 0.1)))
    rig = build(settings, load_mass)
    physics = inverse_dynamics(rig, joints_for(rig, np.diag([1.0, -1.0, -1.0]))[None])
    weight = settings.gravity * (1.5 + load_mass)
    assert physics.wrench[0, :3] == pytest.approx([0.0, 0.0, weight], abs=1e-8)
    # com x (weight * down): (0.02, -0.01) x 1.5 g along z
    assert physics.wrench[0, 3:] == pytest.approx(np.array([-0.01, -0.02, 0.0]) * 1.5 * settings.gravity, abs=1e-8)


@given(seeds)
@few
def test_a_tool_at_rest_weighs_the_same_in_any_pose(seed: int) -> None:
    rng = np.random.default_rng(seed)
    settings = any_settings(rng)
    rig = build(settings)
    joints = any_joints(rng, 2)
    physics = inverse_dynamics(rig, joints)
    down = physics.R_base_flange.transpose(0, 2, 1) @ settings.gravity_direction @ settings.R_flange_sensor
    weight = settings.tool.mass * settings.gravity
    assert physics.wrench[:, :3] == pytest.approx(weight * down, abs=1e-9)
    assert physics.wrench[:, 3:] == pytest.approx(np.cross(settings.tool.com, weight * down), abs=1e-9)


def test_the_arm_weighs_what_its_data_sheet_says() -> None:
    rig = build(Settings(tool=Tool(mass=0.4)), 0.6)
    assert rig.model.body_mass.sum() == pytest.approx(23.9 + 1.0, abs=1e-9)
    assert sum(link.mass for link in LINKS) + BASE_MASS == pytest.approx(23.9, abs=1e-9)


def test_every_link_is_a_body_that_can_exist() -> None:
    """The principal moments of a body obey the triangle inequality."""
    for link in LINKS:
        small, middle, large = np.sort(link.inertia)
        assert small > 0.0
        assert large <= small + middle + 1e-15


def test_lengths_are_the_makers() -> None:
    """KUKA: stretched up, 1266 mm from the floor to the flange; the shoulder at 340, 400 to the elbow and the wrist."""
    rig = build(Settings())
    up, forwards, elbow_up, elbow_down, wrist_down = joints = np.zeros((5, 7))
    forwards[1] = elbow_up[1] = elbow_down[1] = wrist_down[1] = wrist_down[5] = np.pi / 2.0
    elbow_up[3], elbow_down[3] = np.pi / 2.0, -np.pi / 2.0
    R, position = flange_pose(rig, joints)
    expected = [[0.0, 0.0, 1.266], [0.926, 0.0, 0.34], [0.4, 0.0, 0.866], [0.4, 0.0, -0.186], [0.8, 0.0, 0.214]]
    assert position == pytest.approx(np.array(expected), abs=1e-12)
    assert R[0] == pytest.approx(np.eye(3), abs=1e-12)
    assert not up.any()


@given(seeds)
@few
def test_the_wrist_is_never_further_than_its_reach_from_the_shoulder(seed: int) -> None:
    R, position = flange_pose(build(Settings()), any_joints(np.random.default_rng(seed), 50))
    wrist = position - 0.126 * R[:, :, 2]
    assert np.linalg.norm(wrist - [0.0, 0.0, 0.34], axis=1).max() <= 0.8 + 1e-12


@given(seeds)
@few
def test_the_flange_is_where_the_table_of_arms_says(seed: int) -> None:
    """robot_arms.py has the iiwa 7 from its data sheet, in another way."""
    joints = any_joints(np.random.default_rng(seed), 20)
    R, position = flange_pose(build(Settings(base=Base("wall", (3.0, -8.0)))), joints)
    R_of_table, position_of_table = robot_arms.flange_pose(ARMS["iiwa7"], joints)
    assert pytest.approx(R_of_table, abs=1e-12) == R
    assert pytest.approx(position_of_table, abs=1e-12) == position
    assert ARMS["iiwa7"].limits[:, 1] == pytest.approx(JOINT_RANGE)
    assert ARMS["iiwa7"].home == pytest.approx(HOME)


@given(seeds)
@few
def test_the_jacobian_is_how_the_flange_moves(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rig = build(any_settings(rng))
    joints, speed, step = any_joints(rng, 1)[0], rng.normal(size=7), 1e-6
    R, position = flange_pose(rig, np.array([joints - step * speed, joints, joints + step * speed]))
    spin = (R[2] - R[0]) / (2.0 * step) @ R[1].T
    moved = [*(position[2] - position[0]) / (2.0 * step), spin[2, 1], spin[0, 2], spin[1, 0]]
    assert flange_jacobian(rig, joints) @ speed == pytest.approx(moved, abs=1e-7)


@given(seeds)
@few
def test_a_pose_that_was_reached_once_is_reached_again(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rig = build(Settings(base=Base("ceiling", (5.0, 3.0))))
    R, position = flange_pose(rig, 0.9 * any_joints(rng, 1))
    joints = joints_for(rig, R[0], position[0])
    assert np.all(np.abs(joints) <= JOINT_RANGE)
    found, where = flange_pose(rig, joints[None])
    assert rotation_angle(found[0], R[0]) < 1e-9
    assert where[0] == pytest.approx(position[0], abs=1e-9)


@given(seeds)
@few
def test_any_orientation_is_reached_when_the_place_is_free(seed: int) -> None:
    rig = build(Settings())
    R = random_rotations(1, np.random.default_rng(seed))[0]
    joints = joints_for(rig, R, near=ELBOW_OUT)
    assert rotation_angle(flange_pose(rig, joints[None])[0][0], R) < 1e-9
    assert np.array_equal(joints, joints_for(rig, R, near=ELBOW_OUT))


def test_joints_stay_where_they_are_when_the_pose_is_there_already() -> None:
    rig = build(Settings())
    R, position = flange_pose(rig, ELBOW_OUT[None])
    assert joints_for(rig, R[0], position[0], ELBOW_OUT) == pytest.approx(ELBOW_OUT, abs=1e-12)


def test_a_pose_out_of_reach_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kinematics, "TRIES", 2)  # more find no more
    with pytest.raises(InputError) as refused:
        joints_for(build(Settings()), np.eye(3), np.array([0.0, 1.2, 0.34]))
    assert str(refused.value) == (
        "the iiwa 7 was not found to reach a flange pose at 0, 1.2, 0.34 m, expected one in its workspace: move it"
    )


def test_a_negative_load_is_refused() -> None:
    with pytest.raises(InputError) as refused:
        build(Settings(), -0.1)
    assert str(refused.value) == "the load is -0.1 kg, expected 0 or more"
