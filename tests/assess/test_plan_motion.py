"""A recording for model `dynamic`: the flange's motion against differences of poses, limits, rest, what it tells."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contactwrench.assess import plan_motion as motion_design
from contactwrench.assess.fourier_motion import FLANGE_SPEED, TURN_ACCELERATION, TURN_SPEED, limits_of, moving_flange
from contactwrench.assess.plan import READINGS, Expected
from contactwrench.assess.plan_motion import STOP, plan_motion
from contactwrench.assess.robot_arms import ARMS, MARGIN, Arm, flange_pose
from contactwrench.calibration.dynamics import inertial_jacobian
from contactwrench.errors import InputError
from contactwrench.geometry.arrays import Array
from contactwrench.geometry.wrench import STANDARD_GRAVITY
from contactwrench.model import PARAMETERS
from contactwrench.recording.urdf import read_urdf
from contactwrench.simulate.trajectory import exciting
from tests.assess.test_robot_arms import urdf_of
from tests.support.recordings import written

FEW_STEPS = 10


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """A search that keeps the limits as any, and finds less."""
    monkeypatch.setattr(motion_design, "STEPS", FEW_STEPS)
    monkeypatch.setattr(motion_design, "STARTS", 2)


def largest(vectors: Array) -> float:
    return float(np.linalg.norm(vectors, axis=1).max())


@pytest.mark.parametrize("name", ARMS)
def test_a_flange_moves_as_its_poses_differ(name: str) -> None:
    arm, h = ARMS[name], 1e-4
    t = h * np.arange(-1.0, 2.0)[:, None]
    a, b, c = np.random.default_rng(3).normal(size=(3, len(arm)))
    joints = a + b * np.sin(t) + c * np.cos(2.0 * t)
    flange = moving_flange(
        arm, joints, b * np.cos(t) - 2.0 * c * np.sin(2.0 * t), -b * np.sin(t) - 4.0 * c * np.cos(2.0 * t)
    )
    R, position = flange_pose(arm, joints)
    acceleration = R[1].T @ (position[2] - 2.0 * position[1] + position[0]) / h**2
    turned = R[1].T @ (R[2] - R[0]) / (2.0 * h)
    omega = flange.motion.angular_velocity
    np.testing.assert_allclose(flange.position, position, atol=1e-12)
    np.testing.assert_allclose(flange.speed[1], np.linalg.norm(position[2] - position[0]) / (2.0 * h), atol=1e-5)
    np.testing.assert_allclose(flange.motion.acceleration[1], acceleration, atol=1e-5)
    np.testing.assert_allclose(omega[1], [turned[2, 1], turned[0, 2], turned[1, 0]], atol=1e-5)
    np.testing.assert_allclose(flange.motion.angular_acceleration[1], (omega[2] - omega[0]) / (2.0 * h), atol=1e-5)


@pytest.mark.parametrize("name", ["ur5e", "iiwa7", "fr3"])
@pytest.mark.usefixtures("quick")
def test_an_arm_keeps_its_limits(name: str) -> None:
    """Of six joints and of seven, with stated accelerations and without."""
    plan = plan_motion(ARMS[name], n=3)
    arm, limits = plan.arm, plan.limits
    t = np.arange(0.0, plan.duration, 1e-3)
    q, qd, qdd = plan.at(t)
    flange = moving_flange(arm, q, qd, qdd)
    moving = t > plan.duration - STOP - plan.motion.duration
    assert ((arm.limits[:, 0] + MARGIN <= q) & (q <= arm.limits[:, 1] - MARGIN)).all()
    assert (np.abs(qd) <= limits.speed).all()
    assert (np.abs(qdd) <= limits.acceleration).all()
    assert (limits.speed < np.where(np.isnan(arm.max_speed), 2.0, arm.max_speed)).all()
    assert largest(flange.motion.angular_velocity) <= TURN_SPEED
    assert largest(flange.motion.angular_acceleration) <= TURN_ACCELERATION
    assert flange.speed.max() <= FLANGE_SPEED
    assert flange.position[:, 2].min() >= 0.15
    assert largest(flange.position[moving] - flange.position[0]) <= 0.1
    assert plan.motion.duration <= 30.0


@pytest.mark.usefixtures("quick")
def test_it_starts_and_ends_at_rest_where_it_stands_and_rests_at_the_stops() -> None:
    plan = plan_motion(ARMS["panda"], n=3)
    ends = np.array([0.0, plan.duration - STOP, plan.duration])
    q, qd, qdd = plan.at(ends)
    np.testing.assert_allclose(q, np.tile(np.round(plan.arm.home, 4), (3, 1)), atol=1e-12)
    np.testing.assert_allclose(np.concatenate([qd, qdd]), 0.0, atol=1e-11)
    inside = plan.motion.at(np.arange(plan.motion.periods + 1) / plan.motion.frequency)
    np.testing.assert_allclose(inside[0] - plan.motion.start, 0.0, atol=1e-12)
    np.testing.assert_allclose(inside[1:], 0.0, atol=1e-11)
    arrives = np.cumsum(np.r_[0.0, plan.moves + STOP])
    for k, joints in enumerate(plan.visited):
        q, qd, _ = plan.at(arrives[k] + np.linspace(0.0, STOP, 7)[:-1])
        np.testing.assert_allclose(q, np.tile(joints, (6, 1)), atol=1e-9)
        np.testing.assert_allclose(qd, 0.0, atol=1e-9)


@pytest.mark.usefixtures("quick")
def test_velocities_and_accelerations_are_derivatives() -> None:
    plan = plan_motion(ARMS["ur5e"], n=2)
    t, h = np.random.default_rng(0).uniform(0.01, plan.duration - 0.01, 300), 1e-5
    before, at, after = (plan.at(t + late) for late in (-h, 0.0, h))
    np.testing.assert_allclose((after[0] - before[0]) / (2.0 * h), at[1], atol=1e-7)
    np.testing.assert_allclose((after[1] - before[1]) / (2.0 * h), at[2], atol=1e-3)


@pytest.mark.usefixtures("quick")
def test_the_same_question_has_the_same_answer() -> None:
    one, other = (plan_motion(ARMS["fr3"], n=2) for _ in range(2))
    np.testing.assert_array_equal(one.motion.sine, other.motion.sine)
    np.testing.assert_array_equal(one.std, other.std)
    assert one.motion.frequency == other.motion.frequency


def information(arm: Arm, expected: Expected, joints: tuple[Array, Array, Array], rate: float) -> Array:
    """Of inertia and offset (9, 9) from a motion at that rate, tool and all known but the bias, reading by reading."""
    tool, noise = expected.tool, expected.noise
    names = PARAMETERS["mount+base"]
    of_terms = inertial_jacobian(tool, tool.weight / STANDARD_GRAVITY, np.eye(3), np.zeros(3), names)[
        :, :, len(names) :
    ]
    J = np.einsum("nk,kip->nip", moving_flange(arm, *joints).motion.terms, of_terms) / noise[:, None]
    J -= J.mean(axis=0)
    total: Array = READINGS / rate * np.einsum("nip,niq->pq", J, J)
    return total


@pytest.mark.slow
def test_the_bound_is_that_of_the_readings_and_far_below_a_random_motion(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """By the ninth root of the determinant, a mean variance: a random one would have to go on for as many times."""
    monkeypatch.setattr(motion_design, "STEPS", 200)
    monkeypatch.setattr(motion_design, "STARTS", 4)
    plan, rate = plan_motion(ARMS["iiwa7"]), 200.0
    known = plan.arm, plan.stops.expected
    told = information(*known, plan.motion.at(np.arange(0.0, plan.motion.duration, 1.0 / rate)), rate)
    np.testing.assert_allclose(plan.std, np.sqrt(np.diag(np.linalg.inv(told))), rtol=1e-2)
    assert (plan.std_after_stops > plan.std).all()
    of_random = []
    for seed in range(2):
        motion = exciting(plan.motion.duration, rate, np.random.default_rng(seed))
        random = information(*known, (motion.joints, motion.velocity, motion.acceleration), rate)
        of_random.append((np.linalg.slogdet(told)[1] - np.linalg.slogdet(random)[1]) / 9.0)
    assert np.exp(min(of_random)) > 15.0  # 18 to 34, and 19 to 36 with all steps


def test_a_nearer_flange_or_less_time_is_kept(quick: None) -> None:
    plan = plan_motion(ARMS["iiwa7"], n=2, duration=12.0, within=0.03, above=0.3)
    assert plan.motion.duration <= 12.0
    position = moving_flange(plan.arm, *plan.motion.at(np.arange(0.0, plan.motion.duration, 0.001))).position
    assert largest(position - position[0]) <= 0.03
    assert plan.largest.lowest >= 0.3


def test_the_speeds_of_a_urdf_are_its_limits(tmp_path: Path) -> None:
    text = urdf_of("ur5e")
    for unknown in ("", 'velocity="0"'):
        read = read_urdf(written(tmp_path, text.replace('velocity="1"', unknown), "none.urdf"))
        assert np.isnan(read.max_speed).all()
    arm = read_urdf(written(tmp_path, text.replace('velocity="1"', 'velocity="2.5"'), "fast.urdf"))
    np.testing.assert_array_equal(arm.max_speed, np.full(6, 2.5))
    np.testing.assert_allclose(limits_of(arm, ARMS["ur5e"].home).speed, 2.0)


def test_one_joint_that_cannot_turn_about_every_axis_is_told(quick: None) -> None:
    whole = ARMS["ur5e"]
    last = replace(
        whole,
        name="last",
        **{name: getattr(whole, name)[-1:] for name in ("R_before", "axis", "limits", "max_speed", "max_acceleration")},
        home=np.zeros(1),
        offset=np.array([[0.0, 0.0, 0.5], whole.offset[-1]]),
    )
    with pytest.raises(
        InputError, match=r"^no motion of last tells inertia_.*, expected turns about every axis: take "
    ):
        plan_motion(last, n=2)


def test_a_move_between_stops_stays_above(quick: None) -> None:
    complaint = (
        r"^the flange of ur5e is 0\.4\d+ m above the plane of its base between two stops, expected 0\.47 m or more: "
        r"start elsewhere \(--around\), or state --above$"
    )
    with pytest.raises(InputError, match=complaint):
        plan_motion(ARMS["ur5e"], n=6, above=0.47)


NEAR_ITS_LIMIT = np.array([0.0, 0.5, 0.0, -1.0, 0.0, 2.0, 0.0])


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (
            {"around": NEAR_ITS_LIMIT},
            "q6 of iiwa7 stands 5.4 deg from its limit, expected 15 deg or more, to swing: start elsewhere (--around)",
        ),
        (
            {"above": 0.7},
            "the flange of iiwa7 starts 0.56 m above the plane of its base, expected 0.7 m or more: start elsewhere "
            "(--around), or state --above",
        ),
        (
            {"above": 0.5599},
            "found no motion of iiwa7 that keeps its limits from here, expected room around it: start elsewhere "
            "(--around), or state --above, --within or a longer --duration",
        ),
        ({"duration": 3.0}, "duration is 3, expected 10 to 600 s"),
        ({"within": 300.0}, "within is 300, expected 0.01 to 10 m (is it in mm?)"),
        ({"above": 150.0}, "above is 150, expected -10 to 10 m (is it in mm?)"),
    ],
)
def test_what_cannot_be_planned_is_said(arguments: dict[str, Any], complaint: str) -> None:
    with pytest.raises(InputError) as refusal:
        plan_motion(ARMS["iiwa7"], n=2, **arguments)
    assert str(refusal.value) == complaint
