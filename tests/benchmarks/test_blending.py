"""The objective that blends colours, and the one edge on which the two are compared."""

import numpy as np
import pytest
import torch

from benchmarks import edge
from benchmarks.blending import ColourBlending, pixel_values
from vig.inference import Objective
from vig.likelihood import ROBUST, Likelihood, Photos, mixture
from vig.likelihood.kernels.geometry import Geometry
from vig.scene import Camera, Latents, ObjectClass


@pytest.fixture(scope="module")
def exact(teapot: ObjectClass) -> Objective:
    camera = Camera.standard(40, teapot.target_height)
    linear = torch.from_numpy(np.random.default_rng(0).uniform(0.3, 0.6, (1, 40, 40, 3)))
    photos = Photos(linear, ROBUST.log_prior(40, 40)[None])
    return Objective(Likelihood(Geometry(teapot.shape_model, torch.float64), camera, photos), teapot)


@pytest.fixture(scope="module")
def start(teapot: ObjectClass, exact: Objective) -> torch.Tensor:
    light = torch.from_numpy(teapot.light_prior_mean)[None]
    shape = torch.full((1, teapot.shape_model.modes), 0.3, dtype=torch.float64)
    angles = torch.tensor([[0.7, 0.4]], dtype=torch.float64)
    return exact.point(Latents(shape, angles[:, 0], angles[:, 1], torch.full((1, 3), 0.4).double(), light))


@pytest.mark.parametrize(
    "how", [{}, {"beyond": "constant"}, {"covered": "centre"}], ids=["beside", "constant", "centre"]
)
def test_the_gradient_is_that_of_the_value(
    teapot: ObjectClass, exact: Objective, start: torch.Tensor, how: dict
) -> None:
    problem = ColourBlending(exact, teapot, start, **how)
    zero, sigma = torch.zeros(1, dtype=torch.int32), torch.tensor([0.1], dtype=torch.float64)
    gradient = problem(start, zero, sigma).gradient
    assert gradient is not None
    for latent in (0, 3, 10, 11, 13, 17):
        step = torch.zeros_like(start)
        step[0, latent] = 1e-6
        higher, lower = (problem(start + s * step, zero, sigma, derivatives=False).value for s in (1, -1))
        assert float(gradient[0, latent]) == pytest.approx(float(higher - lower) / 2e-6, rel=1e-4, abs=1e-3)


def test_wholly_covered_and_bare_pixels_are_as_in_equation_4() -> None:
    observed, rendered = torch.rand(2, 5, 3, generator=torch.Generator().manual_seed(0)).double()
    log_prior = ROBUST.log_prior(1, 5)[0]
    share = torch.tensor([1.0, 1.0, 0.0, 0.0, 0.0], dtype=torch.float64, requires_grad=True)
    values = pixel_values(observed, rendered, share, log_prior, 0.2)
    covered, _ = mixture(observed, rendered, log_prior, 0.2)
    assert torch.equal(values[:2], covered[:2]) and torch.equal(values[2:], log_prior[2:, 2])
    values.sum().backward()
    assert share.grad is not None and torch.isfinite(share.grad).all()


def test_blended_colours_feel_no_edge_in_the_middle_of_a_wrong_pixel() -> None:
    # Residual 0.25 at sigma 0.03: exp(-34.7) times the Gaussian's height 2352, and 0.55 / 0.45.
    found = edge.edge(torch.tensor([0.5]), 1.0, 0.5, ROBUST)
    expected = np.exp(-(0.25**2) / (2 * 0.03**2)) / (2 * np.pi) ** 1.5 / 0.03**3 * 0.55 / 0.45
    assert float(found.posterior) == pytest.approx(expected, rel=1e-6)
    assert 0 < float(found.colours) < 1e-9
    assert float(found.likelihoods) == pytest.approx(np.log(2352 * 0.55), abs=0.01)


def test_blended_colours_know_where_in_its_own_pixel_an_edge_is() -> None:
    off = np.abs(edge.errors(0.5, ROBUST)).mean(0)
    assert off[0] < 0.01 < 0.2 < off[1]
