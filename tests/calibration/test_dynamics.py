"""The model of a tool that moves: against Pinocchio and MuJoCo, and by what any mechanics has to obey."""

from __future__ import annotations

from dataclasses import replace
from importlib.util import find_spec

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from scipy.spatial.transform import Rotation

from contactwrench.calibration.dynamics import (
    can_exist,
    elements,
    equal_ellipsoid,
    inertial_jacobian,
    inertial_matrix,
    second_moments,
    symmetric,
)
from contactwrench.errors import InputError
from contactwrench.model import PARAMETERS, RigidTool, free_wrench, gravity_in_flange, wrench_matrix
from contactwrench.samples.flange_motion import FlangeMotion
from contactwrench.simulate.rig import build, import_mujoco, inverse_dynamics
from tests.support.moving_tool import STANDARD_GRAVITY, MovingTool, any_motion, any_tool, exerted, known
from tests.support.pinocchio_arm import any_joints, any_settings
from tests.support.rigs import seeds
from tests.support.world import Array, perturbed, random_rotations

few = hypothesis_settings(max_examples=25, deadline=None)


def _predicted(tool: RigidTool, mass: float, inertia: Array, offset: Array, motion: FlangeMotion) -> Array:
    r = gravity_in_flange(motion.R_base_flange, tool.gravity_direction)
    return free_wrench(wrench_matrix(tool), r) + motion.terms @ inertial_matrix(tool, mass, inertia, offset).T


def _of(moving: MovingTool, motion: FlangeMotion) -> Array:
    return _predicted(moving.tool, moving.mass, moving.inertia, moving.offset, motion)


@few
@given(seeds)
def test_any_tool_in_any_motion_is_what_pinocchio_says(seed: int) -> None:
    rng = np.random.default_rng(seed)
    moving, motion = any_tool(rng), any_motion(5, rng)
    expected = exerted(moving, motion)
    assert np.abs(_of(moving, motion) - expected).max() < 1e-9 * max(1.0, float(np.abs(expected).max()))


@few
@given(seeds)
def test_the_arm_in_any_motion_is_what_mujoco_says(seed: int) -> None:
    rng = np.random.default_rng(seed)
    settings = any_settings(rng)
    rig, mujoco = build(settings), import_mujoco()
    joints, velocity, change = any_joints(rng, 3), rng.normal(size=(3, 7)), 5.0 * rng.normal(size=(3, 7))
    physics = inverse_dynamics(rig, joints, velocity, change)
    data, moves = mujoco.MjData(rig.model), np.zeros((3, 3, 3))
    for k in range(3):
        data.qpos[:], data.qvel[:], data.qacc[:] = joints[k], velocity[k], change[k]
        mujoco.mj_inverse(rig.model, data)
        mujoco.mj_rnePostConstraint(rig.model, data)
        twist, acceleration = np.zeros(6), np.zeros(6)
        mujoco.mj_objectVelocity(rig.model, data, mujoco.mjtObj.mjOBJ_SITE, rig.flange, twist, 1)
        mujoco.mj_objectAcceleration(rig.model, data, mujoco.mjtObj.mjOBJ_SITE, rig.flange, acceleration, 1)
        felt = data.site_xmat[rig.flange].reshape(3, 3).T @ [0.0, 0.0, settings.gravity]
        moves[k] = twist[:3], acceleration[:3], acceleration[3:] - felt
    motion = FlangeMotion(moves[:, 0], moves[:, 1], moves[:, 2], physics.R_base_flange, np.ones(3, np.bool_))
    mass, com, down = settings.tool.mass, np.array(settings.tool.com), settings.gravity_direction
    tool = RigidTool(mass * settings.gravity, com, np.zeros(6), settings.R_flange_sensor, down)
    offset = np.array([0.0, 0.0, settings.mounting.height])
    found = _predicted(tool, mass, settings.inertia, offset, motion)
    assert np.abs(found - physics.wrench).max() < 1e-9 * max(1.0, float(np.abs(physics.wrench).max()))


