"""A ROS 2 node: camera images in, pose with covariance and mask of one object out.

    python examples/ros2/vig_node.py --ros-args -p object:=mug -r image:=/camera/image_rect \\
        -r camera_info:=/camera/camera_info

Topics:
    image: sensor_msgs/Image, undistorted, such as image_rect of image_proc.
    camera_info: sensor_msgs/CameraInfo of these images.
    pose: geometry_msgs/PoseWithCovarianceStamped, published in the frame and with the stamp of the image.
    mask: sensor_msgs/Image, published, mono8, 255 where the object is seen.

Nothing is published while the object is lost. Images that come while one is worked on are dropped, as queues
hold one.
"""

from copy import copy
from typing import Any

import numpy as np
import rclpy
from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import CameraInfo, Image

import vig
from vig_app.exports.formats.ros import quaternion_of

ENCODINGS = {"rgb8": (0, 1, 2), "bgr8": (2, 1, 0), "rgba8": (0, 1, 2), "bgra8": (2, 1, 0), "mono8": (0, 0, 0)}
"""Channels that are red, green and blue, by the encodings that are taken."""
BYTES = {"rgb8": 3, "bgr8": 3, "rgba8": 4, "bgra8": 4, "mono8": 1}


def picture_of(image: Any) -> np.ndarray:
    """Return an image message as (H, W, 3) uint8 RGB; vig.UserError for another encoding or a short one."""
    if image.encoding not in BYTES:
        raise vig.UserError(f"expected an image in {', '.join(BYTES)}; got {image.encoding}. Convert it.")
    channels = BYTES[image.encoding]
    data = np.frombuffer(bytes(image.data), np.uint8)
    if data.size < image.height * image.step or image.step < image.width * channels:
        raise vig.UserError(f"expected {image.height} rows of {image.step} bytes; got {data.size} bytes.")
    rows = data[: image.height * image.step].reshape(image.height, image.step)[:, : image.width * channels]
    pixels = rows.reshape(image.height, image.width, channels)
    return np.ascontiguousarray(pixels[..., ENCODINGS[image.encoding]])


def intrinsics_of(info: Any) -> tuple[float, float, float, float]:
    """Return fx, fy, cx, cy of a camera_info message; vig.UserError where it is uncalibrated or cut."""
    (fx, _, cx), (_, fy, cy), _ = (
        np.reshape(info.p, (3, 4))[:, :3] if any(info.p) else np.reshape(info.k, (3, 3))
    )
    if fx <= 0 or fy <= 0:
        raise vig.UserError(
            "expected the camera_info of a calibrated camera; got a focal length of 0. Calibrate it."
        )
    if info.binning_x > 1 or info.binning_y > 1 or info.roi.width:
        raise vig.UserError("expected whole images; got binning or a region of interest. Leave them out.")
    return float(fx), float(fy), float(cx), float(cy)


class VigNode(Node):
    """The node; its parameter `object` names a class, its pack's folder, or a mesh with colours in metres."""

    def __init__(self) -> None:
        super().__init__("vig")
        name = self.declare_parameter("object", "mug").value
        is_mesh = str(name).lower().endswith((".glb", ".gltf", ".obj", ".ply", ".off", ".stl"))
        self.explainer = vig.Explainer.of_mesh(name) if is_mesh else vig.Explainer(name)
        self.tracker: vig.Tracker | None = None
        self.camera: tuple[Any, ...] = ()
        self.poses = self.create_publisher(PoseWithCovarianceStamped, "pose", 1)
        self.masks = self.create_publisher(Image, "mask", 1)
        quality = copy(qos_profile_sensor_data)
        quality.depth = 1
        self.create_subscription(CameraInfo, "camera_info", self.on_camera, quality)
        self.create_subscription(Image, "image", self.on_image, quality)

    def on_camera(self, info: Any) -> None:
        """Begin anew where the camera is another one than before."""
        try:
            camera = (info.width, info.height, *intrinsics_of(info))
        except vig.UserError as error:
            self.get_logger().error(str(error), throttle_duration_sec=10.0)
            return
        if camera != self.camera:
            self.camera, self.tracker = camera, vig.Tracker(self.explainer, K=camera[2:])

    def on_image(self, image: Any) -> None:
        """Publish the pose and mask in an image."""
        if self.tracker is None:
            self.get_logger().warning("waiting for camera_info", throttle_duration_sec=10.0)
            return
        try:
            pose = self.tracker(picture_of(image))
        except vig.UserError as error:
            self.get_logger().error(str(error), throttle_duration_sec=10.0)
            return
        if pose is None or pose.lost:
            return
        answer = PoseWithCovarianceStamped()
        answer.header = image.header
        place, turn = answer.pose.pose.position, answer.pose.pose.orientation
        place.x, place.y, place.z = pose.camera_from_object[:3, 3].tolist()
        turn.x, turn.y, turn.z, turn.w = quaternion_of(pose.camera_from_object[:3, :3]).tolist()
        answer.pose.covariance = pose.covariance.ravel().tolist()
        self.poses.publish(answer)
        mask = Image()
        mask.header = image.header
        mask.height, mask.width = pose.mask.shape
        mask.encoding, mask.step = "mono8", mask.width
        mask.data = (pose.mask * np.uint8(255)).tobytes()
        self.masks.publish(mask)


def main() -> None:
    """Run the node until it is stopped."""
    rclpy.init()
    node = VigNode()
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
