"""Native evaluations beside plain torch."""

from dataclasses import dataclass

import numpy as np
import pytest
import torch

from tests.support import LATENT_PLACES, POINT, assert_close, points_of
from tests.vig.likelihood import reference
from tests.vig.likelihood.reference import faces_seen, shade, surface_at
from vig.likelihood import Evaluation, Geometry, Likelihood, Photos
from vig.parallel.threads import set_thread_count, thread_count
from vig.scene import Camera, Latents
from vig_world.raster.rasterize import rasterize

SIGMA = 0.03


@dataclass(frozen=True)
class Case:
    """A random occluded photo, priors that differ from pixel to pixel, and a guess (1, P')."""

    photo: np.ndarray
    log_prior: np.ndarray
    point: np.ndarray


def case(studio, seed: int) -> Case:
    rng = np.random.default_rng(seed)
    latents = studio.latents(rng)
    photo = studio.photo(rng, latents)
    log_prior = np.log(rng.dirichlet((5, 2, 3), photo.shape[:3]))
    return Case(photo, log_prior, points_of(studio.near(rng, latents), rng.normal(0, 0.02, (1, 4))))


def run_of(geometry: Geometry, camera: Camera, given: Case) -> Evaluation:
    """The evaluation of a case with the authors' constant mask."""
    likelihood = Likelihood(geometry, camera, Photos(given.photo, given.log_prior), "paper")
    return likelihood.at(given.point, np.zeros(1, np.int32), np.array([SIGMA]), images=True)


def assert_is_the_references(geometry: Geometry, camera: Camera, given: Case) -> Evaluation:
    """Value and gradient with the faces that pixels show held; coverage, and irradiances interpolated."""
    shaded = shade(geometry, camera, torch.from_numpy(given.point[0]))
    seen = faces_seen(geometry, shaded.screen, camera).numpy()
    run = run_of(geometry, camera, given)
    value, gradient = reference.value_and_gradient(
        geometry, camera, given.point[0], given.photo[0], given.log_prior[0], SIGMA, seen
    )
    assert run.value == pytest.approx(value, rel=1e-11)
    known, scale = POINT.indices(*reference.BLOCKS), np.abs(gradient).max()
    assert_close(run.gradient[0, known], gradient[known], rtol=1e-8, atol=1e-8 * scale)
    assert_close(run.coverage[0], (seen >= 0).astype(np.float64))
    y, x = np.nonzero(seen >= 0)
    assert len(y) > 500
    shown = torch.from_numpy(seen[y, x]), torch.from_numpy(np.stack([x + 0.5, y + 0.5], 1))
    lit, _ = surface_at(geometry, shaded, *shown)
    assert_close(run.irradiance[0][y, x], lit.numpy(), rtol=1e-9, atol=1e-9)
    return run


@pytest.mark.parametrize("seed", range(3))
def test_with_the_papers_mask_value_and_gradient_are_autograds(studio, seed: int) -> None:
    assert_is_the_references(studio.geometry, studio.camera, case(studio, 10 + seed))


def test_no_vertex_is_lit_by_less_than_nothing(studio) -> None:
    """Under light of one side the other's sum of lobes is negative: it is dark."""
    given = case(studio, 4)
    given.point[0, studio.geometry.layout["light"]] = [2.0, 0, 0, 4.0, 0, 0, 0, 0, 0]
    expected = shade(studio.geometry, studio.camera, torch.from_numpy(given.point[0])).irradiances.numpy()
    assert (expected == 0).sum() > 20 and (expected > 0).sum() > 20
    run = assert_is_the_references(studio.geometry, studio.camera, given)
    inside = run.coverage[0] > 0.5
    assert (run.irradiance[0][inside] == 0).sum() > 20 and (run.irradiance[0] >= 0).all()


def test_self_shadow_enters_value_and_gradient_as_in_torch(studio, teapot) -> None:
    """A transfer table adds D_0 + sum c_k D_k to the nine lobes of each vertex."""
    shadowed = Geometry(teapot.shape_model, np.float64, transfer=teapot.transfer.astype(np.float64))
    for seed in range(2):
        given = case(studio, 50 + seed)
        run = assert_is_the_references(shadowed, studio.camera, given)
        plain = run_of(studio.geometry, studio.camera, given)
        assert np.abs(run.irradiance - plain.irradiance).max() > 0.02


