"""The ROS node: topics, services and parameters wired to a session; it decides nothing."""

from __future__ import annotations

import sys
from collections.abc import Callable, Coroutine
from typing import Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import PoseStamped, WrenchStamped
from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor, SetParametersResult
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.exceptions import InvalidTopicNameException
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.task import Future
from rclpy.validate_topic_name import validate_topic_name
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool
from std_srvs.srv import Trigger

from contactwrench.assess.robot_arms import flange_pose
from contactwrench.errors import ContactWrenchError, InputError, visible
from contactwrench.recording.bags.messages import joint_places
from contactwrench.recording.urdf import arm_of

from .capturing import SECONDS
from .chain import Transform
from .parameters import PARAMETERS, TOPICS, Parameter, meant
from .session import Answer, Session
from .track import Pose, filled_in

SENSOR = QoSProfile(depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT)
"""Sensor QoS with room for 1 s at 1 kHz: a process that waits for its turn misses more than the usual 5 readings."""
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
STATIC = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def seconds(stamp: Any) -> float:
    """A stamp in s."""
    return float(stamp.sec + 1e-9 * stamp.nanosec)


def descriptor(parameter: Parameter) -> ParameterDescriptor:
    """As ROS has it; of any type, as ROS refuses 20 where 20.0 is meant."""
    within = parameter.within
    return ParameterDescriptor(
        description=parameter.description,
        read_only=not parameter.live,
        dynamic_typing=True,
        floating_point_range=[] if within is None else [FloatingPointRange(from_value=within[0], to_value=within[1])],
    )


