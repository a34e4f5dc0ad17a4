"""Images of datasets with the object in other colours: so that hue says nothing of what is the object."""

from __future__ import annotations

import numpy as np

from vig.scene import linear_from_srgb, srgb_from_linear
from vig_world.assets.coats import TEXTURES, any_colour, stock_texture

MIN_ALBEDO = 0.02
"""Least albedo by which radiance is divided, so that the shading of black objects stays finite."""


def recolour(
    image: np.ndarray, visible: np.ndarray, albedo: np.ndarray, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Give the object of an image another surface; what else is in the image stays.

    Args:
        image: (H, W, 3) uint8 sRGB.
        visible: (H, W) bool, where the object is seen.
        albedo: (3,) linear RGB of the object as it is.
        rng: Source of all randomness.

    Returns:
        The image, and the mean albedo (3,) float32 of the new surface.
    """
    if not visible.any():
        return image, albedo.astype(np.float32)
    radiance = linear_from_srgb(image[visible].astype(np.float32) / 255)
    shade = radiance / np.maximum(albedo, MIN_ALBEDO)
    rows, columns = np.nonzero(visible)
    new_albedo = np.broadcast_to(any_colour(rng), (len(rows), 3)).copy()
    for _ in range(int(rng.choice([0, 1, 2], p=[0.5, 0.35, 0.15]))):
        _paint_pattern(new_albedo, rows / len(image), columns / image.shape[1], rng)
    colour = new_albedo * shade
    if rng.random() < 0.4:  # a few highlights, where it is bright
        level = shade.mean(1)
        bright = np.clip((level - np.quantile(level, rng.uniform(0.9, 0.99))) / (level.std() + 1e-3), 0, 1)
        colour = colour + rng.uniform(0.1, 0.8) * bright[:, None]
    painted = image.copy()
    painted[visible] = (srgb_from_linear(np.clip(colour, 0, 1)) * 255).round().astype(np.uint8)
    return painted, new_albedo.mean(0).astype(np.float32)


def _paint_pattern(
    albedos: np.ndarray, rows: np.ndarray, columns: np.ndarray, rng: np.random.Generator
) -> None:
    """Paint over albedos (N, 3) at places (N,) of the picture, in its sizes."""
    kind, count = int(rng.integers(4)), rng.uniform(3, 20)
    angle = rng.choice([0.0, np.pi / 2, rng.uniform(0, np.pi)])
    u, v = (np.cos(angle) * x + np.sin(angle) * y for x, y in ((columns, rows), (rows, -columns)))
    if kind == 0:  # blotches
        waves = rng.normal(size=(5, 2)) * rng.uniform(5, 40)
        value = np.sin(np.stack([u, v], 1) @ waves.T + rng.uniform(0, 6.28, 5)).sum(1)
        chosen = value > rng.uniform(-0.5, 2)
    elif kind == 1:  # bands and checks
        chosen = np.sin(6.28 * count * v) * (np.sin(6.28 * count * u) if rng.random() < 0.5 else 1) > 0.1
    elif kind == 2:  # dots
        chosen = (u * count % 1 - 0.5) ** 2 + (v * count % 1 - 0.5) ** 2 < rng.uniform(0.15, 0.45) ** 2
    else:
        chosen = np.ones(len(albedos), bool)
    if kind == 3 or rng.random() < 0.3:
        image = stock_texture(int(rng.integers(TEXTURES)))
        scale = rng.uniform(0.5, 4) * len(image)
        colour = image[(v * scale).astype(int) % len(image), (u * scale).astype(int) % len(image)]
        albedos[chosen] = colour[chosen]
    else:
        albedos[chosen] = any_colour(rng)
