"""COCO: an image and an annotation with its amodal and its visible mask as run lengths."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

from vig import __version__
from vig.explanation import Explanation
from vig.io.files import write_json
from vig_app.exports.formats.bop import OBJECT_ID, bop_box, score

FILES = ("coco.json",)


def write(folder: Path, explanation: Explanation, photo: str) -> None:
    """The image's id is the number at the end of the photo's name, 139 of COCO_val2014_000000000139.jpg."""
    height, width = explanation.mask.shape
    digits = re.search(r"([0-9]{1,18})\.\w+$", photo)
    image = (int(digits[1]) if digits else 0) or 1
    annotation = annotation_of(1, image, OBJECT_ID, explanation.amodal, explanation.mask, score(explanation))
    described = {
        "info": {"description": f"vig {__version__}"},
        "images": [{"id": image, "file_name": photo, "width": width, "height": height}],
        "categories": [{"id": OBJECT_ID, "name": explanation.object_class.name}],
        "annotations": [annotation],
    }
    write_json(folder / FILES[0], described)


def annotation_of(
    number: int, image: int, category: int, amodal: np.ndarray, visible: np.ndarray, score: float | None
) -> dict[str, Any]:
    """An object: its whole mask (H, W) bool, and what is seen of it."""
    return {
        "id": number,
        "image_id": image,
        "category_id": category,
        "iscrowd": 0,
        "bbox": bop_box(amodal),
        "area": int(amodal.sum()),
        "segmentation": run_lengths(amodal),
        "visible_segmentation": run_lengths(visible),
        "score": score,
    }


def run_lengths(mask: np.ndarray) -> dict[str, Any]:
    """COCO's uncompressed run lengths of a mask (H, W) bool: down the columns, zeros first."""
    flat = mask.ravel(order="F")
    changes = np.flatnonzero(np.diff(flat)) + 1
    starts = np.concatenate([[0], changes, [flat.size]])
    counts = np.diff(starts).tolist()
    return {"size": list(mask.shape), "counts": [0, *counts] if flat[0] else counts}
