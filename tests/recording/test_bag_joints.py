"""Joint states to the flange's orientation, against Pinocchio: named by a URDF, or as the drivers of known arms do."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import contactwrench as cw
from contactwrench.errors import FileFormatError, InputError
from tests.assess.test_robot_arms import poses_by_pinocchio, urdf_of
from tests.support.bags import KINDS, START, bag_streams, joint_state, wrench_stamped, write_bag
from tests.support.moving import whole_arm
from tests.support.recordings import written
from tests.support.world import Array

UR_JOINTS = [
    "shoulder_pan_joint",
    "shoulder_lift_joint",
    "elbow_joint",
    "wrist_1_joint",
    "wrist_2_joint",
    "wrist_3_joint",
]
"""Universal_Robots_ROS2_Description, ur_macro.xacro, from the base outwards."""


def _by_pinocchio(name: str, joints: Array) -> Array:
    return poses_by_pinocchio(urdf_of(name), "tool0", joints)[0]


def _angles(n: int, count: int) -> Array:
    angles: Array = np.random.default_rng(count).uniform(-2.0, 2.0, (n, count))
    return angles


def _bag(path: Path, names: list[str], joints: Array) -> Path:
    messages = [joint_state(0.01 * k, names, row) for k, row in enumerate(joints)]
    return write_bag(path, [wrench_stamped(0.0, np.ones(6)), *messages])


@pytest.mark.parametrize("kind", KINDS)
def test_joints_are_found_by_the_names_of_the_urdf(tmp_path: Path, kind: str) -> None:
    """In any order, with a gripper's between them."""
    arm = str(written(tmp_path, urdf_of("iiwa14"), "arm.urdf"))
    joints, names = _angles(20, 9), ["finger", "j3", "j7", "j1", "j2", "gripper", "j6", "j5", "j4"]
    streams = bag_streams(_bag(tmp_path / f"run{kind}", names, joints), robot=arm)
    in_order = joints[:, [names.index(f"j{k}") for k in range(1, 8)]]
    R, position = poses_by_pinocchio(urdf_of("iiwa14"), "tool0", in_order)
    np.testing.assert_allclose(streams.orientation.R_base_flange, R, atol=1e-12)
    assert streams.orientation.position == pytest.approx(position, abs=1e-12)
    np.testing.assert_allclose(streams.orientation.t - 1e-9 * START, 0.01 * np.arange(20), atol=5e-7)
    assert streams.orientation.source == f"{tmp_path / f'run{kind}'} /joint_states of arm.urdf:tool0"


@pytest.mark.parametrize(
    ("arm", "names", "order"),
    [
        ("ur5e", sorted(UR_JOINTS), [sorted(UR_JOINTS).index(name) for name in UR_JOINTS]),
        ("ur5e", [f"left_{name}" for name in UR_JOINTS], list(range(6))),
        ("ur5e", ["elbow", "shoulder_lift", "shoulder_pan", "wrist_1", "wrist_2", "wrist_3"], [2, 1, 0, 3, 4, 5]),
        ("panda", [f"panda_joint{k}" for k in range(7, 0, -1)], list(range(6, -1, -1))),
        (
            "panda",
            [*(f"panda_joint{k}" for k in range(1, 8)), "panda_finger_joint1", "panda_finger_joint2"],
            list(range(7)),
        ),
        ("panda", ["panda_finger_joint1", *(f"panda_joint{k}" for k in range(1, 8))], list(range(1, 8))),
        ("iiwa14", [f"lbr_A{k}" for k in range(1, 8)], list(range(7))),
        ("iiwa14", [f"joint_{k}" for k in range(7)], list(range(7))),
        ("iiwa14", list("abcdefg"), list(range(7))),
        ("iiwa14", [], list(range(7))),
    ],
)
def test_joints_of_a_known_arm_are_found_as_its_drivers_name_them(
    tmp_path: Path, arm: str, names: list[str], order: list[int]
) -> None:
    joints = _angles(5, max(len(names), 7))
    found = bag_streams(_bag(tmp_path / "run.mcap", names, joints), robot=arm).orientation
    np.testing.assert_allclose(found.R_base_flange, _by_pinocchio(arm, joints[:, order]), atol=1e-12)


