"""What a GPU computes beside what the processor does; skipped where there is none."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch
import warp as wp

import vig
from tests.support import points_of
from vig.likelihood import Likelihood, Photos
from vig.likelihood.geometry import Geometry
from vig.photo import Window
from vig.renderer import MeshObject, Pinhole, Scene, Topology, render
from vig_app.examples import example_photos
from vig_renderer.device import initialise


def has_gpu() -> bool:
    """Whether torch and Warp both have a GPU."""
    initialise()
    return torch.cuda.is_available() and wp.get_cuda_device_count() > 0


pytestmark = pytest.mark.skipif(not has_gpu(), reason="there is no GPU")
GPU = "cuda:0"


@pytest.mark.parametrize("dtype", [torch.float64, torch.float32])
def test_the_objective_is_that_of_the_processor(studio, dtype: torch.dtype) -> None:
    rng = np.random.default_rng(5)
    latents = studio.latents(rng, 12)
    log_prior = torch.from_numpy(np.log(rng.dirichlet((5, 2, 3), (2, 150, 150))))
    photos = Photos(torch.cat([studio.photo(rng, latents[:1]), studio.photo(rng, latents[1:2])]), log_prior)
    points, photo = points_of(latents), torch.arange(12, dtype=torch.int32) % 2

    def evaluated(at: str) -> list[torch.Tensor]:
        likelihood = Likelihood(Geometry(studio.geometry.model, dtype, at), studio.camera, photos)
        sigma = torch.full((12,), 0.03, dtype=dtype, device=at)
        found = likelihood.at(points.to(at, dtype), photo.to(at), sigma)
        assert found.gradient is not None and found.normal is not None
        return [each.double().cpu() for each in (found.value, found.gradient, found.normal)]

    # Sums are added in another order; in single precision an edge may pass on another side of a pixel.
    off = 1e-9 if dtype is torch.float64 else 2e-3
    for there, here in zip(evaluated(GPU), evaluated("cpu"), strict=True):
        for one, other in zip(there, here, strict=True):
            torch.testing.assert_close(one, other, rtol=off, atol=off * float(other.abs().max()))


def test_an_evaluation_can_be_captured(studio) -> None:
    """A graph of CUDA that is replayed with other points gives what a call does."""
    rng = np.random.default_rng(7)
    latents = studio.latents(rng, 2)
    log_prior = torch.from_numpy(np.log(rng.dirichlet((5, 2, 3), (1, 150, 150))))
    photos = Photos(studio.photo(rng, latents[:1]), log_prior)
    likelihood = Likelihood(Geometry(studio.geometry.model, torch.float64, GPU), studio.camera, photos)
    points = points_of(latents).to(GPU)
    photo = torch.zeros(2, dtype=torch.int32, device=GPU)
    sigma = torch.full((2,), 0.03, dtype=torch.float64, device=GPU)

    def results(run: Any) -> list[torch.Tensor]:
        torch.cuda.synchronize()
        return [each.clone() for each in (run.value, run.gradient, run.normal)]

    with likelihood._pass(2) as run:
        given = points.clone()
        run(given, photo, sigma, 2, False)
        graph = torch.cuda.CUDAGraph()
        with torch.cuda.graph(graph):
            run(given, photo, sigma, 2, False)
        expected = []
        for other in (points.flip(0), points + 0.01):
            run(other, photo, sigma, 2, False)
            expected.append(results(run))
            given.copy_(other)
            run.value.zero_(), run.gradient.zero_(), run.normal.zero_()
            graph.replay()
            for one, two in zip(results(run), expected[-1], strict=True):
                torch.testing.assert_close(one, two, rtol=1e-9, atol=1e-9 * float(two.abs().max()))
        assert not torch.equal(expected[0][0], expected[1][0])


def test_a_picture_and_its_gradient_are_those_of_the_processor(packaged: vig.ObjectClass) -> None:
    model = packaged.shape_model
    size = float(np.ptp(model.mean, axis=0).max())
    target = torch.from_numpy(np.random.default_rng(3).uniform(size=(96, 128, 3)))

    def drawn(at: str) -> list[torch.Tensor]:
        def leaf(numbers: object) -> torch.Tensor:
            return torch.tensor(np.asarray(numbers, np.float64), device=at, requires_grad=True)

        turn = [[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]
        vertices, light = leaf(model.mean), leaf([2.0, 0.3, 0.5, -0.4, *[0.1] * 5])
        focal = leaf([180.0, 170.0])
        albedo = leaf(np.full((len(model.mean), 3), 0.5))
        centre, rotation, translation = leaf([64.0, 48.0]), leaf(turn), leaf([0.0, 0.2 * size, 1.6 * size])
        topology = Topology.of(model.faces, model.mean, device=at)
        camera = Pinhole(128, 96, focal, centre, rotation, translation)
        found = render(Scene([MeshObject(vertices, topology, albedo, light=light)], camera))
        (found.rgb[0] - target.to(at)).square().sum().backward()
        leaves = vertices, focal, light, albedo, centre, rotation, translation
        pictures = [found.rgb, found.coverage, found.depth, found.object_id.double()]
        return [each.detach().cpu() for each in (*pictures, *(leaf.grad for leaf in leaves))]

    here, there = drawn("cpu"), drawn(GPU)
    assert 0.05 < float(here[1].mean()) < 0.9
    for one, other in zip(there, here, strict=True):
        finite = torch.isfinite(other)
        assert torch.equal(finite, torch.isfinite(one))
        scale = float(other[finite].abs().max())
        torch.testing.assert_close(one[finite], other[finite], rtol=1e-8, atol=1e-9 * scale)


def test_explanations_are_those_of_the_processor(packaged: vig.ObjectClass) -> None:
    """Both networks compute in bfloat16, whose sums differ, and fits end before they have converged."""
    window, alike = Window.of(150, 150), 0
    here, there = vig.Explainer(packaged), vig.Explainer(packaged, device="cuda")
    for example in example_photos():
        one, other = (each.explain(example.photo, window=window) for each in (here, there))
        turned = abs((one.azimuth_deg - other.azimuth_deg + 180) % 360 - 180)
        alike += one.verdict is other.verdict and turned < 2 and (one.mask != other.mask).mean() < 0.01
    assert alike >= len(example_photos()) - 1