@few
@given(seeds)
def test_a_free_tool_in_any_motion_compensates_to_nothing(seed: int) -> None:
    moving, calibration = known(seed % 5)
    motion = any_motion(5, np.random.default_rng(seed))
    contact = calibration.compensate(exerted(moving, motion), motion.R_base_flange, motion=motion)
    assert np.abs(contact).max() < 1e-9


def test_a_push_in_motion_is_what_is_left() -> None:
    moving, calibration = known(0)
    rng = np.random.default_rng(3)
    motion, push = any_motion(20, rng), rng.normal(size=(20, 6))
    contact = calibration.compensate(exerted(moving, motion) + push, motion.R_base_flange, motion=motion)
    assert contact == pytest.approx(push, abs=1e-9)


@few
@given(seeds)
def test_another_base_changes_nothing(seed: int) -> None:
    moving, calibration = known(seed % 5, noise=1.0)
    rng = np.random.default_rng(seed)
    motion, turn = any_motion(4, rng), random_rotations(1, rng)[0]
    turned = replace(motion, R_base_flange=turn @ motion.R_base_flange)
    other = calibration.with_base(turn, "other")
    readings = exerted(moving, motion)
    contact = calibration.compensate(readings, motion.R_base_flange, motion=motion)
    assert other.compensate(readings, turned.R_base_flange, motion=turned) == pytest.approx(contact, abs=1e-9)
    std = calibration.wrench_std(motion.R_base_flange, motion)
    assert other.wrench_std(turned.R_base_flange, turned) == pytest.approx(std, rel=1e-7)


@pytest.mark.parametrize(
    ("turn", "message"),
    [
        (np.diag([1.0, 1.0, -1.0]), r"^orientation 0 is a matrix that is no rotation .* determinant -1\), expected "),
        (2.0 * np.eye(3), r"^orientation 0 is a matrix that is no rotation "),
        (np.full((3, 3), np.nan), r"^orientation 0 "),
        (np.zeros(4), r"^orientation 0 "),
        (np.eye(4), r"^R_new_base has 4 orientations, expected one$"),
        (np.ones((2, 3)), r"^orientation has shape \(2, 3\), expected "),
    ],
    ids=["mirrored", "twice", "nan", "zeros", "4 x 4", "shape"],
)
def test_a_base_that_is_turned_by_no_rotation_is_refused(turn: Array, message: str) -> None:
    calibration = known(0, noise=1.0)[1]
    with pytest.raises(InputError, match=message):
        calibration.with_base(turn, "other")


@few
@given(seeds)
def test_the_tool_gains_the_energy_that_the_sensor_gives_it(seed: int) -> None:
    """In flange axes; the power at the sensor is minus that of what the tool exerts on it."""
    rng = np.random.default_rng(seed)
    moving, motion = any_tool(rng), any_motion(4, rng)
    w, m, velocity = moving.world, moving.mass, rng.normal(size=(4, 3))
    R, inertia = w.R_flange_sensor, w.R_flange_sensor @ moving.inertia @ w.R_flange_sensor.T
    omega, alpha = motion.angular_velocity, motion.angular_acceleration
    lever = moving.offset + R @ w.com
    of_mass = velocity + np.cross(omega, lever)
    change = motion.acceleration + np.cross(alpha, lever) + np.cross(omega, np.cross(omega, lever))
    falls = STANDARD_GRAVITY * np.einsum("nij,i->nj", motion.R_base_flange, w.down)
    gained = np.sum(of_mass * m * (change - falls), axis=1) + np.sum(omega * (alpha @ inertia), axis=1)
    wrench = _of(moving, motion) - w.bias
    at_sensor = velocity + np.cross(omega, moving.offset)
    given = -np.sum(wrench[:, :3] @ R.T * at_sensor + wrench[:, 3:] @ R.T * omega, axis=1)
    assert given == pytest.approx(gained, rel=1e-9, abs=1e-9 * float(np.abs(gained).max()))


