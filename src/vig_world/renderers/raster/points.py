"""Points that stand for a surface where shadows are concerned."""

from __future__ import annotations

import numpy as np


def strewn(vertices: np.ndarray, faces: np.ndarray, area: float) -> np.ndarray:
    """Points (N, 4) float32 spread over a mesh, one or more a face: places, and areas they stand for."""
    a, b, c = (vertices[faces[:, i]].astype(np.float64) for i in range(3))
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    counts = np.maximum(1, np.ceil(areas / area)).astype(int)
    chosen = np.repeat(np.arange(len(faces)), counts)
    number = np.arange(len(chosen)) - np.repeat(np.cumsum(counts) - counts, counts)
    # A plane sequence of low discrepancy (multiples of the plastic number's powers), folded to a triangle.
    u, v = ((0.5 + number[:, None] * [0.7548776662466927, 0.5698402909980532]) % 1).T
    over = u + v > 1
    u, v = np.where(over, 1 - u, u)[:, None], np.where(over, 1 - v, v)[:, None]
    single = (counts == 1)[chosen, None]
    u, v = np.where(single, 1 / 3, u), np.where(single, 1 / 3, v)
    places = a[chosen] + u * (b - a)[chosen] + v * (c - a)[chosen]
    return np.hstack([places, (areas / counts)[chosen, None]]).astype(np.float32)
