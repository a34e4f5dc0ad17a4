"""Crude shadows on the surface that things stand on, for the raster tier."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter

from vig.render import rasterize
from vig.scene import Camera
from vig.synthesis.build import Instance

HALF_WIDTH = 0.9
"""Metres from the object to the end of the shadow map."""
SIZE = 144
BELOW = 50.0
"""The map is taken from this far below, which makes it all but orthographic."""
REACH = 0.05
"""Height in metres over which contact darkening fades."""


def ground_shade(solids: list[Instance], ground: np.ndarray, light: np.ndarray) -> np.ndarray:
    """Factors (N,) in [0, 1] for the light that reaches ground points (N, 2), metres in the plane z = 0.

    Ambient darkening below low parts, and one soft shadow cast from the direction of the light's first
    degree, the deeper the more directional the light (9,).
    """
    vertices = np.concatenate([solid.mesh.vertices for solid in solids])
    starts = np.cumsum([0] + [len(solid.mesh.vertices) for solid in solids])
    faces = np.concatenate([solid.mesh.faces + start for solid, start in zip(solids, starts, strict=False)])
    height = np.maximum(_from_below(vertices, faces), 0.0)
    ambient = gaussian_filter(np.exp(-height / REACH), 2.0, mode="constant")
    direction = light[[3, 1, 2]]
    directional = np.clip(np.linalg.norm(direction) / light[0] - 0.2, 0, 1)
    strength = directional * np.clip(direction[2] / light[0] * 4, 0, 1)
    shade = 1 - 0.5 * ambient
    if strength > 0:
        slope = direction[:2] / max(direction[2], 0.4 * float(np.linalg.norm(direction)))
        sheared = vertices.copy()
        sheared[:, :2] -= vertices[:, 2:] * slope
        covered = np.isfinite(_from_below(sheared, faces)).astype(np.float64)
        cast = gaussian_filter(covered, 1.5, mode="constant")
        shade *= 1 - 0.6 * strength * cast
    cell = (ground / HALF_WIDTH + 1) * SIZE / 2 - 0.5
    low = np.clip(np.floor(cell), 0, SIZE - 2).astype(np.int64)
    fx, fy = np.clip(cell - low, 0, 1).T
    x, y = low.T
    upper = shade[y, x] * (1 - fx) + shade[y, x + 1] * fx
    lower = shade[y + 1, x] * (1 - fx) + shade[y + 1, x + 1] * fx
    return upper * (1 - fy) + lower * fy


def _from_below(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Height (SIZE, SIZE) of the lowest surface above each cell of the ground, rows along +y; inf = none."""
    camera = Camera(SIZE, SIZE, SIZE / 2 / HALF_WIDTH * BELOW, SIZE / 2, SIZE / 2)
    up = rasterize(vertices, faces, np.eye(3), np.array([0.0, 0.0, BELOW]), camera, cull=True)
    return up.depth - BELOW