def test_the_pixels_covered_are_those_of_the_rasteriser(studio) -> None:
    """Which draws in single precision and without framing, and differs at a few edges only."""
    given = case(studio, 20)
    latents = Latents.from_vector(given.point[:, LATENT_PLACES])
    run = run_of(studio.geometry, studio.camera, Case(given.photo, given.log_prior, points_of(latents)))
    pose = (part[0] for part in studio.camera.pose(latents.azimuth, latents.elevation))
    vertices = studio.geometry.model.vertices(latents.shape)[0]
    fragments = rasterize(vertices, studio.geometry.model.faces, *pose, studio.camera, cull=True)
    assert ((fragments.face >= 0) != (run.coverage[0] > 0.5)).mean() < 2e-4


def test_several_threads_say_the_same(studio, teapot) -> None:
    rng = np.random.default_rng(30)
    latents = studio.latents(rng)
    photos = Photos(studio.photo(rng, latents), np.zeros((1, 150, 150, 3)))
    points = np.concatenate([points_of(studio.near(rng, latents)) for _ in range(5)]).astype(np.float32)
    likelihood = Likelihood(Geometry(teapot.shape_model), studio.camera, photos)
    which, sigma = studio.whose(5)
    one = likelihood.at(points, which, sigma, images=True)
    set_thread_count(3)
    try:
        three = likelihood.at(points, which, sigma, images=True)
        assert thread_count() == torch.get_num_threads() == 3
    finally:
        set_thread_count(1)
    assert np.array_equal(one.value, three.value) and np.array_equal(one.posterior, three.posterior)
    scale = np.abs(one.gradient).max(1, keepdims=True)
    assert np.abs((one.gradient - three.gradient) / scale).max() < 1e-6  # matrix products may round otherwise


def test_a_sparse_normal_matrix_is_near_the_full_one(studio) -> None:
    """Every second pixel of every second line: what the curvature is steered by, not what is maximised."""
    ratios = []
    for seed in range(3):
        given = case(studio, 40 + seed)
        full, sparse = (
            Likelihood(
                studio.geometry, studio.camera, Photos(given.photo, given.log_prior), stride=stride
            ).at(given.point, *studio.whose(1))
            for stride in (1, 2)
        )
        assert np.array_equal(full.value, sparse.value) and np.array_equal(full.gradient, sparse.gradient)
        ratios.append(sparse.normal[0].diagonal() / full.normal[0].diagonal())
    # What moves pixels has its curvature from few steep ones; colour and light from all of them.
    linear = studio.geometry.layout.indices("albedo", "light")
    off = np.abs(np.log(np.stack(ratios)))
    assert off[:, linear].max() < 0.15
    assert np.median(off) < 0.3 and off.max() < 1.5


def test_without_curvature_value_and_gradient_are_the_same(studio) -> None:
    given = case(studio, 7)
    likelihood = Likelihood(studio.geometry, studio.camera, Photos(given.photo, given.log_prior))
    full = likelihood.at(given.point, *studio.whose(1))
    first = likelihood.at(given.point, *studio.whose(1), curvature=False)
    assert first.normal is None
    assert_close(first.value, full.value)
    assert_close(first.gradient, full.gradient)


def test_no_points_have_no_values(studio) -> None:
    given = case(studio, 0)
    likelihood = Likelihood(studio.geometry, studio.camera, Photos(given.photo, given.log_prior))
    none = likelihood.at(given.point[:0], *studio.whose(0), images=True)
    assert (
        none.value.shape == (0,)
        and none.gradient.shape == (0, POINT.size)
        and none.coverage.shape == (0, 150, 150)
    )


def test_edges_stiffen_what_moves_them(studio) -> None:
    """The normal matrix of the exact silhouette is the paper's and what the edges' gain adds to it."""
    given = case(studio, 60)
    photos = Photos(given.photo, given.log_prior)
    exact, paper = (
        Likelihood(studio.geometry, studio.camera, photos, silhouette)
        .at(given.point, *studio.whose(1))
        .normal
        for silhouette in ("exact", "paper")
    )
    added = (exact - paper)[0].diagonal() / paper[0].diagonal()
    assert (added[POINT.indices("shape", "azimuth", "elevation")] > 0.005).all()
    assert np.abs(added[POINT.indices("albedo", "light")]).max() < 1e-12  # these do not move an edge
