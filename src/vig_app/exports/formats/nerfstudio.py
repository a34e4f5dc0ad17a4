"""nerfstudio: the photo's camera in the object's frame, the photo and its mask.

Where the mask is 0 nerfstudio does not train: on occluders and surroundings.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from vig.explanation import Explanation
from vig.io.files import write_json
from vig.photo.images import coded, write_png
from vig_app.glb import LOOKS_BACK

TRANSFORMS = "transforms.json"
PHOTO = "nerfstudio/photo.png"
MASK = "nerfstudio/mask.png"
FILES = (TRANSFORMS, PHOTO, MASK)


def write(folder: Path, explanation: Explanation, photo: str) -> None:
    """Write one frame."""
    camera = explanation.camera
    write_png(folder / PHOTO, coded(explanation.picture))
    write_png(folder / MASK, explanation.mask)
    frame = {
        "file_path": PHOTO,
        "mask_path": MASK,
        "transform_matrix": (np.linalg.inv(explanation.camera_from_object) @ LOOKS_BACK).tolist(),
    }
    described = {
        "camera_model": "OPENCV",
        "w": camera.width,
        "h": camera.height,
        "fl_x": camera.focal,
        "fl_y": camera.focal_y or camera.focal,
        "cx": camera.cx,
        "cy": camera.cy,
        "frames": [frame],
    }
    write_json(folder / TRANSFORMS, described)
