import numpy as np
import pytest
import trimesh

from vig.likelihood.geometry import edges_of, rings_of
from vig_world.mesh import vertex_normals


def torn(mesh: trimesh.Trimesh, rng: np.random.Generator) -> np.ndarray:
    """The faces of a mesh, a third of them missing."""
    return np.asarray(mesh.faces)[rng.random(len(mesh.faces)) > 0.33].astype(np.int32)


@pytest.mark.parametrize("seed", range(3))
def test_a_ring_sums_to_the_area_weighted_normal_and_its_derivative(seed: int) -> None:
    """On a closed ball and on torn ones, where rings are open or in pieces."""
    rng = np.random.default_rng(seed)
    ball = trimesh.creation.icosphere(subdivisions=2)
    faces = torn(ball, rng) if seed else np.asarray(ball.faces, np.int32)
    points = ball.vertices * rng.uniform(0.7, 1.3, (len(ball.vertices), 1))
    start, ring = rings_of(faces, len(points))
    assert start[0] == 0 and start[-1] == len(ring)

    def normals(at: np.ndarray) -> np.ndarray:
        found = np.zeros_like(at)
        for corner in range(3):
            a, b, c = at[faces[:, 0]], at[faces[:, 1]], at[faces[:, 2]]
            np.add.at(found, faces[:, corner], np.cross(b - a, c - a))
        return found

    expected = normals(points)
    step = 1e-6 * rng.normal(size=points.shape)
    moved = (normals(points + step) - normals(points - step)) / 2
    for v in range(len(points)):
        i, ahead, back = ring[start[v] : start[v + 1]].T
        here = points[v]
        total = np.cross(points[i] - here, points[ahead] - here).sum(0)
        np.testing.assert_allclose(total, expected[v], atol=1e-12)
        # d normal = sum over neighbours of d p_i x (next - previous), the vertex itself against them.
        change = np.cross(step[i] - step[v], points[ahead] - points[back]).sum(0)
        np.testing.assert_allclose(change, moved[v], atol=1e-11)
    if not seed:
        unit = expected / np.linalg.norm(expected, axis=1, keepdims=True)
        np.testing.assert_allclose(vertex_normals(points, faces), unit, atol=1e-6)


def test_each_edge_of_a_closed_mesh_is_listed_once_with_both_faces() -> None:
    ball = trimesh.creation.icosphere(subdivisions=2)
    edges = edges_of(np.asarray(ball.faces, np.int32))
    assert len(edges) == len(ball.edges_unique)
    for a, b, face, beyond, corner in edges:
        assert {a, b} <= set(ball.faces[face]) and {a, b, corner} == set(ball.faces[beyond])


def test_edges_at_a_border_have_nothing_beyond() -> None:
    edges = edges_of(np.array([[0, 1, 2], [2, 1, 3]], np.int32))
    inner = edges[edges[:, 3] >= 0]
    assert len(edges) == 5 and len(inner) == 1
    assert inner[0].tolist() == [1, 2, 0, 1, 3]
    assert (edges[edges[:, 3] < 0][:, 4] == -1).all()
