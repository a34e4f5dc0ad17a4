import math
from dataclasses import replace

import numpy as np
import pytest

from tests.support import assert_close, points_of
from tests.vig.likelihood.mixture import mixture
from vig.likelihood import Geometry, Likelihood, Photos
from vig.recognition.network import latents_of, mirror_prediction
from vig.scene import EXPOSURE_L00, Latents
from vig_train.training.targets import numbers_of
from vig_world.raster.rasterize import rasterize


def covered_centres(studio, latents: Latents, factor: int = 1) -> np.ndarray:
    """Which pixels of an image `factor` times as large have their centre on the object: (H, W) bool."""
    model = studio.geometry.model
    rotation, translation = studio.camera.pose(latents.azimuth, latents.elevation)
    vertices = model.vertices(latents.shape)[0]
    camera = studio.camera.scale(factor)
    return rasterize(vertices, model.faces, rotation[0], translation[0], camera).face >= 0


def test_coverage_is_the_area_of_the_silhouette(studio) -> None:
    rng = np.random.default_rng(2)
    relative, largest, typical, one_sample = [], [], [], []
    for _ in range(4):
        latents = studio.latents(rng)
        _, coverage, _ = studio.render(latents)
        fine = covered_centres(studio, latents, 8)
        area = fine.reshape(studio.camera.height, 8, studio.camera.width, 8).mean((1, 3))
        rim = (area > 0) & (area < 1)
        error = np.abs(coverage[0] - area)
        relative.append(coverage.sum() / area.sum() - 1)
        largest.append(error.max())
        typical.append(error[rim].mean())
        one_sample.append(np.abs(covered_centres(studio, latents) - area)[rim].mean())
        assert coverage.min() >= 0 and coverage.max() <= 1
    assert np.abs(relative).max() < 0.003
    assert abs(np.mean(relative)) < 0.0005  # no bias: a tenth of a pixel in a hundred
    # A pixel that holds a corner or a thin part is off by up to half; a rim's pixel by 0.04 on average,
    # where one sample at the centre is off by 0.2.
    assert max(largest) < 0.55
    assert np.mean(typical) < 0.045 < 0.19 < np.mean(one_sample)


def test_the_silhouettes_motion_makes_no_jumps(studio) -> None:
    """In flat light only the silhouette's motion counts: the paper's mask jumps as each pixel comes or goes.

    Steps along .2 degrees of azimuth, .002 each, are off their median by more than .5 nats: over five scenes
    62 of the paper's, 3 of ours.
    """
    rng = np.random.default_rng(3)
    count = {"exact": 0, "paper": 0}
    for _ in range(2):
        latents = replace(studio.latents(rng), light=EXPOSURE_L00 * np.eye(1, 9))
        photo = studio.photo(rng, latents)
        path = np.tile(latents.to_vector(), (101, 1))
        path[:, studio.geometry.model.modes] += np.arange(101) * math.radians(0.002)
        points = points_of(Latents.from_vector(path))
        for silhouette in count:
            likelihood = studio.likelihood(photo, silhouette)
            steps = np.diff(likelihood.at(points, *studio.whose(len(path)), derivatives=False).value)
            count[silhouette] += np.count_nonzero(np.abs(steps - np.median(steps)) > 0.5)
    assert count["exact"] * 10 < count["paper"]


def test_the_mirrored_explanation_renders_the_mirrored_photo(studio) -> None:
    # The class is its own mirror image in y = 0: azimuth becomes pi - azimuth, light flips in y.
    rng = np.random.default_rng(4)
    latents = studio.latents(rng, 4)
    light = latents.light.copy()
    light[:, [1, 4, 5]] *= -1  # Y_1-1, Y_2-2, Y_2-1: odd in y
    flipped = Latents(latents.shape, math.pi - latents.azimuth, latents.elevation, latents.albedo, light)
    for ours, theirs in zip(studio.render(latents), studio.render(flipped), strict=True):
        off = np.abs(ours - theirs[:, :, ::-1]) > 1e-9
        assert off.mean() < 1e-4  # a centre exactly on an edge may go either way
    azimuth, numbers = mirror_prediction(latents.azimuth, numbers_of(latents))
    targets = latents_of(numbers, azimuth)
    assert_close(targets.light, flipped.light)
    assert_close(targets.azimuth, flipped.azimuth % (2 * math.pi))
    assert_close(targets.to_vector()[:, :10], flipped.to_vector()[:, :10])


