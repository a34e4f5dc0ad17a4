"""What pictures are put together from: layers, flat textures, uneven light."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from vig.scene import IMAGE_SIZE
from vig_world.assets.coats import TEXTURES, any_colour, stock_texture


@dataclass(frozen=True)
class Layer:
    """Something drawn: linear RGB (H, W, 3), not multiplied with its coverage (H, W)."""

    colour: np.ndarray
    cover: np.ndarray

    def over(self, picture: np.ndarray) -> np.ndarray:
        """The layer before a picture (H, W, 3)."""
        return picture + self.cover[..., None] * (self.colour - picture)


@functools.cache
def pixels() -> tuple[np.ndarray, np.ndarray]:
    """x and y (H, W) of pixel centres, in widths of the image, from its middle."""
    y, x = (np.mgrid[:IMAGE_SIZE, :IMAGE_SIZE] + 0.5) / IMAGE_SIZE - 0.5
    return x.astype(np.float32), y.astype(np.float32)


def draw_sheet(rng: np.random.Generator) -> np.ndarray:
    """A flat texture or one colour: (H, W, 3)."""
    if rng.random() < 0.3:
        return np.broadcast_to(any_colour(rng), (IMAGE_SIZE, IMAGE_SIZE, 3))
    image = stock_texture(int(rng.integers(TEXTURES)))
    x, y = pixels()
    angle, scale = rng.uniform(0, 6.28), np.exp(rng.uniform(np.log(0.4), np.log(4)))
    u, v = math.cos(angle) * x - math.sin(angle) * y, math.sin(angle) * x + math.cos(angle) * y
    side = len(image)
    return image[(v * scale * side).astype(int) % side, (u * scale * side).astype(int) % side]


def draw_slope(rng: np.random.Generator) -> np.ndarray:
    """Uneven light: (H, W, 1)."""
    x, y = pixels()
    slope = rng.normal(0, 0.5, 2)
    return np.clip(rng.uniform(0.4, 1.3) * (1 + slope[0] * x + slope[1] * y), 0.05, 1.6)[..., None]


def defocus(picture: np.ndarray, blur: float) -> np.ndarray:
    """Out of focus by `blur` pixels."""
    if blur < 0.3:
        return picture
    size = 2 * int(blur) + 1
    filtered = ndimage.uniform_filter(picture, (size, size, 0), mode="nearest")
    return np.asarray(ndimage.uniform_filter(filtered, (size, size, 0), mode="nearest"))


def place_of(cover: np.ndarray) -> tuple[float, float, float]:
    """Middle x, y and size of what is covered, in widths of the image, from its middle."""
    rows, columns = np.flatnonzero(cover.max(1) > 0.5), np.flatnonzero(cover.max(0) > 0.5)
    if not len(rows) or not len(columns):
        return 0.0, 0.0, 0.6
    x, y = (columns[0] + columns[-1]) / 2, (rows[0] + rows[-1]) / 2
    size = max(columns[-1] - columns[0], rows[-1] - rows[0])
    return x / IMAGE_SIZE - 0.5, y / IMAGE_SIZE - 0.5, size / IMAGE_SIZE
