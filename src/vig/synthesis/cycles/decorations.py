"""A painted decoration for the object."""

from __future__ import annotations

import numpy as np

from vig.synthesis.textures import colour


def decoration(rng: np.random.Generator, size: int = 128) -> np.ndarray:
    """Rings round the axis and a row of dots between them.

    Returns (size, 2 size, 4) float32: linear RGB and coverage in [0, 1], not multiplied with each other; u
    runs round the axis, where it is periodic; row 0 is the upper edge (v = 1).
    """
    v = (size - 0.5 - np.arange(size)[:, None]) / size
    u = (np.arange(2 * size) + 0.5) / (2 * size)
    layer = np.zeros((size, 2 * size, 4), np.float32)
    layer[..., :3] = colour(rng)
    for _ in range(rng.integers(1, 4)):
        edge = rng.uniform(0.01, 0.05) - np.abs(v - rng.uniform(0.1, 0.9))
        layer[..., 3:] = np.maximum(layer[..., 3:], np.clip(edge * size + 0.5, 0, 1)[..., None])
    count, middle, radius = rng.integers(6, 20), rng.uniform(0.3, 0.7), rng.uniform(0.02, 0.08)
    aside = ((u * count) % 1 - 0.5) * 2 * 2 / count  # the pot is about twice as far round as high
    dots = np.clip((radius - np.hypot(aside, v - middle)) * size + 0.5, 0, 1)
    layer[..., 3] = np.maximum(layer[..., 3], dots)
    return layer
