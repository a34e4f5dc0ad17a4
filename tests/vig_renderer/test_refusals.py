"""Wrong shapes, types and indices are refused before a kernel reads beyond an array."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch

from tests.support import TEAPOT
from vig.scene import Camera, ObjectClass
from vig_native import engine
from vig_renderer import MeshObject, Pinhole, Pyramid, Scene, Topology, pyramid, render
from vig_world.mesh import Mesh
from vig_world.raster.rasterize import rasterize

TRIANGLE = np.array([[-0.1, -0.1, 0.4], [0.1, -0.1, 0.4], [0.0, 0.1, 0.4]], np.float32)
FACE = np.array([[0, 1, 2]], np.int32)
CAMERA = Camera.standard(20)
RASTER: dict[str, Any] = {
    "vertices": TRIANGLE, "faces": FACE, "rotation": np.eye(3), "translation": np.zeros(3), "camera": CAMERA,
}  # fmt: skip
POINTS = torch.from_numpy(TRIANGLE)
FACES = torch.from_numpy(FACE)
TOPOLOGY = Topology.of(FACE, TRIANGLE)
PINHOLE = Pinhole(8, 8, torch.full((2,), 8.0), torch.full((2,), 4.0), torch.eye(3), torch.zeros(3))
LONG = FACES.long()
BEYOND = torch.tensor([[0, 1, 3]], dtype=torch.int32)
FAR = torch.tensor([[0, 1, 2**31 - 1]], dtype=torch.int32)
BELOW = torch.tensor([[0, -1, 2]], dtype=torch.int32)


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"faces": FAR.numpy()}, "faces must be from 0 to 2; they are from 0 to 2147483647"),
        ({"faces": np.array([[0, 1, 2**32]])}, "faces must be from 0 to 2"),
        ({"faces": BELOW.numpy()}, "faces must be from 0 to 2; they are from -1"),
        ({"faces": FACE.astype(float)}, r"faces must be \(F, 3\) whole numbers; got \(1, 3\) float64"),
        ({"faces": FACE[0]}, r"faces must be \(F, 3\) whole numbers; got \(3,\)"),
        ({"vertices": TRIANGLE[:, :2]}, r"vertices must be .*; got"),
        ({"vertices": TRIANGLE.astype(str)}, "vertices must be"),
    ],
)
def test_rasterize(change: dict[str, Any], why: str) -> None:
    assert (rasterize(**RASTER).face == 0).any()
    with pytest.raises(ValueError, match=why):
        rasterize(**RASTER | change)


@pytest.mark.parametrize(
    ("column", "value"), [(0, 3), (2, -1), (3, 3), (3, -2), (4, 1), (4, -1), (5, 1), (5, -2)]
)
def test_edges(column: int, value: int) -> None:
    edges = TOPOLOGY.edges.clone()
    edges[0, column] = value
    with pytest.raises(ValueError, match="edges must be from"):
        replace(TOPOLOGY, edges=edges)


def test_pyramids() -> None:
    made = pyramid(torch.rand(4, 4, 3))
    levels = made.levels.clone()
    levels[1, 0] = 1000
    for wrong, why in (
        (levels, "levels must lie within the texels"),
        (levels[:0], "levels must lie within the texels, and each texture must have one or more"),
        (levels.long(), "levels must be int32"),
        (levels[:, :2], r"levels must be \(any, 3\)"),
    ):
        with pytest.raises(ValueError, match=why):
            Pyramid(made.texels, wrong)


SCENES: dict[str, Any] = {
    "meshes": [TOPOLOGY.mesh], "levels": [None], "places": [0], "starts": [0, 1], "height": 8, "width": 8,
    "samples": 1, "near": 0.01, "masks": 1, "is_mask": False,
}  # fmt: skip
INPUTS = [POINTS.numpy(), None, None, None, np.ones(3, np.float32), None, None, None]
INPUTS += [np.eye(3, dtype=np.float32), np.zeros(3, np.float32), *np.full((2, 2), 4, np.float32), None, None]


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"height": 0}, "an image must have a pixel or more"),
        ({"samples": 40000}, "an image must have a pixel or more and at most 268 million samples"),
        ({"starts": [0, 2]}, "starts lead from 0 to their number"),
        ({"places": [1]}, "places must be from 0 to 0"),
        ({"levels": [None, None]}, "levels and places must be as many as meshes"),
    ],
)
def test_scenes_in_the_library(change: dict[str, Any], why: str) -> None:
    engine.Scenes32(**SCENES)
    with pytest.raises(ValueError, match=why):
        engine.Scenes32(**SCENES | change)


@pytest.mark.parametrize(
    ("place", "value", "why"),
    [
        (0, np.zeros((2, 3), np.float32), "input 0 of object 0 must have 9 numbers; got 6"),
        (4, np.zeros(6, np.float32), "input 4 of object 0 must have 3 numbers; got 6"),
        (5, np.zeros(8, np.float32), "input 5 of object 0 must have 9 numbers; got 8"),
        (10, None, "input 10 of object 0 is missing"),
    ],
)
def test_inputs_of_scenes_in_the_library(place: int, value: Any, why: str) -> None:
    inputs = [*INPUTS]
    inputs[place] = value
    made, attributes = np.empty((3, 3), np.float32), np.empty((3, 9), np.float32)
    assert engine.Scenes32(**SCENES).place([INPUTS], made, attributes, 1)
    with pytest.raises(ValueError, match=why):
        engine.Scenes32(**SCENES).place([inputs], made, attributes, 1)
    for wrong in (made.astype(np.float64), made[:, ::-1]):
        with pytest.raises(TypeError):
            engine.Scenes32(**SCENES).place([INPUTS], wrong, attributes, 1)
    with pytest.raises(ValueError, match=r"points must be \(3, 3\); got \(2, 3\)"):
        engine.Scenes32(**SCENES).place([INPUTS], made[:2].copy(), attributes, 1)
    with pytest.raises(ValueError, match="scenes must be placed, then painted"):
        depth, normals = np.empty((1, 8, 8), np.float32), np.empty((1, 8, 8, 3), np.float32)
        engine.Scenes32(**SCENES).surface(depth, normals, *np.empty((2, 1, 8, 8), np.int32))


def test_scenes_in_the_library_are_used_in_order() -> None:
    points, attributes = np.ones((3, 3), np.float32), np.ones((3, 9), np.float32)
    images = (
        np.zeros((1, 8, 8, 3), np.float32),
        np.zeros((1, 8, 8), np.float32),
        np.zeros((1, 1, 8, 8), np.float32),
    )
    background, on = np.zeros((1, 3), np.float32), [[None] * 14]
    for columns in (6, 9):
        scenes = engine.Scenes32(**SCENES)
        scenes.bind(points, attributes[:, :columns].copy())
        scenes.find(True, 1)
        with pytest.raises(ValueError, match="scenes must be placed, then painted"):
            scenes.paint(background, *images, 1)
        with pytest.raises(ValueError, match="scenes must be placed, then painted"):
            scenes.back(*images, points, attributes[:, :columns].copy(), None, on, 1)
    for change in ({"meshes": [None]}, {"masks": -1}):
        with pytest.raises((ValueError, TypeError)):
            engine.Scenes32(**SCENES | change)


def test_topologies() -> None:
    for count in (-5, 4.5, 2**40):
        with pytest.raises(ValueError, match="vertex_count must be a whole number from 0 on; got"):
            replace(TOPOLOGY, vertex_count=count)
    with pytest.raises(ValueError, match="faces must be a torch tensor; got a ndarray"):
        replace(TOPOLOGY, faces=FACE)
    with pytest.raises(ValueError, match="faces must be from 0 to 2"):
        replace(TOPOLOGY, faces=BEYOND)
    with pytest.raises(ValueError, match="texture_faces must name rows"):
        replace(TOPOLOGY, texture_faces=BELOW)
    with pytest.raises(ValueError, match="faces must be int32"):
        replace(TOPOLOGY, faces=LONG)


def test_meshes() -> None:
    Mesh(TRIANGLE, FACE)
    for vertices, faces, why in (
        (TRIANGLE, BEYOND.numpy(), "faces must be from 0 to 2"),
        (TRIANGLE, FACE.astype(float), "faces must be int8 .*; it is float64"),
        (TRIANGLE.astype(int), FACE, "vertices must be float16 or float32 or float64; it is int64"),
    ):
        with pytest.raises(ValueError, match=why):
            Mesh(vertices, faces)


@pytest.mark.parametrize(
    ("name", "value", "why"),
    [
        ("faces", np.array([[0, 1, 2636]], np.int32), "faces must be from 0 to 2635"),
        ("parts", np.full(2636, 9, np.int32), "parts must be from 0 to"),
        ("mean", np.full((2636, 3), 1e6, np.float32), "mean must be finite and within 100 metres"),
        ("basis", np.zeros((65, 2636, 3), np.float32), "explained_variance_ratio must be"),
        ("explained_variance_ratio", np.full(10, np.nan, np.float32), "must be from 0 to 1"),
    ],
)
def test_shape_models(name: str, value: np.ndarray, why: str) -> None:
    model = ObjectClass.load(TEAPOT).shape_model
    with pytest.raises(ValueError, match=why):
        replace(model, **{name: value})


@pytest.mark.parametrize(
    ("faces", "why"),
    [
        ([[0, 1, 2, 0]], r"faces must be triangles.*got \(1, 4\).*Cut quads into two triangles each"),
        (FACE.astype(float), "whole numbers; got .* float64"),
        ([0, 1, 2], "faces must be triangles"),
        ([[0, 1, 2], [0, 1]], "faces must be triangles"),
        (np.array([[0, 1, 2**32]]), "faces must name vertices 0 to 2; they name 0 to 4294967296"),
    ],
)
def test_faces_that_are_no_triangles(faces: Any, why: str) -> None:
    assert len(Topology.of([], TRIANGLE).faces) == 0
    with pytest.raises(ValueError, match=why):
        Topology.of(faces, TRIANGLE)


@pytest.mark.parametrize("texture", [torch.zeros(2, 2, 3, dtype=torch.uint8), np.zeros((2, 2, 3)), None])
def test_textures_of_other_types(texture: Any) -> None:
    with pytest.raises(ValueError, match="a texture must be a float32 or float64 tensor of linear values"):
        pyramid(texture)


def test_texture_corners_beyond_all_rows() -> None:
    beyond = replace(TOPOLOGY, texture_faces=FACES * 0 + 2**31 - 1)
    texture = {"texture": pyramid(torch.rand(2, 2, 3)), "texture_coordinates": torch.zeros(3, 2)}
    with pytest.raises(ValueError, match="a texture needs a row of texture_coordinates"):
        render(Scene([MeshObject(POINTS, beyond, torch.ones(3), **texture)], PINHOLE))


@pytest.mark.parametrize("near", [0, -1.0, np.nan, np.inf, "1 mm"])
def test_near_planes(near: Any) -> None:
    with pytest.raises(ValueError, match="near must be metres, above 0"):
        render(Scene([], PINHOLE), near=near)


def test_transforms_that_hide_numbers() -> None:
    def brightness(shift: torch.Tensor) -> torch.Tensor:
        mesh = MeshObject(POINTS.double() + shift, TOPOLOGY, torch.ones(3, dtype=torch.float64))
        return render(Scene([mesh], Pinhole(8, 8, *(each.double() for each in eye)))).rgb.sum()

    eye = PINHOLE.focal, PINHOLE.centre, PINHOLE.rotation, PINHOLE.translation
    at = torch.zeros(3, dtype=torch.float64)
    expected = torch.func.grad(brightness)(at)
    torch.testing.assert_close(torch.func.jacfwd(brightness)(at), expected)
    torch.testing.assert_close(torch.func.jacrev(brightness)(at), expected)
    for transformed in (
        lambda: torch.func.vmap(brightness)(at.expand(2, 3)),
        lambda: torch.func.vmap(torch.func.grad(brightness))(at.expand(2, 3)),
        lambda: torch.func.linearize(brightness, at),
        lambda: torch.jit.trace(brightness, at),
    ):
        with pytest.raises(NotImplementedError, match="draws no scenes under vmap, linearize or another"):
            transformed()
