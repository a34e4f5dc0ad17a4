"""Wrong shapes, types and indices are refused before a kernel reads beyond an array."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch

from tests.support import TEAPOT
from vig.likelihood import Photos
from vig.scene import Camera, ObjectClass
from vig_renderer import MeshObject, Pinhole, Scene, Topology, render
from vig_renderer.primitives import (
    Pyramid,
    barycentrics,
    find_crossings,
    interpolate,
    pyramid,
    sample_texture,
    visible_faces,
)
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
LAYER = torch.zeros(1, dtype=torch.int32)
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
    ("arguments", "why"),
    [
        ((POINTS, BEYOND, LAYER, (1, 8, 8)), "faces must be from 0 to 2; they are from 0 to 3"),
        ((POINTS, BELOW, LAYER, (1, 8, 8)), "faces must be from 0 to 2"),
        ((POINTS, LONG, LAYER, (1, 8, 8)), "faces must be int32; got torch.int64"),
        ((POINTS, FACES, LAYER + 1, (1, 8, 8)), "layer must be from 0 to 0; they are from 1"),
        ((POINTS, FACES, LAYER[:0], (1, 8, 8)), r"layer must be \(1\); got \(0,\)"),
        ((POINTS[:, :2], FACES, LAYER, (1, 8, 8)), r"points must be \(any, 3\); got \(3, 2\)"),
        ((POINTS.half(), FACES, LAYER, (1, 8, 8)), "points must be float32 or float64"),
        ((POINTS, FACES, LAYER, (1, 0, 8)), "size must be images, rows and columns"),
    ],
)
def test_visible_faces_and_crossings(arguments: tuple, why: str) -> None:
    visible_faces(POINTS, FACES, LAYER, (1, 8, 8))
    find_crossings(POINTS, FACES, TOPOLOGY.edges, LAYER, (1, 8, 8))
    points, faces, layer, size = arguments
    with pytest.raises(ValueError, match=why):
        visible_faces(*arguments)
    with pytest.raises(ValueError, match=why):
        find_crossings(points, faces, TOPOLOGY.edges, layer, size)


@pytest.mark.parametrize(
    ("column", "value"), [(0, 3), (2, -1), (3, 3), (3, -2), (4, 1), (4, -1), (5, 1), (5, -2)]
)
def test_edges(column: int, value: int) -> None:
    edges = TOPOLOGY.edges.clone()
    edges[0, column] = value
    with pytest.raises(ValueError, match="edges must be from"):
        find_crossings(POINTS, FACES, edges, LAYER, (1, 8, 8))
    with pytest.raises(ValueError, match="edges must be from"):
        replace(TOPOLOGY, edges=edges)


WEIGHTS = torch.full((1, 3), 1 / 3)
PIXEL = torch.zeros(1, 2, dtype=torch.int32)


@pytest.mark.parametrize(
    ("call", "why"),
    [
        (lambda: interpolate(POINTS, BEYOND, WEIGHTS), "corners must be from 0 to 2"),
        (lambda: interpolate(POINTS, BELOW, WEIGHTS), "corners must be from 0 to 2"),
        (lambda: interpolate(POINTS, LONG, WEIGHTS), "corners must be int32"),
        (lambda: interpolate(POINTS, FACES, WEIGHTS.double()), "all of one type"),
        (lambda: interpolate(POINTS, FACES, WEIGHTS.repeat(2, 1)), r"weights must be \(1, 3\); got \(2, 3\)"),
        (lambda: interpolate(POINTS[0], FACES, WEIGHTS), "attributes must be"),
        (lambda: barycentrics(POINTS, BEYOND, PIXEL), "corners must be from 0 to 2"),
        (lambda: barycentrics(POINTS, FACES, PIXEL.repeat(2, 1)), r"pixels must be \(1, 2\)"),
        (lambda: barycentrics(POINTS, FACES, PIXEL.long()), "pixels must be int32"),
    ],
)
def test_interpolation(call: Callable[[], Any], why: str) -> None:
    interpolate(POINTS, FACES, WEIGHTS)
    barycentrics(POINTS, FACES, PIXEL)
    with pytest.raises(ValueError, match=why):
        call()


def test_textures() -> None:
    made = pyramid(torch.rand(4, 4, 3))
    which, uv, footprint = torch.zeros(1, dtype=torch.int32), torch.zeros(1, 2), torch.zeros(1, 2, 2)
    sample_texture(made, which, uv, footprint)
    sample_texture(made, which - 1, uv, footprint)
    for arguments, why in (
        ((which + 1, uv, footprint), "texture must be from -1 to 0"),
        ((which - 2, uv, footprint), "texture must be from -1 to 0"),
        ((which.long(), uv, footprint), "texture must be int32"),
        ((which, uv.repeat(2, 1), footprint), r"uv must be \(1, 2\)"),
        ((which, uv.double(), footprint.double()), "all of one type"),
        ((which, uv, footprint.repeat(2, 1, 1)), r"footprint must be \(1, 4\)"),
    ):
        with pytest.raises(ValueError, match=why):
            sample_texture(made, *arguments)
    levels = made.levels.clone()
    levels[1, 0] = 1000
    with pytest.raises(ValueError, match="levels must lie within the texels"):
        Pyramid(made.texels, levels, made.first)
    with pytest.raises(ValueError, match="first must be from 0 to 3"):
        Pyramid(made.texels, made.levels, made.first + 1)


def test_topologies() -> None:
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
        (TRIANGLE, FACE.astype(float), "faces whole numbers; got float32 and float64"),
        (TRIANGLE.astype(int), FACE, "vertices must be floating"),
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
    ("linear", "why"),
    [
        (
            torch.zeros(1, 8, 8, 3, dtype=torch.uint8),
            "photos must be floating-point linear RGB; got torch.uint8",
        ),
        (torch.full((1, 8, 8, 3), -1.5), "photos must be linear RGB in .* got a minimum of -1.5"),
        (torch.zeros(1, 3, 8, 8), r"photos must be \(N, H, W, 3\)"),
    ],
)
def test_photos(linear: torch.Tensor, why: str) -> None:
    with pytest.raises(ValueError, match=why):
        Photos(linear, torch.zeros(linear.shape))


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


@pytest.mark.parametrize("near", [0, -1.0, np.nan, np.inf, "1 mm"])
def test_near_planes(near: Any) -> None:
    with pytest.raises(ValueError, match="near must be metres, above 0"):
        render(Scene([], PINHOLE), near=near)


def test_transforms_that_hide_numbers() -> None:
    def brightness(shift: torch.Tensor) -> torch.Tensor:
        mesh = MeshObject(POINTS + shift, TOPOLOGY, torch.ones(3))
        return render(Scene([mesh], PINHOLE)).rgb.sum()

    at = torch.zeros(3)
    expected = torch.func.grad(brightness)(at)
    torch.testing.assert_close(torch.func.jacfwd(brightness)(at), expected)
    torch.testing.assert_close(torch.func.jacrev(brightness)(at), expected)
    for transformed in (
        lambda: torch.func.vmap(brightness)(torch.zeros(2, 3)),
        lambda: torch.func.vmap(torch.func.grad(brightness))(torch.zeros(2, 3)),
        lambda: torch.func.linearize(brightness, at),
        lambda: torch.jit.trace(brightness, at),
    ):
        with pytest.raises(NotImplementedError, match="draws no scenes under vmap, linearize or another"):
            transformed()
