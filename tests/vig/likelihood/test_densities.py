"""Every density of the noise: kernels against its reference, and its gradient."""

from typing import Any

import numpy as np
import pytest
import scipy.integrate

from tests.support import assert_close, points_of
from tests.vig.likelihood.mixture import LOG_DENSITIES, mixture
from vig.likelihood import DENSITIES, Likelihood, Photos
from vig_native import engine

SIGMA = 0.1


@pytest.mark.parametrize("name", DENSITIES)
def test_its_integral_is_one(name: str) -> None:
    """Over the radius r of the error: 4 pi r^2 p(r) dr, with sigma 1."""
    radius = np.linspace(0, 400, 400_001)[1:]
    p = np.exp(LOG_DENSITIES[name](radius**2 / 2) - engine.DENSITIES[name])
    assert scipy.integrate.trapezoid(4 * np.pi * radius**2 * p, radius) == pytest.approx(1, abs=1e-3)


@pytest.mark.parametrize("name", DENSITIES)
def test_kernels_compute_the_reference_and_its_gradient(name: str, studio: Any) -> None:
    rng = np.random.default_rng(0)
    latents = studio.latents(rng)
    _, coverage, colour = studio.render(latents)
    photo = colour + (1 - coverage[..., None]) * studio.blocks(rng)
    log_prior = studio.pixels.log_prior(studio.camera.height, studio.camera.width)
    likelihood = Likelihood(studio.geometry, studio.camera, Photos(photo, log_prior[None]), density=name)
    guess = studio.near(rng, latents)
    whose = studio.whose(1, SIGMA)
    seen = likelihood.at(points_of(guess), *whose, images=True)
    inside = seen.coverage[0] == 1
    rendered = seen.irradiance[0, ..., None] * guess.albedo[0]
    _, visible = mixture(photo[0], rendered, log_prior, SIGMA, name)
    assert_close(seen.posterior[0][inside], visible[inside])

    layout = likelihood.layout
    point = points_of(guess)
    gradient = likelihood.at(point, *whose).gradient[0]
    for column in layout.indices("azimuth", "elevation", "albedo", "light"):
        step = np.zeros_like(point)
        step[0, column] = 1e-6
        ends = [likelihood.at(point + sign * step, *whose, derivatives=False).value for sign in (1, -1)]
        assert gradient[column] == pytest.approx((ends[0][0] - ends[1][0]) / 2e-6, rel=1e-4, abs=1e-2)
