"""Renderings within what torch offers: batches of cotangents, inference mode, pickle."""

import copy
import io
import pickle
from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
import torch

from tests.vig_renderer.conftest import World
from vig_renderer import Rendering, Scene, render

Draw = Callable[[torch.Tensor], Rendering]


@pytest.fixture
def draw(world: Callable[..., World]) -> Draw:
    """A rendering of a scene without textures by where one of its two objects stands."""
    made = world(np.random.default_rng(31), size=12)

    def drawn(place: torch.Tensor) -> Rendering:
        scene = made.build({**made.inputs, "front translation": place})
        return render(replace(scene, objects=[replace(each, texture=None) for each in scene.objects]))

    return drawn


@pytest.fixture
def place() -> torch.Tensor:
    return torch.tensor([0.01, -0.02, 0.4], dtype=torch.float64, requires_grad=True)


def one_by_one(draw: Draw, place: torch.Tensor, name: str, cotangents: torch.Tensor) -> torch.Tensor:
    return torch.stack([torch.autograd.grad(getattr(draw(place), name), place, row)[0] for row in cotangents])


@pytest.mark.parametrize("name", ["rgb", "coverage", "full_masks", "normals"])
def test_batches_of_cotangents_are_those_one_by_one(draw: Draw, place: torch.Tensor, name: str) -> None:
    image = getattr(draw(place), name)
    random = torch.Generator().manual_seed(0)
    cotangents = torch.randn(4, *image.shape, generator=random, dtype=image.dtype)
    expected = one_by_one(draw, place, name, cotangents)
    seen = torch.autograd.grad(image, place, cotangents, retain_graph=True, is_grads_batched=True)[0]
    torch.testing.assert_close(seen, expected, rtol=1e-8, atol=1e-10)

    def pulled(row: torch.Tensor) -> torch.Tensor:
        return torch.autograd.grad(image, place, row, retain_graph=True)[0]

    torch.testing.assert_close(torch.func.vmap(pulled)(cotangents), expected, rtol=1e-8, atol=1e-10)


def test_a_jacobian_of_all_pixels_at_once_is_that_of_one_after_another(
    draw: Draw, place: torch.Tensor
) -> None:
    def coverage(where: torch.Tensor) -> torch.Tensor:
        return draw(where).coverage

    jacobian: Callable[..., Any] = torch.autograd.functional.jacobian
    expected = jacobian(coverage, place)
    assert expected.abs().max() > 0
    torch.testing.assert_close(jacobian(coverage, place, vectorize=True), expected, rtol=1e-8, atol=1e-10)


def test_renderings_are_pickled_saved_and_copied_whole(draw: Draw, place: torch.Tensor) -> None:
    expected, file = draw(place), io.BytesIO()
    torch.save(draw(place), file)
    file.seek(0)
    bare = draw(place.detach())
    for seen in (
        pickle.loads(pickle.dumps(draw(place))),
        torch.load(file, weights_only=False),
        copy.copy(draw(place)),
        copy.deepcopy(bare),
    ):
        for each in fields(Rendering):
            assert torch.equal(getattr(seen, each.name), getattr(expected, each.name)), each.name
        with pytest.raises(AttributeError, match="no shadow"):
            _ = seen.shadow


def test_inference_tensors_may_stand_beside_what_is_differentiated(world: Callable[..., World]) -> None:
    made, gradients = world(np.random.default_rng(32)), []
    with torch.inference_mode():
        frozen = made.inputs["back vertices"].clone()
    for vertices in (frozen, made.inputs["back vertices"]):
        albedo = made.inputs["back albedo"].clone().requires_grad_()
        values = {**made.inputs, "back vertices": vertices, "back albedo": albedo}
        scene: Any = made.build(values)
        scene = Scene([replace(scene.objects[1], translation=None)], scene.camera)
        seen = render(scene)
        gradients.append(torch.autograd.grad(seen.rgb.sum(), albedo)[0])
    assert torch.equal(*gradients)


@pytest.mark.parametrize("name", ["full_masks", "depth", "normals", "triangle_id"])
def test_what_is_first_read_in_inference_mode_belongs_to_its_rendering(
    draw: Draw, place: torch.Tensor, name: str
) -> None:
    seen = draw(place)
    with torch.inference_mode():
        late, inside = getattr(seen, name), draw(place)
    assert not late.is_inference() and late.requires_grad == (name != "triangle_id")
    if late.requires_grad:
        late = torch.where(late.isinf(), 0.0, late)
        assert torch.autograd.grad(late.sum(), place)[0].isfinite().all()
    assert torch.equal(getattr(inside, name), getattr(seen, name))
    assert getattr(inside, name).is_inference()


@pytest.mark.parametrize("focal", [[np.nan, 20.0], [-20.0, 20.0], [0.0, 20.0]])
def test_a_camera_that_sees_no_object_is_checked_too(world: Callable[..., World], focal: list[float]) -> None:
    scene = world(np.random.default_rng(33)).scene
    wrong = replace(scene.camera, focal=torch.tensor(focal, dtype=torch.float64))
    with pytest.raises(ValueError, match="focal of scene 1 must be"):
        render([scene, replace(scene, objects=[], camera=wrong)])
