"""The native stages beside the same in plain torch: pictures, and gradients of every input."""

import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch.utils._python_dispatch import TorchDispatchMode

from tests.vig_renderer.conftest import World
from vig_renderer import MeshObject, Pinhole, Rendering, Scene, Topology, render, rendering

Build = Callable[[dict[str, torch.Tensor]], Scene | list[Scene]]
IMAGES = ("rgb", "coverage", "visible_masks", "full_masks", "depth", "normals")
IDS = ("object_id", "triangle_id")


def both_ways(
    build: Build, inputs: dict[str, torch.Tensor], **how: Any
) -> tuple[Rendering, list[torch.Tensor]]:
    """A rendering, and the gradient of a random weighing of all its images by every input."""
    leaves = {name: value.clone().requires_grad_() for name, value in inputs.items()}
    seen, random = render(build(leaves), **how), torch.Generator().manual_seed(0)
    total = torch.zeros((), dtype=torch.float64)
    for name in IMAGES:
        image = getattr(seen, name).double()
        weights = torch.randn(image.shape, generator=random, dtype=torch.float64)
        total = total + (weights * torch.where(image.isinf(), 0.0, image)).sum()
    return seen, list(torch.autograd.grad(total, list(leaves.values()), materialize_grads=True))


def compare(build: Build, inputs: dict[str, torch.Tensor], **how: Any) -> None:
    """Both, within rounding: in float32 images were within 6e-6 and gradients within 1e-5."""
    single = next(iter(inputs.values())).dtype == torch.float32
    image_bound, gradient_bound = (2e-5, 1e-4) if single else (1e-10, 1e-9)
    seen, gradients = both_ways(build, inputs, **how)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rendering, "differentiates_forward", lambda tensors: True)
        plain, expected = both_ways(build, inputs, **how)
    for name in IDS:
        assert torch.equal(getattr(seen, name), getattr(plain, name)), name
    for name in IMAGES:
        torch.testing.assert_close(getattr(seen, name), getattr(plain, name), rtol=0, atol=image_bound)
    for name, mine, theirs in zip(inputs, gradients, expected, strict=True):
        scale = float(theirs.abs().max())
        assert float((mine - theirs).abs().max()) <= gradient_bound * scale + 1e-12, name


@pytest.mark.parametrize(
    "how", [{}, {"shading": "pixel"}, {"samples": 2}, {"shading": "pixel", "samples": 3}]
)
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_random_scenes(world: Callable[..., World], how: dict[str, Any], dtype: torch.dtype) -> None:
    """In float32 of such seeds only where rounding does not decide whether an edge is seen: most, not all."""
    seed = 21 if dtype == torch.float64 else 35
    for number in range(3):
        made = world(np.random.default_rng([seed, number]), dtype=dtype)
        compare(made.build, made.inputs, **how)


def test_a_batch_of_unlike_scenes(world: Callable[..., World]) -> None:
    """None, one and two objects; with normals of its own, without light, before a plain background."""
    made = world(np.random.default_rng(22))

    def build(values: dict[str, torch.Tensor]) -> list[Scene]:
        scene = made.build(values)
        front, back = scene.objects
        own = replace(front, normals=values["front vertices"] * 3, texture=None)
        dark = replace(back, light=None, rotation=values["front rotation"])
        plain = replace(scene, background=values["back albedo"][0], lamp=None)
        return [scene, replace(plain, objects=[dark, own, front]), replace(plain, objects=[]), plain]

    compare(build, made.inputs)
    compare(build, made.inputs, shading="pixel")


def test_meshes_across_the_near_plane() -> None:
    """Soups of triangles that pierce each other, before, across and behind the eye's plane."""
    eye = [torch.tensor(a, dtype=torch.float64) for a in ([30.0, 31.0], [14.2, 11.9], np.eye(3), [0, 0, 0.0])]
    for number in range(6):
        rng = np.random.default_rng([23, number])
        centre = rng.uniform((-0.3, -0.3, -0.2), (0.3, 0.3, 0.9), (40, 1, 3))
        corners = (centre + rng.uniform(0.02, 0.2, (40, 1, 1)) * rng.normal(size=(40, 3, 3))).reshape(-1, 3)
        topologies = [Topology.of(np.arange(60).reshape(-1, 3), half) for half in np.split(corners, 2)]

        def build(values: dict[str, torch.Tensor], topologies: list[Topology] = topologies) -> Scene:
            halves = values["vertices"].split(60)
            objects = [
                MeshObject(half, topology, values["albedo"])
                for half, topology in zip(halves, topologies, strict=True)
            ]
            return Scene(objects, Pinhole(30, 24, *eye))

        albedo = torch.from_numpy(rng.uniform(size=3))
        compare(build, {"vertices": torch.from_numpy(corners), "albedo": albedo})


class _Large(TorchDispatchMode):
    """Names of operations that make more numbers than torch gives to one thread."""

    names: set[str]

    def __torch_dispatch__(self, function: Any, types: Any, arguments: Any = (), named: Any = None) -> Any:
        result = function(*arguments, **(named or {}))
        if isinstance(result, torch.Tensor) and result.numel() > 32768:
            self.names.add(function.overloadpacket.__name__)
        return result


