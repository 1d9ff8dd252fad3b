"""Joint torque sensors, and contact force from them: against Pinocchio, levers, and exactly where nothing is wrong."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings

pytest.importorskip("mujoco", reason="mujoco is not installed")

from contactwrench.geometry.arrays import Array
from contactwrench.simulate.arm import MAX_TORQUE
from contactwrench.simulate.kinematics import paper_joints, random_joints
from contactwrench.simulate.recording import record_motion, record_poses
from contactwrench.simulate.rig import build, inverse_dynamics
from contactwrench.simulate.sensor import friction_torque, joint_torque_readings
from contactwrench.simulate.settings import Base, JointTorque, Mounting, Noise, Sensor, Settings, Tool
from contactwrench.simulate.trajectory import exciting
from reproduction import joint_torque_routes
from reproduction.joint_torque_routes import (
    COM_ERROR,
    CROSSTALK,
    FORCE,
    GAIN_ERROR,
    MASS_ERROR,
    PUSH,
    ROUTES,
    WRENCH,
    ZEROED_FORCE,
    ZEROED_WRENCH,
    ModelError,
    any_wrist_sensor,
    arm_gravity,
    force_from_torques,
    one_robot,
    pushed,
    smallest_singular_value,
    squared_errors,
    stretching,
    tool_wrench,
    wrench_from_torques,
    zeroed,
)
from reproduction.joint_torque_sensors import any_robot, sensor_jacobians, torque_against
from reproduction.joint_torques import STEADY, part
from reproduction.methods import Method, calibrated
from reproduction.part import Measured, Part
from tests.support.experiments import undrawn
from tests.support.pinocchio_arm import any_joints, any_settings, arm_of, judge
from tests.support.rigs import seeds
from tests.test_benchmarks import Here

few = hypothesis_settings(max_examples=15, deadline=None)
NOTHING = (0.0,) * 7
RIGHT = JointTorque(noise=0.0, offset=NOTHING, gain=(1.0,) * 7, friction=0.0)
QUIET = Sensor(noise=Noise((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)), quantum=0.0)
NO_ERROR = ModelError(np.zeros(7), np.zeros((7, 3)))
FORWARDS = np.array([0.0, np.pi / 2.0, 0.0, 0.0, 0.0, 0.0, 0.0])
"""The arm stretched out along the base's x, level; the flange too."""


def _truth(settings: Settings) -> Method:
    """The method of compensation that knows everything."""
    weight, com, R = settings.tool.mass * settings.gravity, np.array(settings.tool.com), settings.R_flange_sensor
    force = weight * R.T
    B = np.column_stack([np.vstack([force, np.cross(com, force, axisb=0, axisc=0)]), settings.sensor.bias])
    return Method("truth", B, settings.gravity_direction)


@few
@given(seeds)
def test_a_push_is_the_same_to_both_judges(seed: int) -> None:
    rng = np.random.default_rng(seed)
    settings = any_settings(rng)
    rig, arm, joints = build(settings, 0.3), arm_of(settings, 0.3), any_joints(rng, 3)
    push = pushed(rig, joints, rng)
    assert np.linalg.norm(push.contact[:, :3], axis=1) == pytest.approx(PUSH)
    assert push.contact[:, 3:] == pytest.approx(np.cross(settings.tool.hook, push.contact[:, :3]))
    for k in range(3):
        judged = judge(arm, joints[k], push=push.contact[k])
        assert push.under.joint_torque[k] == pytest.approx(judged.joint_torque, abs=1e-9)
        assert push.under.wrench[k] == pytest.approx(judged.wrench, abs=1e-9)


def test_a_push_at_the_end_of_a_lever_is_felt_at_its_root() -> None:
    """926 mm from the shoulder to the flange, 30 to the sensor, 100 to the hook."""
    rig = build(Settings(mounting=Mounting(yaw_deg=0.0)))
    jacobians = sensor_jacobians(rig, FORWARDS[None])
    lever, hook = 0.926 + 0.03 + 0.1, np.array([0.0, 0.0, 0.1])
    # the sensor's z is the base's x, its y the base's y, its x down
    sideways, upwards, outwards = (
        torque_against(jacobians, np.concatenate([force, np.cross(hook, force)])[None])[0]
        for force in np.array([[0.0, 10.0, 0.0], [-10.0, 0.0, 0.0], [0.0, 0.0, 10.0]])
    )
    # pushed to +y, joint 1 must hold towards -y: a negative turn about z
    assert sideways[[0, 1, 3, 5]] == pytest.approx([-10.0 * lever, 0.0, 0.0, 0.0], abs=1e-12)
    # pushed up, joint 2, which turns the arm down, holds with a positive torque
    assert upwards[[0, 1]] == pytest.approx([0.0, 10.0 * lever], abs=1e-12)
    assert outwards == pytest.approx(np.zeros(7), abs=1e-12)


