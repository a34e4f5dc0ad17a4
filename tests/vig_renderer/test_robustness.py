"""Strange scenes: finite images, finite gradients."""

import os
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import torch

from vig_renderer import MeshObject, Pinhole, Rendering, Scene, Topology, pyramid, render

SCENES = int(os.environ.get("VIG_RANDOM_SCENES", "300"))


def strange_object(rng: np.random.Generator, dtype: torch.dtype) -> tuple[MeshObject, list[torch.Tensor]]:
    """Triangles anywhere round the eye, some degenerate; what of it is differentiable."""
    count = int(rng.integers(0, 25))
    vertices = rng.uniform(-0.5, 0.5, (count + 3, 3)) * 10 ** rng.uniform(-2, 1) + (
        0,
        0,
        rng.uniform(-0.5, 1),
    )
    if rng.random() < 0.3:
        vertices = np.round(vertices, 1)  # many at one place, on one line, on the eye's plane
    faces = rng.integers(0, len(vertices), (int(rng.integers(0, 60)), 3))
    tensors = [torch.tensor(vertices), torch.tensor(rng.random(3)), torch.tensor(rng.normal(0, 1, 9))]
    tensors += [
        torch.tensor(rng.random((*rng.integers(1, 6, 2), 3))),
        torch.tensor(rng.normal(size=(len(vertices), 2))),
    ]
    if rng.random() < 0.3:
        tensors[4] = tensors[4] * 1e6  # a footprint of a million texels
    leaves = [tensor.to(dtype).requires_grad_() for tensor in tensors]
    topology = Topology.of(faces, vertices)
    bare = MeshObject(leaves[0], topology, leaves[1], light=leaves[2])
    if rng.random() < 0.5:
        return bare, leaves[:3]
    return replace(bare, texture=pyramid(leaves[3]), texture_coordinates=leaves[4]), leaves


def assert_finite(seen: Rendering, leaves: list[torch.Tensor]) -> None:
    for name in ("rgb", "coverage", "visible_masks", "full_masks", "normals"):
        assert getattr(seen, name).isfinite().all(), name
    assert not seen.depth.isnan().any()
    for masks in (seen.visible_masks, seen.full_masks, seen.coverage):
        assert masks.numel() == 0 or (masks.min() >= -1e-4 and masks.max() <= 1 + 1e-4)
    if leaves:
        depth = torch.where(seen.depth.isinf(), 0.0, seen.depth)
        total = seen.rgb.sum() + seen.full_masks.sum() + depth.sum() + seen.normals.sum()
        for gradient in torch.autograd.grad(total, leaves, allow_unused=True, materialize_grads=True):
            assert gradient.isfinite().all()


def check_random_scenes(count: int, seed: int) -> None:
    for number in range(count):
        rng = np.random.default_rng([seed, number])
        dtype = (torch.float32, torch.float64)[number % 2]
        width, height = (int(n) for n in rng.integers(1, 20, 2))
        made = [strange_object(rng, dtype) for _ in range(rng.integers(0, 4))]
        focal, centre = rng.uniform(1, 50, 2), rng.normal(10, 10, 2)
        camera = Pinhole(
            width, height, *(torch.tensor(a, dtype=dtype) for a in (focal, centre, np.eye(3), np.zeros(3)))
        )
        seen = render(
            Scene([item for item, _ in made], camera),
            ("vertex", "pixel")[number // 2 % 2],
            1 + number // 4 % 2,
        )
        try:
            assert_finite(seen, [leaf for _, leaves in made for leaf in leaves])
        except AssertionError as error:
            raise AssertionError(f"scene {number} of seed {seed}: {error}") from error


def test_random_scenes_give_finite_images_and_gradients() -> None:
    check_random_scenes(SCENES, seed=0)


def test_nothing_at_all_is_the_background() -> None:
    camera = Pinhole(5, 4, torch.ones(2), torch.ones(2), torch.eye(3), torch.zeros(3))
    seen = render(Scene([], camera, background=torch.tensor([0.1, 0.2, 0.3])))
    assert (seen.rgb == torch.tensor([0.1, 0.2, 0.3])).all() and (seen.object_id == -1).all()
    assert seen.visible_masks.shape == (1, 0, 4, 5) and not seen.coverage.any()


@pytest.mark.parametrize("size", [1, pytest.param(4096, marks=pytest.mark.slow)])
def test_images_of_one_pixel_and_of_sixteen_million(world: Callable, size: int) -> None:
    made = world(np.random.default_rng(1), 32, torch.float32)
    alone = replace(made.scene, objects=made.scene.objects[:1], background=None)
    values = {name: made.inputs[name] * (size / 32) for name in ("focal", "centre")}
    large = replace(alone.camera, width=size, height=size, **values)
    with torch.no_grad():
        small, seen = render(alone), render(replace(alone, camera=large))
    assert seen.rgb.shape == (1, size, size, 3) and seen.rgb.isfinite().all()
    assert seen.coverage.mean().item() == pytest.approx(
        small.coverage.mean().item(), abs=0.002 if size > 1 else 0.3
    )
