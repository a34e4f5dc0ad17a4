"""The derivatives of Eq. 4 against central differences of the same number, in float64."""

import numpy as np
import pytest

from tests.support import POINT, points_of
from vig.likelihood import Likelihood

STENCIL = ((-2, 1 / 12), (-1, -8 / 12), (1, 8 / 12), (2, -1 / 12))
"""Fourth-order central difference: offsets in steps, weights."""


def central(studio, likelihood: Likelihood, point: np.ndarray, column: int, step: float) -> float:
    """d value / d point[column] of a point (1, P')."""
    points = point.repeat(len(STENCIL), 0)
    points[:, column] += [offset * step for offset, _ in STENCIL]
    found = likelihood.at(points, *studio.whose(len(STENCIL)), derivatives=False)
    return sum(w * v for (_, w), v in zip(STENCIL, found.value, strict=True)) / step


@pytest.mark.parametrize("seed", range(2))
def test_the_gradient_is_the_objectives_own(studio, seed: int) -> None:
    """Every number of a point, on a random occluded photo, at a guess off the truth.

    A teapot hides parts of itself; in every second photo the border cuts off part of it, too.
    """
    rng = np.random.default_rng(seed)
    latents = studio.latents(rng)
    shift = np.zeros((1, 4))
    if seed % 2:
        shift = rng.uniform((0.2, -0.3, 0.0, -0.1), (0.35, 0.3, 0.3, 0.1))[None]
        shift[0, 0] *= rng.choice([-1.0, 1.0])
    likelihood = studio.likelihood(studio.photo(rng, latents, shift))
    framing = shift + rng.normal(0, 0.01, (1, 4))
    point = points_of(studio.near(rng, latents), framing)
    found = likelihood.at(point, *studio.whose(1), images=True)
    if seed % 2:
        covered = found.coverage[0] > 0.5
        assert covered[:, [0, -1]].any(), "the border must cut the object"
    analytic = found.gradient[0]
    assert len(analytic) == POINT.size
    numeric = np.array([central(studio, likelihood, point, column, 1e-7) for column in range(POINT.size)])

    def error() -> np.ndarray:
        return np.abs(analytic - numeric) / (np.abs(numeric) + 1e-3 * np.abs(analytic).max())

    # Where a pixel's centre passes an edge within the stencil a shorter step is the better difference.
    for step in (1e-8, 1e-9):
        for column in np.nonzero(error() > 1e-5)[0]:
            shorter = central(studio, likelihood, point, column, step)
            if abs(shorter - analytic[column]) < abs(numeric[column] - analytic[column]):
                numeric[column] = shorter
    assert error().max() <= 1e-4, dict(
        zip(np.nonzero(error() > 1e-4)[0], error()[error() > 1e-4], strict=True)
    )


@pytest.mark.parametrize("seed", range(2))
def test_at_the_truth_the_interiors_normal_matrix_is_gauss_newtons(studio, seed: int) -> None:
    """J^T W J of the rendered colours, W the posterior over sigma squared, J by central differences."""
    rng = np.random.default_rng(200 + seed)
    latents = studio.latents(rng)
    point = points_of(latents)
    photo = studio.photo(rng, latents, occluded=False)
    likelihood = studio.likelihood(photo, "paper", stride=1)
    found = likelihood.at(point, *studio.whose(1), images=True)
    inside = found.coverage[0] > 0.5
    columns = []
    for column in range(POINT.size):
        ends = point.repeat(2, 0)
        ends[:, column] += [-1e-7, 1e-7]
        seen = likelihood.at(ends, *studio.whose(2), derivatives=False, images=True)
        assert ((seen.coverage > 0.5) == inside).all(), "a pixel flipped: choose another seed"
        colour = seen.irradiance[..., None] * ends[:, None, None, POINT["albedo"]]
        columns.append(((colour[1] - colour[0]) / 2e-7)[inside])
    jacobian = np.stack(columns, axis=-1)  # (pixels, 3, P')
    weight = found.posterior[0, inside] / studio.pixels.sigma**2
    expected = np.einsum("nci,n,ncj->ij", jacobian, weight, jacobian, optimize=True)
    scale = np.sqrt(expected.diagonal())
    off = (found.normal[0] - expected) / scale / scale[:, None]
    assert np.abs(off).max() < 1e-4
    # Nothing is left to explain: in the interior the truth is the maximum.
    assert np.abs(found.gradient).max() < 1e-6 * scale.max()
