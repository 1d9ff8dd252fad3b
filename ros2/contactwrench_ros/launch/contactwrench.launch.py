"""The node with a file of parameters: `ros2 launch contactwrench_ros contactwrench.launch.py params:=my.yaml`."""

from pathlib import Path

from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchDescription


def generate_launch_description() -> LaunchDescription:
    """One node, whose parameters are in `params`."""
    usual = Path(__file__).parents[1] / "config" / "contactwrench.yaml"
    return LaunchDescription(
        [
            DeclareLaunchArgument("params", default_value=str(usual), description="file of parameters"),
            Node(
                package="contactwrench_ros",
                executable="contactwrench",
                name="contactwrench",
                output="screen",
                parameters=[LaunchConfiguration("params")],
            ),
        ]
    )
