"""Splits the vertices of a welded mesh at creases, and lays its smooth patches flat for textures."""

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from vig_world.mesh import Mesh, face_normals

LEVEL = 0.95  # length of the mean normal of a patch, over that of a plane, above which it counts as plane


def unwrap(vertices: np.ndarray, faces: np.ndarray, uv: np.ndarray | None = None) -> Mesh:
    """Return the mesh with sharp edges where faces meet at an angle; without uv it gets some in metres.

    A plane patch is laid flat along the two axes nearest to it, v along its longest side, which is the grain
    of wood. A curved one is wound: v along its longest axis, u along the sum of the others.

    Args:
        vertices: (V, 3) metres.
        faces: (F, 3).
        uv: (V, 2) coordinates in a picture, or None.
    """
    patch = smooth_patches(vertices, faces)
    corner, index = np.unique(faces * (int(patch.max()) + 1) + patch[:, None], return_inverse=True)
    owner, of_patch = np.divmod(corner, int(patch.max()) + 1)
    points, triangles = vertices[owner], index.reshape(-1, 3)
    flat = _unroll(points, of_patch, vertices, faces, patch) if uv is None else uv[owner]
    return Mesh(points.astype(np.float32), triangles.astype(np.int32), flat.astype(np.float32))


def smooth_patches(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return the patch (F,) of each face: patches are faces connected over edges that are no creases."""
    _, place = np.unique(vertices, axis=0, return_inverse=True)
    corners = place.reshape(-1)[faces]
    ends = np.sort(corners[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    owner = np.repeat(np.arange(len(faces)), 3)
    order = np.lexsort((ends[:, 1], ends[:, 0]))
    ends, owner = ends[order], owner[order]
    same = (ends[1:] == ends[:-1]).all(1)
    one, other = owner[:-1][same], owner[1:][same]
    normal = face_normals(vertices, faces)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    # 53 degrees; decimated round things have less
    smooth = np.einsum("nk,nk->n", normal[one], normal[other]) > 0.6
    links = coo_matrix((np.ones(smooth.sum()), (one[smooth], other[smooth])), (len(faces), len(faces)))
    labels: np.ndarray = connected_components(links, directed=False)[1]
    return labels.astype(np.int64)


def _unroll(
    points: np.ndarray, of_patch: np.ndarray, vertices: np.ndarray, faces: np.ndarray, patch: np.ndarray
) -> np.ndarray:
    """Return texture coordinates (N, 2), metres, of points (N, 3) that belong to patches (N,)."""
    count = int(patch.max()) + 1
    normals = face_normals(vertices, faces)
    total = np.stack([np.bincount(patch, column, count) for column in normals.T], axis=1)
    area = np.bincount(patch, np.linalg.norm(normals, axis=1), count)
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    np.minimum.at(low, of_patch, points)
    np.maximum.at(high, of_patch, points)
    extent = high - low
    facing = np.abs(total).argmax(1)
    plane = np.linalg.norm(total, axis=1) > LEVEL * area
    extent[np.flatnonzero(plane), facing[plane]] = -1.0  # a plane is not mapped along its normal
    order = np.argsort(extent, axis=1)  # shortest first
    rows = np.arange(len(points))
    along, across, third = (order[of_patch, k] for k in (2, 1, 0))
    u = points[rows, across] + np.where(plane[of_patch], 0.0, points[rows, third])
    return np.stack([u, points[rows, along]], axis=1)
