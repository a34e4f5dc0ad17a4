"""Meshes rounded by their normals."""

import numpy as np
import pytest

from vig_world.assets.models.unwrapping import unwrap
from vig_world.assets.shapes import box
from vig_world.mesh import Mesh, vertex_normals
from vig_world.renderers.cycles.rounding import CUTS, round_mesh

SIDES = 12


def cylinder() -> Mesh:
    """Of radius and height 1, closed, with creases at top and foot: two rings there, one for each face."""
    k, angle = np.arange(SIDES), 2 * np.pi * np.arange(SIDES) / SIDES
    rings = [np.stack([np.cos(angle), np.sin(angle), np.full(SIDES, z)], 1) for z in (0.0, 1.0)]
    after, foot, top = (k + 1) % SIDES, np.full(SIDES, 2 * SIDES), np.full(SIDES, 2 * SIDES + 1)
    sides = [(k, after, k + SIDES), (after, after + SIDES, k + SIDES)]
    faces = [*sides, (after, k, foot), (k + SIDES, after + SIDES, top)]
    points = np.concatenate([*rings, [[0, 0, 0], [0, 0, 1]]])
    return unwrap(points, np.concatenate([np.stack(corners, 1) for corners in faces]))


def rounded_mesh(mesh: Mesh) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray | None]:
    uv = None if mesh.uv is None else mesh.uv[mesh.faces]
    return round_mesh(mesh.vertices, vertex_normals(mesh.vertices, mesh.faces), mesh.faces, uv)


def test_a_prism_with_a_cylinder_s_normals_becomes_one() -> None:
    mesh = cylinder()
    corner = np.cos(np.pi / SIDES)  # a side's middle is 3.4 % nearer to the axis than its edges
    vertices, normals, faces, _ = rounded_mesh(mesh)
    points, directions = vertices[faces].reshape(-1, 3), normals[faces].reshape(-1, 3)
    side = np.abs(directions[:, 2]) < 0.5
    radius = np.linalg.norm(points[side, :2], axis=1)
    assert corner < 0.967 and radius.min() > 0.987 and radius.max() < 1.004
    along = np.einsum("nd,nd->n", directions[side, :2], points[side, :2]) / radius
    assert along.min() > 0.99, "normals point away from the axis"
    rim = points[~side & (np.linalg.norm(points[:, :2], axis=1) > 0.9)]
    assert np.linalg.norm(rim[:, :2], axis=1).min() > 0.987, "lids follow the sides: no gap at the crease"


def test_flat_faces_stay_and_keep_their_texture() -> None:
    mesh = box([1.0, 2.0, 3.0])
    vertices, normals, faces, uv = rounded_mesh(mesh)
    assert np.array_equal(faces, mesh.faces) and np.array_equal(vertices, mesh.vertices.astype(np.float32))
    assert uv is not None and mesh.uv is not None
    np.testing.assert_array_equal(uv, mesh.uv[mesh.faces].astype(np.float32))


def test_a_cut_face_has_the_texture_and_the_corners_of_the_whole() -> None:
    """Three corners on a unit sphere, 39 degrees apart."""
    vertices = np.eye(3) + 0.9
    vertices /= np.linalg.norm(vertices, axis=1, keepdims=True)
    uv = np.array([[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]])
    points, normals, faces, finer = round_mesh(vertices, vertices, np.array([[0, 1, 2]]), uv)
    assert len(faces) == CUTS**2 and finer is not None
    radius = np.linalg.norm(points[faces], axis=-1)
    assert radius.min() > 0.99 and radius.max() < 1.001  # the flat face's middle has 0.93
    np.testing.assert_allclose(np.linalg.norm(normals[faces], axis=-1), 1, rtol=1e-5)
    areas = 0.5 * np.abs(np.linalg.det(finer[:, 1:] - finer[:, :1]))
    np.testing.assert_allclose(areas, 0.5 / CUTS**2, rtol=1e-5)
    for corner, texel in zip(vertices, uv[0], strict=True):
        at = np.linalg.norm(points[faces] - corner, axis=-1) < 1e-6
        assert at.any()
        np.testing.assert_allclose(finer[at], np.tile(texel, (int(at.sum()), 1)), atol=1e-6)


@pytest.mark.parametrize("turned", [False, True])
def test_edges_of_neighbours_meet(turned: bool) -> None:
    """Two faces over a bent edge: the same points on it, whichever way the second is wound."""
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0.5, 1, -0.2], [0.5, -1, -0.2]])
    normals = np.array([[-0.3, 0, 1], [0.3, 0, 1], [0, 0.4, 1], [0, -0.4, 1]])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    second = [0, 1, 3] if turned else [1, 0, 3]
    points, _, faces, _ = round_mesh(vertices, normals, np.array([[0, 1, 2], second]), None)
    on_edge = [
        {tuple(np.round(p, 6)) for p in points[half].reshape(-1, 3) if abs(p[1]) < 1e-6}
        for half in (faces[: CUTS**2], faces[CUTS**2 :])
    ]
    assert on_edge[0] == on_edge[1] and len(on_edge[0]) == CUTS + 1
    assert max(p[2] for p in on_edge[0]) > 0.05, "the edge rises between its ends"
