"""Polygons in space as triangles."""

from collections.abc import Sequence

import numpy as np


def owners(polygons: Sequence[np.ndarray], places: np.ndarray) -> np.ndarray:
    """Return which polygon (F,) each triangle is of, from the places that `triangles_of` gives."""
    ends = np.cumsum([len(polygon) for polygon in polygons])
    return np.searchsorted(ends, places[:, 0], side="right")


def triangulate(vertices: np.ndarray, polygons: Sequence[np.ndarray]) -> np.ndarray:
    """Return triangles (F, 3) of polygons, each a row of indices of vertices (V, 3), corners in order.

    A convex polygon becomes a fan; one whose fan would turn over somewhere is cut into ears.
    """
    corners, _ = triangles_of(vertices, polygons)
    return corners


def triangles_of(vertices: np.ndarray, polygons: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Triangulate like `triangulate`; also return where (F, 3) corners lie among all polygons' corners."""
    lengths = np.array([len(polygon) for polygon in polygons], np.int64)
    starts = np.concatenate([[0], np.cumsum(lengths)])
    flat = np.concatenate([lengths[:0], *(np.asarray(polygon, np.int64) for polygon in polygons)])
    if len(flat) and (flat.min() < 0 or flat.max() >= len(vertices)):
        raise ValueError(f"faces between {flat.min()} and {flat.max()} of {len(vertices)} vertices")
    places: list[np.ndarray] = []
    for size in np.unique(lengths[lengths >= 3]).tolist():
        rows = starts[:-1][lengths == size][:, None] + np.arange(size)  # (n, size)
        fans = np.stack([rows[:, [0] * (size - 2)], rows[:, 1:-1], rows[:, 2:]], axis=2)
        if size == 3:
            places.append(fans.reshape(-1, 3))
            continue
        points = vertices[flat[rows]]
        normals = np.cross(points, np.roll(points, -1, 1)).sum(1)  # Newell's, twice the area
        a, b, c = (vertices[flat[fans[..., corner]]] for corner in range(3))
        turned = (np.cross(b - a, c - a) * normals[:, None]).sum(2) < 0
        concave = turned.any(1)
        places.append(fans[~concave].reshape(-1, 3))
        for row, outline, normal in zip(rows[concave], points[concave], normals[concave], strict=True):
            places.append(row[_ears(outline, normal)])
    triangles = np.concatenate(places) if places else np.zeros((0, 3), np.int64)
    triangles = triangles[np.argsort(triangles[:, 0], kind="stable")]
    return flat[triangles], triangles


def _ears(outline: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Return triangles (n - 2, 3) of a concave polygon (n, 3), as corners of it, turning as it does."""
    import mapbox_earcut

    axis = int(np.abs(normal).argmax())
    flat = np.delete(outline, axis, axis=1).astype(np.float64)
    ears = mapbox_earcut.triangulate_float64(flat, np.array([len(flat)], np.uint32)).reshape(-1, 3)
    a, b, c = (outline[ears[:, corner]] for corner in range(3))
    backwards = (np.cross(b - a, c - a) @ normal) < 0
    ears[backwards] = ears[backwards, ::-1]
    return ears.astype(np.int64)
