"""labelme: a JSON file for each photo in the folder labelme, polygons of the visible pixels, named points.

The shapes of an object have one group_id. A file that was edited in labelme is neither replaced nor removed.
"""

import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from vig import __version__
from vig.io.checks import read_json
from vig.io.errors import UserError
from vig.io.files import write_json
from vig_app.exports.annotations import AnnotatedPhoto, polygons_of

FILES = ("labelme/*.json",)
VERSION = f"5.5.0 (vig {__version__})"  # the version of the format, which labelme replaces by its own


def write_photos(folder: Path, photos: Sequence[AnnotatedPhoto], class_ids: Mapping[str, int]) -> None:
    """Write the files; UserError for one that was edited."""
    paths = [folder / "labelme" / f"{photo.stem}.json" for photo in photos]
    if changed := [path for path in paths if is_edited(path)]:
        raise UserError(f"expected '{changed[0]}' as vig wrote it; got it edited. Choose another folder.")
    for path, photo in zip(paths, photos, strict=True):
        width, height = photo.size
        name = photo.name
        if photo.path is not None and photo.path.exists():
            name = os.path.relpath(photo.path.resolve(), path.parent.resolve())
        content = {"version": VERSION, "flags": {}, "shapes": _shapes(photo), "imagePath": name}
        write_json(path, content | {"imageData": None, "imageHeight": height, "imageWidth": width})


def is_edited(path: Path) -> bool:
    """Return whether a file is another one than vig wrote."""
    with suppress(OSError, ValueError, AttributeError):
        return read_json(path).get("version") != VERSION
    return os.path.lexists(path)


def _shapes(photo: AnnotatedPhoto) -> list[dict[str, Any]]:
    shapes = []
    for number, each in enumerate(photo.read(), 1):
        parts = [
            (each.category, "polygon", polygon.round(2).tolist()) for polygon in polygons_of(each.visible)
        ]
        parts += [(name, "point", [[x, y]]) for name, (x, y, _) in each.points.items()]
        for label, kind, points in parts:
            shape = {"label": label, "points": points, "group_id": number, "shape_type": kind}
            shapes.append(shape | {"description": "", "flags": {}, "mask": None})
    return shapes
