"""Edges and normals of triangle meshes in arrays."""

import numpy as np


def weld_vertices(vertices: np.ndarray) -> np.ndarray:
    """Return the first vertex at the place of each vertex: (V,)."""
    _, first, inverse = np.unique(vertices, axis=0, return_index=True, return_inverse=True)
    return first[inverse.reshape(-1)].astype(np.int32)


def edges_of(faces: np.ndarray) -> np.ndarray:
    """Return the rows of `Topology.edges`, in the order of their vertices."""
    whole = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    which = np.flatnonzero(whole).astype(np.int32)
    sides = np.concatenate([faces[which][:, [i, (i + 1) % 3, (i + 2) % 3]] for i in range(3)])
    face = np.concatenate([which] * 3)
    low, high = sides[:, :2].min(axis=1), sides[:, :2].max(axis=1)
    order = np.lexsort((face, high, low))
    low, high, apex, face = low[order], high[order], sides[order, 2], face[order]
    starts = np.flatnonzero(np.r_[True, (low[1:] != low[:-1]) | (high[1:] != high[:-1])][: len(low)])
    counts = np.diff(np.r_[starts, len(low)])
    paired = starts[counts == 2]
    pairs = [low[paired], high[paired], apex[paired], apex[paired + 1], face[paired], face[paired + 1]]
    single = np.flatnonzero(np.repeat(counts != 2, counts))
    nothing = np.full(len(single), -1, np.int32)
    borders = [low[single], high[single], apex[single], nothing, face[single], nothing]
    return np.concatenate([np.stack(pairs, axis=1), np.stack(borders, axis=1)]).astype(np.int32)


def smooth_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return unit vertex normals, the mean of adjacent faces' weighted by area: (V, 3) and (F, 3) to (V, 3).

    A vertex without area gets the zero vector. `vig_renderer.shading` has the same for tensors.
    """
    a, b, c = (vertices[corner] for corner in faces.T)
    weighted = np.repeat(np.cross(b - a, c - a), 3, axis=0)
    total, index = np.empty_like(vertices), faces.ravel()
    for axis in range(3):
        total[:, axis] = np.bincount(index, weighted[:, axis], len(vertices))
    size = np.abs(total).max(1, keepdims=True)
    scaled = np.where(size > 1e-15, total / np.where(size > 1e-15, size, 1), 0)
    length = np.sqrt(np.square(scaled).sum(1, keepdims=True))
    normals: np.ndarray = (scaled / np.where(length > 0, length, 1)).astype(vertices.dtype)
    return normals