def test_at_rest_it_is_what_poses_tell() -> None:
    moving, calibration = known(1, noise=1.0)
    rng = np.random.default_rng(5)
    R = random_rotations(10, rng)
    rest = FlangeMotion(np.zeros((10, 3)), np.zeros((10, 3)), np.zeros((10, 3)), R, np.ones(10, np.bool_))
    readings = exerted(moving, rest)
    assert np.array_equal(calibration.compensate(readings, R, motion=rest), calibration.compensate(readings, R))
    assert np.array_equal(calibration.wrench_std(R, rest), calibration.wrench_std(R))


@pytest.mark.parametrize("model", ["yaw", "mount", "mount+base"])
def test_the_jacobian_is_that_of_finite_differences(model: str) -> None:
    rng = np.random.default_rng(7)
    moving, names = any_tool(rng), PARAMETERS[model]
    J = inertial_jacobian(moving.tool, moving.mass, moving.inertia, moving.offset, names)
    p, size = len(names), 1e-6

    def matrix(step: Array) -> Array:
        stepped = perturbed(moving.world, step[:p])
        after = MovingTool(stepped, moving.inertia + symmetric(step[p : p + 6]), moving.offset + step[p + 6 :])
        return inertial_matrix(after.tool, after.mass, after.inertia, after.offset)

    assert J.shape == (12, 6, p + 9)
    for k, unit in enumerate(size * np.eye(p + 9)):
        expected = (matrix(unit) - matrix(-unit)).T / (2.0 * size)
        assert J[:, :, k] == pytest.approx(expected, abs=1e-7), [*names, "inertia and offset"][min(k, p)]


def test_the_variance_in_motion_is_that_of_drawn_tools() -> None:
    """Weight, mass and whatever else correlate with the inertia, so that the variances do not just add up."""
    _, c = known(2, "mount", noise=1.0)
    assert c.dynamics is not None
    rng = np.random.default_rng(8)
    motion, names, p = any_motion(3, rng), c.parameter_names, len(c.parameters)
    joint = np.block(
        [[c.covariance, c.dynamics.with_parameters.T], [c.dynamics.with_parameters, c.dynamics.covariance]]
    )
    drawn = rng.multivariate_normal(np.zeros(p + 9), joint, 4000, method="svd")
    assert c.weight is not None
    assert c.com is not None
    assert c.R_flange_sensor is not None
    moving, _ = known(2, "mount", noise=1.0)
    world = replace(
        moving.world,
        weight=c.weight,
        com=c.com,
        bias=c.bias,
        R_flange_sensor=c.R_flange_sensor,
        down=c.gravity_direction,
    )
    wrenches = []
    for step in drawn:
        inertia, offset = c.dynamics.inertia + symmetric(step[p : p + 6]), c.dynamics.sensor_offset + step[p + 6 :]
        wrenches.append(_of(MovingTool(perturbed(world, step[:p]), inertia, offset), motion))
    assert names == PARAMETERS["mount"]
    assert c.wrench_std(motion.R_base_flange, motion) == pytest.approx(np.std(wrenches, axis=0), rel=0.06)


def test_what_shakes_goes_through_the_centre_of_mass() -> None:
    _, c = known(2, "mount", noise=1.0)
    assert c.dynamics is not None
    assert c.com is not None
    noise = np.array([[0.1, 0.2], [0.003, 0.004]])
    shaken = replace(c, dynamics=replace(c.dynamics, motion_noise=noise))
    motion = any_motion(3, np.random.default_rng(9))
    more = shaken.wrench_std(motion.R_base_flange, motion) ** 2 - c.wrench_std(motion.R_base_flange, motion) ** 2
    squares = np.column_stack([np.sum(motion.acceleration**2, axis=1), np.sum(motion.angular_velocity**2, axis=1)])
    force, torque = (squares @ (noise**2).T).T
    assert more[:, :3] == pytest.approx(np.tile(force[:, None], 3), rel=1e-9)
    of_force = np.sum(c.com**2) - c.com**2
    assert more[:, 3:] == pytest.approx(torque[:, None] + np.multiply.outer(force, of_force), rel=1e-9)


