"""Places of a class's objects in a whole photo: a map of centres and boxes, read at a few scales.

Each cell of the trunk's coarsest maps gives the probability that an object's centre lies in it, where in the
cell, and how large its box is, hidden parts included (Zhou et al. 2019, "Objects as points").
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from vig.parallel import on_one_core
from vig.photo import ImagePyramid, Window
from vig.scene import srgb_from_linear
from vig.scene.functions import sigmoid

if TYPE_CHECKING:
    from vig.recognition.recognizer import Recognizer

MAP_STRIDE = 16
"""Pixels a side of a cell."""
PHOTO_SIDES = (128, 304)
"""Longer sides of the photo, pixels, at which it is read: objects of a twelfth of it and more are found."""
SIDES_FOR_SEVERAL = (*PHOTO_SIDES, 608)
"""The same for several objects, some of them small: a 23rd of the photo and more."""
BOX_SIDES = (26.0, 150.0)
"""Longer sides of boxes, pixels, that the map predicts."""
MAX_LOG_SIZE = 4.0
"""Log size of a box, in cells, and of a cell, in boxes, at most: beyond any that is trained."""
NUMBERS = 5
"""Numbers of a cell: the centre's logit; how far right and down of the cell's middle it is, in cells; log
width and height of the box, in cells."""


@dataclass(frozen=True)
class Place:
    """A likely place of an object.

    Attributes:
        box: x, y, w, h in the photo's pixels, round its hidden parts as well, also beyond the photo.
        probability: Uncalibrated probability that its centre is there.
    """

    box: tuple[float, float, float, float]
    probability: float


def places(
    photo: np.ndarray | ImagePyramid, recognizer: Recognizer, sides: Sequence[int] = PHOTO_SIDES
) -> list[Place]:
    """Return the places of objects in a photo (H, W, 3), as `coded_photo` gives it, the surest first.

    No two are of one object. The recognizer's network must have a map. sides: Longer ones of the photo,
    pixels, at which it is read.
    """
    found: list[Place] = []
    for side in sides:
        found += on_one_core(lambda side=side: _at_scale(photo, recognizer, side))  # type: ignore[misc]
    separate: list[Place] = []
    for place in sorted(found, key=lambda place: -place.probability):
        # 0.4: intersection over union of boxes from which they are of one object
        if all(box_overlap(place.box, other.box) < 0.4 for other in separate):
            separate.append(place)
    return separate


def _at_scale(photo: np.ndarray | ImagePyramid, recognizer: Recognizer, side: int) -> list[Place]:
    """Return local maxima of the map of a photo whose longer side is made `side` pixels."""
    height, width = photo.shape[:2]
    whole = Window.of(width, height)
    cut, inside = whole.crop(photo, side)
    if not inside.any():  # less than a line is left of a long narrow photo
        return []
    rows, columns = (np.flatnonzero(inside.any(axis)) for axis in (1, 0))
    top, left = int(rows[0]), int(columns[0])
    shown = cut[top : rows[-1] + 1, left : columns[-1] + 1]
    numbers = recognizer.object_map(srgb_from_linear(shown).transpose(2, 0, 1)[None])[0]
    probability = sigmoid(numbers[0])
    found, pixels = [], whole.side / side
    # 0.02: probability from which a centre counts
    for row, column in np.argwhere(_is_highest(probability) & (probability > 0.02)).tolist():
        right, down, *log_size = numbers[1:, row, column].tolist()
        w, h = (
            MAP_STRIDE * pixels * math.exp(min(max(each, -MAX_LOG_SIZE), MAX_LOG_SIZE)) for each in log_size
        )
        x = whole.left + pixels * (left + MAP_STRIDE * (column + 0.5 + right))
        y = whole.top + pixels * (top + MAP_STRIDE * (row + 0.5 + down))
        found.append(Place((x - w / 2, y - h / 2, w, h), float(probability[row, column])))
    return found


def _is_highest(values: np.ndarray) -> np.ndarray:
    """Return whether each cell (H, W) is as high as its eight neighbours."""
    padded = np.pad(values, 1, constant_values=-np.inf)
    height, width = values.shape
    shifted = [padded[i : i + height, j : j + width] for i in range(3) for j in range(3)]
    highest: np.ndarray = values == np.max(shifted, axis=0)
    return highest


def box_overlap(one: tuple[float, float, float, float], other: tuple[float, float, float, float]) -> float:
    """Return the intersection over union of boxes x, y, w, h."""
    shared = box_shared(one, other)
    return shared / (one[2] * one[3] + other[2] * other[3] - shared)


def box_shared(one: tuple[float, float, float, float], other: tuple[float, float, float, float]) -> float:
    """Return the area that boxes x, y, w, h have in common."""
    shared = 1.0
    for low, size in ((0, 2), (1, 3)):
        end = min(one[low] + one[size], other[low] + other[size])
        shared *= max(0.0, end - max(one[low], other[low]))
    return shared
