import numpy as np
import torch

from vig_renderer import MeshObject, Pinhole, Scene, Topology, pyramid, render

CORNERS = np.array([[-0.1, -0.1, 0.0], [0.1, -0.1, 0.0], [0.1, 0.1, 0.0], [-0.1, 0.1, 0.0]])
FACES = np.array([[0, 1, 2], [0, 2, 3]])


def square(depth: float, texture_faces: np.ndarray | None = None, **more: object) -> MeshObject:
    vertices = torch.from_numpy(CORNERS + [0.0, 0.0, depth]).requires_grad_()
    albedo = torch.full((3,), 0.5, dtype=torch.float64)
    return MeshObject(vertices, Topology.of(FACES, CORNERS, texture_faces), albedo, **more)


def test_texture_faces_of_an_object_without_a_texture_are_not_read() -> None:
    """Beside a textured object, corners that name rows beyond all coordinates must do no harm."""
    numbers = np.random.default_rng(0).uniform(size=(8, 8, 3))
    uv = torch.tensor([[0.0, 0], [1, 0], [1, 1], [0, 1]], dtype=torch.float64)
    textured = square(0.6, texture=pyramid(torch.from_numpy(numbers)), texture_coordinates=uv)
    bare, plain = square(0.5, FACES + 1_000_000), square(0.5)
    camera = Pinhole(
        20,
        20,
        torch.full((2,), 30.0, dtype=torch.float64),
        torch.full((2,), 10.0, dtype=torch.float64),
        torch.eye(3, dtype=torch.float64),
        torch.zeros(3, dtype=torch.float64),
    )
    images = []
    for front in (bare, plain):
        image = render(Scene([textured, front], camera)).rgb
        image.square().sum().backward()
        images.append(image.detach())
    torch.testing.assert_close(images[0], images[1])
    assert bare.vertices.grad is not None and bare.vertices.grad.abs().max() > 0
    torch.testing.assert_close(bare.vertices.grad, plain.vertices.grad)
