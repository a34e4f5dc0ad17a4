"""nerfstudio: the photo's camera in the object's frame, the photo and its mask.

Where the mask is 0 nerfstudio does not train: on occluders and surroundings.
"""

from pathlib import Path

import numpy as np

from vig.explanation import Explanation
from vig.io.files import write_json
from vig.photo.images import as_srgb, write_png
from vig_app.glb import LOOKS_BACK

FILES = ("transforms.json", "nerfstudio/photo.png", "nerfstudio/mask.png")


def write(folder: Path, explanation: Explanation) -> None:
    """Write one frame."""
    camera, (described, picture, mask) = explanation.camera, FILES
    write_png(folder / picture, as_srgb(explanation.picture))
    write_png(folder / mask, explanation.mask)
    pose = np.linalg.inv(explanation.camera_from_object) @ LOOKS_BACK
    frame = {"file_path": picture, "mask_path": mask, "transform_matrix": pose.tolist()}
    lens = {"fl_x": camera.focal, "fl_y": camera.focal_y or camera.focal, "cx": camera.cx, "cy": camera.cy}
    size = {"camera_model": "OPENCV", "w": camera.width, "h": camera.height}
    write_json(folder / described, size | lens | {"frames": [frame]})
