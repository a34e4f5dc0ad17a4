"""Where things lie in a dataset folder, in the BOP layout, and how one sample is described there.

A dataset is `D/info.json` and, for each split, `D/<split>/` with `latents.parquet`, `specs.jsonl` (one
SceneSpec a line) and the BOP scene `000000/`: `rgb/`, `depth/` (16 bits, times depth_scale in mm; 0 unknown),
`mask/` (the object alone), `mask_visib/`, `scene_gt.json`, `scene_camera.json`, `scene_gt_info.json`.
See https://github.com/thodan/bop_toolkit/blob/master/docs/bop_datasets_format.md for the format.
"""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np

from vig.errors import UserError
from vig.scene import IMAGE_SIZE, Latents, ObjectClass
from vig.synthesis.picture import Picture
from vig.synthesis.spec import SceneSpec
from vig.synthesis.view import View

FORMAT_VERSION = 1
INFO = "info.json"
SCENE = "000000"
DEPTH_SCALE = 0.1
"""Millimetres per unit of the depth images."""
OBJECT_ID = 1


def image_paths(folder: Path, index: int) -> dict[str, Path]:
    """The image files of sample `index` in the split folder: rgb, depth, mask, mask_visib."""
    scene = folder / SCENE
    return {
        "rgb": scene / "rgb" / f"{index:06d}.png",
        "depth": scene / "depth" / f"{index:06d}.png",
        "mask": scene / "mask" / f"{index:06d}_000000.png",
        "mask_visib": scene / "mask_visib" / f"{index:06d}_000000.png",
    }


def class_fingerprint(object_class: ObjectClass) -> str:
    """A short hash of the shapes of a class, so that a dataset is not continued with another."""
    digest = hashlib.sha256()
    model = object_class.shape_model
    for array in (model.mean, model.basis, model.faces):
        digest.update(np.ascontiguousarray(array).tobytes())
    digest.update(str(object_class.target_height).encode())
    return digest.hexdigest()[:16]


def describe(spec: SceneSpec, picture: Picture, object_class: ObjectClass) -> dict[str, Any]:
    """All that the merged files say of a sample: keys camera, gt, gt_info (BOP), row (parquet), spec."""
    view = View.of(object_class, spec.azimuth, spec.elevation, IMAGE_SIZE)
    camera = view.camera
    matrix = [camera.focal, 0.0, camera.cx, 0.0, camera.focal, camera.cy, 0.0, 0.0, 1.0]
    rotation, translation = view.rotation.ravel().tolist(), (1000 * view.translation).tolist()
    world = {"cam_R_w2c": rotation, "cam_t_w2c": translation}
    alone, seen = int(picture.amodal.sum()), int(picture.visible.sum())
    border = np.concatenate([picture.amodal[[0, -1]].ravel(), picture.amodal[:, [0, -1]].ravel()])
    latents = dict(zip(Latents.names(len(spec.shape)), spec.latents().tolist(), strict=True))
    return {
        "camera": {"cam_K": matrix, "depth_scale": DEPTH_SCALE, **world},
        "gt": [{"cam_R_m2c": rotation, "cam_t_m2c": translation, "obj_id": OBJECT_ID}],
        "gt_info": [
            {
                "bbox_obj": _box(picture.amodal),
                "bbox_visib": _box(picture.visible),
                "px_count_all": alone,
                "px_count_valid": alone,
                "px_count_visib": seen,
                "visib_fract": seen / alone,
            }
        ],
        "row": {
            "index": spec.index,
            "seed": spec.seed,
            **latents,
            "occlusion": picture.occlusion,
            "target_occlusion": spec.target,
            "cause": spec.cause,
            "truncated": bool(border.any()),
            "panorama": spec.panorama,
        },
        "rejected": spec.rejected,
        "spec": spec.to_json(),
    }


def _box(mask: np.ndarray) -> list[int]:
    """x, y, width, height of the true pixels; all -1 when there is none, as BOP has it."""
    rows, columns = np.nonzero(mask)
    if not len(rows):
        return [-1, -1, -1, -1]
    left, top = int(columns.min()), int(rows.min())
    return [left, top, int(columns.max()) - left + 1, int(rows.max()) - top + 1]


def read_info(root: Path) -> dict[str, Any]:
    """The contents of D/info.json. Raises UserError when it is missing or not ours."""
    try:
        info = json.loads((root / INFO).read_text())
        version = info["vig_dataset"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise UserError(
            f"expected a dataset folder with {INFO}; '{root}' has none that can be read. "
            "Make one with `vig dataset make`."
        ) from error
    if version != FORMAT_VERSION:
        raise UserError(
            f"'{root}' is a dataset of format {version}; this vig reads {FORMAT_VERSION}. Make it again."
        )
    return info
