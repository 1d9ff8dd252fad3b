"""A sensor and an arm on ROS: readings by the formula of design.md, section 1, and tf; and what comes back."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from ament_index_python.packages import get_package_prefix
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped, TransformStamped, WrenchStamped
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool
from std_srvs.srv import Trigger
from tf2_msgs.msg import TFMessage

import contactwrench as cw
from contactwrench_ros.node import ContactWrenchNode

WEIGHT, COM = 13.7, np.array([0.012, -0.031, 0.074])
BIAS = np.array([3.0, -5.0, 20.0, 0.2, -0.1, 0.05])
MOUNTING = Rotation.from_euler("zyx", [37.0, 1.5, -2.0], degrees=True)
NOISE = np.array([0.02, 0.02, 0.02, 0.001, 0.001, 0.001])
PUSH = np.array([1.5, -2.0, 4.0, 0.1, 0.2, -0.05])
ON_WRIST = Rotation.from_euler("xyz", [0.3, -0.2, 1.1])
PROGRAM = str(Path(get_package_prefix("contactwrench_ros")) / "lib" / "contactwrench_ros" / "contactwrench")
LATCHED = QoSProfile(depth=50, durability=DurabilityPolicy.TRANSIENT_LOCAL)
BEST_EFFORT = QoSProfile(depth=2000, reliability=ReliabilityPolicy.BEST_EFFORT)


def free(R: Rotation) -> Any:
    """What a free tool reads at `R_base_flange`."""
    pull = (R * MOUNTING).inv().apply([0.0, 0.0, -WEIGHT])
    return np.hstack([pull, np.cross(COM, pull)]) + BIAS


def save_calibration(path: str) -> None:
    """Of this tool, from noiseless poses."""
    poses = Rotation.random(16, random_state=3)
    samples = cw.Samples(np.array([free(R) for R in poses]), poses.as_matrix(), read_as={"base_frame": "base_link"})
    cw.calibrate(samples, model="mount", noise=NOISE / 100.0).save(path)


def stamp_of(t: float) -> tuple[int, int]:
    nanoseconds = round(t * 1e9)
    return nanoseconds // 10**9, nanoseconds % 10**9


class Rig:
    """The node under test in a thread of its own, or as the installed program (`apart`), and beside it a node that is
    sensor, arm and listener.
    """

    def __init__(self, apart: bool = False, **parameters: Any) -> None:
        self.context = rclpy.Context()
        rclpy.init(context=self.context)
        self.program: subprocess.Popen[str] | None = None
        if apart:
            given = [word for name, value in parameters.items() for word in ("-p", f"{name}:={value}")]
            self.program = subprocess.Popen([PROGRAM, "--ros-args", *given], stderr=subprocess.PIPE, text=True)
        else:
            overrides = [Parameter(name, value=value) for name, value in parameters.items()]
            self.node = ContactWrenchNode(context=self.context, parameter_overrides=overrides)
        self.outside = rclpy.create_node("outside", context=self.context)
        self.found: list[WrenchStamped] = []
        self.arrived: list[float] = []
        self.contacts: list[bool] = []
        self.said: list[Any] = []
        subscribe, publisher = self.outside.create_subscription, self.outside.create_publisher
        subscribe(WrenchStamped, "/contactwrench/contact_wrench", self._arrive, 2000)
        subscribe(Bool, "/contactwrench/contact", lambda message: self.contacts.append(message.data), LATCHED)
        subscribe(DiagnosticArray, "/diagnostics", lambda message: self.said.append(message.status[0]), 10)
        self.wrenches, self.tf = publisher(WrenchStamped, "/wrench", BEST_EFFORT), publisher(TFMessage, "/tf", 100)
        self.tf_static = publisher(TFMessage, "/tf_static", LATCHED)
        self.poses, self.joints = publisher(PoseStamped, "/pose", 10), publisher(JointState, "/joint_states", 10)
        self.nodes = [self.outside] if apart else [self.node, self.outside]
        self.executors = [SingleThreadedExecutor(context=self.context) for _ in self.nodes]
        for executor, node in zip(self.executors, self.nodes, strict=True):
            executor.add_node(node)
        self.closing = False
        self.threads = [threading.Thread(target=self._spin, args=(executor,)) for executor in self.executors]
        self.sent: list[tuple[int, int]] = []
        self.rng = np.random.default_rng(5)
        sys.setswitchinterval(2e-4)  # two threads share this process: neither waits for 5 ms
        for thread in self.threads:
            thread.start()
        self.wait(lambda: self.wrenches.get_subscription_count() > 0)
        self.wait(lambda: self.outside.count_publishers("/contactwrench/contact_wrench") > 0)
        self.say(
            [("world", "base_link", Rotation.from_rotvec([0.1, 0.0, 0.0])), ("wrist", "tool0", ON_WRIST)], 0.0, True
        )

    def _arrive(self, message: WrenchStamped) -> None:
        self.arrived.append(time.time())
        self.found.append(message)

    def _spin(self, executor: SingleThreadedExecutor) -> None:
        while not self.closing:
            executor.spin_once(timeout_sec=0.05)

    def close(self) -> None:
        """Everything ends."""
        self.closing = True
        for thread in self.threads:
            thread.join(10.0)
        for executor in self.executors:
            executor.shutdown()
        for node in self.nodes:
            node.destroy_node()
        rclpy.shutdown(context=self.context)
        self.context.destroy()
        if self.program is not None:
            self.program.send_signal(signal.SIGINT)
            assert self.program.communicate(timeout=15.0)[1].count("Traceback") == 0
            assert self.program.returncode == 0

    def wait(self, until: Callable[[], bool], seconds: float = 15.0) -> None:
        """Until it holds."""
        end = time.monotonic() + seconds
        while not until():
            assert time.monotonic() < end, "waited in vain"
            time.sleep(0.01)

    def say(
        self, transforms: list[tuple[str, str, Rotation]], t: float, static: bool = False, places: Any = ()
    ) -> None:
        """Transforms on tf, at 0, 0, 0 or at `places` (n, 3), m."""
        message = TFMessage()
        at_all = places if len(places) else np.zeros((len(transforms), 3))
        for (parent, child, R), place in zip(transforms, at_all, strict=True):
            each = TransformStamped(child_frame_id=child)
            at = each.transform.translation
            at.x, at.y, at.z = np.asarray(place, dtype=float).tolist()
            each.header.frame_id = parent
            each.header.stamp.sec, each.header.stamp.nanosec = stamp_of(t)
            q = each.transform.rotation
            q.x, q.y, q.z, q.w = R.as_quat().tolist()
            message.transforms.append(each)
        (self.tf_static if static else self.tf).publish(message)

    def stand(self, R: Rotation, t: float) -> None:
        """The arm's flange at `R_base_flange`: two joints share the turn."""
        half = Rotation.from_rotvec([0.2, 0.5, -0.3])
        self.say([("base_link", "elbow", half), ("elbow", "wrist", half.inv() * R * ON_WRIST.inv())], t)

    def read(self, wrench: Any, t: float) -> None:
        """A reading of the sensor, which never repeats to the last digit: that would be a fault."""
        message = WrenchStamped()
        message.header.frame_id = "ft_sensor"
        message.header.stamp.sec, message.header.stamp.nanosec = stamp_of(t)
        force, torque = message.wrench.force, message.wrench.torque
        force.x, force.y, force.z, torque.x, torque.y, torque.z = (wrench + 1e-7 * self.rng.normal(size=6)).tolist()
        self.wrenches.publish(message)
        self.sent.append((message.header.stamp.sec, message.header.stamp.nanosec))

    def run(
        self,
        R: Rotation,
        seconds: float,
        push: Any = 0.0,
        rate: float = 200.0,
        noise: float = 1.0,
        under_way: float = np.inf,
        turned: float = 1.0,
    ) -> None:
        """Readings, and tf at most at 100 Hz, at an orientation, in real time. No more than `under_way`
        readings are without an answer, and these are stamped at an even pace: a machine that stalls is not what is
        tested. `turned`: -1 with the other sign.
        """
        pure, start, stood = free(R) + push * np.ones(6), time.time(), 0.0
        begun = start
        for k in range(int(seconds * rate)):
            t = start + k / rate
            time.sleep(max(0.0, t - time.time()))
            start += max(0.0, time.time() - t - 0.02)  # late is late: no burst makes up for it
            if len(self.sent) - len(self.found) > under_way:
                self.wait(lambda: len(self.sent) - len(self.found) <= under_way)
            t = begun + k / rate if np.isfinite(under_way) else time.time()
            if t - stood > 0.009:
                self.stand(R, t)
                stood = t
            self.read(turned * pure + noise * NOISE * self.rng.normal(size=6), t)

    def ask(self, service: str, meanwhile: Callable[[], None] = lambda: None) -> Any:
        """The answer of a service, which comes while `meanwhile` runs or after."""
        client = self.outside.create_client(Trigger, f"/contactwrench/{service}")
        assert client.wait_for_service(10.0)
        future = client.call_async(Trigger.Request())
        meanwhile()
        self.wait(future.done)
        self.outside.destroy_client(client)
        return future.result()
