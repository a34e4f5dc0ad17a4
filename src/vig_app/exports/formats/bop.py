"""BOP: camera, pose and boxes as its datasets have them, and the model, all in millimetres."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from vig.explanation import Explanation
from vig.io.files import atomic_write, write_json
from vig.photo.masks import box_of

MILLIMETRES = 1000.0
"""In a metre."""
OBJECT_ID = 1
"""BOP and COCO count classes from 1; an explanation has one."""
MODEL = f"bop/models/obj_{OBJECT_ID:06}.ply"
FILES = ("bop/scene_camera.json", "bop/scene_gt.json", "bop/scene_gt_info.json", MODEL)


def write(folder: Path, explanation: Explanation, photo: str) -> None:
    """The photo is image 0 of its scene."""
    pose, pixels, visible = explanation.camera_from_object, explanation.amodal.sum(), explanation.mask.sum()
    truth = {
        "obj_id": OBJECT_ID,
        "cam_R_m2c": pose[:3, :3].ravel().tolist(),
        "cam_t_m2c": (MILLIMETRES * pose[:3, 3]).tolist(),
        "score": score(explanation),
    }
    info = {
        "bbox_obj": bop_box(explanation.amodal),
        "bbox_visib": bop_box(explanation.mask),
        "px_count_all": int(pixels),
        "px_count_visib": int(visible),
        "visib_fract": float(visible / pixels) if pixels else 0.0,
    }
    camera = {"cam_K": explanation.camera.K.ravel().tolist(), "depth_scale": 1.0}
    for path, content in zip(FILES, (camera, [truth], [info]), strict=False):
        write_json(folder / path, {"0": content})
    vertices, faces = explanation.vertices, explanation.object_class.shape_model.faces
    rows = ["ply", "format ascii 1.0", f"element vertex {len(vertices)}"]
    rows += [f"property float {axis}" for axis in "xyz"]
    rows += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header"]
    rows += [" ".join(f"{number:.4f}" for number in row) for row in MILLIMETRES * vertices]
    rows += [f"3 {a} {b} {c}" for a, b, c in faces]
    with atomic_write(folder / MODEL) as temporary:
        temporary.write_text("\n".join(rows) + "\n")


def bop_box(mask: np.ndarray) -> list[int]:
    """x, y, width, height round a mask (H, W) bool; -1 four times for nothing, as BOP has it."""
    return list(box_of(mask) or (-1, -1, -1, -1))


def score(explanation: Explanation) -> float | None:
    """The confidence that the view is right, None for a class without calibration."""
    return None if math.isnan(explanation.confidence) else round(explanation.confidence, 5)
