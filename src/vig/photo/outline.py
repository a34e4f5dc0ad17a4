"""The outline of what a window shows: distances to it, which can be drawn at any size."""

from __future__ import annotations

import numpy as np
from PIL import Image

from vig.photo.masks import box_of

FINER = 4
"""Distances are kept at so many points a pixel of the map."""
SMOOTH = 0.5
"""Pixels of the map within which staircases are smoothed."""
REACH = 12
"""Pixels of the map up to which distances are told; farther away they stay at that."""


def outline_distance(share: np.ndarray) -> np.ndarray:
    """Signed distance (4 S, 4 S) float32, in pixels of a map (S, S), to where the map is a half.

    share: in [0, 1], such as the share of each pixel that an object covers. Negative where it is more than a
    half, cut off at `REACH`.
    """
    from scipy import ndimage

    size, mask = len(share), share > 0.25
    distance: np.ndarray = np.full((FINER * size, FINER * size), float(REACH), np.float32)
    if (box := box_of(mask)) is None:
        return distance
    x, y, width, height = box
    top, left = max(0, y - REACH), max(0, x - REACH)
    part = share[top : y + height + REACH, left : x + width + REACH]
    soft = ndimage.gaussian_filter(part.astype(np.float32), SMOOTH, mode="nearest")
    shape = part.shape[1] * FINER, part.shape[0] * FINER
    fine = np.asarray(Image.fromarray(soft).resize(shape, Image.Resampling.BICUBIC)) > 0.5
    if fine.all() or not fine.any():
        near = np.full(fine.shape, -REACH if fine.all() else REACH, np.float32)
    else:
        # From the outline, which runs half a point beside the points next to it.
        near = np.where(
            fine, 0.5 - ndimage.distance_transform_edt(fine), ndimage.distance_transform_edt(~fine) - 0.5
        ).astype(np.float32)
        near = ndimage.gaussian_filter(near, 1.0, mode="nearest") / FINER
    high, wide = shape[::-1]
    distance[FINER * top : FINER * top + high, FINER * left : FINER * left + wide] = near
    return distance.clip(-REACH, REACH)