def test_no_picture_passes_through_operations_that_torch_shares_out(world: Callable[..., World]) -> None:
    """On more threads these wait for each other far longer than they compute."""
    made = world(np.random.default_rng(25), size=256)
    leaves = {name: value.clone().requires_grad_() for name, value in made.inputs.items()}
    background = torch.zeros(3, dtype=torch.float64)
    with _Large() as large:
        large.names = set()
        seen = render([replace(made.build(leaves), background=background)] * 2)
        images = [seen.rgb, seen.coverage, seen.visible_masks]
        torch.autograd.backward(images, [torch.ones_like(image) for image in images])
    assert large.names <= {"new_empty", "empty_like", "ones_like", "detach", "select", "alias"}


def test_what_is_computed_later_belongs_to_the_graph_of_its_rendering(world: Callable[..., World]) -> None:
    made = world(np.random.default_rng(26))
    place = made.inputs["front translation"].clone().requires_grad_()
    seen = render(made.build({**made.inputs, "front translation": place}))
    with torch.no_grad():
        assert seen.full_masks.requires_grad and seen.depth.requires_grad
        bare = render(made.build({**made.inputs, "front translation": place}))
    assert not bare.full_masks.requires_grad
    assert torch.equal(seen.full_masks, bare.full_masks)
    with pytest.raises(AttributeError, match="no shadow"):
        _ = seen.shadow


SHORT_OF_MEMORY = """
import resource
from collections import Counter
import numpy as np
import torch
import test_native
from conftest import random_world

def attempt(more):
    leaf = vertices.clone().requires_grad_()
    resource.setrlimit(resource.RLIMIT_AS, (more and virtual() + more, hard))
    try:
        seen = test_native.render(made.build({**made.inputs, "front vertices": leaf}), samples=40)
        (seen.rgb.sum() + seen.full_masks.sum()).backward()
        return "drawn"
    except (MemoryError, RuntimeError) as error:
        return type(error).__name__
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (resource.RLIM_INFINITY, hard))

def virtual():
    return 4096 * int(open("/proc/self/statm").read().split()[0])

hard = resource.getrlimit(resource.RLIMIT_AS)[1]
made = random_world(np.random.default_rng(2), size=24)
vertices = made.inputs["front vertices"]
test_native.render(made.build(made.inputs)).full_masks
print(*sorted(Counter(attempt(more << 20) for more in range(4, 124, 8)).items()))
"""


@pytest.mark.skipif(sys.platform != "linux", reason="bounds a process's memory as Linux does")
def test_too_little_memory_is_an_error() -> None:
    """However little there is: native code ends with a MemoryError, torch's own with a RuntimeError."""
    command, here = [sys.executable, "-c", SHORT_OF_MEMORY], Path(__file__).parent
    paths = os.pathsep.join([str(here), *sys.path])
    done = subprocess.run(command, capture_output=True, text=True, env={**os.environ, "PYTHONPATH": paths})
    assert done.returncode == 0, done.stderr
    assert "MemoryError" in done.stdout and "drawn" in done.stdout, done.stdout


def test_inputs_of_any_strides_have_the_same_gradients(world: Callable[..., World]) -> None:
    made, gradients = world(np.random.default_rng(28)), []
    for strided in (False, True):
        leaves = {name: value.clone().requires_grad_() for name, value in made.inputs.items()}
        values = leaves
        if strided:
            leaves = {
                name: value.detach().permute(*range(value.ndim)[::-1]).contiguous().requires_grad_()
                for name, value in made.inputs.items()
            }
            values = {name: value.permute(*range(value.ndim)[::-1]) for name, value in leaves.items()}
        seen = render(made.build(values))
        (seen.rgb.square().sum() + seen.full_masks.sum() + seen.normals.sum()).backward()
        gradients.append([values[name].grad if not strided else leaves[name].grad for name in made.inputs])
    for plain, other in zip(*gradients, strict=True):
        assert torch.equal(plain, other.permute(*range(other.ndim)[::-1]))


def test_points_beyond_all_numbers_have_finite_gradients(world: Callable[..., World]) -> None:
    made = world(np.random.default_rng(29), dtype=torch.float32)
    leaf = (made.inputs["front vertices"] * 1e37).requires_grad_()
    render(made.build({**made.inputs, "front vertices": leaf}), samples=2).rgb.sum().backward()
    assert leaf.grad is not None and leaf.grad.isfinite().all()


@pytest.mark.parametrize("threads", [2, 3])
def test_threads_and_batches_give_the_same_bits(world: Callable[..., World], threads: int) -> None:
    made = world(np.random.default_rng(27), dtype=torch.float32)
    results, before = [], torch.get_num_threads()
    for count, asked in ((1, 1), (4, 1), (4, threads)):
        leaves = {name: value.clone().requires_grad_() for name, value in made.inputs.items()}
        torch.set_num_threads(asked)
        try:
            seen = render([made.build(leaves)] * count, samples=2)
            seen.rgb[-1].square().sum().backward()
        finally:
            torch.set_num_threads(before)
        results.append([seen.rgb[-1], *(leaf.grad for leaf in leaves.values())])
    for other in results[1:]:
        assert all(torch.equal(a, b) for a, b in zip(results[0], other, strict=True))


def test_the_renderer_stands_on_its_own() -> None:
    """Its import brings no network, no fit and no photograph."""
    listed = "import sys, vig_renderer; print(*sys.modules)"
    names = subprocess.run([sys.executable, "-c", listed], capture_output=True, text=True, check=True).stdout
    assert {name.split(".")[0] for name in names.split() if name.startswith("vig")} == {"vig_renderer"}
    rooms = subprocess.run(
        [sys.executable, "-c", listed.replace("vig_renderer", "vig.renderer")],
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    assert {name for name in rooms.split() if name.startswith("vig.")} == {"vig.renderer"}
