"""What keeps shapes in correspondence their own mirror images, or the same under any turn."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import scipy.sparse as sp
from scipy.spatial import cKDTree

from vig_train.building.surface import Surface, points_on
from vig_world.mesh import vertex_normals
from vig_world.rotations import about_z

ACROSS = np.array([1.0, -1.0, 1.0])
"""Times points or normals (..., 3) it is their mirror image in y = 0."""
PLACES = 60
"""On each face, among which that of a mirrored vertex is found."""
TURNS = 36
"""Of a whole, whose mean is taken."""
DIRECTION = 0.05
"""Sizes of the object that a difference of normals of one counts as."""


class Places:
    """Where on a template (V, 3), (F, 3) moved vertices come to lie."""

    def __init__(self, vertices: np.ndarray, faces: np.ndarray):
        self.vertices, self.normals = vertices, vertex_normals(vertices, faces)
        face, self.weights = points_on(vertices, faces, PLACES * len(faces))
        self.corners = faces[face]
        both = (
            np.einsum("nk,nkd->nd", self.weights, each[self.corners]) for each in (vertices, self.normals)
        )
        self.scale = DIRECTION * float(np.ptp(vertices, axis=0).max())
        self.tree = cKDTree(Surface(*both).features(self.scale))

    def of(self, linear: np.ndarray) -> sp.csr_matrix:
        """Sparse (V, V) that takes what vertices have to where an orthogonal map (3, 3) takes them."""
        moved = Surface(self.vertices @ linear.T, self.normals @ linear.T)
        index, count = self.tree.query(moved.features(self.scale))[1], len(self.vertices)
        rows = np.repeat(np.arange(count), 3)
        entries = (self.weights[index].ravel(), (rows, self.corners[index].ravel()))
        return sp.csr_matrix(entries, (count, count))


def mirror_map(vertices: np.ndarray, faces: np.ndarray) -> sp.csr_matrix:
    """Sparse (V, V): times vertices it gives the places on a mesh where their mirror images are.

    Of a shape x in correspondence with the mesh, `(map @ x) * ACROSS` is the mirror image, in correspondence.
    """
    return Places(vertices, faces).of(np.diag(ACROSS))


def image_map(vertices: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """What takes of deformations (M, V, 3) of a template (V, 3) the part that is like its mirror image."""
    image = cKDTree(vertices).query(vertices * ACROSS)[1]
    return lambda field: (field + field[:, image] * ACROSS) / 2


def round_map(vertices: np.ndarray, faces: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """What makes fields (..., V, 3) on a template (V, 3) about +Z alike under any turn.

    Each vertex gets the mean of where turns take it, seen along the radius and the axis: a linear map of
    shapes and of deformations.
    """
    away = vertices[:, :2] / np.maximum(np.linalg.norm(vertices[:, :2], axis=1, keepdims=True), 1e-12)
    places = Places(vertices, faces)
    mean = sum(places.of(about_z(2 * math.pi * turn / TURNS)) for turn in range(TURNS)) / TURNS

    def made_round(field: np.ndarray) -> np.ndarray:
        along = np.stack([(field[..., :2] * away).sum(-1), field[..., 2]], axis=-1)
        flat = np.moveaxis(along, -2, 0).reshape(len(vertices), -1)
        along = np.moveaxis((mean @ flat).reshape(len(vertices), *field.shape[:-2], 2), 0, -2)
        return np.concatenate([along[..., :1] * away, along[..., 1:]], axis=-1)

    return made_round
