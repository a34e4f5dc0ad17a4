import numpy as np
import pytest
import trimesh

from vig_world.mesh import Mesh, face_normals, vertex_normals

TRIANGLE = np.array([[0, 0, 0], [2, 0, 0], [0, 3, 0]], np.float32)


def test_a_face_normal_points_outwards_and_is_twice_the_area_long() -> None:
    np.testing.assert_allclose(face_normals(TRIANGLE, np.array([[0, 1, 2]])), [[0, 0, 6]])
    np.testing.assert_allclose(face_normals(TRIANGLE, np.array([[0, 2, 1]])), [[0, 0, -6]])


def test_vertex_normals_of_a_sphere_are_its_radii() -> None:
    ball = trimesh.creation.icosphere(subdivisions=4)
    normals = vertex_normals(ball.vertices, ball.faces)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-12)
    assert (normals * ball.vertices).sum(1).min() > np.cos(np.radians(0.5))


def test_vertex_normals_weigh_faces_by_area() -> None:
    # Vertex 0 is shared by a face of area 3 in z and one of area 1 in x.
    vertices = np.concatenate([TRIANGLE, [[0, 1, 0], [0, 0, 2]]])
    faces = np.array([[0, 1, 2], [0, 3, 4]])
    np.testing.assert_allclose(vertex_normals(vertices, faces)[0], np.array([1, 0, 3]) / np.sqrt(10))


def test_a_vertex_without_area_has_no_normal() -> None:
    vertices = np.concatenate([TRIANGLE, [[5, 5, 5]]])
    assert vertex_normals(vertices, np.array([[0, 1, 2]]))[3].tolist() == [0, 0, 0]


@pytest.mark.parametrize(
    ("vertices", "faces", "uv", "message"),
    [
        ((3, 2), (1, 3), None, "vertices must be"),
        ((3, 3), (1, 4), None, "faces must be"),
        ((3, 3), (1, 3), (2, 2), r"uv must be \(3, 2\)"),
    ],
)
def test_arrays_of_the_wrong_shape_are_refused(
    vertices: tuple[int, ...], faces: tuple[int, ...], uv: tuple[int, ...] | None, message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        Mesh(np.zeros(vertices, np.float32), np.zeros(faces, np.int32), None if uv is None else np.zeros(uv))
