"""COCO: images and annotations, whole masks as `segmentation`, visible ones as `visible_segmentation`.

Masks are run lengths. A run is one file, in which images are numbered by files' names that are numbers, as
COCO's are; else by their place. Photos that could not be read are left out.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from vig import __version__
from vig.io.files import atomic_write
from vig.photo.masks import coco_region, run_lengths
from vig_app.exports.annotations import AnnotatedPhoto, Annotation

FILES = ("coco.json",)
Fields = Callable[[Annotation], dict[str, Any]]  # fields of an object that depend on its masks; none skip it


def write_photos(folder: Path, photos: Sequence[AnnotatedPhoto], class_ids: Mapping[str, int]) -> None:
    """Write one file with both masks of each object."""
    write_file(folder / FILES[0], photos, class_ids, both_masks)


def both_masks(annotation: Annotation) -> dict[str, Any]:
    """Return box and mask of the whole object, and the visible part beside them."""
    return coco_region(annotation.amodal) | {"visible_segmentation": run_lengths(annotation.visible)}


def write_file(
    path: Path, photos: Sequence[AnnotatedPhoto], class_ids: Mapping[str, int], fields: Fields
) -> None:
    """Write a line for each object, as there may be many; categories last, as objects name their points.

    Points are keypoints: with the flag 2 where seen, 1 where not, and all 0 beyond the photo.
    """
    keys = "id", "file_name", "width", "height"
    images = [dict(zip(keys, (each.number, each.name, *each.size), strict=True)) for each in photos]
    head = {"info": {"description": f"vig {__version__}"}, "images": images}
    points: dict[str, list[str]] = dict.fromkeys(class_ids, [])
    with atomic_write(path) as temporary, open(temporary, "w", encoding="utf-8") as file:
        print(json.dumps(head)[:-1], end=', "annotations": [', file=file)
        count = 0
        for photo in photos:
            for each in photo.read():
                points[each.category] = [*each.points]
                if not (shown := fields(each)):
                    continue
                count += 1
                width, height = photo.size
                places = [
                    (x, y, 1 + int(seen)) if 0 <= x < width and 0 <= y < height else (0, 0, 0)
                    for x, y, seen in each.points.values()
                ]
                row = {
                    "id": count,
                    "image_id": photo.number,
                    "category_id": class_ids[each.category],
                    "iscrowd": 0,
                    **shown,
                    "score": each.score,
                }
                if places:
                    numbers = [number for place in places for number in place]
                    row |= {"keypoints": numbers, "num_keypoints": sum(flag > 0 for *_, flag in places)}
                print("," * (count > 1), json.dumps(row), sep="\n", end="", file=file)
        categories: list[dict[str, Any]] = [{"id": each, "name": name} for name, each in class_ids.items()]
        for category in categories:
            if named := points[category["name"]]:
                category |= {"keypoints": named, "skeleton": []}
        print(f'], "categories": {json.dumps(categories)}}}', file=file)
