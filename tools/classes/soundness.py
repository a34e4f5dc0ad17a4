"""Checks that designs of any kind share: surfaces that cross, and sizes out of their limits."""

from collections.abc import Iterable

import numpy as np
from scipy.spatial import cKDTree

_INSIDE = 1e-6
"""Shares of an edge and of a face by which a crossing must be within them."""


def crossings(vertices: np.ndarray, faces: np.ndarray) -> int:
    """Count the pairs of an edge and a face without a common vertex that cross, of a mesh (V, 3), (F, 3)."""
    vertices = np.asarray(vertices, np.float64)
    edges = np.unique(np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1), axis=0)
    corners = vertices[faces]
    middles, centres = vertices[edges].mean(1), corners.mean(1)
    halves = 0.5 * np.linalg.norm(vertices[edges[:, 1]] - vertices[edges[:, 0]], axis=1)
    reaches = np.linalg.norm(corners - centres[:, None], axis=2).max(1)
    edge, face = _near(middles, halves, centres, reaches)
    apart = ~(edges[edge][:, :, None] == faces[face][:, None, :]).any((1, 2))
    edge, face = edge[apart], face[apart]
    start, way = vertices[edges[edge, 0]], vertices[edges[edge, 1]] - vertices[edges[edge, 0]]
    a, b, c = (corners[face, k] for k in range(3))
    # Moller and Trumbore, 1997: where the edge's line meets the face's plane, in barycentric coordinates.
    across = np.cross(way, c - a)
    determinant = np.sum((b - a) * across, axis=1)
    level = np.abs(determinant) < 1e-18
    scale = 1.0 / np.where(level, 1.0, determinant)
    offset = start - a
    u = np.sum(offset * across, axis=1) * scale
    turned = np.cross(offset, b - a)
    v, t = np.sum(way * turned, axis=1) * scale, np.sum((c - a) * turned, axis=1) * scale
    least = np.minimum.reduce([u, v, 1.0 - u - v, t, 1.0 - t])
    return int(((least > _INSIDE) & ~level).sum())


def _near(
    middles: np.ndarray, halves: np.ndarray, centres: np.ndarray, reaches: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return numbers (N,), (N,) of edges and faces whose balls meet; large faces are looked for apart."""
    candidates = []
    limit = np.quantile(reaches, 0.9)
    for chosen in (np.flatnonzero(reaches <= limit), np.flatnonzero(reaches > limit)):
        if len(chosen) == 0:
            continue
        tree = cKDTree(centres[chosen])
        lists = tree.query_ball_point(middles, halves + reaches[chosen].max())
        edge = np.repeat(np.arange(len(lists)), [len(each) for each in lists])
        face = chosen[np.concatenate([np.array(each, int) for each in lists])] if len(edge) else edge
        close = np.linalg.norm(middles[edge] - centres[face], axis=1) <= halves[edge] + reaches[face]
        candidates.append((edge[close], face[close]))
    return np.concatenate([each[0] for each in candidates]), np.concatenate([each[1] for each in candidates])


def size_flaws(sizes: Iterable[tuple[str, float, tuple[float, float]]]) -> list[str]:
    """Return a sentence on each size, metres, that is not within its limits; sizes: word, size, limits."""
    return [
        f"it is {1000 * size:.0f} mm {word}, not {1000 * least:.0f} to {1000 * most:.0f}"
        for word, size, (least, most) in sizes
        if not least <= size <= most
    ]
