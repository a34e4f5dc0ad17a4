"""Tables of faces, edges and levels that somebody writes to while a rendering still needs them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
import torch

from vig_renderer import MeshObject, Pinhole, Rendering, Scene, Topology, render
from vig_renderer.primitives import Pyramid, pyramid

CORNERS = np.array([[-0.1, -0.1, 0.4], [0.1, -0.1, 0.4], [0.0, 0.1, 0.4]])
UV = torch.tensor([[0.0, 0], [1, 0], [1, 1]], dtype=torch.float64)
EYE = [torch.tensor(a, dtype=torch.float64) for a in ([30.0, 30.0], [8.0, 8.0], np.eye(3), [0, 0, 0.0])]
OUT_OF_RANGE = "must be from -?[01] to|must lie within the texels|a texture needs a row"


@dataclass
class Triangle:
    """A textured triangle before a plain one, whose tables share their memory with arrays."""

    vertices: torch.Tensor
    arrays: dict[str, np.ndarray]
    topology: Topology
    texture: Pyramid

    @staticmethod
    def make() -> Triangle:
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


def full_masks(seen: Rendering) -> None:
    _ = seen.full_masks


def depth(seen: Rendering) -> None:
    _ = seen.depth


def backward(seen: Rendering) -> None:
    seen.rgb.sum().backward()


LATER = pytest.mark.parametrize("later", [full_masks, depth, backward])


@pytest.mark.parametrize(
    ("name", "place", "number"),
    [
        ("faces", (0, 1), 3),
        ("faces", (0, 1), -1),
        ("texture_faces", (0, 2), 3),
        ("edges", (0, 0), 3),
        ("edges", (0, 3), -2),
        ("edges", (1, 4), 1),
        ("levels", (0, 1), 9),
        ("levels", (1, 2), 0),
    ],
)
def test_numbers_out_of_range_are_refused_in_every_call(
    name: str, place: tuple[int, int], number: int
) -> None:
    """Written through memory that is shared, so that torch does not know."""
    made = Triangle.make()
    calls = [made.render(), made.render(), made.render()]
    made.arrays[name][place] = number
    with pytest.raises(ValueError, match=OUT_OF_RANGE):
        made.render()
    if name == "faces":
        with pytest.raises(ValueError, match=OUT_OF_RANGE):
            depth(calls[0])
    if name in ("faces", "edges"):
        with pytest.raises(ValueError, match=OUT_OF_RANGE):
            full_masks(calls[1])
    if name != "edges":
        with pytest.raises(ValueError, match=OUT_OF_RANGE):
            backward(calls[2])


@LATER
def test_inference_tables_are_checked_in_every_call(later: Callable[[Rendering], None]) -> None:
    made = Triangle.make()
    with torch.inference_mode():
        made.topology = Topology.of([[0, 1, 2]], CORNERS)
    seen = made.render()
    later(made.render())
    with torch.inference_mode():
        made.topology.faces[0, 1] = 3
    with pytest.raises(ValueError, match=OUT_OF_RANGE):
        later(seen)


@LATER
@pytest.mark.parametrize("name", ["faces", "texture_faces", "edges", "levels"])
def test_what_was_written_to_is_refused_as_torch_does(name: str, later: Callable[[Rendering], None]) -> None:
    """Even where all numbers are in range."""
    made = Triangle.make()
    seen = made.render()
    table = made.texture.levels if name == "levels" else getattr(made.topology, name)
    table.copy_(table.clone())
    with pytest.raises(RuntimeError, match="was modified while a rendering needed it"):
        later(seen)
    later(made.render())


@LATER
def test_a_table_in_other_memory_is_refused(later: Callable[[Rendering], None]) -> None:
    made = Triangle.make()
    seen = made.render()
    made.topology.faces.data = made.topology.faces.clone()[:0]
    with pytest.raises(RuntimeError, match="was modified while a rendering needed it"):
        later(seen)


def test_an_input_of_another_shape_is_refused() -> None:
    made = Triangle.make()
    seen = made.render()
    made.vertices.data = made.vertices.detach()[:1].clone()
    with pytest.raises(RuntimeError, match="exchanged before its backward pass"):
        backward(seen)


def test_tables_that_were_written_to_are_checked_again() -> None:
    made = Triangle.make()
    made.render()
    made.topology.faces[0, 1] = 7
    with pytest.raises(ValueError, match="faces must be from 0 to 2; they are from 0 to 7"):
        made.render()
