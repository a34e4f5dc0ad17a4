"""Starts the node behind a camera: ros2 launch examples/ros2/vig.launch.py object:=mug camera:=/camera"""

import sys
from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess
from launch.substitutions import LaunchConfiguration


def generate_launch_description() -> LaunchDescription:
    """Return the node with the topics of a rectified camera."""
    camera = LaunchConfiguration("camera")
    node = Path(__file__).with_name("vig_node.py")
    remapped = ["-r", ["image:=", camera, "/image_rect"], "-r", ["camera_info:=", camera, "/camera_info"]]
    return LaunchDescription(
        [
            DeclareLaunchArgument("object", default_value="mug", description="class, its pack, or a mesh"),
            DeclareLaunchArgument("camera", default_value="/camera", description="namespace of the camera"),
            ExecuteProcess(
                cmd=[
                    sys.executable,
                    str(node),
                    "--ros-args",
                    "-p",
                    ["object:=", LaunchConfiguration("object")],
                    *remapped,
                ],
                output="screen",
            ),
        ]
    )
