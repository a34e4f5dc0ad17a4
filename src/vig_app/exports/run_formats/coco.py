"""coco.json: a run as one COCO file of images, categories and annotations.

An annotation is that of a photo's own coco.json: the whole mask as `segmentation`, what is seen of it as
`visible_segmentation`. Images are numbered by files' names that are numbers, as COCO's are; else by their
place. Photos that could not be read are left out.
"""

from __future__ import annotations

import json
from pathlib import Path, PurePath

import numpy as np

from vig import __version__
from vig.io.checks import reading
from vig.io.files import atomic_write
from vig.photo.decoding import opened
from vig_app.exports.formats.coco import annotation_of
from vig_app.exports.run import FILE_NUMBERS, ExportedRun

FILE = "coco.json"


def write(path: Path, run: ExportedRun) -> None:
    """A line for each object, as there may be many."""
    numbers = run.image_numbers(FILE_NUMBERS)
    names = [PurePath(photo).name for photo in run.sizes]
    names = names if len(set(names)) == len(names) else [PurePath(photo).as_posix() for photo in run.sizes]
    head = {
        "info": {"description": f"vig {__version__}"},
        "images": [
            {"id": numbers[photo][1], "file_name": name, "width": width, "height": height}
            for name, (photo, (width, height)) in zip(names, run.sizes.items(), strict=True)
        ],
        "categories": [{"id": number, "name": name} for name, number in run.class_ids.items()],
    }
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
