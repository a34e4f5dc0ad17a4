"""What a camera, its software and a web site make of a picture."""

from __future__ import annotations

import io
import math

import numpy as np
from PIL import Image
from scipy import ndimage

from vig.scene import IMAGE_SIZE, srgb_from_linear
from vig_train.training.layers import pixels


def photograph(rng: np.random.Generator, picture: np.ndarray) -> np.ndarray:
    """What a camera, its software and a web site make of linear light: (H, W, 3) uint8 sRGB."""
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
    """An image (H, W, 3) whose sides repeat the row or column where the photo ended, outside the object.

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
