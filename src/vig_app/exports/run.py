"""A finished run as its exports need it: found objects, with the numbers of photos and classes."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import Any

from vig_app.results import read_results

OBJECT_ID = 1  # BOP and COCO count classes from 1; an explanation has one
FILE_NUMBERS = (r"()(?:^|/)([0-9]+)", r"()(?:^|/|[^0-9])([0-9]{1,18})")
"""Ends of paths that number the image: files named by a number, or with one at the end."""
SCENE_NUMBERS = (r"([0-9]+)/(?:rgb|gray)/([0-9]+)", *FILE_NUMBERS)
"""The same preceded by BOP's, which number the scene, too."""


@dataclass(frozen=True)
class ExportedRun:
    """The results of many photos.

    Attributes:
        folder: Folder of the run.
        photos: Paths of all photos, each once.
        objects: Rows of results.csv of the objects that were found, with a "score": the confidence, 1 where
            none was learned.
        class_ids: Number of each class.
        sizes: Width and height of each photo that could be read, pixels.
        folders: Name of each photo's folder of results.
    """

    folder: Path
    photos: tuple[str, ...]
    objects: tuple[dict[str, Any], ...]
    class_ids: dict[str, int]
    sizes: dict[str, tuple[int, int]]
    folders: dict[str, str]

    @staticmethod
    def read(folder: Path, first_id: int) -> "ExportedRun":
        """Return a folder's run, classes numbered by name from `first_id`; UserError as `read_results`."""
        rows = read_results(folder)
        photos = tuple(dict.fromkeys(row["photo"] for row in rows))
        objects = tuple(
            row | {"score": 1.0 if row["confidence"] is None else row["confidence"]}
            for row in rows
            if row["error"] is None and row["verdict"] != "absent"
        )
        classes = sorted({row["class"] for row in rows if row["class"] is not None})
        sizes = {row["photo"]: (row["width"], row["height"]) for row in rows if row["error"] is None}
        class_ids = {name: first_id + i for i, name in enumerate(classes)}
        folders = {row["photo"]: row["folder"].split("/")[0] for row in rows}
        return ExportedRun(folder, photos, objects, class_ids, sizes, folders)

    def image_numbers(self, patterns: Sequence[str]) -> dict[str, tuple[int, int]]:
        """Return scene and image of each photo: from the paths where all match and differ, else by place.

        Args:
            patterns: Patterns of the ends of paths, with a group for the scene and one for the image.
        """
        for pattern in patterns:
            ends = [re.search(rf"{pattern}\.\w+$", PurePath(photo).as_posix()) for photo in self.photos]
            numbers = [(int(end[1] or 0), int(end[2])) for end in ends if end is not None]
            if len(set(numbers)) == len(self.photos):
                return dict(zip(self.photos, numbers, strict=True))
        return {photo: (0, place) for place, photo in enumerate(self.photos)}
