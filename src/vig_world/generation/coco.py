"""Datasets as COCO annotations: visible instances, amodal ones as the amodal tools read them, keypoints."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from vig.io.files import write_bytes
from vig.photo.masks import coco_region, run_lengths
from vig.scene import ObjectClass
from vig_world.dataset.format import OBJECT_ID, image_paths, read_info
from vig_world.dataset.read import Dataset, image_bytes, read_dataset
from vig_world.generation.files import refuse_used
from vig_world.generation.keypoints import EDGES, OUTSIDE, class_of_keypoints, keypoints, names_of


def export_coco(root: str | Path, out: str | Path, split: str | None = None) -> Path:
    """Write `out/images/<split>/*.png` and, under `out/annotations`, two files of the split.

    `instances_<split>.json` is plain COCO: segmentation, bbox and area of the visible part; an object that is
    not seen at all has no annotation. `amodal_<split>.json` is in the manner of COCOA and D2SA (segmentation,
    bbox and area of the whole object within the frame, visible_mask, invisible_mask, occlude_rate) and has
    KINS's names beside (a_segm, a_bbox, a_area, i_segm, i_bbox, i_area). Masks are uncompressed run lengths.

    Returns `out`. Raises UserError when there is no such dataset, `out` is the dataset or holds an export of
    that split, or a file cannot be read or written.
    """
    root, out = Path(root), Path(out)
    dataset = read_dataset(root, split)
    split = dataset.folder.name
    refuse_used(root, out, [out / "images" / split, out / "annotations" / f"instances_{split}.json"])
    visible: list[dict[str, Any]] = []
    amodal: list[dict[str, Any]] = []
    read_at_once = 256
    for start in range(0, len(dataset), read_at_once):
        indices = range(start, min(start + read_at_once, len(dataset)))
        alone, visible_masks = dataset.read("mask", indices), dataset.read("mask_visib", indices)
        for index, whole, part in zip(indices, alone, visible_masks, strict=True):
            if part.any():
                visible.append(_instance(index) | coco_region(part))
            amodal.append(_instance(index) | _amodal(whole, part))
            copy_image(dataset, index, out / "images" / split / f"{index:06d}.png")
    for name, regions in (("instances", visible), ("amodal", amodal)):
        _write(dataset, out / "annotations" / f"{name}_{split}.json", regions, {})
    return out


def export_coco_keypoints(
    root: str | Path, out: str | Path, split: str | None = None, object_class: ObjectClass | None = None
) -> Path:
    """Write `out/images/<split>/*.png` and `out/annotations/keypoints_<split>.json`.

    Annotations are those of `export_coco`'s visible instances with `keypoints` and `num_keypoints`; the
    category has the keypoints' names, and the edges of the object's box as its skeleton.

    Returns `out`. Raises UserError as `export_coco` does, and when the dataset is of another class.
    """
    root, out = Path(root), Path(out)
    dataset = read_dataset(root, split)
    split = dataset.folder.name
    object_class = class_of_keypoints(root, split, object_class)
    path = out / "annotations" / f"keypoints_{split}.json"
    refuse_used(root, out, [out / "images" / split, path])
    annotations: list[dict[str, Any]] = []
    for index, located in enumerate(keypoints(dataset, object_class, range(len(dataset)))):
        part = dataset.read("mask_visib", [index])[0]
        if part.any():
            labelled = int(np.count_nonzero(located.seen != OUTSIDE))
            numbers = [round(number, 2) for row in located.rows() for number in row]
            points = {"keypoints": numbers, "num_keypoints": labelled}
            annotations.append(_instance(index) | coco_region(part) | points)
        copy_image(dataset, index, out / "images" / split / f"{index:06d}.png")
    first = len(object_class.points) + 1  # COCO counts from 1
    skeleton = [[first + i, first + j] for i, j in EDGES]
    named = {"keypoints": list(names_of(object_class)), "skeleton": skeleton}
    _write(dataset, path, annotations, named)
    return out


def _write(dataset: Dataset, path: Path, annotations: list[dict[str, Any]], category: dict[str, Any]) -> None:
    """Write a file of annotations; `category` holds further entries of the one category."""
    settings = read_info(dataset.folder.parent)["splits"][dataset.folder.name]
    described = {"id": OBJECT_ID, "name": settings["class"], "supercategory": "object"}
    images = [
        {
            "id": index,
            "file_name": f"{index:06d}.png",
            "width": dataset.size[0],
            "height": dataset.size[1],
            "occlusion": round(float(dataset.occlusion[index]), 6),
        }
        for index in range(len(dataset))
    ]
    data = {
        "info": {"description": f"{settings['class']}, {settings['tier']} tier, seed {settings['seed']}"},
        "licenses": [],
        "categories": [described | category],
        "images": images,
        "annotations": annotations,
    }
    write_bytes(path, json.dumps(data).encode())


def _instance(index: int) -> dict[str, Any]:
    return {"id": index + 1, "image_id": index, "category_id": OBJECT_ID, "iscrowd": 0}


def _amodal(whole: np.ndarray, part: np.ndarray) -> dict[str, Any]:
    full, visible = coco_region(whole), coco_region(part)
    return {
        **full,
        "visible_mask": visible["segmentation"],
        "visible_bbox": visible["bbox"],
        "invisible_mask": run_lengths(whole & ~part),
        "occlude_rate": 1 - visible["area"] / full["area"] if full["area"] else 0.0,
        **{f"a_{short}": full[name] for short, name in _KINS.items()},
        **{f"i_{short}": visible[name] for short, name in _KINS.items()},
    }


_KINS = {"segm": "segmentation", "bbox": "bbox", "area": "area"}


def copy_image(dataset: Dataset, index: int, path: Path) -> None:
    """Copy a sample's photo."""
    source = image_paths(dataset.folder, index)["rgb"]
    write_bytes(path, image_bytes(dataset.folder, source, dataset.size))
