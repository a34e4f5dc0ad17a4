"""ROS: geometry_msgs/PoseWithCovarianceStamped and sensor_msgs/CameraInfo.

The frame is the optical one of the camera that took the photo, `Explanation.pinhole_pose`.
"""

from pathlib import Path
from typing import Any

import numpy as np

from vig.explanation import Explanation
from vig.io.files import write_json

FILES = ("pose.yaml", "camera_info.yaml")


def write(folder: Path, explanation: Explanation) -> None:
    """Write JSON, which is YAML."""
    intrinsics, pose, covariance = explanation.pinhole_pose()
    stamp: dict[str, Any] = {"header": {"frame_id": "camera_optical_frame"}}
    position = dict(zip("xyz", pose[:3, 3].tolist(), strict=True))
    orientation = dict(zip("xyzw", quaternion_of(pose[:3, :3]).tolist(), strict=True))
    placed = {"position": position, "orientation": orientation}
    estimate = {"pose": placed, "covariance": covariance.ravel().tolist()}
    camera = explanation.camera
    info = {"width": camera.width, "height": camera.height, "distortion_model": "plumb_bob", "d": [0.0] * 5}
    matrices = {"k": intrinsics, "r": np.eye(3), "p": np.c_[intrinsics, np.zeros(3)]}
    info |= {name: matrix.ravel().tolist() for name, matrix in matrices.items()}
    write_json(folder / FILES[0], stamp | {"pose": estimate})
    write_json(folder / FILES[1], stamp | info)


def quaternion_of(rotation: np.ndarray) -> np.ndarray:
    """Return x, y, z, w of a rotation, w >= 0: the first eigenvector of Bar-Itzhack's matrix (2000)."""
    (a, b, c), (d, e, f), (g, h, i) = rotation
    lower = [
        [a - e - i, 0, 0, 0],
        [b + d, e - a - i, 0, 0],
        [c + g, f + h, i - a - e, 0],
        [h - f, c - g, d - b, a + e + i],
    ]
    quaternion: np.ndarray = np.linalg.eigh(np.array(lower))[1][:, -1]
    return quaternion if quaternion[3] >= 0 else -quaternion