class ContactWrenchNode(Node):  # type: ignore[misc]
    """Readings and poses in, contact wrenches out. Raises `ContactWrenchError` for parameters that cannot be meant."""

    def __init__(self, **options: Any) -> None:
        super().__init__("contactwrench", **options)
        of_any_type = ParameterDescriptor(dynamic_typing=True)
        stated = {name: self.declare_parameter(name, p.default, of_any_type).value for name, p in PARAMETERS.items()}
        topics = "wrench_topic", *(name for source, name in TOPICS.items() if source == stated["pose_source"])
        self.session = Session(stated | {name: self.topic(name, stated[name]) for name in topics})
        for name, parameter in PARAMETERS.items():
            self.set_descriptor(name, descriptor(parameter))
        if self.session.note:
            self.get_logger().warning(self.session.note)
        self.steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.told: bool | None = None
        self.wrenches = self.create_publisher(WrenchStamped, "~/contact_wrench", 200)
        self.contacts = self.create_publisher(Bool, "~/contact", LATCHED)
        self.diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        getattr(self, f"listen_to_{self.settings['pose_source']}")()  # first: poses are taken before readings that wait
        self.create_subscription(
            WrenchStamped,
            stated["wrench_topic"],
            self.on_wrench,
            SENSOR,
            event_callbacks=SubscriptionEventCallbacks(message_lost=self.on_lost),
        )
        self.waiting = ReentrantCallbackGroup()  # a service that awaits would hold up the others of its group
        for name, serve in {
            "~/zero": self.after_a_second(self.session.zero),
            "~/start_calibration": self.at_once(self.session.start),
            "~/capture": self.after_a_second(self.session.capture),
            "~/finish_calibration": self.at_once(self.session.finish),
        }.items():
            self.create_service(Trigger, name, serve, callback_group=self.waiting)
        self.add_on_set_parameters_callback(self.on_parameters)
        self.since = self.steady.now()
        self.create_timer(1.0, self.on_second, clock=self.steady)

    @property
    def settings(self) -> dict[str, Any]:
        """The parameters by their names."""
        return self.session.settings

    def topic(self, name: str, stated: Any) -> str:
        """The full name of the topic that a parameter states. Raises `InputError` for what is none."""
        topic = str(meant(name, stated))
        try:
            validate_topic_name(topic)
        except InvalidTopicNameException:
            raise InputError(f"{name} is {topic!r}, expected a topic such as {PARAMETERS[name].default}") from None
        return str(self.resolve_topic_name(topic))

    def listen_to_tf(self) -> None:
        """Poses from /tf and /tf_static."""
        from tf2_msgs.msg import TFMessage

        def heard(message: TFMessage, static: bool) -> None:
            transforms = []
            for each in message.transforms:
                p, q, header = each.transform.translation, each.transform.rotation, each.header
                t, quat, place = seconds(header.stamp), (q.x, q.y, q.z, q.w), (p.x, p.y, p.z)
                transforms.append(Transform(header.frame_id, each.child_frame_id, t, quat, place))
            self.session.transforms(transforms, static)

        self.create_subscription(TFMessage, "/tf", lambda message: heard(message, False), 100)
        self.create_subscription(TFMessage, "/tf_static", lambda message: heard(message, True), STATIC)

    def listen_to_pose(self) -> None:
        """Poses from a PoseStamped."""

        def heard(message: PoseStamped) -> None:
            p, q, frame = message.pose.position, message.pose.orientation, message.header.frame_id.removeprefix("/")
            if frame in ("", self.settings["base_frame"].removeprefix("/")):
                place = filled_in((p.x, p.y, p.z))
                self.session.pose(Pose(seconds(message.header.stamp), (q.x, q.y, q.z, q.w), place))
            else:
                said = f"poses are in {frame}, expected base_frame {self.settings['base_frame']}: passed over"
                self.get_logger().error(said, throttle_duration_sec=10.0)

        self.create_subscription(PoseStamped, self.get_parameter("pose_topic").value, heard, SENSOR)

    def listen_to_joints(self) -> None:
        """Poses from joint angles. Raises `ContactWrenchError` for an arm that is not known."""
        arm = arm_of(self.settings["urdf"])

        def heard(message: JointState) -> None:
            places = joint_places(message.name, arm)
            if places is None or len(message.position) != len(message.name):
                return  # a gripper's, or a part of the arm's
            R, position = flange_pose(arm, np.array([message.position])[:, places])
            x, y, z, w = Rotation.from_matrix(R[0]).as_quat().tolist()
            a, b, c = position[0].tolist()
            self.session.pose(Pose(seconds(message.header.stamp), (x, y, z, w), filled_in((a, b, c))))

        self.create_subscription(JointState, self.get_parameter("joint_topic").value, heard, SENSOR)

    def on_wrench(self, message: WrenchStamped) -> None:
        """A reading; a valid contact wrench goes out with its stamp."""
        force, torque, header = message.wrench.force, message.wrench.torque, message.header
        found = self.session.read(seconds(header.stamp), (force.x, force.y, force.z, torque.x, torque.y, torque.z))
        if found is None:
            return
        frames = {"flange": self.settings["flange_frame"], "base": self.settings["base_frame"]}
        header.frame_id = frames.get(self.settings["output_frame"], header.frame_id)
        force.x, force.y, force.z, torque.x, torque.y, torque.z = found.tolist()
        self.wrenches.publish(message)
        if self.session.contact is not None and self.session.contact is not self.told:
            self.told = self.session.contact
            self.contacts.publish(Bool(data=self.told))

    def on_lost(self, event: Any) -> None:
        """The middleware says how many readings it dropped."""
        self.session.tally.lost = event.total_count

    def on_second(self) -> None:
        """Diagnostics."""
        now, doubt = self.steady.now(), self.session.tally.doubt
        status = self.session.status(1e-9 * (now - self.since).nanoseconds)
        self.since = now
        values = [KeyValue(key=key, value=value) for key, value in status.values.items()]
        name, level = self.get_fully_qualified_name().removeprefix("/"), bytes([status.level])
        said = DiagnosticStatus(level=level, name=name, message=status.message, values=values)
        array = DiagnosticArray(status=[said])
        array.header.stamp = self.get_clock().now().to_msg()
        self.diagnostics.publish(array)
        if doubt:
            self.get_logger().warning(doubt, throttle_duration_sec=60.0)
        if lacking := self.session.lacking:
            self.get_logger().warning(lacking, once=True)

    def on_parameters(self, changes: list[Any]) -> SetParametersResult:
        """Take what can be meant, refuse the rest with one line."""
        try:
            self.session.set({change.name: change.value for change in changes if change.name in PARAMETERS})
        except ContactWrenchError as error:
            return SetParametersResult(successful=False, reason=visible(str(error)))
        return SetParametersResult(successful=True)

    def at_once(self, wish: Callable[[], Answer]) -> Callable[[Any, Any], Any]:
        """A service that answers with what the session says."""

        def serve(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            answer = wish()
            response.success, response.message = answer.success, visible(answer.message)
            if answer.success:
                self.get_logger().info(response.message)
            else:
                self.get_logger().warning(response.message)
            return response

        return serve

    def after_a_second(self, wish: Callable[[], Answer]) -> Callable[[Any, Any], Coroutine[Any, Any, Any]]:
        """A service that lets the session gather a second of readings first."""

        async def serve(request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            busy = self.session.gather()
            if busy is not None:
                return self.at_once(lambda: busy)(request, response)
            done = Future(executor=self.executor)
            timer = self.create_timer(SECONDS, lambda: done.set_result(None), self.waiting, self.steady)
            await done
            self.destroy_timer(timer)
            return self.at_once(wish)(request, response)

        return serve


def main(args: list[str] | None = None) -> int:
    """Run until interrupted. Returns the exit status: 2 for parameters that cannot be meant."""
    rclpy.init(args=args)
    try:
        rclpy.spin(ContactWrenchNode())
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except ContactWrenchError as error:
        print(f"contactwrench: {visible(str(error))}", file=sys.stderr)
        return 2
    except Exception:
        if rclpy.ok():  # else a callback ran on while all ended
            raise
    finally:
        rclpy.try_shutdown()
    return 0
