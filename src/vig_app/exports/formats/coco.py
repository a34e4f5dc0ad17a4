"""COCO: images and annotations, whole masks as `segmentation`, visible ones as `visible_segmentation`.

Masks are run lengths. A run is one file, in which images are numbered by files' names that are numbers, as
COCO's are; else by their place. Photos that could not be read are left out.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping
from pathlib import Path, PurePath
from typing import Any

import numpy as np

from vig import __version__
from vig.explanation import Explanation
from vig.io.checks import reading
from vig.io.files import atomic_write, write_json
from vig.photo.decoding import opened
from vig.photo.masks import run_lengths
from vig_app.exports.formats.bop import OBJECT_ID, bop_box, score
from vig_app.exports.run import FILE_NUMBERS, ExportedRun

FILES = ("coco.json",)
RUN_FILE = "coco.json"


def write(folder: Path, explanation: Explanation, photo: str) -> None:
    """Write the photo; its id is the number at the end of its name, 139 of COCO_val2014_000000000139.jpg."""
    height, width = explanation.mask.shape
    digits = re.search(r"([0-9]{1,18})\.\w+$", photo)
    image = (int(digits[1]) if digits else 0) or 1
    annotation = annotation_of(1, image, OBJECT_ID, explanation.amodal, explanation.mask, score(explanation))
    head = head_of([(image, photo, width, height)], {explanation.object_class.name: OBJECT_ID})
    write_json(folder / FILES[0], head | {"annotations": [annotation]})


def write_run(path: Path, run: ExportedRun) -> None:
    """Write a line for each object, as there may be many."""
    numbers = run.image_numbers(FILE_NUMBERS)
    names = [PurePath(photo).name for photo in run.sizes]
    names = names if len(set(names)) == len(names) else [PurePath(photo).as_posix() for photo in run.sizes]
    images = [
        (numbers[photo][1], name, *size) for name, (photo, size) in zip(names, run.sizes.items(), strict=True)
    ]
    head = head_of(images, run.class_ids)
    with atomic_write(path) as temporary, open(temporary, "w", encoding="utf-8") as file:
        print(json.dumps(head)[:-1], end=', "annotations": [', file=file)
        count = 0
        for row in run.objects:
            picture = run.folder / row["folder"] / "mask.png"
            with reading(picture, "a mask of `vig fit`", "Fit the photo again."), opened(picture) as mask:
                levels = np.asarray(mask)
            if levels.any():
                count += 1
                image, category = numbers[row["photo"]][1], run.class_ids[row["class"]]
                annotation = annotation_of(count, image, category, levels > 0, levels == 255, row["score"])
                print("," * (count > 1), json.dumps(annotation), sep="\n", end="", file=file)
        print("]}", file=file)


def head_of(images: Iterable[tuple[int, str, int, int]], class_ids: Mapping[str, int]) -> dict[str, Any]:
    """Return all but the annotations: number, name, width and height of images; numbers of classes."""
    return {
        "info": {"description": f"vig {__version__}"},
        "images": [dict(zip(("id", "file_name", "width", "height"), each, strict=True)) for each in images],
        "categories": [{"id": number, "name": name} for name, number in class_ids.items()],
    }


def annotation_of(
    number: int, image: int, category: int, amodal: np.ndarray, visible: np.ndarray, score: float | None
) -> dict[str, Any]:
    """Return an object: its whole mask (H, W) bool, and its visible pixels."""
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
