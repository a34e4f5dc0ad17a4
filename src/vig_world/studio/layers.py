"""Parts of drawn pictures: layers, flat textures, light, mirrored surroundings, and the camera."""

from __future__ import annotations

import functools
import io
import math
from dataclasses import dataclass

import numpy as np
from PIL import Image
from scipy import ndimage

from vig.scene import IMAGE_SIZE, srgb_from_linear
from vig_world.assets.coats import TEXTURES, any_colour, stock_texture


@dataclass(frozen=True)
class Layer:
    """Something drawn: linear RGB (H, W, 3), not multiplied with its coverage (H, W)."""

    colour: np.ndarray
    cover: np.ndarray

    def over(self, picture: np.ndarray) -> np.ndarray:
        """Return a picture (H, W, 3) with the layer before it."""
        return picture + self.cover[..., None] * (self.colour - picture)


@functools.cache
def pixels() -> tuple[np.ndarray, np.ndarray]:
    """Return x and y (H, W) of pixel centres, in widths of the image, from its middle."""
    y, x = (np.mgrid[:IMAGE_SIZE, :IMAGE_SIZE] + 0.5) / IMAGE_SIZE - 0.5
    return x.astype(np.float32), y.astype(np.float32)


def draw_sheet(rng: np.random.Generator) -> np.ndarray:
    """Draw a flat texture or one colour: (H, W, 3)."""
    if rng.random() < 0.3:
        return np.broadcast_to(any_colour(rng), (IMAGE_SIZE, IMAGE_SIZE, 3))
    image = stock_texture(int(rng.integers(TEXTURES)))
    x, y = pixels()
    angle, scale = rng.uniform(0, 6.28), np.exp(rng.uniform(np.log(0.4), np.log(4)))
    u, v = math.cos(angle) * x - math.sin(angle) * y, math.sin(angle) * x + math.cos(angle) * y
    side = len(image)
    return image[(v * scale * side).astype(int) % side, (u * scale * side).astype(int) % side]


def draw_slope(rng: np.random.Generator) -> np.ndarray:
    """Draw uneven light: (H, W, 1)."""
    x, y = pixels()
    slope = rng.normal(0, 0.5, 2)
    return np.clip(rng.uniform(0.4, 1.3) * (1 + slope[0] * x + slope[1] * y), 0.05, 1.6)[..., None]


def defocus(picture: np.ndarray, blur: float) -> np.ndarray:
    """Return a picture out of focus by `blur` pixels."""
    if blur < 0.3:
        return picture
    size = 2 * int(blur) + 1
    filtered = ndimage.uniform_filter(picture, (size, size, 0), mode="nearest")
    return np.asarray(ndimage.uniform_filter(filtered, (size, size, 0), mode="nearest"))


def place_of(cover: np.ndarray) -> tuple[float, float, float]:
    """Return middle x, y and size of the covered pixels, in widths of the image, from its middle."""
    rows, columns = np.flatnonzero(cover.max(1) > 0.5), np.flatnonzero(cover.max(0) > 0.5)
    if not len(rows) or not len(columns):
        return 0.0, 0.0, 0.6
    x, y = (columns[0] + columns[-1]) / 2, (rows[0] + rows[-1]) / 2
    size = max(columns[-1] - columns[0], rows[-1] - rows[0])
    return x / IMAGE_SIZE - 0.5, y / IMAGE_SIZE - 0.5, size / IMAGE_SIZE


