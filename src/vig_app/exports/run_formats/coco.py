"""coco.json: the visible masks of a run as a COCO result file, which `COCO.loadRes` reads.

A list of `{image_id, category_id, segmentation, bbox, score, file_name}`: run lengths of the pixels in which
the object is seen, and the box round them; photos in which nothing of it is seen are left out. Images are
numbered by files' names that are numbers, as COCO's are; else by their place.
"""

from __future__ import annotations

import json
from pathlib import Path, PurePath

import numpy as np

from vig.io.checks import reading
from vig.io.files import atomic_write
from vig.photo.decoding import opened
from vig_app.exports.formats.bop import bop_box
from vig_app.exports.formats.coco import run_lengths
from vig_app.exports.run import FILE_NUMBERS, ExportedRun

FILE = "coco.json"


def write(path: Path, run: ExportedRun) -> None:
    """A line for each object, as there may be many."""
    images = run.image_numbers(FILE_NUMBERS)
    with atomic_write(path) as temporary, open(temporary, "w", encoding="utf-8") as file:
        separator = "["
        for row in run.objects:
            picture = run.folder / row["folder"] / "mask.png"
            with reading(picture, "a mask of `vig fit`", "Fit the photo again."), opened(picture) as mask:
                visible = np.asarray(mask) == 255
            if visible.any():
                result = {
                    "image_id": images[row["photo"]][1],
                    "category_id": run.class_ids[row["class"]],
                    "segmentation": run_lengths(visible),
                    "bbox": bop_box(visible),
                    "score": row["score"],
                    "file_name": PurePath(row["photo"]).name,
                }
                print(separator, json.dumps(result), end="", file=file)
                separator = ",\n"
        print("]" if separator != "[" else "[]", file=file)
