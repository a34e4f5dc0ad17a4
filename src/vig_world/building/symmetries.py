"""What keeps shapes in correspondence their own mirror images, or the same under any turn."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.sparse as sp
from scipy.spatial import cKDTree

from vig_world.building.surface import Surface, points_on
from vig_world.mesh import vertex_normals

ACROSS = np.array([1.0, -1.0, 1.0])
"""Times points or normals (..., 3) it is their mirror image in y = 0."""
PLACES = 60
"""On each face, among which that of a mirrored vertex is found."""
RING = 24
"""Vertices of about one height and radius whose mean is taken."""
DIRECTION = 0.05
"""Sizes of the object that a difference of normals of one counts as."""


def mirror_map(vertices: np.ndarray, faces: np.ndarray) -> sp.csr_matrix:
    """Sparse (V, V): times vertices it gives the places on a mesh where their mirror images are.

    Of a shape x in correspondence with the mesh, `(map @ x) * ACROSS` is the mirror image, in correspondence.
    """
    normals = vertex_normals(vertices, faces)
    face, weights = points_on(vertices, faces, PLACES * len(faces))
    corners = faces[face]
    spread = Surface(*(np.einsum("nk,nkd->nd", weights, each[corners]) for each in (vertices, normals)))
    scale = DIRECTION * float(np.ptp(vertices, axis=0).max())
    image = Surface(vertices * ACROSS, normals * ACROSS)
    _, index = cKDTree(spread.features(scale)).query(image.features(scale))
    rows = np.repeat(np.arange(len(vertices)), 3)
    return sp.csr_matrix((weights[index].ravel(), (rows, corners[index].ravel())), (len(vertices),) * 2)


def image_map(vertices: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """What takes of deformations (M, V, 3) of a template (V, 3) the part that is like its mirror image."""
    image = cKDTree(vertices).query(vertices * ACROSS)[1]
    return lambda field: (field + field[:, image] * ACROSS) / 2


def round_map(vertices: np.ndarray, faces: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """What makes fields (..., V, 3) on a template (V, 3) about +Z alike under any turn.

    Each vertex gets the mean of those on the same ring, seen along the radius and the axis: a linear map of
    shapes and of deformations.
    """
    away = vertices[:, :2] / np.maximum(np.linalg.norm(vertices[:, :2], axis=1, keepdims=True), 1e-12)
    normals = vertex_normals(vertices, faces)

    def along(field: np.ndarray) -> np.ndarray:
        return np.stack([(field[..., :2] * away).sum(-1), field[..., 2]], axis=-1)

    size = float(np.ptp(vertices, axis=0).max())
    rings = np.concatenate([along(vertices), DIRECTION * size * along(normals)], axis=1)
    index = cKDTree(rings).query(rings, RING)[1]

    def made_round(field: np.ndarray) -> np.ndarray:
        mean = along(field)[..., index, :].mean(-2)
        return np.concatenate([mean[..., :1] * away, mean[..., 1:]], axis=-1)

    return made_round
