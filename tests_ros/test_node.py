"""The node on real rclpy: known answers, nothing lost, every service, parameters, lost chains, no leak."""

from __future__ import annotations

import gc
import os
import resource
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rclpy
from ament_index_python.packages import get_package_share_directory
from rclpy.parameter import Parameter
from scipy.spatial.transform import Rotation

import contactwrench as cw
from contactwrench_ros.node import ContactWrenchNode
from contactwrench_ros.parameters import PARAMETERS

from .rig import MOUNTING, PROGRAM, PUSH, Rig, free, stamp_of

Make = Callable[..., Rig]


def values(message: Any) -> Any:
    force, torque = message.wrench.force, message.wrench.torque
    return np.array([force.x, force.y, force.z, torque.x, torque.y, torque.z])


def stamp_in(message: Any) -> tuple[int, int]:
    return message.header.stamp.sec, message.header.stamp.nanosec


@pytest.mark.parametrize("frame", ["sensor", "flange", "base"])
def test_an_injected_wrench_comes_out(frame: str, rig: Make, calibration: str) -> None:
    one = rig(calibration=calibration, output_frame=frame)
    R = Rotation.random(random_state=8)
    one.run(R, 0.5, push=PUSH, noise=0.0)
    one.wait(lambda: len(one.found) > 90)
    axes = {"sensor": Rotation.identity(), "flange": MOUNTING, "base": R * MOUNTING}[frame]
    assert values(one.found[-1]) == pytest.approx(np.hstack([axes.apply(PUSH[:3]), axes.apply(PUSH[3:])]), abs=1e-5)
    assert one.found[-1].header.frame_id == {"sensor": "ft_sensor", "flange": "tool0", "base": "base_link"}[frame]


def test_while_the_arm_turns_too(rig: Make, calibration: str) -> None:
    """Readings 15 ms behind tf at 100 Hz: interpolated; not at its stamps."""
    one, start = rig(calibration=calibration), time.time()
    for k in range(400):
        t = start + 0.005 * k
        time.sleep(max(0.0, t - time.time()))
        turn = [
            Rotation.from_rotvec(0.6 * np.sin(2.0 * (at - start)) * np.array([1.0, 0.5, -0.7])) for at in (t, t - 0.015)
        ]
        if k % 2 == 0:
            one.stand(turn[0], t)
        if k > 10:
            one.read(free(turn[1]) + PUSH, t - 0.015)
    one.wait(lambda: len(one.found) == 389)
    assert np.abs(np.array([values(message) for message in one.found]) - PUSH).max() < 2e-3


def test_nothing_is_lost_at_1_khz(rig: Make, calibration: str) -> None:
    one, R = rig(apart=True, calibration=calibration, noise=0.02, lowpass=20.0), Rotation.random(random_state=8)
    while not one.found or stamp_in(one.found[-1]) != one.sent[-1]:  # topics find each other one by one
        one.run(R, 1.0)
        time.sleep(0.5)
    before = len(one.sent)
    one.run(R, 4.0, rate=1000.0, under_way=200.0 + len(one.sent) - len(one.found))
    one.wait(lambda: stamp_in(one.found[-1]) == one.sent[-1])
    first, *sent = one.sent[before:]  # the first ends a pause, in which filters start anew
    assert [stamp for stamp in map(stamp_in, one.found) if stamp > first] == sent
    assert len(sent) == 3999
    one.wait(lambda: any(status.message.startswith("contact wrenches at") for status in one.said))
    assert {value.value for status in one.said for value in status.values if value.key.startswith("lost")} == {"0"}