@dataclass(frozen=True)
class Environment:
    """Surroundings that a glossy thing mirrors: a gradient from ground to sky, lamps and windows.

    Attributes:
        ground: (3,) radiance below.
        sky: (3,) above.
        directions: (L, 3) unit, towards the lamps.
        sharpness: (L,) sharpness of each lamp's lobe.
        radiance: (L, 3).
    """

    ground: np.ndarray
    sky: np.ndarray
    directions: np.ndarray
    sharpness: np.ndarray
    radiance: np.ndarray

    @staticmethod
    def draw(rng: np.random.Generator) -> Environment:
        """Draw an indoor environment."""
        count = int(rng.integers(1, 5))
        directions = rng.normal(size=(count, 3))
        directions[:, 2] = np.abs(directions[:, 2]) + 0.2
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        tint = rng.uniform(0.85, 1.0, (count, 3))
        strength = np.exp(rng.uniform(np.log(2), np.log(25), (count, 1)))
        return Environment(
            rng.uniform(0.05, 0.7) * rng.uniform(0.7, 1, 3),
            rng.uniform(0.2, 1.1) * rng.uniform(0.85, 1, 3),
            directions,
            np.exp(rng.uniform(np.log(10), np.log(800), count)),
            strength * tint,
        )

    def radiance_from(self, directions: np.ndarray, roughness: float) -> np.ndarray:
        """Return radiance (N, 3) from unit directions (N, 3), blurred by the roughness of the mirror."""
        up = np.clip(0.5 + directions[:, 2:] / (0.1 + 2 * roughness), 0, 1)
        total = self.ground + (self.sky - self.ground) * up
        for towards, sharpness, radiance in zip(self.directions, self.sharpness, self.radiance, strict=True):
            wide = 1 / (1 / sharpness + roughness**2)
            lobe = np.exp(wide * (directions @ towards - 1)) * min(1.0, wide / sharpness)
            total = total + lobe[:, None] * radiance
        return total


def photograph(rng: np.random.Generator, picture: np.ndarray) -> np.ndarray:
    """Return linear light as processed by a camera, its software and a web site: (H, W, 3) uint8 sRGB."""
    gain = math.exp(rng.normal(0, 0.2)) * np.exp(rng.normal(0, 0.04, 3))
    x, y = pixels()
    vignetting = 1 - rng.uniform(0, 0.35) * (rng.random() < 0.3) * 2 * (x**2 + y**2)
    picture = picture * (gain * vignetting[..., None])
    if rng.random() < 0.6:
        picture = ndimage.gaussian_filter(picture, (*[float(rng.uniform(0.3, 1.0))] * 2, 0), truncate=2.5)
    display = srgb_from_linear(np.clip(picture, 0, 1)).astype(np.float32)
    if rng.random() < 0.3:  # contrast
        display = np.clip(0.5 + (display - 0.5) * rng.uniform(0.75, 1.4) + rng.normal(0, 0.05), 0, 1)
    if rng.random() < 0.25:  # sharpening
        blurred = ndimage.uniform_filter(display, (3, 3, 0))
        display = np.clip(display + rng.uniform(0.3, 1.2) * (display - blurred), 0, 1)
    display = display + rng.normal(0, 1, display.shape).astype(np.float32) * rng.uniform(0, 0.025)
    if rng.random() < 0.03:
        display = np.broadcast_to(display.mean(2, keepdims=True), display.shape)
    image = Image.fromarray((np.clip(display, 0, 1) * 255).round().astype(np.uint8))
    if rng.random() < 0.2:  # few pixels
        side = int(rng.integers(60, IMAGE_SIZE))
        image = image.resize((side, side), Image.Resampling.BOX).resize(
            (IMAGE_SIZE,) * 2, Image.Resampling.BICUBIC
        )
    if rng.random() < 0.7:
        file = io.BytesIO()
        image.save(file, "JPEG", quality=int(rng.integers(35, 96)))
        image = Image.open(file)
    return np.asarray(image)


def continue_border(rng: np.random.Generator, image: np.ndarray, cover: np.ndarray) -> np.ndarray:
    """Return an image (H, W, 3) whose sides repeat the last row or column of its photo, off the object.

    cover: (H, W) bool, where the object is.
    """
    image = image.copy()
    for _ in range(int(rng.integers(1, 3))):
        turn = int(rng.integers(4))
        rotated, rows = np.rot90(image, turn), np.rot90(cover, turn).any(1)
        max_end = int(rows.argmax()) if rows.any() else IMAGE_SIZE // 3
        end = int(rng.integers(max_end + 1))
        rotated[:end] = rotated[end : end + 1]
    return image