def test_a_batch_is_its_members_and_scratch_is_not_seen(studio) -> None:
    rng = np.random.default_rng(6)
    latents, framing = studio.latents(rng, 3), rng.normal(0, 0.02, (3, 4))
    photos = np.concatenate([studio.photo(rng, latents[i : i + 1]) for i in range(2)])
    photo, sigma = np.array([1, 0, 1]), np.array([0.03, 0.1, 0.05])
    likelihood, points = studio.likelihood(photos), points_of(latents, framing)
    together = likelihood.at(points, photo, sigma, images=True)
    again = likelihood.at(points, photo, sigma, images=True)
    for name, value in vars(together).items():
        assert_close(vars(again)[name], value, rtol=1e-10, atol=1e-9)
    for i in range(3):
        one = slice(i, i + 1)
        alone = likelihood.at(points[one], photo[one], sigma[one], images=True)
        for name, value in vars(alone).items():
            assert_close(value, vars(together)[name][one], rtol=1e-9, atol=1e-6)
    plain = likelihood.at(points, photo, sigma, derivatives=False, images=True)
    assert plain.gradient is None and plain.normal is None
    assert_close(plain.value, together.value)


def test_single_precision_agrees(studio) -> None:
    rng = np.random.default_rng(8)
    single = Geometry(studio.geometry.model, np.float32)
    for _ in range(2):
        latents = studio.latents(rng)
        photo = studio.photo(rng, latents)
        guess = studio.near(rng, latents)
        photos = Photos(photo, studio.pixels.log_prior(studio.camera.height, studio.camera.width)[None])
        exact = studio.likelihood(photo).at(points_of(guess), *studio.whose(1))
        short = Likelihood(single, studio.camera, photos).at(points_of(guess), *studio.whose(1))
        assert short.gradient.dtype == np.float32 and short.value.dtype == np.float64
        assert short.value == pytest.approx(exact.value, rel=1e-5)
        ours, exactly = short.gradient[0].astype(np.float64), exact.gradient[0]
        assert ours @ exactly > 0.99999 * np.linalg.norm(ours) * np.linalg.norm(exactly)


def test_an_object_out_of_the_frame_leaves_the_background(studio) -> None:
    rng = np.random.default_rng(9)
    photo = studio.blocks(rng)[None]
    away = np.array([[5.0, 0.0, 0.0, 0.0]])
    found = studio.likelihood(photo).at(points_of(studio.latents(rng), away), *studio.whose(1), images=True)
    assert found.value == 0
    assert not found.coverage.any() and not found.gradient.any() and not found.normal.any()


def test_with_the_papers_silhouette_the_value_is_eq_4_summed_plainly(studio) -> None:
    rng = np.random.default_rng(0)
    latents = studio.latents(rng)
    photo = studio.photo(rng, studio.near(rng, latents))
    log_prior = np.log(rng.dirichlet((5, 2, 3), (1, studio.camera.height, studio.camera.width)))
    likelihood = Likelihood(studio.geometry, studio.camera, Photos(photo, log_prior), "paper")
    found = likelihood.at(points_of(latents), *studio.whose(1), images=True)
    inside = covered_centres(studio, latents)
    rendered = latents.albedo * found.irradiance[0, inside][:, None]
    value, posterior = mixture(photo[0, inside], rendered, log_prior[0, inside], studio.pixels.sigma)
    expected = value.sum() + log_prior[0, ~inside][:, 2].sum()
    assert found.value == pytest.approx(expected, rel=1e-10)
    assert_close(found.posterior[0, inside], posterior)
    assert not found.posterior[0, ~inside].any() and not found.irradiance[0, ~inside].any()
    assert_close(found.coverage[0], inside.astype(np.float64))
