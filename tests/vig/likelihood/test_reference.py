"""Native evaluations beside plain torch."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
import torch

from tests.support import LATENT_PLACES, POINT, assert_close, points_of
from tests.vig.likelihood import reference
from tests.vig.likelihood.reference import shade, surface_at
from vig.likelihood import Evaluation, Geometry, Likelihood, Photos
from vig.parallel.threads import set_thread_count, thread_count
from vig.scene import Camera, Latents
from vig_native import engine
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


class Stages:
    """Results of the stages of an evaluation, and the evaluation itself."""

    LIGHT, IRRADIANCE = slice(6, 15), 15  # columns of `rest_rows`, see rows.h

    def __init__(self, geometry: Geometry, camera: Camera, given: Case):
        likelihood = Likelihood(geometry, camera, Photos(given.photo, given.log_prior), "paper", stride=1)
        made = engine.stages(geometry.native, likelihood.native, given.point[0], SIGMA)
        self.face, points, used, normals, self.shape_rows, self.rest_rows = made.values()
        self.screen, self.irradiances, self.normals = points[:, :3], points[:, 3], normals[:, :3]
        self.used, self.has_shape_row = used != 0, used == 2
        self.evaluation: Evaluation = likelihood.at(
            given.point, np.zeros(1, np.int32), np.array([SIGMA]), images=True
        )


def assert_derivatives_are_autograds(geometry: Geometry, camera: Camera, given: Case, run: Stages) -> None:
    """Value and gradient with the faces that each pixel shows held."""
    value, gradient = reference.value_and_gradient(
        geometry, camera, given.point[0], given.photo[0], given.log_prior[0], SIGMA, run.face
    )
    assert run.evaluation.value == pytest.approx(value, rel=1e-11)
    known, scale = POINT.indices(*reference.BLOCKS), np.abs(gradient).max()
    assert_close(run.evaluation.gradient[0, known], gradient[known], rtol=1e-8, atol=1e-8 * scale)


def irradiance_jacobian(geometry: Geometry, camera: Camera, given: Case, vertices: np.ndarray) -> np.ndarray:
    """Derivatives (n, P') of the irradiances of some vertices (n,), by autograd."""
    return torch.autograd.functional.jacobian(
        lambda point: shade(geometry, camera, point).irradiances[vertices], torch.from_numpy(given.point[0])
    ).numpy()


@pytest.mark.parametrize("seed", range(2))
def test_vertices_are_placed_and_shaded_as_by_torch(studio, seed: int) -> None:
    given = case(studio, seed)
    run = Stages(studio.geometry, studio.camera, given)
    expected = shade(studio.geometry, studio.camera, torch.from_numpy(given.point[0]))
    assert_close(run.screen, expected.screen.numpy(), rtol=1e-12, atol=1e-10)
    used, seen = run.used, run.face
    assert used.sum() > 500
    assert np.array_equal(np.flatnonzero(used), np.unique(studio.geometry.faces[seen[seen >= 0]]))
    assert_close(run.normals[used], expected.normals.numpy()[used], rtol=0, atol=1e-10)
    assert_close(run.irradiances[used], expected.irradiances.numpy()[used], rtol=0, atol=1e-10)


def test_no_vertex_is_lit_by_less_than_nothing(studio) -> None:
    """Under light of one side the other's sum of lobes is negative: it is dark."""
    given = case(studio, 4)
    given.point[0, studio.geometry.layout["light"]] = [2.0, 0, 0, 4.0, 0, 0, 0, 0, 0]
    run = Stages(studio.geometry, studio.camera, given)
    shaded = shade(studio.geometry, studio.camera, torch.from_numpy(given.point[0]))
    expected = shaded.irradiances.numpy()[run.used]
    assert (expected == 0).sum() > 20 and (expected > 0).sum() > 20
    assert_close(run.irradiances[run.used], expected, rtol=0, atol=1e-10)


def test_rows_of_vertices_are_their_irradiances_derivatives(studio) -> None:
    given = case(studio, 5)
    run = Stages(studio.geometry, studio.camera, given)
    assert 2 * run.has_shape_row.sum() > run.used.sum()
    used = np.flatnonzero(run.has_shape_row & (run.irradiances > 1e-3))[::20]
    jacobian = irradiance_jacobian(studio.geometry, studio.camera, given, used)
    modes = studio.geometry.model.modes
    assert_close(run.shape_rows[used][:, :modes], jacobian[:, :modes], rtol=1e-7, atol=1e-9)
    assert not run.shape_rows[used][:, modes:].any()
    assert_close(run.rest_rows[used][:, run.LIGHT], jacobian[:, studio.geometry.layout["light"]])
    assert_close(run.rest_rows[used][:, run.IRRADIANCE], run.irradiances[used])


@pytest.mark.parametrize("seed", range(3))
def test_with_the_mask_held_value_and_gradient_are_autograds(studio, seed: int) -> None:
    given = case(studio, 10 + seed)
    run = Stages(studio.geometry, studio.camera, given)
    assert_derivatives_are_autograds(studio.geometry, studio.camera, given, run)


def test_the_faces_seen_are_those_of_the_rasteriser_and_their_irradiance_is_interpolated(studio) -> None:
    given = case(studio, 20)
    run = Stages(studio.geometry, studio.camera, given)
    seen = run.face
    y, x = np.nonzero(seen >= 0)
    shaded = shade(studio.geometry, studio.camera, torch.from_numpy(given.point[0]))
    shown = torch.from_numpy(seen[y, x]), torch.from_numpy(np.stack([x + 0.5, y + 0.5], 1))
    lit, _ = surface_at(studio.geometry, shaded, *shown)
    assert_close(run.evaluation.irradiance[0][y, x], lit.numpy(), rtol=1e-9, atol=1e-9)
    # The public rasteriser, in single precision and without framing, differs at a few edges only.
    latents = Latents.from_vector(given.point[:, LATENT_PLACES])
    still = Case(given.photo, given.log_prior, points_of(latents))
    seen = Stages(studio.geometry, studio.camera, still).face
    pose = (part[0] for part in studio.camera.pose(latents.azimuth, latents.elevation))
    vertices = studio.geometry.model.vertices(latents.shape)[0]
    fragments = rasterize(vertices, studio.geometry.model.faces, *pose, studio.camera, cull=True)
    assert (fragments.face != seen).mean() < 2e-4


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


def test_self_shadow_enters_value_and_gradient_as_in_torch(studio, teapot) -> None:
    """A transfer table adds D_0 + sum c_k D_k to the nine lobes of each vertex."""
    table = teapot.transfer.astype(np.float64)
    shadowed = Geometry(teapot.shape_model, np.float64, transfer=table)
    for seed in range(2):
        given = case(studio, 50 + seed)
        run = Stages(shadowed, studio.camera, given)
        assert_derivatives_are_autograds(shadowed, studio.camera, given, run)
        used = np.flatnonzero(run.has_shape_row & (run.irradiances > 1e-3))[::30]
        jacobian = irradiance_jacobian(shadowed, studio.camera, given, used)
        modes = shadowed.model.modes
        assert_close(run.shape_rows[used][:, :modes], jacobian[:, :modes], rtol=1e-7, atol=1e-9)
        plain = Stages(studio.geometry, studio.camera, given)
        assert np.abs((run.irradiances - plain.irradiances)[used]).max() > 0.02


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
