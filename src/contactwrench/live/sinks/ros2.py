"""Contact wrenches as `geometry_msgs/WrenchStamped`, by rclpy where a ROS 2 is sourced."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ...errors import InputError, MissingExtraError
from ..sink import Turn
from ..source import NO_WRENCH
from ..uri import Uri

FORCE_TORQUE = (("force", slice(0, 3)), ("torque", slice(3, 6)))


class Ros2:
    """`ros2://TOPIC[?frame=NAME]`: one message a sample, in the frame `sensor` unless another is named, with the
    quality of service of sensors. A wrench that is not valid is NaN, as the message has no place to say so.
    """

    FORM = "ros2://TOPIC[?frame=NAME]"
    ABOUT = "WrenchStamped, NaN where it is not valid"
    RATE = "the sensor's"
    TESTED = "rclpy"
    waits = True

    def __init__(self, uri: Uri) -> None:
        uri.only("frame")
        self.uri, self._frame = uri.text, uri.options.get("frame", "sensor")
        self._topic = uri.text.partition("://")[2].partition("?")[0]
        if not self._topic:
            raise InputError(f"{uri}: found no topic, expected a URI like ros2://contact_wrench")
        self.written = self.dropped = 0
        self._context: Any = None
        self._node: Any = None

    def open(self) -> None:
        """Raises `MissingExtraError` where no ROS 2 is sourced."""
        try:
            import rclpy
            from geometry_msgs.msg import WrenchStamped
            from rclpy.qos import qos_profile_sensor_data
        except ImportError as error:
            raise MissingExtraError(
                f"{self.uri}: needs ROS 2's {error.name}, which this Python does not find: start it where ROS is "
                "sourced, as by 'source /opt/ros/jazzy/setup.bash', with the Python of that ROS"
            ) from None
        self._context, self._message = rclpy.Context(), WrenchStamped
        rclpy.init(context=self._context)
        self._node = rclpy.create_node("contactwrench_live", context=self._context)
        self._publisher = self._node.create_publisher(WrenchStamped, self._topic, qos_profile_sensor_data)

    def write(self, turn: Turn) -> None:
        """Publish the contact wrenches, none where there is no calibration yet."""
        for each in turn.judged:
            self._publisher.publish(self._stamped(each.t, each.wrench.tolist() if each.valid else NO_WRENCH))
            self.written += 1

    def close(self) -> None:
        """Take the publisher down."""
        if self._node is not None:
            self._node.destroy_node()
            self._context.shutdown()
            self._node = None

    def _stamped(self, t: float, wrench: Sequence[float]) -> Any:
        message = self._message()
        header = message.header
        header.frame_id, header.stamp.sec = self._frame, int(t)
        header.stamp.nanosec = int((t - int(t)) * 1e9)
        for name, part in FORCE_TORQUE:
            vector = getattr(message.wrench, name)
            vector.x, vector.y, vector.z = wrench[part]
        return message
