"""Arms against Pinocchio and the makers' tables, their wrists against their limits, and URDF files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import contactwrench as cw
from contactwrench.assess.robot_arms import ARMS, MARGIN, flange_orientation, flange_pose, known_arm, reach
from contactwrench.errors import InputError
from contactwrench.recording.urdf import read_urdf
from tests.support.recordings import generic_rotations, written
from tests.support.rigs import rotation_angle, seeds
from tests.support.world import Array

H = np.pi / 2
ROUNDED = 1e-4
"""rad: joint angles are given to four digits."""

URDF_JOINTS: dict[str, list[tuple[float, ...]]] = {
    # x, y, z and roll, pitch, yaw of every joint's frame in the one before it, and of the flange in the last one
    "iiwa14": [
        (0, 0, 0.1575, 0, 0, 0),
        (0, 0, 0.2025, H, 0, np.pi),
        (0, 0.2045, 0, H, 0, np.pi),
        (0, 0, 0.2155, H, 0, 0),
        (0, 0.1845, 0, -H, np.pi, 0),
        (0, 0, 0.2155, H, 0, 0),
        (0, 0.081, 0, -H, np.pi, 0),
        (0, 0, 0.045, 0, 0, 0),
    ],
    "panda": [
        (0, 0, 0.333, 0, 0, 0),
        (0, 0, 0, -H, 0, 0),
        (0, -0.316, 0, H, 0, 0),
        (0.0825, 0, 0, H, 0, 0),
        (-0.0825, 0.384, 0, -H, 0, 0),
        (0, 0, 0, H, 0, 0),
        (0.088, 0, 0, H, 0, 0),
        (0, 0, 0.107, 0, 0, 0),
    ],
    "ur5e": [
        (0, 0, 0.1625, 0, 0, 0),
        (0, 0, 0, H, 0, 0),
        (-0.425, 0, 0, 0, 0, 0),
        (-0.3922, 0, 0.1333, 0, 0, 0),
        (0, -0.0997, 0, H, 0, 0),
        (0, 0.0996, 0, H, np.pi, np.pi),
        (0, 0, 0, 0, 0, 0),
    ],
}
"""As the ROS descriptions give them, not as Denavit-Hartenberg figures: iiwa_stack, franka_description
(kinematics.yaml), Universal_Robots_ROS2_Description (base_link_inertia to tool0).
"""


def urdf_of(name: str, lower: float = -2.0, upper: float = 2.0, extra: str = "") -> str:
    """A URDF with those joints."""
    *joints, flange = URDF_JOINTS[name]
    lines = [
        f'<robot name="{name}">',
        *(f'<link name="l{k}"/>' for k in range(len(joints) + 1)),
        '<link name="tool0"/>',
    ]
    for k, origin in enumerate(joints):
        lines.append(
            f'<joint name="j{k + 1}" type="revolute"><parent link="l{k}"/><child link="l{k + 1}"/>'
            f'{_origin(origin)}<axis xyz="0 0 1"/>'
            f'<limit lower="{lower}" upper="{upper}" effort="1" velocity="1"/></joint>'
        )
    lines.append(
        f'<joint name="last" type="fixed"><parent link="l{len(joints)}"/><child link="tool0"/>'
        f"{_origin(flange)}</joint>{extra}</robot>"
    )
    return "\n".join(lines)


def _origin(numbers: tuple[float, ...]) -> str:
    x, y, z, roll, pitch, yaw = map(repr, numbers)
    return f'<origin xyz="{x} {y} {z}" rpy="{roll} {pitch} {yaw}"/>'


def poses_by_pinocchio(text: str, frame: str, joints: Array) -> tuple[Array, Array]:
    """`R_base_flange` (n, 3, 3) and position (n, 3), m."""
    pin = pytest.importorskip("pinocchio", reason="Pinocchio has no build for this platform")
    model = pin.buildModelFromXML(text)
    data, index = model.createData(), model.getFrameId(frame)
    R, position = [], []
    for q in joints:
        pin.framesForwardKinematics(model, data, q)
        R.append(data.oMf[index].rotation.copy())
        position.append(data.oMf[index].translation.copy())
    return np.array(R), np.array(position)


def _require_same(poses: tuple[Array, Array], expected: tuple[Array, Array]) -> None:
    for one, other in zip(poses, expected, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-12)


@pytest.mark.parametrize("name", URDF_JOINTS)
def test_an_arm_and_its_urdf_turn_and_carry_the_flange_as_pinocchio_says(name: str, tmp_path: Path) -> None:
    text = urdf_of(name)
    joints = np.random.default_rng(1).uniform(-2.0, 2.0, (50, len(URDF_JOINTS[name]) - 1))
    expected = poses_by_pinocchio(text, "tool0", joints)
    _require_same(flange_pose(ARMS[name], joints), expected)
    _require_same(flange_pose(read_urdf(written(tmp_path, text, "arm.urdf")), joints), expected)


def test_ur5e_turns_as_the_makers_denavit_hartenberg_table_says() -> None:
    """The table of tests/simulate/test_pinocchio.py, alpha = pi/2, 0, 0, pi/2, -pi/2, 0, multiplied out."""
    q = np.array([0.3, -1.2, 1.7, -0.4, 0.9, 2.1])
    R = np.eye(3)
    for angle, alpha in zip(q, (H, 0.0, 0.0, H, -H, 0.0), strict=True):
        c, s, ca, sa = np.cos(angle), np.sin(angle), np.cos(alpha), np.sin(alpha)
        R = R @ np.array([[c, -s * ca, s * sa], [s, c * ca, -c * sa], [0.0, sa, ca]])
    assert flange_orientation(ARMS["ur5e"], q[None])[0] == pytest.approx(R, abs=1e-12)


def test_arms_of_one_wrist_turn_alike() -> None:
    joints = np.random.default_rng(2).uniform(-1.0, 1.0, (5, 7))
    for one, other in (("iiwa7", "iiwa14"), ("panda", "fr3")):
        assert flange_orientation(ARMS[one], joints) == pytest.approx(flange_orientation(ARMS[other], joints), abs=0)


def test_limits_are_the_makers() -> None:
    assert np.rad2deg(ARMS["iiwa7"].limits[:, 1]) == pytest.approx([170, 120, 170, 120, 170, 120, 175])
    assert np.rad2deg(ARMS["ur20"].limits) == pytest.approx(np.tile([-360.0, 360.0], (6, 1)))
    assert ARMS["panda"].limits[5].tolist() == [-0.0175, 3.7525]
    assert ARMS["fr3"].limits[3].tolist() == [-3.0421, -0.1518]
    for arm in ARMS.values():
        assert arm.source


@pytest.mark.parametrize("name", ARMS)
def test_at_home_the_flange_points_down_and_no_joint_is_near_a_limit(name: str) -> None:
    arm = ARMS[name]
    assert flange_orientation(arm, arm.home[None])[0, :, 2] == pytest.approx([0.0, 0.0, -1.0], abs=1e-12)
    assert (arm.home > arm.limits[:, 0] + MARGIN).all()
    assert (arm.home < arm.limits[:, 1] - MARGIN).all()


@pytest.mark.parametrize("name", ARMS)
def test_the_wrist_reaches_every_tilt_from_home_within_its_limits(name: str) -> None:
    arm = ARMS[name]
    found = reach(arm)
    assert found.joints[0] == pytest.approx(arm.home, abs=ROUNDED)
    assert (found.joints >= arm.limits[:, 0] + MARGIN - ROUNDED).all()
    assert (found.joints <= arm.limits[:, 1] - MARGIN + ROUNDED).all()
    assert np.abs(found.joints - found.around).max() <= np.pi + ROUNDED
    assert (found.joints[:, :-3] == found.around[:-3]).all()
    assert flange_orientation(arm, found.joints) == pytest.approx(found.R_base_flange, abs=1e-12)
    down = -found.R_base_flange[:, 2]
    for direction in generic_rotations(40)[:, 0]:
        assert np.rad2deg(np.arccos((down @ direction).max())) < 25.0


@pytest.mark.slow
@settings(max_examples=10, deadline=None)
@given(seed=seeds, name=st.sampled_from(sorted(ARMS)))
def test_reach_is_sparse_and_starts_where_the_arm_stands(seed: int, name: str) -> None:
    arm = ARMS[name]
    around = np.random.default_rng(seed).uniform(arm.limits[:, 0], arm.limits[:, 1])
    found = reach(arm, around)
    assert found.joints[0] == pytest.approx(around, abs=ROUNDED)
    nearest = min(rotation_angle(found.R_base_flange[5], R) for k, R in enumerate(found.R_base_flange) if k != 5)
    assert nearest > np.deg2rad(17.9)
    outside = (found.joints[1:] < arm.limits[:, 0]) | (found.joints[1:] > arm.limits[:, 1])
    assert not outside[:, -3:].any()


@pytest.mark.parametrize("written_so", ["iiwa7", "IIWA 7", "iiwa-7"])
def test_names_are_read_kindly(written_so: str) -> None:
    assert known_arm(written_so) is ARMS["iiwa7"]


@pytest.mark.parametrize(
    ("name", "around", "message"),
    [
        ("ur5e", [0.0] * 5, "found 5 joint angles, expected 6 for ur5e: give one a joint, rad"),
        ("iiwa7", [0, 0, 0, 2.5, 0, 0, 0], "q4 of iiwa7 is 2.5 rad, expected -2.094 to 2.094"),
        ("panda", [0, 0, 0, -90, 0, 0, 0], "q4 of panda is -90 rad, expected -3.072 to -0.0698 (are these degrees?)"),
        ("ur5e", [0, 0, 0, 0, 0, np.nan], "q6 of ur5e is nan rad, expected -6.283 to 6.283"),
    ],
)
def test_a_place_that_cannot_be_is_refused(name: str, around: list[float], message: str) -> None:
    with pytest.raises(InputError) as refused:
        reach(ARMS[name], np.array(around, dtype=float))
    assert str(refused.value) == message


# URDF files


def test_limits_flange_and_home_come_from_the_file(tmp_path: Path) -> None:
    path = written(tmp_path, urdf_of("ur5e", -1.0, 3.0), "arm.urdf")
    arm = read_urdf(path)
    assert arm.name == "arm.urdf:tool0"
    assert arm.limits.tolist() == [[-1.0, 3.0]] * 6
    assert arm.home.tolist() == [1.0] * 6
    assert len(read_urdf(path, "l3")) == 3


def test_any_axis_and_any_origin_turn_and_carry_as_pinocchio_says(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    joints = "".join(
        f'<link name="l{k + 1}"/><joint name="j{k}" type="revolute"><parent link="l{k}"/><child link="l{k + 1}"/>'
        f"{_origin(tuple(rng.uniform(-3, 3, 6).tolist()))}"
        + (f'<axis xyz="{" ".join(map(str, rng.normal(size=3)))}"/>' if k else "")
        + '<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
        for k in range(4)
    )
    text = f'<robot name="odd"><link name="l0"/>{joints}</robot>'
    q = rng.uniform(-1.0, 1.0, (20, 4))
    _require_same(flange_pose(read_urdf(written(tmp_path, text, "odd.urdf")), q), poses_by_pinocchio(text, "l4", q))


def test_the_only_end_of_the_chain_is_the_flange(tmp_path: Path) -> None:
    text = urdf_of("panda").replace("tool0", "panda_link8")
    camera = (
        '<link name="camera"/><joint name="c" type="fixed"><parent link="l0"/><child link="camera"/></joint></robot>'
    )
    arm = read_urdf(written(tmp_path, text.replace("</robot>", camera), "arm.urdf"))
    assert arm.name == "arm.urdf:panda_link8"


def test_continuous_joints_have_two_turns(tmp_path: Path) -> None:
    path = written(tmp_path, urdf_of("ur5e").replace("revolute", "continuous"), "arm.urdf")
    assert read_urdf(path).limits == pytest.approx(np.tile([-2 * np.pi, 2 * np.pi], (6, 1)))


@pytest.mark.parametrize(
    ("text", "flange", "message"),
    [
        ("fx,fy\n", None, "found no XML (syntax error: line 1, column 0), expected a URDF"),
        ("<sdf/>", None, "found <sdf>, expected <robot>: a URDF"),
        ("<robot/>", None, "found no joint, expected a URDF (of a xacro file, run xacro on it first)"),
        (
            urdf_of("ur5e"),
            "hand",
            "found no joint that carries a link 'hand', expected one of l1, l2, l3, l4, l5, l6, tool0",
        ),
        (
            urdf_of("ur5e")
            .replace("tool0", "a")
            .replace("</robot>", '<joint name="x" type="fixed"><parent link="l6"/><child link="b"/></joint></robot>'),
            None,
            "found 2 ends of the arm (a, b), expected one: name the flange, as in arm.urdf:LINK",
        ),
        (
            urdf_of("ur5e").replace("revolute", "prismatic", 1),
            None,
            "joint j1 is prismatic, expected revolute joints from root to tool0: name the arm's flange, as in "
            "arm.urdf:LINK",
        ),
        (
            urdf_of("ur5e").replace("revolute", "fixed"),
            None,
            "found no revolute joint from root to tool0, expected a robot arm",
        ),
        (
            urdf_of("ur5e").replace('xyz="0 0 1"', 'xyz="0 0"', 1),
            None,
            "joint j1: axis xyz is '0 0', expected 3 numbers, at most 1e+06",
        ),
        (
            urdf_of("ur5e").replace('xyz="0 0 1"', 'xyz="0 0 0"', 1),
            None,
            "joint j1 has the axis 0 0 0, expected length 1",
        ),
        (urdf_of("ur5e", float("nan")), None, "joint j1: limit lower is 'nan', expected 1 number, at most 1e+06"),
        (
            urdf_of("ur5e").replace('<limit lower="-2.0" upper="2.0" effort="1" velocity="1"/>', "", 1),
            None,
            "joint j1 is revolute and has no limit, expected lower and upper, rad",
        ),
        (urdf_of("ur5e").replace('<parent link="l0"/>', "", 1), None, "joint j1 has no parent link, expected one"),
        (
            urdf_of("ur5e").replace('<parent link="l0"/>', '<parent link="tool0"/>'),
            None,
            "found links that go round in a circle (tool0, l6, l5, l4, l3, l2, l1, tool0), expected a tree: correct "
            "the parent of one of them",
        ),
        (
            urdf_of("ur5e").replace('lower="-2.0" upper="2.0"', 'lower="2.0" upper="-2.0"', 1),
            None,
            "joint j1 has the limits 2 to -2 rad, expected lower below upper: exchange them",
        ),
    ],
)
def test_what_is_no_arm_is_refused(text: str, flange: str | None, message: str, tmp_path: Path) -> None:
    path = written(tmp_path, text, "arm.urdf")
    with pytest.raises(cw.ContactWrenchError) as refused:
        read_urdf(path, flange)
    assert str(refused.value) == f"{path}: {message}"
