"""A topic of ROS 2: by rclpy where a ROS is sourced, else by rosless, which speaks DDS without any ROS."""

from __future__ import annotations

import os
from collections import deque
from importlib import import_module
from math import nan
from time import sleep
from typing import Any

from ...errors import MissingExtraError
from ..counter import Counter
from ..source import TAKEN_FOR_THE_FLANGE, About, Batch, DeviceError, Four, NobodyYetError, Sample, Six, Three
from ..uri import Uri
from .reader import Reader
from .transport import LISTENS, Driver

WRENCHES = ("geometry_msgs/msg/WrenchStamped", "geometry_msgs/msg/Wrench")
POSES = ("geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/Pose")
DEPTH = 1_000
"""Messages that wait for a reader which is late."""
STEP = 0.05
"""s from one look for a publisher to the next."""


class Ros2(Reader[Driver]):
    """A topic."""

    FORM = "ros2://TOPIC"
    ABOUT = (
        "WrenchStamped, Wrench, PoseStamped or Pose (of the flange in base axes) of ROS 2; ROS_DOMAIN_ID as always; "
        "without a sourced ROS: pip install rosless"
    )
    RATE = "the publisher's"
    TESTED = "rosless 0.5 to rosless; rclpy of Kilted"

    any_thread = False

    def __init__(self, uri: Uri) -> None:
        super().__init__(uri, Driver(uri.text, "topic"))
        self._topic = "/" + uri.text.partition("?")[0].partition("://")[2].strip("/")

    def open(self) -> About:
        """As `Source`; it waits for a publisher."""
        made, by = self._made()
        with self._link.start(made):
            self._begin(self)
        if not made.type_name:
            raise self._nobody()
        if made.type_name not in WRENCHES + POSES:
            raise self._error(f"messages of {made.type_name}", "check the topic and ROS_DOMAIN_ID")
        self._counter = Counter(1e-6, step=None)
        wrench = made.type_name in WRENCHES
        settings = {"message": made.type_name, "by": by} | ({} if wrench else {"pose": TAKEN_FOR_THE_FLANGE})
        return About(f"ROS 2 topic {self._topic}", wrench, not wrench, settings=settings)

    def feed(self, data: Any, arrival: float, batch: Batch) -> None:
        """Put what a message says into the batch."""
        device = nan
        if (header := getattr(data, "header", None)) is not None and (header.stamp.sec or header.stamp.nanosec):
            device = header.stamp.sec + 1e-9 * header.stamp.nanosec
            count = header.stamp.sec * 1_000_000 + header.stamp.nanosec // 1_000
            if self._counter.take(count, arrival, batch) is None:
                return
        inner = getattr(data, "wrench", None) or getattr(data, "pose", data)
        if hasattr(inner, "force"):
            f, t = inner.force, inner.torque
            wrench: Six = (f.x, f.y, f.z, t.x, t.y, t.z)
            batch.samples.append(Sample(arrival, device, wrench))
        else:
            p, q = inner.position, inner.orientation
            turn: Four = (q.x, q.y, q.z, q.w)
            position: Three | None = (p.x, p.y, p.z) if p.x or p.y or p.z else None  # nobody filled it in
            batch.samples.append(Sample(arrival, device, None, turn, position))

    def _made(self) -> tuple[_Rosless | _Rclpy, str]:
        try:
            import_module("rclpy")
        except ImportError:
            pass
        else:
            return _Rclpy(self._topic), "rclpy"
        try:
            rosless = import_module("rosless")
        except ImportError:
            raise MissingExtraError(
                f"{self.uri}: found neither rclpy nor rosless, expected one: source /opt/ros/DISTRO/setup.bash before "
                "the program starts, or pip install rosless"
            ) from None
        try:
            return _Rosless(rosless, self._topic), "rosless"
        except RuntimeError:
            raise self._nobody() from None

    def _nobody(self) -> NobodyYetError:
        return NobodyYetError(str(self._error("nobody who publishes it yet", "check the topic and ROS_DOMAIN_ID")))

    def _error(self, found: str, do: str) -> DeviceError:
        return self._link.error(found, " or ".join(WRENCHES + POSES), do)


class _Rosless:
    def __init__(self, rosless: Any, topic: str) -> None:
        domain = int(os.environ.get("ROS_DOMAIN_ID") or 0)
        self._subscription = rosless.subscribe(topic, domain=domain, wait=LISTENS, depth=DEPTH)
        self.type_name: str = self._subscription.type_name

    def take(self, timeout: float) -> list[Any]:
        messages: list[Any] = []
        while (message := self._subscription.read(timeout=timeout)) is not None and len(messages) < DEPTH:
            messages.append(message)
            timeout = 0.0
        return messages

    def close(self) -> None:
        self._subscription.close()


class _Rclpy:
    def __init__(self, topic: str) -> None:
        rclpy, qos = import_module("rclpy"), import_module("rclpy.qos")
        self._context = rclpy.Context()
        rclpy.init(context=self._context)
        self._node = rclpy.create_node(f"contactwrench_live_{os.getpid()}", context=self._context)
        self._executor = import_module("rclpy.executors").SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._messages: deque[Any] = deque(maxlen=DEPTH)
        self.type_name = self._discovered(topic)
        if self.type_name in WRENCHES + POSES:
            package, _, name = self.type_name.split("/")
            profile = qos.QoSProfile(depth=DEPTH, reliability=qos.ReliabilityPolicy.BEST_EFFORT)
            kind = getattr(import_module(f"{package}.msg"), name)
            self._node.create_subscription(kind, topic, self._keep, profile)

    def _keep(self, message: Any) -> None:
        """A method, as rclpy asks a callback for its signature."""
        self._messages.append(message)

    def _discovered(self, topic: str) -> str:
        for _ in range(round(LISTENS / STEP)):
            if types := dict(self._node.get_topic_names_and_types()).get(topic):
                return str(types[0])
            sleep(STEP)
        return ""

    def take(self, timeout: float) -> list[Any]:
        known = -1
        while len(self._messages) > known:
            known = len(self._messages)
            self._executor.spin_once(timeout_sec=0.0 if known else timeout)
        messages = list(self._messages)
        self._messages.clear()
        return messages

    def close(self) -> None:
        self._executor.shutdown(0.0)
        self._node.destroy_node()
        self._context.try_shutdown()