def test_a_lost_chain_is_a_diagnostic_and_no_wrench(rig: Make, calibration: str) -> None:
    one, R = rig(calibration=calibration), Rotation.random(random_state=8)
    one.run(R, 0.3, noise=0.0)
    one.wait(lambda: len(one.found) > 50)
    time.sleep(0.2)
    before, last = len(one.found), time.time()
    while time.time() < last + 2.5:  # only the elbow is heard
        one.say([("base_link", "elbow", Rotation.identity())], time.time())
        one.read(free(R), time.time())
        time.sleep(0.01)
    assert len(one.found) == before
    status = one.said[-1]
    assert status.level == b"\x02"
    assert "orientation: the last is" in status.message
    assert "tf elbow -> wrist is the one that is behind" in status.message
    one.run(R, 0.3, noise=0.0)
    one.wait(lambda: len(one.found) > before + 50)


def test_a_chain_that_never_was_is_said(rig: Make, calibration: str) -> None:
    one, R = rig(calibration=calibration, flange_frame="gripper"), Rotation.random(random_state=8)
    one.run(R, 1.5)
    one.wait(lambda: any("found no tf chain from base_link to gripper" in status.message for status in one.said))
    assert one.found == []


def test_contacts_begin_and_end(rig: Make, calibration: str) -> None:
    one, R = rig(calibration=calibration, noise=0.02), Rotation.random(random_state=8)
    one.run(R, 1.0)
    one.run(R, 0.5, push=PUSH)
    one.run(R, 1.0)
    one.wait(lambda: one.contacts == [False, True, False])


def test_zero(rig: Make, calibration: str) -> None:
    one, R = rig(calibration=calibration, noise=0.02), Rotation.random(random_state=8)
    one.run(R, 0.5, push=0.2)
    answer = one.ask("zero", lambda: one.run(R, 1.5, push=0.2))
    assert answer.success, answer.message
    one.found.clear()
    one.run(R, 0.5, push=0.2)
    one.wait(lambda: len(one.found) > 90)
    assert np.abs(np.mean([values(message) for message in one.found], axis=0)).max() < 0.01
    moving = one.ask("zero", lambda: one.run(Rotation.random(random_state=9), 1.5))
    assert not moving.success
    assert moving.message.startswith("no new zero: ")


def test_calibrating(rig: Make, tmp_path: Path) -> None:
    one = rig(save_to=str(tmp_path / "cal.json"))
    assert not one.ask("capture", lambda: one.run(Rotation.identity(), 1.2)).success
    assert one.ask("start_calibration").success
    for seed in range(7):
        R = Rotation.random(random_state=seed)
        one.run(R, 0.1)
        answer = one.ask("capture", partial(one.run, R, 1.2))
        assert answer.success, answer.message
    time.sleep(0.5)
    nothing = one.ask("capture")
    assert not nothing.success
    assert "readings with an orientation in 1 s, expected at least 20" in nothing.message
    answer = one.ask("finish_calibration")
    assert answer.success, answer.message
    assert "; weight 13." in answer.message
    assert cw.Calibration.load(tmp_path / "cal.json").weight == pytest.approx(13.7, abs=0.01)
    one.run(R, 0.5)
    one.wait(lambda: len(one.found) > 90)
    assert not one.ask("finish_calibration").success


def test_poses_from_a_topic(rig: Make, calibration: str) -> None:
    from geometry_msgs.msg import PoseStamped

    one, R = rig(calibration=calibration, pose_source="pose"), Rotation.random(random_state=8)
    for k in range(100):
        message, t = PoseStamped(), time.time()
        message.header.frame_id = "base_link" if k < 50 else "world"
        message.header.stamp.sec, message.header.stamp.nanosec = stamp_of(t)
        q = message.pose.orientation
        q.x, q.y, q.z, q.w = R.as_quat().tolist()
        one.poses.publish(message)
        time.sleep(0.005)
        one.read(free(R) + PUSH, t + 0.001)
    one.wait(lambda: len(one.found) > 40)
    assert len(one.found) < 90
    assert values(one.found[-1]) == pytest.approx(PUSH, abs=1e-5)


