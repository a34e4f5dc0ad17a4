"""Barycentrics, interpolation and textures: values, both kinds of derivative, against the references."""

from collections.abc import Callable

import numpy as np
import pytest
import torch

from tests.vig_renderer import reference
from vig_renderer import Pyramid, pyramid
from vig_renderer.interpolation import barycentrics, interpolate
from vig_renderer.texture import sample_texture

Function = Callable[..., torch.Tensor]


def agree(function: Function, expected: Function, inputs: list[torch.Tensor], rest: tuple = ()) -> None:
    """Same values, reverse and forward derivatives, in float64; same values in float32."""
    torch.testing.assert_close(function(*inputs, *rest), expected(*inputs, *rest), rtol=1e-9, atol=1e-10)
    single = function(*(x.float() for x in inputs), *rest)
    assert single.dtype == torch.float32
    torch.testing.assert_close(single.double(), expected(*inputs, *rest), rtol=1e-3, atol=1e-3)
    generator = torch.Generator().manual_seed(0)
    value = expected(*inputs, *rest)
    cotangent = torch.randn(value.shape, generator=generator, dtype=value.dtype)
    tangents = tuple(torch.randn(x.shape, generator=generator, dtype=x.dtype) for x in inputs)
    leaves = [x.clone().requires_grad_() for x in inputs]
    for found, wanted in zip(
        torch.autograd.grad(function(*leaves, *rest), leaves, cotangent),
        torch.autograd.grad(expected(*leaves, *rest), leaves, cotangent),
        strict=True,
    ):
        torch.testing.assert_close(found, wanted, rtol=1e-8, atol=1e-8 * float(wanted.abs().max()) + 1e-10)
    moved = torch.func.jvp(lambda *x: function(*x, *rest), tuple(inputs), tangents)[1]
    wanted = torch.func.jvp(lambda *x: expected(*x, *rest), tuple(inputs), tangents)[1]
    torch.testing.assert_close(moved, wanted, rtol=1e-8, atol=1e-8 * float(wanted.abs().max()) + 1e-10)


@pytest.fixture
def seen(triangles: Callable) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Screen points, corners and pixels of a soup's visible faces; slivers left out."""
    rng = np.random.default_rng(1)
    points, faces = triangles(rng)
    found = reference.visible_faces(points, faces, (24, 32))
    corners, pixels = faces[found[found >= 0]].long(), (found >= 0).nonzero().flip(1)
    area = reference._edge_functions(points[corners.long()], *(pixels + 0.5).double().unbind(1)).sum(1).abs()
    return points, corners[area > 0.5], pixels[area > 0.5]


def test_barycentrics_and_their_derivatives_are_the_references(seen: tuple) -> None:
    points, corners, pixels = seen
    assert len(corners) > 100
    agree(barycentrics, reference.barycentrics, [points], (corners, pixels))


def test_barycentrics_find_the_pixel_again(seen: tuple) -> None:
    points, corners, pixels = seen
    weights = barycentrics(points, corners, pixels)
    met = (weights[:, 0, :, None] * points[corners.long()]).sum(1)
    torch.testing.assert_close(met[:, :2] / met[:, 2:], (pixels + 0.5).double())
    torch.testing.assert_close(weights.sum(2), torch.tensor([1.0, 0, 0]).double().expand(len(corners), 3))


def test_interpolation_is_the_references(seen: tuple) -> None:
    points, corners, pixels = seen
    attributes = torch.from_numpy(np.random.default_rng(2).normal(size=(len(points), 5)))
    weights = barycentrics(points, corners, pixels)[:, 0]
    agree(
        lambda a, w: interpolate(a, corners, w),
        lambda a, w: reference.interpolate(a, corners, w),
        [attributes, weights],
    )


@pytest.mark.parametrize("shape", [(7, 12), (16, 16), (1, 1), (1, 5)])
def test_textures_are_looked_up_as_by_the_reference(shape: tuple[int, int]) -> None:
    rng = np.random.default_rng(3)
    made = pyramid(torch.from_numpy(rng.random((*shape, 3))))
    uv = torch.from_numpy(rng.uniform(-2, 3, (60, 2)))
    footprint = torch.from_numpy(rng.normal(size=(60, 2, 2)) * 10 ** rng.uniform(-3, 0.5, (60, 1, 1)))

    def look_up(function: Function) -> Function:
        return lambda texels, uv, footprint: function(Pyramid(texels, made.levels), uv, footprint)

    agree(look_up(sample_texture), look_up(reference.sample_texture), [made.texels, uv, footprint])


def test_texel_centres_give_texels_and_rows_run_down() -> None:
    image = torch.arange(6.0).reshape(2, 3, 1)
    sharp = torch.zeros(6, 2, 2)
    uv = torch.tensor([[(c + 0.5) / 3, 1 - (r + 0.5) / 2] for r in range(2) for c in range(3)])
    for turns in (0, 3, -2):  # repeated outside [0, 1]
        found = sample_texture(pyramid(image), uv + turns, sharp)
        torch.testing.assert_close(found[:, 0], torch.arange(6.0), atol=1e-5, rtol=0)


@pytest.mark.parametrize("pixel", [1.0, 2.0, 2.8284271, 8.0, 100.0])
def test_the_level_is_the_logarithm_of_the_pixels_size_in_texels(pixel: float) -> None:
    # Level l of a 16 x 16 texture is made to hold the number l.
    made = pyramid(torch.zeros(16, 16, 1))
    levels = torch.cat([torch.full((h * w, 1), float(i)) for i, (_, h, w) in enumerate(made.levels.tolist())])
    footprint = pixel / 16 * torch.eye(2)[None]
    found = sample_texture(Pyramid(levels, made.levels), torch.rand(1, 2), footprint)
    assert found.item() == pytest.approx(min(np.log2(pixel), 4), abs=1e-5)


def test_a_pyramid_halves_to_one_texel_and_keeps_the_mean() -> None:
    made = pyramid(torch.rand(8, 4, 2))
    assert made.levels.tolist() == [[0, 8, 4], [32, 4, 2], [40, 2, 1], [42, 1, 1]]
    torch.testing.assert_close(made.texels[-1], made.texels[:32].mean(0))
    with pytest.raises(ValueError, match=r"\(H, W, C\)"):
        pyramid(torch.rand(8, 4))


def test_no_pixels_are_no_rows() -> None:
    corners, pixels = torch.zeros(0, 3).long(), torch.zeros(0, 2).long()
    weights = barycentrics(torch.rand(4, 3), corners, pixels)
    assert weights.shape == (0, 3, 3)
    assert interpolate(torch.rand(4, 5), corners, weights[:, 0]).shape == (0, 5)
    rows = sample_texture(pyramid(torch.rand(2, 2, 3)), weights[:, 0, :2], weights[:, 1:, :2])
    assert rows.shape == (0, 3)
