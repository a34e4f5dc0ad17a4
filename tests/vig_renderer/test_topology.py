import numpy as np
import pytest
import trimesh

from vig_renderer import Topology


def test_a_closed_mesh_has_three_edges_for_two_faces_and_no_border() -> None:
    ball = trimesh.creation.icosphere(subdivisions=2)
    edges = Topology.of(ball.faces, ball.vertices).edges.numpy()
    assert len(edges) == 1.5 * len(ball.faces) and edges.min() >= 0
    # Both faces hold the edge, and the third vertices are theirs.
    for a, b, apex, beyond, face, other in edges:
        assert set(ball.faces[face]) == {a, b, apex} and set(ball.faces[other]) == {a, b, beyond}


def test_vertices_at_one_place_are_one_for_the_edges() -> None:
    square = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)
    edges = Topology.of(np.array([[0, 1, 2], [3, 4, 5]]), square).edges
    assert len(edges) == 5 and (edges[:, 3] < 0).sum() == 4


def test_an_edge_of_three_faces_borders_each_and_degenerate_faces_have_none() -> None:
    vertices = np.eye(5, 3) + np.arange(5)[:, None]
    edges = Topology.of(np.array([[0, 1, 2], [1, 0, 3], [0, 1, 4], [2, 2, 3]]), vertices).edges.numpy()
    shared = edges[(edges[:, 0] == 0) & (edges[:, 1] == 1)]
    assert shared[:, 4].tolist() == [0, 1, 2] and (shared[:, [3, 5]] == -1).all()
    assert 3 not in edges[:, 4:]


def test_no_faces_are_no_edges_and_tables_of_other_shapes_are_refused() -> None:
    assert Topology.of(np.zeros((0, 3), int), np.zeros((0, 3))).edges.shape == (0, 6)
    with pytest.raises(ValueError, match=r"texture_faces must be \(1, 3\)"):
        Topology.of(np.array([[0, 1, 2]]), np.zeros((3, 3)), np.zeros((2, 3), int))
    with pytest.raises(ValueError, match=r"vertices must be \(V, 3\)"):
        Topology.of(np.array([[0, 1, 2]]), np.zeros((3, 2)))
