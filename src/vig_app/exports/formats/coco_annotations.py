"""COCO for annotation tools: visible and whole masks as two files of polygons, boxes and keypoints."""

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from vig.photo.masks import coco_region
from vig_app.exports.annotations import SETS, AnnotatedPhoto, Annotation, polygons_of
from vig_app.exports.formats.coco import write_file

FILES = tuple(f"annotations_{name}.json" for name in SETS)


def write_photos(folder: Path, photos: Sequence[AnnotatedPhoto], class_ids: Mapping[str, int]) -> None:
    """Write a file for each set of masks."""
    for file, name in zip(FILES, SETS, strict=True):
        write_file(folder / file, photos, class_ids, partial(_fields, name))


def _fields(name: str, annotation: Annotation) -> dict[str, Any]:
    """Return box, area and polygons of a mask, none of an empty one; Label Studio takes no run lengths."""
    mask = getattr(annotation, name)
    polygons = [polygon.round(2).ravel().tolist() for polygon in polygons_of(mask)]
    return coco_region(mask) | {"segmentation": polygons} if polygons else {}