def test_poses_from_joints(rig: Make, calibration: str) -> None:
    from sensor_msgs.msg import JointState

    from contactwrench.assess.robot_arms import flange_orientation, known_arm

    q = np.array([0.3, -1.1, 1.4, -0.7, 0.9, 0.2])
    R = Rotation.from_matrix(flange_orientation(known_arm("ur5e"), q[None])[0])
    names = ["shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3"]
    one, order = rig(calibration=calibration, pose_source="joints", urdf="ur5e"), [2, 1, 0, 3, 4, 5]
    for _ in range(60):
        message, t = JointState(name=[f"{names[k]}_joint" for k in order], position=q[order].tolist()), time.time()
        message.header.stamp.sec, message.header.stamp.nanosec = stamp_of(t)
        one.joints.publish(message)
        one.joints.publish(JointState(name=["gripper"], position=[0.1]))
        time.sleep(0.005)
        one.read(free(R) + PUSH, t + 0.001)
    one.wait(lambda: len(one.found) > 40)
    assert values(one.found[-1]) == pytest.approx(PUSH, abs=1e-5)


def test_parameters_are_described_and_guarded(rig: Make, calibration: str) -> None:
    node = rig(calibration=calibration).node
    for name, parameter in PARAMETERS.items():
        described = node.describe_parameter(name)
        assert described.description == parameter.description
        assert described.read_only is not parameter.live
        assert bool(described.floating_point_range) is isinstance(parameter.default, float)
    done = node.set_parameters([Parameter("lowpass", value=30.0), Parameter("output_frame", value="base")])
    assert all(result.successful for result in done)
    refused = node.set_parameters(
        [
            Parameter("lowpass", value=-1.0),
            Parameter("output_frame", value="world"),
            Parameter("wrench_topic", value="/other"),
            Parameter("stale_after", value=100.0),
        ]
    )
    assert not any(result.successful for result in refused)
    assert "expected sensor, flange, base" in refused[1].reason
    assert node.session.settings["output_frame"] == "base"


def test_the_installed_program_starts_says_what_is_wrong_and_stops(calibration: str, tmp_path: Path) -> None:
    command = [PROGRAM, "--ros-args", "-p", f"calibration:={tmp_path}/none.json"]
    wrong = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert wrong.returncode == 2
    assert wrong.stderr.startswith("contactwrench: ")
    assert len(wrong.stderr.splitlines()) == 1
    config = Path(get_package_share_directory("contactwrench_ros")) / "config" / "contactwrench.yaml"
    running = subprocess.Popen([PROGRAM, "--ros-args", "--params-file", str(config)], stderr=subprocess.PIPE, text=True)
    time.sleep(3.0)
    assert running.poll() is None
    running.send_signal(2)
    _, said = running.communicate(timeout=15)
    assert running.returncode == 0, said
    assert "Traceback" not in said


def test_it_needs_no_numba() -> None:
    script = "import sys, contactwrench_ros.node; print('numba' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout == "False\n"


def test_50_starts_and_stops_leave_nothing(calibration: str) -> None:
    def once() -> None:
        context = rclpy.Context()
        rclpy.init(context=context)
        node = ContactWrenchNode(context=context, parameter_overrides=[Parameter("calibration", value=calibration)])
        executor = rclpy.executors.SingleThreadedExecutor(context=context)
        executor.add_node(node)
        executor.spin_once(timeout_sec=0.01)
        executor.shutdown()
        node.destroy_node()
        rclpy.shutdown(context=context)
        context.destroy()

    def held() -> tuple[int, int, int]:
        gc.collect()
        threads = len(os.listdir("/proc/self/task"))
        return threads, len(os.listdir("/proc/self/fd")), int(Path("/proc/self/statm").read_text().split()[1])

    for _ in range(10):
        once()
    threads, files, pages = held()
    for _ in range(50):
        once()
    now = held()
    assert threading.active_count() == 1
    assert now[0] <= threads
    assert now[1] <= files
    grown = (now[2] - pages) * resource.getpagesize() / 2**20
    print(f"grown by {grown:.1f} MiB in 50 starts")
    assert grown < 25.0