def test_accelerations_that_are_not_told_are_in_the_covariance() -> None:
    """As contact wrenches scatter that are computed with accelerations which are off by as much."""
    moving, c = known(3)
    rng = np.random.default_rng(10)
    motion = any_motion(1, rng)
    untold = rng.uniform(0.1, 2.0, size=(1, 6))
    more = c.covariance_in_motion(motion.R_base_flange, replace(motion, untold=untold))[0]
    more -= c.covariance_in_motion(motion.R_base_flange, motion)[0]
    off = np.sqrt(untold) * rng.normal(size=(20_000, 6))
    many = FlangeMotion(
        np.tile(motion.angular_velocity, (len(off), 1)),
        motion.angular_acceleration + off[:, :3],
        motion.acceleration + off[:, 3:],
        np.tile(motion.R_base_flange, (len(off), 1, 1)),
        np.ones(len(off), np.bool_),
    )
    readings = np.tile(exerted(moving, motion), (len(off), 1))
    drawn = np.cov(c.compensate(readings, many.R_base_flange, motion=many).T)
    assert more == pytest.approx(drawn, abs=0.05 * float(np.sqrt(np.outer(np.diag(drawn), np.diag(drawn))).max()))
    assert np.diag(more) == pytest.approx(np.diag(drawn), rel=0.05)


def test_elements_and_matrices_are_each_other() -> None:
    inertia = any_tool(np.random.default_rng(1)).inertia
    assert np.array_equal(symmetric(elements(inertia)), inertia)
    assert np.trace(second_moments(inertia)) == pytest.approx(0.5 * np.trace(inertia))


def test_which_inertias_exist() -> None:
    assert can_exist(np.diag([0.002, 0.003, 0.004]))
    assert can_exist(np.diag([0.002, 0.002, 0.004]))
    assert not can_exist(np.diag([0.002, 0.002, 0.0041]))
    assert not can_exist(np.diag([0.002, -0.002, 0.002]))


def test_a_motion_asks_for_an_inertia_and_for_as_many_moments_as_readings() -> None:
    moving, calibration = known(0)
    motion = any_motion(4, np.random.default_rng(1))
    readings = exerted(moving, motion)
    with pytest.raises(InputError, match=r"^found a motion and no inertia: calibrate with model dynamic, or leave"):
        replace(calibration, dynamics=None).compensate(readings, motion.R_base_flange, motion=motion)
    with pytest.raises(InputError, match=r"^found 4 moments of motion, expected 3, one for each reading$"):
        calibration.compensate(readings[:3], motion.R_base_flange[:3], motion=motion)


