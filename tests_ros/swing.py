"""An arm that swings the rig's tool: where its flange is, and what six point masses exert on the sensor."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseStamped
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import JointState

import contactwrench as cw
from contactwrench.assess.robot_arms import flange_pose, known_arm
from contactwrench.calibration.dynamics import Dynamics, inertial_matrix
from contactwrench.model import RigidTool

from .rig import BIAS, COM, MOUNTING, ON_WRIST, WEIGHT, Rig, save_calibration, stamp_of

ARM = known_arm("ur5e")
JOINTS = ["shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", "wrist_1_joint", "wrist_2_joint", "wrist_3_joint"]
GRAVITY = 9.80665
MASS = WEIGHT / GRAVITY
OFFSET = np.array([0.01, -0.02, 0.05])
"""m, of the sensor's origin, flange axes."""
ARMS = np.array([0.04, 0.05, 0.06])
"""m, of the point masses from the centre of mass, one to each side along each sensor axis."""
POINTS = COM + np.vstack([np.diag(ARMS), -np.diag(ARMS)])
WRIST_TO_TOOL = np.array([0.02, -0.03, 0.1])
STEP = 1e-3
"""s, of second differences."""


def joints(t: Any) -> Any:
    """(n, 6), rad, at times (n,), s."""
    speed, swing = (
        2.0 * np.pi * np.array([0.19, 0.16, 0.21, 0.24, 0.17, 0.2]),
        np.array([0.7, 0.45, 0.5, 0.9, 0.8, 1.0]),
    )
    return ARM.home + swing * np.sin(np.outer(t, speed) + np.arange(6.0))


def readings(t: Any) -> Any:
    """What the free tool reads (n, 6) at times (n,), s, without noise."""
    R, _ = flange_pose(ARM, joints(t))
    turn = R @ MOUNTING.as_matrix()

    def places(when: Any) -> Any:
        R, flange = flange_pose(ARM, joints(when))
        in_flange = OFFSET + MOUNTING.apply(POINTS)
        return flange[:, None] + np.einsum("nij,pj->npi", R, in_flange)

    acceleration = (places(t + STEP) - 2.0 * places(t) + places(t - STEP)) / STEP**2
    force = MASS / 6.0 * np.einsum("nji,npj->npi", turn, np.array([0.0, 0.0, -GRAVITY]) - acceleration)
    return np.hstack([force.sum(axis=1), np.cross(POINTS, force).sum(axis=1)]) + BIAS


def save_dynamic_calibration(path: str) -> None:
    """Of this tool, with its inertia as it is."""
    save_calibration(path)
    still = cw.Calibration.load(path)
    inertia = np.diag(MASS / 3.0 * (np.sum(ARMS**2) - ARMS**2))
    tool = RigidTool(WEIGHT, COM, BIAS, MOUNTING.as_matrix(), np.array([0.0, 0.0, -1.0]))
    dynamics = Dynamics(
        matrix=inertial_matrix(tool, MASS, inertia, OFFSET),
        inertia=inertia,
        sensor_offset=OFFSET,
        covariance=1e-12 * np.eye(9),
        with_parameters=np.zeros((9, len(still.parameters))),
        bandwidth=10.0,
        motion_noise=np.zeros((2, 2)),
        residual_rms=np.zeros(6),
        static_rms=np.zeros(6),
        seconds=10.0,
    )
    replace(still, dynamics=dynamics).save(path)


@dataclass(frozen=True)
class Swing:
    """The arm, as it tells its pose by one `pose_source`; `placed`: with positions."""

    one: Rig
    pose_source: str
    placed: bool = True

    def tell(self, t: float, stamp: float) -> None:
        """The pose at `t` s of the swing."""
        q = joints(np.array([t]))
        R, place = flange_pose(ARM, q)
        turn, at = Rotation.from_matrix(R[0]), place[0] * self.placed
        if self.pose_source == "tf":
            elbow, elbow_at = Rotation.from_rotvec([0.0, np.sin(t), 0.0]), np.array([0.1, 0.2 * np.cos(t), 0.3])
            wrist = turn * ON_WRIST.inv()
            wrist_at = elbow.inv().apply(at - wrist.apply(WRIST_TO_TOOL) - elbow_at)
            links = [("base_link", "elbow", elbow), ("elbow", "wrist", elbow.inv() * wrist)]
            self.one.say(links, stamp, places=(elbow_at, wrist_at) if self.placed else ())
            return
        message = PoseStamped() if self.pose_source == "pose" else JointState(name=JOINTS, position=q[0].tolist())
        message.header.stamp.sec, message.header.stamp.nanosec = stamp_of(stamp)
        if self.pose_source == "joints":
            self.one.joints.publish(message)
            return
        p, o = message.pose.position, message.pose.orientation
        (p.x, p.y, p.z), (o.x, o.y, o.z, o.w) = at.tolist(), turn.as_quat().tolist()
        self.one.poses.publish(message)
