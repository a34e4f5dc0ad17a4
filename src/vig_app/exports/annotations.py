"""Photos and their objects as annotation tools have them: masks, keypoints, a 3-D box; polygons of masks."""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import product
from pathlib import Path, PurePath
from typing import Any

import numpy as np

from vig.explanation import Explanation
from vig.io.checks import reading
from vig.io.errors import UserError
from vig.photo.decoding import open_picture
from vig.photo.masks import box_of
from vig.photo.pinhole import project
from vig.record import read_explanation
from vig_app.exports.run import FILE_NUMBERS, OBJECT_ID
from vig_app.exports.run import ExportedRun as ExportedRun

SETS = "visible", "amodal"
"""The masks of an annotation by their names: the pixels that are seen, and those of the whole object."""


@dataclass(frozen=True)
class Annotation:
    """One object of a photo of H x W pixels.

    Attributes:
        category: Name of its class.
        visible: (H, W) bool, where it is seen.
        amodal: (H, W) bool, the whole object.
        score: The confidence; None where none was learned.
        points: Each point that the class names: x, y in pixels; 1 where it is seen, else 0.
        corners: (2, 2, 2, 3) corners of its 3-D box by low and high x, y, z of the object's frame: their x, y
            on the photo and their depth, metres; None for a result of an earlier version.
    """

    category: str
    visible: np.ndarray
    amodal: np.ndarray
    score: float | None
    points: Mapping[str, Sequence[float]]
    corners: np.ndarray | None

    @staticmethod
    def of(described: Mapping[str, Any], visible: np.ndarray, amodal: np.ndarray) -> "Annotation":
        """Return the annotation of the content of explanation.json and its masks (H, W)."""
        corners, camera = None, described["camera"]
        if bounds := described.get("bounds"):
            places = np.array([*product(*zip(*bounds, strict=True))])
            pose = np.array(camera["camera_from_object"])
            corners = project(np.array(camera["K"]), pose, places).reshape(2, 2, 2, 3)
        points = described.get("points", {})
        return Annotation(described["class"], visible, amodal, described["confidence"], points, corners)


@dataclass(frozen=True)
class AnnotatedPhoto:
    """A photo: its number, name and unique stem among those of a run, width and height, path and objects.

    `read` reads the objects, as masks of many photos would fill the memory.
    """

    number: int
    name: str
    stem: str
    size: tuple[int, int]
    path: Path | None
    read: Callable[[], Iterator[Annotation]]


def one_photo(explanation: Explanation, name: str) -> tuple[list[AnnotatedPhoto], dict[str, int]]:
    """Return the photo of an explanation as those of a run, and the number of its class.

    Its own number is that at the end of its name, 139 of COCO_val2014_000000000139.jpg.
    """
    height, width = explanation.mask.shape
    digits = re.search(r"([0-9]{1,18})\.\w+$", name)
    objects = [Annotation.of(explanation.to_dict(), explanation.mask, explanation.amodal)]
    objects = objects if explanation.amodal.any() else []
    number, stem = (int(digits[1]) if digits else 0) or 1, PurePath(name).stem
    photo = AnnotatedPhoto(number, name, stem, (width, height), None, lambda: iter(objects))
    return [photo], {explanation.object_class.name: OBJECT_ID}


def photos_of(run: ExportedRun) -> list[AnnotatedPhoto]:
    """Return the photos of a run that could be read, numbered by their files' names or by their place."""
    numbers = run.image_numbers(FILE_NUMBERS)
    names = [PurePath(photo).name for photo in run.sizes]
    names = names if len(set(names)) == len(names) else [PurePath(photo).as_posix() for photo in run.sizes]
    rows: dict[str, list[dict[str, Any]]] = {photo: [] for photo in run.sizes}
    for row in run.objects:
        rows[row["photo"]].append(row)

    def read(photo: str) -> Iterator[Annotation]:
        for row in rows[photo]:
            folder = run.folder / row["folder"]
            picture = folder / "mask.png"
            with (
                reading(picture, "a mask of `vig fit`", "Fit the photo again."),
                open_picture(picture) as mask,
            ):
                levels = np.asarray(mask)
            if levels.any():
                described = read_explanation(folder) | {"confidence": row["score"]}
                yield Annotation.of(described, levels == 255, levels > 0)

    return [
        AnnotatedPhoto(numbers[photo][1], name, run.folders[photo], size, Path(photo), partial(read, photo))
        for name, (photo, size) in zip(names, run.sizes.items(), strict=True)
    ]


def polygons_of(mask: np.ndarray) -> list[np.ndarray]:
    """Return a polygon (N, 2) x, y in pixels round each piece of a mask (H, W) bool, the largest first.

    Holes are joined to their piece by a line there and back. Raises UserError without OpenCV.
    """
    try:
        import cv2
    except ImportError:
        raise UserError("polygons need OpenCV; run pip install 'vig[match]'") from None
    x, y, width, height = box_of(mask) or (0, 0, 0, 0)
    # Lines through the middles of pixels of a quarter of the size lie an eighth of a pixel within the edge.
    fine: Any = np.kron(mask[y : y + height, x : x + width].astype(np.uint8), np.ones((4, 4), np.uint8))
    lines, tree = cv2.findContours(fine, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    pieces: dict[int, np.ndarray] = {}
    order = sorted(range(len(lines)), key=lambda number: tree[0][number][3] >= 0)  # holes after their pieces
    for number in order:
        line = cv2.approxPolyDP(lines[number], 2.0, True)[:, 0]  # to half a pixel
        parent = int(tree[0][number][3])
        if len(line) < 3:
            continue
        if parent < 0:
            pieces[number] = line
        elif parent in pieces:
            outer = pieces[parent]
            apart = np.abs(outer[:, None] - line).sum(2)
            at, start = np.unravel_index(apart.argmin(), apart.shape)
            hole = np.roll(line, -start, axis=0)
            pieces[parent] = np.concatenate([outer[: at + 1], hole, hole[:1], outer[at:]])
    found = sorted(pieces.values(), key=cv2.contourArea, reverse=True)
    return [(piece + 0.5) / 4 + (x, y) for piece in found]