@pytest.mark.skipif(find_spec("numba") is None, reason="no numba")
@pytest.mark.parametrize("matrices", [True, False])
def test_compiled_and_plain_agree_in_motion(matrices: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Read-only or not, in a block that is not full, in place, with gaps in the readings and in the motion."""
    _, calibration = known(3)
    rng = np.random.default_rng(11)
    motion, wide = any_motion(1003, rng), rng.normal(size=(1003, 12))
    alpha, omega = motion.angular_acceleration.copy(), motion.angular_velocity.copy()
    alpha[7, 1], omega[500], wide[40, 4] = np.nan, np.nan, np.nan
    motion = replace(motion, angular_acceleration=alpha, angular_velocity=omega)
    R = motion.R_base_flange
    orientation = R if matrices else Rotation.from_matrix(R).as_quat()
    plain = calibration.compensate(wide[:, ::2], orientation, motion=motion)
    monkeypatch.setattr("contactwrench.subtract.FUSED_FROM", 1)
    readings = wide[:, ::2].copy()
    fused = calibration.compensate(readings, orientation, out=readings, motion=motion)
    assert np.array_equal(np.flatnonzero(np.isnan(plain).any(axis=1)), [7, 40, 500])
    assert np.array_equal(np.isnan(fused), np.isnan(plain))
    scale = np.nanmax(np.abs(plain))
    assert np.nanmax(np.abs(fused - plain)) < 1e-12 * scale
    assert np.nanmax(np.abs(calibration.compensate(wide[:, ::2], orientation, motion=motion) - plain)) < 1e-12 * scale


def test_a_single_reading_takes_a_single_moment_of_motion() -> None:
    moving, calibration = known(0)
    motion = any_motion(1, np.random.default_rng(2))
    contact = calibration.compensate(exerted(moving, motion)[0], motion.R_base_flange[0], motion=motion)
    assert contact.shape == (6,)
    assert contact == pytest.approx(np.zeros(6), abs=1e-9)


def test_an_ellipsoid_has_its_own_semi_axes_turned_flat_and_round() -> None:
    """Of a solid ellipsoid `I_x = m (b^2 + c^2) / 5`; of a flat one too, whose semi-axis is 0 to what two std make."""
    turn, mass = random_rotations(1, np.random.default_rng(12))[0], 1.7
    for a, b, c in ((0.09, 0.05, 0.02), (0.08, 0.04, 0.0), (0.03, 0.03, 0.03)):
        principal = mass / 5.0 * np.array([b * b + c * c, a * a + c * c, a * a + b * b])
        inertia = turn @ np.diag(principal) @ turn.T
        found = equal_ellipsoid(mass, inertia, np.diag([0.0, *[1e-10] * 6]))
        assert found.moments == pytest.approx(principal)
        assert found.semi_axes == pytest.approx([a, b, c], abs=1e-8)
        assert (found.axes * found.moments) @ found.axes.T == pytest.approx(inertia)
        assert (found.low <= found.semi_axes).all()
        assert (found.high > found.semi_axes).all()
        assert np.isfinite(found.high).all()


def test_the_ellipsoid_is_as_uncertain_as_ellipsoids_of_drawn_tools() -> None:
    rng = np.random.default_rng(13)
    turn, mass = random_rotations(1, rng)[0], 2.0
    inertia = turn @ np.diag([0.002, 0.005, 0.006]) @ turn.T
    root = rng.normal(size=(7, 7)) * np.r_[0.05, np.full(6, 4e-5)][:, None]
    found = equal_ellipsoid(mass, inertia, root @ root.T)
    drawn = []
    for off in rng.normal(size=(4000, 7)) @ root.T:
        moments = np.linalg.eigvalsh(inertia + symmetric(off[1:]))
        drawn.append([*moments, *(5.0 / (mass + off[0]) * (0.5 * moments.sum() - moments))])
    assert found.moment_std == pytest.approx(np.std(drawn, axis=0)[:3], rel=0.05)
    assert (found.high**2 - found.low**2) / 4.0 == pytest.approx(np.std(drawn, axis=0)[3:], rel=0.05)


def test_the_ellipsoid_of_a_calibration_is_that_of_its_mass_and_inertia() -> None:
    moving, c = known(2, "mount", noise=1.0)
    assert c.ellipsoid is not None
    assert c.mass is not None
    square = (c.ellipsoid.axes * c.ellipsoid.semi_axes**2) @ c.ellipsoid.axes.T
    assert square == pytest.approx(5.0 / c.mass * second_moments(moving.inertia), abs=1e-9)
    assert replace(c, dynamics=None).ellipsoid is None


def test_an_interval_goes_with_its_std() -> None:
    moving, c = known(2, "mount", noise=1.0)
    for name, value in (("inertia", elements(moving.inertia)), ("sensor_offset", moving.offset)):
        low, high = c.interval(name, 0.95)
        assert low.shape == high.shape == c.std[name].shape == value.shape
        assert (low + high) / 2.0 == pytest.approx(value)
        assert high - low == pytest.approx(2.0 * c.t_quantile(0.95) * c.std[name])
