"""Mirror images of shapes in correspondence."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.spatial import cKDTree

from vig_world.building.surface import Surface, points_on
from vig_world.mesh import vertex_normals

ACROSS = np.array([1.0, -1.0, 1.0])
"""Times points or normals (..., 3) it is their mirror image in y = 0."""
PLACES = 60
"""On each face, among which that of a mirrored vertex is found."""
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