@pytest.mark.slow
@few
@given(seeds)
def test_without_errors_both_ways_are_exact(seed: int) -> None:
    rng = np.random.default_rng(seed)
    settings = Settings(
        tool=Tool(mass=float(rng.uniform(0.1, 2.0)), com=(0.01, -0.02, 0.05), hook=(0.03, -0.02, 0.12)),
        mounting=Mounting(float(rng.uniform(-180.0, 180.0)), (4.0, -3.0)),
        base=Base("wall", (10.0, -20.0)),
        sensor=replace(QUIET, ranges=(1e3,) * 6),
        joint_torque=RIGHT,
    )
    rig, truth = build(settings), _truth(settings)
    joints = random_joints(rig, 40, rng)
    steady = smallest_singular_value(sensor_jacobians(rig, joints), settings.tool.hook) > 1e-3
    push = pushed(rig, joints[steady], rng)
    errors = np.sqrt(squared_errors(rig, (truth, truth), NO_ERROR, np.zeros(7), push, rng))
    assert errors.shape == (len(ROUTES), steady.sum())
    assert errors.max() < 1e-7


def test_the_tools_own_wrench_is_what_it_weighs() -> None:
    settings = Settings(base=Base("ceiling", (3.0, 5.0)), mounting=Mounting(50.0, (170.0, 4.0)))
    physics = inverse_dynamics(build(settings), any_joints(np.random.default_rng(1), 20))
    assert tool_wrench(_truth(settings), physics.R_base_flange) == pytest.approx(physics.wrench, abs=1e-12)


def test_the_arms_own_gravity_is_that_of_an_arm_without_a_tool() -> None:
    settings = Settings(base=Base("table", (10.0, 5.0)))
    joints = any_joints(np.random.default_rng(2), 5)
    bare = arm_of(replace(settings, tool=replace(settings.tool, mass=1e-12)))
    torque = arm_gravity(settings, NO_ERROR, joints)
    assert torque == pytest.approx(np.array([judge(bare, q).joint_torque for q in joints]), abs=1e-7)


def test_zeroed_joint_sensors_have_no_offset_and_keep_every_other_error() -> None:
    """With offsets alone the zeroed routes are exact; with a gain too, an error is left."""
    rng = np.random.default_rng(12)
    offset = (3.0, -2.0, 1.0, 4.0, -1.0, 0.5, -0.7)
    for gain, exact in ((1.0, True), (1.01, False)):
        settings = Settings(
            mounting=Mounting(40.0, (3.0, -2.0)),
            base=Base("table", (5.0, -8.0)),
            sensor=replace(QUIET, ranges=(1e3,) * 6),
            joint_torque=replace(RIGHT, offset=offset, gain=(gain,) * 7),
        )
        rig, truth = build(settings), _truth(settings)
        zero = zeroed(rig, truth, NO_ERROR, record_poses(settings, paper_joints(build(Settings())), rng=rng))
        # the arm alone is one with a tool of 1e-9 kg, 1e-8 N m at a lever of a metre
        assert (np.abs(zero - offset).max() < 2e-8) == exact
        joints = random_joints(rig, 40, rng)
        joints = joints[smallest_singular_value(sensor_jacobians(rig, joints), settings.tool.hook) > 0.01]
        errors = np.sqrt(squared_errors(rig, (truth, truth), NO_ERROR, zero, pushed(rig, joints, rng), rng))
        error = dict(zip(ROUTES, errors.max(axis=1), strict=True))
        assert min(error[WRENCH], error[FORCE]) > 1.0
        assert (max(error[ZEROED_WRENCH], error[ZEROED_FORCE]) < 1e-6) == exact


