"""Texture look-up: bilinear within a level of detail, for the raster tier."""

from __future__ import annotations

import numpy as np

from vig.scene import Mesh


def texels_per_metre(mesh: Mesh, texture: np.ndarray) -> float:
    """How many texels of the texture one metre of the mesh carries, in the mean over its area."""
    assert mesh.uv is not None
    faces = mesh.faces[:: max(1, len(mesh.faces) // 200)]
    a, b, c = (mesh.vertices[faces[:, i]] for i in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()
    (u1, v1), (u2, v2) = ((mesh.uv[faces[:, i]] - mesh.uv[faces[:, 0]]).T for i in (1, 2))
    uv_area = np.abs(u1 * v2 - u2 * v1).sum()
    texels = uv_area * texture.shape[0] * texture.shape[1]
    return float(np.sqrt(texels / area)) if area > 0 else 0.0


def sample_texture(texture: np.ndarray, uv: np.ndarray, texels: np.ndarray) -> np.ndarray:
    """Colours (N, 3) at uv (N, 2), repeated outside [0, 1]; v = 1 is row 0's upper edge.

    texels: (N,) texels of the full texture per pixel of the image. Each look-up uses the level, box-averaged
    by powers of two, in which that is nearest to one.
    """
    if texture.shape[0] == texture.shape[1] == 1:
        return np.broadcast_to(texture[0, 0], (len(uv), 3))
    deepest = int(np.log2(min(texture.shape[:2])))
    levels = np.clip(np.round(np.log2(np.maximum(texels, 1e-6))), 0, deepest).astype(int)
    result = np.empty((len(uv), 3), np.float32)
    for level in range(levels.max() + 1):
        chosen = levels == level
        if chosen.all():
            return _bilinear(texture, uv)
        if chosen.any():
            result[chosen] = _bilinear(texture, uv[chosen])
        height, width = texture.shape[0] // 2 * 2, texture.shape[1] // 2 * 2
        texture = texture[:height, :width].reshape(height // 2, 2, width // 2, 2, 3).mean(axis=(1, 3))
    return result


def _bilinear(texture: np.ndarray, uv: np.ndarray) -> np.ndarray:
    height, width = texture.shape[:2]
    x = uv[:, 0] * width - 0.5
    y = (1 - uv[:, 1]) * height - 0.5
    left, top = np.floor(x), np.floor(y)
    fx, fy = (x - left)[:, None], (y - top)[:, None]
    x0, y0 = left.astype(np.int32) % width, top.astype(np.int32) % height * width
    x1 = np.where(x0 + 1 == width, 0, x0 + 1)
    y1 = np.where(y0 + width == width * height, 0, y0 + width)
    flat = texture.reshape(-1, 3)
    upper = np.take(flat, y0 + x0, axis=0)
    upper += fx * (np.take(flat, y0 + x1, axis=0) - upper)
    lower = np.take(flat, y1 + x0, axis=0)
    lower += fx * (np.take(flat, y1 + x1, axis=0) - lower)
    lower -= upper
    lower *= fy
    upper += lower
    return upper
