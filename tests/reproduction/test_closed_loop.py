"""The arm in a closed loop: servos, the sensor as a controller sees it, and contact forces by MuJoCo's own contacts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

mujoco = pytest.importorskip("mujoco")

from contactwrench.geometry.arrays import Array  # noqa: E402
from contactwrench.geometry.rotations import rotation_exp  # noqa: E402
from contactwrench.simulate.kinematics import HOME, flange_pose, joints_for  # noqa: E402
from contactwrench.simulate.rig import Rig, build, inverse_dynamics  # noqa: E402
from contactwrench.simulate.settings import Base, Mounting, Noise, Sensor, Settings  # noqa: E402
from reproduction.closed_loop import PERIOD, ClosedLoop, servo_rig  # noqa: E402
from reproduction.postures import roomy_joints  # noqa: E402
from reproduction.scenes import (  # noqa: E402
    BALL_RADIUS,
    CHAMFER,
    CLEARANCE,
    HOLE_RADIUS,
    PEG_RADIUS,
    PLATE,
    PLATE_STIFFNESS,
    PROBE,
    SIDES,
    TOOL,
    hole,
    peg_tool,
    tip_in_flange,
)

IDEAL = Sensor(
    bias=(0.0,) * 6, noise=Noise((0.0,) * 3, (0.0,) * 3), quantum=0.0, low_pass=0.0, delay=0.0, ranges=(1e6,) * 6
)
INTO = np.diag([1.0, -1.0, -1.0])


def probe(settings: Settings) -> Rig:
    return servo_rig(settings, PROBE, PLATE)


def over_plate(rig: Rig, R_base_plate: Array, spot: Array, height: float) -> tuple[Array, Array, Array]:
    """Flange pose, and joints there, with the ball at a height over the plate, square to it."""
    R = R_base_plate @ INTO @ rig.settings.R_flange_sensor.T
    position = spot + (BALL_RADIUS + height) * R_base_plate[:, 2] - R @ tip_in_flange(rig)
    return R, position, roomy_joints(build(rig.settings), R, position)


def test_the_servos_hold_a_pose_under_the_tools_weight() -> None:
    settings = Settings(tool=TOOL, base=Base(tilt_deg=(4.0, -7.0)))
    joints = np.array([0.4, 0.7, -0.3, -1.2, 0.5, 1.1, -0.8])
    R, position = (part[0] for part in flange_pose(build(settings), joints[None]))
    arm = ClosedLoop(probe(settings), joints, np.eye(3), np.array([0.0, 0.0, -5.0]), np.random.default_rng(0))
    for _ in range(60):
        arm.advance(R, position)
    assert np.abs(arm.position - position).max() < 1e-6
    assert np.abs(arm.R_base_flange - R).max() < 1e-6


def test_at_rest_the_reading_is_what_inverse_dynamics_says_of_the_same_pose() -> None:
    settings = Settings(tool=TOOL, sensor=IDEAL, mounting=Mounting(tilt_deg=(3.0, 2.0)), base=Base(on="wall"))
    joints = np.array([-0.4, 0.6, 0.3, -1.0, 0.9, 0.7, 0.2])
    truth = inverse_dynamics(build(settings), joints[None])
    arm = ClosedLoop(probe(settings), joints, np.eye(3), np.array([0.0, 0.0, -5.0]), np.random.default_rng(0))
    for _ in range(60):
        arm.advance(truth.R_base_flange[0], truth.position[0])
    assert arm.reading == pytest.approx(truth.wrench[0], abs=1e-6)


def test_the_flange_follows_a_moving_command_without_falling_behind() -> None:
    settings = Settings(tool=TOOL)
    R, start = (part[0] for part in flange_pose(build(settings), HOME[None]))
    arm = ClosedLoop(probe(settings), HOME, np.eye(3), np.array([0.0, 0.0, -5.0]), np.random.default_rng(0))
    velocity, turning = np.array([0.03, -0.02, 0.015]), np.array([0.1, 0.2, -0.15])
    steps = 150
    for k in range(1, steps + 1):
        arm.advance(rotation_exp(k * PERIOD * turning) @ R, start + k * PERIOD * velocity)
    assert arm.position == pytest.approx(start + steps * PERIOD * velocity, abs=2e-4)
    assert np.abs(arm.R_base_flange - rotation_exp(steps * PERIOD * turning) @ R).max() < 2e-3


@pytest.mark.parametrize("tilt", [(0.0, 0.0, 0.0), (0.4, -0.3, 0.2), (-1.1, 0.4, 0.0)])
def test_the_contact_force_is_the_plates_spring_and_what_the_sensor_feels(tilt: tuple[float, float, float]) -> None:
    """Three accounts of one force: the spring's travel, MuJoCo's contacts, and the sensor less the free tool."""
    settings = Settings(tool=TOOL, sensor=IDEAL)
    rig = probe(settings)
    R_base_plate, spot = rotation_exp(np.array(tilt)), np.array([0.55, 0.05, 0.35])
    R, position, joints = over_plate(rig, R_base_plate, spot, 0.0005)
    arm = ClosedLoop(rig, joints, R_base_plate, spot, np.random.default_rng(0))
    normal = R_base_plate[:, 2]
    for k in range(150):
        arm.advance(R, position - min(0.0012, 1e-5 * k) * normal)
    trace = arm.trace()
    force = trace.force[-1]
    free = inverse_dynamics(build(settings), trace.qpos[-1:, :7])
    felt = R @ settings.R_flange_sensor @ (arm.reading - free.wrench[0])[:3]
    assert np.linalg.norm(force) > 5.0
    assert force @ normal == pytest.approx(-PLATE_STIFFNESS * trace.qpos[-1, 7], rel=1e-3)
    assert felt == pytest.approx(force, abs=0.01)
    assert trace.point[-1] == pytest.approx(spot + (trace.qpos[-1, 7]) * normal, abs=2e-4)


def test_a_place_in_the_axes_of_the_work_is_told_from_where_the_spring_let_it_sink() -> None:
    settings = Settings(tool=TOOL, sensor=IDEAL, base=Base(tilt_deg=(4.0, -7.0)))
    rig = probe(settings)
    R_base_plate, spot = rotation_exp(np.array([0.4, -0.3, 0.2])), np.array([0.55, 0.05, 0.35])
    R, position, joints = over_plate(rig, R_base_plate, spot, 0.0005)
    arm = ClosedLoop(rig, joints, R_base_plate, spot, np.random.default_rng(0))
    beside = np.array([0.03, -0.02, 0.01])
    assert arm.in_work(spot + R_base_plate @ beside) == pytest.approx(beside, abs=1e-9)
    for k in range(150):
        arm.advance(R, position - min(0.0012, 1e-5 * k) * R_base_plate[:, 2])
    sunk = arm.largest_force / PLATE_STIFFNESS
    assert sunk > 2e-4
    assert arm.in_work(spot + R_base_plate @ beside) == pytest.approx(beside + np.array([0.0, 0.0, sunk]), abs=2e-5)


def test_the_contact_torque_is_that_of_the_force_at_its_point() -> None:
    settings = Settings(tool=TOOL, sensor=IDEAL)
    rig = probe(settings)
    R_base_plate, spot = rotation_exp(np.array([0.3, 0.2, 0.0])), np.array([0.55, 0.05, 0.35])
    _, _, joints = over_plate(rig, R_base_plate, spot, 0.0005)
    R = R_base_plate @ rotation_exp(np.array([0.3, -0.4, 0.0])) @ INTO @ settings.R_flange_sensor.T
    position = spot + BALL_RADIUS * R_base_plate[:, 2] - R @ tip_in_flange(rig)
    arm = ClosedLoop(
        rig, joints_for(build(settings), R, position, joints), R_base_plate, spot, np.random.default_rng(0)
    )
    for k in range(150):
        arm.advance(R, position - min(0.0006, 1e-5 * k) * R_base_plate[:, 2])
    trace = arm.trace()
    free = inverse_dynamics(build(settings), trace.qpos[-1:, :7])
    R_base_sensor = arm.R_base_flange @ settings.R_flange_sensor
    sensor = arm.position + arm.R_base_flange @ np.array([0.0, 0.0, settings.mounting.height])
    expected = R_base_sensor.T @ np.cross(trace.point[-1] - sensor, trace.force[-1])
    assert np.linalg.norm(expected) > 0.2
    assert (arm.reading - free.wrench[0])[3:] == pytest.approx(expected, abs=2e-3)


def test_same_seed_same_readings() -> None:
    def readings(seed: int) -> list[Array]:
        settings = Settings(tool=TOOL)
        R, start = (part[0] for part in flange_pose(build(settings), HOME[None]))
        arm = ClosedLoop(probe(settings), HOME, np.eye(3), np.array([0.0, 0.0, -5.0]), np.random.default_rng(seed))
        found = []
        for _ in range(5):
            arm.advance(R, start)
            found.append(arm.reading)
        return found

    assert np.array_equal(readings(3), readings(3))
    assert not np.array_equal(readings(3), readings(4))


def touching_pairs(offset: Array, height: float, tilt: Array) -> int:
    """How many contacts there are with the peg's end at a place in the hole's axes, the peg tilted about it."""
    settings = replace(Settings(tool=TOOL), base=Base(tilt_deg=(2.0, 3.0)))
    rig = servo_rig(settings, peg_tool(), hole())
    R_base_hole, mouth = rotation_exp(np.array([0.2, -0.3, 0.5])), np.array([0.55, 0.05, 0.3])
    R = R_base_hole @ rotation_exp(tilt) @ INTO @ settings.R_flange_sensor.T
    position = mouth + R_base_hole @ np.array([*offset, height]) - R @ tip_in_flange(rig)
    plain = build(settings)
    data = mujoco.MjData(rig.model)
    data.qpos[:7] = joints_for(plain, R, position)
    data.qpos[10] = 1.0
    data.mocap_pos[0] = settings.R_world_base @ mouth
    mujoco.mju_mat2Quat(data.mocap_quat[0], (settings.R_world_base @ R_base_hole).ravel())
    mujoco.mj_forward(rig.model, data)
    return int(data.ncon)


@pytest.mark.parametrize("toward_a_flat", range(0, SIDES, 3))
def test_the_peg_has_its_clearance_and_no_more(toward_a_flat: int) -> None:
    angle = 2.0 * np.pi * toward_a_flat / SIDES
    sideways, straight = np.array([np.cos(angle), np.sin(angle)]), np.zeros(3)
    assert pytest.approx(CLEARANCE) == 2.0 * (HOLE_RADIUS - PEG_RADIUS)
    assert touching_pairs(0.4998 * CLEARANCE * sideways, -0.015, straight) == 0
    assert touching_pairs(0.5002 * CLEARANCE * sideways, -0.015, straight) > 0


def test_between_the_flats_the_clearance_is_that_of_a_polygon_round_the_circle() -> None:
    angle = np.pi / SIDES
    sideways = np.array([np.cos(angle), np.sin(angle)]) / np.cos(angle)
    assert touching_pairs(0.4998 * CLEARANCE * sideways, -0.015, np.zeros(3)) == 0
    assert touching_pairs(0.5002 * CLEARANCE * sideways, -0.015, np.zeros(3)) > 0


@pytest.mark.slow
def test_a_tilted_peg_jams_at_two_points() -> None:
    """A peg deep in the hole can tilt by clearance over depth, and no more: its end touches one wall, its side the
    edge across."""
    depth = 0.02 - CHAMFER

    def free(tilt: float) -> bool:
        sideways = np.linspace(-0.6, 0.6, 25) * CLEARANCE
        return any(touching_pairs(np.array([x, 0.0]), -0.02, np.array([0.0, tilt, 0.0])) == 0 for x in sideways)

    assert free(0.85 * CLEARANCE / depth)
    assert not free(1.25 * CLEARANCE / depth)