def test_a_gripper_of_its_own_on_the_same_topic_is_passed_over(tmp_path: Path) -> None:
    joints, names = _angles(6, 7), [f"panda_joint{k}" for k in range(1, 8)]
    messages = [wrench_stamped(0.0, np.ones(6))]
    for k, row in enumerate(joints):
        messages.append(joint_state(0.01 * k, names, row))
        messages.append(joint_state(0.01 * k, ["panda_finger_joint1", "panda_finger_joint2"], [0.01, 0.02]))
        messages.append(joint_state(0.01 * k, names, []))
    found = bag_streams(write_bag(tmp_path / "run.bag", messages), robot="panda").orientation
    np.testing.assert_allclose(found.R_base_flange, _by_pinocchio("panda", joints), atol=1e-12)


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (
            list("abcdef"),
            "found the joints a, b, c, d, e, f, expected those of iiwa14 (7 numbered joints): name the arm's "
            "URDF with --robot",
        ),
        (
            [f"{side}_joint_{k}" for side in ("l", "r") for k in range(1, 8)],
            "found the joints l_joint_1, l_joint_2, "
            "l_joint_3, l_joint_4, l_joint_5, l_joint_6, l_joint_7, r_joint_1, r_joint_2, r_joint_3, r_joint_4, "
            "r_joint_5, ..., expected those of iiwa14 (7 numbered joints): name the arm's URDF with --robot",
        ),
    ],
)
def test_joints_of_another_arm_or_of_two_are_refused(tmp_path: Path, names: list[str], message: str) -> None:
    path = _bag(tmp_path / "run.mcap", names, _angles(2, len(names)))
    with pytest.raises(FileFormatError) as caught:
        bag_streams(path, robot="iiwa14")
    assert str(caught.value) == f"{path}: topic /joint_states: {message}"


def test_joints_that_the_urdf_names_and_the_bag_does_not_are_refused(tmp_path: Path) -> None:
    arm = str(written(tmp_path, urdf_of("ur5e"), "arm.urdf"))
    path = _bag(tmp_path / "run.mcap", UR_JOINTS, _angles(2, 6))
    with pytest.raises(FileFormatError) as caught:
        bag_streams(path, robot=arm)
    assert str(caught.value) == (
        f"{path}: topic /joint_states: found the joints {', '.join(UR_JOINTS)}, expected those of arm.urdf:tool0 (j1, "
        "j2, j3, j4, j5, j6): name the arm's URDF with --robot"
    )


def test_joints_in_degrees_are_said(tmp_path: Path) -> None:
    joints = _angles(3, 7)
    assert bag_streams(_bag(tmp_path / "rad.mcap", [f"j{k}" for k in range(1, 8)], joints), robot="panda")
    joints[0, 6] = 400.0  # of a driver that counts turns
    assert bag_streams(_bag(tmp_path / "turns.mcap", [f"j{k}" for k in range(1, 8)], joints), robot="panda")
    joints[1, [1, 3]] = 30.0, -135.0
    path = _bag(tmp_path / "run.mcap", [f"j{k}" for k in range(1, 8)], joints)
    with pytest.raises(FileFormatError) as caught:
        bag_streams(path, robot="panda")
    assert str(caught.value) == (
        f"{path}: topic /joint_states, at 0.010 s: found joints at 30 and -135, expected angles, rad"
    )


def test_a_joint_that_is_no_number_is_named(tmp_path: Path) -> None:
    joints = _angles(3, 7)
    joints[1, 4] = np.nan
    path = _bag(tmp_path / "run.mcap", [f"j{k}" for k in range(1, 8)], joints)
    with pytest.raises(FileFormatError) as caught:
        bag_streams(path, robot="panda")
    assert str(caught.value) == (
        f"{path}: topic /joint_states, at 0.010 s: found a joint that is no number, expected angles, rad"
    )


def test_the_pose_has_one_source(tmp_path: Path) -> None:
    path = _bag(tmp_path / "run.mcap", UR_JOINTS, _angles(2, 6))
    with pytest.raises(InputError) as caught:
        bag_streams(path, robot="ur5e", frames=("base", "tool0"))
    assert str(caught.value) == "found --frames and --robot, expected one of them: the pose has one source"


def test_joints_tell_the_delay_of_a_whole_arm(tmp_path: Path) -> None:
    rec = whole_arm("hand", 20.0, 5)
    names = [f"A{k}" for k in range(1, 8)]
    wrenches = [wrench_stamped(t + 0.02, wrench) for t, wrench in zip(rec.t[::5], rec.wrench[::5], strict=True)]
    joints = [joint_state(t, names, row) for t, row in zip(rec.t[3::10], rec.joints[3::10], strict=True)]
    samples = cw.read(write_bag(tmp_path / "run.mcap", [*wrenches, *joints]), robot="iiwa7")
    assert samples.delay == pytest.approx(0.02, abs=0.0003)