def test_any_wrist_sensor_is_off_in_gain_and_cross_talk_as_stated() -> None:
    rng, ranges = np.random.default_rng(13), np.array(Settings().sensor.ranges)
    sensors = [any_wrist_sensor(Settings(tool=Tool(mass=0.3)), rng) for _ in range(300)]
    assert {one.tool.mass for one in sensors} == {0.3}
    gain = np.array([one.sensor.gain for one in sensors])
    assert gain.std() == pytest.approx(GAIN_ERROR, rel=0.1)
    assert gain.mean() == pytest.approx(1.0, abs=5.0 * GAIN_ERROR / np.sqrt(gain.size))
    # each other axis at its full range, as a share of the range of the axis that shows it
    shown = np.array([one.sensor.crosstalk for one in sensors]) * ranges / ranges[:, None]
    assert np.all(np.diagonal(shown, axis1=1, axis2=2) == 0.0)
    assert shown[:, ~np.eye(6, dtype=bool)].std(axis=0) == pytest.approx(np.full(30, CROSSTALK), rel=0.25)


@pytest.mark.parametrize(
    ("link", "mass", "lever", "outwards"),
    [
        (2, 3.6, 0.060, (0.0, -1.0, 0.0)),
        (3, 3.4, 0.200 + 0.120, (0.0, 0.0, 1.0)),
        (4, 3.3, 0.400 + 0.060, (0.0, 1.0, 0.0)),
        (5, 2.0, 0.600 + 0.100, (0.0, 0.0, 1.0)),
        (6, 2.8, 0.800, (0.0, -1.0, 0.0)),
        (7, 0.7, 0.881 + 0.020, (0.0, 0.0, 1.0)),
    ],
)
def test_a_wrong_mass_is_felt_at_its_lever(
    link: int, mass: float, lever: float, outwards: tuple[float, float, float]
) -> None:
    """About the shoulder, from which the arm is stretched out level: a link's axis `outwards` is along the arm and its
    x is down. Every link, because MuJoCo has a short cut for those with their centre of mass at their origin.
    """
    settings, joints = Settings(), FORWARDS[None]
    which = np.eye(7)[link - 1]
    right = arm_gravity(settings, NO_ERROR, joints)[0]

    def more(error: ModelError) -> Array:
        torque: Array = arm_gravity(settings, error, joints)[0] - right
        return torque

    heavier = more(ModelError(which, np.zeros((7, 3))))
    assert heavier[1] == pytest.approx(-mass * 9.80665 * lever, abs=1e-9)
    longer = more(ModelError(np.zeros(7), np.outer(which, outwards) * 0.01))
    assert longer[1] == pytest.approx(-mass * 9.80665 * 0.01, abs=1e-9)
    lower = more(ModelError(np.zeros(7), np.outer(which, [0.01, 0.0, 0.0])))
    assert lower == pytest.approx(np.zeros(7), abs=1e-12)


@pytest.mark.parametrize(
    ("name", "joints_deg"),
    [
        ("stretched up", (0, 0, 0, 0, 0, 0, 0)),
        ("stretched out", (0, 90, 0, 0, 0, 0, 0)),
        ("elbow straight", (20, 40, 10, 0, 30, 60, 5)),
        ("wrist straight, shoulder across", (10, 50, 90, -70, 90, 0, 0)),
    ],
)
def test_singular_configurations_are_known_as_such(name: str, joints_deg: tuple[float, ...]) -> None:
    rig = build(Settings())
    jacobians = sensor_jacobians(rig, np.deg2rad([joints_deg]))
    assert smallest_singular_value(jacobians, (0.0, 0.0, 0.1))[0] < 1e-9, name
    # a force that no joint feels is not found, and nothing is invented for it
    unfelt = np.linalg.svd(jacobians[0].T)[2][-1]
    assert torque_against(jacobians, unfelt[None]) == pytest.approx(np.zeros((1, 7)), abs=1e-9)
    assert wrench_from_torques(jacobians, -torque_against(jacobians, unfelt[None])) == pytest.approx(0.0, abs=1e-6)


