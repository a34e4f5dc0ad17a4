"""The outline of a window's object: distances to it, which can be drawn at any size."""

import math

import numpy as np
from PIL import Image

from vig.photo.filters import gaussian_filter
from vig.photo.masks import box_of

FINER = 4  # distances are kept at so many points a pixel of the map
SMOOTH = 0.5  # pixels of the map within which staircases are smoothed
REACH = 12  # pixels of the map up to which distances are measured; farther away they stay at that
BESIDE = 5  # points from which distances are smoothed
SMALLEST_PICTURE = 320  # pixels of the longer side of the smallest pictures on which outlines are drawn


def line_width(height: float, width: float) -> float:
    """Return the pixels of an outline on a photo of a size, the dark lines beside it left out."""
    return max(1.5, min(height, width) / 250)


def line_reach(height: float, width: float) -> float:
    """Return the pixels from an object to the outer end of an outline and of the dark line beside it."""
    line = line_width(height, width)
    return line + 2 * max(1.0, line / 2) + 0.5


def outline_distance(share: np.ndarray, outside: float = REACH, inside: float = REACH) -> np.ndarray:
    """Return signed distance (4 S, 4 S) float32, in pixels of a map (S, S), to where the map is a half.

    Args:
        share: Values in [0, 1], such as the share of a pixel that an object covers. Distances are negative
            where it is more than a half.
        outside: Distance up to which they are needed there, at most `REACH`; farther away they stay at that.
        inside: The same of the other side.
    """
    size, reach = len(share), math.ceil(max(outside, inside)) + 1
    distance: np.ndarray = np.full((FINER * size, FINER * size), outside, np.float32)
    if (box := box_of(share > 0.25)) is None:
        return distance
    x, y, width, height = box
    top, left = max(0, y - reach), max(0, x - reach)
    part = share[top : y + height + reach, left : x + width + reach]
    soft = gaussian_filter(part.astype(np.float32), SMOOTH)
    shape = part.shape[1] * FINER, part.shape[0] * FINER
    fine = np.asarray(Image.fromarray(soft).resize(shape, Image.Resampling.BICUBIC)) > 0.5
    # From the outline, which runs half a point beside the points next to it.
    within, beyond = _points_to(~fine, inside), _points_to(fine, outside)
    near = gaussian_filter(np.where(fine, 0.5 - within, beyond - 0.5), 1.0) / FINER
    high, wide = shape[::-1]
    distance[FINER * top : FINER * top + high, FINER * left : FINER * left + wide] = near
    return distance.clip(-inside, outside)


def _points_to(places: np.ndarray, reach: float) -> np.ndarray:
    """Return the distance (h, w) float32, in points, to the nearest of some places (h, w) bool.

    Exact up to a reach in pixels of the map and `BESIDE` points; farther away it is a point more than that.
    """
    most = math.ceil(FINER * reach) + BESIDE
    along = np.where(places, 0, most + 1).astype(np.int16)
    step = 1
    while step <= most:  # along the rows: 0 or 1, then 0 or 2, then 0 or 4 points on make any number
        farther = along + np.int16(step)
        np.minimum(along[:, step:], farther[:, :-step], out=along[:, step:])
        np.minimum(along[:, :-step], farther[:, step:], out=along[:, :-step])
        step *= 2
    square = np.minimum(along, most + 1) ** 2
    nearest, farther = square.copy(), np.empty_like(square)
    for step in range(1, most + 1):
        np.add(square, np.int16(step * step), out=farther)
        np.minimum(nearest[step:], farther[:-step], out=nearest[step:])
        np.minimum(nearest[:-step], farther[step:], out=nearest[:-step])
    roots = np.sqrt(np.arange((most + 1) ** 2 + 1, dtype=np.float32))
    return np.asarray(roots[np.minimum(nearest, (most + 1) ** 2)])
