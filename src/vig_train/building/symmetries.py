"""Projections of shapes in correspondence onto those with a mirror plane, or the same under any turn."""

import math
from collections.abc import Callable

import numpy as np
import scipy.sparse as sp
from scipy.spatial import cKDTree

from vig_train.building.surface import SurfaceSample, sample_surface
from vig_world.mesh import vertex_normals
from vig_world.rotations import about_z

MIRROR_Y = np.array([1.0, -1.0, 1.0])  # factor on points or normals (..., 3) that mirrors them in y = 0
TURN_COUNT = 36  # turns of 10 degrees, over which a shape is averaged


class SurfaceLookup:
    """Finds where on a template (V, 3), (F, 3) its vertices come to lie under an orthogonal map."""

    def __init__(self, vertices: np.ndarray, faces: np.ndarray):
        self.vertices, self.normals = vertices, vertex_normals(vertices, faces)
        # The place of a moved vertex is searched among 60 samples of each face.
        face, self.weights = sample_surface(vertices, faces, 60 * len(faces))
        self.corners = faces[face]
        sampled = (
            np.einsum("nk,nkd->nd", self.weights, values[self.corners]) for values in (vertices, self.normals)
        )
        # A difference of normals of length one counts as .05 sizes of the object.
        self.scale = 0.05 * float(np.ptp(vertices, axis=0).max())
        self.tree = cKDTree(SurfaceSample(*sampled).features(self.scale))

    def resampling(self, linear: np.ndarray) -> sp.csr_matrix:
        """Return sparse (V, V); times a vertex attribute it is that attribute at the images of the vertices
        under an orthogonal map (3, 3).
        """
        moved = SurfaceSample(self.vertices @ linear.T, self.normals @ linear.T)
        index, count = self.tree.query(moved.features(self.scale))[1], len(self.vertices)
        rows = np.repeat(np.arange(count), 3)
        entries = (self.weights[index].ravel(), (rows, self.corners[index].ravel()))
        return sp.csr_matrix(entries, (count, count))


def mirror_map(vertices: np.ndarray, faces: np.ndarray) -> sp.csr_matrix:
    """Return sparse (V, V); times vertices it gives the points of the mesh where their mirror images are.

    For a shape x in correspondence with the mesh, `(map @ x) * ACROSS` is its mirror image.
    """
    return SurfaceLookup(vertices, faces).resampling(np.diag(MIRROR_Y))


def mirror_projection(vertices: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """Return the projection of deformations (M, V, 3) of a template (V, 3) onto mirror-symmetric ones."""
    image = cKDTree(vertices).query(vertices * MIRROR_Y)[1]
    return lambda field: (field + field[:, image] * MIRROR_Y) / 2


def rotation_projection(vertices: np.ndarray, faces: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """Return the projection of fields (..., V, 3) on a template (V, 3) onto those that turns about +Z keep.

    The radial and the axial component are averaged over `TURN_COUNT` turns: a linear map of shapes and of
    deformations.
    """
    radial = vertices[:, :2] / np.maximum(np.linalg.norm(vertices[:, :2], axis=1, keepdims=True), 1e-12)
    lookup = SurfaceLookup(vertices, faces)
    mean = (
        sum(lookup.resampling(about_z(2 * math.pi * turn / TURN_COUNT)) for turn in range(TURN_COUNT))
        / TURN_COUNT
    )

    def made_round(field: np.ndarray) -> np.ndarray:
        along = np.stack([(field[..., :2] * radial).sum(-1), field[..., 2]], axis=-1)
        flat = np.moveaxis(along, -2, 0).reshape(len(vertices), -1)
        along = np.moveaxis((mean @ flat).reshape(len(vertices), *field.shape[:-2], 2), 0, -2)
        return np.concatenate([along[..., :1] * radial, along[..., 1:]], axis=-1)

    return made_round