def test_away_from_singularities_a_wrench_comes_back_from_its_torques() -> None:
    rig, rng = build(Settings()), np.random.default_rng(3)
    jacobians = sensor_jacobians(rig, random_joints(rig, 50, rng))
    jacobians = jacobians[smallest_singular_value(jacobians, (0.0, 0.0, 0.0)) > 0.01]
    wrench = rng.normal(size=(len(jacobians), 6))
    assert wrench_from_torques(jacobians, -torque_against(jacobians, wrench)) == pytest.approx(wrench, abs=1e-9)
    at = np.array([0.02, -0.05, 0.2])
    force = wrench[:, :3]
    felt = -torque_against(jacobians, np.hstack([force, np.cross(at, force)]))
    assert force_from_torques(jacobians, at, felt) == pytest.approx(force, abs=1e-9)


def test_the_line_ends_close_to_the_stretched_arm() -> None:
    rig = build(Settings())
    distance = smallest_singular_value(sensor_jacobians(rig, stretching(rig)), rig.settings.tool.hook)
    assert np.all(np.diff(distance) < 0.0)
    # an elbow that lacks s of being straight is bent by about sqrt(2 s (1 / 0.4 + 1 / 0.4)): so goes the distance
    assert distance[-1] / distance[-3] == pytest.approx(np.sqrt(0.001 / 0.01), rel=0.05)


def test_a_wrong_torque_makes_an_error_that_grows_into_a_singularity() -> None:
    """In inverse proportion to the singular value, for the worst torque there is."""
    rig = build(Settings())
    jacobians = sensor_jacobians(rig, stretching(rig))
    worst = np.linalg.svd(jacobians.swapaxes(1, 2))[0][:, :, 5]
    error = np.linalg.norm(wrench_from_torques(jacobians, worst), axis=1)
    assert error * smallest_singular_value(jacobians, (0.0, 0.0, 0.0)) == pytest.approx(np.ones(len(error)))


def test_readings_have_their_gain_offset_and_noise() -> None:
    sensors = JointTorque(
        noise=0.2, offset=(1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0), gain=(1.1, 0.9, 1.0, 1.0, 1.0, 1.0, -1.0), friction=0.3
    )
    torque, friction = np.full((20_000, 7), 10.0), np.full((20_000, 7), 0.5)
    readings = joint_torque_readings(sensors, torque, friction, np.random.default_rng(5))
    expected = 10.5 * np.array(sensors.gain) + sensors.offset
    assert readings.mean(axis=0) == pytest.approx(expected, abs=5.0 * 0.2 / np.sqrt(20_000))
    assert readings.std(axis=0) == pytest.approx(np.full(7, 0.2), rel=5.0 / np.sqrt(2.0 * 20_000))


def test_friction_is_along_the_motion_and_anything_up_to_it_at_rest() -> None:
    velocity = np.zeros((20_000, 7))
    velocity[:, :2] = [0.5, -1e-6]
    friction = friction_torque(JointTorque(friction=0.3), velocity, np.random.default_rng(6))
    assert np.all(friction[:, 0] == 0.3)
    assert np.all(friction[:, 1] == -0.3)
    at_rest = friction[:, 2:]
    assert np.abs(at_rest).max() <= 0.3
    assert at_rest.std() == pytest.approx(0.3 / np.sqrt(3.0), rel=0.02)
    assert at_rest.mean() == pytest.approx(0.0, abs=0.003)


def test_friction_stays_while_the_arm_stands_still() -> None:
    settings = Settings(joint_torque=replace(RIGHT, friction=0.2))
    settings = replace(settings, recording=replace(settings.recording, rows=5))
    joints = any_joints(np.random.default_rng(7), 4)
    recorded = record_poses(settings, joints, rng=np.random.default_rng(8))
    exact = inverse_dynamics(build(settings), joints).joint_torque
    friction = recorded.joint_torque.reshape(4, 5, 7) - exact[:, None]
    assert np.ptp(friction, axis=1).max() < 1e-12
    assert np.ptp(friction, axis=0).min() > 1e-3
    assert np.abs(friction).max() <= 0.2


