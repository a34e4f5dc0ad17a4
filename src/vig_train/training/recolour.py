"""Images of datasets with the object in other colours: so that hue does not identify the object."""

import numpy as np

from vig.scene import linear_from_srgb, srgb_from_linear
from vig_world.assets.coats import any_colour, draw_paint_layer


def recolour(
    image: np.ndarray, visible: np.ndarray, albedo: np.ndarray, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Give the object of an image another surface; all else in the image stays.

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
    shade = radiance / np.maximum(albedo, 0.02)  # finite for black objects
    rows, columns = np.nonzero(visible)
    new_albedo = np.broadcast_to(any_colour(rng), (len(rows), 3)).copy()
    for _ in range(int(rng.choice([0, 1, 2], p=[0.5, 0.35, 0.15]))):
        angle = rng.choice([0.0, np.pi / 2, rng.uniform(0, np.pi)])
        x, y = columns / image.shape[1], rows / len(image)
        u, v = np.cos(angle) * x + np.sin(angle) * y, np.cos(angle) * y - np.sin(angle) * x
        paint, cover = draw_paint_layer(rng, u, v, np.stack([u, v, np.zeros_like(u)], 1), 1.0)
        new_albedo += (paint.T - new_albedo) * cover[:, None]
    colour = new_albedo * shade
    if rng.random() < 0.4:  # a few highlights, where it is bright
        level = shade.mean(1)
        bright = np.clip((level - np.quantile(level, rng.uniform(0.9, 0.99))) / (level.std() + 1e-3), 0, 1)
        colour = colour + rng.uniform(0.1, 0.8) * bright[:, None]
    painted = image.copy()
    painted[visible] = (srgb_from_linear(np.clip(colour, 0, 1)) * 255).round().astype(np.uint8)
    return painted, new_albedo.mean(0).astype(np.float32)
