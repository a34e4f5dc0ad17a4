"""Tables of faces, edges and levels that somebody writes to while a rendering still needs them."""

import copy
import pickle
from dataclasses import dataclass

import numpy as np
import pytest
import torch

from vig_renderer import MeshObject, Pinhole, Pyramid, Rendering, Scene, Topology, pyramid, render

CORNERS = np.array([[-0.1, -0.1, 0.4], [0.1, -0.1, 0.4], [0.0, 0.1, 0.4]])
UV = torch.tensor([[0.0, 0], [1, 0], [1, 1]], dtype=torch.float64)
EYE = [torch.tensor(a, dtype=torch.float64) for a in ([30.0, 30.0], [8.0, 8.0], np.eye(3), [0, 0, 0.0])]


@dataclass
class Triangle:
    """A textured triangle before a plain one, whose tables share their memory with arrays."""

    vertices: torch.Tensor
    arrays: dict[str, np.ndarray]
    topology: Topology
    texture: Pyramid

    @staticmethod
    def make() -> "Triangle":
        edges = Topology.of(np.array([[0, 1, 2]]), CORNERS).edges.numpy()
        arrays = {"faces": np.array([[0, 1, 2]], np.int32), "texture_faces": np.array([[0, 1, 2]], np.int32)}
        arrays |= {"edges": edges}
        texture = pyramid(torch.rand(4, 4, 3, generator=torch.Generator().manual_seed(0)).double())
        arrays["levels"] = texture.levels.numpy()
        shared = {name: torch.from_numpy(array) for name, array in arrays.items() if name != "levels"}
        vertices = torch.tensor(CORNERS, requires_grad=True)
        return Triangle(vertices, arrays, Topology(**shared, vertex_count=3), texture)

    def render(self) -> Rendering:
        white, texture = torch.ones(3).double(), {"texture": self.texture, "texture_coordinates": UV}
        front = MeshObject(self.vertices, self.topology, white, **texture)
        back = MeshObject(self.vertices.detach() * 2, Topology.of([[0, 1, 2]], CORNERS), white)
        return render(Scene([front, back], Pinhole(16, 16, *EYE)))


@pytest.mark.parametrize(
    ("name", "place", "number"), [("faces", (0, 1), 3), ("texture_faces", (0, 2), 3), ("edges", (0, 0), 3)]
)
def test_a_write_that_torch_does_not_know_of_changes_nothing(
    name: str, place: tuple[int, int], number: int
) -> None:
    """Tables are copied, so that no write leads beyond memory."""
    made = Triangle.make()
    early, expected = made.render(), made.render()
    assert expected.full_masks.sum() > 0
    made.arrays[name][place] = number
    for seen in (early, made.render()):
        for each in ("rgb", "full_masks", "triangle_id"):
            assert torch.equal(getattr(seen, each), getattr(expected, each))
        seen.rgb.sum().backward()


@pytest.mark.parametrize(
    ("name", "place", "number", "why"),
    [
        ("faces", (0, 1), 7, "faces must be from 0 to 2; they are from 0 to 7"),
        ("texture_faces", (0, 2), 3, "a texture needs a row of texture_coordinates"),
        ("edges", (1, 4), 1, "edges must be from 0 to 0; they are from 0 to 1"),
        ("edges", (0, 3), -2, "edges must be from -1 to 2; they are from -2"),
        ("levels", (1, 2), 0, "levels must lie within the texels"),
    ],
)
def test_tables_that_were_written_to_are_checked_again(
    name: str, place: tuple[int, int], number: int, why: str
) -> None:
    made = Triangle.make()
    early = made.render()
    table = made.texture.levels if name == "levels" else getattr(made.topology, name)
    table[place] = number
    with pytest.raises(ValueError, match=why):
        made.render()
    early.rgb.sum().backward()  # of the tables as they were


def test_an_input_of_another_shape_is_refused() -> None:
    made = Triangle.make()
    seen = made.render()
    made.vertices.data = made.vertices.detach()[:1].clone()
    with pytest.raises((RuntimeError, ValueError), match=r"shape|numbers"):
        seen.rgb.sum().backward()


def test_copies_and_pickles_draw_the_same() -> None:
    made = Triangle.make()
    expected = made.render().rgb
    for copied in (copy.deepcopy(made.topology), pickle.loads(pickle.dumps(made.topology))):
        made.topology = copied
        assert torch.equal(made.render().rgb, expected)