def test_a_motion_is_recorded_with_the_friction_along_it() -> None:
    settings = Settings(joint_torque=replace(RIGHT, friction=0.2))
    motion = exciting(2.0, 100.0, np.random.default_rng(9))
    recorded = record_motion(settings, motion, rng=np.random.default_rng(10))
    exact = inverse_dynamics(build(settings), motion.joints, motion.velocity, motion.acceleration).joint_torque
    moving = np.abs(motion.velocity) > 1e-6
    assert (recorded.joint_torque - exact)[moving] == pytest.approx(0.2 * np.sign(motion.velocity)[moving], abs=1e-9)


def test_any_robot_is_within_the_makers_accuracy() -> None:
    rng = np.random.default_rng(11)
    robots = [any_robot(JointTorque(noise=0.7), rng) for _ in range(500)]
    offset = np.array([robot.offset for robot in robots]) / MAX_TORQUE
    gain = np.array([robot.gain for robot in robots]) - 1.0
    for error in (offset, gain):
        assert 0.0095 < np.abs(error).max() <= 0.01
        assert error.mean() == pytest.approx(0.0, abs=0.0005)
    assert np.all(np.abs(offset + gain) <= 0.02)
    assert {robot.noise for robot in robots} == {0.7}
    default = np.abs(JointTorque().offset) / MAX_TORQUE + np.abs(np.array(JointTorque().gain) - 1.0)
    assert default.max() <= 0.02


def _cells(found: Measured | str | None) -> float:
    assert isinstance(found, Measured)
    return found.value


def seeded(seed: int) -> Part:
    """By a wrist sensor that is calibrated with its mounting and its base known; `one_robot` is tested with `auto`."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(joint_torque_routes, "ours", calibrated("yaw", "ours"))
        return part(Here(), 0.0, seed)


@pytest.fixture(scope="module")
def small() -> Part:
    return seeded(3)


@pytest.mark.slow
def test_the_same_seed_has_the_same_figures(small: Part) -> None:
    with undrawn():
        again, other = seeded(3), seeded(4)
    assert (again.tables, again.paragraphs) == (small.tables, small.paragraphs)
    assert other.tables != small.tables


def test_the_part_has_its_figures(small: Part) -> None:
    workspace, by_distance, line, sources = small.tables
    assert [name for name, _ in workspace.rows] == list(ROUTES)
    assert sum(_cells(cells[0]) for _, cells in by_distance.rows) == pytest.approx(1.0)
    column = workspace.columns.index("median")
    median = {name: _cells(cells[column]) for name, cells in workspace.rows}
    assert 1.0 < median[WRENCH] < 20.0
    assert all(len(cells) == len(table.columns) for table in small.tables for _, cells in table.rows)
    assert all(f"{median[route]:.3g} N ({route})" in small.paragraphs[2] for route in ROUTES)
    near = {name: _cells(cells[by_distance.columns.index(WRENCH)]) for name, cells in by_distance.rows}
    assert f"more than {near['0 to 0.01']:.3g} N where" in small.paragraphs[3]
    assert f"more than {near['0.2 and more']:.3g} N where" in small.paragraphs[3]
    assert near["0.2 and more"] < near["0 to 0.01"]
    # the flange looks down, and the paper's six poses tilt it by up to 27 degrees (Table III, row 5)
    assert "within the tilts of up to 27 deg" in small.paragraphs[4]
    assert not any("e+" in paragraph for paragraph in small.paragraphs)
    assert len(line.rows) == 6
    *alone, by_chance, together = [_cells(cells[0]) for _, cells in sources.rows]
    assert max(alone) < together < np.sum(alone)
    assert by_chance == pytest.approx(np.hypot(alone[-2], alone[-1]), rel=0.1)
    assert f"{100 * MASS_ERROR:g} %" in sources.note
    assert f"{1e3 * COM_ERROR:g} mm" in sources.note
    (picture,) = small.pictures
    assert picture.html.startswith("<svg")
    assert all(route in picture.html for route in ROUTES)


def test_the_sum_of_the_sources_is_what_the_route_shows() -> None:
    """Reading by reading with all errors, against the errors of the torques added up, for one robot."""
    robot = one_robot(np.random.SeedSequence(3))
    steady = robot.distance >= STEADY
    for source, route in enumerate((WRENCH, FORCE)):
        summed = robot.sources[-1, source, steady].mean()
        assert np.sqrt(summed) == pytest.approx(np.sqrt(robot.workspace[ROUTES.index(route), steady].mean()), rel=0.05)
