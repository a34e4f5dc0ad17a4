"""A photo with the explained object drawn over it."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

OUTLINE = np.array([255, 210, 0], np.float32)
HIDDEN = np.array([235, 40, 120], np.float32)
HIDDEN_SHARE = 0.5


def overlay(photo: np.ndarray, amodal: np.ndarray, visible: np.ndarray) -> np.ndarray:
    """The photo with the object's whole outline in yellow and its hidden pixels tinted pink.

    photo (H, W, 3) uint8 sRGB; amodal, visible (H, W) bool. Result (H, W, 3) uint8. The outline's width
    grows with the photo.
    """
    picture = photo.astype(np.float32)
    hidden = amodal & ~visible
    picture[hidden] = (1 - HIDDEN_SHARE) * picture[hidden] + HIDDEN_SHARE * HIDDEN
    width = max(1, round(min(photo.shape[:2]) / 200))
    rim = ndimage.binary_dilation(amodal, iterations=width) & ~amodal
    picture[rim] = OUTLINE
    return picture.round().astype(np.uint8)
