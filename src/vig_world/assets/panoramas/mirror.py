"""The part of a room's panorama that a mirror in it shows."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy import ndimage

LEAST_BLUR = 0.01
"""Roughness below which mirrors are all alike."""


def mirror(
    radiance: np.ndarray, angle: float, ground_albedo: float
) -> Callable[[np.ndarray, float], np.ndarray]:
    """Return the radiance from unit directions (N, 3), as a mirror of some roughness shows it, above a level
    ground.

    Args:
        radiance: (H, 2H, 3) equirectangular, as in `project_panorama`.
        angle: Radians by which it is turned about +Z.
        ground_albedo: Albedo (3,) of the ground below, lit by the panorama's mean.
    """
    height, width = radiance.shape[:2]
    below = ground_albedo * radiance[: height // 2].mean((0, 1))

    def from_directions(directions: np.ndarray, roughness: float) -> np.ndarray:
        # A lobe's width is about twice the roughness squared, in radians.
        blur = 2 * max(roughness, LEAST_BLUR) ** 2 * height / np.pi
        soft = radiance
        if blur > 0.5:
            soft = ndimage.gaussian_filter(radiance, (blur, blur, 0), mode=("nearest", "wrap", "nearest"))
        around = (np.arctan2(directions[:, 1], directions[:, 0]) - angle) / (2 * np.pi)
        down = np.arccos(np.clip(directions[:, 2], -1, 1)) / np.pi
        row = np.minimum((down * height).astype(np.int32), height - 1)
        place = row * width + np.floor(around * width).astype(np.int32) % width
        reflected = soft.reshape(-1, 3).T.take(place, axis=1)  # a channel after the other: faster
        return np.where(directions[:, 2] < 0, below[:, None], reflected).T

    return from_directions
